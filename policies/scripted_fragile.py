"""A scripted policy for GraspFragile: as :mod:`scripted_grasp`, but gripping by felt stress.

It closes lightly and then moves the grip force towards the one at which the stress is a fixed share
of the episode's limit. It reads only the default observation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scripted_grasp import ScriptedGrasp

SHARE = 0.35
"""Highest stress on the grid that is aimed at, of the limit on the higher peak inside."""

FIRST = 0.05
"""Grip force command until both pads touch, of the gripper's largest."""

HIGHEST = 0.25
"""Highest grip force command, of the gripper's largest."""

GAIN = 0.05
"""Change of the command a step, at no stress."""

ENOUGH = 0.7
"""Share of the stress aimed at from which it lifts."""

UP = 0.005
"""Rise from which it goes on lifting (m)."""

LARGEST_FORCE = 10.0
"""Grip force at action 1 (N)."""


class ScriptedFragile(ScriptedGrasp):
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
        limit, before = observation["limit"][:, 0], observation["proprio"][:, 11] / LARGEST_FORCE
        felt = observation["stress"].max(axis=1) / (SHARE * limit)
        firmer = np.clip(before + GAIN * (1.0 - felt), FIRST, HIGHEST)
        closing = action[:, 4] > 0
        touching = (observation["proprio"][:, 12:14] > 0).all(axis=1)
        action[:, 4] = np.where(closing, np.where(touching, firmer, FIRST), action[:, 4])
        waits = closing & (felt < ENOUGH) & (firmer < HIGHEST) & (observation["object"][:, 15] < UP)
        action[waits, 2] = 0.0
        return action, state
