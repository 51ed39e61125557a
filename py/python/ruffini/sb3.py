"""Vector environment and encoder of touch for Stable-Baselines3."""

from __future__ import annotations

import importlib
import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any, Literal, get_args

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

try:
    import torch
    from stable_baselines3.common.policies import MultiInputActorCriticPolicy
    from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, MlpExtractor
    from stable_baselines3.common.type_aliases import Schedule
    from stable_baselines3.common.vec_env import (
        VecEnv,
        VecFrameStack,
        VecMonitor,
        VecNormalize,
        is_vecenv_wrapped,
        unwrap_vec_wrapper,
    )
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn
except ModuleNotFoundError as error:
    missing = f'ruffini.sb3: found no {error.name}: pip install "ruffini[train]"'
    raise ModuleNotFoundError(missing, name=error.name) from None

from ruffini import _rows
from ruffini._schema import TACTILE_CHANNELS
from ruffini._spaces import check_options
from ruffini.envs import NativeVectorEnv

Infos = Literal["every step", "episode ends"]
"""Steps in which a row's info is filled."""

_INSTEAD = {
    **dict.fromkeys(
        ("wrapper_class", "wrapper_kwargs", "wrappers"),
        "no wrapper of a single environment, for rows are stepped natively: reward, endings, "
        "start and observations in ruffini.custom, actions in a VecEnvWrapper around the result",
    ),
    **dict.fromkeys(
        ("monitor_dir", "monitor_kwargs"),
        "stable_baselines3.common.vec_env.VecMonitor around the result",
    ),
    **dict.fromkeys(
        ("vec_env_cls", "vec_env_kwargs"), "none of them: rows are stepped on num_threads threads"
    ),
    **dict.fromkeys(("nenvs", "n_env", "num_env", "num_envs"), "n_envs"),
    "env_kwargs": "its entries as arguments of their own: mass=0.1",
    "start_index": "seed, that of the first row",
    "autoreset_mode": "none: the adapter needs SAME_STEP",
}
"""Arguments of Stable-Baselines3's and Gymnasium's functions, and what is expected in place."""


def make_vec_env(
    env_id: str,
    n_envs: int = 1,
    seed: int | None = None,
    infos: Infos = "every step",
    **kwargs: Any,
) -> RuffiniVecEnv:
    """Create a vector environment for Stable-Baselines3.

    It is not monitored: `normalize` does that, or a ``VecMonitor`` around it; else no returns of
    episodes are logged.

    Args:
        env_id: A registered id, such as ``"ruffini/GraspLift-v0"``; ``"module:id"`` imports the
            module first.
        n_envs: Number of environments.
        seed: Seed of the first one; each next one has the next seed.
        infos: ``"every step"`` fills every row's info in every step, as ``DummyVecEnv`` does;
            ``"episode ends"`` fills only those of rows whose episode has ended, which is enough
            for Stable-Baselines3's algorithms and ``VecMonitor``. It saves about 1 µs per row and
            step, below 1 % of a step of rigid environments (``policies/rollout_speed.py --infos``).
        **kwargs: As for ``gymnasium.make_vec``, ``max_episode_steps`` included.

    Raises:
        TypeError: If a setting is unknown.
        ValueError: If one is of the wrong type or out of range, or is an argument of
            Stable-Baselines3's function of that name which has no meaning here.
    """
    for name in kwargs:
        if name in _INSTEAD:
            raise ValueError(f"make_vec_env: found {name}, expected {_INSTEAD[name]}")
    # As of Gymnasium's `make`, a module may stand in front, which registers the task.
    module, _, name = env_id.rpartition(":")
    try:
        if module:
            importlib.import_module(module)
        entry = gym.spec(name).vector_entry_point
    except gym.error.Error as error:
        expected = "one as 'ruffini/GraspLift-v0', or that of a task that was registered"
        raise type(error)(f"env_id: found {env_id!r}, expected {expected} ({error})") from None
    if isinstance(entry, str):
        entry = gym.envs.registration.load_env_creator(entry)  # type: ignore[assignment]
    if not (isinstance(entry, type) and issubclass(entry, NativeVectorEnv)):
        raise ValueError(f"env_id: found {env_id!r}, expected an environment of ruffini")
    same_step = AutoresetMode.SAME_STEP
    envs = gym.make_vec(env_id, num_envs=n_envs, autoreset_mode=same_step, **kwargs)
    assert isinstance(envs, NativeVectorEnv), "checked"
    vec_env = RuffiniVecEnv(envs, infos)
    vec_env.seed(seed)
    return vec_env


