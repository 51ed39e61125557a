"""Success of a policy over fixed seeds, with its interval.

Use::

python policies/evaluate.py --policy policies/runs/GraspLift-v0-ppo-0
python policies/evaluate.py --policy scripted --episodes 200 --json scripted.json
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import subprocess
from pathlib import Path
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

import ruffini
from scripted_fragile import ScriptedFragile
from scripted_grasp import ScriptedGrasp
from scripted_hold import ScriptedHold
from scripted_soft import ScriptedSoft

LIFT = "ruffini/GraspLift-v0"

FIRST_SEED = 10_000
"""Evaluation seeds are this and the following; training seeds stay far below."""


class Policy(Protocol):
    """What acts: Stable-Baselines3's signature."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (N, 5) for observations of N environments."""


SCRIPTED: dict[str, type[Policy]] = {
    LIFT: ScriptedGrasp,
    "ruffini/GraspFragile-v0": ScriptedFragile,
    "ruffini/GraspSoft-v0": ScriptedSoft,
    "ruffini/HoldStill-v0": ScriptedHold,
}
"""The scripted policy of each environment."""


class RandomPolicy:
    """Uniform actions, the same on every run."""

    def __init__(self) -> None:
        self._random = np.random.default_rng(0)

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (N, 5) for observations of N environments."""
        rows = len(next(iter(observation.values())))
        return self._random.uniform(-1, 1, (rows, 5)).astype(np.float32), state


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
    """The policy of that name for an environment, or that of a run folder.

    Raises:
        ValueError: If there is neither.
    """
    if name == "scripted" and env_id in SCRIPTED:
        return SCRIPTED[env_id]()
    if name == "random":
        return RandomPolicy()
    if (Path(name) / "run.json").is_file():
        return TrainedPolicy(Path(name))
    raise ValueError(f"policy: found {name!r}, expected scripted, random or the folder of a run")


def wilson(successes: int, n: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    z = 1.96
    share, spread = successes / n, z * z / n
    middle = (share + spread / 2) / (1 + spread)
    half = z * math.sqrt(share * (1 - share) / n + spread / (4 * n)) / (1 + spread)
    return max(0.0, middle - half), min(1.0, middle + half)


def evaluate(policy: Policy, env_id: str, episodes: int, **settings: Any) -> dict[str, Any]:
    """One episode a seed, all stepped together: success, interval, return, and by object."""
    envs = gym.make_vec(
        env_id, num_envs=episodes, autoreset_mode=AutoresetMode.DISABLED, **settings
    )
    observation, _ = envs.reset(seed=FIRST_SEED)
    objects = [envs.look(row)["object"] for row in range(episodes)]  # type: ignore[attr-defined]
    returns, success = np.zeros(episodes), np.zeros(episodes, bool)
    ended, state = np.zeros(episodes, bool), None
    while not ended.all():
        action, state = policy.predict(observation, state, deterministic=True)
        observation, reward, terminated, truncated, info = envs.step(action)
        returns += np.where(ended, 0.0, reward)
        over = (terminated | truncated) & ~ended
        success[over] = info["is_success"][over]
        ended |= over
        if terminated.any() and not ended.all():
            # A row that ended early idles in a new episode, which does not count.
            observation, _ = envs.reset(options={"reset_mask": terminated})
    low, high = wilson(int(success.sum()), episodes)
    by_object = {
        name: [int(success[rows].sum()), len(rows)]
        for name in sorted(set(objects))
        for rows in [[row for row, other in enumerate(objects) if other == name]]
    }
    return {
        "env": env_id,
        "episodes": episodes,
        "first_seed": FIRST_SEED,
        "success": float(success.mean()),
        "interval": [round(low, 4), round(high, 4)],
        "return": round(float(returns.mean()), 3),
        "by_object": by_object,
    }


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
        "commit": commit,
    }


def line(name: str, result: dict[str, Any]) -> str:
    """A result as a line of a table."""
    low, high = result["interval"]
    return (
        f"{name:<24} {result['success']:7.1%}  ({low:.1%} to {high:.1%})"
        f"   return {result['return']:6.2f}"
    )


def main() -> None:
    """Parses the command line, evaluates, prints and writes."""
    parser = argparse.ArgumentParser(description="Evaluate a policy over fixed seeds.")
    parser.add_argument("--policy", required=True, help="scripted, random or a run's folder")
    parser.add_argument("--env", default=LIFT, choices=sorted(SCRIPTED), help="environment id")
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
    trained_with = policy.environment if isinstance(policy, TrainedPolicy) else {}
    settings = trained_with | arguments.settings
    result = evaluate(policy, arguments.env, arguments.episodes, **settings)
    print(line(Path(arguments.policy).name, result))
    for name, (good, of) in result["by_object"].items():
        print(f"  {name:<22} {good:4d} of {of}")
    if arguments.json:
        about = {"policy": Path(arguments.policy).name, "settings": settings}
        document = about | result | about_this_run()
        arguments.json.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main()
