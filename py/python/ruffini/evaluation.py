"""Success rate of a policy over fixed seeds, with its confidence interval.

There is one episode per seed, all stepped together; seeds count up from `FIRST_SEED`.
"""

from __future__ import annotations

import contextlib
import math
import os
import platform
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol, cast

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike, NDArray

from ruffini._core import __version__
from ruffini._schema import full_id
from ruffini._spaces import check_count
from ruffini.policies import ScriptedPolicy

__all__ = [
    "FIRST_SEED",
    "Policy",
    "ProgressCallback",
    "about_this_run",
    "as_policy",
    "bootstrap",
    "check_wrappers",
    "evaluate",
    "line",
    "normaliser_of",
    "processor",
    "usable_cores",
    "wilson",
]

FIRST_SEED = 10_000
"""First of the consecutive evaluation seeds; environments in training have seeds from 2³² on."""

ProgressCallback = Callable[[int, int, int], None]
"""Called after every step with the episodes finished, all episodes, and the steps taken."""


class Policy(Protocol):
    """Policy whose ``predict`` takes what Stable-Baselines3's does, deterministic by default."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (N, 5) for observations of N environments."""


def wilson(successes: int, n: int) -> tuple[float, float]:
    """Compute the 95 % confidence interval of a proportion (Wilson 1927)."""
    z = 1.96
    share, spread = successes / n, z * z / n
    middle = (share + spread / 2) / (1 + spread)
    half = z * math.sqrt(share * (1 - share) / n + spread / (4 * n)) / (1 + spread)
    return max(0.0, middle - half), min(1.0, middle + half)


def bootstrap(
    values: ArrayLike,
    statistic: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    resamples: int = 10_000,
) -> tuple[float, float]:
    """Compute the bootstrapped 95 % interval of a statistic, the same on every call.

    Args:
        values: Sample, (N,).
        statistic: The statistic of each row of resamples, (R, N) to (R,).
        resamples: Number of resamples R.
    """
    drawn = np.random.default_rng(0).choice(np.asarray(values), (resamples, np.size(values)))
    low, high = np.quantile(statistic(drawn), [0.025, 0.975])
    return float(low), float(high)


def evaluate(
    policy: Policy | Callable[[Any], NDArray[np.float32]],
    env_id: str,
    episodes: int,
    *,
    first_seed: int = FIRST_SEED,
    progress: ProgressCallback | None = None,
    **settings: Any,
) -> dict[str, Any]:
    """Success rate, its interval, return, successes by object, and reasons of early endings.

    ``outcomes`` of the result has one record per episode, in the order of the seeds, so that
    policies can be compared seed by seed: ``seed``, ``success``, ``return``, ``length`` (steps),
    ``ending`` (``None`` if it ran out of time) and ``object``.

    Args:
        policy: Policy, or a function of the observations of N environments that returns their
            actions (N, 5). Observations of a model of Stable-Baselines3 are normalised by its
            ``VecNormalize``, if it has one.
        env_id: Id of the environment, or the name of a built-in task, ``GraspLift``.
        episodes: Number of episodes, one per seed.
        first_seed: Seed of the first episode.
        progress: Callback after every step; see `ProgressCallback`.
        **settings: As for ``gymnasium.make_vec``.

    Raises:
        TypeError: If `policy` is neither.
        ValueError: If `episodes` is no whole number from 1, a setting is invalid, or the model was
            trained on other observations, in a wrapper that changes them or actions, or with a
            ``VecNormalize`` that it has no more.
    """
    check_count("episodes", episodes)
    env_id = full_id(env_id)
    for name, instead in _INSTEAD.items():
        if name in settings:
            raise TypeError(f"got an unexpected keyword argument {name!r}, expected {instead}")
    _check_acts(policy)
    check_wrappers(policy)
    envs = gym.make_vec(
        env_id, num_envs=episodes, autoreset_mode=AutoresetMode.DISABLED, **settings
    )
    with contextlib.closing(envs):
        acting = as_policy(policy, envs.single_observation_space)
        return {"env": env_id} | _evaluated(acting, envs, first_seed, progress)


