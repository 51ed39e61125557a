"""Errors of the solutions that the network of pads learns from, under deep presses.

Five minutes of one core a shape. A shape is pressed straight down to 60 % of the Mini's thickness
as the presses of both training sets are solved, and as the presses of `unseen` are; each is
compared with quadratic finite elements on a mesh of 2,000 nodes refined towards the contact, which
are not corrected by linear elasticity. --quick presses one ball on coarser meshes.
"""

from __future__ import annotations

import json
import time
from argparse import Namespace
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import tomllib

from engine import KEPT, ROOT, Rows, made, run, table, text
from pareto_cases import MINI, SHAPES, UPRIGHT, Case, Fields, presses, straight, true
from ruffini import PressError
from ruffini._core import solve_press

MADE_OF = [
    *("env-core/src/dataset", "env-core/src/fem", "env-core/src/compliance"),
    *("py/reports/targets.py", "py/reports/pareto_cases.py", "tests/reference/presses.py"),
    *("tests/reference/indentations.toml", "tests/reference/indentations_finer.toml"),
]
DEPTHS = (0.6e-3, 1.2e-3, 1.8e-3, 2.4e-3)
"""Depths (m) of the frames: 15, 30, 45 and 60 % of the thickness."""
NODES, FEW = 2000, 300
"""Most nodes of the truth, and of what is judged by it, in the quick form."""
PARTS = ("displacement", "stress", "force")
COARSE, FINE, FINER = "800 presses", "106 presses", "reference of `unseen`"
SETS = {COARSE: "indentations.toml", FINE: "indentations_finer.toml", FINER: "indentations.toml"}
"""Configuration of each way to solve a press, under tests/reference."""
CHANGES = {FINER: presses.FINER}
"""Differences from it."""


def make(options: Namespace) -> dict[str, Any]:
    """Each shape, solved in each way."""
    rows = Rows.of("targets", options, MADE_OF, {"nodes of the truth": NODES, "depths": DEPTHS})
    kept = KEPT / options.form / f"targets-{rows.header['commit']}"
    cases = cases_of(options.quick)
    judged = partial(errors, options.quick, kept)
    run(
        rows,
        {
            f"{case.name}, {how}": (judged, number, how)
            for number, case in enumerate(cases)
            for how in SETS
        },
    )
    return rows.header | {"note": options.note, "rows": list(rows), "table": list(summary(rows))}


def cases_of(quick: bool) -> list[Case]:
    """Shapes that are pressed, beside the middle of the pad."""
    return list(straight("targets", MINI, SHAPES[: 1 if quick else None], list(DEPTHS)))


def errors(quick: bool, kept: Any, number: int, how: str) -> dict[str, Any]:
    """Relative errors of a way to solve a press at each depth, and how long it took."""
    case = cases_of(quick)[number]
    found: dict[str, Any] = {"shape": case.name, "set": how}
    truth = true(case, FEW if quick else NODES, kept)
    if truth is None:
        return found | {"failed": "not solved by the truth"}
    begun = time.process_time()
    frames = solved(case, how, quick)
    found["seconds"] = time.process_time() - begun
    if isinstance(frames[-1], PressError):
        found["failed"] = frames[-1].kind
        frames = frames[:-1]
    if not frames:
        return found
    exact = Fields(*(of[case.judged] for of in (truth.displacement, truth.stress, truth.force)))
    displacement, stress, wrench = (np.array(of) for of in zip(*frames, strict=True))
    off = Fields(displacement, stress, wrench[:, :3]).errors(exact, range(len(frames)))
    return found | {"errors": {part: off[part] for part in PARTS}}


def solved(case: Case, how: str, quick: bool) -> list[Any]:
    """The frames of a press as those of a training set are solved."""
    config = tomllib.loads((ROOT / "tests/reference" / SETS[how]).read_text())
    config |= CHANGES.get(how, {})
    gel = {"share": 1.0, **vars(case.gel)}
    config["gels"] = [gel]
    if quick:
        config |= {"truth_nodes": FEW, "truth_linear_nodes": 2 * FEW, "truth_steps": 2}
    (x, y, z), _ = case.path[case.judged[0]]
    heights = [z + DEPTHS[0] - depth for depth in (0.0, *DEPTHS)]
    path = [((x, y, height), UPRIGHT) for height in heights]
    return list(solve_press(None, json.dumps(config), case.shape, path))


def summary(rows: Rows) -> Iterator[dict[str, Any]]:
    """Median and largest errors over the shapes, by depth."""
    for how in SETS:
        some = [row for row in rows if row["set"] == how and "errors" in row]
        for number, depth in enumerate(DEPTHS):
            found: dict[str, Any] = {"set": how, "depth": depth}
            for part in PARTS:
                off = [
                    row["errors"][part][number] for row in some if number < len(row["errors"][part])
                ]
                if off:
                    found[part] = {"median": float(np.median(off)), "worst": max(off)}
                found["shapes"] = len(off)
            yield found


PAGE = """# What the network learns from, under deep presses

A press of the training data is solved by linear elasticity with finely resolved contact, and what
the nonlinear law changes is added, from quadratic elements on a coarser mesh
([mechanics](../../py/docs/mechanics.md)). How coarse it may be is decided by deep presses, in which
that change is large. Here three balls and a block, which are no training data, are pressed straight
down beside the middle of the GelSight Mini's pad as the 800 presses of one training set are solved
(500 nodes), as the 106 of the other are (700, twice as fine at the contact), and as the reference
of [unseen](unseen.md) is (900). Each is compared with quadratic elements alone, on up to
{sizes[nodes of the truth]:,} nodes refined towards the contact, in relative L² errors.

By depth, median / largest over the shapes that were solved so far (%):

{table}

Every press, at {depths} mm (%), and processor seconds of the whole press:

{presses}

In force the finer set is half as far off as the coarser one, and about as near as the reference of
`unseen`. The shapes and depths of this page were looked at when its meshes were chosen.

{made}"""


def page(report: dict[str, Any]) -> str:
    """Errors by depth, and of every press."""
    both = {"median": ".1f", "worst": ".1f"}
    columns = {"set": "{set}", "depth (mm)": "{depth:1e3*.1f}", "shapes": "{shapes}"}
    columns |= {
        part: " / ".join(f"{{{part}[{high}]:100*{form}}}" for high, form in both.items())
        for part in PARTS
    }
    every_press: dict[str, Any] = {"shape": "{shape}", "set": "{set}"}
    every_press |= {part: partial(every, part) for part in PARTS}
    every_press |= {"s": "{seconds:.0f}", "failed": "{failed}"}
    depths = " / ".join(f"{1e3 * depth:.1f}" for depth in DEPTHS)
    return text(
        PAGE,
        report,
        table=table(columns, report["table"], absent="–"),
        presses=table(every_press, report["rows"], absent=""),
        depths=depths,
        made=made(report),
    )


def every(part: str, row: dict[str, Any]) -> str:
    """Errors of a press at each depth."""
    return " / ".join(f"{100 * off:.1f}" for off in row.get("errors", {}).get(part, []))
