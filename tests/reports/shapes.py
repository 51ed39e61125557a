"""The shipped network on plain shapes: small and large balls, a block, shallow and deep.

    python tests/reports/shapes.py    ten minutes of one core: shapes.json and shapes.md

The truth is quadratic finite elements on a mesh of 1,200 nodes refined towards the contact; beside
the network and the linear answer that it corrects stand the usual elements, p1-bar on 1,995 nodes.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from kept import header, made, table
from numpy.typing import NDArray

import ruffini
from ruffini import Deformation, Fem, LinearPad, Press, PressError, Shape, Surrogate

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


def main() -> None:
    """Presses every shape to every depth by network, linear answer and finite elements."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder")
    out = parser.parse_args().out
    gel = {"sensor": SENSOR, "friction": FRICTION}
    elements = Fem(ruffini.sensor(SENSOR, resolution=ELEMENT_NODES), friction=FRICTION)
    models = {"network": Surrogate(**gel), "linear": LinearPad(**gel), "elements": elements}
    rows = []
    for name, (shape, half) in SHAPES.items():
        for depth in DEPTHS if "ball" in name else [d for d in DEPTHS if d <= SHALLOW]:
            path = [([ASIDE, 0, half - d], UPRIGHT) for d in np.linspace(0, depth, FRAMES + 1)[1:]]
            around = contact(shape, half - depth)
            body = ruffini.sensor(SENSOR, resolution=TRUTH_NODES, around=around)
            judge = {"truth": Fem(body, friction=FRICTION, element="p2")}
            rows.append({"press": name, "depth": depth} | row(judge | models, Press(shape, path)))
            print(*cells(rows[-1]), flush=True)
    report = header(["env-core"], {"nodes of the truth": TRUTH_NODES, "friction": FRICTION})
    report |= {"note": "", "rows": rows, "medians": medians(rows)}
    (out / "shapes.json").write_text(json.dumps(report, indent=1) + "\n")
    (out / "shapes.md").write_text(markdown(report))


def medians(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Median errors over the presses, by answerer."""
    solved = [row for row in rows if "failed" not in row]
    return {
        who: {part: float(np.median([row[who][part] for row in solved])) for part in PARTS}
        for who in ANSWERERS
    }


def contact(shape: Shape, height: float) -> NDArray[np.float64]:
    """Places of a flat face inside a shape whose origin is at that height (K, 3)."""
    line = np.arange(-9e-3, 9.1e-3, 2e-4)
    places = np.stack(np.meshgrid(line, line, [0.0]), axis=-1).reshape(-1, 3)
    return places[shape.distance(places - [ASIDE, 0, height])[0] <= 0]


def row(models: dict[str, Any], press: Press) -> dict[str, Any]:
    """Errors of the answers to a press, or what kept its models from answering."""
    answers = {who: model.solve_path(press)[-1] for who, model in models.items()}
    failed = {who: str(a) for who, a in answers.items() if isinstance(a, PressError)}
    if failed:
        return {"failed": failed}
    mesh = models["network"].body.mesh
    fields = {who: carried(answers[who], models[who].body.mesh, mesh) for who in models}
    errors = {
        who: {
            part: float(np.linalg.norm(a - b) / np.linalg.norm(b))
            for part, a, b in zip(PARTS, fields[who], fields["truth"], strict=True)
        }
        for who in ANSWERERS
    }
    network = answers["network"]
    return {
        "force": float(np.linalg.norm(answers["truth"].wrench[:3])),
        **errors,
        "predicted": network.predicted_error,
        "knows": models["network"].knows(network),
    }


def carried(
    answer: Deformation, mesh: ruffini.TetMesh, to: ruffini.TetMesh
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Displacement, stress and force of an answer on another mesh."""
    fields = answer.displacement, answer.von_mises
    if len(mesh.vertices) != len(to.vertices):
        transfer = ruffini.Transfer(mesh, to)
        fields = transfer.interpolate(fields[0]), transfer.average(fields[1])
    return (*fields, answer.wrench[:3])


def cells(row: dict[str, Any]) -> list[str]:
    """A row of the page's table."""
    head = f"{row['press']}, {1e3 * row['depth']:.1f} mm"
    if "failed" in row:
        return [head, f"not solved by {', '.join(row['failed'])}", *[""] * len(ANSWERERS)]
    return [head, f"{row['force']:.2f} N", *(errors(row[who]) for who in ANSWERERS)]


def errors(found: dict[str, float]) -> str:
    """Errors in u, stress and force in per cent."""
    return " / ".join(f"{100 * found[part]:.1f}" for part in PARTS)


def markdown(report: dict[str, Any]) -> str:
    """The page: a table of all presses."""
    rows = [cells(row) for row in report["rows"]]
    rows.append(["**median**", "", *(errors(report["medians"][who]) for who in ANSWERERS)])
    lines = [
        "# The network of pads on plain shapes",
        "Errors in displacement / von Mises stress / force in %, relative L² on the last frame, on "
        "the GelSight Mini against quadratic elements on a mesh refined towards the contact. "
        "*Linear* is the answer that the network corrects, *elements* are p1-bar on 1,995 nodes.",
        table(["press", "force", *ANSWERERS], rows),
        made(report),
    ]
    return "\n\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
