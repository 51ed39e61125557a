"""Single environment on top of the native batch."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from typing_extensions import Unpack

from ruffini._native import Native
from ruffini._settings import Settings
from ruffini._spaces import (
    ACTION_SIZE,
    NO_LIMIT,
    RENDER_MODES,
    Camera,
    Observation,
    Renderer,
    RenderFrame,
    as_actions,
    check_open,
    check_options,
    check_seed,
    metadata,
    warn_of_unseen_window,
)


class NativeEnv(Native, gym.Env[Observation, NDArray[np.float32]]):
    """One environment on top of the native batch; a subclass sets its task.

    Args:
        render_mode: ``None`` or ``"rgb_array"``; ``gymnasium.make`` takes ``"human"``, too, which
            shows a window (``pip install "ruffini[human]"``).
        obs: ``"dict"`` or ``"flat"``.
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        camera: ``"corner"``, ``"front"`` or ``"side"``, which rise with a lifted object;
            ``"wrist"`` or ``"palm"``, which move with the hand; or a mapping: ``position`` and
            ``target`` (m, world frame), ``field_of_view`` (rad, vertical; 0.6 if not given).
        **settings: As the specification lists them.

    Raises:
        TypeError: If a setting is unknown.
        ValueError: If one is of the wrong type or out of range.
    """

    # Without pygame "human" gets to the constructor, whose error says what to install.
    metadata = metadata({}) | (
        {} if find_spec("pygame") else {"render_modes": [*RENDER_MODES, "human"]}
    )
    _ARGUMENTS = ("render_mode", "obs", "width", "height", "camera")

    def __init__(
        self,
        render_mode: str | None = None,
        obs: str = "dict",
        width: int = 640,
        height: int = 480,
        camera: Camera = "corner",
        **settings: Unpack[Settings],
    ) -> None:
        self._count = self._threads = 1
        self._autoreset = AutoresetMode.DISABLED.value
        self._make(Renderer(render_mode, width, height, camera), obs, dict(settings))
        self.render_mode = render_mode
        self.metadata = metadata(settings)
        self.observation_space: gym.spaces.Space[Any] = self._spaces.observation
        self.action_space = self._spaces.action

    def set_wrapper_attr(self, name: str, value: Any, *, force: bool = True) -> bool:
        """Set an attribute, also for wrappers; refuse a setting, which is read once.

        Raises:
            ValueError: If it is a setting: another value takes a new environment.
        """
        self._check_attribute(name)
        return bool(super().set_wrapper_attr(name, value, force=force))

    def _leave_time_limit(self) -> None:
        """Leave the time limit to the wrapper of ``gymnasium.make``, the only place that has it."""
        name = "max_episode_steps"
        if self.spec is None or name in self.spec.kwargs or self._settings.get(name) == NO_LIMIT:
            return
        registered = gym.registry.get(self.spec.id)
        if registered is not None and registered.max_episode_steps is None:
            return  # No wrapper limits it, so the task's own limit holds.
        self._settings[name] = NO_LIMIT
        self._batch = self._new_batch()
        self._started = False

    def close(self) -> None:
        """End the use of the environment and free its memory; all else is an error from then on."""
        super().close()
        self._close()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; a seed restarts the random stream."""
        check_open(self._batch, "reset")
        check_options(options)
        if seed is not None:
            check_seed(seed)
        super().reset(seed=None if seed is None else int(seed))
        self._leave_time_limit()
        seeds: list[int | None] | None = None
        if seed is not None or not self._started:
            seeds = [int(self.np_random.integers(2**63) if seed is None else seed)]
        observation = self._begin(seeds, None)
        self._started = True
        return self._spaces.cut(observation[0]), {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Take one control step, of 40 ms by default."""
        check_open(self._batch, "step")
        actions = as_actions(action, (ACTION_SIZE,))[None]
        step = self._advance(actions)
        info: dict[str, Any] = {
            "reward_terms": dict(zip(self._terms, step.terms[0].tolist(), strict=True)),
            "is_success": bool(step.success[0]),
        }
        if step.ending[0]:
            info["ending"] = self._endings[step.ending[0] - 1]
        for _, kind in step.failed:
            info["press_error"] = kind
        return (
            self._spaces.cut(step.observation[0]),
            float(step.reward[0]),
            bool(step.terminated[0]),
            bool(step.truncated[0]),
            info,
        )

    def render(self, camera: Camera | None = None) -> RenderFrame | None:
        """Picture (height, width, 3) of the scene, or ``None`` without a render mode.

        Args:
            camera: Another camera than the environment's.

        Raises:
            ValueError: If there is no such camera.
        """
        check_open(self._batch, "render")
        self._renderer.view(camera)
        if self.render_mode is None:
            return None
        warn_of_unseen_window()
        return self._renderer.draw(self._batch, 0, camera)

    def state(self) -> bytes:
        """Snapshot as bytes of everything on which the environment's future depends.

        Raises:
            ValueError: If it was never reset.
        """
        self._check_started()
        return self._saved()[0]

    def set_state(self, state: bytes) -> Observation:
        """Restore a snapshot made by :meth:`state`; return the observation.

        Raises:
            ValueError: If the bytes are damaged or come from an environment with other settings.
        """
        if not isinstance(state, bytes):
            raise ValueError(f"state: found {type(state).__name__}, expected bytes")
        check_open(self._batch, "set_state")
        self._leave_time_limit()
        observation = self._restored([state])[0]
        self._started = True
        return self._spaces.cut(observation)
