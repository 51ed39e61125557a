"""A scripted policy for InsertPeg: press the peg on the block, find the hole by touch, follow it.

It reads ``proprio`` and ``wrench`` of the default observation. A peg that is partly over its hole
rests on what is left of the block under it, so the middle of the force is on the side away from
the hole. Along the pads' faces that is hidden by how the peg is tilted in the hand, so the hand
steers by it from pad to pad and sweeps along the faces; how far the peg is off the middle of the
hand there shows in where the pads bear it. Once the peg drops, the hand moves in small circles and
gives way to what the hole's walls push it with.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini._schema import control_period
from ruffini.policies._parts import part

READS = ("proprio", "wrench")
"""Channels of the observation."""

IS_STATEFUL = True
"""Whether the policy keeps a state from step to step."""

SPEED = 0.02
"""Speed of the wrist at action 1 (m/s)."""

PERIOD = control_period()
"""Time of a step (s)."""

TOUCH = 1.0
"""Upward force at which the peg counts as touching the block (N)."""

PRESS = 3.0
"""Upward force that is kept while searching (N)."""

STIFFNESS = 8e3
"""Stiffness of peg and gel along z (N/m)."""

DROP = 7e-4
"""Distance that the hand sinks when the peg has found the hole (m)."""

PACE = 0.014
"""Speed of the sweep (m/s)."""

WIDEST = 4.8e-3
"""Reach of the sweep to either side (m)."""

SWING = 0.8
"""Yaw rate with which the peg is turned to and fro while inserting, as action."""

STEER = 150.0
"""Action for a metre that the force is off the peg's middle."""

TIP = 0.03
"""Distance of the peg's tip from the middle of the hand (m)."""

PUSH = 6.0
"""Upward force that is kept while inserting (N)."""

YIELD = 1.5e-4
"""Compliance of the hand to a sideways force of the hole (m/N)."""

WIGGLE = 4e-4
"""Radius of the circles in which the hand moves while inserting (m)."""

TURN = 0.8
"""Angle of that circle in a step (rad)."""


Floats = NDArray[np.floating[Any]]


def felt(observation: dict[str, Any]) -> tuple[Floats, Floats, Floats, Floats]:
    """Load and place of the peg in the hand, from the wrenches on the pads, in the wrist's frame.

    Of n environments: its force on the hand in N (n, 3), its torque about the tool centre in N m
    (n, 3), the torque in N m that turns both pads alike about z (n,), and how far the peg is along
    y in m (n,).
    """
    forces, turns, arms = [], [], []
    for side, sign in (("\N{MINUS SIGN}", 1.0), ("+", -1.0)):
        force = part(observation, "wrench", f"force, {side}x pad")
        turn = part(observation, "wrench", f"torque, {side}x pad")
        # Of the pad on −x, the axes x, y, z are the wrist's y, z, x; of the other −y, z, −x.
        forces.append(np.stack([sign * force[:, 2], sign * force[:, 0], force[:, 1]], axis=1))
        turns.append(np.stack([sign * turn[:, 2], sign * turn[:, 0], turn[:, 1]], axis=1))
        arm = np.zeros_like(force)
        arm[:, 0] = -0.5 * sign * part(observation, "proprio", "opening")
        arms.append(arm)
    torque = sum(turn + np.cross(arm, f) for turn, arm, f in zip(turns, arms, forces, strict=True))
    pressing = np.maximum([-forces[0][:, 0], forces[1][:, 0]], 1.0)
    aside = 0.5 * (turns[0][:, 2] / pressing[0] - turns[1][:, 2] / pressing[1])
    return forces[0] + forces[1], torque, turns[0][:, 2] + turns[1][:, 2], aside


def act(observation: dict[str, NDArray[np.float32]], state: Any) -> tuple[NDArray[np.float32], Any]:
    """Actions (N, 5) for observations (N, ...), and a state for the next call.

    The state has, of each environment: the height at which the peg touched (m), the phase of sweep
    or circle, whether the peg is in, and the middle of the sweep or circle (2) in m.
    """
    place = part(observation, "proprio", "tool centre position")
    force, torque, turn, aside = felt(observation)
    count = len(place)
    if state is None:
        # Where the peg's middle is over the nominal place of the hole.
        middle = np.stack([np.zeros(count), -aside], axis=1)
        state = (np.full(count, np.nan), np.zeros(count), np.zeros(count, bool), middle)
    touched, phase, inside, middle = state
    up = force[:, 2]
    touched = np.where(np.isnan(touched) & (up > TOUCH), place[:, 2], touched)
    searching = ~np.isnan(touched) & ~inside
    found = searching & (place[:, 2] < touched - DROP - PRESS / STIFFNESS)
    inside = inside | found
    middle = np.where(found[:, None], place[:, :2], middle)
    middle = middle + np.where(inside[:, None], YIELD * force[:, :2], 0.0)
    phase = np.where(found, 0.0, phase + np.where(inside, TURN, searching * PACE * PERIOD / WIDEST))

    # From the middle to one side, to the other, and back, in four phases; then circles.
    sweep = WIDEST * (1.0 - abs((phase - 1.0) % 4.0 - 2.0))
    steer = -STEER * (-TIP * force[:, 0] - torque[:, 1]) / np.maximum(up, TOUCH)
    goal = middle + WIGGLE * np.stack([np.cos(phase), np.sin(phase)], axis=1)
    goal[:, 1] = np.where(inside, goal[:, 1], middle[:, 1] - sweep)
    action = np.zeros((count, 5), np.float32)
    action[:, :2] = (goal - place[:, :2]) / (SPEED * PERIOD)
    action[:, 0] = np.where(searching, np.clip(steer, -0.5, 0.5), action[:, 0])
    wanted = np.where(inside, PUSH, np.where(searching, PRESS, 2 * TOUCH))
    action[:, 2] = np.clip((up - wanted) / (STIFFNESS * SPEED * PERIOD), -0.6, 0.6)
    action[:, 3] = np.where(inside, 10.0 * turn + SWING * np.sin(0.4 * phase), 0.0)
    return np.clip(action, -1.0, 1.0), (touched, phase, inside, middle)