def _evaluated(
    acting: Policy, envs: gym.vector.VectorEnv, first_seed: int, progress: ProgressCallback | None
) -> dict[str, Any]:
    """Play an episode in every row; see `evaluate`."""
    episodes = envs.num_envs
    observation, _ = envs.reset(seed=first_seed)
    objects = [envs.look(row)["object"] for row in range(episodes)]  # type: ignore[attr-defined]
    returns, success = np.zeros(episodes), np.zeros(episodes, bool)
    lengths, ending = np.zeros(episodes, int), np.full(episodes, None, object)
    ended, state, steps = np.zeros(episodes, bool), None, 0
    first = np.ones(episodes, bool)
    while not ended.all():
        action, state = acting.predict(observation, state, episode_start=first, deterministic=True)
        observation, reward, terminated, truncated, info = envs.step(action)
        returns += np.where(ended, 0.0, reward)
        lengths += ~ended
        over = (terminated | truncated) & ~ended
        success[over] = info["is_success"][over]
        if "ending" in info:
            ending[terminated & over] = info["ending"][terminated & over]
        ended |= over
        first = terminated
        steps += 1
        if progress is not None:
            progress(int(ended.sum()), episodes, steps)
        if terminated.any() and not ended.all():
            # A row that has terminated starts another episode, which is not counted.
            observation, _ = envs.reset(options={"reset_mask": terminated})
    low, high = wilson(int(success.sum()), episodes)
    by_object = {
        name: [int(success[rows].sum()), len(rows)]
        for name in sorted(set(objects))
        for rows in [[row for row, other in enumerate(objects) if other == name]]
    }
    return {
        "episodes": episodes,
        "first_seed": first_seed,
        "success": float(success.mean()),
        "interval": [round(low, 4), round(high, 4)],
        "return": round(float(returns.mean()), 3),
        "by_object": by_object,
        "endings": dict(sorted(Counter(name for name in ending if name).items())),
        "outcomes": [
            {
                "seed": int(first_seed) + row,
                "success": bool(success[row]),
                "return": float(returns[row]),
                "length": int(lengths[row]),
                "ending": ending[row],
                "object": objects[row],
            }
            for row in range(episodes)
        ],
    }


_INSTEAD = {
    "seed": "first_seed",
    "num_envs": "episodes",
    "autoreset_mode": "none: each row plays one episode",
    "deterministic": "none: policies act without noise",
}
"""What takes the place of arguments that are asked for elsewhere."""


def as_policy(policy: Any, space: gym.Space[Any] | None = None) -> Policy:
    """Policy that acts on observations as an environment returns them.

    A model of Stable-Baselines3 gets them normalised by its ``VecNormalize``, if it has one.

    Args:
        policy: Policy, or a function of the observations of N environments that returns their
            actions (N, 5).
        space: Space of the observations of one environment, to be checked.

    Raises:
        TypeError: If `policy` is neither.
        ValueError: If a model was trained on observations of another space, in a wrapper that is
            left out here, or normalised by a ``VecNormalize`` that it was loaded without.
    """
    _check_acts(policy)
    if not hasattr(policy, "predict"):
        return ScriptedPolicy(lambda observation, state: (policy(observation), state))
    check_wrappers(policy)
    _check_actions(getattr(policy, "action_space", None))
    trained = getattr(policy, "observation_space", None)
    if space is not None and isinstance(trained, gym.Space):
        _check_same(trained, space)
    normaliser = normaliser_of(policy)
    return cast("Policy", policy) if normaliser is None else _Normalising(policy, normaliser)


def _check_acts(policy: Any) -> None:
    if isinstance(policy, type) or not (hasattr(policy, "predict") or callable(policy)):
        expected = "a policy with predict(observation, state, ...), or a function of observations"
        raise TypeError(f"policy: found {policy!r}, expected {expected} that returns actions")
    if any(kind.__name__ == "BasePolicy" and _is_sb3(kind) for kind in type(policy).__mro__):
        raise ValueError(
            f"policy: found the {type(policy).__name__} of a model by itself, expected the model, "
            "which knows the VecNormalize of its training, or a function of observations that "
            "normalises them if need be: lambda seen: policy.predict(seen)[0]"
        )


def _is_sb3(kind: type) -> bool:
    return kind.__module__.startswith("stable_baselines3.")


def _check_actions(space: gym.Space[Any] | None) -> None:
    """Check that a model acts in the environments' own space of actions."""
    if isinstance(space, gym.spaces.Box) and not (
        np.all(space.low == -1) and np.all(space.high == 1)
    ):
        raise ValueError(
            f"policy: found one with actions from {space.low.min():g} to {space.high.max():g}, "
            "expected -1 to 1, as of the environments: pass a function of observations that does "
            "what the wrapper of actions does"
        )


_TRANSPARENT = ("VecMonitor", "VecNormalize", "VecCheckNan", "VecVideoRecorder")
"""Wrappers of Stable-Baselines3 without which a model acts the same, or that are accounted for."""
_WATCHING = (
    "Monitor",
    "PassiveEnvChecker",
    "OrderEnforcing",
    "TimeLimit",
    "RecordEpisodeStatistics",
    "RecordVideo",
    "RenderCollection",
    "HumanRendering",
)
"""Wrappers of single environments without which a model acts the same."""