class RuffiniVecEnv(VecEnv):
    """Adapter from the batch to Stable-Baselines3.

    A row's info has ``TimeLimit.truncated``, ``is_success``, ``reward_terms``, ``ending`` and
    ``press_error`` if there is one, and ``terminal_observation`` when its episode has ended.

    Args:
        envs: The batch, in SAME_STEP mode.
        infos: As for :func:`make_vec_env`.

    Raises:
        ValueError: If the batch is in another mode or `infos` is not valid.
    """

    def __init__(self, envs: NativeVectorEnv, infos: Infos = "every step") -> None:
        if infos not in get_args(Infos):
            known = " or ".join(map(repr, get_args(Infos)))
            raise ValueError(f"infos: found {infos!r}, expected {known}")
        if envs.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ValueError(f"autoreset_mode: found {envs.autoreset_mode}, expected SAME_STEP")
        self.envs = envs
        self._infos = infos
        self._actions: NDArray[np.float32] | None = None
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self.metadata = envs.metadata  # Films have its rate.

    def reset(self) -> VecEnvObs:
        """Start an episode in every row, with the seeds given since the last reset."""
        seeds = self._seeds if any(seed is not None for seed in self._seeds) else None
        observation: VecEnvObs
        observation, _ = self.envs.reset(seed=seeds)
        self._reset_seeds()
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return observation

    def set_options(
        self, options: Sequence[Mapping[str, Any]] | Mapping[str, Any] | None = None
    ) -> None:
        """Take the options of the next reset, of each row or the same for all; rows have none.

        Raises:
            ValueError: If one is given. What an episode draws are settings of the environment.
        """
        for row in options if isinstance(options, (list, tuple)) else [options]:
            check_options(row)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions for :meth:`step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Take one step; rows whose episode ended have already started the next."""
        observation, reward, terminated, truncated, info = self.envs.step(self._actions)
        dones = terminated | truncated
        every_step = self._infos == "every step"
        blank: dict[str, Any] = {"TimeLimit.truncated": False} if every_step else {}
        infos = [blank.copy() for _ in range(self.num_envs)]
        if every_step:
            _fill(infos, info)
        if dones.any():
            _fill(infos, info["final_info"])
            for row in np.flatnonzero(dones).tolist():
                infos[row]["terminal_observation"] = info["final_obs"][row]
                infos[row]["TimeLimit.truncated"] = bool(truncated[row] and not terminated[row])
                self.reset_infos[row] = {}
        return observation, reward.astype(np.float32), dones, infos

    def close(self) -> None:
        """Free the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of every requested row.

        Rows share their attributes; their spaces are those of a single environment. For a method
        of a row, a function that calls it for that row is returned; see :meth:`env_method`.

        Raises:
            ValueError: If it is a method of the whole batch, and only some rows are requested.
        """
        return _rows.attribute(self.envs, self._chosen(indices), attr_name)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the batch, which all rows share.

        Raises:
            ValueError: If only some rows are requested, it is a setting: another value takes a
                new environment, or a task of one's own has no such attribute.
        """
        _rows.set_attribute(self.envs, self._chosen(indices), attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method for the requested rows, without effect on the others; return the results.

        ``look``, ``surfaces``, ``presses``, ``state``, ``render``, ``reset``, ``channels`` and
        ``skin`` are those of the single environment that a row equals. ``set_state`` takes one
        state for all rows or a list with one for each. ``step`` raises an error. Any other method,
        such as ``plan``, is called once for the batch, and its result is returned for every row.

        Raises:
            ValueError: If it is ``set_state`` or a method of the whole batch, and only some rows
                are requested.
        """
        rows = self._chosen(indices)
        return _rows.call(self.envs, rows, method_name, *method_args, **method_kwargs)

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: Any = None
    ) -> list[bool]:
        """Return False for every row: rows of the native batch are not wrapped."""
        return [False for _ in self._chosen(indices)]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """One picture (height, width, 3) per row."""
        frames = self.envs.render()
        return [None] * self.num_envs if frames is None else list(frames)

    def _chosen(self, indices: int | Iterable[int] | None) -> list[int]:
        return _rows.chosen(indices, self.num_envs)


def _fill(infos: list[dict[str, Any]], info: dict[str, Any]) -> None:
    """Copy the entries of a vector info to the infos of the rows."""
    if "is_success" not in info:
        return
    names = [name for name in info["reward_terms"] if not name.startswith("_")]
    terms = zip(*(info["reward_terms"][name].tolist() for name in names), strict=True)
    success = info["is_success"].tolist()
    given = info["_is_success"].tolist()
    for row_info, has_terms, values, done in zip(infos, given, terms, success, strict=True):
        if has_terms:
            row_info["reward_terms"] = dict(zip(names, values, strict=True))
            row_info["is_success"] = done
    for key in ("ending", "press_error"):
        for row in np.flatnonzero(info.get(f"_{key}", ())).tolist():
            infos[row][key] = info[key][row]


TYPICAL = {
    "markers": 80.0,
    "marker_pixels": 80.0,
    "displacement": 80.0,
    "stress": 100.0,
    "tet_stress": 100.0,
    "traction": 100.0,
}
"""Ratio of a channel's bound to its typical value under a firm grip."""

WEAK = 0.1
"""Scale of the features of touch at the beginning of training."""


def _check_dict(space: gym.Space[Any]) -> None:
    """Raise a ``ValueError`` unless observations of `space` are dicts of channels."""
    if not isinstance(space, gym.spaces.Dict):
        expected = 'a Dict of channels, as with obs="dict", the default'
        found = f"{type(space).__name__} {space.shape}"
        raise ValueError(f"observation_space: found {found}, expected {expected}")


def fields(space: gym.spaces.Dict, frames: int = 1) -> list[str]:
    """Names of the tactile channels that are fields, with values at many points of a pad.

    Args:
        space: Space of the observations.
        frames: Number of observations that a ``VecFrameStack`` has joined.
    """
    sizes = {name: int(np.prod(box.shape or ())) for name, box in space.items()}
    felt = [name for name in TACTILE_CHANNELS if name != "predicted_error"]
    return [name for name, size in sizes.items() if name in felt and size > 2 * frames]


def normalize(envs: VecEnv, **kwargs: Any) -> VecNormalize:
    """Normalise observations as the shipped agents see them, and monitor episodes.

    A ``VecMonitor``, if there is none, and a ``VecNormalize`` of all channels but fields of touch
    (:func:`fields`), which are 0 without contact, so that running statistics would scale the first
    contacts to huge values; :class:`TouchExtractor` scales them. Rewards stay as they are.

    Flat observations have no channels to leave out: touch in them is normalised like the rest, its
    first contacts to ``clip_obs``. To learn from touch, take dicts.

    Args:
        envs: Environments, as of :func:`make_vec_env`.
        **kwargs: As for ``VecNormalize``.
    """
    if not is_vecenv_wrapped(envs, VecMonitor):
        envs = VecMonitor(envs, info_keywords=("is_success",))
    keys = None
    if isinstance(envs.observation_space, gym.spaces.Dict):
        stack = unwrap_vec_wrapper(envs, VecFrameStack)
        felt = fields(envs.observation_space, stack.stacked_obs.n_stack if stack else 1)
        keys = [name for name in envs.observation_space if name not in felt]
    return VecNormalize(envs, **{"norm_reward": False, "norm_obs_keys": keys} | kwargs)


class Pictures(torch.nn.Module):
    """Convolutional network of pictures of a pad: three layers, each of half the size.

    Args:
        shape: Rows, columns and colours of a picture.
        features: Number of features.
        frames: Number of pictures that are seen at once.
    """

    def __init__(self, shape: tuple[int, int, int], features: int, frames: int = 1) -> None:
        channels = [frames * shape[2], 16, 32, 32]
        layers: list[torch.nn.Module] = []
        for given, wanted in pairwise(channels):
            layers += [torch.nn.Conv2d(given, wanted, 3, stride=2, padding=1), torch.nn.ReLU()]
        layers += [torch.nn.AdaptiveAvgPool2d(4), torch.nn.Flatten()]
        layers += [torch.nn.Linear(16 * channels[-1], features), torch.nn.Tanh()]
        super().__init__()
        self.layers = torch.nn.Sequential(*layers)
        self._shape, self._frames = shape, frames

    def forward(self, pads: torch.Tensor) -> torch.Tensor:
        """Features (N, 2, F) of the flattened pictures (N, 2, ...) of two pads."""
        pictures = pads.reshape(-1, self._frames, *self._shape).permute(0, 1, 4, 2, 3)
        found: torch.Tensor = self.layers(pictures.flatten(1, 2))
        return found.reshape(-1, 2, found.shape[-1])


class TouchExtractor(BaseFeaturesExtractor):
    """Features of dict observations for ``MultiInputPolicy``.

    Each field of touch (:func:`fields`) has a small network of its own, which is applied to each
    of the two pads; all other channels are passed through. The default markers take about 9,000
    weights. A network is a perceptron, or convolutional for those that `pictures` names.

    Touch is scaled by its bounds, other channels not at all: :func:`normalize` does that. A learnt
    factor on the features starts small, so that contact at first hardly changes the actions of the
    policy.

    Args:
        observation_space: Space of the observations, a ``Dict`` of vectors.
        features: Number of features of one pad.
        hidden: Width of the hidden layer.
        frames: Number of observations that a ``VecFrameStack`` has joined; the network of a pad
            then sees that pad in all of them.
        pictures: Rows, columns and colours of channels that are pictures, such as
            ``{"image": (80, 60, 3), "depth": (80, 60, 1)}``; those of an environment are in its
            setting ``resolution``.

    Raises:
        ValueError: If observations are not dicts, or not of so many frames, or pictures are not
            of that shape.
    """

    def __init__(
        self,
        observation_space: gym.spaces.Dict,
        features: int = 32,
        hidden: int = 64,
        frames: int = 1,
        pictures: Mapping[str, Sequence[int]] | None = None,
    ) -> None:
        _check_dict(observation_space)
        sizes = {name: int(np.prod(box.shape or ())) for name, box in observation_space.items()}
        for name in fields(observation_space, frames):
            if frames < 1 or sizes[name] % (2 * frames):
                expected = f"a divisor of the {sizes[name] // 2} values of {name} at a pad"
                raise ValueError(f"frames: found {frames}, expected {expected}")
        shapes = {
            name: _of_pad(name, shape, sizes, frames) for name, shape in (pictures or {}).items()
        }
        self._frames = frames
        felt = {name: sizes[name] // 2 for name in fields(observation_space, frames)}
        seen = sum(size for name, size in sizes.items() if name not in felt)
        super().__init__(observation_space, features_dim=seen + 2 * features * len(felt))
        self._channels = list(sizes)
        for name in felt:
            box = observation_space[name]
            assert isinstance(box, gym.spaces.Box), "channels are boxes"
            scale = TYPICAL.get(name, 1.0) / np.maximum(-box.low, box.high)
            scales = self._by_pad(torch.as_tensor(scale)[None])[0]
            self.register_buffer(f"scale_{name}", scales)
        self._pads = torch.nn.ModuleDict(
            {
                name: Pictures(shapes[name], features, frames)
                if name in shapes
                else torch.nn.Sequential(
                    torch.nn.Linear(size, hidden),
                    torch.nn.Tanh(),
                    torch.nn.Linear(hidden, features),
                    torch.nn.Tanh(),
                )
                for name, size in felt.items()
            }
        )

        self._strength = torch.nn.ParameterDict(
            {name: torch.nn.Parameter(torch.tensor(WEAK)) for name in felt}
        )

    def _by_pad(self, values: torch.Tensor) -> torch.Tensor:
        """Values (N, 2, ...) of each pad in all frames, from those (N, ...) of a channel."""
        return values.reshape(len(values), self._frames, 2, -1).transpose(1, 2).flatten(2)

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        """Features (N, F) of observations (N, ...)."""
        parts = []
        for name in self._channels:
            values = observations[name]
            if name in self._pads:
                pads = self._by_pad(values) * self.get_buffer(f"scale_{name}")
                values = self._strength[name] * self._pads[name](pads).flatten(1)
            parts.append(values)
        return torch.cat(parts, dim=1)


def _of_pad(
    name: str, shape: Sequence[int], sizes: Mapping[str, int], frames: int
) -> tuple[int, int, int]:
    """Shape of a channel of pictures, of which two pads have `frames` each.

    Raises:
        ValueError: If it is not that of such a channel.
    """
    if name not in sizes:
        raise ValueError(f"pictures: found {name}, expected some of {', '.join(sizes)}")
    size = sizes[name] // (2 * frames)
    if len(shape) != 3 or min(shape) < 1 or math.prod(shape) != size:
        expected = f"rows, columns and colours of the {size} values of {name} at a pad"
        raise ValueError(f"pictures: found {name} {tuple(shape)}, expected {expected}")
    rows, columns, colours = shape
    return rows, columns, colours


class AsymmetricPolicy(MultiInputActorCriticPolicy):
    """Policy of PPO whose value function sees channels that its actions do not depend on.

    A simulator has state that a robot has to find out: give it, as ``insertion`` of InsertPeg,
    to the value function alone, and advantages are told apart from luck (Pinto et al., "Asymmetric
    actor critic for image-based robot learning", arXiv:1710.06542).

    Args:
        observation_space: Space of the observations, a ``Dict`` of vectors.
        action_space: Space of the actions.
        lr_schedule: Learning rate by the remaining progress.
        privileged: Channels that the value function alone sees.
        **kwargs: As for ``MultiInputPolicy``.

    Raises:
        ValueError: If observations are not dicts, one of `privileged` is no channel of theirs, all
            or none are, or the algorithm is none with a value function of states, such as SAC.
    """

    def __init__(
        self,
        observation_space: gym.spaces.Dict,
        action_space: gym.Space[Any],
        lr_schedule: Schedule,
        *,
        privileged: Sequence[str],
        **kwargs: Any,
    ) -> None:
        _check_dict(observation_space)
        if isinstance(privileged, str):
            expected = f"a list of channels: [{privileged!r}]"
            raise ValueError(f"privileged: found {privileged!r}, expected {expected}")
        seen = [name for name in observation_space if name not in privileged]
        known = list(observation_space)
        if not privileged or not seen or len(seen) + len(privileged) != len(known):
            found = ", ".join(privileged) or "none"
            expected = f"some, but not all, of {', '.join(known)}"
            raise ValueError(f"privileged: found {found}, expected {expected}")
        self.seen, self._privileged = seen, list(privileged)
        kwargs |= {"share_features_extractor": False}
        kwargs.setdefault("features_extractor_class", TouchExtractor)
        super().__init__(observation_space, action_space, lr_schedule, **kwargs)

    @property
    def actor(self) -> Any:
        """Part of the policies of SAC, TD3 and DDPG, which this one cannot take the place of."""
        raise ValueError(
            "policy: found AsymmetricPolicy in an algorithm that learns off-policy, expected PPO, "
            "A2C or TRPO, whose policy has a value function of states"
        )

    @property
    def lstm_actor(self) -> Any:
        """Part of the policies of RecurrentPPO, which this one cannot take the place of."""
        raise ValueError(
            "policy: found AsymmetricPolicy in a recurrent algorithm, expected PPO, A2C or TRPO"
        )

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return super()._get_constructor_parameters() | {"privileged": self._privileged}

    def make_features_extractor(self) -> BaseFeaturesExtractor:
        """Create the actor's extractor at the first call, the value function's at the second."""
        space = self.observation_space
        assert isinstance(space, gym.spaces.Dict), "checked by the constructor of the base class"
        if "features_extractor" not in self._modules:
            space = gym.spaces.Dict({name: space[name] for name in self.seen})
        return self.features_extractor_class(space, **self.features_extractor_kwargs)

    def _build_mlp_extractor(self) -> None:
        super()._build_mlp_extractor()
        features = self.vf_features_extractor.features_dim
        whole = MlpExtractor(features, self.net_arch, self.activation_fn, self.device)
        self.mlp_extractor.value_net = whole.value_net
