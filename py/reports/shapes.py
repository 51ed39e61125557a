"""The shipped network on plain shapes, small and large balls, a block, shallow and deep.

Ten minutes of one core. The truth is quadratic finite elements on a mesh of 1,200 nodes refined
towards the contact; beside the network and the linear answer that it corrects stand the usual
elements, p1-bar on 1,995 nodes. --quick asks the smallest ball alone.
"""

from __future__ import annotations

from argparse import Namespace
from typing import Any

import numpy as np

import ruffini
from engine import Rows, made, run, table, text
from pareto_cases import ELEMENTS, MINI, Case, Fields, row, straight
from ruffini import Fem, PressError

MADE_OF = ["env-core", "py/reports/shapes.py", "py/reports/pareto_cases.py"]
SHAPES = [*(("ball", radius) for radius in (1, 3, 6, 12)), ("block", 5)]
"""Shapes, and radius or half an edge (mm)."""
DEPTHS = {"ball": (1e-4, 4e-4, 1e-3, 2e-3), "block": (1e-4, 4e-4)}
"""Depths of the presses (m): under a block's edges the truth takes many minutes beyond."""
TRUTH_NODES = 1200
ANSWERERS = {"network": "network", "linear": "linear, on cells", "elements": ELEMENTS}
PARTS = ("displacement", "stress", "force")


def make(options: Namespace) -> dict[str, Any]:
    """Every shape to every depth."""
    sizes = {"nodes of the truth": TRUTH_NODES, "friction": MINI.friction}
    rows = Rows.of("shapes", options, MADE_OF, sizes)
    presses = [(shape, depth) for shape in SHAPES for depth in DEPTHS[shape[0]]]
    few = presses[:1] if options.quick else presses
    run(rows, {f"{n:02}": (errors, *press) for n, press in enumerate(few)})
    solved = [row for row in rows if "failed" not in row]
    medians = {
        who: {part: float(np.median([row[who][part] for row in solved])) for part in PARTS}
        for who in ANSWERERS
    }
    return rows.header | {"note": options.note, "rows": list(rows), "medians": medians}


def errors(shape: tuple[str, int], depth: float) -> dict[str, Any]:
    """Errors of the answers to a press in its last frame, or the models that failed."""
    [case] = straight("shapes", MINI, [shape], [depth])
    found: dict[str, Any] = {"press": case.name, "depth": depth}
    true = truth(case)
    if true is None:
        return found | {"failed": ["truth"]}
    answers = {who: row(case, name, {"truth": true}) for who, name in ANSWERERS.items()}
    if failed := [who for who, answer in answers.items() if "failed" in answer]:
        return found | {"failed": failed}
    found["force"] = float(np.linalg.norm(true.force[-1]))
    return found | {
        who: {part: of[0] for part, of in answer["truth"].items()}
        for who, answer in answers.items()
    }


def truth(case: Case) -> Fields | None:
    """Quadratic elements refined towards where the undeformed face is inside the shape."""
    line, (place, _) = np.arange(-9e-3, 9.1e-3, 2e-4), case.path[-1]
    face = np.stack(np.meshgrid(line, line, [0.0]), axis=-1).reshape(-1, 3)
    around = face[case.shape.distance(face - place)[0] <= 0]
    pad = ruffini.sensor(MINI.sensor, resolution=TRUTH_NODES, around=around)
    body = ruffini.SoftBody(pad.mesh, MINI.young, MINI.poisson, fixed=pad.fixed)
    frames = Fem(body, friction=MINI.friction, element="p2").solve_path(case.press())
    if isinstance(frames[-1], PressError):
        return None
    return Fields.carried(MINI, pad.mesh, frames)


PAGE = """# The network of pads on plain shapes

Errors in displacement / von Mises stress / force in %, relative L² on the last frame, on the
GelSight Mini against quadratic elements on a mesh refined towards the contact. *Linear* is the
answer that the network corrects, *elements* are p1-bar on 1,995 nodes.

{presses}

{made}"""


def page(report: dict[str, Any]) -> str:
    """A row a press, and the medians."""
    named = [
        row | {"press": f"{row['press']}, {1e3 * row['depth']:.1f} mm"} for row in report["rows"]
    ]
    columns: dict[str, Any] = {"press": "{press}"}
    columns["force"] = lambda row: (
        f"not solved by {', '.join(row['failed'])}" if "failed" in row else f"{row['force']:.2f} N"
    )
    columns |= {
        who: " / ".join(f"{{{who}[{part}]:100*.1f}}" for part in PARTS) for who in ANSWERERS
    }
    rows = [*named, {"press": "**median**", **report["medians"]}]
    return text(PAGE, report, presses=table(columns, rows, absent=""), made=made(report))
