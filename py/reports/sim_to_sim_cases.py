"""Cases of `sim_to_sim`: an episode with either model."""

from __future__ import annotations

from collections import Counter
from functools import partial
from typing import Any

import gymnasium
import numpy as np

from network_slip import NetworkSlip
from ruffini import agents
from ruffini.policies import part, scripted
from timing import timed

MODELS = ("surrogate", "fem")
"""Models of touch that are compared."""
UNSOLVED = "press_failed"
"""Ending of an episode with a press that the model did not solve."""
DRAWN = ("object", "size", "mass", "friction")
"""Parameters that are drawn at the start of an episode, alike with both models."""


def episode(
    task: str, policy: str, seed: int, model: str, has_network_slip: bool = False
) -> dict[str, Any]:
    """Success, return, ending and time of one episode; the network's ``slip`` may be shown."""
    env_id, settings = f"ruffini/{task}-v0", {}
    player: Any = scripted(env_id)
    if policy == "agent":
        player = agents.load(task)
        settings = player.settings
    settings = settings | {"tactile": model}
    env = gymnasium.make(env_id, disable_env_checker=True, **settings)
    (observation, _), reset_seconds, _ = timed(partial(env.reset, seed=seed))
    row: dict[str, Any] = {"reset_seconds": reset_seconds}
    drawn = env.unwrapped.look()
    row |= {name: drawn[name] for name in DRAWN}
    slip = NetworkSlip(env) if has_network_slip else None
    state, over, rewards, grips, terms, seconds, restarts = None, False, [], [], Counter(), 0.0, 0
    while not over:
        observation = slip.in_place_of(observation) if slip else observation
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
    return (
        row
        | {
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
        | ({"missed": slip.missed} if slip else {})
    )
