"""Agents of random numbers, made without torch."""

from __future__ import annotations

import gymnasium as gym
import numpy as np

import ruffini
from ruffini.agents import FORMAT, Agent, _agent

HOLD = "ruffini/HoldStill-v0"
COARSE = {"tactile": "compliance", "resolution": {"nodes": 150}, "max_episode_steps": 12}


def card(env_id=HOLD, settings=COARSE):
    """The card of an agent that nobody has trained."""
    env = gym.make(env_id, **settings).unwrapped
    channels = {name: sum(len(p[1]) for p in parts) for name, parts in env.channels()}
    felt = [name for name in ("markers", "stress") if name in channels]
    return {
        "format": FORMAT,
        "ruffini": ruffini.__version__,
        "commit": "abc1234",
        "env": env_id,
        "settings": dict(settings),
        "channels": channels,
        "algorithm": "ppo",
        "policy": "MultiInputPolicy",
        "hyperparameters": {"gamma": 0.97, "n_envs": 2},
        "seed": 0,
        "steps": 1000,
        "threads": 1,
        "evaluation": {
            "episodes": 200,
            "first_seed": 10_000,
            "success": 0.9,
            "interval": [0.851, 0.934],
            "return": 1.0,
        },
        "network": {
            "order": sorted(channels),
            "touch": {name: [8, 4] for name in felt},
            "policy": [16],
            "value": [16],
            "activation": "Tanh",
        },
        "normaliser": {
            "channels": [name for name in channels if name not in felt],
            "count": 1e3,
            "clip": 10.0,
            "epsilon": 1e-8,
        },
    }


def tensors(of):
    """Random numbers for a card."""
    drawn = np.random.default_rng(0)
    made = {}
    for name, shape in _agent.shapes(of).items():
        kind = np.float64 if name.startswith("normaliser") else np.float32
        made[name] = np.asarray(np.abs(0.1 * drawn.standard_normal(shape)) + 0.01, kind)
    return made


def drawn(env_id=HOLD, settings=COARSE):
    """An agent of random numbers."""
    made = card(env_id, settings)
    return Agent(made, tensors(made))
