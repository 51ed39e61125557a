"""Parts of observations by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini._schema import SCHEMA, TACTILE_CHANNELS, TASKS
from ruffini._words import nearest

_MINUS = "\u2212"

Places = Mapping[tuple[str, str], slice]
"""Place of each component in its channel, by the names of both."""


def _places(
    channels: Iterable[tuple[str, Iterable[tuple[str, int]]]],
) -> dict[tuple[str, str], slice]:
    """Places of components of some sizes; those of fields also by their name without its shape."""
    places: dict[tuple[str, str], slice] = {}
    for channel, components in channels:
        start = 0
        for name, size in components:
            place = slice(start, start + size)
            for known in (name, name.partition(": ")[0]):
                # A minus sign may be typed as a hyphen.
                places[channel, known] = places[channel, known.replace(_MINUS, "-")] = place
            start += size
    return places


@cache
def _shared() -> dict[tuple[str, str], slice]:
    """Places in the channels of all tasks that are not felt by soft pads."""
    own = [channel for task in TASKS.values() for channel in task["channels"]]
    return _places(
        (channel["name"], [(each["name"], each["size"]) for each in channel["components"]])
        for channel in [*SCHEMA["channels"], *own]
    )


def places_of(
    layout: Iterable[tuple[str, list[tuple[str, list[float], list[float], str]]]],
) -> Places:
    """Places in an environment's channels, as ``channels()`` returns them, and in all others."""
    own = _places(
        (channel, [(name, len(low)) for name, low, *_ in components])
        for channel, components in layout
    )
    had = {channel for channel, _ in own}
    return {key: place for key, place in _shared().items() if key[0] not in had} | own


def _unobserved(channel: str, observation: Mapping[str, Any]) -> KeyError:
    """Error about a channel that exists and is not there."""
    remedy = "observe it, or list it in a task's `reads`"
    return KeyError(
        f"channel: found {channel!r}, expected one of {', '.join(observation)}: {remedy}"
    )


def _unknown(places: Places, channel: str, component: str) -> KeyError:
    """Error that names the nearest channel or component."""
    components = [name.partition(": ")[0] for own, name in places if own == channel]
    what, word = ("component", component) if components else ("channel", channel)
    known = list(dict.fromkeys(components or (own for own, _ in places)))
    near = nearest(word, known)
    return KeyError(f"{what}: found {word!r}{near} expected one of {', '.join(known)}")


def find(
    places: Places, observation: dict[str, Any], channel: str, component: str
) -> NDArray[np.float32]:
    """One component (N, ...) of a channel, found by its place.

    Raises:
        KeyError: If there is no such channel or component, or it was not observed.
    """
    place = places.get((channel, component))
    if place is None:
        # The components of what soft pads feel are known only where it is observed.
        if channel in TACTILE_CHANNELS and channel not in observation:
            raise _unobserved(channel, observation)
        if channel in TACTILE_CHANNELS and all(own != channel for own, _ in places):
            raise KeyError(
                f"channel: found {channel!r}, expected `channels` with it: its components "
                "depend on the settings; pass env.unwrapped.channels()"
            )
        raise _unknown(places, channel, component)
    if channel not in observation:
        raise _unobserved(channel, observation)
    values: NDArray[np.float32] = observation[channel][..., place]
    return values[..., 0] if place.stop - place.start == 1 else values


def part(
    observation: dict[str, Any], channel: str, component: str, channels: Any = None
) -> NDArray[np.float32]:
    """One component (N, ...) of a channel of dict observations of N environments.

    The names are those of ``env.unwrapped.channels()``, which `channels` has to be given if the
    channel is one of soft pads: its components depend on the settings. Theirs may stand without the
    shape, ``"force, +x pad"`` for ``"force, +x pad: 3"``. A component of one number has shape (N,).

    Raises:
        KeyError: If there is no such channel or component, or it was not observed.
    """
    places = _shared() if channels is None else places_of(channels)
    return find(places, observation, channel, component)
