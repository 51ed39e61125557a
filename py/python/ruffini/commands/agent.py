"""``ruffini agent``: training, evaluation and export of agents."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from ruffini._settings import read_json
from ruffini._spaces import (
    MOST_ENVIRONMENTS,
    MOST_STEPS,
    MOST_THREADS,
    check_count,
    check_writable,
    replace_file,
)
from ruffini.agents import (
    CHECKPOINT_AGENT,
    RUN,
    SUFFIX,
    Agent,
    checkpoint,
    environment_id,
    last_checkpoint,
    load,
)
from ruffini.commands.policy import (
    HELP,
    TASK,
    Bar,
    add_evaluation,
    check_evaluation,
    choose,
    evaluated,
    observation_space,
    settings,
)
from ruffini.evaluation import about_this_run, line

_SETTINGS = "settings of the environment, as JSON"


def add_to(commands: Any) -> None:
    """Add the subcommand to the parser."""
    agent: argparse.ArgumentParser = commands.add_parser(
        "agent", help="train, evaluate or export an agent"
    )
    parts = agent.add_subparsers(metavar="train|evaluate|export", required=True)
    _add_train(parts)
    _add_evaluate(parts)
    _add_export(parts)


def _add_train(parts: Any) -> None:
    parser = parts.add_parser(
        "train",
        help="train an agent by PPO",
        description="Trains an agent with the hyper-parameters of its task, which are listed in "
        "ruffini.agents.params. A run is a folder with checkpoints; stopped with Ctrl-C or "
        "SIGTERM, it goes on with --resume. `ruffini play --policy RUN` shows the agent of the "
        "last checkpoint, at any time.",
    )
    parser.add_argument("task", help="a task, such as GraspLift or its id")
    parser.add_argument("--seed", type=int, help="seed of the run; 0 if not given")
    parser.add_argument(
        "--steps",
        type=int,
        help="environment steps in all, rounded to whole rollouts; those of the task if not given",
    )
    parser.add_argument(
        "--n-envs", type=int, help="environments stepped together; those of the task if not given"
    )
    parser.add_argument("--threads", type=int, help="threads; as many as cores if not given")
    parser.add_argument("--settings", help=f"{_SETTINGS}; may change when a run goes on")
    parser.add_argument("--out", type=Path, help="folder of the run; runs/TASK-SEED if not given")
    begin = parser.add_mutually_exclusive_group()
    begin.add_argument(
        "--resume",
        action="store_true",
        help="go on from the last checkpoint; a run that has none is begun, and one that has its "
        "steps is left as it is",
    )
    begin.add_argument(
        "--from",
        dest="begin",
        metavar="AGENT",
        help="train this agent further: one of the package, a file, or the folder of a run",
    )
    parser.set_defaults(run=_train)


def _add_evaluate(parts: Any) -> None:
    parser = parts.add_parser(
        "evaluate",
        help="success rate of a policy over fixed seeds",
        description="Success rate with its 95 % interval, successes by object, and what ended "
        "episodes early. Task and settings are those of the agent.",
    )
    parser.add_argument("policy", help=f"{HELP}, or a task's name for its agent")
    parser.add_argument("--task", help=f"for scripted and random; {TASK} if not given")
    add_evaluation(parser, "200 if not given")
    parser.add_argument("--settings", help=f"{_SETTINGS}, in place of the agent's")
    parser.add_argument("--json", type=Path, help="file for the result")
    parser.set_defaults(run=_evaluate)


def _add_export(parts: Any) -> None:
    parser = parts.add_parser(
        "export",
        help="write a training run as an agent's file",
        description="Evaluates the last checkpoint of a run and writes it as a file, with a card "
        "that says how it was trained and how well it does. It acts without PyTorch.",
    )
    parser.add_argument("folder", metavar="run", help="folder of the run")
    parser.add_argument("--out", type=Path, required=True, help=f"the {SUFFIX} file")
    parser.add_argument(
        "--episodes", type=int, default=200, help="evaluation episodes; 200 if not given"
    )
    parser.set_defaults(run=_export)


def _train(options: argparse.Namespace) -> None:
    env_id = environment_id(options.task)
    limits = {"steps": MOST_STEPS, "n_envs": MOST_ENVIRONMENTS, "threads": MOST_THREADS}
    given = {name: getattr(options, name) for name in limits}
    for name, most in limits.items():
        if given[name] is not None:
            check_count(name.replace("_", "-"), given[name], most)
    seed = 0 if options.seed is None else options.seed
    if not 0 <= seed < 2**32:
        raise ValueError(f"seed: found {seed}, expected a whole number from 0 below 2**32")
    changes = settings(options.settings)
    folder = options.out or Path("runs", f"{env_id.split('/')[-1]}-{seed}")
    if last_checkpoint(folder) is not None and not options.resume:
        raise ValueError(f"out: {folder} holds a run: give --resume to go on, or another --out")
    agent = load(options.begin) if options.begin is not None else None
    # Jobs of a queue are submitted again as they were, whether they have begun, ended or neither.
    resumes = options.resume and last_checkpoint(folder) is not None
    if resumes:
        agent = Agent.read(checkpoint(folder) / CHECKPOINT_AGENT)
        if agent.env_id != env_id:
            raise ValueError(f"task: found {env_id}, expected {agent.env_id}, that of {folder}")
        about = read_json(folder / RUN)
        begun = about.get("seed", options.seed)
        if options.seed not in (None, begun):
            raise ValueError(f"seed: found {seed}, expected {begun}, that of {folder}")
        done = agent.card["steps"] - about.get("steps_before", 0)
        if options.steps is None and done >= about.get("params", {}).get("steps", MOST_STEPS + 1):
            print(f"{folder}: has its {done:,} steps")
            return
    elif options.resume:
        print(f"{folder}: nothing to go on with, a new run")
    kept = {} if agent is None else agent.settings
    space = observation_space(env_id, kept | changes, "settings")
    if agent is not None:
        agent.check(space)
    try:
        from ruffini.agents import training
    except ImportError as error:
        needed = 'pip install "ruffini[train]"'
        raise ValueError(f"training: found no {error.name}: {needed}") from None
    folder.mkdir(parents=True, exist_ok=True)
    print(f"{env_id}: PPO, in {folder}", flush=True)
    try:
        if resumes:
            training.resume(folder, settings=changes, **given)
        else:
            training.train(env_id, seed, folder, settings=changes, agent=agent, **given)
    except KeyboardInterrupt:
        if last_checkpoint(folder) is not None:
            print(f"\n{folder}: --resume goes on from the last checkpoint", file=sys.stderr)
        raise
    print(f"ruffini play --policy {folder} shows the agent")


def _evaluate(options: argparse.Namespace) -> None:
    check_evaluation(options)
    if options.json is not None:
        check_writable("json", options.json)
    chosen = choose(options.task, options.policy, settings(options.settings))
    episodes = 200 if options.episodes is None else options.episodes
    result = evaluated(chosen, episodes, options.seed, options.threads)
    name = Path(options.policy).name
    print(line(name, result))
    for thing, (good, of) in result["by_object"].items():
        print(f"  {thing:<22} {good:4d} of {of}")
    for reason, count in result["endings"].items():
        print(f"  ended by {reason:<13} {count:4d}")
    if options.json is not None:
        about = {"policy": name, "settings": chosen.settings}
        document = about | result | about_this_run()
        replace_file(options.json, json.dumps(document, indent=1) + "\n")


def _export(options: argparse.Namespace) -> None:
    if options.out.suffix != SUFFIX:
        raise ValueError(f"out: found {options.out}, expected a {SUFFIX} file")
    check_count("episodes", options.episodes)
    check_writable("out", options.out)
    agent = Agent.read(checkpoint(options.folder) / CHECKPOINT_AGENT)
    agent.evaluate(options.episodes, Bar(agent.env_id, agent.settings))
    agent.write(options.out)
    print(line("agent", agent.card["evaluation"]))
    print(f"{options.out}: {options.out.stat().st_size} bytes")
