"""Trained agents, one per task: `load` returns one, which acts without torch.

``ruffini.agents.load("GraspLift").predict(observation)`` has Stable-Baselines3's signature;
``ruffini demo`` plays one. `ruffini.agents.sb3` writes agents, and converts them to models of
Stable-Baselines3 to continue their training.
"""

from __future__ import annotations

import difflib
from os import PathLike
from pathlib import Path

import gymnasium as gym

from ruffini.agents._agent import FORMAT, MOST_BYTES, SUFFIX, Agent, Card

__all__ = ["FORMAT", "MOST_BYTES", "Agent", "Card", "environment_id", "load", "names"]

_FOLDER = Path(__file__).parent


def names() -> list[str]:
    """Names of the agents that come with the package, such as ``GraspLift-v0``."""
    return sorted(file.stem for file in _FOLDER.glob(f"*{SUFFIX}"))


def load(name: str | PathLike[str]) -> Agent:
    """Load the agent of a task, or the one in a .safetensors file.

    Args:
        name: A task, in a form that `environment_id` accepts, or the path of a file.

    Raises:
        ValueError: If there is no such agent, or the file does not hold a readable one.
    """
    if Path(name).suffix == SUFFIX:
        return Agent.read(name)
    known = ", ".join(names()) or "none, for this build has no agents"
    expected = f"the path of a {SUFFIX} file or one of: {known}"
    try:
        found = environment_id(str(name)).split("/")[-1]
    except ValueError as error:
        raise ValueError(f"{error}; or {expected}") from None
    if found not in names():
        raise ValueError(f"agent: found none of {found}, expected {expected}")
    return Agent.read(_FOLDER / f"{found}{SUFFIX}")


def environment_id(task: str) -> str:
    """Id of an environment from ``GraspLift``, ``grasp-lift``, ``GraspLift-v0`` or the id itself.

    Raises:
        ValueError: If there is no such task.
    """
    ids = sorted(name for name in gym.registry if name.startswith("ruffini/"))
    tasks = [name.removeprefix("ruffini/").split("-v")[0] for name in ids]
    # A name without version stands for the newest version of the task.
    known = {_key(t): name for t, name in zip(tasks, ids, strict=True)}
    known |= {_key(name): name for name in ids}
    key = _key(task)
    if key in known:
        return known[key]
    expected = ", ".join(dict.fromkeys(tasks))
    near = difflib.get_close_matches(key, known, 1)
    hint = f" (nearest: {known[near[0]].split('/')[-1]})" if near else ""
    raise ValueError(f"task: found {task!r}, expected one of {expected}{hint}")


def _key(task: str) -> str:
    """Letters and digits of a task's name, in lower case."""
    bare = task.lower().removeprefix("ruffini:").removeprefix("ruffini/")
    return bare.replace("-", "").replace("_", "")
