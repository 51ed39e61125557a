"""A scripted policy for InsertPeg: press the peg on the block, search in a spiral, follow the hole.

It reads ``proprio`` and ``wrench`` of the default observation. Where the normal force acts on the
pads tells how far the peg is off the middle of the hand; the hole is searched around where it is
said to be while the peg presses lightly; once it drops, the hand gives way to what the hole's walls
push it with.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini.policies._parts import part

SPEED = 0.02
"""Speed of the wrist at action 1 (m/s)."""

PERIOD = 0.04
"""Time of a step (s)."""

TOUCH = 1.0
"""Upward force at which the peg counts as touching the block (N)."""

PRESS = 3.0
"""Upward force that is kept while searching (N)."""

STIFFNESS = 8e3
"""Upward force for a millimetre that the hand goes down, over a thousandth (N/m)."""

DROP = 7e-4
"""How far the hand sinks when the peg has found the hole (m)."""

PITCH = 0.9e-3
"""Distance between two turns of the spiral (m)."""

PACE = 0.018
"""Speed along the spiral (m/s)."""

WIDEST = 4.5e-3
"""Radius at which the spiral begins again (m)."""

PUSH = 6.0
"""Upward force that is kept while inserting (N)."""

YIELD = 1.5e-4
"""How far the hand gives way to a newton that the hole pushes sideways with (m/N)."""

WIGGLE = 4e-4
"""Radius of the circles in which the hand moves while inserting (m)."""

TURN = 0.8
"""Angle of that circle in a step (rad)."""


def forces(observation: dict[str, Any]) -> tuple[NDArray, NDArray, NDArray]:
    """Force of the peg on the hand in the wrist's frame (N, 3), its torque about the wrist's z (N),
    and how far the peg is along y (N), in m."""
    left, right = (part(observation, "wrench", f"force on the {s}x pad, in its frame") for s in "−+")
    about = "torque on the {}x pad about its face's centre"
    turns = [part(observation, "wrench", about.format(side)) for side in "−+"]
    # Of the pad on −x, the axes x, y, z are the wrist's y, z, x; of the other −y, z, −x.
    force = np.stack(
        [left[:, 2] - right[:, 2], left[:, 0] - right[:, 0], left[:, 1] + right[:, 1]], axis=1
    )
    turn = turns[0][:, 1] + turns[1][:, 1]
    firm = np.minimum(left[:, 2], right[:, 2]) < -1.0
    places = [-t[:, 1] / np.where(firm, f[:, 2], 1.0) for t, f in zip(turns, (left, right))]
    return force, turn, np.where(firm, 0.5 * (places[0] - places[1]), 0.0)


def act(observation: dict[str, NDArray[np.float32]], state: Any) -> tuple[NDArray[np.float32], Any]:
    """Actions (N, 5) for observations (N, ...), and a state for the next call.

    The state has, of each environment: the height at which the peg touched (m), the angle along the
    spiral or circle (rad), whether the peg is in, and the middle of the spiral or circle (2) in m.
    """
    place = part(observation, "proprio", "tool centre position")
    force, turn, aside = forces(observation)
    count = len(place)
    if state is None:
        # Where the peg's middle is over the place that the hole is said to be at.
        middle = np.stack([np.zeros(count), -aside], axis=1)
        state = (np.full(count, np.nan), np.zeros(count), np.zeros(count, bool), middle)
    touched, angle, inside, middle = state
    up = force[:, 2]
    touched = np.where(np.isnan(touched) & (up > TOUCH), place[:, 2], touched)
    searching = ~np.isnan(touched) & ~inside
    found = searching & (place[:, 2] < touched - DROP - PRESS / STIFFNESS)
    inside = inside | found
    middle = np.where(found[:, None], place[:, :2], middle)
    middle = middle + np.where(inside[:, None], YIELD * force[:, :2], 0.0)

    # Archimedes' spiral at constant speed, then circles.
    radius = np.where(inside, WIGGLE, PITCH * angle / (2 * np.pi))
    angle = angle + np.where(searching, PACE * PERIOD / np.maximum(radius, PITCH), 0.0)
    angle = np.where(inside, angle + TURN, np.where(radius > WIDEST, 0.0, angle))
    goal = middle + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    action = np.zeros((count, 5), np.float32)
    action[:, :2] = (goal - place[:, :2]) / (SPEED * PERIOD)
    wanted = np.where(inside, PUSH, np.where(searching, PRESS, 2 * TOUCH))
    action[:, 2] = np.clip((up - wanted) / (STIFFNESS * SPEED * PERIOD), -0.6, 0.6)
    action[:, 3] = np.where(inside, 10.0 * turn, 0.0)
    return np.clip(action, -1.0, 1.0), (touched, angle, inside, middle)
