"""Force of a GelSight Mini under a ball, fitted; and how far intervals of fits can be trusted."""

from __future__ import annotations

import itertools
from argparse import Namespace
from typing import Any

import numpy as np

from engine import ROOT, Rows, run
from ruffini import Shape
from ruffini.commands.fitting import GRIDS, Curve, Gel, Problem, Table, read_curve

MADE_OF = [
    *("env-core", "py/src", "py/python/ruffini/commands/fitting.py"),
    *("py/reports/reality_curves.py", "tests/reference/feats_force_depth.csv"),
]
BALL, SENSOR = Shape.sphere(7.5e-3), "gelsight-mini"
DEPTHS = np.linspace(0.0, 2.3e-3, 24)
"""Of the tables (m): half of the gel, and the range of the offset."""
POISSON, LAW = 0.475, "neo-hookean"
"""Those of FEATS, which measured the curve."""
STICKY = 1.0
"""Coefficient of friction that the sensor's file has."""
LAWS = ("neo-hookean", "stable-neo-hookean", "corotated", "linear")
SIZES: dict[str, dict[str, Any]] = {
    "full": {
        "nodes": 1000,
        "finer": [[2000, STICKY], [2000, 0.0], [4000, 0.0]],
        "draws": 100,
        "seed": 20261126,
    },
    "quick": {"nodes": 200, "finer": [[400, 0.0]], "draws": 5, "seed": 20261126},
}
GOAL = 0.05
"""Error of force that a fit shall stay below at every depth."""


def make(options: Namespace) -> dict[str, Any]:
    """Solved paths, fits to what was measured, and fits to drawn curves."""
    sizes = SIZES[options.form]
    rows = Rows.of("reality_curves", options, MADE_OF, sizes)
    grid = itertools.product(GRIDS["poisson"], GRIDS["friction"])
    thick = itertools.product((0.0, STICKY), GRIDS["thickness"])
    laws = itertools.product(LAWS, (0.0, STICKY))
    asked = [(LAW, poisson, friction, 1.0, sizes["nodes"]) for poisson, friction in grid]
    asked += [(LAW, POISSON, friction, scale, sizes["nodes"]) for friction, scale in thick]
    asked += [(law, POISSON, friction, 1.0, sizes["nodes"]) for law, friction in laws]
    asked += [(LAW, POISSON, friction, 1.0, nodes) for nodes, friction in sizes["finer"]]
    run(rows, {_key(*path): (solved, *path) for path in asked})
    paths = {row["key"]: np.array(row["force"]) for row in rows if "force" in row}

    def tabled(law: str, nodes: int, axes: tuple[str, ...], held: dict[str, float]) -> Table:
        """A table of solved paths."""
        at = [
            {**held, **dict(zip(axes, corner, strict=True))}
            for corner in itertools.product(*(GRIDS[name] for name in axes))
        ]
        names = ("poisson", "friction", "thickness")
        forces = [paths[_key(law, *(one[name] for name in names), nodes)] for one in at]
        grids = {name: np.array(GRIDS[name]) for name in axes}
        values = np.array(forces) ** (2 / 3)
        return Table(DEPTHS, grids, values.reshape(*map(len, grids.values()), -1))

    fits = []
    for number, (fitted, law, friction, nodes) in enumerate(_fits(sizes)):
        held = {"poisson": POISSON, "friction": friction, "thickness": 1.0}
        axes = tuple(name for name in GRIDS if name in fitted)
        found = fit(tabled(law, nodes, axes, held), fitted, held)
        fits.append({"number": number, "law": law, "nodes": nodes, "friction": friction, **found})
    smooth = {"poisson": POISSON, "friction": 0.0, "thickness": 1.0}
    two = tabled(LAW, sizes["nodes"], ("poisson",), smooth)
    drawn = {
        f"draws {points} points, {', '.join(fitted)}": (drawn_fits, two, points, fitted, sizes)
        for points, fitted in (
            (4, ("young", "offset")),
            (20, ("young", "offset")),
            (20, ("young", "poisson", "offset")),
        )
    }
    run(rows, drawn)
    coverage = [row for row in rows if row["key"] in drawn]
    measured = curve()
    about = {"depths": measured.depths.tolist(), "forces": measured.forces.tolist()}
    return rows.header | {"note": options.note, **about, "fits": fits, "coverage": coverage}