def check_wrappers(model: Any) -> None:
    """Check that a model of Stable-Baselines3 acts the same without its environments' wrappers.

    Raises:
        ValueError: If there is one that may change observations or actions.
    """
    envs: Any = model.get_env() if hasattr(model, "get_env") else None
    while hasattr(envs, "venv"):
        kind = type(envs)
        ours = kind.__module__.startswith("ruffini.")
        if not (ours or (_is_sb3(kind) and kind.__name__ in _TRANSPARENT)):
            raise _wrapped(kind.__name__, _TRANSPARENT[:2])
        envs = envs.venv
    # Single environments, as those of a DummyVecEnv, have wrappers of their own.
    singles = getattr(envs, "envs", None)
    if isinstance(singles, list):
        for env in singles:
            while isinstance(env, gym.Wrapper):
                _check_watching(type(env).__name__)
                env = env.env
    elif envs is not None and type(envs).__name__ == "SubprocVecEnv":
        # Those of other processes tell what they were made of.
        for spec in envs.get_attr("spec"):
            for wrapper in getattr(spec, "additional_wrappers", ()):
                _check_watching(wrapper.name)


def _check_watching(wrapper: str) -> None:
    if wrapper not in _WATCHING:
        raise _wrapped(wrapper, _WATCHING[:1])


def _wrapped(kind: str, but: Sequence[str]) -> ValueError:
    return ValueError(
        f"policy: found a model whose environments are in a {kind}, which is left "
        f"out here, expected none but {' and '.join(but)}: judge it by "
        "stable_baselines3.common.evaluation.evaluate_policy(model, model.get_env()), or "
        "pass a function of observations that does what the wrapper does"
    )


def normaliser_of(model: Any, given: Any = None) -> Any:
    """``VecNormalize`` with which a model of Stable-Baselines3 sees observations, or ``None``.

    Args:
        model: The model.
        given: A ``VecNormalize`` in place of that of the model's environments.

    Raises:
        ValueError: If it was trained on normalised observations, and has no ``VecNormalize``, or
            one that has seen nothing.
    """
    if not hasattr(model, "get_vec_normalize_env"):
        return given
    normaliser = model.get_vec_normalize_env() if given is None else given
    if normaliser is None and _has_seen_normalised(model):
        found = "a model trained on normalised observations, and no VecNormalize with it"
    elif normaliser is not None and model.num_timesteps > 0 and _is_fresh(normaliser):
        found = f"a model of {model.num_timesteps} steps with a VecNormalize that has seen none"
    else:
        return normaliser if normaliser is not None and normaliser.norm_obs else None
    raise ValueError(
        f"policy: found {found}, expected that of its training: PPO.load(file, "
        'env=VecNormalize.load("statistics.pkl", envs)) after envs.save("statistics.pkl"); if it '
        "scaled rewards alone, VecNormalize(envs, norm_obs=False)"
    )


def _has_seen_normalised(model: Any) -> bool:
    # `learn` leaves the first original observations in a model whose environments normalise, and
    # they are saved with it. The last observations are not kept by `load(file, env=...)`.
    last = getattr(model, "_last_obs", None)
    beyond = last is not None and not _within(last, model.observation_space)
    return beyond or getattr(model, "_last_original_obs", None) is not None


def _is_fresh(normaliser: Any) -> bool:
    """Return whether statistics of observations are as they were made."""
    if not normaliser.norm_obs:
        return False
    found = normaliser.obs_rms
    running = list(found.values()) if isinstance(found, dict) else [found]
    fresh = (np.all(each.mean == 0.0) and np.all(each.var == 1.0) for each in running)
    return bool(running) and all(fresh)


