"""A scripted policy for GraspFragile: grip until the measured stress is near the limit, then lift.

It reads only ``proprio`` and ``stress_ratio`` of the default observation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini.policies._rise import rise

READS = ("proprio", "stress_ratio")
"""Channels of the observation."""

IS_STATEFUL = True
"""Whether the policy keeps a state from step to step."""

AIM = 0.9
"""Stress that is aimed at, of the limit."""

FIRM = 0.85
"""Stress from which it lifts, of the limit: a looser grip slips, which stresses the pads more."""

GAIN = 6.0
"""Action of the grip for a difference of the whole limit."""


def act(observation: dict[str, NDArray[np.float32]], state: Any) -> tuple[NDArray[np.float32], Any]:
    """Actions (N, 5) for observations (N, ...), and a state for the next call."""
    stress = observation["stress_ratio"][:, 0]
    action = np.zeros((len(stress), 5), np.float32)
    action[:, 2], state = rise(observation, stress > FIRM, state)
    action[:, 4] = np.clip(GAIN * (AIM - stress), -1.0, 1.0)
    return action, state
