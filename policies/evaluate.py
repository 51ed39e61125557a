"""Success of a policy over fixed seeds, with its interval.

Use::

python policies/evaluate.py --policy policies/runs/GraspLift-v0-ppo-0
python policies/evaluate.py --policy scripted --episodes 200 --json scripted.json
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import ruffini
from ruffini import agents
from ruffini.evaluation import FIRST_SEED, Policy, evaluate, line, wilson
from ruffini.policies import RandomPolicy, scripted

__all__ = [
    "FIRST_SEED",
    "LIFT",
    "Policy",
    "RandomPolicy",
    "TrainedPolicy",
    "about_this_run",
    "evaluate",
    "line",
    "load",
    "wilson",
]

LIFT = "ruffini/GraspLift-v0"


class TrainedPolicy:
    """A training run's last checkpoint, with its normalisation."""

    def __init__(self, folder: Path) -> None:
        from stable_baselines3.common.vec_env import VecNormalize

        from params import params
        from train import ALGORITHMS, CHECKPOINT, make_environment

        about = json.loads((folder / "run.json").read_text())
        settings = about.get("environment", {})
        chosen = params(about["env"], about["algorithm"]).with_settings(settings)
        self.environment = chosen.environment
        """Settings that it was trained with."""
        envs = make_environment(about["env"], chosen, 0, 1)
        saved = folder / CHECKPOINT
        self._normaliser = VecNormalize.load(str(saved / "normaliser.pkl"), envs.venv)
        self._model = ALGORITHMS[about["algorithm"]].load(saved / "model.zip", device="cpu")

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (N, 5) for dict observations of N environments."""
        if not isinstance(self._normaliser.observation_space, gym.spaces.Dict):
            observation = np.concatenate(list(observation.values()), axis=1)
        normal = self._normaliser.normalize_obs(observation)
        action, state = self._model.predict(normal, deterministic=deterministic)
        return np.asarray(action, np.float32), state


def load(name: str, env_id: str = LIFT) -> Policy:
    """The policy of that name for an environment, or that of a run folder or an agent's file.

    Raises:
        ValueError: If there is neither.
    """
    if name == "scripted":
        return scripted(env_id)
    if name == "random":
        return RandomPolicy()
    if name == "agent":
        return agents.load(env_id)
    if Path(name).suffix == ".safetensors":
        return agents.load(name)
    if (Path(name) / "run.json").is_file():
        return TrainedPolicy(Path(name))
    expected = "scripted, random, agent, an agent's file or the folder of a run"
    raise ValueError(f"policy: found {name!r}, expected {expected}")


def about_this_run() -> dict[str, Any]:
    """Versions, machine and commit, for the record beside every figure."""
    here = Path(__file__).parent
    git = ["git", "-C", str(here), "rev-parse", "--short", "HEAD"]
    try:
        commit = subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        commit = "unknown"
    return {
        "ruffini": ruffini.__version__,
        "gymnasium": gym.__version__,
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "processor": processor(),
        "commit": commit,
    }


def processor() -> str:
    """The processor's name, with the caches that its first core reaches where Linux tells them."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(": ", 1)[1] for line in lines if line.startswith("model name")]
    caches = sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*"))
    told = [[(cache / key).read_text().strip() for key in ("level", "size")] for cache in caches]
    return ", ".join([*names[:1], *(f"L{level} {size}" for level, size in told if level > "1")])


def main() -> None:
    """Parses the command line, evaluates, prints and writes."""
    parser = argparse.ArgumentParser(description="Evaluate a policy over fixed seeds.")
    parser.add_argument(
        "--policy", required=True, help="scripted, random, agent, an agent's file or a run's folder"
    )
    parser.add_argument("--env", default=LIFT, help="environment id")
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument(
        "--settings", type=json.loads, default={}, help="the environment's, as JSON"
    )
    parser.add_argument("--json", type=Path, help="file to write the result to")
    arguments = parser.parse_args()
    if arguments.episodes < 1:
        parser.error(f"--episodes: found {arguments.episodes}, expected at least 1")
    try:
        policy = load(arguments.policy, arguments.env)
    except ValueError as error:
        parser.error(str(error))
    trained_with: dict[str, Any] = {}
    if isinstance(policy, TrainedPolicy):
        trained_with = policy.environment
    elif isinstance(policy, agents.Agent):
        trained_with = policy.settings
    settings = trained_with | arguments.settings
    result = evaluate(policy, arguments.env, arguments.episodes, **settings)
    print(line(Path(arguments.policy).name, result))
    for name, (good, of) in result["by_object"].items():
        print(f"  {name:<22} {good:4d} of {of}")
    for name, count in result["endings"].items():
        print(f"  ended by {name:<13} {count:4d}")
    if arguments.json:
        about = {"policy": Path(arguments.policy).name, "settings": settings}
        document = about | result | about_this_run()
        arguments.json.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
