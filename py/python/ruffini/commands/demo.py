"""``ruffini demo``: play the agent of a task."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym

from ruffini import video
from ruffini._spaces import check_count, check_seed
from ruffini.agents import Agent, environment_id, load
from ruffini.evaluation import FIRST_SEED, evaluate, line

_TASK = "GraspLift"
_EPISODES = {"ruffini/GraspSoft-v0": 15}
"""Default number of episodes of tasks whose presses are slow."""
_WIDTH = 30
"""Width of the progress bar."""


def add_to(commands: Any) -> None:
    """Add the subcommand to the parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "demo",
        help="watch the agent of a task",
        description="Plays the trained agent of a task on evaluation seeds and compares its "
        "success with what its card says.",
    )
    parser.add_argument(
        "task", nargs="?", help=f"GraspLift, grasp-lift or an id; {_TASK} if not given"
    )
    parser.add_argument("--agent", help=".safetensors file of another agent than the task's own")
    parser.add_argument(
        "--episodes", type=int, help="episodes, one a seed; 50 if not given, of GraspSoft 15"
    )
    parser.add_argument(
        "--seed", type=int, default=FIRST_SEED, help=f"the first seed; {FIRST_SEED} if not given"
    )
    parser.add_argument("--threads", type=int, help="threads; as many as cores if not given")
    parser.add_argument("--video", type=Path, help=".gif or .mp4 file for the first episodes")
    parser.add_argument(
        "--video-episodes", type=int, default=3, help="episodes in it; 3 if not given"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Play the agent and print its success rate.

    Raises:
        ValueError: If an option is invalid, or the agent is for another environment.
        SimulationError: If the video cannot be made.
    """
    agent = _agent(options.task, options.agent)
    if options.episodes is None:
        options.episodes = _EPISODES.get(agent.env_id, 50)
    for name in ("episodes", "video_episodes"):
        if getattr(options, name) < 1:
            found, flag = getattr(options, name), name.replace("_", "-")
            raise ValueError(f"{flag}: found {found}, expected at least 1")
    check_seed(options.seed)
    if options.threads is not None:
        check_count("threads", options.threads)
    if options.video is not None:
        video.check(options.video)
    limit = _check_environment(agent)
    card, settings = agent.card, agent.settings
    print(
        f"{agent.env_id}: {card['algorithm'].upper()}, {card['steps']:,} steps, "
        f"seed {card['seed']}; {options.episodes} episodes from seed {options.seed}"
    )
    result = evaluate(
        agent,
        agent.env_id,
        options.episodes,
        first_seed=options.seed,
        progress=_Bar(limit),
        num_threads=options.threads,
        **settings,
    )
    told = card["evaluation"]
    print(line("agent", result))
    print(line(f"its card, {told['episodes']} seeds", told))
    print(_verdict(result["interval"], told["interval"]))
    if options.video is not None:
        count = min(options.video_episodes, options.episodes)
        print(video.film(agent, options.video, range(options.seed, options.seed + count)))


def _agent(task: str | None, path: str | None) -> Agent:
    """Load the agent in a file, or that of a task; if both are given, they must match."""
    if path is None:
        return load(environment_id(_TASK if task is None else task))
    agent = load(path)
    if task is not None and environment_id(task) != agent.env_id:
        raise ValueError(
            f"{agent.name}: found one of {agent.env_id}, expected one of {environment_id(task)}"
        )
    return agent


def _check_environment(agent: Agent) -> int:
    """Check that agent and environment match; return the step limit of an episode."""
    try:
        envs = gym.make_vec(agent.env_id, **agent.settings)
    except (gym.error.Error, TypeError, ValueError) as error:
        raise ValueError(f"{agent.name}: {error}") from None
    agent.check(envs.single_observation_space)
    envs.close()
    limit = gym.spec(agent.env_id).max_episode_steps
    assert limit is not None, "every task has a limit"
    return int(agent.settings.get("max_episode_steps", limit))


def _verdict(found: Sequence[float], told: Sequence[float]) -> str:
    """Text that compares two confidence intervals of a success rate."""
    if found[1] < told[0]:
        return "less than its card says"
    return "more than its card says" if found[0] > told[1] else "as its card says"


class _Bar:
    """Progress bar on a terminal; elsewhere one line per quarter."""

    def __init__(self, limit: int) -> None:
        self._limit, self._shown = limit, ""

    def __call__(self, finished: int, episodes: int, steps: int) -> None:
        share = 1.0 if finished == episodes else min(steps / self._limit, 0.99)
        done = f"{finished} of {episodes} episodes"
        if sys.stderr.isatty():
            full = int(share * _WIDTH)
            bar = f"[{'#' * full}{'.' * (_WIDTH - full)}] {share:4.0%}  {done}"
            print(f"\r{bar}", end="\n" if share == 1.0 else "", file=sys.stderr, flush=True)
        elif (quarter := f"{25 * int(4 * share)} %") != self._shown:
            self._shown = quarter
            print(f"{quarter}, {done}", file=sys.stderr, flush=True)
