"""The networks of pads by size, contact and seed: makes networks.json and networks.md.

    python tests/reports/networks.py                           the page, from networks.json
    python tests/reports/networks.py --data SET --runs FOLDER  trains first what FOLDER lacks

Trained by `ruffini train`, 10 to 60 core minutes each; a run that was stopped goes on, but for the
paper's networks, which are trained for `pareto.py` and not on this page. SET is what
`ruffini dataset generate SET --grasps 10 --frames 10` makes.
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
FEW = ["--down", "1", "1", "1", "--up", "1", "1"]
SMALL, SMALLEST = (["--width", width, *FEW] for width in ("32", "16"))
NODES = ["--epochs", "30", "--contact", "nodes"]
POINTS = ["--epochs", "24"]
SEEDS = range(3)
RUNS = (
    {f"default-{seed}": [*POINTS, "--seed", str(seed)] for seed in SEEDS}
    | {"points32-0": [*POINTS, *SMALL], "points16-0": [*POINTS, *SMALLEST]}
    | {f"swift-{seed}": [*NODES, *SMALL, "--seed", str(seed)] for seed in SEEDS}
    | {"nodes48-0": NODES, "nodes16-0": [*NODES, *SMALLEST]}
)
"""Options of `ruffini train` by run."""
TEN_MINUTES = ["--seconds", "600", "--batch", "1"]
PAPERS = {
    "paper-baseline": ["--variant", "baseline", "--width", "16", "--rounds", "4"],
    "paper-a": ["--variant", "a", "--width", "16", "--rounds", "4"],
    "paper-b-wide": ["--variant", "b", "--width", "32", "--rounds", "4"],
    "paper-b-long": ["--variant", "b", "--width", "16", "--rounds", "8"],
}
"""The same for the paper's networks."""
ERRORS = {"displacement": "u", "stress": "σ", "peak": "σ at the peak", "force": "net force"}


def train(data: Path, runs: Path) -> None:
    """Trains what has no card yet."""
    papers = {name: [*options, *TEN_MINUTES] for name, options in PAPERS.items()}
    for name, options in (RUNS | papers).items():
        if not (runs / name / "card.toml").exists():
            command = [sys.executable, "-m", "ruffini", "train", str(data), str(runs / name)]
            subprocess.run([*command, *options], check=True)


def gathered(runs: Path, before: dict[str, Any]) -> dict[str, Any]:
    """What the cards of the runs say; `before` says what is known of runs that the folder lacks."""
    cards = {name: runs / name / "card.toml" for name in RUNS}
    found = {name: tomllib.loads(f.read_text()) for name, f in cards.items() if f.exists()}
    return {name: (before | found)[name] for name in RUNS if name in before | found}


def markdown(report: dict[str, Any]) -> str:
    """Spread over seeds, and a table of all runs."""
    data = {card["contact"]: card["data"] for card in report.values()}
    counts = [
        f"{part['train'][1]:,} frames and judged on {part['test'][1]:,} with contact at {contact}"
        for contact, part in data.items()
    ]
    grasps = next(iter(data.values()))["train"][0]
    parts = [
        "# The networks of pads: size, contact, seed",
        f"Trained on {grasps} grasps of 49 objects, judged on 14 of families left out (split "
        f"`novel-14`): trained on {', on '.join(counts)}; the others have no linear answer. "
        "Relative L² a frame, median / 95th percentile.",
        "\n".join(spread(report, name) for name in ("default", "swift")),
        table(
            ["run", "contact", "channels", "rounds", "epochs", *ERRORS.values(), "trained by"],
            [row(name, card) for name, card in report.items()] + linear(report),
        ),
        "The runs ending in 0 of `default` and `swift` are shipped. Nothing is chosen by these "
        "errors: the best epoch is that of the validation part. Data: `ruffini dataset generate "
        "set --grasps 10 --frames 10`; `python tests/reports/networks.py --data set --runs runs`.",
    ]
    return "\n\n".join(parts) + "\n"


def spread(report: dict[str, Any], name: str) -> str:
    """What another seed changes."""
    cards = [card for run, card in report.items() if run.startswith(f"{name}-")]
    found = []
    for what, title in ERRORS.items():
        medians = [100 * card["test"][what]["median"] for card in cards]
        found.append(f"{title} {min(medians):.2f} to {max(medians):.2f} %")
    return f"- **{name}**, medians of {len(cards)} seeds: {', '.join(found)}."


def row(name: str, card: dict[str, Any]) -> list[str]:
    """A run's sizes and errors."""
    network, training = card["network"], card["training"]
    rounds = sum(network["down"]) + sum(network["up"])
    sizes = [card["contact"], network["width"], rounds, training["epochs"]]
    errors = [cell(card["test"][what]) for what in ERRORS]
    return [name, *map(str, sizes), *errors, card["data"]["trained_by"]]


def linear(report: dict[str, Any]) -> list[list[str]]:
    """The linear answers that are corrected."""
    kinds = {card["contact"]: card["linear"] for card in report.values()}
    return [
        ["linear answer", contact, "–", "–", "–", *(cell(found[what]) for what in ERRORS), "–"]
        for contact, found in kinds.items()
    ]


def cell(error: dict[str, float]) -> str:
    """Median and 95th percentile in percent."""
    return f"{100 * error['median']:.2f} / {100 * error['p95']:.1f}"


def main() -> None:
    """Trains what is missing, if asked to, and writes the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="a dataset to train on")
    parser.add_argument("--runs", type=Path, help="folder of the runs")
    options = parser.parse_args()
    if options.data and not options.runs:
        parser.error("--data needs --runs, the folder to train into")
    if options.data:
        train(options.data, options.runs)
    file = HERE / "networks.json"
    report = json.loads(file.read_text())
    if options.runs:
        report = gathered(options.runs, report)
        file.write_text(json.dumps(report, indent=1) + "\n")
    (HERE / "networks.md").write_text(markdown(report))


if __name__ == "__main__":
    main()
