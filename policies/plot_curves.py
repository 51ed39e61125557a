"""Draws the learning curves of several seeds, by what is felt and seen, in one picture.

Use::

    python policies/plot_curves.py policies/runs/GraspLift-v0-ppo-*
    python policies/plot_curves.py --name HoldStill-v0-ppo runs/hold-touch-* runs/hold-none-*

Writes ``policies/results/<name>.png``, by default ``<environment>-<algorithm>``, and, beside it,
the JSON that it shows: each seed's settings and curve, and its success over the fixed evaluation
seeds under the settings that it was trained with.
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
STYLES = ("-", "--", ":")


def read(folder: Path) -> dict[str, Any]:
    """A run's settings, curve and evaluation."""
    about: dict[str, Any] = json.loads((folder / "run.json").read_text())
    curve = json.loads((folder / CHECKPOINT / "curve.json").read_text())
    policy = TrainedPolicy(folder)
    tactile, seen = (about["environment"].get(name) for name in ("tactile", "observation"))
    channels = [f"only {' '.join(seen)}"] if seen else []
    return about | {
        "tactile": tactile or "surrogate",
        "kind": ", ".join([tactile or "surrogate", *channels]),
        "curve": curve,
        "minutes": round(curve[-1]["seconds"] / 60, 2),
        "evaluation": evaluate(policy, about["env"], EPISODES, **about["environment"]),
    }


def draw(runs: list[dict[str, Any]], scripted: dict[str, dict[str, Any]], path: Path) -> None:
    """Success and return against steps, one line a seed, one colour a kind of run."""
    figure, (above, below) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    kinds = sorted({run["kind"] for run in runs})
    colours = {kind: f"C{i}" for i, kind in enumerate(kinds)}
    for run in runs:
        curve, evaluation = run["curve"], run["evaluation"]
        label = f"{run['kind']}, seed {run['seed']}: {100 * evaluation['success']:.1f} %, "
        label += f"return {evaluation['return']:.1f}, {run['minutes']:.0f} min"
        style = {"color": colours[run["kind"]], "ls": STYLES[run["seed"] % 3], "lw": 1.3}
        steps = [point["steps"] / 1e6 for point in curve]
        above.plot(steps, [100 * point["success"] for point in curve], label=label, **style)
        below.plot(steps, [point["return"] for point in curve], **style)
    for tactile, told in scripted.items():
        style = {"color": colours.get(tactile, "black"), "ls": (0, (1, 3)), "lw": 1}
        above.axhline(100 * told["success"], **style)
        below.axhline(told["return"], **style)
    above.set(xlabel="million steps", ylabel="success in training (%)", ylim=(-2, 103))
    below.set(xlabel="million steps", ylabel="return in training")
    for axes in (above, below):
        axes.grid(alpha=0.3)
    figure.suptitle(
        f"{runs[0]['env']}, {runs[0]['algorithm'].upper()}; widely dotted: scripted", fontsize=9
    )
    figure.legend(loc="outside lower center", ncols=min(len(kinds), 3), fontsize=6)
    figure.savefig(path, dpi=150)


def main() -> None:
    """Reads the runs, evaluates them, draws and writes."""
    parser = argparse.ArgumentParser(description="Draw learning curves.")
    parser.add_argument("runs", nargs="+", type=Path, help="folders of runs, one a seed")
    parser.add_argument("--name", help="of the files that are written")
    arguments = parser.parse_args()
    missing = [str(folder) for folder in arguments.runs if not (folder / "run.json").is_file()]
    if missing:
        parser.error(f"no run in {', '.join(missing)}")
    runs = sorted(map(read, arguments.runs), key=lambda run: (run["kind"], run["seed"]))
    if len({run["env"] for run in runs}) > 1:
        parser.error("expected runs of one environment")
    # A scripted policy reads the usual observation.
    usual = [{k: v for k, v in run["environment"].items() if k != "observation"} for run in runs]
    settings = {run["tactile"]: chosen for run, chosen in zip(runs, usual, strict=True)}
    env_id = runs[0]["env"]
    scripted = {
        tactile: evaluate(load("scripted", env_id), env_id, EPISODES, **chosen)
        for tactile, chosen in settings.items()
    }
    RESULTS.mkdir(exist_ok=True)
    name = arguments.name or f"{env_id.split('/')[-1]}-{runs[0]['algorithm']}"
    draw(runs, scripted, RESULTS / f"{name}.png")
    document = about_this_run() | {"scripted": scripted, "runs": runs}
    (RESULTS / f"{name}.json").write_text(json.dumps(document, indent=1) + "\n")
    for run in runs:
        evaluation = run["evaluation"]
        print(f"{run['kind']}, seed {run['seed']}: {evaluation['success']:.1%} ", end="")
        print(f"{evaluation['interval']}, return {evaluation['return']}", end="")
        print(f" after {run['minutes']} min")


if __name__ == "__main__":
    main()
