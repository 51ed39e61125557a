"""The networks of pads by seed and size: makes networks.json and networks.md.

    python tests/reports/networks.py                           the page, from networks.json
    python tests/reports/networks.py --data SET --runs FOLDER  trains first what FOLDER lacks

Trained by `ruffini train` on what `ruffini dataset generate SET --config
tests/reference/indentations.toml` makes, 15 minutes on two threads each; a run that was stopped
goes on. ``--sizes`` adds other widths. ``--papers GRASPS`` trains the paper's networks, too, which
are for `pareto.py` and not on this page, on what `ruffini dataset generate GRASPS --grasps 10
--frames 10` makes.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import tomllib
from kept import table

HERE = Path(__file__).resolve().parent
ROUNDS = ["--down", "1", "1", "1", "--up", "1", "1"]
RECIPE = ["--split", "presses", "--epochs", "80", *ROUNDS]
SEEDED = {f"pads-{seed}": [*RECIPE, "--width", "32", "--seed", str(seed)] for seed in range(3)}
"""Options of `ruffini train` by run: the shipped network and two more seeds of it."""
SIZED = {f"pads{width}-0": [*RECIPE, "--width", str(width)] for width in (16, 48)}
"""The same at other widths."""
RUNS = SEEDED | SIZED
TEN_MINUTES = ["--seconds", "600", "--batch", "1"]
PAPERS = {
    "paper-baseline": ["--variant", "baseline", "--width", "16", "--rounds", "4"],
    "paper-a": ["--variant", "a", "--width", "16", "--rounds", "4"],
    "paper-b-wide": ["--variant", "b", "--width", "32", "--rounds", "4"],
    "paper-b-long": ["--variant", "b", "--width", "16", "--rounds", "8"],
}
"""The same for the paper's networks."""
ERRORS = {"displacement": "u", "stress": "σ", "peak": "σ at the peak", "force": "net force"}


def train(data: Path, runs: Path, options: dict[str, list[str]]) -> None:
    """Trains what has no card yet."""
    for name, chosen in options.items():
        if not (runs / name / "card.toml").exists():
            command = [sys.executable, "-m", "ruffini", "train", str(data), str(runs / name)]
            subprocess.run([*command, *chosen], check=True)


def gathered(runs: Path, before: dict[str, Any]) -> dict[str, Any]:
    """The cards of the runs; `before` has those of runs that the folder lacks."""
    cards = {name: runs / name / "card.toml" for name in RUNS}
    found = {name: tomllib.loads(f.read_text()) for name, f in cards.items() if f.exists()}
    return {name: (before | found)[name] for name in RUNS if name in before | found}


def markdown(report: dict[str, Any]) -> str:
    """Data, spread over seeds, and a table of all runs."""
    report = {name: card for name, card in report.items() if name in RUNS}
    title = "# The network of pads by seed and size"
    if not report:
        return f"{title}\n\nNo run is on record.\n"
    data = next(iter(report.values()))["data"]
    (learnt, frames), (judged, held_out) = data["train"], data["test"]
    parts = [
        title,
        f"Trained on {frames:,} frames of {learnt} drawn indenters and judged on {held_out:,} "
        f"frames of {judged} others, which no network was trained on and none was chosen by. "
        "Relative L² a frame, median / 95th percentile.",
        *spread([card for name, card in report.items() if name in SEEDED]),
        table(
            ["run", "channels", "rounds", "epochs", *ERRORS.values(), "trained by"],
            [*(row(name, card) for name, card in report.items()), linear(report)],
        ),
        "`pads-0` is shipped. The best epoch is that of the validation part. Data: `ruffini "
        "dataset generate presses --config tests/reference/indentations.toml`; `python "
        "tests/reports/networks.py --data presses --sizes --runs runs`.",
    ]
    return "\n\n".join(parts) + "\n"


def spread(cards: list[dict[str, Any]]) -> list[str]:
    """Medians over the seeds, least and largest."""
    if len(cards) < 2:
        return []
    found = []
    for what, title in ERRORS.items():
        medians = [100 * card["test"][what]["median"] for card in cards]
        found.append(f"{title} {min(medians):.1f} to {max(medians):.1f} %")
    return [f"Medians of {len(cards)} seeds: {', '.join(found)}."]


def row(name: str, card: dict[str, Any]) -> list[str]:
    """A run's sizes and errors."""
    network = card["network"]
    rounds = sum(network["down"]) + sum(network["up"])
    sizes = [network["width"], rounds, card["training"]["epochs"]]
    errors = [cell(card["test"][what]) for what in ERRORS]
    return [name, *map(str, sizes), *errors, card["data"]["trained_by"]]


def linear(report: dict[str, Any]) -> list[str]:
    """The linear answer that all of them correct."""
    found = next(iter(report.values()))["linear"]
    return ["linear answer", "–", "–", "–", *(cell(found[what]) for what in ERRORS), "–"]


def cell(error: dict[str, float]) -> str:
    """Median and 95th percentile in percent."""
    return f"{100 * error['median']:.1f} / {100 * error['p95']:.1f}"


def main() -> None:
    """Trains what is missing, if asked to, and writes the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--data", type=Path, help="presses to train on")
    parser.add_argument("--sizes", action="store_true", help="train other widths, too")
    parser.add_argument("--papers", type=Path, help="grasps to train the paper's networks on")
    parser.add_argument("--runs", type=Path, help="folder of the runs")
    options = parser.parse_args()
    if (options.data or options.papers) and not options.runs:
        parser.error("--data and --papers need --runs, the folder to train into")
    if options.data:
        train(options.data, options.runs, RUNS if options.sizes else SEEDED)
    if options.papers:
        papers = {name: [*chosen, *TEN_MINUTES] for name, chosen in PAPERS.items()}
        train(options.papers, options.runs, papers)
    file = HERE / "networks.json"
    report = json.loads(file.read_text()) if file.exists() else {}
    if options.runs:
        report = gathered(options.runs, report)
        file.write_text(json.dumps(report, indent=1) + "\n")
    (HERE / "networks.md").write_text(markdown(report))


if __name__ == "__main__":
    main()
