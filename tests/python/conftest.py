"""Common fixtures of the tests: every id with every observation choice."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from ruffini._schema import SHARED_CHANNELS

sys.path.insert(0, str(Path(__file__).parents[2] / "policies"))
sys.path.insert(0, str(Path(__file__).parents[1] / "reference"))

IDS = sorted(name for name in gym.registry if name.startswith("ruffini/"))
OBSERVATIONS: dict[str, dict[str, Any]] = {
    "default": {},
    "flat": {"obs": "flat"},
    "all": {"observation": SHARED_CHANNELS},
    "all flat": {"observation": SHARED_CHANNELS, "obs": "flat"},
    **{channel: {"observation": channel} for channel in SHARED_CHANNELS},
}
WHOLE = ["default", "flat", "all", "all flat"]
"""Choices with every shared channel among them, for what is slow."""
NEEDED: dict[str, dict[str, Any]] = {
    # A coarse pad: the shipped network has one size.
    "ruffini/GraspFragile-v0": {"tactile": "compliance", "resolution": {"nodes": 300}},
    # One object: each is condensed once.
    "ruffini/GraspSoft-v0": {"objects": "sphere"},
}
"""Settings without which an id is slow to test."""
MODES = ["NextStep", "SameStep", "Disabled"]


@pytest.fixture(params=IDS)
def env_id(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(params=OBSERVATIONS)
def choice(request: pytest.FixtureRequest, env_id: str) -> dict[str, Any]:
    return NEEDED.get(env_id, {}) | OBSERVATIONS[request.param]


def actions(rows: int, steps: int, seed: int = 0) -> np.ndarray:
    """Random actions (steps, rows, 5) that mostly go down and close."""
    drift = np.array([0, 0, -0.3, 0, 0.3])
    noise = np.random.default_rng(seed).uniform(-1, 1, (steps, rows, 5))
    return np.clip(noise + drift, -1, 1).astype(np.float32)


def flat(observation: Any) -> np.ndarray:
    """All channels in one array, in order."""
    if isinstance(observation, dict):
        return np.concatenate(list(observation.values()), axis=-1)
    return observation
