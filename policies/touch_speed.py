"""Environment steps a second while both fingers touch, by model of touch and object.

The scripted policy grasps, lifts and holds in four environments; only steps in which all eight pads
touch are counted, by processor time. Set RAYON_NUM_THREADS=1 for one thread. A minute. Use::

    RAYON_NUM_THREADS=1 python policies/touch_speed.py
"""

from __future__ import annotations

import json
import os
import subprocess
import time
from pathlib import Path
from typing import Any

import gymnasium

import ruffini
from scripted_grasp import ScriptedGrasp

MODELS = ("none", "surrogate", "surrogate-fine", "compliance")
OBJECTS = ("sphere", "cuboid", "cylinder")
COUNT = 4
STEPS = 100
FELT = 0.05
"""Force from which a pad counts as touching (N)."""
RESULT = Path(__file__).parent / "results" / "touch_speed.json"


def main() -> None:
    """Measures every model with every object and writes the result."""
    rows = [measure(model, name) for model in MODELS for name in OBJECTS]
    here = Path(__file__).parent
    git = ["git", "-C", str(here), "rev-parse", "--short", "HEAD"]
    commit = subprocess.check_output(git, text=True).strip()
    setup = {"commit": commit, "version": ruffini.__version__, "cores": os.cpu_count()}
    setup["threads"] = os.environ.get("RAYON_NUM_THREADS", "all")
    RESULT.write_text(json.dumps({**setup, "rows": rows}, indent=1) + "\n")


def measure(model: str, name: str) -> dict[str, Any]:
    """Steps a second with all pads touching, and how the episodes ended."""
    envs = gymnasium.make_vec("ruffini/GraspLift-v0", num_envs=COUNT, tactile=model, objects=[name])
    policy = ScriptedGrasp()
    observation, _ = envs.reset(seed=0)
    seconds, counted, episodes, lifted = 0.0, 0, 0, 0
    for _ in range(STEPS):
        action, _ = policy.predict(observation)
        start = time.process_time()
        observation, _, terminated, truncated, info = envs.step(action)
        if (observation["proprio"][:, 12:14] > FELT).all():
            seconds += time.process_time() - start
            counted += COUNT
        over = terminated | truncated
        episodes += int(over.sum())
        lifted += int(info["is_success"][over].sum()) if over.any() else 0
    row = {
        "tactile": model,
        "object": name,
        "steps_per_second": counted / seconds if seconds else None,
        "steps": counted,
        "episodes": episodes,
        "lifted": lifted,
    }
    print(row, flush=True)
    return row


if __name__ == "__main__":
    main()
