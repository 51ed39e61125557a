"""What a single and a vector environment have in common: a native batch and its description."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ruffini._core import Batch
from ruffini._schema import TASKS, docstring
from ruffini._settings import to_json
from ruffini._spaces import Renderer, Spaces


class Native:
    """A native batch of environments of one task, made of settings."""

    TASK: ClassVar[str]
    """Name of the task."""

    _batch: Batch
    _spaces: Spaces
    _renderer: Renderer
    _terms: list[str]
    _rows: int
    _threads: int
    _autoreset: str

    def __init_subclass__(cls, *, task: str | None = None, **kwargs: Any) -> None:
        """Make a subclass the environment of a task, with the task's docstring."""
        super().__init_subclass__(**kwargs)
        if task is not None:
            cls.TASK = task
            cls.__doc__ = cls._docstring(task)

    @staticmethod
    def _docstring(task: str) -> str:
        return docstring(TASKS[task])

    def _make(
        self, render_mode: str | None, obs: str, width: int, height: int, settings: dict[str, Any]
    ) -> None:
        """Create the batch; the number of rows, threads and the autoreset mode are set before."""
        self._obs = obs
        self._settings = settings
        self._renderer = Renderer(render_mode, width, height)
        self._batch = self._new_batch()
        self._spaces = Spaces(self._batch, obs)
        self._terms = self._batch.reward_terms()

    def _new_batch(self) -> Batch:
        settings = to_json(self._settings, self.TASK)
        return Batch(settings, self._rows, self._threads, self._autoreset)

    def channels(self) -> list[tuple[str, list[tuple[str, list[float], list[float], str]]]]:
        """Channels in order, with name, lower bounds, upper bounds and unit of each component."""
        return self._batch.layout()

    def plan(self, forget: bool = False) -> list[tuple[str, float, float]]:
        """Stages of a step in order, with their mean cost.

        Each has a name, its number of runs and its time (µs) in a step of one environment: means
        since the environment was created or restored, or since the last call with `forget`. Stages:
        ``scene`` (Rapier), ``press`` (contact detection, creation of presses), ``model`` (all
        presses of a batch in one call), ``correction`` (feedback of the solutions to the rigid
        bodies), ``peak stress`` (of GraspFragile), each channel, ``reward``.
        """
        return self._batch.plan(forget)

    def skin(self) -> dict[str, NDArray[np.float64]] | None:
        """Rest positions, in the frame of a pad (m), to which the tactile channels refer.

        ``markers`` (M, 3), ``surface`` (S, 3): the nodes of ``displacement``, ``grid`` (G, 2): the
        cells of ``stress`` and ``traction``, ``depth`` (D, 2): its pixels; ``None`` for rigid
        fingers.
        """
        return self._batch.skin()

    def look(self, row: int = 0) -> dict[str, Any] | None:
        """Drawn quantities of a row's episode and poses of its bodies (SI); ``None`` before it."""
        return self._batch.look(row)

    def __getstate__(self) -> dict[str, Any]:
        """Arguments and snapshots; a copy continues from the present state."""
        mine = {k: v for k, v in self.__dict__.items() if k not in ("_batch", "_spaces")}
        return mine | {"_snapshot": self._batch.save()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        snapshot = state.pop("_snapshot")
        self.__dict__.update(state)
        self._batch = self._new_batch()
        self._batch.load(snapshot)
        self._spaces = Spaces(self._batch, self._obs)
