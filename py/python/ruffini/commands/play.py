"""``ruffini play``: watch a trained, scripted or random policy and count its successes."""

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
from ruffini.evaluation import FIRST_SEED, Policy, evaluate, line
from ruffini.policies import RandomPolicy, scripted

_TASK = "GraspLift"
_EPISODES = {"ruffini/GraspSoft-v0": 15}
"""Default number of episodes of tasks whose presses are slow."""
_WIDTH = 30
"""Width of the progress bar."""


def add_to(commands: Any) -> None:
    """Add the subcommand to the parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "play",
        aliases=["demo"],
        help="watch a policy at a task: the trained agent, a scripted or a random one",
        description="Plays a policy on evaluation seeds and prints its success rate; that of a "
        "trained agent is compared with what its card says.",
    )
    parser.add_argument(
        "task", nargs="?", help=f"GraspLift, grasp-lift or an id; {_TASK} if not given"
    )
    parser.add_argument(
        "--policy",
        default="trained",
        help="trained (the task's own agent), scripted, random, or an agent's .safetensors file",
    )
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
    """Play the policy and print its success rate.

    Raises:
        ValueError: If an option is invalid, or the agent is for another environment.
        SimulationError: If the video cannot be made.
    """
    env_id, policy = _policy(options.task, options.policy)
    if options.episodes is None:
        options.episodes = _EPISODES.get(env_id, 50)
    for name in ("episodes", "video_episodes"):
        if getattr(options, name) < 1:
            found, flag = getattr(options, name), name.replace("_", "-")
            raise ValueError(f"{flag}: found {found}, expected at least 1")
    check_seed(options.seed)
    if options.threads is not None:
        check_count("threads", options.threads)
    if options.video is not None:
        video.check(options.video)
    agent = policy if isinstance(policy, Agent) else None
    settings = {} if agent is None else agent.settings
    about = f"{options.policy} policy"
    if agent is not None:
        _check_environment(agent)
        card = agent.card
        about = f"{card['algorithm'].upper()}, {card['steps']:,} steps, seed {card['seed']}"
    print(f"{env_id}: {about}; {options.episodes} episodes from seed {options.seed}")
    limit = settings.get("max_episode_steps", gym.spec(env_id).max_episode_steps or 0)
    result = evaluate(
        policy,
        env_id,
        options.episodes,
        first_seed=options.seed,
        progress=_Bar(limit),
        num_threads=options.threads,
        **settings,
    )
    print(line("agent" if agent is not None else options.policy, result))
    if agent is not None:
        told = agent.card["evaluation"]
        print(line(f"its card, {told['episodes']} seeds", told))
        print(_verdict(result["interval"], told["interval"]))
    if options.video is not None:
        count = min(options.video_episodes, options.episodes)
        seeds = range(options.seed, options.seed + count)
        print(video.film(policy, env_id, options.video, seeds, **settings))


def _policy(task: str | None, name: str) -> tuple[str, Policy]:
    """Id of the environment, and the policy that the name or file stands for."""
    if name in ("trained", "scripted", "random"):
        env_id = environment_id(_TASK if task is None else task)
        if name == "random":
            return env_id, RandomPolicy()
        if name == "scripted":
            return env_id, scripted(env_id)
        try:
            return env_id, load(env_id)
        except ValueError as error:
            raise ValueError(f"{error}; --policy scripted plays without one") from None
    if Path(name).suffix != ".safetensors":
        expected = "trained, scripted, random or an agent's .safetensors file"
        if (Path(name) / "run.json").is_file():
            expected += ": export the run first (policies/export_agent.py)"
        raise ValueError(f"policy: found {name}, expected {expected}")
    agent = load(name)
    if task is not None and environment_id(task) != agent.env_id:
        raise ValueError(
            f"{agent.name}: found one of {agent.env_id}, expected one of {environment_id(task)}"
        )
    return agent.env_id, agent


def _check_environment(agent: Agent) -> None:
    """Check that agent and environment match."""
    try:
        envs = gym.make_vec(agent.env_id, **agent.settings)
    except (gym.error.Error, TypeError, ValueError) as error:
        raise ValueError(f"{agent.name}: {error}") from None
    agent.check(envs.single_observation_space)
    envs.close()


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
