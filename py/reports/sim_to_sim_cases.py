"""Cases of `sim_to_sim`: an episode with either model, and a press that is dragged."""

from __future__ import annotations

import math
from collections import Counter
from functools import partial
from typing import Any

import gymnasium
import numpy as np

import ruffini
from ruffini import Fem, Press, Shape, agents
from ruffini.policies import part, scripted
from timing import timed

MODELS = ("surrogate", "fem")
"""Models of touch that are compared."""
UNSOLVED = "press_failed"
"""Ending of an episode with a press that the model did not solve."""
NODES, MORE_NODES = 1000, 3000
"""Default number of nodes of an environment's pad, and that of a finer one."""
DRAGGED = {
    "network": None,
    "finite elements of an environment": ("p1-bar", NODES, False),
    "the same elements, a finer mesh": ("p1-bar", MORE_NODES, False),
    "quadratic elements, refined towards the contact": ("p2", 1500, True),
}
"""Models of the dragged shapes: element, nodes, ``True`` for a mesh refined at the contact."""
BALL, FRICTION = 0.018, 0.6
"""Radius of a ball that is dragged (m), as of the sphere that is grasped, and friction."""
PRESSED = {
    "ball": (Shape.sphere(BALL), BALL, 5e-4, 3.6e-3),
    "block": (Shape.cuboid((0.02, 0.02, 0.015)), 0.015, 1.5e-4, 5e-3),
}
"""Shapes that are dragged, height of the middle, depth, half of the fine part of the mesh (m)."""
DRAG = [4e-5 * step for step in range(1, 13)]
"""Distances that they are dragged along the finger (m)."""
USED = (0.2, 0.4, 0.6)
"""Fractions of the greatest friction at which sliding is reported."""
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


def dragged(shape: str, model: str) -> dict[str, Any]:
    """Share of the normal force that slides under what is pressed, then dragged."""
    presser, above, depth, half = PRESSED[shape]
    answerer: Any = ruffini.Surrogate(friction=FRICTION)
    if DRAGGED[model]:
        element, nodes, crowded = DRAGGED[model]
        line = np.linspace(-half, half, 25)
        around = np.stack([*np.meshgrid(line, line), np.zeros((25, 25))], axis=-1).reshape(-1, 3)
        pad = ruffini.sensor("gelsight-mini", resolution=nodes, around=around if crowded else None)
        answerer = Fem(pad, friction=FRICTION, element=element)
    down = [(0.0, depth * share) for share in (0.25, 0.5, 0.75, 1.0)]
    places = [([0.0, y, above - z], (0, 0, 0, 1)) for y, z in [*down, *((y, depth) for y in DRAG)]]
    frames, spent, _ = timed(answerer.solve_path, Press(presser, places))
    frames = frames[len(down) - 1 :]
    used = [math.hypot(*f.wrench[:2]) / (FRICTION * abs(f.wrench[2])) for f in frames]
    share = [frame.sliding for frame in frames]
    row = {"shape": shape, "model": model, "seconds": spent, "used": used, "sliding": share}
    return row | {"force": float(frames[-1].wrench[2])}


def half_space(used: float) -> float:
    """Share that slides under a ball on a half-space (Cattaneo, Mindlin)."""
    return float((1 - (1 - used) ** (2 / 3)) ** 1.5)
