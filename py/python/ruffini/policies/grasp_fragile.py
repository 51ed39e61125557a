"""A scripted policy for GraspFragile: grip until the measured stress is near the limit, then lift.

It reads only ``proprio`` and ``stress_ratio`` of the default observation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini.policies._parts import part

AIM = 0.9
"""Stress that is aimed at, of the limit."""

FIRM = 0.85
"""Stress from which it lifts, of the limit: a looser grip slips, which stresses the pads more."""

GAIN = 6.0
"""Action of the grip for a difference of the whole limit."""

SPEED = 0.5
"""Action of the lift."""

RAMP = 5
"""Steps in which the lift comes to its speed."""

RISE = 0.06
"""Rise of the hand at which it stops (m)."""

BRAKING = 40.0
"""Action for a metre that is left to rise."""


class Scripted:
    """Acts on a batch of dict observations, one row an environment."""

    def predict(
        self,
        observation: dict[str, NDArray[np.float32]],
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (N, 5) for observations (N, ...), and a state for the next call.

        The state is the steps (N) since each lift began, and the hand's first heights (N) in m.
        """
        stress = observation["stress_ratio"][:, 0]
        height = part(observation, "proprio", "tool centre position")[:, 2]
        steps, first = (np.zeros(len(height)), height) if state is None else state
        steps = steps + ((stress > FIRM) | (steps > 0))
        action = np.zeros((len(height), 5), np.float32)
        left = BRAKING * (first + RISE - height)
        lift = SPEED * np.minimum(steps / RAMP, 1.0)
        action[:, 2] = np.where(steps > 0, np.clip(left, -SPEED, lift), 0.0)
        action[:, 4] = np.clip(GAIN * (AIM - stress), -1.0, 1.0)
        return action, (steps, first)
