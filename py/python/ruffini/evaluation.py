"""Success rate of a policy over fixed seeds, with its confidence interval.

There is one episode per seed, all stepped together; seeds count up from `FIRST_SEED`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

__all__ = ["FIRST_SEED", "Policy", "Progress", "evaluate", "line", "wilson"]

FIRST_SEED = 10_000
"""First of the consecutive evaluation seeds; training seeds are far below."""

Progress = Callable[[int, int, int], None]
"""Called after every step with the episodes finished, all episodes, and the steps taken."""


class Policy(Protocol):
    """Policy with Stable-Baselines3's signature."""

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


def evaluate(
    policy: Policy,
    env_id: str,
    episodes: int,
    *,
    first_seed: int = FIRST_SEED,
    progress: Progress | None = None,
    **settings: Any,
) -> dict[str, Any]:
    """Success rate, its interval, return, successes by object, and reasons of early endings.

    Args:
        policy: Policy.
        env_id: Id of the environment.
        episodes: Number of episodes, one per seed.
        first_seed: Seed of the first episode.
        progress: Callback after every step; see `Progress`.
        **settings: As for ``gymnasium.make_vec``.
    """
    envs = gym.make_vec(
        env_id, num_envs=episodes, autoreset_mode=AutoresetMode.DISABLED, **settings
    )
    observation, _ = envs.reset(seed=first_seed)
    objects = [envs.look(row)["object"] for row in range(episodes)]  # type: ignore[attr-defined]
    returns, success = np.zeros(episodes), np.zeros(episodes, bool)
    ended, state, steps = np.zeros(episodes, bool), None, 0
    endings: Counter[str] = Counter()
    while not ended.all():
        action, state = policy.predict(observation, state, deterministic=True)
        observation, reward, terminated, truncated, info = envs.step(action)
        returns += np.where(ended, 0.0, reward)
        over = (terminated | truncated) & ~ended
        success[over] = info["is_success"][over]
        endings.update(info["ending"][terminated & over] if "ending" in info else ())
        ended |= over
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
        "env": env_id,
        "episodes": episodes,
        "first_seed": first_seed,
        "success": float(success.mean()),
        "interval": [round(low, 4), round(high, 4)],
        "return": round(float(returns.mean()), 3),
        "by_object": by_object,
        "endings": dict(sorted(endings.items())),
    }


def line(name: str, result: dict[str, Any]) -> str:
    """Format a result as a line of a table."""
    low, high = result["interval"]
    return (
        f"{name:<24} {result['success']:7.1%}  ({low:.1%} to {high:.1%})"
        f"   return {result['return']:6.2f}"
    )
