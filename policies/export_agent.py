"""Writes the last checkpoint of a training run as an agent of the package.

Use::

python policies/export_agent.py policies/runs/GraspLift-v0-ppo-0 --threads 2
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

import ruffini
from evaluate import line
from params import params
from ruffini.agents import MOST_BYTES
from ruffini.agents.sb3 import export
from train import CHECKPOINT, make_environment


def main() -> None:
    """Parses the command line, writes the agent and prints its success."""
    parser = argparse.ArgumentParser(description="Write a training run as an agent.")
    parser.add_argument("run", type=Path, help="folder of the run, of PPO")
    parser.add_argument("--threads", type=int, help="threads of the run; as it says if not given")
    parser.add_argument("--episodes", type=int, default=200, help="evaluation episodes")
    parser.add_argument("--out", type=Path, help="file; that of the package if not given")
    arguments = parser.parse_args()
    saved = arguments.run / CHECKPOINT
    if not (saved / "model.zip").is_file():
        parser.error(f"found no checkpoint in {arguments.run}, expected the folder of a run")
    about = json.loads((arguments.run / "run.json").read_text())
    threads = arguments.threads or about.get("threads")
    if threads is None:
        parser.error(f"--threads: {arguments.run} does not say how many it had")
    settings = about["environment"]
    chosen = params(about["env"], about["algorithm"]).with_settings(settings)
    envs = make_environment(about["env"], chosen, 0, 1)
    folder = Path(ruffini.__file__).parent / "agents"
    path = arguments.out or folder / f"{about['env'].split('/')[-1]}.safetensors"
    try:
        agent = export(
            PPO.load(saved / "model.zip", device="cpu"),
            VecNormalize.load(str(saved / "normaliser.pkl"), envs.venv),
            path,
            env_id=about["env"],
            settings=chosen.environment,
            seed=about["seed"],
            threads=threads,
            commit=", ".join(about["trained_by"]),
            episodes=arguments.episodes,
        )
    except ValueError as error:
        parser.error(str(error))
    size = path.stat().st_size
    print(line("agent", agent.card["evaluation"]))
    print(f"{path}: {size} bytes")
    if size > MOST_BYTES:
        sys.exit(f"{size} bytes are too many for the package, which has at most {MOST_BYTES}")


if __name__ == "__main__":
    main()