def _fits(sizes: dict[str, Any]) -> list[tuple[tuple[str, ...], str, float, int]]:
    """What is fitted, with which law, friction and mesh."""
    usual, nodes = ("young", "offset"), sizes["nodes"]
    found: list[tuple[tuple[str, ...], str, float, int]] = [
        (("young",), LAW, STICKY, nodes),
        (("young",), LAW, 0.0, nodes),
        *((usual, LAW, friction, nodes) for friction in (STICKY, 0.2, 0.0)),
        *((usual, LAW, friction, more) for more, friction in sizes["finer"]),
        *((usual, law, friction, nodes) for law in LAWS[1:] for friction in (STICKY, 0.0)),
        (("young", "poisson", "offset"), LAW, STICKY, nodes),
        (("young", "poisson", "offset"), LAW, 0.0, nodes),
        (("young", "thickness", "offset"), LAW, STICKY, nodes),
        (("young", "thickness", "offset"), LAW, 0.0, nodes),
        (("young", "friction", "offset"), LAW, 0.0, nodes),
    ]
    return found


def _key(law: str, poisson: float, friction: float, thickness: float, nodes: int) -> str:
    return f"{law}, {poisson}, {friction}, {thickness}, {nodes} nodes"


def solved(
    law: str, poisson: float, friction: float, thickness: float, nodes: int
) -> dict[str, Any]:
    """Force over Young's modulus (m²) along a path."""
    at = {"poisson": poisson, "friction": friction, "thickness": thickness}
    return {"force": [0.0, *Gel(SENSOR, law, nodes).solve(BALL, DEPTHS[1:], at).tolist()]}


def curve() -> Curve:
    """What FEATS measured."""
    return read_curve(ROOT / "tests/reference/feats_force_depth.csv", BALL, 4e-3)


def fit(tabled: Table, fitted: tuple[str, ...], held: dict[str, float]) -> dict[str, Any]:
    """A fit to what was measured, its errors, and those at depths that were left out."""
    problem = Problem([curve()], [tabled], fitted, held)
    found = problem.fit()
    [errors], [left] = found.errors, problem.left_out(found)
    depths = np.linspace(0.0, 2e-3, 41)
    at = {**held, **found.values}
    force = at["young"] * tabled.force(at, depths + problem.offset(found.values, 0))
    return {
        "fitted": list(fitted),
        "values": found.values,
        "intervals": {
            name: [end if np.isfinite(end) else None for end in some[0.95]]
            for name, some in found.intervals.items()
        },
        "errors": errors.tolist(),
        "left out": left.tolist(),
        "curve": force.tolist(),
    }


def drawn_fits(
    tabled: Table, points: int, fitted: tuple[str, ...], sizes: dict[str, Any]
) -> dict[str, Any]:
    """How often intervals hold what curves with noise were drawn from."""
    noise, random = 0.03, np.random.default_rng([sizes["seed"], points, len(fitted)])
    held = {"poisson": POISSON, "friction": 0.0, "thickness": 1.0}
    depths, hits, wide, off = np.linspace(0.0, 2e-3, points + 1)[1:], [], [], []
    for _ in range(sizes["draws"]):
        young, offset = random.uniform(1e5, 1e6), random.uniform(-1e-4, 1e-4)
        true = {"young": young, "offset": offset, "poisson": POISSON}
        if "poisson" in fitted:
            true["poisson"] = random.uniform(0.42, 0.49)
        force = young * tabled.force({**held, **true}, depths + offset)
        force += noise * (force + 0.02 * force.max()) * random.normal(size=points)
        drawn = Curve("drawn", BALL, depths, force.clip(0.0))
        found = Problem([drawn], [tabled], fitted, {**held, "poisson": true["poisson"]}).fit()
        hits.append(
            [
                [low <= true[name] <= high for low, high in found.intervals[name].values()]
                for name in fitted
            ]
        )
        wide.append([not np.isfinite(found.intervals[name][0.95]).all() for name in fitted])
        off.append([found.values[name] - true[name] for name in fitted])
    told = zip(fitted, np.mean(hits, axis=0), np.mean(wide, axis=0), np.array(off).T, strict=True)
    parameters = {
        name: {
            "within 68 %": float(share[0]),
            "within 95 %": float(share[1]),
            "open": float(ends),
            "median error": float(np.median(np.abs(errors))),
        }
        for name, share, ends, errors in told
    }
    return {"points": points, "noise": noise, "parameters": parameters}
