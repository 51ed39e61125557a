"""The shipped network on plain shapes, small and large balls, a block, shallow and deep.

Ten minutes of one core. The truth is quadratic finite elements on a mesh of 1,200 nodes refined
towards the contact; beside the network and the linear answer that it corrects stand the usual
elements, p1-bar on 1,995 nodes.
"""

from __future__ import annotations

from argparse import Namespace
from functools import cache
from typing import Any

import numpy as np

import ruffini
from engine import Rows, made, run, table, text
from meshes import carried, difference
from ruffini import Fem, LinearPad, Press, PressError, Shape, Surrogate

SENSOR, FRICTION = "gelsight-mini", 0.8
UPRIGHT = (0, 0, 0, 1)
SHAPES = {
    **{f"ball {r} mm": (Shape.sphere(1e-3 * r), 1e-3 * r) for r in (1, 3, 6, 12)},
    "block 10 mm": (Shape.cuboid((5e-3, 5e-3, 5e-3)), 5e-3),
}
"""Shapes and how far they reach below their origin (m)."""
SHALLOW = 4e-4
"""Greatest depth of the block (m): under its edges the truth takes many minutes beyond."""
ASIDE = 1e-3
"""Where they press, beside the middle (m)."""
DEPTHS = (1e-4, 4e-4, 1e-3, 2e-3)
FRAMES = 6
TRUTH_NODES, ELEMENT_NODES = 1200, 2000
ANSWERERS = ("network", "linear", "elements")
PARTS = ("displacement", "stress", "force")


def make(options: Namespace) -> dict[str, Any]:
    """Every shape to every depth; the quick form the smallest ball to the least."""
    sizes = {"nodes of the truth": TRUTH_NODES, "friction": FRICTION}
    rows = Rows.of("shapes", options, ["env-core", "py/reports/shapes.py"], sizes)
    cases = {
        f"{place}/{depth}": (row, name, depth)
        for place, (name, (_, half)) in enumerate(SHAPES.items())
        for depth in DEPTHS
        if "ball" in name or depth <= SHALLOW
    }
    run(rows, dict(list(cases.items())[:1]) if options.quick else cases)
    solved = [row for row in rows if "failed" not in row]
    medians = {
        who: {part: float(np.median([row[who][part] for row in solved])) for part in PARTS}
        for who in ANSWERERS
    }
    return rows.header | {"note": options.note, "rows": list(rows), "medians": medians}


@cache
def models() -> dict[str, Any]:
    """The network, the answer that it corrects, and the usual elements."""
    gel = {"sensor": SENSOR, "friction": FRICTION}
    elements = Fem(ruffini.sensor(SENSOR, resolution=ELEMENT_NODES), friction=FRICTION)
    return {"network": Surrogate(**gel), "linear": LinearPad(**gel), "elements": elements}


def row(name: str, depth: float) -> dict[str, Any]:
    """Errors of the answers to a press, or what kept its models from answering."""
    shape, half = SHAPES[name]
    path = [([ASIDE, 0, half - d], UPRIGHT) for d in np.linspace(0, depth, FRAMES + 1)[1:]]
    body = ruffini.sensor(SENSOR, resolution=TRUTH_NODES, around=contact(shape, half - depth))
    asked = models() | {"truth": Fem(body, friction=FRICTION, element="p2")}
    answers = {who: model.solve_path(Press(shape, path))[-1] for who, model in asked.items()}
    found: dict[str, Any] = {"press": name, "depth": depth}
    if failed := {who: str(a) for who, a in answers.items() if isinstance(a, PressError)}:
        return found | {"failed": failed}
    network, fields = answers["network"], {}
    for who, answer in answers.items():
        [of] = carried([answer], asked[who].body.mesh, asked["network"].body.mesh)
        fields[who] = dict(zip(PARTS, (*of, answer.wrench[:3]), strict=True))
    true = fields.pop("truth")
    errors = {
        who: {part: difference(of[part], true[part]) for part in PARTS}
        for who, of in fields.items()
    }
    knows = {"predicted": network.predicted_error, "knows": asked["network"].knows(network)}
    return found | {"force": float(np.linalg.norm(true["force"]))} | errors | knows


def contact(shape: Shape, height: float) -> np.ndarray:
    """Places of a flat face inside a shape whose origin is at that height (K, 3)."""
    line = np.arange(-9e-3, 9.1e-3, 2e-4)
    places = np.stack(np.meshgrid(line, line, [0.0]), axis=-1).reshape(-1, 3)
    return places[shape.distance(places - [ASIDE, 0, height])[0] <= 0]


PAGE = """# The network of pads on plain shapes

Errors in displacement / von Mises stress / force in %, relative L² on the last frame, on the
GelSight Mini against quadratic elements on a mesh refined towards the contact. *Linear* is the
answer that the network corrects, *elements* are p1-bar on 1,995 nodes.

{presses}

{made}"""


def page(report: dict[str, Any]) -> str:
    """A row a press, and the medians."""
    errors = " / ".join(f"{{{{{{0}}[{part}]:100*.1f}}}}" for part in PARTS)
    columns = {
        "press": lambda row: (
            f"{row['press']}, {1e3 * row['depth']:.1f} mm" if "depth" in row else row["press"]
        ),
        "force": lambda row: (
            f"not solved by {', '.join(row['failed'])}"
            if "failed" in row
            else f"{row['force']:.2f} N"
        ),
        **{who: errors.format(who) for who in ANSWERERS},
    }
    rows = [*report["rows"], {"press": "**median**", **report["medians"]}]
    return text(PAGE, report, presses=table(columns, rows, absent=""), made=made(report))
