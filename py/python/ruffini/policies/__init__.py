"""Policies that are not learnt: a hand-written (scripted) one for each task, and a random one.

The ``predict`` of a policy takes what Stable-Baselines3's does, for dict observations of N
environments::

    policy, state = ruffini.policies.scripted("ruffini/GraspLift-v0"), None
    action, state = policy.predict(observation, state, episode_start)

Those with `is_stateful` need that state in every step. The scripted policy of a task is the
function ``act`` of the module of the task's name, whose ``READS`` names the channels that it needs.
"""

from __future__ import annotations

import importlib
import re
import warnings
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
        is_stateful: Whether actions depend on the state.
    """

    def __init__(
        self,
        act: Callable[[Any, Any], tuple[NDArray[np.float32], Any]],
        reads: Sequence[str] = (),
        is_stateful: bool = False,
    ) -> None:
        self._act = act
        self.reads = tuple(reads)
        """Channels that it reads."""
        self.is_stateful = is_stateful
        """Whether actions depend on the state, which has to be passed on from call to call."""
        self._stateless_calls = 0

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (N, 5) for observations of N environments, and a state for the next call.

        A policy that `is_stateful` warns if it is called several times in a row without a state.

        Args:
            observation: Observations of N environments, or of one without the first axis, whose
                action has shape (5,).
            state: State that the last call returned; none at the first.
            episode_start: Rows (N,) whose observation is the first of an episode, where the state
                begins anew; none if not given.
            deterministic: Not used.

        Raises:
            ValueError: If the observation lacks a channel that the policy reads, or `episode_start`
                is not one bool per environment.
        """
        if self.reads:
            channels = self._channels(observation)
            single = channels[self.reads[0]].ndim == 1
            observation = {name: np.atleast_2d(values) for name, values in channels.items()}
        else:
            single = False
        if self.is_stateful:
            self._watch(state, episode_start)
        action, state = self._next(observation, state, episode_start)
        return (action[0] if single else action), state

    def _watch(self, state: Any, episode_start: Any) -> None:
        """Warn of calls without the state that this policy keeps."""
        lost = state is None and episode_start is None
        self._stateless_calls = self._stateless_calls + 1 if lost else 0
        if self._stateless_calls == 2:
            warnings.warn(
                "predict: found two calls in a row without a state, expected the one that the "
                "last call returned, for this policy keeps one: action, state = "
                "predict(observation, state, episode_start)",
                stacklevel=3,
            )

    def _next(
        self, observation: Any, state: Any, episode_start: Any
    ) -> tuple[NDArray[np.float32], Any]:
        action, following = self._act(observation, state)
        if state is None or episode_start is None:
            return action, following
        first = np.atleast_1d(np.asarray(episode_start, np.bool_))
        if first.shape != (len(action),):
            found = f"found shape {first.shape}, expected ({len(action)},)"
            raise ValueError(f"episode_start: {found}, one bool per environment")
        if first.any():
            begun, new = self._act(observation, None)
            action = _replaced(action, begun, first)
            pairs = zip(following, new, strict=True)
            following = tuple(_replaced(old, fresh, first) for old, fresh in pairs)
        return action, following

    def _channels(self, observation: Any) -> dict[str, NDArray[Any]]:
        """Channels that are read, as arrays, all of N environments or all of one.

        Raises:
            ValueError: If one is not there or has another shape.
        """
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
        # Tensors of PyTorch as well; those on a GPU or with a gradient say what to do.
        channels = {name: np.asarray(observation[name]) for name in self.reads}
        axes = channels[self.reads[0]].ndim
        for name, values in channels.items():
            if values.ndim != axes or axes not in (1, 2):
                found = f"found {name} of shape {values.shape}"
                raise ValueError(
                    f"observation: {found}, expected {expected}, or of one, each (...)"
                )
        return channels


def _replaced(old: NDArray[Any], new: NDArray[Any], rows: NDArray[np.bool_]) -> NDArray[Any]:
    """Values (N, ...) of `new` in these rows, of `old` in the others."""
    return np.where(rows.reshape(-1, *[1] * (old.ndim - 1)), new, old)


class RandomPolicy(ScriptedPolicy):
    """Uniform actions, the same whenever an observation is the same.

    They are drawn from the observation itself, so that an episode that is filmed alone is the one
    that was counted in a batch.
    """

    def __init__(self, seed: int = 0) -> None:
        def drawn(row: NDArray[Any]) -> NDArray[np.float32]:
            words = np.frombuffer(np.ascontiguousarray(row, np.float32).tobytes(), np.uint32)
            return np.random.default_rng([seed, *words]).uniform(-1, 1, 5).astype(np.float32)

        def act(observation: Any, state: Any) -> tuple[NDArray[np.float32], Any]:
            channels = observation if isinstance(observation, Mapping) else {"flat": observation}
            values = np.concatenate([np.asarray(each) for each in channels.values()], axis=-1)
            # Without rows of one environment, and so is its action.
            rows = values.reshape(-1, values.shape[-1])
            actions = np.stack([drawn(row) for row in rows])
            return actions.reshape(*values.shape[:-1], 5), state

        super().__init__(act)


def scripted(env_id: str) -> ScriptedPolicy:
    """The scripted policy of an environment.

    It reads a part of the default observation, as a dict (``obs="dict"``); ``reads`` of the policy
    names the channels. Those of GraspFragile, GraspSoft and InsertPeg keep a state (`is_stateful`).

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
    return ScriptedPolicy(module.act, module.READS, module.IS_STATEFUL)
