"""Tasks of one's own: reward, endings, success, starts and observations in Python.

Their physics are those of a built-in task.

A task is a class whose methods compute arrays over N environments at once. The same class makes a
single environment (N = 1), a vector environment, and one for Stable-Baselines3::

    class Snug(ruffini.custom.Task):
        base = "GraspLift"
        terms = {"lift": 0.8, "snug": 0.2}

        def reward(self, state):
            force = state.part("proprio", "normal force of each pad").min(axis=1)
            return {"lift": state.base_terms["lift"], "snug": np.exp(-((force - 3.0) ** 2))}

    ruffini.custom.register("me/Snug-v0", Snug)
    env = gymnasium.make("me/Snug-v0", objects="cup")
    envs = gymnasium.make_vec("me/Snug-v0", num_envs=64)
"""

from __future__ import annotations

import difflib
import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from ruffini._native import Channels, Native, StepArrays
from ruffini._schema import CHANNELS, ENDINGS, RULES, TASKS
from ruffini._single import NativeEnv
from ruffini._spaces import (
    ACTION_SIZE,
    NO_LIMIT,
    Observation,
    Renderer,
    Spaces,
    check_count,
)
from ruffini._vector import NativeVectorEnv
from ruffini._words import nearest
from ruffini.policies._parts import Places, find, places_of

