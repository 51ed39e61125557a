"""Draws the learning curves of several seeds.

Use::

    python policies/plot_curves.py policies/runs/GraspLift-v0-ppo-*

Writes ``policies/results/<environment>-<algorithm>.png`` and, beside it, the JSON that it shows:
each seed's curve and its success over the fixed evaluation seeds.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import matplotlib as mpl

from evaluate import TrainedPolicy, about_this_run, evaluate, load
from train import CHECKPOINT

mpl.use("Agg")
from matplotlib import pyplot as plt

RESULTS = Path(__file__).parent / "results"
EPISODES = 200


def read(folder: Path) -> dict[str, Any]:
    """A run's settings, curve and evaluation."""
    about: dict[str, Any] = json.loads((folder / "run.json").read_text())
    curve = json.loads((folder / CHECKPOINT / "curve.json").read_text())
    return about | {
        "curve": curve,
        "minutes": round(curve[-1]["seconds"] / 60, 2),
        "evaluation": evaluate(TrainedPolicy(folder), about["env"], EPISODES),
    }


def draw(runs: list[dict[str, Any]], yardstick: dict[str, Any], path: Path) -> None:
    """Success against steps and against minutes, one line a seed."""
    figure, (by_steps, by_minutes) = plt.subplots(1, 2, figsize=(9, 3.4), sharey=True)
    for run in runs:
        curve = run["curve"]
        success = [100 * point["success"] for point in curve]
        label = f"seed {run['seed']}: {100 * run['evaluation']['success']:.1f} % at the end"
        by_steps.plot([p["steps"] / 1e6 for p in curve], success, lw=1.4, label=label)
        by_minutes.plot([p["seconds"] / 60 for p in curve], success, lw=1.4)
    for axes, title in ((by_steps, "million environment steps"), (by_minutes, "minutes")):
        axes.axhline(100 * yardstick["success"], color="0.4", ls="--", lw=1)
        axes.axhline(90, color="0.7", ls=":", lw=1)
        axes.set(xlabel=title, ylim=(-2, 103))
        axes.grid(alpha=0.3)
    by_steps.set_ylabel("success in training (%)")
    by_steps.legend(loc="lower right", fontsize=8)
    by_minutes.text(
        0.45, 0.05, "dashed: scripted policy", transform=by_minutes.transAxes, fontsize=8
    )
    figure.suptitle(f"{runs[0]['env']}, {runs[0]['algorithm'].upper()}, {len(runs)} seeds")
    figure.tight_layout()
    figure.savefig(path, dpi=150)


def main() -> None:
    """Reads the runs, evaluates them, draws and writes."""
    parser = argparse.ArgumentParser(description="Draw learning curves.")
    parser.add_argument("runs", nargs="+", type=Path, help="folders of runs, one a seed")
    arguments = parser.parse_args()
    missing = [str(folder) for folder in arguments.runs if not (folder / "run.json").is_file()]
    if missing:
        parser.error(f"no run in {', '.join(missing)}")
    runs = sorted((read(folder) for folder in arguments.runs), key=lambda run: run["seed"])
    yardstick = evaluate(load("scripted", runs[0]["env"]), runs[0]["env"], EPISODES)
    RESULTS.mkdir(exist_ok=True)
    name = f"{runs[0]['env'].split('/')[-1]}-{runs[0]['algorithm']}"
    draw(runs, yardstick, RESULTS / f"{name}.png")
    document = about_this_run() | {"scripted": yardstick, "runs": runs}
    (RESULTS / f"{name}.json").write_text(json.dumps(document, indent=1) + "\n")
    for run in runs:
        evaluation = run["evaluation"]
        print(f"seed {run['seed']}: {evaluation['success']:.1%} {evaluation['interval']}", end="")
        print(f" after {run['minutes']} min")


if __name__ == "__main__":
    main()
