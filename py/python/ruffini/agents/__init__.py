"""Trained agents, one per task: `load` returns one, which acts without torch.

``ruffini.agents.load("GraspLift").predict(observation)`` takes what Stable-Baselines3's ``predict``
does, but is deterministic if not told otherwise; ``ruffini play`` plays an agent.
`ruffini.agents.training` trains them (``ruffini agent train``), `ruffini.agents.params` has the
hyper-parameters, and `ruffini.agents.sb3` converts models of Stable-Baselines3 to agents and back.
"""

from __future__ import annotations

import re
from os import PathLike
from pathlib import Path

import gymnasium as gym
import numpy as np

from ruffini._words import nearest
from ruffini.agents._agent import FORMAT, MOST_BYTES, SUFFIX, Agent, Card

__all__ = [
    "CHECKPOINT",
    "CHECKPOINT_AGENT",
    "FORMAT",
    "MOST_BYTES",
    "RUN",
    "SUFFIX",
    "Agent",
    "Card",
    "checkpoint",
    "environment_id",
    "first_seed",
    "last_checkpoint",
    "load",
    "names",
]

RUN = "run.json"
"""File of a training run with its parameters."""

CHECKPOINT = "checkpoint"
"""Folder of a training run with the files of its last checkpoint."""

CHECKPOINT_AGENT = f"agent{SUFFIX}"
"""File of a checkpoint that is an agent, not evaluated."""

_FOLDER = Path(__file__).parent


def names() -> list[str]:
    """Names of the agents that come with the package, such as ``GraspLift-v0``."""
    return sorted(file.stem for file in _FOLDER.glob(f"*{SUFFIX}"))


def load(name: str | PathLike[str]) -> Agent:
    """Load the agent of a task, that in a .safetensors file, or that of a training run.

    Args:
        name: A task, in a form that `environment_id` accepts, the path of a file, or the folder of
            a run, whose last checkpoint is loaded.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If there is no agent of that name, or the file does not hold one.
    """
    path = Path(name)
    if path.suffix == SUFFIX:
        return Agent.read(path)
    if (path / RUN).is_file():
        try:
            return Agent.read(checkpoint(path) / CHECKPOINT_AGENT)
        except FileNotFoundError:
            # The run was just replacing its checkpoint.
            return Agent.read(checkpoint(path) / CHECKPOINT_AGENT)
    known = ", ".join(names()) or "none, for this build has no agents"
    expected = f"the path of a {SUFFIX} file, the folder of a run, or one of: {known}"
    try:
        found = environment_id(str(name)).split("/")[-1]
    except ValueError as error:
        if path.is_file():
            raise ValueError(f"agent: found {path}, expected {expected}") from None
        if len(path.parts) > 1 or (path.parts and path.is_dir()):
            checkpoint(path)
        raise ValueError(f"{error}; or {expected}") from None
    if found not in names():
        raise ValueError(f"agent: found none of {found}, expected {expected}")
    return Agent.read(_FOLDER / f"{found}{SUFFIX}")


def checkpoint(run: str | PathLike[str]) -> Path:
    """Folder of the last checkpoint of a training run.

    Raises:
        ValueError: If there is no such run, or it has none yet.
    """
    path = Path(run)
    if not (path / RUN).is_file():
        near = nearest(str(path), [str(file.parent) for file in path.parent.glob(f"*/{RUN}")])
        raise ValueError(f"run: found none in {path}{near} expected the folder of a training run")
    found = last_checkpoint(path)
    if found is None:
        raise ValueError(f"run: found no checkpoint in {path}, expected one: it has just begun")
    return found


def last_checkpoint(folder: Path) -> Path | None:
    """Folder of the last checkpoint within a folder, if there is one.

    A run that is killed while it replaces its checkpoint leaves the one before as ``.old``.
    """
    folders = (folder / name for name in (CHECKPOINT, f"{CHECKPOINT}.old"))
    return next((found for found in folders if found.is_dir()), None)


def first_seed(seed: int, steps: int = 0) -> int:
    """Seed of the first environment of a run of that seed, after some steps; row i adds i.

    Runs of neighbouring seeds share no episodes, and none has those of an evaluation, whose seeds
    are below 2³².
    """
    drawn = int(np.random.SeedSequence([seed, steps]).generate_state(1)[0])
    return (1 << 32) + (drawn << 16)


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
    if re.fullmatch(r"[\w:.-]+/[\w:.-]+-v\d+", task) and not task.startswith("ruffini/"):
        raise ValueError(
            f"task: found {task!r}, expected a built-in one: {expected}; tasks of your own are for "
            "Python, with ruffini.evaluation.evaluate and ruffini.video.film"
        )
    raise ValueError(f"task: found {task!r}{nearest(task, tasks)} expected one of {expected}")


def _key(task: str) -> str:
    """Letters and digits of a task's name, in lower case."""
    bare = task.lower().removeprefix("ruffini:").removeprefix("ruffini/")
    return bare.replace("-", "").replace("_", "")
