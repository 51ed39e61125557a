"""Parts of observations by name."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini._schema import SCHEMA, TASKS
from ruffini._settings import nearest


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


def _unknown(channel: str, component: str) -> slice:
    """Raise a ``KeyError`` that names the nearest channel or component."""
    components = [name for own, name in _slices() if own == channel]
    what, word = ("component", component) if components else ("channel", channel)
    known = components or list(dict.fromkeys(own for own, _ in _slices()))
    near = nearest(word, known)
    raise KeyError(f"{what}: found {word!r}{near} expected one of {', '.join(known)}")


def part(observation: dict[str, Any], channel: str, component: str) -> NDArray[np.float32]:
    """One component (N, ...) of a channel of dict observations of N environments.

    The names are those of ``env.unwrapped.channels()``; a component of one number has shape (N,).

    Raises:
        KeyError: If there is no such channel or component, or it was not observed.
    """
    place = _slices().get((channel, component)) or _unknown(channel, component)
    if channel not in observation:
        had = (
            f"expected one of {', '.join(observation)}: observe it, or list it in a task's `reads`"
        )
        raise KeyError(f"channel: found {channel!r}, {had}")
    values: NDArray[np.float32] = observation[channel][..., place]
    return values[..., 0] if place.stop - place.start == 1 else values
