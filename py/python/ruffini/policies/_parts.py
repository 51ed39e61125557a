"""Parts of observations by name."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini._schema import SCHEMA, TASKS


@cache
def _slices() -> dict[tuple[str, str], slice]:
    """Place of each component in its channel."""
    own = [channel for task in TASKS.values() for channel in task["channels"]]
    places: dict[tuple[str, str], slice] = {}
    for channel in [*SCHEMA["channels"], *own]:
        start = 0
        for part in channel["components"]:
            end = start + part["size"]
            places[channel["name"], part["name"]] = slice(start, end)
            start = end
    return places


def part(observation: dict[str, Any], channel: str, component: str) -> NDArray[np.float32]:
    """One component (N, ...) of a channel of dict observations of N environments.

    The names are those of ``env.unwrapped.channels()``; a component of one number has shape (N,).

    Raises:
        KeyError: If there is no such channel or component, or it was not observed.
    """
    place = _slices()[channel, component]
    values: NDArray[np.float32] = observation[channel][..., place]
    return values[..., 0] if place.stop - place.start == 1 else values
