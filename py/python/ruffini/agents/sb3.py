"""Conversion of agents from and to Stable-Baselines3; needs the extra ``train``."""

from __future__ import annotations

import json
from os import PathLike
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.torch_layers import CombinedExtractor, FlattenExtractor
from stable_baselines3.common.vec_env import (
    VecEnv,
    VecMonitor,
    VecNormalize,
    unwrap_vec_normalize,
)

from ruffini import __version__
from ruffini._settings import plain
from ruffini.agents import first_seed
from ruffini.agents._agent import ACTIVATIONS, FORMAT, Agent, Card, Network, Normaliser
from ruffini.evaluation import ProgressCallback, check_wrappers, normaliser_of
from ruffini.sb3 import AsymmetricPolicy, Pictures, TouchExtractor, make_vec_env

_HYPERPARAMETERS = (
    "n_steps",
    "batch_size",
    "n_epochs",
    "gamma",
    "gae_lambda",
    "normalize_advantage",
    "ent_coef",
    "vf_coef",
    "max_grad_norm",
    "target_kl",
)
"""Keyword arguments of PPO that the model has as attributes of the same name."""


def export(
    model: PPO,
    normaliser: VecEnv | None,
    path: str | PathLike[str],
    *,
    env_id: str,
    settings: dict[str, Any],
    seed: int,
    threads: int,
    commit: str,
    episodes: int = 200,
    progress: ProgressCallback | None = None,
) -> Agent:
    """Write a trained model as an agent, with the success rate of the exported agent.

    Args:
        model: The model.
        normaliser: Environments with the ``VecNormalize`` of its observations; ``None`` takes the
            model's own, if it has one. Environments without one give way to the model's.
        path: The .safetensors file.
        env_id: Id of the environment in which it was trained.
        settings: Keyword arguments of that environment.
        seed: Seed of the training run.
        threads: Threads of the training run.
        commit: Commit of this library.
        episodes: Number of evaluation episodes, for the card.
        progress: Callback after every step; see `ProgressCallback`.

    Raises:
        ValueError: If the model cannot be represented as an agent.
    """
    about: dict[str, Any] = {"seed": seed, "threads": threads, "commit": commit}
    agent = from_sb3(model, normaliser, env_id=env_id, settings=settings, **about)
    agent.evaluate(episodes, progress)
    agent.write(path)
    return agent


def from_sb3(
    model: PPO,
    normaliser: VecEnv | None,
    *,
    env_id: str,
    settings: dict[str, Any],
    seed: int,
    threads: int,
    commit: str,
) -> Agent:
    """Convert a model to an agent that was not evaluated; arguments are those of `export`.

    An agent holds policy, normalisation and, unless the policy is an `AsymmetricPolicy`, the value
    function, but not the state of the optimiser. Of schedules, it holds the initial values.

    Raises:
        ValueError: If the model cannot be represented as an agent.
    """
    policy = _checked(model)
    check_wrappers(model)
    flat = not isinstance(model.observation_space, gym.spaces.Dict)
    # How observations are laid out and how many threads step is no matter of the agent.
    settings = {k: value for k, value in settings.items() if k not in ("obs", "num_threads")}
    settings = json.loads(json.dumps(settings, default=plain))
    channels = _channels(env_id, settings)
    given = None if normaliser is None else unwrap_vec_normalize(normaliser)
    found = normaliser_of(model, given)
    statistics, numbers = _statistics(found, channels)
    tensors = numbers | {
        name: parameter.detach().cpu().numpy().copy()
        for name, parameter in _parameters(policy).items()
    }
    schedules = {"learning_rate": model.lr_schedule(1.0), "clip_range": model.clip_range(1.0)}  # type: ignore[operator]
    hyperparameters = {name: getattr(model, name) for name in _HYPERPARAMETERS}
    card: Card = {
        "format": FORMAT,
        "ruffini": __version__,
        "commit": commit,
        "env": env_id,
        "settings": settings,
        "channels": channels,
        "algorithm": "ppo",
        "policy": "MlpPolicy" if flat else "MultiInputPolicy",
        "hyperparameters": hyperparameters | schedules | {"n_envs": model.n_envs},
        "seed": seed,
        "steps": model.num_timesteps,
        "threads": threads,
        "evaluation": {},
        "network": _network(policy, channels),
        "normaliser": statistics,
    }
    return Agent(card, tensors)


