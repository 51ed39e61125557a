"""What a task of one's own is made of: its rules, the state that they read, random numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from ruffini.policies._parts import Places, find

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class State:
    """State of N environments after a step, or at the start of episodes."""

    channels: dict[str, NDArray[np.float32]]
    """Observed channels and those that the task reads, each (N, ...)."""
    action: NDArray[np.float32]
    """Actions (N, 5) of the step, cut to [-1, 1]; zeros at the start."""
    base_terms: dict[str, Floats]
    """Terms of the built-in task's reward, each (N,)."""
    base_success: Bools
    """Rows (N,) in which the built-in task is done."""
    places: Places = field(repr=False)
    """Place of each component in its channel."""
    random: Draws
    """Random numbers for the rows that begin, in :meth:`Task.start`; elsewhere for none."""

    def part(self, channel: str, component: str) -> NDArray[np.float32]:
        """One component (N, ...) of a channel, by its name in ``env.unwrapped.channels()``.

        The name of what soft pads feel may stand without its shape: ``"force, +x pad"``.

        Raises:
            KeyError: If there is none, or the task neither observes nor reads the channel.
        """
        return find(self.places, self.channels, channel, component)


class Draws:
    """Random numbers for some rows, each from the row's own stream, which its seed restarts."""

    def __init__(self, streams: Sequence[np.random.Generator]) -> None:
        self._streams = streams

    def __len__(self) -> int:
        """Number of rows that are drawn for."""
        return len(self._streams)

    def uniform(self, low: float = 0.0, high: float = 1.0) -> Floats:
        """One number (n,) for each row, uniform in a range."""
        return np.array([stream.uniform(low, high) for stream in self._streams])

    def normal(self, mean: float = 0.0, deviation: float = 1.0) -> Floats:
        """One number (n,) for each row, normally distributed."""
        return np.array([stream.normal(mean, deviation) for stream in self._streams])

    def choice(self, values: Sequence[float]) -> Floats:
        """One of `values` (n,) for each row, with equal probability."""
        return np.array([stream.choice(values) for stream in self._streams], np.float64)


class Task:
    """Reward, endings and success of an environment; one instance serves one environment.

    Physics, actions, start and channels are those of `base`, whose endings hold as well.
    """

    base: ClassVar[str] = "GraspLift"
    """Built-in task, such as ``GraspLift``."""

    settings: ClassVar[Mapping[str, Any]] = {}
    """Other defaults of the base's settings."""

    terms: ClassVar[Mapping[str, float]] = {}
    """Names of the reward's terms with their weights: the reward is the sum of weight times
    term."""

    reads: ClassVar[str | Sequence[str]] = ()
    """Channels that the rules read and the agent need not observe, such as ``properties``; one may
    be given by its name alone."""

    endings: ClassVar[str | Sequence[str]] = ()
    """Names of the endings that :meth:`ending` may return, other than those of built-in tasks; one
    may be given by its name alone."""

    observation: ClassVar[Mapping[str, Box]] = {}
    """Channels that :meth:`observe` adds to those of the base, each a box of one axis of 32-bit
    floats."""

    def draw(self, random: Draws) -> Mapping[str, Floats]:
        """Quantities of the start of the next episodes; those left out are drawn as usual.

        ``object`` (counted from 0 in the setting ``objects``), ``mass`` (kg), ``friction``,
        ``size``, ``yaw`` (rad), ``x``, ``y``, ``start_x``, ``start_y``, ``start_height`` (m) and
        ``gel_stiffness``, each (n,) for the n rows that `random` draws for, or one number for all,
        within the range that the settings have. With the autoreset mode ``SameStep``, which
        Stable-Baselines3 uses, it is called when the episode before begins: numbers of a task's own
        are drawn in `start`.
        """
        return {}

    def start(self, state: State, rows: NDArray[np.intp]) -> None:
        """Take note of the rows whose episode begins with `state`; whatever is kept, is kept here.

        ``state.random`` draws for these rows.

        Args:
            state: State of all N environments; only `rows` begin.
            rows: Indices of the rows that begin.
        """

    def reward(self, state: State) -> Mapping[str, Any]:
        """Each of the `terms` as numbers (N,), or one number for all rows."""
        raise NotImplementedError(f"{type(self).__name__} has no reward")

    def ending(self, state: State) -> Mapping[str, Any]:
        """Rows (N,) whose episode ends, by the name of the ending; none by default."""
        return {}

    def observe(self, state: State) -> Mapping[str, Any]:
        """Values (N, n) of each channel in `observation`; (N,) will do where n is 1.

        Called after `start` and after `reward`, `ending` and `is_success`, in a step in which
        episodes begin once more than that: what it keeps is not kept once a step.
        """
        return {}

    def is_success(self, state: State) -> Any:
        """Rows (N,) in which the task is done, which ends no episode; by default, the base's."""
        return state.base_success
