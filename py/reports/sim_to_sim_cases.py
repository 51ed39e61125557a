"""Cases of `sim_to_sim`: an episode with either model."""

from __future__ import annotations

from collections import Counter
from functools import partial
from typing import Any

import gymnasium
import numpy as np

from ruffini import agents
from ruffini.policies import part, scripted
from timing import timed

MODELS = ("surrogate", "fem")
"""Models of touch that are compared."""
UNSOLVED = "press_failed"
"""Ending of an episode with a press that the model did not solve."""
NODES, MORE_NODES = 1000, 2000
"""Default number of nodes of an environment's pad, and that of a finer one."""
DRAWN = ("object", "size", "mass", "friction")
"""Parameters that are drawn at the start of an episode, alike with both models."""


def episode(task: str, policy: str, seed: int, model: str, nodes: int = NODES) -> dict[str, Any]:
    """Success, return, ending and time of one episode, on a pad of so many nodes."""
    env_id, settings = f"ruffini/{task}-v0", {}
    player: Any = scripted(env_id)
    if policy == "agent":
        player = agents.load(task)
        settings = player.settings
    settings = settings | {"tactile": model, "resolution": {"nodes": nodes}}
    env = gymnasium.make(env_id, disable_env_checker=True, **settings)
    (observation, _), reset_seconds, _ = timed(partial(env.reset, seed=seed))
    row: dict[str, Any] = {"reset_seconds": reset_seconds}
    drawn = env.unwrapped.look()
    row |= {name: drawn[name] for name in DRAWN}
    state, over, rewards, grips, terms, seconds, restarts = None, False, [], [], Counter(), 0.0, 0
    while not over:
        batch = {name: values[None] for name, values in observation.items()}
        action, state = player.predict(batch, state)
        (observation, reward, terminated, truncated, info), spent, _ = timed(env.step, action[0])
        seconds += spent
        over = terminated or truncated
        rewards.append(float(reward))
        grips.append(float(part(observation, "proprio", "grip force command")))
        terms.update(info["reward_terms"])
        restarts += "press_error" in info and info.get("ending") != UNSOLVED
    env.close()
    return row | {
        "success": bool(info["is_success"]),
        "return": sum(rewards),
        "ending": info.get("ending"),
        "press_error": info.get("press_error"),
        "restarts": restarts,
        "steps": len(rewards),
        "seconds": seconds,
        "terms": {name: float(value) / len(rewards) for name, value in terms.items()},
        "grip": float(np.mean(grips)),
    }
