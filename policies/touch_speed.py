"""Environment steps a second while both fingers touch, by model of touch and object.

The scripted policy grasps, lifts and holds in four environments; only steps in which all eight pads
touch are counted, by processor time, on one thread. Some minutes. Use::

    python policies/touch_speed.py --out policies/results/touch_speed.json
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from ruffini.evaluation import about_this_run
from ruffini.policies import part, scripted

MODELS = ("none", "surrogate", "compliance")
OBJECTS = ("sphere", "cuboid", "cylinder", "cup")
COUNT = 4
STEPS = 100
RIGID_STEPS = 2000
"""Of rigid pads, whose steps take tens of microseconds."""
FELT = 0.05
"""Force from which a pad counts as touching (N)."""


def main() -> None:
    """Measures every model with every object, and without one at hand, and writes the result."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--out", type=Path, required=True, help="the JSON file")
    out = parser.parse_args().out
    touching = {model: {name: measure(model, name) for name in OBJECTS} for model in MODELS}
    still = {model: untouched(model) for model in MODELS}
    report = {**about_this_run(), "touching": touching, "untouched": still}
    out.write_text(json.dumps(report, indent=1) + "\n")


def pad_forces(observation: dict[str, Any]) -> NDArray[np.float32]:
    """Normal force on each pad (N, 2) in N."""
    return part(observation, "proprio", "normal force of each pad")


def environments(model: str, name: str) -> Any:
    """A few environments on one thread."""
    one: dict[str, Any] = {"tactile": model, "objects": [name], "num_threads": 1}
    return gymnasium.make_vec("ruffini/GraspLift-v0", num_envs=COUNT, **one)


def measure(model: str, name: str) -> dict[str, Any]:
    """Steps a second with all pads touching, and how the episodes ended."""
    envs, policy = environments(model, name), scripted("ruffini/GraspLift-v0")
    observation, _ = envs.reset(seed=0)
    seconds, counted, episodes, lifted = 0.0, 0, 0, 0
    for _ in range(RIGID_STEPS if model == "none" else STEPS):
        action, _ = policy.predict(observation)
        start = time.process_time()
        observation, _, terminated, truncated, info = envs.step(action)
        if (pad_forces(observation) > FELT).all():
            seconds += time.process_time() - start
            counted += COUNT
        over = terminated | truncated
        episodes += int(over.sum())
        lifted += int(info["is_success"][over].sum()) if over.any() else 0
    row = {
        "steps_per_second": counted / seconds if seconds else None,
        "steps": counted,
        "episodes": episodes,
        "lifted": lifted,
    }
    print(model, name, row, flush=True)
    return row


def untouched(model: str) -> float:
    """Steps a second of a hand that stays where it starts, over the object."""
    envs = environments(model, "sphere")
    envs.reset(seed=0)
    still = np.zeros((COUNT, 5), np.float32)
    best = 0.0
    for _ in range(5):
        start = time.process_time()
        for _ in range(STEPS):
            observation, *_ = envs.step(still)
            if (pad_forces(observation) > FELT).any():
                raise RuntimeError("a pad touches")
        best = max(best, COUNT * STEPS / (time.process_time() - start))
    print({"tactile": model, "untouched": best}, flush=True)
    return best


if __name__ == "__main__":
    main()
