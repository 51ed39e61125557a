"""A scripted policy for GraspSoft: as :mod:`scripted_grasp`, but closing as softly as will do.

It closes with the least force that moves the fingers, grips as the heaviest object needs once both
touch, and lifts. It reads only the default observation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scripted_grasp import ScriptedGrasp

FIRST = 0.03
"""Grip force command until both fingers touch, of the gripper's largest."""

ENOUGH = 0.55
"""Normal force on each finger that holds the heaviest object at the least friction (N)."""

LARGEST_FORCE = 10.0
"""Grip force at action 1 (N)."""


class ScriptedSoft(ScriptedGrasp):
    """Acts on a batch of dict observations, one row an environment."""

    def predict(
        self,
        observation: dict[str, NDArray[np.float32]],
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (N, 5) for observations (N, ...); the signature is Stable-Baselines3's."""
        action, state = super().predict(observation, state, episode_start, deterministic)
        proprio, seen = observation["proprio"], observation["object"]
        forces = proprio[:, 12:14]
        closing = action[:, 4] > 0
        squeezed = observation["squeeze"][:, 0] > 0
        grip = np.where(squeezed, (ENOUGH + 0.05) / LARGEST_FORCE, FIRST)
        action[:, 4] = np.where(closing, grip, action[:, 4])
        holds = closing & squeezed & (forces > 0.85 * ENOUGH).all(axis=1)
        action[:, 2] = np.where(closing, np.where(holds, self._lift(seen), 0.0), action[:, 2])
        return np.clip(action, -1.0, 1.0), state
