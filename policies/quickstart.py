"""Trains a small grasp agent that feels with both fingertips, and evaluates it.

Beside it are the scripted and the random policy.

Use::

python policies/quickstart.py
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from evaluate import TrainedPolicy, evaluate, line, load
from train import train

ENV_ID = "ruffini/GraspLift-v0"


def main() -> None:
    """Trains, evaluates, prints the table."""
    parser = argparse.ArgumentParser(description="Train and evaluate a small grasp agent.")
    parser.add_argument("--steps", type=int, default=600_000, help="environment steps")
    parser.add_argument("--episodes", type=int, default=200, help="evaluation episodes")
    parser.add_argument("--out", type=Path, help="keep the run in this folder")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.out or Path(scratch)
        started = time.monotonic()
        print(f"training PPO on {ENV_ID} for {arguments.steps:,} steps")
        train(ENV_ID, "ppo", 0, folder, steps=arguments.steps)
        minutes = (time.monotonic() - started) / 60
        print(f"\nsuccess over {arguments.episodes} fixed seeds (95 % interval):")
        policy = TrainedPolicy(folder)
        settings = policy.environment
        agent = evaluate(policy, ENV_ID, arguments.episodes, **settings)
        print(line(f"agent ({minutes:.1f} min)", agent))
        for name in ("scripted", "random"):
            print(line(name, evaluate(load(name), ENV_ID, arguments.episodes, **settings)))


if __name__ == "__main__":
    main()
