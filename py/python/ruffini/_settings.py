"""Keyword arguments of the environments, and their conversion to JSON for Rust."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypedDict

import numpy as np

from ruffini._schema import SETTINGS, SHARED, TASKS
from ruffini._words import nearest

Range = float | tuple[float, float]
"""Both ends of a uniform draw, or a single value."""


class Settings(TypedDict, total=False):
    """Settings of all tasks; :mod:`ruffini.envs` documents meanings, defaults and tasks.

    Type checkers read them here; a test compares them with what Rust has.
    """

    objects: str | Mapping[str, Any] | Sequence[str | Mapping[str, Any]]
    mass: Range
    friction: Range
    size: Range
    position: Range
    yaw: Range
    start: Range
    start_height: Range
    gel_stiffness: Range
    lift_height: float
    hold_time: float
    distractors: int
    grip_rate: float
    safety_factor: float
    margin: Range
    start_grip: float
    least_grip: float
    load: Range
    shaking: Range
    shaking_frequency: Range
    slip_limit: float
    max_grip_ratio: float
    clearance: Range
    hole_error: Range
    hole_yaw_error: Range
    peg_offset: Range
    peg_tilt: Range
    insert_depth: float
    force_limit: float
    young: Range
    poisson: float
    crush: float
    max_episode_steps: int
    tactile: Literal["surrogate", "compliance", "fem", "none"]
    sensor: str
    material: str | Mapping[str, float]
    network: str | PathLike[str]
    resolution: Mapping[str, int | Sequence[int]]
    observation: str | Sequence[str]
    sensor_errors: Mapping[
        str, Mapping[str, float | Sequence[float] | Mapping[str, float | Sequence[float]]]
    ]
    reward_weights: Mapping[str, float]
    gripper: Mapping[str, float]
    workspace: Mapping[str, Sequence[float]]
    physics: Mapping[str, float]


_INSTEAD = {
    "seed": "reset(seed=...)",
    **dict.fromkeys(
        ("num_envs", "num_threads", "autoreset_mode"),
        "it in gymnasium.make_vec, which makes a batch",
    ),
}
"""What takes the place of arguments that are asked for elsewhere."""


def to_json(settings: Mapping[str, Any], task: str, arguments: Sequence[str] = ()) -> str:
    """Convert the settings of a task to the JSON that Rust reads.

    Args:
        settings: Values by name.
        task: Name of the task.
        arguments: What else the environment takes, for the error of an unknown name.

    Raises:
        TypeError: If a setting is unknown.
        ValueError: If a value is not a finite number, a name, or a list or mapping of those.
    """
    own = (each["name"] for each in TASKS[task]["settings"])
    known = list(dict.fromkeys([*arguments, *SHARED, *own]))
    for name in settings:
        if name not in SETTINGS:
            if name in _INSTEAD and name not in arguments:
                raise TypeError(
                    f"got an unexpected keyword argument {name!r}, expected {_INSTEAD[name]}"
                )
            raise TypeError(
                f"got an unexpected keyword argument {name!r}{nearest(name, known)} "
                f"expected one of {', '.join(known)}"
            )
    given = {name: value for name, value in settings.items() if value is not None}
    if isinstance(given.get("objects"), Mapping):
        given["objects"] = [given["objects"]]
    for name, value in given.items():
        try:
            json.dumps(value, allow_nan=False, default=plain)
        except (TypeError, ValueError, RecursionError) as error:
            expected = "finite numbers, names, and lists or mappings of them"
            found = reprlib.repr(value)
            raise ValueError(f"{name}: found {found}, expected {expected} ({error})") from None
    return json.dumps(given | {"task": task}, default=plain)


def read_json(path: Path) -> dict[str, Any]:
    """Contents of a file; a ``ValueError`` that names it if they are no JSON object."""
    try:
        found = json.loads(path.read_bytes())
    except ValueError as error:
        raise ValueError(f"{path}: damaged, {error}") from None
    if not isinstance(found, dict):
        raise ValueError(f"{path}: damaged, expected a JSON object")
    return found


def plain(value: Any) -> Any:
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