def to_sb3(agent: Agent, envs: VecEnv | None = None, **hyperparameters: Any) -> PPO:
    """Convert the agent to a model of Stable-Baselines3, with its normalisation, for training.

    The normalisation is in the model's environments: ``model.predict`` takes what they observe, as
    in ``evaluate_policy(model, model.get_env())``; other observations go through
    ``model.get_env().normalize_obs`` first. The value function of an agent without one begins anew.

    Args:
        agent: The agent.
        envs: Environments to train in, not normalised; ``None`` creates those of the card. Their
            settings may differ from the agent's, but not their channels.
        **hyperparameters: Keyword arguments of PPO in place of the card's, and ``n_envs``. Of
            ``policy_kwargs``, what gives the network its form is the agent's.

    Raises:
        ValueError: If the channels of the environments are not those of the agent.
    """
    card = agent.card
    arguments: dict[str, Any] = {"seed": card["seed"], "device": "cpu"}
    arguments |= card["hyperparameters"] | hyperparameters
    n_envs = arguments.pop("n_envs")
    flat = card["policy"] == "MlpPolicy"
    if envs is None:
        obs = "flat" if flat else "dict"
        made = make_vec_env(card["env"], n_envs=n_envs, obs=obs, **card["settings"])
        envs = VecMonitor(made, info_keywords=("is_success",))
    agent.check(envs.observation_space)
    normalised = _normalised(agent, envs, arguments["gamma"])
    network = card["network"]
    value = network["policy"] if network["value"] is None else network["value"]
    kwargs: dict[str, Any] = {
        "net_arch": {"pi": network["policy"], "vf": value},
        "activation_fn": getattr(torch.nn, network["activation"]),
    }
    if network["touch"]:
        hidden, features = next(iter(network["touch"].values()))
        kwargs["features_extractor_class"] = TouchExtractor
        kwargs["features_extractor_kwargs"] = {"hidden": hidden, "features": features}
    kwargs = arguments.pop("policy_kwargs", {}) | kwargs
    model = PPO(card["policy"], normalised, policy_kwargs=kwargs, **arguments)
    model.num_timesteps = card["steps"]
    if normalised.norm_obs:
        # As `learn` leaves it, the sign that it sees normalised observations.
        model._last_original_obs = {}
    # Other episodes than the agent has seen; PPO seeds them with its own seed.
    normalised.seed(first_seed(arguments["seed"], card["steps"]))
    with torch.no_grad():
        for name, parameter in _parameters(model.policy).items():
            if name in agent.tensors:
                parameter.copy_(torch.as_tensor(agent.tensors[name]))
    return model


def _checked(model: Any) -> ActorCriticPolicy:
    """Policy of a model, checked to be one that an agent can represent."""
    if not isinstance(model, PPO):
        raise ValueError(f"model: found {type(model).__name__}, expected PPO")
    policy = model.policy
    extractors = (TouchExtractor, CombinedExtractor, FlattenExtractor)
    for name, found, sound in (
        ("use_sde", model.use_sde, not model.use_sde),
        (
            "share_features_extractor",
            False,
            policy.share_features_extractor or isinstance(policy, AsymmetricPolicy),
        ),
        (
            "features_extractor_class",
            type(policy.features_extractor).__name__,
            type(policy.features_extractor) in extractors,
        ),
        (
            "activation_fn",
            policy.activation_fn.__name__,
            policy.activation_fn.__name__ in ACTIVATIONS,
        ),
        (
            "features_extractor_kwargs",
            "pictures",
            not any(isinstance(part, Pictures) for part in policy.features_extractor.modules()),
        ),
    ):
        if not sound:
            expected = (
                f"no gSDE, one extractor of {', '.join(e.__name__ for e in extractors)} without "
                f"pictures, and an activation of {', '.join(ACTIVATIONS)}"
            )
            raise ValueError(f"model: {name}: found {found}, expected {expected}")
    return policy


def _channels(env_id: str, settings: dict[str, Any]) -> dict[str, int]:
    """Channels of an environment in its order, with their sizes."""
    env = gym.make(env_id, **settings).unwrapped
    table = env.channels()  # type: ignore[attr-defined]
    observed = env._observed  # type: ignore[attr-defined]
    env.close()
    # A task of one's own may read channels that its agents do not observe.
    return {
        name: sum(len(part[1]) for part in parts)
        for name, parts in table
        if observed is None or name in observed
    }


