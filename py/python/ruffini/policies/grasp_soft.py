"""A scripted policy for GraspSoft: close until the heaviest object would be held, then lift.

It reads only ``proprio`` and ``squeeze`` of the default observation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini.policies._parts import part
from ruffini.policies.grasp_fragile import BRAKING, RAMP, RISE, SPEED

ENOUGH = 0.6
"""Grip force that holds the heaviest object at the least friction (N)."""

PRESSED = 0.85
"""Force on each finger from which it lifts, of the grip force."""

FACTOR = 0.4
"""Logarithm of the factor by which an action of 1 changes the grip force."""


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
        height = part(observation, "proprio", "tool centre position")[:, 2]
        grip = part(observation, "proprio", "grip force command")
        forces = part(observation, "proprio", "normal force of each pad")
        steps, first = (np.zeros(len(height)), height) if state is None else state
        deformation = part(observation, "squeeze", "root mean square deformation of the object")
        held = (deformation > 0) & (forces > PRESSED * ENOUGH).all(axis=1)
        steps = steps + (held | (steps > 0))
        action = np.zeros((len(height), 5), np.float32)
        left = BRAKING * (first + RISE - height)
        lift = SPEED * np.minimum(steps / RAMP, 1.0)
        action[:, 2] = np.where(steps > 0, np.clip(left, -SPEED, lift), 0.0)
        action[:, 4] = np.clip(np.log(ENOUGH / grip) / FACTOR, -1.0, 1.0)
        return action, (steps, first)
