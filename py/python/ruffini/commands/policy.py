"""Policies on the command line: ``trained``, ``scripted``, ``random``, an agent's file, a run."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import dataclass
from typing import Any

import gymnasium as gym

from ruffini._schema import TASKS
from ruffini._spaces import MOST_THREADS, check_count, check_seed
from ruffini._words import counted, nearest
from ruffini.agents import Agent, environment_id, load
from ruffini.evaluation import FIRST_SEED, Policy, evaluate
from ruffini.policies import RandomPolicy, scripted

WORDS = ("trained", "scripted", "random")
HELP = (
    "trained (the agent of the package), scripted, random, an agent's .safetensors file, or the "
    "folder of a training run"
)
TASK = "GraspLift"
_WIDTH = 30
"""Width of the progress bar."""


@dataclass(frozen=True)
class Chosen:
    """A policy and the environment in which it acts."""

    env_id: str
    policy: Policy
    settings: dict[str, Any]
    """Keyword arguments of the environment."""
    about: str
    """Description of the policy."""


def add_evaluation(parser: argparse.ArgumentParser, episodes: str) -> None:
    """Add the options of `evaluated` to a parser; `episodes` is the text on their number."""
    parser.add_argument("--episodes", type=int, help=f"episodes, one a seed; {episodes}")
    parser.add_argument(
        "--seed", type=int, default=FIRST_SEED, help=f"the first seed; {FIRST_SEED} if not given"
    )
    parser.add_argument("--threads", type=int, help="threads; as many as cores if not given")


def check_evaluation(options: argparse.Namespace) -> None:
    """Check the options of `add_evaluation`.

    Raises:
        ValueError: If a number is out of range.
    """
    if options.episodes is not None:
        check_count("episodes", options.episodes)
    check_seed(options.seed)
    if options.threads is not None:
        check_count("threads", options.threads, MOST_THREADS)


def settings(text: str | None) -> dict[str, Any]:
    """Parse keyword arguments of an environment, written as JSON.

    Raises:
        ValueError: If they are not an object of JSON.
    """
    try:
        given = json.loads(text or "{}")
    except ValueError:
        given = None
    if not isinstance(given, dict):
        example = '{"objects": ["cup"]}'
        raise ValueError(f"settings: found {text!r}, expected JSON such as '{example}'")
    return given


def observation_space(env_id: str, settings: dict[str, Any], whose: str) -> gym.Space[Any]:
    """Make an environment, and return the space of its observations.

    Raises:
        ValueError: If there is none of these settings; they are those of `whose` in the message.
    """
    try:
        envs = gym.make_vec(env_id, **settings)
    except (gym.error.Error, TypeError, ValueError) as error:
        raise ValueError(f"{whose}: {error}") from None
    envs.close()
    return envs.single_observation_space


def choose(task: str | None, name: str, changes: dict[str, Any]) -> Chosen:
    """Find the policy of that name, and check that it fits its environment.

    Args:
        task: A task; that of the agent if not given, and `TASK` if the policy has none.
        name: A word of `WORDS`, or what `ruffini.agents.load` accepts.
        changes: Keyword arguments of the environment in place of those of the agent.

    Raises:
        ValueError: If there is no such policy, or it does not fit the environment.
    """
    env_id = None if task is None else environment_id(task)
    if name in ("scripted", "random"):
        env_id = env_id or environment_id(TASK)
        if name == "scripted" and {"obs", "observation"} & changes.keys():
            raise ValueError("settings: the scripted policy reads the default observation alone")
        observation_space(env_id, changes, "settings")
        policy = scripted(env_id) if name == "scripted" else RandomPolicy()
        return Chosen(env_id, policy, changes, f"{name} policy")
    agent = _agent(env_id, name)
    if env_id not in (None, agent.env_id):
        raise ValueError(f"{agent.name}: found one of {agent.env_id}, expected one of {env_id}")
    settings = agent.settings | changes
    whose = "settings" if changes else agent.name
    agent.check(observation_space(agent.env_id, settings, whose))
    card = agent.card
    about = f"{card['algorithm'].upper()}, {card['steps']:,} steps, seed {card['seed']}"
    return Chosen(agent.env_id, agent, settings, about)


def _agent(env_id: str | None, name: str) -> Agent:
    if name == "trained":
        try:
            return load(env_id or TASK)
        except ValueError as error:
            raise ValueError(f"{error}; --policy scripted plays without one") from None
    try:
        return load(name)
    except ValueError as error:
        if not str(error).startswith("task: "):
            raise
        near = nearest(name, (*WORDS, *TASKS))
        raise ValueError(f"policy: found {name!r}{near} expected {HELP}") from None


def evaluated(chosen: Chosen, episodes: int, seed: int, threads: int | None) -> dict[str, Any]:
    """Print what is played, play it under a progress bar, and return the result."""
    about = f"{chosen.about}; {counted(episodes, 'episode')} from seed {seed}"
    print(f"{chosen.env_id}: {about}", flush=True)
    settings = {"num_threads": threads} | chosen.settings
    bar = Bar(chosen.env_id, settings)
    return evaluate(
        chosen.policy, chosen.env_id, episodes, first_seed=seed, progress=bar, **settings
    )


class Bar:
    """Progress bar on a terminal, elsewhere one line per quarter: episodes are stepped together."""

    def __init__(self, env_id: str, settings: dict[str, Any]) -> None:
        limit = settings.get("max_episode_steps") or gym.spec(env_id).max_episode_steps
        self._limit, self._shown = limit if limit and limit > 0 else None, -1

    def __call__(self, finished: int, episodes: int, steps: int) -> None:
        """Show how far the evaluation is; a callback as `ruffini.evaluation.ProgressCallback`."""
        share = 1.0 if finished == episodes else min(steps / (self._limit or math.inf), 0.99)
        ended = f"{finished} of {counted(episodes, 'episode')} ended"
        most = f" of at most {self._limit}" if self._limit else ""
        done = f"step {steps}{most}, {ended}"
        if sys.stderr.isatty():
            full = int(share * _WIDTH)
            bar = f"[{'#' * full}{'.' * (_WIDTH - full)}] {done}"
            print(f"\r{bar}", end="\n" if share == 1.0 else "", file=sys.stderr, flush=True)
        elif (quarter := int(4 * share)) != self._shown:
            self._shown = quarter
            print(done, file=sys.stderr, flush=True)
