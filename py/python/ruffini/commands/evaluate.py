"""``ruffini evaluate``: errors of a surrogate on unseen presses."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from ruffini import surrogate


def add_to(commands: Any) -> None:
    """Add the subcommand to the parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "evaluate",
        help="errors of a surrogate on a dataset",
        description="Errors of a corrector and of the linear answer that it corrects, or of one of "
        "the paper's networks, on the test part of a split, by object. The card of weights of soft "
        "objects tells theirs.",
    )
    parser.add_argument("weights", help="the .safetensors file")
    parser.add_argument("data", help="the dataset")
    parser.add_argument("--split", default="novel-14", help="split; novel-14 if not given")
    parser.add_argument("--json", type=Path, help="file for the errors of every frame")
    parser.set_defaults(run=_evaluate)


def _evaluate(options: argparse.Namespace) -> None:
    frames = surrogate.evaluate(options.weights, options.data, options.split)
    if not frames:
        raise ValueError(f"{options.data}: no frames in the test part of {options.split}")
    if options.json is not None:
        options.json.write_text(json.dumps(frames))
    by_object: dict[str, list[dict[str, Any]]] = {}
    for frame in frames:
        by_object.setdefault(frame["grasp"].split("/")[0], []).append(frame)
    answerers = [who for who in ("surrogate", "linear") if frames[0][who] is not None]
    linear = "   linear: u, stress, force" if "linear" in answerers else ""
    print(f"{'medians':<16}{'u':>8}{'stress':>8}{'force':>8}" + linear)
    for name, part in {**by_object, "all": frames}.items():
        cells = [
            _median([frame[who][what] for frame in part])
            for who in answerers
            for what in ("displacement", "stress", "force")
        ]
        print(f"{name:<16}" + "".join(f"{cell:>8}" for cell in cells) + " %")


def _median(values: list[float | None]) -> str:
    """Format the median in percent; a dash if there are no values."""
    ordered = sorted(value for value in values if value is not None)
    return f"{100 * ordered[len(ordered) // 2]:.2f}" if ordered else "-"
