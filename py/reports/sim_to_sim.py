"""Policies whose touch is that of the network, played with finite elements instead, two hours.

Agents learn with ``tactile="surrogate"``. If they had learnt to use its errors, or the errors
misled them, they would do worse with finite elements. Every policy with soft tactile pads plays the
same evaluation seeds with both models: an episode has the same object, friction and start, and only
the model of the presses differs. --quick plays two seeds of one task.
"""

from __future__ import annotations

import math
import time
from argparse import ArgumentParser, Namespace
from collections import Counter
from typing import Any

import numpy as np

from engine import Rows, run
from paired import RESAMPLED, mcnemar, mean_with_interval, paired_interval
from ruffini.evaluation import FIRST_SEED, wilson
from sim_to_sim_cases import DRAWN, MODELS, UNSOLVED, episode
from sim_to_sim_figure import figure
from sim_to_sim_page import page, summary

__all__ = ["figure", "make", "options", "page"]

ONE_THREAD = True
MADE_OF = ["env-core", "py/src"]
MADE_OF += [
    f"py/reports/{name}.py" for name in ("sim_to_sim", "sim_to_sim_cases", "network_slip", "paired")
]
MADE_OF += ["py/python/ruffini/agents", "py/python/ruffini/policies"]
PLAYED = (
    ("HoldStill", "agent"),
    ("GraspLift", "agent"),
    ("GraspFragile", "agent"),
    ("InsertPeg", "agent"),
    ("GraspFragile", "scripted"),
    ("InsertPeg", "scripted"),
    ("HoldStill", "scripted"),
)
"""Tasks with the policies that play them, the most wanted first."""
QUICK = ("GraspFragile", "agent")
SEEDS, BLOCK = 50, 10
"""Seeds of a policy, and how many of it are played before the next policy's turn."""
SHOWN = 10
"""Seeds of HoldStill that the agent plays with the network's slip, too."""
COLUMNS = ("key", "object", "success", "return", "ending", "press_error", "restarts", "steps")
COLUMNS += ("seconds", "grip")
"""Columns that are kept of each episode."""


def options(parser: ArgumentParser) -> None:
    """Adds options: number of seeds, time."""
    parser.add_argument("--seeds", type=int, default=SEEDS, help="seeds of each policy")
    parser.add_argument("--minutes", type=float, default=math.inf, help="then no more episodes")


def make(options: Namespace) -> dict[str, Any]:
    """Episodes by blocks of seeds, so that a run that is stopped has some of every policy."""
    played, count = ((QUICK,), 2) if options.quick else (PLAYED, options.seeds)
    rows = Rows.of(
        "sim_to_sim", options, MADE_OF, {"first seed": FIRST_SEED, "resamples": RESAMPLED}
    )
    end = time.monotonic() + 60 * options.minutes
    for first in range(0, count, BLOCK):
        for task, policy in played:
            for seed in range(FIRST_SEED + first, FIRST_SEED + min(first + BLOCK, count)):
                if time.monotonic() < end:
                    asked = {
                        f"{task}/{policy}/{seed}/{model}": (episode, task, policy, seed, model)
                        for model in MODELS
                    }
                    run(rows, asked)
    asked = {
        f"slip/{seed}/{model}": (episode, "HoldStill", "agent", seed, model, True)
        for seed in range(FIRST_SEED, FIRST_SEED + (0 if options.quick else min(SHOWN, count)))
        for model in MODELS
        if time.monotonic() < end
    }
    run(rows, asked)
    found = {f"{task} {policy}": pairs(rows, task, policy) for task, policy in played}
    report = rows.header | {
        "note": options.note,
        "wanted": count,
        "policies": {name: compared(some) for name, some in found.items() if some},
        "slip": {
            row["key"]: kept(row) | {"missed": row["missed"]} for row in rows if is_shown(row)
        },
        "rows": [kept(row) for row in rows if not is_shown(row)],
    }
    return report | {"shown": summary(report)}


def is_shown(row: dict[str, Any]) -> bool:
    """Returns whether the network's slip was shown in an episode."""
    return row["key"].startswith("slip/")


def kept(row: dict[str, Any]) -> dict[str, Any]:
    """Columns of an episode that are kept."""
    return {name: row[name] for name in COLUMNS}


def pairs(rows: Rows, task: str, policy: str) -> list[dict[str, dict[str, Any]]]:
    """Rows by model of each seed that was played with both.

    Raises:
        RuntimeError: If the same seed drew two different episodes.
    """
    by_seed: dict[str, dict[str, Any]] = {}
    for row in rows:
        *of, seed, model = row["key"].split("/")
        if of == [task, policy]:
            by_seed.setdefault(seed, {})[model] = row
    whole = [pair for pair in by_seed.values() if len(pair) == len(MODELS)]
    for pair in whole:
        if any(pair["surrogate"][name] != pair["fem"][name] for name in DRAWN):
            raise RuntimeError(f"{pair['fem']['key']}: another episode than with the network")
    return whole


def compared(some: list[dict[str, dict[str, Any]]]) -> dict[str, Any]:
    """Results of a policy with both models, and their differences, finite elements less network."""
    solved = [pair for pair in some if all(row["ending"] != UNSOLVED for row in pair.values())]
    by_model = {model: alone([pair[model] for pair in some]) for model in MODELS}
    fewer = differences(solved) if 0 < len(solved) < len(some) else None
    return by_model | differences(some) | {"solved": fewer}


def differences(some: list[dict[str, dict[str, Any]]]) -> dict[str, Any]:
    """Number of seeds, and the differences of success and return."""
    returns = [pair["fem"]["return"] - pair["surrogate"]["return"] for pair in some]
    return {"seeds": len(some), "success": won(some), "return": mean_with_interval(returns)}


def alone(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Results of a policy with one model."""
    low, high = wilson(sum(row["success"] for row in rows), len(rows))
    names = rows[0]["terms"]
    return {
        "success": float(np.mean([row["success"] for row in rows])),
        "interval": [low, high],
        "return": float(np.mean([row["return"] for row in rows])),
        "outcomes": dict(Counter(outcome(row) for row in rows)),
        "press errors": dict(Counter(r["press_error"] for r in rows if r["ending"] == UNSOLVED)),
        "restarts": sum(row["restarts"] for row in rows),
        "steps": sum(row["steps"] for row in rows),
        "steps_per_second": sum(r["steps"] for r in rows) / sum(r["seconds"] for r in rows),
        "reset_seconds": float(np.mean([row["reset_seconds"] for row in rows])),
        "terms": {name: float(np.mean([row["terms"][name] for row in rows])) for name in names},
        "grip": float(np.mean([row["grip"] for row in rows])),
    }


def outcome(row: dict[str, Any]) -> str:
    """Outcome of an episode: success, the name of its ending, or that its time was up."""
    return "success" if row["success"] else row["ending"] or "time_up"


def won(some: list[dict[str, dict[str, Any]]]) -> dict[str, Any]:
    """Seeds won with both models, one and none, and the difference of success with its interval."""
    counts = Counter((pair["fem"]["success"], pair["surrogate"]["success"]) for pair in some)
    both, fem, network, neither = (
        counts[won] for won in ((True, True), (True, False), (False, True), (False, False))
    )
    low, high = paired_interval(both, fem, network, neither)
    return {
        "both": both,
        "only fem": fem,
        "only surrogate": network,
        "neither": neither,
        "difference": (fem - network) / len(some),
        "interval": [low, high],
        "p": mcnemar(fem, network),
    }
