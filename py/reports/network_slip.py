"""Sliding as the network has it, along an episode in which another model moves everything."""

from __future__ import annotations

from typing import Any

import numpy as np

import ruffini
from ruffini import Press
from sliding_cases import HELD, Pose, in_pads, sized


class NetworkSlip:
    """Share that slides under an object in the hand, solved by the network along its motion.

    Attributes:
        missed: Number of presses that the network did not solve, whose share is the environment's.
    """

    def __init__(self, env: Any):
        """Begins with the grip before the first step, which is taken to be straight.

        Raises:
            RuntimeError: If the object is none of the families whose shape is known here.
        """
        self.missed = 0
        self._env = env.unwrapped
        look = self._env.look()
        if look["object"] not in HELD:
            raise RuntimeError(f"found a {look['object']}, expected one of {', '.join(HELD)}")
        vertices, *_ = self._env.surfaces()["object"]
        self._shape = sized(look, vertices)
        self._network = ruffini.Surrogate(friction=look["friction"])
        self._histories: list[Any] = [None, None]

    def in_place_of(self, observation: dict[str, Any]) -> dict[str, Any]:
        """Returns the observation of now with the network's ``slip``. Call it once in a step."""
        look = self._env.look()
        slip = np.array(observation["slip"])
        for pad, (place, turn) in enumerate(in_pads(look)):
            path: list[Pose] = [(place, turn)]
            if self._histories[pad] is None:
                path.insert(0, (np.array([0.0, 0.0, place[2]]), turn))
            press = Press(self._shape, path, history=self._histories[pad])
            found = self._network.solve_path(press)[-1]
            if isinstance(found, ruffini.PressError):
                self.missed += 1
                self._histories[pad] = None
                continue
            self._histories[pad] = found.history
            slip[pad] = found.sliding
        return observation | {"slip": slip}
