"""Environments of other packages, for comparison with steps of ruffini's."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass

import gymnasium as gym
import numpy as np

from timing import steps_per_second


def fetch_pick_and_place(seconds: float) -> float:
    """MuJoCo's FetchPickAndPlace in one environment."""
    import gymnasium_robotics

    gym.register_envs(gymnasium_robotics)
    env = gym.make("FetchPickAndPlace-v4")
    env.reset(seed=0)

    def step(_count: int) -> None:
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        if terminated or truncated:
            env.reset()

    return steps_per_second(1, step, seconds)


def panda_pick_cube(seconds: float) -> float:
    """Envpool's PandaPickCube, 16 environments on one thread."""
    import envpool

    env = envpool.make_gymnasium("PandaPickCube-v1", num_envs=16, num_threads=1, seed=0)
    env.reset()
    random = np.random.default_rng(0)
    shape = (16, *env.action_space.shape)
    return steps_per_second(16, lambda _: env.step(random.uniform(-1, 1, shape)), seconds)


@dataclass(frozen=True)
class Peer:
    """Environments of another package on one thread."""

    packages: tuple[str, ...]
    """Modules that it needs."""
    control_step: float
    """Time that a step simulates (s)."""
    measure: Callable[[float], float]
    """Steps per second, measured for so many seconds."""


PEERS = {
    "FetchPickAndPlace, 1 environment": Peer(
        ("gymnasium_robotics", "mujoco"), 0.04, fetch_pick_and_place
    ),
    "envpool PandaPickCube, 16 environments": Peer(("envpool",), 0.02, panda_pick_cube),
}


def peer(name: str, seconds: float) -> float | str:
    """Steps per second of a peer, or why there is none."""
    for package in PEERS[name].packages:
        if importlib.util.find_spec(package) is None:
            return f"{package} is not installed"
    try:
        return round(PEERS[name].measure(seconds), 1)
    except Exception as error:  # A peer that fails must not take the measurement with it.
        return f"failed: {error!r}"