def _parameters(policy: ActorCriticPolicy) -> dict[str, torch.Tensor]:
    """Parameters of a policy by their names in an agent's file."""
    named: dict[str, torch.Tensor] = {"log_std": policy.log_std}
    extractor = policy.features_extractor
    if isinstance(extractor, TouchExtractor):
        for name, pad in extractor._pads.items():
            named[f"touch.{name}.scale"] = extractor.get_buffer(f"scale_{name}")
            named[f"touch.{name}.strength"] = extractor._strength[name]
            named |= _layers(f"touch.{name}", pad)
    named |= _layers("policy", policy.mlp_extractor.policy_net, policy.action_net)
    if isinstance(policy, AsymmetricPolicy):
        return named
    return named | _layers("value", policy.mlp_extractor.value_net, policy.value_net)


def _layers(name: str, *parts: torch.nn.Module) -> dict[str, torch.Tensor]:
    named: dict[str, torch.Tensor] = {}
    for layer, linear in enumerate(_linear(*parts)):
        named[f"{name}.{layer}.weight"] = linear.weight
        named[f"{name}.{layer}.bias"] = linear.bias
    return named


def _linear(*parts: torch.nn.Module) -> list[torch.nn.Linear]:
    inner = (module for part in parts for module in part.modules())
    return [module for module in inner if isinstance(module, torch.nn.Linear)]


def _network(policy: ActorCriticPolicy, channels: dict[str, int]) -> Network:
    def widths(part: torch.nn.Module) -> list[int]:
        return [linear.out_features for linear in _linear(part)]

    space, extractor = policy.observation_space, policy.features_extractor
    felt: Any = extractor._pads if isinstance(extractor, TouchExtractor) else {}
    return {
        "order": [name for name in space if name in channels]
        if isinstance(space, gym.spaces.Dict)
        else list(channels),
        "touch": {name: widths(pad) for name, pad in felt.items()},
        "policy": widths(policy.mlp_extractor.policy_net),
        "value": None
        if isinstance(policy, AsymmetricPolicy)
        else widths(policy.mlp_extractor.value_net),
        "activation": policy.activation_fn.__name__,
    }


def _statistics(
    normaliser: VecNormalize | None, channels: dict[str, int]
) -> tuple[Normaliser, dict[str, NDArray[np.float64]]]:
    """Normalisation of observations, and means and variances by their names in the file."""
    saved: Normaliser = {"channels": [], "count": 0.0, "clip": 10.0, "epsilon": 1e-8}
    numbers: dict[str, NDArray[np.float64]] = {}
    if normaliser is None or not normaliser.norm_obs:
        return saved, numbers
    saved["clip"], saved["epsilon"] = float(normaliser.clip_obs), float(normaliser.epsilon)
    for names, running in _running(normaliser, channels):
        if not set(names) <= set(channels):
            continue
        ends = np.cumsum([channels[name] for name in names])[:-1]
        saved["channels"] += names
        saved["count"] = float(running.count)
        for part, values in (("mean", running.mean), ("variance", running.var)):
            for name, share in zip(names, np.split(values, ends), strict=True):
                numbers[f"normaliser.{name}.{part}"] = np.asarray(share, np.float64)
    return saved, numbers


def _normalised(agent: Agent, envs: VecEnv, gamma: float) -> VecNormalize:
    """The environments with the agent's normalisation."""
    saved = agent.card["normaliser"]
    dictionary = isinstance(envs.observation_space, gym.spaces.Dict)
    normalised = VecNormalize(
        envs,
        norm_obs=bool(saved["channels"]),
        norm_reward=False,
        clip_obs=saved["clip"],
        gamma=gamma,
        epsilon=saved["epsilon"],
        norm_obs_keys=saved["channels"] if dictionary else None,
    )
    if saved["channels"]:
        for names, running in _running(normalised, agent.channels):
            running.mean, running.var = (
                np.concatenate([agent.tensors[f"normaliser.{name}.{part}"] for name in names])
                for part in ("mean", "variance")
            )
            running.count = saved["count"]
    return normalised


def _running(
    normaliser: VecNormalize, channels: dict[str, int]
) -> list[tuple[list[str], RunningMeanStd]]:
    """Running statistics, each with its channels: a single one, or all in a row."""
    found: Any = normaliser.obs_rms
    if isinstance(found, dict):
        return [([name], running) for name, running in found.items()]
    return [(list(channels), found)]
