"""A scripted policy for HoldStill: loosen the grip until the pads begin to slide.

Of the default observation it reads ``slip`` alone. How much of a contact slides says how much of
what friction bears is used, whatever its coefficient and whatever the load.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

READS = ("slip",)
"""Channels of the observation."""

IS_STATEFUL = False
"""Whether the policy keeps a state from step to step."""

SLIDING = 0.4
"""Share of sliding contact that the policy steers for."""

LOOSER = 0.15
"""Rate at which the grip falls while nothing slides, of the fastest."""

TIGHTER = 8.0
"""Rate at which the grip grows per share of contact that slides beyond, of the fastest."""


def act(observation: dict[str, NDArray[np.float32]], state: Any) -> tuple[NDArray[np.float32], Any]:
    """Actions (N, 5) for observations (N, ...); `state` is passed through."""
    over = observation["slip"].max(axis=1) - SLIDING
    action = np.zeros((len(over), 5), np.float32)
    action[:, 4] = np.where(over > 0, np.minimum(TIGHTER * over, 1.0), LOOSER * over / SLIDING)
    return action, state
