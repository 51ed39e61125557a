"""Keyword arguments of the environments, and their conversion to JSON for Rust."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypedDict

import numpy as np

Range = float | tuple[float, float]
"""Both ends of a uniform draw, or a single value."""

_PARTS = {
    "start_grip": "closing",
    "least_grip": "closing",
    "grip_rate": "closing",
    "spare": "fragility",
    "margin": "fragility",
    "load": "holding",
    "shaking": "holding",
    "shaking_frequency": "holding",
    "slip_limit": "holding",
    "thrift": "holding",
    "young": "softness",
    "poisson": "softness",
    "crush": "softness",
}
"""Settings of only some tasks, with the part of the settings in Rust to which they belong."""
_RENAMED = {"shaking_frequency": "frequency"}
"""Settings that have another name in Rust."""
_RANGES = (
    "mass",
    "friction",
    "size",
    "position",
    "yaw",
    "start",
    "start_height",
    "margin",
    "load",
    "shaking",
    "shaking_frequency",
    "young",
)
_SCENE = ("gripper", "workspace", "physics")


class Settings(TypedDict, total=False):
    """Settings of all tasks; :mod:`ruffini.envs` documents meanings, defaults and tasks."""

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
    grip_rate: float
    spare: float
    margin: Range
    start_grip: float
    least_grip: float
    load: Range
    shaking: Range
    shaking_frequency: Range
    slip_limit: float
    thrift: float
    young: Range
    poisson: float
    crush: float
    max_episode_steps: int
    tactile: Literal["surrogate", "surrogate-fine", "compliance", "fem", "none"]
    sensor: str
    material: str | Mapping[str, float]
    resolution: Mapping[str, int | Sequence[int]]
    observation: str | Sequence[str]
    reward_weights: Mapping[str, float]
    gripper: Mapping[str, float]
    workspace: Mapping[str, Sequence[float]]
    physics: Mapping[str, float]


def to_json(settings: Mapping[str, Any], task: str) -> str:
    """Convert the settings of a task to the JSON that Rust reads.

    Raises:
        TypeError: If a setting is unknown.
        ValueError: If a value is not a finite number, a name, or a list or mapping of those.
    """
    for name in settings:
        if name not in Settings.__annotations__:
            known = ", ".join(Settings.__annotations__)
            raise TypeError(f"got an unexpected keyword argument {name!r}, expected one of {known}")
    given = {name: value for name, value in settings.items() if value is not None}
    document: dict[str, Any] = {"task": task}
    for name, given_value in given.items():
        single = name in _RANGES and isinstance(given_value, (int, float, np.number))
        value = [given_value, given_value] if single else given_value
        if name in _SCENE:
            document.setdefault("scene", {})[name] = value
        elif name in _PARTS:
            document.setdefault(_PARTS[name], {})[_RENAMED.get(name, name)] = value
        elif name == "reward_weights":
            document["reward"] = value
        elif name in ("objects", "observation") and isinstance(value, str):
            document[name] = [value]
        else:
            document[name] = value
    try:
        return json.dumps(document, allow_nan=False, default=_plain)
    except (TypeError, ValueError, RecursionError) as error:
        found = ", ".join(f"{name}={reprlib.repr(value)}" for name, value in given.items())
        expected = "finite numbers, names, and lists or mappings of them"
        raise ValueError(f"settings: found {found}; expected {expected} ({error})") from None


def _plain(value: Any) -> Any:
    """Convert numpy's numbers and arrays, paths and other sequences to types that JSON has."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if hasattr(value, "__fspath__"):
        return value.__fspath__()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, Sequence):
        return list(value)
    raise TypeError(f"{type(value).__name__} is none of them")
