"""Policies that are not learnt: a hand-written (scripted) one for each task, and a random one.

The ``predict`` of a policy takes what Stable-Baselines3's does, for dict observations of N
environments::

    policy, state = ruffini.policies.scripted("ruffini/GraspLift-v0"), None
    action, state = policy.predict(observation, state, episode_start)

The scripted policy of a task is the function ``act`` of the module of the task's name, whose
``READS`` names the channels that it needs.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini._schema import TASKS
from ruffini._words import nearest
from ruffini.policies._parts import part

__all__ = ["RandomPolicy", "ScriptedPolicy", "part", "scripted"]


class ScriptedPolicy:
    """Policy of a function of observations and state.

    Args:
        act: The function; its state is a tuple of arrays (N, ...), or none.
        reads: Channels that it reads of dict observations.
    """

    def __init__(
        self, act: Callable[[Any, Any], tuple[NDArray[np.float32], Any]], reads: Sequence[str] = ()
    ) -> None:
        self._act = act
        self.reads = tuple(reads)
        """Channels that it reads."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (N, 5) for observations of N environments, and a state for the next call.

        Args:
            observation: Observations of N environments.
            state: State that the last call returned; none at the first.
            episode_start: Rows (N,) whose observation is the first of an episode, where the state
                begins anew; none if not given.
            deterministic: Not used.

        Raises:
            ValueError: If the observation lacks a channel that the policy reads, or `episode_start`
                is not one bool per environment.
        """
        self._check(observation)
        action, following = self._act(observation, state)
        if state is None or episode_start is None:
            return action, following
        first = np.asarray(episode_start, np.bool_)
        if first.shape != (len(action),):
            found = f"found shape {first.shape}, expected ({len(action)},)"
            raise ValueError(f"episode_start: {found}, one bool per environment")
        if first.any():
            begun, new = self._act(observation, None)
            action = _replaced(action, begun, first)
            pairs = zip(following, new, strict=True)
            following = tuple(_replaced(old, fresh, first) for old, fresh in pairs)
        return action, following

    def _check(self, observation: Any) -> None:
        """Raise a ``ValueError`` unless all that is read is there, for N environments."""
        if not self.reads:
            return
        expected = f"the channels {', '.join(self.reads)} of N environments, each (N, ...)"
        if not isinstance(observation, Mapping):
            found = f"an array of shape {np.shape(observation)}"
            raise ValueError(f"observation: found {found}, expected {expected}, in a dict")
        for name in self.reads:
            if name not in observation:
                raise ValueError(
                    f"observation: found no {name} among {', '.join(observation)}, "
                    f"expected {expected}"
                )
            values: Any = observation.get(name)
            if len(shape := np.shape(values)) != 2:
                raise ValueError(f"observation: found {name} of shape {shape}, expected {expected}")


def _replaced(old: NDArray[Any], new: NDArray[Any], rows: NDArray[np.bool_]) -> NDArray[Any]:
    """Values (N, ...) of `new` in these rows, of `old` in the others."""
    return np.where(rows.reshape(-1, *[1] * (old.ndim - 1)), new, old)


class RandomPolicy(ScriptedPolicy):
    """Uniform actions, the same on every run."""

    def __init__(self, seed: int = 0) -> None:
        random = np.random.default_rng(seed)

        def act(observation: Any, state: Any) -> tuple[NDArray[np.float32], Any]:
            channels = observation if isinstance(observation, dict) else {"flat": observation}
            rows = len(next(iter(channels.values())))
            return random.uniform(-1, 1, (rows, 5)).astype(np.float32), state

        super().__init__(act)


def scripted(env_id: str) -> ScriptedPolicy:
    """The scripted policy of an environment.

    It reads a part of the default observation, as a dict (``obs="dict"``); ``reads`` of the policy
    names the channels.

    Raises:
        ValueError: If there is no such environment.
    """
    name = env_id.split("/")[-1].split("-v")[0]
    if name not in TASKS:
        known = ", ".join(f"ruffini/{task}-v0" for task in TASKS)
        near = nearest(env_id, (f"ruffini/{task}-v0" for task in TASKS))
        raise ValueError(f"env_id: found {env_id!r}{near} expected one of {known}")
    word = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()
    module = importlib.import_module(f"ruffini.policies.{word}")
    return ScriptedPolicy(module.act, module.READS)
