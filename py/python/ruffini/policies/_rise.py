"""The lift that scripted policies share whose hand starts around the object."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini.policies._parts import part

SPEED = 0.5
"""Action of the lift."""

RAMP = 5
"""Steps in which the lift comes to its speed."""

RISE = 0.06
"""Rise of the hand at which it stops (m)."""

BRAKING = 40.0
"""Action for a metre that is left to rise."""


def rise(
    observation: dict[str, NDArray[np.float32]], held: NDArray[np.bool_], state: Any
) -> tuple[NDArray[np.float32], Any]:
    """Vertical action (N,) that lifts what is or was `held` (N,), and a state for the next call.

    The state is the steps (N) since each lift began, and the hand's first heights (N) in m.
    """
    height = part(observation, "proprio", "tool centre position")[:, 2]
    steps, first = (np.zeros(len(height)), height) if state is None else state
    steps = steps + (held | (steps > 0))
    left = BRAKING * (first + RISE - height)
    lift = SPEED * np.minimum(steps / RAMP, 1.0)
    return np.where(steps > 0, np.clip(left, -SPEED, lift), 0.0), (steps, first)
