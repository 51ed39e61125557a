"""Policies that are not learnt: a hand-written (scripted) one for each task, and a random one.

A policy has the ``predict`` of Stable-Baselines3 and acts on dict observations of N environments::

    policy, state = ruffini.policies.scripted("ruffini/GraspLift-v0"), None
    action, state = policy.predict(observation, state)

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
from ruffini._settings import nearest
from ruffini.policies._parts import part

__all__ = ["RandomPolicy", "ScriptedPolicy", "part", "scripted"]


class ScriptedPolicy:
    """Policy of a function of observations and state.

    Args:
        act: The function.
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

        Raises:
            ValueError: If the observation lacks a channel that the policy reads.
        """
        self._check(observation)
        return self._act(observation, state)

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
