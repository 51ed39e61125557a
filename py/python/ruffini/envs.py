"""The environments, single and vectorised, over one native batch."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from typing_extensions import Unpack

from ruffini._core import ENDINGS, REWARD_TERMS, Batch
from ruffini._settings import Settings, to_json

Observation = NDArray[np.float32] | dict[str, NDArray[np.float32]]
"""A flat vector, or one vector a channel."""

Frame = NDArray[np.uint8]
"""A picture (height, width, 3)."""

ACTION_SIZE = 5
MOST_ENVIRONMENTS = 1_000_000
_NO_LIMIT = 1_000_000

_METADATA: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 25}


class _Spaces:
    """Spaces of one environment, and observations cut out of the batch's matrix."""

    def __init__(self, batch: Batch, obs: str) -> None:
        if obs not in ("dict", "flat"):
            raise ValueError(f"obs: found {obs!r}, expected 'dict' or 'flat'")
        self.action = Box(-1.0, 1.0, (ACTION_SIZE,), np.float32)
        boxes: dict[str, Box] = {}
        self._slices: dict[str, slice] = {}
        start = 0
        for channel, components in batch.layout():
            low = np.concatenate([np.array(c[1], np.float32) for c in components])
            high = np.concatenate([np.array(c[2], np.float32) for c in components])
            boxes[channel] = Box(low, high, dtype=np.float32)
            self._slices[channel] = slice(start, start + len(low))
            start += len(low)
        self._flat = obs == "flat"
        self.observation: Box | Dict
        if self._flat:
            low = np.concatenate([box.low for box in boxes.values()])
            high = np.concatenate([box.high for box in boxes.values()])
            self.observation = Box(low, high, dtype=np.float32)
        else:
            self.observation = Dict(boxes)  # type: ignore[arg-type]

    def cut(self, values: NDArray[np.float32]) -> Observation:
        """The observation in `values`, whose last axis is all channels in a row."""
        if self._flat:
            return values
        return {name: values[..., part].copy() for name, part in self._slices.items()}


class _Renderer:
    """Size of a picture, checked once."""

    def __init__(self, mode: str | None, width: int, height: int) -> None:
        if mode is not None and mode not in _METADATA["render_modes"]:
            raise ValueError(f"render_mode: found {mode!r}, expected None or 'rgb_array'")
        for name, pixels in (("width", width), ("height", height)):
            if not (isinstance(pixels, int) and 16 <= pixels <= 4096):
                raise ValueError(f"{name}: found {pixels!r}, expected 16 to 4096 pixels")
        self.mode, self.width, self.height = mode, width, height

    def draw(self, batch: Batch, row: int) -> Frame:
        return batch.render(row, self.width, self.height)


def _check_count(name: str, count: Any) -> None:
    """A ``ValueError`` unless `count` is a whole number of environments or threads."""
    whole = isinstance(count, (int, np.integer)) and not isinstance(count, bool)
    if not (whole and 1 <= count <= MOST_ENVIRONMENTS):
        expected = f"a whole number from 1 to {MOST_ENVIRONMENTS}"
        raise ValueError(f"{name}: found {count!r}, expected {expected}")


def _check_seed(seed: Any) -> None:
    """A ``ValueError`` unless `seed` is a whole number that leaves room for a seed a row."""
    whole = isinstance(seed, (int, np.integer)) and not isinstance(seed, bool)
    if not (whole and 0 <= seed < 2**63):
        raise ValueError(f"seed: found {seed!r}, expected a whole number from 0 below 2**63")


def _check_options(options: Any) -> None:
    """A ``ValueError`` unless `options` is a mapping or ``None``."""
    if options is not None and not isinstance(options, Mapping):
        raise ValueError(f"options: found {options!r}, expected a mapping or None")


def _as_actions(actions: Any, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """`actions` as floats of that shape, or a ``ValueError`` that says what they were."""
    try:
        given = np.asarray(actions)
        if given.dtype.kind not in "fiub":
            raise TypeError(f"of type {given.dtype}")
        array = given.astype(np.float32)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"actions: found {actions!r}, expected numbers ({error})") from None
    if array.shape != shape:
        raise ValueError(f"actions: found shape {array.shape}, expected {shape}")
    return array


