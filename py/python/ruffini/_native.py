"""Common part of single and vector environments: a native batch and its description."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from ruffini._core import Batch, Press
from ruffini._rows import expect_row
from ruffini._schema import ENDINGS, SETTINGS, TASKS, specification
from ruffini._settings import to_json
from ruffini._spaces import NO_LIMIT, ClosedBatch, Renderer, Spaces, check_count, is_whole
from ruffini._trained_gels import warn_of


@dataclass
class StepArrays:
    """Results of a step of N environments, as arrays."""

    observation: NDArray[np.float32]
    """Observations (N, D), of rows that have already restarted those of the next episode."""
    reward: NDArray[np.float64]
    """Rewards (N,)."""
    terminated: NDArray[np.bool_]
    """Rows (N,) whose episode ended by a rule or a failure."""
    truncated: NDArray[np.bool_]
    """Rows (N,) whose episode ran out of time."""
    terms: NDArray[np.float64]
    """Terms of the reward (N, K)."""
    success: NDArray[np.bool_]
    """Rows (N,) in which the task is done."""
    ending: NDArray[np.uint8]
    """Reason of the end (N,): 0, or a place in the names of endings, counted from 1."""
    finals: list[tuple[int, NDArray[np.float32]]]
    """Rows that have already restarted, with the last observation of their episode."""
    failed: list[tuple[int, str]]
    """Rows with a failed press, with the kind of its error."""


class Channels(list[tuple[str, list[tuple[str, list[float], list[float], str]]]]):
    """Names of channels with their components: name, lower bounds, upper bounds, unit."""

    def __repr__(self) -> str:
        rows = [("channel", "component", "numbers", "from", "to", "unit")]
        for channel, components in self:
            for name, low, high, unit in components:
                ends = f"{min(low):g}", f"{max(high):g}"
                rows.append((channel, name, str(len(low)), *ends, unit))
                channel = ""
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        cells = (map(str.ljust, row, widths) for row in rows)
        return "\n".join("  ".join(line).rstrip() for line in cells)


def _change(setting: str) -> ValueError:
    expected = f"a new environment that is made with {setting}=..."
    return ValueError(f"{setting}: found a change of a setting, expected {expected}")


class Native:
    """A native batch of environments of one task, made of settings."""

    TASK: ClassVar[str]
    """Name of the task."""

    _ARGUMENTS: ClassVar[Sequence[str]]
    """Names of the arguments of the constructor that are no settings."""

    _batch: Batch
    _spaces: Spaces
    _renderer: Renderer
    _observed: list[str] | None = None
    """Channels that the agent sees, the first of the batch's; ``None``: all."""
    _terms: list[str]
    _endings: list[str]
    _count: int
    """Number of environments."""
    _threads: int
    _autoreset: str
    _started = False
    """Whether an episode was ever started."""

    def __init_subclass__(cls, *, task: str | None = None, **kwargs: Any) -> None:
        """Make a subclass the environment of a task: its specification, its parent's arguments."""
        super().__init_subclass__(**kwargs)
        if task is not None:
            cls.TASK = task
            _, *arguments = (cls.__bases__[0].__doc__ or "").partition("Args:")
            cls.__doc__ = f"{cls._about(task)}\n\n    {''.join(arguments)}"

    @classmethod
    def _about(cls, task: str) -> str:
        """Docstring of the environment of a task, without its arguments."""
        return specification(TASKS[task])

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute; refuse a setting, which is read once."""
        if name in SETTINGS:
            raise _change(name)
        super().__setattr__(name, value)

    def _check_attribute(self, name: str) -> None:
        """Raise a ``ValueError`` if setting an attribute from outside would change nothing."""
        if name in SETTINGS or (name in self._ARGUMENTS and not hasattr(self, name)):
            raise _change(name)

    def _check_started(self) -> None:
        """Raise a ``ValueError`` if no episode was ever started, so that there is no state."""
        if not self._started:
            raise ValueError("state: found an environment that was never reset; call reset() first")

    def _make(self, renderer: Renderer, obs: str, settings: dict[str, Any]) -> None:
        """Create the batch; the number of rows, threads and the autoreset mode are set before."""
        self._obs = obs
        self._settings = settings
        limit = settings.get("max_episode_steps")
        # Gymnasium's word for none.
        if is_whole(limit) and limit == -1:
            settings["max_episode_steps"] = NO_LIMIT
        elif limit is not None:
            check_count("max_episode_steps", limit, NO_LIMIT)
        self._renderer = renderer
        self._batch = self._new_batch()
        if self._batch.skin() is not None:
            warn_of(settings)
        self._make_spaces()
        self._terms = self._batch.reward_terms()
        self._endings = ENDINGS

    def _make_spaces(self) -> None:
        self._spaces = Spaces(self.channels(), self._obs, self._observed)

    def _new_batch(self) -> Batch:
        settings = to_json(self._settings, self.TASK, self._ARGUMENTS)
        return Batch(settings, self._count, self._threads, self._autoreset)

    def _begin(
        self, seeds: list[int | None] | None, mask: NDArray[np.bool_] | None
    ) -> NDArray[np.float32]:
        """Start episodes in the rows of a mask, or in all; return all observations."""
        return self._batch.reset(seeds, mask)

    def _restarted(self) -> NDArray[np.bool_]:
        """Rows that the next step restarts; a step that was interrupted has ended some, too."""
        return self._batch.ended() & (self._autoreset == "NextStep")

    def _advance(self, actions: NDArray[np.float32]) -> StepArrays:
        """Take one step in all rows."""
        return StepArrays(*self._batch.step(actions))

    def _saved(self) -> list[bytes]:
        """Snapshot of each row."""
        return self._batch.save()

    def _restored(self, states: list[bytes]) -> NDArray[np.float32]:
        """Restore all rows from snapshots; return their observations."""
        return self._batch.load(states)

    def _close(self) -> None:
        """Free the batch; whatever needs it is an error from then on."""
        self._batch = cast("Batch", ClosedBatch())

    def channels(self) -> Channels:
        """Channels in order, with name, lower bounds, upper bounds and unit of each component.

        A list that prints as a table.
        """
        return Channels(self._batch.layout())

    def plan(self, forget: bool = False) -> list[tuple[str, float, float]]:
        """Stages of a step in order, with their mean cost.

        Each has a name, its number of runs and its time (µs) in a step of one environment: means
        since the environment was created or restored, or since the last call with `forget`. Stages:
        ``scene`` (Rapier), ``press`` (contact detection, creation of presses), ``model surrogate``
        and the like (all presses of a batch in one call), ``correction`` (feedback of the solutions
        to the rigid bodies), ``peak stress`` (of GraspFragile), ``channel proprio`` and so on,
        ``reward``.
        """
        return self._batch.plan(forget)

    def skin(self) -> dict[str, NDArray[np.float64]] | None:
        """Rest positions, in the frame of a pad (m), to which the tactile channels refer.

        ``markers`` (M, 3), ``surface`` (S, 3): the nodes of ``displacement``, ``grid`` (G, 2): the
        cells of ``stress`` and ``traction``, ``depth`` (D, 2) and ``image`` (P, 2): their
        pixels; ``None`` for rigid fingers.
        """
        return self._batch.skin()

    def look(self, row: int = 0) -> dict[str, Any] | None:
        """Drawn quantities of a row's episode and poses of its bodies (SI); ``None`` before it.

        Raises:
            IndexError: If there is no such row.
        """
        return self._batch.look(expect_row(row, self._count))

    def presses(self, row: int = 0) -> list[Press | None]:
        """Press of each pad of a row as its bodies stand now, the one on -x first.

        Every model of the mechanics API solves it on the pad's body, `Fem` for one, from rest and
        with the friction that the model has: that of the episode is in `look`, as is
        ``gel_stiffness``, by which forces and stress are to be multiplied. ``None`` where nothing
        is near a pad, before a reset, and with rigid fingers.

        Raises:
            IndexError: If there is no such row.
        """
        return self._batch.presses(expect_row(row, self._count))

    def surfaces(
        self, row: int = 0
    ) -> dict[str, tuple[NDArray[np.float64], NDArray[np.uint32], NDArray[np.float64] | None]]:
        """Surfaces of a row's bodies by name; empty before a reset.

        ``object``, ``distractor_1`` and so on, and in InsertPeg ``fixture``. Each has its vertices
        (V, 3) in m, those of objects in their own frames (see `look`), corners of its triangles
        (F, 3), and if it is soft the von Mises stress (V,) in Pa at the vertices, which are those
        of the deformed object.

        Raises:
            IndexError: If there is no such row.
        """
        return self._batch.surfaces(expect_row(row, self._count))

    def __getstate__(self) -> dict[str, Any]:
        """Arguments and snapshots; a copy continues from the present state."""
        mine = {k: v for k, v in self.__dict__.items() if k not in ("_batch", "_spaces")}
        return mine | {"_snapshot": self._batch.save()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        snapshot = state.pop("_snapshot")
        self.__dict__.update(state)
        self._batch = self._new_batch()
        self._batch.load(snapshot)
        self._make_spaces()
