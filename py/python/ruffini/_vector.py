"""Vector environment on top of the native batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from typing_extensions import Unpack

from ruffini import _rows
from ruffini._native import Native
from ruffini._schema import TASKS
from ruffini._settings import Settings
from ruffini._spaces import (
    ACTION_SIZE,
    MOST_THREADS,
    NO_LIMIT,
    Camera,
    Renderer,
    RenderFrame,
    as_actions,
    check_count,
    check_open,
    check_options,
    check_seed,
    metadata,
)
from ruffini._words import nearest
from ruffini.evaluation import usable_cores


class NativeVectorEnv(Native, VectorEnv[Any, Any, Any]):
    """Many environments of one task stepped together by one native call; a subclass sets the task.

    Row i of a batch seeded with s equals the single environment seeded with s + i, bit for bit.

    Args:
        num_envs: Number of environments.
        num_threads: Number of threads; ``None`` takes one per core, at most one per environment.
        autoreset_mode: When a row whose episode has ended starts the next one: ``"NextStep"``,
            ``"SameStep"``, or ``"Disabled"`` if the caller resets it by ``reset_mask``. TorchRL's
            ``GymWrapper`` works with ``"Disabled"`` only: with ``"SameStep"`` it cannot read infos
            that are dicts, such as the reward's terms, and loses the last observation of an
            episode if that is a dict.
        render_mode: ``None`` or ``"rgb_array"``.
        obs: ``"dict"`` or ``"flat"``.
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        camera: ``"corner"``, ``"front"`` or ``"side"``, which rise with a lifted object;
            ``"wrist"`` or ``"palm"``, which move with the hand; or a mapping: ``position`` and
            ``target`` (m, world frame), ``field_of_view`` (rad, vertical; 0.6 if not given).
        **settings: As for the single environment.

    Raises:
        TypeError: If a setting is unknown.
        ValueError: If one is of the wrong type or out of range.
    """

    metadata = metadata({})
    _ARGUMENTS = (
        *("num_envs", "num_threads", "autoreset_mode"),
        *("render_mode", "obs", "width", "height", "camera"),
    )

    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """Specification given by ``gymnasium.make_vec``, with the time limit of its rows."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            limit = self._settings.get("max_episode_steps") or TASKS[self.TASK]["max_episode_steps"]
            spec.max_episode_steps = None if limit == NO_LIMIT else limit
        self._spec = spec

    @classmethod
    def _about(cls, task: str) -> str:
        return (
            f"Many :class:`{task}Env` stepped together by one native call.\n\n    Row i of a batch "
            "seeded with s equals the single environment seeded with s + i, bit for bit."
        )

    def __init__(
        self,
        num_envs: int = 1,
        num_threads: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        obs: str = "dict",
        width: int = 640,
        height: int = 480,
        camera: Camera = "corner",
        **settings: Unpack[Settings],
    ) -> None:
        try:
            mode = AutoresetMode(autoreset_mode)
        except ValueError:
            known = ", ".join(m.value for m in AutoresetMode)
            near = nearest(str(autoreset_mode), (m.value for m in AutoresetMode))
            raise ValueError(
                f"autoreset_mode: found {autoreset_mode!r}{near} expected one of {known}"
            ) from None
        check_count("num_envs", num_envs)
        if num_threads is not None:
            check_count("num_threads", num_threads, MOST_THREADS)
        self.num_envs = num_envs
        self.autoreset_mode = mode
        self._count, self._autoreset = num_envs, mode.value
        self._threads = num_threads or min(usable_cores(), num_envs)
        self._make(Renderer(render_mode, width, height, camera), obs, dict(settings))
        self.render_mode = render_mode
        self.metadata = metadata(settings) | {"autoreset_mode": mode}
        self.single_observation_space = self._spaces.observation
        self.single_action_space = self._spaces.action
        self.observation_space = batch_space(self._spaces.observation, num_envs)
        self.action_space = batch_space(self._spaces.action, num_envs)
        self._started = False

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode in every row, or in those of ``options["reset_mask"]``.

        A seed s gives row i the seed s + i; a sequence gives each row its own, and ``None`` in it
        leaves that row's random stream as it is. Rows that the mask excludes are not changed, even
        if a seed is given for them.
        """
        check_open(self._batch, "reset")
        check_options(options, ["reset_mask"])
        seeds = self._seeds(seed)
        mask = None if options is None else self._mask(options.get("reset_mask"))
        if isinstance(seed, (int, np.integer)):
            super().reset(seed=int(seed))
        if seeds is not None and mask is not None:
            seeds = [s if chosen else None for s, chosen in zip(seeds, mask, strict=True)]
        observation = self._begin(seeds, mask)
        self._started = True
        return self._spaces.cut(observation), {}

    def _seeds(self, seed: Any) -> list[int | None] | None:
        given: list[int | None] = [None] * self.num_envs
        if isinstance(seed, (Sequence, np.ndarray)) and not isinstance(seed, (str, bytes)):
            given = list(seed)
            if len(given) != self.num_envs:
                raise ValueError(f"seed: found {len(given)} seeds, expected {self.num_envs}")
            for one in given:
                if one is not None:
                    check_seed(one)
        elif seed is not None:
            check_seed(seed)
            given = [int(seed) + row for row in range(self.num_envs)]
        if not self._started:
            fresh = self.np_random.integers(2**63, size=self.num_envs)
            given = [f if s is None else s for s, f in zip(given, fresh, strict=True)]
        return [None if s is None else int(s) for s in given]

    def _mask(self, mask: Any) -> NDArray[np.bool_] | None:
        if mask is None:
            return None
        shape = (self.num_envs,)
        sound = isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == shape
        if not sound or not mask.any():
            expected = f"a bool array of shape {shape} with at least one True"
            raise ValueError(f"options['reset_mask']: found {mask!r}, expected {expected}")
        return np.ascontiguousarray(mask)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Take one control step, of 40 ms by default, in every row.

        With ``NextStep``, a row whose episode ended in the previous step starts the next episode
        instead: it has a reward of 0 and no info.
        """
        check_open(self._batch, "step")
        actions = as_actions(actions, (self.num_envs, ACTION_SIZE))
        restarted = self._restarted()
        step = self._advance(actions)
        terminated, truncated = step.terminated, step.truncated
        info = self._info(step.terms, step.success, step.ending)
        if step.failed:
            info |= self._press_errors(step.failed)
        if step.finals:
            info = self._with_finals(info, step.finals)
        if restarted.any():
            info = _masked(info, ~restarted)
        return self._spaces.cut(step.observation), step.reward, terminated, truncated, info

    def _info(
        self, terms: NDArray[Any], success: NDArray[np.bool_], ending: NDArray[np.uint8]
    ) -> dict[str, Any]:
        def everywhere() -> NDArray[np.bool_]:
            return np.ones(self.num_envs, np.bool_)

        named: dict[str, Any] = {}
        for name, column in zip(self._terms, terms.T.copy(), strict=True):
            named[name], named[f"_{name}"] = column, everywhere()
        info: dict[str, Any] = {
            "reward_terms": named,
            "_reward_terms": everywhere(),
            "is_success": success,
            "_is_success": everywhere(),
        }
        if ending.any():
            names = np.full(self.num_envs, None, dtype=object)
            for row in np.flatnonzero(ending):
                names[row] = self._endings[ending[row] - 1]
            info["ending"], info["_ending"] = names, ending != 0
        return info

    def _press_errors(self, failed: list[tuple[int, str]]) -> dict[str, Any]:
        kinds = np.full(self.num_envs, None, dtype=object)
        for row, kind in failed:
            kinds[row] = kind
        return {
            "press_error": kinds,
            "_press_error": np.array([kind is not None for kind in kinds]),
        }

    def _with_finals(
        self, info: dict[str, Any], finals: list[tuple[int, NDArray[np.float32]]]
    ) -> dict[str, Any]:
        """Move the last observations and infos of reset rows to ``final_obs``/``final_info``."""
        rows = np.array([row for row, _ in finals])
        done = np.zeros(self.num_envs, np.bool_)
        done[rows] = True
        last = np.full(self.num_envs, None, dtype=object)
        for row, observation in finals:
            last[row] = self._spaces.cut(observation)
        final_info = _masked(info, done)
        kept = _masked(info, ~done)
        return kept | {
            "final_obs": last,
            "_final_obs": done,
            "final_info": final_info,
            "_final_info": done.copy(),
        }

    def close_extras(self, **kwargs: Any) -> None:
        """Free the memory of the environments."""
        self._close()

    def render(self, camera: Camera | None = None) -> tuple[RenderFrame, ...] | None:
        """One picture (height, width, 3) per row, or ``None`` without a render mode."""
        check_open(self._batch, "render")
        self._renderer.view(camera)
        if self.render_mode is None:
            return None
        rows = range(self.num_envs)
        return tuple(self._renderer.draw(self._batch, row, camera) for row in rows)

    def picture(self, row: int, camera: Camera | None = None) -> RenderFrame | None:
        """Picture (height, width, 3) of one row, or ``None`` without a render mode.

        Raises:
            IndexError: If there is no such row.
            ValueError: If there is no such camera.
        """
        row = _rows.expect_row(row, self.num_envs)
        check_open(self._batch, "picture")
        self._renderer.view(camera)
        return None if self.render_mode is None else self._renderer.draw(self._batch, row, camera)

    def state(self) -> list[bytes]:
        """Snapshot of each row as bytes of everything on which its future depends.

        Raises:
            ValueError: If the environments were never reset.
        """
        self._check_started()
        return self._saved()

    def set_state(self, states: Sequence[bytes]) -> Any:
        """Restore every row from a snapshot made by :meth:`state`; return the observations.

        Raises:
            ValueError: If the bytes are damaged or come from an environment with other settings.
        """
        if not isinstance(states, (list, tuple)):
            raise ValueError(f"state: found {type(states).__name__}, expected a list of bytes")
        for row, state in enumerate(states):
            if not isinstance(state, bytes):
                raise ValueError(f"state[{row}]: found {type(state).__name__}, expected bytes")
        observation = self._restored(list(states))
        self._started = True
        return self._spaces.cut(observation)

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Value of attribute `name`, or result of method `name`, for each row.

        ``look``, ``surfaces``, ``presses``, ``state``, ``render``, ``reset``, ``channels`` and
        ``skin`` are called for each row, ``set_state`` takes one state for all rows or a list with
        one for each, ``step`` raises an error, and any other method is called once for the batch.
        """
        if callable(getattr(self, name)):
            return tuple(_rows.call(self, range(self.num_envs), name, *args, **kwargs))
        return self.get_attr(name)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Value of an attribute for each row; of a method, a function that calls it for the row."""
        return tuple(_rows.attribute(self, range(self.num_envs), name))

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute, which all rows share.

        Raises:
            ValueError: If `values` is a list or tuple of other than one equal value for each row,
                it is a setting: another value takes a new environment, or a task of one's own has
                no such attribute.
        """
        if isinstance(values, (list, tuple)):
            first = values[:1]
            if len(values) != self.num_envs or not all(_same(each, *first) for each in values):
                raise ValueError(
                    f"{name}: found {values!r}, expected one value, which all rows share"
                )
            values = values[0]
        _rows.set_attribute(self, range(self.num_envs), name, values)


def _same(value: Any, other: Any) -> bool:
    """Return whether two values, arrays among them, are equal."""
    return value is other or bool(np.array_equal(value, other))


def _masked(info: Mapping[str, Any], rows: NDArray[np.bool_]) -> dict[str, Any]:
    """Entries of a vector info that belong to `rows`, without keys that none of them has."""
    kept: dict[str, Any] = {}
    for key, value in info.items():
        if key.startswith("_"):
            continue
        mask = info[f"_{key}"] & rows
        if not mask.any():
            continue
        if isinstance(value, dict):
            kept[key] = _masked(value, rows)
        else:
            blank = None if value.dtype == object else value.dtype.type(0)
            kept[key] = np.where(mask, value, blank)
        kept[f"_{key}"] = mask
    return kept
