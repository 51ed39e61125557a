"""Checks of a task of one's own, and of the numbers that its rules return."""

from __future__ import annotations

import difflib
import math
import warnings
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from ruffini._schema import CHANNELS, ENDINGS, TASKS
from ruffini._words import nearest
from ruffini.custom._task import Task

_MOST_ENDINGS = 255
"""Most endings of an environment, which count from 1 in a byte."""


def check(task: Any) -> None:
    """Raise a ``ValueError`` unless `task` is a task of a known base and has terms with weights."""
    if not (isinstance(task, type) and issubclass(task, Task)):
        raise ValueError(f"task: found {task!r}, expected a subclass of ruffini.custom.Task")
    name, weights = task.__name__, task.terms
    if task.base not in TASKS:
        known = ", ".join(TASKS)
        near = nearest(str(task.base), TASKS)
        raise ValueError(f"{name}.base: found {task.base!r}{near} expected one of {known}")
    numbers = weights.values() if isinstance(weights, Mapping) else ()
    if not numbers or not all(isinstance(w, Real) and math.isfinite(w) for w in numbers):
        raise ValueError(f"{name}.terms: found {weights!r}, expected names with finite weights")
    rules = [rule for rule in vars(Task) if not rule.startswith("_")]
    for own in vars(task):
        if own not in rules and difflib.get_close_matches(own, rules, 1, 0.8):
            near = nearest(own, rules).rstrip("?")
            warnings.warn(f"{name}: {own!r} is no rule of a task{near}?", stacklevel=4)
    if task.reward is Task.reward:
        raise ValueError(f"{name}.reward: found none, expected a method that returns the terms")
    for listed in ("reads", "endings"):
        found = getattr(task, listed)
        if not isinstance(found, (str, Sequence)) or not all(isinstance(n, str) for n in found):
            raise ValueError(f"{name}.{listed}: found {found!r}, expected a list of names")
    for channel in names(task.reads):
        if channel not in CHANNELS:
            near = nearest(channel, CHANNELS)
            expected = f"one of {', '.join(CHANNELS)}"
            raise ValueError(f"{name}.reads: found {channel!r}{near} expected {expected}")
    _check_observation(task)
    endings = names(task.endings)
    if endings and task.ending is Task.ending:
        raise ValueError(f"{name}.endings: found {endings} and no method `ending`")
    if taken := [ending for k, ending in enumerate(endings) if ending in (*ENDINGS, *endings[:k])]:
        whose = "a built-in task's" if taken[0] in ENDINGS else "there twice"
        raise ValueError(f"{name}.endings: found {taken[0]!r}, which is {whose}, expected others")
    if len(endings) > (most := _MOST_ENDINGS - len(ENDINGS)):
        raise ValueError(f"{name}.endings: found {len(endings)}, expected at most {most}")


def _check_observation(task: type[Task]) -> None:
    """Raise a ``ValueError`` unless the task's own channels are boxes with names of their own."""
    name, boxes = task.__name__, task.observation
    if not isinstance(boxes, Mapping):
        raise ValueError(f"{name}.observation: found {boxes!r}, expected boxes by name")
    for channel, box in boxes.items():
        where = f"{name}.observation {channel!r}"
        if not isinstance(box, Box) or len(box.shape) != 1 or box.dtype != np.float32:
            raise ValueError(f"{where}: found {box!r}, expected Box(low, high, (n,), np.float32)")
        if channel in CHANNELS:
            raise ValueError(f"{where}: found a built-in channel's name, expected another")
    if boxes and task.observe is Task.observe:
        raise ValueError(f"{name}.observation: found {list(boxes)} and no method `observe`")
    if not boxes and task.observe is not Task.observe:
        raise ValueError(f"{name}.observe: found no `observation`, expected boxes of its channels")


def numbers(name: str, values: Any, count: int) -> NDArray[Any]:
    """Numbers (N,) of N rows; a single one of Python counts for all.

    Of numpy's it does not, for it is more likely a mean over rows by mistake.

    Raises:
        ValueError: If they are no numbers, or of another shape.
    """
    if isinstance(values, (int, float)) and not isinstance(values, np.generic):
        return np.full(count, float(values))
    column = np.asarray(values)
    if column.shape != (count,) or column.dtype.kind not in "fiub":
        found = f"{column.dtype} of shape {column.shape}"
        each = f"numbers of shape ({count},), one for each row, or one float for all"
        raise ValueError(f"{name}: found {found}, expected {each}")
    return column


def names(listed: str | Sequence[str]) -> list[str]:
    """Names of a list, or of one name alone."""
    return [listed] if isinstance(listed, str) else list(listed)