class _Normalising:
    """Policy whose observations are normalised first."""

    def __init__(self, policy: Policy, normaliser: Any) -> None:
        self._policy, self._normaliser = policy, normaliser

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (N, 5) for observations of N environments."""
        seen = self._normaliser.normalize_obs(observation)
        return self._policy.predict(seen, state, episode_start, deterministic)


def _sizes(space: gym.Space[Any]) -> dict[str, Any]:
    """Shapes of a space by channel, or of flat observations."""
    if isinstance(space, gym.spaces.Dict):
        return {name: box.shape for name, box in space.items()}
    return {"observations": space.shape}


def _check_same(trained: gym.Space[Any], space: gym.Space[Any]) -> None:
    found, given = _sizes(trained), _sizes(space)
    if found == given:
        if _is_reordered(trained, space):
            raise ValueError(
                "policy: found one trained on flat observations in another order, expected that of "
                "env.unwrapped.channels(): pass the list observation that it was trained with; "
                "FlattenObservation sorts the channels, obs='flat' does not"
            )
        if _has_bounds(space) and not _has_bounds(trained):
            raise ValueError(
                "policy: found one trained on observations without bounds, as a wrapper such as "
                "NormalizeObservation makes them, expected those of the environment: pass a "
                "function of observations that does what the wrapper does"
            )
        return

    def told(shapes: dict[str, Any]) -> str:
        return ", ".join(f"{name} {shape}" for name, shape in shapes.items())

    remedy = "the settings that it was trained with"
    if "observations" not in found | given and set(found) != set(given):
        remedy = f"observation={list(found)}"
    raise ValueError(
        f"policy: found one trained on {told(found)}; the environment gives {told(given)}, "
        f"expected the same: pass {remedy}"
    )


def _is_reordered(trained: gym.Space[Any], space: gym.Space[Any]) -> bool:
    """Return whether the bounds of flat observations are the same in another order."""
    if not (isinstance(trained, gym.spaces.Box) and isinstance(space, gym.spaces.Box)):
        return False
    ours, theirs = (np.stack([box.low, box.high], axis=1) for box in (trained, space))
    if np.allclose(ours, theirs):
        return False
    return np.allclose(sorted(ours.tolist()), sorted(theirs.tolist()))


def _has_bounds(space: gym.Space[Any]) -> bool:
    """Return whether every number of a space has finite bounds."""
    boxes = list(space.values()) if isinstance(space, gym.spaces.Dict) else [space]
    return all(box.is_bounded() for box in boxes if isinstance(box, gym.spaces.Box))


def _within(observation: Any, space: Any) -> bool:
    """Return whether a batch of observations lies within the bounds of a space."""
    if isinstance(space, gym.spaces.Dict):
        return all(_within(observation[name], box) for name, box in space.items())
    if not isinstance(space, gym.spaces.Box):
        return True
    inside = (observation >= space.low - 1e-6) & (observation <= space.high + 1e-6)
    return bool(np.all(inside))


def line(name: str, result: dict[str, Any]) -> str:
    """Format a result as a line of a table."""
    low, high = result["interval"]
    return (
        f"{name:<24} {result['success']:7.1%}  ({low:.1%} to {high:.1%})"
        f"   return {result['return']:6.2f}"
    )


def about_this_run() -> dict[str, Any]:
    """Versions, machine and commit, for the record beside a figure.

    The commit is that of the repository of ruffini in which the package lies, with a ``+`` if
    tracked files differ from it but for tests and results; else ``unknown``.
    """
    return {
        "ruffini": __version__,
        "gymnasium": gym.__version__,
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cores": usable_cores(),
        "processor": ", ".join([processor(), *_caches()]),
        "commit": _commit(),
    }


def _commit() -> str:
    def git(folder: Path, *words: str) -> str:
        line = ["git", "-C", str(folder), *words]
        return subprocess.run(line, capture_output=True, text=True, check=True).stdout

    try:
        found = git(Path(__file__).parent, "rev-parse", "--show-toplevel", "--short", "HEAD")
        root, commit = found.splitlines()
        # The package may be installed within a repository of something else.
        if not Path(root, "py/python/ruffini").is_dir():
            return "unknown"
        status = ("status", "--porcelain", "--untracked-files=no", "--")
        changed = git(Path(root), *status, ".", ":!tests", ":!policies/results")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return commit + "+" * bool(changed)


def usable_cores() -> int:
    """Number of cores that this process may use."""
    affinity: Callable[[int], Any] | None = getattr(os, "sched_getaffinity", None)
    cores = len(affinity(0)) if affinity is not None else os.cpu_count() or 1
    return max(1, min(cores, _quota()))


def _quota() -> int:
    """Cores that the quota of a container allows, rounded up; many if there is none."""
    try:
        quota, period = Path("/sys/fs/cgroup/cpu.max").read_text().split()
        return -(-int(quota) // int(period))
    except (OSError, ValueError):  # "max" is no quota.
        return sys.maxsize


def processor() -> str:
    """Name of the processor, or its architecture where the system does not name it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.split(": ", 1)[1] for line in lines if line.startswith("model name")]
    return (names or [platform.processor() or platform.machine()])[0]


def _caches() -> list[str]:
    """Caches that the first core reaches, if Linux names them."""
    caches = sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*"))
    found = []
    for cache in caches:
        # Firmware need not tell their sizes.
        with contextlib.suppress(OSError):
            level, size = ((cache / key).read_text().strip() for key in ("level", "size"))
            found.append((level, size))
    return [f"L{level} {size}" for level, size in found if level > "1"]
