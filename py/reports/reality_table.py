"""Error of forces read from the tables of `ruffini calibrate` against those that are solved."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

import numpy as np

from engine import Rows, made, run, table, text
from reality_curves import BALL, LAW, SENSOR
from ruffini.commands.fitting import GRIDS, GelModel, Table

MADE_OF = [
    *(f"env-core/src/{name}" for name in ("contact", "deformation", "fem")),
    *("py/src", "py/python/ruffini/commands/fitting.py", "py/reports/reality_table.py"),
]
HELD = {"friction": 0.0, "thickness": 1.0}
DEEPEST = 2.3e-3
"""Of the tables (m): half of the gel, and the range of the offset."""
BETWEEN = (0.35, 0.425, 0.46, 0.485)
"""Poisson's ratios between those of the table."""
DEPTHS = np.arange(0.15e-3, DEEPEST, 1e-4)
"""Midway between the depths of the table (m)."""
SHALLOW = 3e-4
"""Depth up to which errors are told apart (m): there a contact of few nodes grows by jumps."""
SIZES = {"full": {"nodes": 1000}, "quick": {"nodes": 200}}


def make(options: Namespace) -> dict[str, Any]:
    """Errors of the force between the points of a table."""
    sizes = SIZES[options.form]
    rows = Rows.of("reality_table", options, MADE_OF, sizes)
    axis = {f"ν {poisson}": (on_table, poisson, sizes["nodes"]) for poisson in GRIDS["poisson"]}
    between = {f"ν {poisson}": (midway, poisson, sizes["nodes"]) for poisson in BETWEEN}
    run(rows, axis | between)
    forces = {row["key"]: np.array(row["force"]) for row in rows}
    values = np.array([forces[key] for key in axis]) ** (2 / 3)
    tabled = Table(tabled_depths(), {"poisson": np.array(GRIDS["poisson"])}, values)
    found = []
    for key, (_, poisson, _) in between.items():
        read = tabled.force({"poisson": poisson}, DEPTHS)
        errors = read / forces[key] - 1
        found.append({"poisson": poisson, "errors": errors.tolist()})
    return rows.header | {"note": options.note, "depths": DEPTHS.tolist(), "rows": found}


def tabled_depths() -> Any:
    """Depths of the table (m), as those of the fits."""
    return np.linspace(0.0, DEEPEST, 24)


def on_table(poisson: float, nodes: int) -> dict[str, Any]:
    """Force over Young's modulus (m²) at the depths of the table."""
    forces = solved(poisson, nodes, tabled_depths()[1:])
    return {"force": [0.0, *forces.tolist()]}


def midway(poisson: float, nodes: int) -> dict[str, Any]:
    """Force over Young's modulus (m²) at depths between those of the table."""
    # The mesh depends on the last depth.
    return {"force": solved(poisson, nodes, np.append(DEPTHS, DEEPEST))[:-1].tolist()}


def solved(poisson: float, nodes: int, depths: Any) -> Any:
    """Force over Young's modulus (m²) at increasing depths."""
    return GelModel(SENSOR, LAW, nodes).solve(BALL, depths, {**HELD, "poisson": poisson})


SECTION = """### Forces between the points of a table

Fits read forces from tables that finite elements of {sizes[nodes]} nodes were solved for, without
friction, at five of Poisson's ratios from 0.3 to 0.495 and every 0.1 mm, by cubic splines of
force^(2/3). Here they are compared with forces solved between these points, midway in depth. The
noise of the drawn curves is 3 %.

{table}

{made}"""
COLUMNS = {
    "ν": "{poisson}",
    "up to 0.3 mm: largest error": "{shallow:100*.2f} %",
    "deeper: largest error": "{deep:100*.2f} %",
    "median": "{median:100*.3f} %",
}


def section(part: dict[str, Any]) -> str:
    """Errors by Poisson's ratio."""
    shallow, rows = np.array(part["depths"]) <= SHALLOW, []
    for row in part["rows"]:
        errors = np.abs(row["errors"])
        rows.append(
            {
                "poisson": row["poisson"],
                "shallow": errors[shallow].max(),
                "deep": errors[~shallow].max(),
                "median": float(np.median(errors)),
            }
        )
    return text(SECTION, part, table=table(COLUMNS, rows), made=made(part))
