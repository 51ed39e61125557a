"""Native batch whose reward, endings and success are those of a task of one's own."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from ruffini._native import Channels, Native, StepArrays
from ruffini._schema import ENDINGS, RULES, SETTINGS, TASKS
from ruffini._spaces import ACTION_SIZE, Renderer, Spaces
from ruffini._words import nearest
from ruffini.custom._checks import check, names, numbers
from ruffini.custom._task import Bools, Draws, Floats, State, Task
from ruffini.policies._parts import places_of

_ROUNDING = 1e-5
"""Share of its bounds, or of 1, by which an own channel may lie beyond them."""


class Custom(Native):
    """Native batch whose reward, endings and success a :class:`Task` computes."""

    _is_made = False
    """Whether attributes may be those of the task: the constructor sets the environment's."""
    _task: Task
    _drawn: Bools
    """Rows whose next episode has its start."""

    def __init__(self, task: type[Task], *args: Any, **settings: Any) -> None:
        check(task)
        if "reward_weights" in settings:
            expected = f"none: {task.__name__} has its weights in `terms`"
            found = settings["reward_weights"]
            raise ValueError(f"reward_weights: found {found!r}, expected {expected}")
        self._task = task()
        # Native is given the name of the base; the attribute of the class is its own.
        self.TASK = task.base  # type: ignore[misc]
        given = {name: value for name, value in settings.items() if value is not None}
        super().__init__(*args, **{**task.settings, **given})
        self._is_made = True

    @property
    def task(self) -> Task:
        """The task whose rules these are; its attributes may be read and set at any time."""
        return self._task

    def _is_tasks(self, name: str) -> bool:
        """Return whether a public attribute is the task's, not the environment's."""
        return (
            not name.startswith("_")
            and not hasattr(type(self), name)
            and name not in {*self.__dict__, *vars(Task), *SETTINGS}
            and hasattr(self.__dict__.get("_task"), name)
        )

    def __getattr__(self, name: str) -> Any:
        """Attribute of the task that the environment does not have."""
        if self._is_tasks(name):
            return getattr(self._task, name)
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute, of the task if it is the task's."""
        if self._is_made and self._is_tasks(name):
            setattr(self._task, name, value)
        else:
            super().__setattr__(name, value)

    def _check_attribute(self, name: str) -> None:
        super()._check_attribute(name)
        if not hasattr(self, name):
            kind = type(self._task).__name__
            own = [each for each in dir(self._task) if self._is_tasks(each)]
            near = nearest(name, own) if own else ","
            expected = f"an attribute of the class {kind} ({', '.join(own) or 'it has none'})"
            raise ValueError(
                f"{name}: found no such attribute{near} expected {expected} or of its environment; "
                f"env.unwrapped.task is the {kind}"
            )

    def _make(self, renderer: Renderer, obs: str, settings: dict[str, Any]) -> None:
        super()._make(renderer, obs, settings)
        observed = [name for name, _ in self._batch.layout()]
        read = [name for name in names(self._task.reads) if name not in observed]
        if read:
            settings["observation"] = [*observed, *read]
            self._batch = self._new_batch()
        self._observed = [*observed, *self._task.observation]
        self._make_spaces()
        self._base_terms = self._batch.reward_terms()
        self._terms = list(self._task.terms)
        self._own_endings = names(self._task.endings)
        self._endings = [*ENDINGS, *self._own_endings]
        self._failures = [code for code, name in enumerate(ENDINGS, 1) if name not in RULES]
        self._weights = np.array([self._task.terms[name] for name in self._terms])
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
        added = [
            (name, [(name, box.low.tolist(), box.high.tolist(), "")]) for name, box in own.items()
        ]
        return Channels([*native[:observed], *added, *native[observed:]])

    def _begin(self, seeds: list[int | None] | None, mask: Bools | None) -> NDArray[np.float32]:
        rows = np.ones(self._count, np.bool_) if mask is None else mask
        for row, seed in enumerate(seeds or ()):
            if seed is not None:
                self._streams[row] = np.random.default_rng(seed)
                self._drawn[row] = False
        self._draw(rows)
        try:
            observation = super()._begin(seeds, mask)
        except ValueError:
            # What native cannot start with is not given again.
            self._drawn[rows] = False
            raise
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
            if name not in (known := TASKS[self._task.base]["draws"]):
                near = nearest(str(name), known)
                expected = f"what {self._task.base} draws: {', '.join(known)}"
                raise ValueError(f"draw: found {name!r}{near} expected {expected}")
        # What is left out this time is drawn by native again.
        for given in self._given.values():
            given[chosen] = np.nan
        for name, values in drawn.items():
            if name == "object" and np.asarray(values).dtype.kind in "US":
                expected = "places in the setting `objects`, counted from 0"
                raise ValueError(f"draw object: found {values!r}, expected {expected}")
            column = numbers(f"draw {name}", values, len(chosen))
            if not np.isfinite(column).all():
                raise ValueError(f"draw {name}: found {column}, expected finite numbers")
            self._given.setdefault(name, np.full(self._count, np.nan))[chosen] = column
        self._give()
        self._drawn[chosen] = True

    def _give(self) -> None:
        for name, values in self._given.items():
            self._batch.give(name, values)

    def _start(self, observation: NDArray[np.float32], rows: Bools) -> None:
        """Begin the episodes of `rows`."""
        self._begin_unpaid(rows)
        chosen = np.flatnonzero(rows)
        self._task.start(self._state(observation, chosen), chosen)
        self._drawn &= ~rows
        if self._autoreset == "SameStep":
            # Native restarts rows within a step, when it is too late to draw.
            self._draw(rows)

    def _begin_unpaid(self, rows: Bools) -> None:
        """Take `rows` for ones in which nothing was done and paid yet."""
        self._action = np.where(rows[:, None], np.float32(0.0), self._action)
        self._paid = np.where(rows[:, None], 0.0, self._paid)
        self._done = self._done & ~rows

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
        restarted = self._restarted()
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
        # What the base has ended early has failed, whatever it had reached.
        going = ~restarted & (step.ending == 0)
        step.success = self._booleans("is_success", self._task.is_success(state)) & going
        ended = self._ended_by_task(state, step, restarted)
        step.terms[restarted] = 0.0
        step.terms[np.isin(step.ending, self._failures)] = 0.0
        # Term by term: a product of matrices may round a row by how many there are.
        step.reward = sum(
            (weight * step.terms[:, k] for k, weight in enumerate(self._weights)),
            start=np.zeros(self._count),
        )
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
                if not self._own_endings:
                    expected = f"none, as `endings` lists none: endings = [{name!r}]"
                    raise ValueError(f"ending: found {name!r}, expected {expected}")
                near = nearest(str(name), self._own_endings)
                known = ", ".join(self._own_endings)
                raise ValueError(f"ending: found {name!r}{near} expected one of {known}")
            new = self._booleans(f"ending {name}", rows) & ~restarted & ~step.terminated & ~ended
            step.ending[new] = self._endings.index(name) + 1
            ended |= new
        step.terminated = step.terminated | ended
        return ended & ~step.truncated

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
            terms[:, k] = numbers(f"reward {name}", given[name], self._count)
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

    def _saved(self) -> list[bytes]:
        self._check_snapshots()
        return super()._saved()

    def _restored(self, states: list[bytes]) -> NDArray[np.float32]:
        self._check_snapshots()
        observation = super()._restored(states)
        self._begin_unpaid(np.ones(self._count, np.bool_))
        return observation

    def _check_snapshots(self) -> None:
        task = type(self._task)
        if task.observation or task.start is not Task.start or task.draw is not Task.draw:
            raise ValueError(
                f"state: {task.__name__} keeps numbers of its own, which no snapshot has"
            )
