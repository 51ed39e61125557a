"""Searches for the hole of InsertPeg: a spiral that knows touch as yes or no, and successes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini._schema import control_period
from ruffini.evaluation import evaluate
from ruffini.policies import insert_peg, part, scripted

TASK = "ruffini:ruffini/InsertPeg-v0"
FIRST_SEED = 20_000
PERIOD = control_period()
"""Time of a control step (s)."""
PITCH, PACE = 1.6e-3, 0.014
"""Distance between turns of the spiral (m), and speed along it (m/s)."""
LIGHT, FIRM = 1.0, 3.0
"""Upward forces on the pads from which the peg touches, and from which it is pressed enough (N)."""
DROPPED = 9e-4
"""Depth of the hand below where the peg first touched, when the peg is in the hole (m)."""
RISE, SINK, FALL = 0.15, -0.4, -0.6
"""Actions where the peg is pressed enough, where it is not, and before the search and after."""


class Spiral:
    """Presses the peg lightly, moves it on an Archimedean spiral until it drops in, and pushes it.

    Of touch it knows yes or no: whether the pads feel more than a force upwards. It goes on along
    the spiral only while the peg touches, around where the hand is said to be over the hole. The
    peg is in when the hand has sunk. There the policy moves in the small circles of the scripted
    policy and turns to and fro as that does, but does not give way to the hole's walls.
    """

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (N, 5), and a state for the next call.

        The state has, of each environment: the height at which the peg touched (m), the way along
        the spiral (m), the phase of the circle, whether the peg is in, and where (m).
        """
        place = part(observation, "proprio", "tool centre position")
        sides = [f"force, {side} pad" for side in ("\N{MINUS SIGN}x", "+x")]
        up = sum(part(observation, "wrench", side)[:, 1] for side in sides)
        count = len(place)
        if state is None:
            nothing = np.zeros(count)
            state = (np.full(count, np.nan), nothing, nothing, nothing > 0, np.zeros((count, 2)))
        height, way, phase, inside, middle = state
        height = np.where(np.isnan(height) & (up > FIRM), place[:, 2], height)
        searching = ~np.isnan(height) & ~inside
        drops = searching & (place[:, 2] < height - DROPPED)
        inside = inside | drops
        middle = np.where(drops[:, None], place[:, :2], middle)
        way = way + np.where(searching & (up > LIGHT), PACE * PERIOD, 0.0)
        phase = phase + np.where(inside, insert_peg.TURN, 0.0)

        turn = np.sqrt(4 * np.pi * way / PITCH)
        radius = np.where(inside, insert_peg.WIGGLE, PITCH * turn / (2 * np.pi))
        angle = np.where(inside, phase, turn)
        goal = middle + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        action = np.zeros((count, 5), np.float32)
        action[:, :2] = (goal - place[:, :2]) / (insert_peg.SPEED * PERIOD)
        enough = up > np.where(inside, insert_peg.PUSH, FIRM)
        action[:, 2] = np.where(enough, RISE, np.where(searching, SINK, FALL))
        action[:, 3] = np.where(inside, insert_peg.SWING * np.sin(0.4 * phase), 0.0)
        return np.clip(action, -1.0, 1.0), (height, way, phase, inside, middle)


def searched(
    policy: str, peg: str, clearance: float | None, episodes: int, first_seed: int = FIRST_SEED
) -> dict[str, Any]:
    """Successes of a policy with a peg and a clearance (m), the task's range if ``None``."""
    player = Spiral() if policy == "spiral" else scripted(TASK)
    settings: dict[str, Any] = {} if clearance is None else {"clearance": clearance}
    found = evaluate(
        player,
        TASK,
        episodes,
        first_seed=first_seed,
        objects=[peg],
        observation=["proprio", "wrench"],
        **settings,
    )
    found["successes"] = round(found["success"] * episodes)
    kept = ("episodes", "successes", "success", "interval", "endings")
    row = {"policy": policy, "peg": peg, "clearance": clearance}
    return {"search": row | {name: found[name] for name in kept}}
