"""A scripted policy for GraspSoft: close until the heaviest object would be held, then lift.

It reads only ``proprio`` and ``squeeze`` of the default observation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini.policies._parts import part
from ruffini.policies._rise import rise

READS = ("proprio", "squeeze")
"""Channels of the observation."""

IS_STATEFUL = True
"""Whether the policy keeps a state from step to step."""

ENOUGH = 0.6
"""Grip force that holds the heaviest object at the least friction (N)."""

PRESSED = 0.85
"""Force on each finger from which it lifts, of the grip force."""

FACTOR = 0.4
"""Logarithm of the factor by which an action of 1 changes the grip force."""


def act(observation: dict[str, NDArray[np.float32]], state: Any) -> tuple[NDArray[np.float32], Any]:
    """Actions (N, 5) for observations (N, ...), and a state for the next call."""
    grip = part(observation, "proprio", "grip force command")
    forces = part(observation, "proprio", "normal force of each pad")
    deformation = part(observation, "squeeze", "root mean square deformation of the object")
    held = (deformation > 0) & (forces > PRESSED * ENOUGH).all(axis=1)
    action = np.zeros((len(grip), 5), np.float32)
    action[:, 2], state = rise(observation, held, state)
    action[:, 4] = np.clip(np.log(ENOUGH / grip) / FACTOR, -1.0, 1.0)
    return action, state
