"""A scripted policy: turn, go over the object, go down, close, lift, hold.

It reads only the default observation (``proprio`` and ``object``), so it is the yardstick for what
an agent can do with it. Use::

    ruffini agent evaluate scripted --task GraspLift
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini.policies._parts import part

READS = ("proprio", "object")
"""Channels of the observation."""

IS_STATEFUL = False
"""Whether the policy keeps a state from step to step."""

MAX_SPEED = 0.25
"""Speed of the wrist at action 1 (m/s)."""

GAIN = 8.0
"""Rate at which a position error is closed (1/s)."""

NEAR = 0.006
"""Horizontal error at which the hand goes down (m)."""

FIRM = 0.5
"""Normal force on each pad from which the hand lifts (N)."""

GRIP = 0.5
"""Grip force command while closing, of the gripper's largest."""


def act(observation: dict[str, NDArray[np.float32]], state: Any) -> tuple[NDArray[np.float32], Any]:
    """Actions (N, 5) for observations (N, ...); `state` is passed through."""
    forces = part(observation, "proprio", "normal force of each pad")
    place = part(observation, "object", "position from the tool centre, in the wrist's frame")
    x, y, z = place.T
    grasped = (forces > FIRM).all(axis=1)
    # A grasped object is below or between the pads; one that merely stands there is not held.
    over = np.hypot(x, y) < NEAR + 0.3 * np.maximum(0.0, 0.03 + z)
    down = np.abs(z) < NEAR
    closing = grasped | (over & (down | (forces > 0.05).any(axis=1)))
    action = np.zeros((len(place), 5), np.float32)
    velocity = GAIN * place / MAX_SPEED
    velocity[:, 2] = np.where(over, velocity[:, 2], np.maximum(velocity[:, 2] + 2.0, 0.0))
    action[:, :3] = np.where(closing[:, None], 0.0, velocity)
    action[:, 2] = np.where(grasped, _lift(observation), action[:, 2])
    action[:, 3] = np.where(closing, 0.0, _yaw_rate(observation))
    action[:, 4] = np.where(closing, GRIP, -GRIP)
    return np.clip(action, -1.0, 1.0), state


def _lift(observation: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
    """Upward speed that brings the object 10 cm up and stops it there."""
    rise = part(observation, "object", "rise over the table")
    lift: NDArray[np.float32] = np.clip(10.0 * (0.10 - rise), -0.2, 0.8)
    return lift


def _yaw_rate(observation: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
    """Yaw rate that turns the jaws square to the object's nearer horizontal axis."""
    name = "first two columns of the rotation in the wrist's frame"
    axis = part(observation, "object", name)
    angle = np.arctan2(axis[:, 1], axis[:, 0])
    quarter = 0.5 * np.pi
    square = angle - quarter * np.round(angle / quarter)
    rate: NDArray[np.float32] = np.clip(2.0 * square, -1.0, 1.0)
    return rate