__all__ = ["CustomEnv", "CustomVectorEnv", "Draws", "State", "Task", "register"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
_MOST_ENDINGS = 255
"""Most endings of an environment, which count from 1 in a byte."""
_ROUNDING = 1e-5
"""Share of its bounds, or of 1, by which an own channel may lie beyond them."""
_QUANTITIES = (
    *("object", "mass", "friction", "size", "yaw", "x", "y", "start_x", "start_y"),
    *("start_height", "gel_stiffness"),
)
_SETTINGS = {"object": "objects", "x": "position", "y": "position"}
_SETTINGS |= {"start_x": "start", "start_y": "start"}
"""Quantities of a start that a task may draw, and settings of them that have other names."""


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


class _Custom(Native):
    """Native batch whose reward, endings and success a :class:`Task` computes."""

    _task: Task
    _fresh: Bools
    """Rows that native restarts in the next step."""
    _drawn: Bools
    """Rows whose next episode has its start."""

    def __init__(self, task: type[Task], *args: Any, **settings: Any) -> None:
        _check(task)
        if "reward_weights" in settings:
            expected = f"none: {task.__name__} has its weights in `terms`"
            found = settings["reward_weights"]
            raise ValueError(f"reward_weights: found {found!r}, expected {expected}")
        self._task = task()
        # Native is given the name of the base; the attribute of the class is its own.
        self.TASK = task.base  # type: ignore[misc]
        super().__init__(*args, **{**task.settings, **settings})

    def _make(self, renderer: Renderer, obs: str, settings: dict[str, Any]) -> None:
        super()._make(renderer, obs, settings)
        observed = [name for name, _ in self._batch.layout()]
        read = [name for name in _names(self._task.reads) if name not in observed]
        if read:
            settings["observation"] = [*observed, *read]
            self._batch = self._new_batch()
        self._observed = [*observed, *self._task.observation]
        self._make_spaces()
        self._base_terms = self._batch.reward_terms()
        self._terms = list(self._task.terms)
        self._own_endings = _names(self._task.endings)
        self._endings = [*ENDINGS, *self._own_endings]
        self._failures = [code for code, name in enumerate(ENDINGS, 1) if name not in RULES]
        self._weights = np.array([self._task.terms[name] for name in self._terms])
        self._fresh = np.ones(self._count, np.bool_)
        self._streams = [np.random.default_rng(row) for row in range(self._count)]
        self._given: dict[str, Floats] = {}
        self._drawn = np.zeros(self._count, np.bool_)
        self._action = np.zeros((self._count, ACTION_SIZE), np.float32)
        self._paid = np.zeros((self._count, len(self._base_terms)))
        self._done = np.zeros(self._count, np.bool_)

    def _make_spaces(self) -> None:
        """Spaces of what the agent observes, and the layout of all that native computes."""
        super()._make_spaces()
        self._whole = Spaces(self._batch.layout(), "dict")
        self._places = places_of(self._batch.layout())

    def channels(self) -> Channels:
        """Channels as of the base's environment, the task's own after those that it observes."""
        native, own = super().channels(), self._task.observation
        observed = len(native) if self._observed is None else len(self._observed) - len(own)
        added = [(name, [(name, *_bounds(box), "")]) for name, box in own.items()]
        return Channels([*native[:observed], *added, *native[observed:]])

    def _begin(self, seeds: list[int | None] | None, mask: Bools | None) -> NDArray[np.float32]:
        rows = np.ones(self._count, np.bool_) if mask is None else mask
        for row, seed in enumerate(seeds or ()):
            if seed is not None:
                self._streams[row] = np.random.default_rng(seed)
                self._drawn[row] = False
        self._draw(rows)
        observation = super()._begin(seeds, mask)
        self._start(observation, rows)
        return self._with_own(observation)

    def _draw(self, rows: Bools) -> None:
        """Give the native batch the start of the next episodes of `rows`, where it has none yet.

        Raises:
            ValueError: If a quantity is unknown, of another shape, or out of its range.
        """
        chosen = np.flatnonzero(rows & ~self._drawn)
        if type(self._task).draw is Task.draw or not len(chosen):
            return
        drawn = self._task.draw(Draws([self._streams[row] for row in chosen]))
        if not isinstance(drawn, Mapping):
            raise ValueError(f"draw: found {type(drawn).__name__}, expected numbers by name")
        for name in drawn:
            if name not in (known := _quantities(self._task.base)):
                near = nearest(str(name), known)
                expected = f"what {self._task.base} draws: {', '.join(known)}"
                raise ValueError(f"draw: found {name!r}{near} expected {expected}")
        # What is left out this time is drawn by native again.
        for given in self._given.values():
            given[chosen] = np.nan
        for name, values in drawn.items():
            column = _numbers(f"draw {name}", values, len(chosen))
            if not np.isfinite(column).all():
                raise ValueError(f"draw {name}: found {column}, expected finite numbers")
            self._given.setdefault(name, np.full(self._count, np.nan))[chosen] = column
        self._give()
        self._drawn[chosen] = True

    def _give(self) -> None:
        for name, values in self._given.items():
            self._batch.give(name, values)

    def _start(self, observation: NDArray[np.float32], rows: Bools) -> None:
        """Begin the episodes of `rows`: nothing was done and paid in them yet."""
        self._action = np.where(rows[:, None], np.float32(0.0), self._action)
        self._paid = np.where(rows[:, None], 0.0, self._paid)
        self._done = self._done & ~rows
        chosen = np.flatnonzero(rows)
        self._task.start(self._state(observation, chosen), chosen)
        self._fresh = self._fresh & ~rows
        self._drawn &= ~rows
        if self._autoreset == "SameStep":
            # Native restarts rows within a step, when it is too late to draw.
            self._draw(rows)

    def _state(self, observation: NDArray[np.float32], begun: Iterable[int] = ()) -> State:
        channels = self._whole.cut(observation)
        assert isinstance(channels, dict)
        named = dict(zip(self._base_terms, self._paid.T, strict=True))
        random = Draws([self._streams[row] for row in begun])
        return State(channels, self._action, named, self._done, self._places, random)

    def _with_own(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Observations of native with the task's own channels after those that are observed.

        Raises:
            ValueError: If a channel is missing, unknown, of another shape, or not finite.
        """
        boxes = self._task.observation
        if not boxes:
            return observation
        given = self._task.observe(self._state(observation))
        if not isinstance(given, Mapping) or set(given) != set(boxes):
            names = list(given) if isinstance(given, Mapping) else type(given).__name__
            raise ValueError(f"observe: found {names}, expected the channels {list(boxes)}")
        own = [self._own_channel(name, given[name], box) for name, box in boxes.items()]
        # Channels that are not observed stay last.
        observed = self._spaces.size - sum(channel.shape[1] for channel in own)
        return np.concatenate([observation[:, :observed], *own, observation[:, observed:]], axis=1)

    def _own_channel(self, name: str, values: Any, box: Box) -> NDArray[np.float32]:
        """Values (N, n) of one of the task's own channels."""
        array = np.asarray(values)
        shape = (self._count, *box.shape)
        if array.shape == (self._count,) and box.shape == (1,):
            array = array[:, None]
        if array.shape != shape or array.dtype.kind not in "fiub":
            found = f"{array.dtype} of shape {array.shape}"
            raise ValueError(f"observe {name}: found {found}, expected numbers of shape {shape}")
        # Rounding may lead just beyond a bound.
        low, high = (bound.astype(np.float64) for bound in (box.low, box.high))
        slack = _ROUNDING * np.maximum(1.0, np.maximum(np.abs(low), np.abs(high)))
        slack = np.where(np.isfinite(slack), slack, 0.0)
        within = np.isfinite(array) & (array >= low - slack) & (array <= high + slack)
        if not within.all():
            row, place = np.argwhere(~within)[0]
            found = f"{array[row, place]} in row {row}"
            expected = f"finite numbers from {low[place]:g} to {high[place]:g}, its box"
            raise ValueError(f"observe {name}: found {found}, expected {expected}")
        channel: NDArray[np.float32] = np.clip(array.astype(np.float32), box.low, box.high)
        return channel

    def _advance(self, actions: NDArray[np.float32]) -> StepArrays:
        # Rows that native restarts in this step: their action is ignored and nothing is paid.
        restarted = self._fresh
        self._draw(restarted)
        step = super()._advance(actions)
        self._action = np.clip(actions, np.float32(-1.0), np.float32(1.0))
        self._paid, self._done = step.terms, step.success
        whole = step.observation
        if step.finals:
            whole = whole.copy()
            for row, last in step.finals:
                whole[row] = last
        state = self._state(whole)
        step.terms = self._judged_terms(state)
        step.success = self._booleans("is_success", self._task.is_success(state)) & ~restarted
        ended = self._ended_by_task(state, step, restarted)
        step.terms[restarted] = 0.0
        step.terms[np.isin(step.ending, self._failures)] = 0.0
        step.reward = step.terms @ self._weights
        seen = self._with_own(whole)
        begun = self._restart(step, seen, ended, restarted)
        step.observation = self._with_own(step.observation) if begun else seen
        return step

    def _ended_by_task(self, state: State, step: StepArrays, restarted: Bools) -> Bools:
        """Rows that the task alone ends; marks them as terminated with the ending's name."""
        ended = np.zeros(self._count, np.bool_)
        endings = self._task.ending(state)
        if not isinstance(endings, Mapping):
            raise ValueError(f"ending: found {type(endings).__name__}, expected booleans by name")
        for name, rows in endings.items():
            if name not in self._own_endings:
                known = ", ".join(self._own_endings) or "none: `endings` lists no name"
                near = nearest(str(name), self._own_endings)
                raise ValueError(f"ending: found {name!r}{near} expected one of {known}")
            new = self._booleans(f"ending {name}", rows) & ~restarted & ~step.terminated & ~ended
            step.ending[new] = self._endings.index(name) + 1
            ended |= new
        step.terminated = step.terminated | ended
        already = step.truncated & ended
        step.truncated = step.truncated & ~ended
        return ended & ~already

    def _restart(
        self, step: StepArrays, seen: NDArray[np.float32], ended: Bools, restarted: Bools
    ) -> bool:
        """Restart the rows that the task has ended, according to the autoreset mode.

        Rows that are restarted within the step get their last observation from `seen`. Returns
        whether any episode has begun.
        """
        over = step.terminated | step.truncated
        begun = restarted.copy()
        if self._autoreset == "SameStep":
            step.finals = [(int(row), seen[row].copy()) for row in np.flatnonzero(over)]
            if ended.any():
                step.observation = self._batch.reset(None, ended)
            begun |= over
        elif ended.any():
            self._batch.end(ended)
        if begun.any():
            self._start(step.observation, begun)
        self._fresh = over if self._autoreset == "NextStep" else np.zeros(self._count, np.bool_)
        return bool(begun.any())

    def _judged_terms(self, state: State) -> Floats:
        """Terms (N, K) of the task's reward.

        Raises:
            ValueError: If a term is missing, unknown, of another shape, or not finite.
        """
        given = self._task.reward(state)
        if not isinstance(given, Mapping) or set(given) != set(self._terms):
            names = list(given) if isinstance(given, Mapping) else type(given).__name__
            raise ValueError(f"reward: found {names}, expected the terms {self._terms}")
        terms = np.empty((self._count, len(self._terms)))
        for k, name in enumerate(self._terms):
            terms[:, k] = _numbers(f"reward {name}", given[name], self._count)
        wrong = np.argwhere(~np.isfinite(terms))
        if len(wrong):
            row, k = wrong[0]
            name, value = self._terms[k], terms[row, k]
            raise ValueError(f"reward {name}: found {value} in row {row}, expected finite numbers")
        return terms

    def _booleans(self, name: str, rows: Any) -> Bools:
        mask = np.asarray(rows)
        if mask.shape != (self._count,) or mask.dtype != np.bool_:
            found = f"{mask.dtype} of shape {mask.shape}"
            raise ValueError(f"{name}: found {found}, expected booleans ({self._count},)")
        return mask

    def __getstate__(self) -> dict[str, Any]:
        state = super().__getstate__()
        del state["_whole"], state["_places"]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        self._give()

    def _check_snapshots(self) -> None:
        task = type(self._task)
        if task.observation or task.start is not Task.start or task.draw is not Task.draw:
            raise ValueError(
                f"state: {task.__name__} keeps numbers of its own, which no snapshot has"
            )


def _numbers(name: str, values: Any, count: int) -> NDArray[Any]:
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


class CustomEnv(_Custom, NativeEnv):
    """One environment of a :class:`Task`; arguments as of the base's environment.

    Raises:
        TypeError: If a setting is unknown.
        ValueError: If `task` is no task, or a setting is of the wrong type or out of range.
    """

    def set_state(self, state: bytes) -> Observation:
        """As of the base's environment; an error with ``start``, ``draw`` or ``observe``."""
        self._check_snapshots()
        return super().set_state(state)


class CustomVectorEnv(_Custom, NativeVectorEnv):
    """Many environments of a :class:`Task` stepped together; arguments as of the base's.

    Raises:
        TypeError: If a setting is unknown.
        ValueError: If `task` is no task, or a setting is of the wrong type or out of range.
    """

    def set_state(self, states: Sequence[bytes]) -> Any:
        """As of the base's environments; an error with ``start``, ``draw`` or ``observe``."""
        self._check_snapshots()
        return super().set_state(states)


def register(env_id: str, task: type[Task], max_episode_steps: int | None = None) -> None:
    """Register a task with Gymnasium, for ``make``, ``make_vec`` and Stable-Baselines3.

    Args:
        env_id: Id, such as ``"me/Snug-v0"``.
        task: The class.
        max_episode_steps: Steps after which an episode is truncated; the base's if not given.

    Raises:
        ValueError: If `task` is no task.
    """
    _check(task)
    if max_episode_steps is not None:
        check_count("max_episode_steps", max_episode_steps, NO_LIMIT)
    steps = task.settings.get("max_episode_steps", TASKS[task.base]["max_episode_steps"])
    gym.register(
        id=env_id,
        entry_point=CustomEnv,  # type: ignore[arg-type]
        vector_entry_point=CustomVectorEnv,  # type: ignore[arg-type]
        max_episode_steps=max_episode_steps or steps,
        kwargs={"task": task},
    )


def _check(task: Any) -> None:
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
            warnings.warn(f"{name}: {own!r} is no rule of a task{near}?", stacklevel=3)
    if task.reward is Task.reward:
        raise ValueError(f"{name}.reward: found none, expected a method that returns the terms")
    for listed in ("reads", "endings"):
        found = getattr(task, listed)
        if not isinstance(found, (str, Sequence)) or not all(isinstance(n, str) for n in found):
            raise ValueError(f"{name}.{listed}: found {found!r}, expected a list of names")
    for channel in _names(task.reads):
        if channel not in CHANNELS:
            near = nearest(channel, CHANNELS)
            expected = f"one of {', '.join(CHANNELS)}"
            raise ValueError(f"{name}.reads: found {channel!r}{near} expected {expected}")
    _check_observation(task)
    endings = _names(task.endings)
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


def _quantities(base: str) -> list[str]:
    """Quantities of a start that a base draws."""
    drawn = {each["name"] for kind in ("settings", "others") for each in TASKS[base][kind]}
    return [name for name in _QUANTITIES if _SETTINGS.get(name, name) in drawn]


def _bounds(box: Box) -> tuple[list[float], list[float]]:
    """Lower and upper bounds of a box of one axis."""
    return box.low.tolist(), box.high.tolist()


def _names(listed: str | Sequence[str]) -> list[str]:
    """Names of a list, or of one name alone."""
    return [listed] if isinstance(listed, str) else list(listed)
