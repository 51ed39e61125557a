"""Access to the rows of a batch as to the single environments that they equal.

What belongs to one row is read or changed for that row alone; what all rows share is returned for
each requested row. A call that would also affect rows that were not requested is a ``ValueError``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ruffini._spaces import Camera, check_options, is_whole

if TYPE_CHECKING:
    from ruffini._vector import NativeVectorEnv

_SINGLE = {
    "observation_space": "single_observation_space",
    "action_space": "single_action_space",
}
"""Attributes of a row that have another name in the batch."""


def chosen(indices: int | Iterable[int] | None, count: int) -> list[int]:
    """Rows among `count` that `indices` selects, counted from the end if negative; ``None``: all.

    Raises:
        ValueError: If there is no such row, or one is named twice.
    """
    if indices is None:
        return list(range(count))
    given = [indices] if isinstance(indices, (int, np.integer)) else list(indices)
    for row in given:
        if not (is_whole(row) and -count <= row < count):
            raise ValueError(f"indices: found {row!r}, expected rows from {-count} to {count - 1}")
    rows = [int(row) % count for row in given]
    if len(set(rows)) != len(rows):
        raise ValueError(f"indices: found {given}, expected each row once")
    return rows


def expect_row(row: int, count: int) -> int:
    """Row of a batch of `count`.

    Raises:
        IndexError: If there is no such row.
    """
    if not (is_whole(row) and 0 <= row < count):
        raise IndexError(f"row: found {row!r}, expected 0 to {count - 1}")
    return int(row)


def attribute(envs: NativeVectorEnv, rows: Sequence[int], name: str) -> list[Any]:
    """An attribute of each of `rows`; for a method, a function that calls it for that row.

    Raises:
        ValueError: If it is the batch or one of its methods, and `rows` are not all rows.
    """
    value = getattr(envs, _SINGLE.get(name, name))
    if name in _METHODS:
        return [partial(_call_of_one, envs, row, name) for row in rows]
    if value is envs or callable(getattr(type(envs), name, None)):
        _expect_all(envs, rows, name)
    return [value for _ in rows]


def set_attribute(envs: NativeVectorEnv, rows: Sequence[int], name: str, value: Any) -> None:
    """Set an attribute, which all rows share.

    Raises:
        ValueError: If `rows` are not all rows, it is a setting, which is read once, or a task of
            one's own has no such attribute.
    """
    envs._check_attribute(name)
    _expect_all(envs, rows, name)
    setattr(envs, _SINGLE.get(name, name), value)


def call(
    envs: NativeVectorEnv, rows: Sequence[int], name: str, *args: Any, **kwargs: Any
) -> list[Any]:
    """Call a method for each of `rows`, with the same arguments; return the results.

    A method of the whole batch is called once, and its result is returned for each row.

    Raises:
        ValueError: If it is a method of the whole batch, and `rows` are not all rows.
    """
    if not rows:
        return []
    if name in _METHODS:
        return _METHODS[name](envs, rows, *args, **kwargs)
    method = getattr(envs, name)
    _expect_all(envs, rows, name)
    result = method(*args, **kwargs)
    return [result for _ in rows]


def _call_of_one(envs: NativeVectorEnv, row: int, name: str, *args: Any, **kwargs: Any) -> Any:
    return call(envs, [row], name, *args, **kwargs)[0]


def _expect_all(envs: NativeVectorEnv, rows: Sequence[int], name: str) -> None:
    if len(rows) != envs.num_envs:
        found = f"{len(rows)} of {envs.num_envs} rows"
        raise ValueError(f"indices: found {found}, expected all: they share {name}")


def _of_row(name: str) -> Callable[..., list[Any]]:
    """A method of the batch that takes the number of a row."""
    return lambda envs, rows: [getattr(envs, name)(row) for row in rows]


def _shared(name: str) -> Callable[..., list[Any]]:
    """A method of the batch whose result holds for every row, and that changes nothing."""
    return lambda envs, rows: [getattr(envs, name)() for _ in rows]


def _state(envs: NativeVectorEnv, rows: Sequence[int]) -> list[Any]:
    states = envs.state()
    return [states[row] for row in rows]


def _set_state(envs: NativeVectorEnv, rows: Sequence[int], state: Any) -> list[Any]:
    """Set one state for all rows, or a list with one for each.

    Only all rows together can be restored: the batch resets the time measurements of all rows.
    """
    _expect_all(envs, rows, "set_state, which starts the plan of every row anew")
    states = [state] * len(rows) if isinstance(state, bytes) else state
    if isinstance(states, (list, tuple)) and len(states) == len(rows):
        states = [states[rows.index(row)] for row in range(envs.num_envs)]
    observation = envs.set_state(states)
    return [_row_of(observation, row) for row in rows]


def _reset(
    envs: NativeVectorEnv,
    rows: Sequence[int],
    *,
    seed: int | None = None,
    options: dict[str, Any] | None = None,
) -> list[Any]:
    """Reset `rows`, each with the same seed."""
    check_options(options)
    mask = np.zeros(envs.num_envs, np.bool_)
    mask[list(rows)] = True
    seeds = None if seed is None else [seed if asked else None for asked in mask]
    observation, _ = envs.reset(seed=seeds, options={**(options or {}), "reset_mask": mask})
    return [(_row_of(observation, row), {}) for row in rows]


def _step(envs: NativeVectorEnv, rows: Sequence[int], *_: Any, **__: Any) -> list[Any]:
    raise ValueError("step: found a call for rows, expected one of the vector environment's step")


def _render(envs: NativeVectorEnv, rows: Sequence[int], camera: Camera | None = None) -> list[Any]:
    return [envs.picture(row, camera) for row in rows]


_METHODS: dict[str, Callable[..., list[Any]]] = {
    "look": _of_row("look"),
    "state": _state,
    "set_state": _set_state,
    "reset": _reset,
    "step": _step,
    "render": _render,
    "channels": _shared("channels"),
    "skin": _shared("skin"),
    "surfaces": _of_row("surfaces"),
    "presses": _of_row("presses"),
}
"""Methods of a single environment, as called for rows."""


def _row_of(observation: Any, row: int) -> Any:
    """Copy of the observation of one row."""
    if isinstance(observation, dict):
        return {name: values[row].copy() for name, values in observation.items()}
    return observation[row].copy()
