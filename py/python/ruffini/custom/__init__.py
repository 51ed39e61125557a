"""Tasks of one's own: reward, endings, success, starts and observations in Python.

Their physics are those of a built-in task.

A task is a class whose methods compute arrays over N environments at once. The same class makes a
single environment (N = 1), a vector environment, and one for Stable-Baselines3::

    class Snug(ruffini.custom.Task):
        base = "GraspLift"
        terms = {"lift": 0.8, "snug": 0.2}

        def reward(self, state):
            force = state.part("proprio", "normal force of each pad").min(axis=1)
            return {"lift": state.base_terms["lift"], "snug": np.exp(-((force - 3.0) ** 2))}

    ruffini.custom.register("me/Snug-v0", Snug)
    env = gymnasium.make("me/Snug-v0", objects="cup")
    envs = gymnasium.make_vec("me/Snug-v0", num_envs=64)
"""

from __future__ import annotations

import gymnasium as gym

from ruffini._schema import TASKS
from ruffini._single import NativeEnv
from ruffini._spaces import NO_LIMIT, check_count
from ruffini._vector import NativeVectorEnv
from ruffini.custom._batch import Custom
from ruffini.custom._checks import check
from ruffini.custom._task import Draws, State, Task

__all__ = ["CustomEnv", "CustomVectorEnv", "Draws", "State", "Task", "register"]


class CustomEnv(Custom, NativeEnv):
    """One environment of a :class:`Task`; arguments as of the base's environment.

    ``state`` and ``set_state`` are an error with a task that has ``start``, ``draw`` or
    ``observe``: it keeps numbers of its own.

    Raises:
        TypeError: If a setting is unknown.
        ValueError: If `task` is no task, or a setting is of the wrong type or out of range.
    """


class CustomVectorEnv(Custom, NativeVectorEnv):
    """Many environments of a :class:`Task` stepped together; arguments as of the base's.

    ``state`` and ``set_state`` are an error with a task that has ``start``, ``draw`` or
    ``observe``: it keeps numbers of its own.

    Raises:
        TypeError: If a setting is unknown.
        ValueError: If `task` is no task, or a setting is of the wrong type or out of range.
    """


def register(env_id: str, task: type[Task], max_episode_steps: int | None = None) -> None:
    """Register a task with Gymnasium, for ``make``, ``make_vec`` and Stable-Baselines3.

    Args:
        env_id: Id, such as ``"me/Snug-v0"``.
        task: The class.
        max_episode_steps: Steps after which an episode is truncated; the base's if not given.

    Raises:
        ValueError: If `task` is no task.
    """
    check(task)
    if max_episode_steps is not None:
        check_count("max_episode_steps", max_episode_steps, NO_LIMIT)
    steps = task.settings.get("max_episode_steps", TASKS[task.base]["max_episode_steps"])
    gym.register(
        id=env_id,
        entry_point=CustomEnv,  # type: ignore[arg-type]
        vector_entry_point=CustomVectorEnv,  # type: ignore[arg-type]
        max_episode_steps=max_episode_steps or steps,
        kwargs={"task": task},
    )
