"""Draws the learning curves of several seeds, by what is felt and seen, in one picture.

Use::

    python policies/plot_curves.py policies/runs/GraspLift-v0-ppo-*
    python policies/plot_curves.py --name HoldStill-v0-ppo runs/hold-touch-* runs/hold-none-*

    python policies/plot_curves.py --name HoldStill-v0-ppo      # again, from its JSON

Writes ``policies/results/<name>.json``, by default ``<environment>-<algorithm>``: each seed's
settings and curve, and its success over the fixed evaluation seeds under the settings that it was
trained with; and beside it the picture and the page of that.
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


def page(document: dict[str, Any], name: str) -> str:
    """The table of the runs, and what they are made of."""
    runs = document["runs"]
    first, head = runs[0], ["what is felt", "seed", "success", "95 % interval", "return", "minutes"]
    rows = [[seen(run), str(run["seed"]), *told(run["evaluation"])] for run in runs]
    rows = [[*row, f"{run['minutes']:.0f}"] for row, run in zip(rows, runs, strict=True)]
    for tactile, scripted in document["scripted"].items():
        rows.append([f"scripted, {tactile}", "", *told(scripted), ""])
    lines = [head, ["---", *["---:"] * 5], *rows]
    commits = sorted({commit for run in runs for commit in run["trained_by"]})
    return "\n".join(
        [
            f"# {first['env'].split('/')[-1]} by {first['algorithm'].upper()}",
            "",
            f"{max(run['curve'][-1]['steps'] for run in runs):,} steps, then "
            f"{first['evaluation']['episodes']} evaluation seeds without noise. Success, its "
            "interval (Wilson) and the mean return are of those; minutes are of training, beside "
            "other work.",
            "",
            *("| " + " | ".join(line) + " |" for line in lines),
            "",
            f"![learning curves]({name}.png)",
            "",
            f"Trained at {', '.join(commits)}, judged at {document['commit']}: ruffini "
            f"{document['ruffini']}, gymnasium {document['gymnasium']}, Python "
            f"{document['python']}, {document['cores']} cores ({document['machine']}).",
            "",
        ]
    )


def seen(run: dict[str, Any]) -> str:
    """What an agent is shown, in words."""
    settings = run["environment"]
    channels = ", ".join(settings.get("observation", ["as by default"]))
    return channels if run["tactile"] == "surrogate" else f"{channels}, tactile {run['tactile']}"


def told(evaluation: dict[str, Any]) -> list[str]:
    """Success, its interval and the return."""
    low, high = evaluation["interval"]
    success, interval = f"{evaluation['success']:.1%}", f"{low:.1%} to {high:.1%}"
    return [success, interval, f"{evaluation['return']:.1f}"]


def gathered(folders: list[Path]) -> dict[str, Any]:
    """The runs in the folders, evaluated, and the scripted policy under their settings.

    Raises:
        ValueError: If they are of several environments, or two are told apart by nothing.
    """
    runs = sorted(map(read, folders), key=lambda run: (run["kind"], run["seed"]))
    if len({run["env"] for run in runs}) > 1:
        raise ValueError("expected runs of one environment")
    # A scripted policy reads the usual observation.
    usual = [{k: v for k, v in run["environment"].items() if k != "observation"} for run in runs]
    settings = {run["tactile"]: chosen for run, chosen in zip(runs, usual, strict=True)}
    env_id = runs[0]["env"]
    scripted = {
        tactile: evaluate(load("scripted", env_id), env_id, EPISODES, **chosen)
        for tactile, chosen in settings.items()
    }
    success: dict[str, dict[int, float]] = {}
    for run in runs:
        seeds = success.setdefault(seen(run), {})
        if run["seed"] in seeds:
            raise ValueError(f"expected one run of seed {run['seed']} that sees {seen(run)}")
        seeds[run["seed"]] = run["evaluation"]["success"]
    return about_this_run() | {"success": success, "scripted": scripted, "runs": runs}


def main() -> None:
    """Reads and evaluates the runs, or what was told of them, draws and writes."""
    parser = argparse.ArgumentParser(description="Draw learning curves.")
    parser.add_argument("runs", nargs="*", type=Path, help="folders of runs, one a seed")
    parser.add_argument("--name", help="of the files that are written")
    arguments = parser.parse_args()
    missing = [str(folder) for folder in arguments.runs if not (folder / "run.json").is_file()]
    if missing:
        parser.error(f"no run in {', '.join(missing)}")
    if not arguments.runs and not arguments.name:
        parser.error("expected folders of runs, or the --name of what was drawn before")
    try:
        document = gathered(arguments.runs) if arguments.runs else None
    except ValueError as error:
        parser.error(str(error))
    RESULTS.mkdir(exist_ok=True)
    if document is None:
        name = arguments.name
        document = json.loads((RESULTS / f"{name}.json").read_text())
    else:
        first = document["runs"][0]
        name = arguments.name or f"{first['env'].split('/')[-1]}-{first['algorithm']}"
        (RESULTS / f"{name}.json").write_text(json.dumps(document, indent=1) + "\n")
    draw(document["runs"], document["scripted"], RESULTS / f"{name}.png")
    (RESULTS / f"{name}.md").write_text(page(document, name))
    print(page(document, name))


if __name__ == "__main__":
    main()
