"""A scripted policy for HoldStill: grip in proportion to what the pads must hold.

It reads only the default observation, ``proprio`` and ``wrench``: the normal force follows the
largest load that the pads have felt, in the friction cone of the least friction.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FRICTION = 0.5
"""Least coefficient of friction of the default settings."""

FORGETTING = 0.99
"""Share of the largest load that is left after a step."""

SPARE = 0.6
"""Grip force beyond the least that holds by Coulomb's law (N)."""

LARGEST_FORCE = 10.0
"""Grip force at action 1 (N)."""


class ScriptedHold:
    """Acts on a batch of dict observations, one row an environment."""

    def predict(
        self,
        observation: dict[str, NDArray[np.float32]],
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (N, 5) for observations (N, ...) and the largest loads (N) for the next call."""
        force = observation["wrench"].reshape(-1, 2, 6)[:, :, :3]
        load = np.linalg.norm(force[:, :, :2], axis=2).max(axis=1)
        before = np.zeros(len(load)) if state is None else FORGETTING * state
        largest = np.maximum(load, before)
        action = np.zeros((len(load), 5), np.float32)
        grip = SPARE + largest / FRICTION
        action[:, 4] = np.clip(grip / LARGEST_FORCE, 0.0, 1.0)
        return action, largest
