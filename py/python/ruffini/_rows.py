"""Rows of a batch, asked as the single environments that they equal.

What a row has of its own is asked of it or done to it alone. What the rows have in common is given
to each that asks. A call that would take in rows which nobody asked for is a ``ValueError``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ruffini._spaces import check_options

if TYPE_CHECKING:
    from ruffini._vector import NativeVectorEnv

_SINGLE = {
    "observation_space": "single_observation_space",
    "action_space": "single_action_space",
}
"""Attributes that a row has under another name in the batch."""


def chosen(indices: int | Iterable[int] | None, count: int) -> list[int]:
    """Rows that `indices` names among `count`, the last one as -1 too, or all for ``None``.

    Raises:
        ValueError: If there is no such row, or one is named twice.
    """
    if indices is None:
        return list(range(count))
    given = [indices] if isinstance(indices, (int, np.integer)) else list(indices)
    for row in given:
        whole = isinstance(row, (int, np.integer)) and not isinstance(row, bool)
        if not (whole and -count <= row < count):
            raise ValueError(f"indices: found {row!r}, expected rows from {-count} to {count - 1}")
    rows = [int(row) % count for row in given]
    if len(set(rows)) != len(rows):
        raise ValueError(f"indices: found {given}, expected each row once")
    return rows


def attribute(envs: NativeVectorEnv, rows: Sequence[int], name: str) -> list[Any]:
    """An attribute of each of `rows`; of a method, what calls it for that row.

    Raises:
        ValueError: If it is the batch or one of its methods, and only some of the rows are asked.
    """
    value = getattr(envs, _SINGLE.get(name, name))
    if name in _METHODS:
        return [partial(_call_of_one, envs, row, name) for row in rows]
    if value is envs or callable(getattr(type(envs), name, None)):
        _expect_all(envs, rows, name)
    return [value for _ in rows]


def set_attribute(envs: NativeVectorEnv, rows: Sequence[int], name: str, value: Any) -> None:
    """Sets an attribute, which the rows have in common.

    Raises:
        ValueError: If only some of the rows are asked.
    """
    _expect_all(envs, rows, name)
    setattr(envs, _SINGLE.get(name, name), value)


def call(
    envs: NativeVectorEnv, rows: Sequence[int], name: str, *args: Any, **kwargs: Any
) -> list[Any]:
    """Answers of a method called for each of `rows`, with the same arguments.

    A method that is not a row's is called once for the batch, and each row gets what it returns.

    Raises:
        ValueError: If it is a method of the whole batch, and only some of the rows are asked.
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


def _look(envs: NativeVectorEnv, rows: Sequence[int]) -> list[Any]:
    return [envs.look(row) for row in rows]


def _state(envs: NativeVectorEnv, rows: Sequence[int]) -> list[Any]:
    states = envs.state()
    return [states[row] for row in rows]


def _set_state(envs: NativeVectorEnv, rows: Sequence[int], state: Any) -> list[Any]:
    """One state for all rows, or a list of one each.

    Only all rows can be put back: the batch forgets the costs of every row's stages with it.
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
    """Every row gets that very seed."""
    check_options(options)
    mask = np.zeros(envs.num_envs, np.bool_)
    mask[list(rows)] = True
    seeds = None if seed is None else [seed if asked else None for asked in mask]
    observation, _ = envs.reset(seed=seeds, options={**(options or {}), "reset_mask": mask})
    return [(_row_of(observation, row), {}) for row in rows]


def _step(envs: NativeVectorEnv, rows: Sequence[int], *_: Any, **__: Any) -> list[Any]:
    raise ValueError("step: found a call for rows, expected one of the vector environment's step")


def _render(envs: NativeVectorEnv, rows: Sequence[int]) -> list[Any]:
    return [envs.picture(row) for row in rows]


def _channels(envs: NativeVectorEnv, rows: Sequence[int]) -> list[Any]:
    return [envs.channels() for _ in rows]


def _skin(envs: NativeVectorEnv, rows: Sequence[int]) -> list[Any]:
    return [envs.skin() for _ in rows]


_METHODS: dict[str, Callable[..., list[Any]]] = {
    "look": _look,
    "state": _state,
    "set_state": _set_state,
    "reset": _reset,
    "step": _step,
    "render": _render,
    "channels": _channels,
    "skin": _skin,
}
"""Methods of a single environment as a row answers them."""


def _row_of(observation: Any, row: int) -> Any:
    """The observation of one row, its own."""
    if isinstance(observation, dict):
        return {name: values[row].copy() for name, values in observation.items()}
    return observation[row].copy()
