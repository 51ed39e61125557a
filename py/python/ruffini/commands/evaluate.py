"""``ruffini evaluate``: errors of a surrogate on presses that it never saw."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from ruffini import surrogate


def add_to(commands: Any) -> None:
    """Adds the subcommand to the parser's."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "evaluate",
        help="errors of a surrogate on a dataset",
        description="Errors of a surrogate, and of the linear answer that it corrects, on the test "
        "part of a split, by object.",
    )
    parser.add_argument("weights", help="the .safetensors file")
    parser.add_argument("data", help="the dataset")
    parser.add_argument("--split", default="novel-14", help="split; novel-14 if not given")
    parser.add_argument("--json", type=Path, help="file for the errors of every frame")
    parser.set_defaults(run=_evaluate)


def _evaluate(options: argparse.Namespace) -> None:
    frames = surrogate.evaluate(options.weights, options.data, options.split)
    if options.json is not None:
        options.json.write_text(json.dumps(frames))
    by_object: dict[str, list[dict[str, Any]]] = {}
    for frame in frames:
        by_object.setdefault(frame["grasp"].split("/")[0], []).append(frame)
    print(f"{'medians':<16}{'u':>8}{'stress':>8}{'force':>8}   linear: u, stress, force")
    for name, part in {**by_object, "all": frames}.items():
        cells = [
            f"{100 * _median([frame[who][what] for frame in part]):.2f}"
            for who in ("surrogate", "linear")
            for what in ("displacement", "stress", "force")
        ]
        print(f"{name:<16}" + "".join(f"{cell:>8}" for cell in cells) + " %")


def _median(values: list[float]) -> float:
    ordered = sorted(values)
    return ordered[len(ordered) // 2]