class GraspLiftEnv(gym.Env[Observation, NDArray[np.float32]]):
    """Grasp an object of unknown shape, mass and friction with two fingers, and lift it.

    A parallel-jaw gripper hangs over a table on which one object rests. The agent moves the wrist
    and commands the grip force, 25 times a second.

    ## Action
    ``Box(-1, 1, (5,), float32)``: velocity of the tool centre along x, y, z (times 0.25 m/s), yaw
    rate (times 2 rad/s), grip force of each finger (times 40 N; positive closes, negative opens).
    Components outside [-1, 1] count as the nearer bound; one that is not finite is a
    ``ValueError``.

    ## Observation
    One-level ``Dict`` of the chosen channels, or with ``obs="flat"`` their concatenation in the
    order chosen. ``env.unwrapped.channels()`` is the table of components, bounds and units.

    | channel | size | content |
    | --- | --- | --- |
    | ``proprio`` | 14 | tool centre, yaw, their rates, opening and rate, grip command, pad forces |
    | ``object`` | 16 | pose and velocity of the object in the wrist's frame, rise |
    | ``wrench`` | 12 | force and torque on each pad in the pad's frame |
    | ``properties`` | 5 | mass, friction, half of the bounding box |
    | ``time`` | 1 | time since the start of the episode (s) |

    With a `tactile` model there are also these, of the pad on −x and then of the one on +x, in the
    pad's frame (x across, y along the finger, z out of the gel), flat; `resolution` sets the sizes.
    Without contact each is exactly 0, but for ``depth``. ``wrench`` is then what the model says.

    | channel | size of each pad | content |
    | --- | --- | --- |
    | ``markers`` | 7 x 5 x 3 | displacement of the sensor's markers (m) |
    | ``displacement`` | S x 3 | displacement of all free nodes of the pad's surface (m) |
    | ``stress`` | 12 x 10 | von Mises stress under the face (Pa) |
    | ``tet_stress`` | T | von Mises stress in each tetrahedron (Pa) |
    | ``traction`` | 12 x 10 x 3 | contact force per area (Pa): shear in x and y, normal in z |
    | ``depth`` | 32 x 24 | height of the face over the camera's view (m) |
    | ``trust`` | 3 | unbalanced force (N), its share, 1 if deeper than gels are calibrated |

    ## Reward
    Weighted mean of five terms in [0, 1], each in ``info["reward_terms"]``: ``reach``, ``grasp``,
    ``lift``, ``hold``, ``effort``.

    ## Start
    Object, size, mass, friction, position, yaw and the tool centre are drawn from their ranges by
    the environment's seed.

    ## End
    Truncated after ``max_episode_steps`` steps, 100 by default (``gymnasium.make`` leaves that to
    its wrapper, which does not know of :meth:`set_state`); a lift does not end the episode.
    Terminated, with the reason in ``info["ending"]``, when the object leaves the table
    (``object_lost``), a body's state becomes infinite (``non_finite``) or leaves the declared
    bounds (``out_of_range``), the engine fails (``engine_error``), or the tactile model has no
    answer (``press_failed``, with the kind of the error in ``info["press_error"]``); the last
    observation is then the last valid one.
    ``info["is_success"]`` says whether the object is up and has been for ``hold_time``.

    Args:
        render_mode: ``None`` or ``"rgb_array"``.
        obs: ``"dict"`` or ``"flat"``.
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        **settings: Any of: ``objects`` (names, mesh files, ``{"mesh": path, "scale": metres}``, or
            ``{"shape": "sphere", "radius": 0.02}`` and the like), ``mass`` (kg), ``friction``,
            ``size`` (factor), ``position`` and ``start`` (m, for x and y), ``yaw`` (rad),
            ``start_height`` (m), each a range or a number; ``lift_height`` (m), ``hold_time`` (s),
            ``max_episode_steps``, ``observation`` (channels), ``reward_weights``, and mappings for
            ``gripper``, ``workspace`` and ``physics``. Of touch: ``tactile`` (``"none"``,
            ``"surrogate"``: a network,
            ``"compliance"``: linear elasticity, or ``"fem"``: finite elements), ``sensor``
            (``"gelsight-mini"``, ``"digit"`` or a .toml file), ``material`` (name of a calibration
            of the sensor, or ``{"young": Pa, "poisson": ratio}``), ``resolution``
            (``{"nodes": 1000, "markers": (5, 7), "grid": (10, 12), "depth": (24, 32)}``, the pairs
            across and along).

    Raises:
        ValueError: If a setting is unknown, of the wrong type or out of range.
    """

    metadata = _METADATA

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
        self._renderer = _Renderer(render_mode, width, height)
        self.render_mode = render_mode
        self._batch = self._new_batch()
        self._spaces = _Spaces(self._batch, obs)
        self.observation_space: gym.spaces.Space[Any] = self._spaces.observation
        self.action_space = self._spaces.action

    def _new_batch(self) -> Batch:
        return Batch(to_json(self._settings), 1, 1, AutoresetMode.DISABLED.value)

    def _leave_time_limit(self) -> None:
        """Leaves the limit to the wrapper of ``gymnasium.make``, which alone knows it."""
        if self.spec is not None and "max_episode_steps" not in self._settings:
            self._settings["max_episode_steps"] = _NO_LIMIT
            self._batch = self._new_batch()
            self._started = False

    _started = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Starts an episode; a seed restarts the random stream."""
        _check_options(options)
        if seed is not None:
            _check_seed(seed)
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
        """Takes one control step of 40 ms."""
        actions = _as_actions(action, (ACTION_SIZE,))[None]
        observation, reward, terminated, truncated, terms, success, ending, _, failed = (
            self._batch.step(actions)
        )
        info: dict[str, Any] = {
            "reward_terms": dict(zip(REWARD_TERMS, terms[0].tolist(), strict=True)),
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
        """A picture (height, width, 3) of the scene, or ``None`` without a render mode."""
        if self.render_mode is None:
            return None
        return self._renderer.draw(self._batch, 0)

    def state(self) -> bytes:
        """The environment as bytes: everything that its future depends on."""
        return self._batch.save()[0]

    def set_state(self, state: bytes) -> Observation:
        """Puts the environment back to a :meth:`state`; its observation then.

        Raises:
            ValueError: If the bytes are damaged or come from an environment with other settings.
        """
        if not isinstance(state, bytes):
            raise ValueError(f"state: found {type(state).__name__}, expected bytes")
        self._leave_time_limit()
        self._started = True
        return self._spaces.cut(self._batch.load([state])[0])

    def channels(self) -> list[tuple[str, list[tuple[str, list[float], list[float], str]]]]:
        """Channels in order, with each component's name, lower bounds, upper bounds and unit."""
        return self._batch.layout()

    def plan(self, forget: bool = False) -> list[tuple[str, float, float]]:
        """The stages that a step runs, in order, with what they cost.

        Each has its name, how often it runs in a step of one environment, and its time in such a
        step (µs): means since the environment was made or put back to a state, or since the last
        call with `forget`. Stages: ``scene`` (Rapier), ``press`` (contact found, presses made),
        ``model`` (all presses of a batch in one call), each channel, ``reward``.
        """
        return self._batch.plan(forget)

    def skin(self) -> dict[str, NDArray[np.float64]] | None:
        """Places at rest in the frame of a pad (m) that the tactile channels refer to.

        ``markers`` (M, 3), ``surface`` (S, 3) the nodes of ``displacement``, ``grid`` (G, 2) the
        cells of ``stress`` and ``traction``, ``depth`` (D, 2) its pixels; ``None`` for rigid
        fingers.
        """
        return self._batch.skin()

    def look(self) -> dict[str, Any] | None:
        """What the episode drew and where the bodies are (SI), or ``None`` before a reset."""
        return self._batch.look(0)

    def __getstate__(self) -> dict[str, Any]:
        """Arguments and snapshot; a copy goes on where this one stands."""
        mine = {k: v for k, v in self.__dict__.items() if k not in ("_batch", "_spaces")}
        return mine | {"_snapshot": self._batch.save()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        snapshot = state.pop("_snapshot")
        self.__dict__.update(state)
        self._batch = self._new_batch()
        self._batch.load(snapshot)
        self._spaces = _Spaces(self._batch, self._obs)


class GraspLiftVectorEnv(VectorEnv[Any, Any, Any]):
    """Many :class:`GraspLiftEnv` stepped together by one native call.

    Row i of a batch seeded with s equals the single environment seeded with s + i, bit for bit.

    Args:
        num_envs: Number of environments.
        num_threads: Threads to step them on; ``None`` takes one a core, at most one an environment.
        autoreset_mode: When a row whose episode has ended starts the next one.
        render_mode: ``None`` or ``"rgb_array"``.
        obs: ``"dict"`` or ``"flat"``.
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        **settings: As for :class:`GraspLiftEnv`.

    Raises:
        ValueError: If a setting is unknown, of the wrong type or out of range.
    """

    metadata = _METADATA

    def __init__(
        self,
        num_envs: int = 1,
        num_threads: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        obs: str = "dict",
        width: int = 640,
        height: int = 480,
        **settings: Unpack[Settings],
    ) -> None:
        try:
            mode = AutoresetMode(autoreset_mode)
        except ValueError:
            known = ", ".join(m.value for m in AutoresetMode)
            raise ValueError(
                f"autoreset_mode: found {autoreset_mode!r}, expected one of {known}"
            ) from None
        _check_count("num_envs", num_envs)
        if num_threads is not None:
            _check_count("num_threads", num_threads)
        self.num_envs = num_envs
        self.autoreset_mode = mode
        self.metadata = {**_METADATA, "autoreset_mode": mode}
        self._renderer = _Renderer(render_mode, width, height)
        self.render_mode = render_mode
        self._obs = obs
        self._settings: dict[str, Any] = dict(settings)
        self._threads = num_threads or min(_cores(), num_envs)
        self._batch = self._new_batch()
        self._spaces = _Spaces(self._batch, obs)
        self.single_observation_space = self._spaces.observation
        self.single_action_space = self._spaces.action
        self.observation_space = batch_space(self._spaces.observation, num_envs)
        self.action_space = batch_space(self._spaces.action, num_envs)
        self._started = False

    def _new_batch(self) -> Batch:
        mode = self.autoreset_mode.value
        return Batch(to_json(self._settings), self.num_envs, self._threads, mode)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Starts an episode in every row, or in those of ``options["reset_mask"]``.

        A seed s gives row i the seed s + i; a sequence gives each row its own, and ``None`` in it
        leaves that row's random stream as it is.
        """
        _check_options(options)
        seeds = self._seeds(seed)
        if isinstance(seed, (int, np.integer)):
            super().reset(seed=int(seed))
        mask = None if options is None else self._mask(options.get("reset_mask"))
        observation = self._batch.reset(seeds, mask)
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
                    _check_seed(one)
        elif seed is not None:
            _check_seed(seed)
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
        """Takes one control step of 40 ms in every row."""
        actions = _as_actions(actions, (self.num_envs, ACTION_SIZE))
        observation, reward, terminated, truncated, terms, success, ending, finals, failed = (
            self._batch.step(actions)
        )
        info = self._info(terms, success, ending)
        if failed:
            info |= self._press_errors(failed)
        if finals:
            info = self._with_finals(info, finals)
        return self._spaces.cut(observation), reward, terminated, truncated, info

    def _info(
        self, terms: NDArray[Any], success: NDArray[np.bool_], ending: NDArray[np.uint8]
    ) -> dict[str, Any]:
        def everywhere() -> NDArray[np.bool_]:
            return np.ones(self.num_envs, np.bool_)

        named: dict[str, Any] = {}
        for name, column in zip(REWARD_TERMS, terms.T.copy(), strict=True):
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
                names[row] = ENDINGS[ending[row] - 1]
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
        """Moves what rows that have started anew ended with into ``final_obs``/``final_info``."""
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

    def render(self) -> tuple[Frame, ...] | None:
        """One picture (height, width, 3) a row, or ``None`` without a render mode."""
        if self.render_mode is None:
            return None
        return tuple(self._renderer.draw(self._batch, row) for row in range(self.num_envs))

    def state(self) -> list[bytes]:
        """Every row as bytes: everything that its future depends on."""
        return self._batch.save()

    def set_state(self, states: Sequence[bytes]) -> Any:
        """Puts every row back to its :meth:`state`; the observations then.

        Raises:
            ValueError: If the bytes are damaged or come from an environment with other settings.
        """
        if not (isinstance(states, (list, tuple)) and all(isinstance(s, bytes) for s in states)):
            raise ValueError(f"state: found {type(states).__name__}, expected a list of bytes")
        self._started = True
        return self._spaces.cut(self._batch.load(list(states)))

    def plan(self, forget: bool = False) -> list[tuple[str, float, float]]:
        """The stages that a step runs, in order, with what they cost.

        Each has its name, how often it runs in a step of one environment, and its time in such a
        step (µs): means since the environment was made or put back to a state, or since the last
        call with `forget`. Stages: ``scene`` (Rapier), ``press`` (contact found, presses made),
        ``model`` (all presses of a batch in one call), each channel, ``reward``.
        """
        return self._batch.plan(forget)

    def skin(self) -> dict[str, NDArray[np.float64]] | None:
        """Places at rest in the frame of a pad (m) that the tactile channels refer to.

        ``markers`` (M, 3), ``surface`` (S, 3) the nodes of ``displacement``, ``grid`` (G, 2) the
        cells of ``stress`` and ``traction``, ``depth`` (D, 2) its pixels; ``None`` for rigid
        fingers.
        """
        return self._batch.skin()

    def look(self, row: int = 0) -> dict[str, Any] | None:
        """What a row's episode drew and where its bodies are (SI)."""
        return self._batch.look(row)

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """What `name` is or returns, once a row."""
        value = getattr(self, name)
        result = value(*args, **kwargs) if callable(value) else value
        return (result,) * self.num_envs

    def __getstate__(self) -> dict[str, Any]:
        """Arguments and snapshots; a copy goes on where this one stands."""
        mine = {k: v for k, v in self.__dict__.items() if k not in ("_batch", "_spaces")}
        return mine | {"_snapshot": self._batch.save()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        snapshot = state.pop("_snapshot")
        self.__dict__.update(state)
        self._batch = self._new_batch()
        self._batch.load(snapshot)
        self._spaces = _Spaces(self._batch, self._obs)


def _cores() -> int:
    """Cores that this process may use."""
    affinity: Callable[[int], Any] | None = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity is not None else os.cpu_count() or 1


def _masked(info: Mapping[str, Any], rows: NDArray[np.bool_]) -> dict[str, Any]:
    """The entries of a vector info that belong to `rows`, without keys that none of them has."""
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
