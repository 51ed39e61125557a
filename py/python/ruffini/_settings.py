"""Keyword arguments of the environments, and their way into Rust as JSON."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypedDict

import numpy as np

Range = float | tuple[float, float]
"""Both ends of a uniform draw, or the one value."""

_RANGES = ("mass", "friction", "size", "position", "yaw", "start", "start_height")
_SCENE = ("gripper", "workspace", "physics")


class Settings(TypedDict, total=False):
    """What can be set; see :class:`ruffini.envs.GraspLiftEnv` for meaning and defaults."""

    objects: str | Sequence[str | Mapping[str, Any]]
    mass: Range
    friction: Range
    size: Range
    position: Range
    yaw: Range
    start: Range
    start_height: Range
    lift_height: float
    hold_time: float
    max_episode_steps: int
    tactile: Literal["none", "compliance", "fem", "surrogate"]
    sensor: str
    material: str | Mapping[str, float]
    resolution: Mapping[str, int | Sequence[int]]
    observation: str | Sequence[str]
    reward_weights: Mapping[str, float]
    gripper: Mapping[str, float]
    workspace: Mapping[str, Sequence[float]]
    physics: Mapping[str, float]


def to_json(settings: Mapping[str, Any]) -> str:
    """The settings as the JSON that Rust reads.

    Raises:
        ValueError: If a value is not a finite number, a name, or a list or mapping of those.
    """
    given = {name: value for name, value in settings.items() if value is not None}
    document: dict[str, Any] = {}
    for name, value in given.items():
        if name in _SCENE:
            document.setdefault("scene", {})[name] = value
        elif name == "reward_weights":
            document["reward"] = value
        elif name in ("objects", "observation") and isinstance(value, str):
            document[name] = [value]
        elif name in _RANGES and isinstance(value, (int, float, np.number)):
            document[name] = [value, value]
        elif name in ("scene", "reward"):
            raise ValueError(
                f"{name}: unknown, expected one of {', '.join(Settings.__annotations__)}"
            )
        else:
            document[name] = value
    try:
        return json.dumps(document, allow_nan=False, default=_plain)
    except (TypeError, ValueError, RecursionError) as error:
        found = ", ".join(f"{name}={reprlib.repr(value)}" for name, value in given.items())
        expected = "finite numbers, names, and lists or mappings of them"
        raise ValueError(f"settings: found {found}; expected {expected} ({error})") from None


def _plain(value: Any) -> Any:
    """Numpy's numbers and arrays, paths and other sequences as JSON knows them."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if hasattr(value, "__fspath__"):
        return value.__fspath__()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, Sequence):
        return list(value)
    raise TypeError(f"{type(value).__name__} is none of them")
