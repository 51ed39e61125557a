"""Single environment on top of the native batch."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from typing_extensions import Unpack

from ruffini._core import ENDINGS, Batch
from ruffini._settings import Settings, to_json
from ruffini._spaces import (
    ACTION_SIZE,
    METADATA,
    NO_LIMIT,
    Frame,
    Observation,
    Renderer,
    Spaces,
    as_actions,
    check_options,
    check_seed,
)


class NativeEnv(gym.Env[Observation, NDArray[np.float32]]):
    """One environment on top of the native batch; a subclass sets its task.

    Args:
        render_mode: ``None`` or ``"rgb_array"``.
        obs: ``"dict"`` or ``"flat"``.
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        **settings: As the subclass documents them.

    Raises:
        TypeError: If a setting is unknown.
        ValueError: If one is of the wrong type or out of range.
    """

    TASK: ClassVar[str]
    """Name of the task in the settings."""

    metadata = METADATA

    def __init__(
        self,
        render_mode: str | None = None,
        obs: str = "dict",
        width: int = 640,
        height: int = 480,
        **settings: Unpack[Settings],
    ) -> None:
        self._obs = obs
        self._settings: dict[str, Any] = dict(settings)
        self._renderer = Renderer(render_mode, width, height)
        self.render_mode = render_mode
        self._batch = self._new_batch()
        self._spaces = Spaces(self._batch, obs)
        self._terms = self._batch.reward_terms()
        self.observation_space: gym.spaces.Space[Any] = self._spaces.observation
        self.action_space = self._spaces.action

    def _new_batch(self) -> Batch:
        return Batch(to_json(self._settings, self.TASK), 1, 1, AutoresetMode.DISABLED.value)

    def _leave_time_limit(self) -> None:
        """Leave the time limit to the wrapper of ``gymnasium.make``, the only place that has it."""
        if self.spec is not None and "max_episode_steps" not in self._settings:
            self._settings["max_episode_steps"] = NO_LIMIT
            self._batch = self._new_batch()
            self._started = False

    _started = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; a seed restarts the random stream."""
        check_options(options)
        if seed is not None:
            check_seed(seed)
        super().reset(seed=None if seed is None else int(seed))
        self._leave_time_limit()
        seeds: list[int | None] | None = None
        if seed is not None or not self._started:
            seeds = [int(self.np_random.integers(2**63) if seed is None else seed)]
        observation = self._batch.reset(seeds, None)
        self._started = True
        return self._spaces.cut(observation[0]), {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Take one control step of 40 ms."""
        actions = as_actions(action, (ACTION_SIZE,))[None]
        observation, reward, terminated, truncated, terms, success, ending, _, failed = (
            self._batch.step(actions)
        )
        info: dict[str, Any] = {
            "reward_terms": dict(zip(self._terms, terms[0].tolist(), strict=True)),
            "is_success": bool(success[0]),
        }
        if ending[0]:
            info["ending"] = ENDINGS[ending[0] - 1]
        for _, kind in failed:
            info["press_error"] = kind
        return (
            self._spaces.cut(observation[0]),
            float(reward[0]),
            bool(terminated[0]),
            bool(truncated[0]),
            info,
        )

    def render(self) -> Frame | None:
        """Picture (height, width, 3) of the scene, or ``None`` without a render mode."""
        if self.render_mode is None:
            return None
        return self._renderer.draw(self._batch, 0)

    def state(self) -> bytes:
        """Snapshot as bytes of everything on which the environment's future depends."""
        return self._batch.save()[0]

    def set_state(self, state: bytes) -> Observation:
        """Restore a snapshot made by :meth:`state`; return the observation.

        Raises:
            ValueError: If the bytes are damaged or come from an environment with other settings.
        """
        if not isinstance(state, bytes):
            raise ValueError(f"state: found {type(state).__name__}, expected bytes")
        self._leave_time_limit()
        self._started = True
        return self._spaces.cut(self._batch.load([state])[0])

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

    def look(self) -> dict[str, Any] | None:
        """Drawn quantities and poses of the bodies (SI), or ``None`` before a reset."""
        return self._batch.look(0)

    def __getstate__(self) -> dict[str, Any]:
        """Arguments and snapshot; a copy continues from the present state."""
        mine = {k: v for k, v in self.__dict__.items() if k not in ("_batch", "_spaces")}
        return mine | {"_snapshot": self._batch.save()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        snapshot = state.pop("_snapshot")
        self.__dict__.update(state)
        self._batch = self._new_batch()
        self._batch.load(snapshot)
        self._spaces = Spaces(self._batch, self._obs)
