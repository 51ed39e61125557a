"""``ruffini recommend``: the fastest model within a given error."""

from __future__ import annotations

import argparse
import json
from importlib import resources
from typing import Any

_FILE = "answerers.json"
"""File of measured errors and times, written by py/reports/pareto.py."""


def add_to(commands: Any) -> None:
    """Add the subcommand to the parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "recommend",
        help="name the fastest model of the mechanics within an error",
        description="Names the fastest model of the mechanics, whether network, linear elasticity "
        "or finite elements, whose error against fine quadratic elements is at most the one given. "
        "All measured errors and times: tests/reports/pareto.md.",
    )
    parser.add_argument("--error", required=True, help="largest error, such as 3%% or 0.03")
    parser.add_argument(
        "--of", default="force", help="displacement, stress, force (if not given) or peak"
    )
    parser.add_argument(
        "--panel", help="kind of presses: unseen (if not given), deep, tiny, soft or stiff"
    )
    parser.add_argument(
        "--worst", action="store_true", help="the error's 95th percentile in place of its median"
    )
    parser.set_defaults(run=_recommend)


def _recommend(options: argparse.Namespace) -> None:
    report = json.loads((resources.files("ruffini") / _FILE).read_text())
    panels = report["panels"]
    panel = options.panel or next(iter(panels))
    if panel not in panels:
        raise ValueError(f"panel: found {panel}, expected one of {', '.join(panels)}")
    share = "95 %" if options.worst else "median"
    rows = _ranked(panels[panel], options.of, share)
    most = _error(options.error)
    fit = [row for row in rows if row[1] <= most]
    if not fit:
        name, error, _, _ = min(rows, key=lambda row: row[1])
        raise ValueError(
            f"error: found {100 * most:g} %, expected at least {100 * error:.1f} %, that of {name}"
        )
    name, error, milliseconds, use = fit[0]
    print(f"{name}: {use}")
    print(f"{options.of} off by {100 * error:.1f} % ({share}, {panel})")
    print(f"{milliseconds:.3g} ms of one thread a frame, on {report['machine']['cpu']}")


def _ranked(
    found: dict[str, dict[str, Any]], what: str, share: str
) -> list[tuple[str, float, float, str]]:
    """Name, error, time (ms) and use of all models with an error of `what`, fastest first."""
    known = {what for row in found.values() for what in row["errors"]}
    if what not in known:
        raise ValueError(f"of: found {what}, expected one of {', '.join(sorted(known))}")
    rows = [
        (name, float(row["errors"][what][share]), float(row["ms"]), str(row["use"]))
        for name, row in found.items()
        if what in row["errors"]
    ]
    return sorted(rows, key=lambda row: row[2])


def _error(text: str) -> float:
    """Parse a fraction such as ``3%`` or ``0.03``."""
    try:
        share = float(text.rstrip("% ")) / (100 if "%" in text else 1)
    except ValueError:
        raise ValueError(f"error: found {text}, expected a share such as 3% or 0.03") from None
    if not 0 < share < (float("inf") if "%" in text else 1):
        raise ValueError(f"error: found {text}, expected a share above 0, such as 3% or 0.03")
    return share
