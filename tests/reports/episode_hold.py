"""A quiet hold of 60 s: whether a model of touch lets what is held creep."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

STEPS = 1500
"""Control steps of a hold (60 s)."""
SETTLED = 25
"""Control steps after which it counts as settled (1 s)."""
GRIP = 4.0
"""Grip force (N)."""
THINGS = ("sphere", "cuboid")
CHANNELS = ("markers", "wrench")


def hold(thing: str, model: str, nodes: int) -> dict[str, float]:
    """What changes between the first second and the last of a hold without load or shaking.

    Relative L2 for channels; for the object the way it went (m).
    """
    env = gymnasium.make(
        "ruffini:ruffini/HoldStill-v0",
        tactile=model,
        objects=[thing],
        resolution={"nodes": nodes},
        observation=["proprio", "object", *CHANNELS],
        max_episode_steps=STEPS + 1,
        start_grip=GRIP,
        load=0.0,
        shaking=0.0,
        disable_env_checker=True,
    )
    env.reset(seed=3)
    kept: dict[int, dict[str, Any]] = {}
    for step in range(1, STEPS + 1):
        observation, _, terminated, _, info = env.step(np.zeros(5, np.float32))
        if step in (SETTLED, STEPS):
            kept[step] = {key: np.array(value, float) for key, value in observation.items()}
        if terminated:
            raise RuntimeError(f"{thing} with {model} ended after {step} steps: {info}")
    env.close()
    first, last = kept[SETTLED], kept[STEPS]
    change = {
        channel: float(
            np.linalg.norm(last[channel] - first[channel]) / np.linalg.norm(first[channel])
        )
        for channel in CHANNELS
    }
    return change | {"object": float(np.linalg.norm((last["object"] - first["object"])[:3]))}
