"""``ruffini play``: watch a trained, scripted or random policy and count its successes."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ruffini import video
from ruffini._core import CAMERAS
from ruffini._spaces import Renderer, check_count
from ruffini._words import counted
from ruffini.agents import Agent
from ruffini.commands.policy import HELP, TASK, add_evaluation, check_evaluation, choose, evaluated
from ruffini.evaluation import line

_EPISODES = {"ruffini/GraspSoft-v0": 15}
"""Default number of episodes of tasks whose presses are slow."""


def add_to(commands: Any) -> None:
    """Add the subcommand to the parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "play",
        help="watch a policy at a task: the trained agent, a scripted or a random one",
        description="Plays a policy on evaluation seeds and prints its success rate; that of a "
        "trained agent is compared with what its card says.",
    )
    parser.add_argument(
        "task", nargs="?", help=f"a task, such as GraspLift or its id; {TASK} if not given"
    )
    parser.add_argument("--policy", default="trained", help=HELP)
    add_evaluation(parser, "50 if not given, of GraspSoft 15")
    parser.add_argument("--video", type=Path, help=".gif or .mp4 file for the first episodes")
    parser.add_argument(
        "--video-episodes", type=int, default=3, help="episodes in it; 3 if not given"
    )
    parser.add_argument("--camera", default="corner", help=f"{', '.join(CAMERAS)}")
    parser.add_argument(
        "--size", metavar="WxH", help="pixels of a picture; 320x240 for .gif, 640x480 for .mp4"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Play the policy and print its success rate.

    Raises:
        ValueError: If an option is invalid, or the agent is for another environment.
        SimulationError: If the video cannot be made.
    """
    check_evaluation(options)
    check_count("video-episodes", options.video_episodes)
    if options.video is not None:
        video.check(options.video)
    picture = _picture(options.camera, options.size)
    chosen = choose(options.task, options.policy, {})
    episodes = options.episodes
    if episodes is None:
        episodes = _EPISODES.get(chosen.env_id, 50)
    result = evaluated(chosen, episodes, options.seed, options.threads)
    agent = chosen.policy if isinstance(chosen.policy, Agent) else None
    print(line("agent" if agent is not None else options.policy, result))
    if agent is not None and (stated := agent.card["evaluation"]):
        print(line(f"its card, {counted(stated['episodes'], 'seed')}", stated))
        print(_verdict(result["interval"], stated["interval"]))
    if options.video is not None:
        count = min(options.video_episodes, episodes)
        seeds = range(options.seed, options.seed + count)
        made = chosen.policy, chosen.env_id, options.video, seeds
        print(video.film(*made, **chosen.settings | picture))


def _picture(camera: str, size: str | None) -> dict[str, Any]:
    """Keyword arguments of an environment for its pictures.

    Raises:
        ValueError: If there is no such camera or size.
    """
    picture: dict[str, Any] = {"camera": camera}
    if size is not None:
        found = re.fullmatch(r"(\d+)x(\d+)", size)
        if found is None:
            raise ValueError(f"size: found {size!r}, expected WxH in pixels, such as 640x480")
        picture |= {"width": int(found[1]), "height": int(found[2])}
    Renderer("rgb_array", **{"width": 640, "height": 480} | picture)
    return picture


def _verdict(found: Sequence[float], stated: Sequence[float]) -> str:
    """Text that compares two confidence intervals of a success rate."""
    if found[1] < stated[0]:
        return "less than its card says"
    return "more than its card says" if found[0] > stated[1] else "as its card says"
