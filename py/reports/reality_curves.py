"""Force of a GelSight Mini under a ball, fitted; and how far intervals of fits can be trusted."""

from __future__ import annotations

import itertools
from argparse import Namespace
from typing import Any

import numpy as np
from scipy.stats import binom

from engine import ROOT, Rows, made, run, table, text
from ruffini import Shape
from ruffini.commands.fitting import GRIDS, RANGES, Curve, GelModel, Problem, Table, read_curve

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
        "finer": [[2000, STICKY], [2000, 0.0]],
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
    drawn = {
        f"draws {points} points, {', '.join(fitted)}": (
            *(drawn_fits, tabled(LAW, sizes["nodes"], axes, smooth), points, fitted, sizes),
        )
        for points, fitted, axes in (
            (4, ("young", "offset"), ()),
            (20, ("young", "offset"), ()),
            (20, ("young", "poisson", "offset"), ("poisson",)),
        )
    }
    run(rows, drawn)
    coverage = [row for row in rows if row["key"] in drawn]
    measured = curve()
    about = {"depths": measured.depths.tolist(), "forces": measured.forces.tolist()}
    return rows.header | {"note": options.note, **about, "fits": fits, "coverage": coverage}


def _fits(sizes: dict[str, Any]) -> list[tuple[tuple[str, ...], str, float, int]]:
    """Parameters, law, friction and mesh of each fit."""
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
    return {"force": [0.0, *GelModel(SENSOR, law, nodes).solve(BALL, DEPTHS[1:], at).tolist()]}


def curve() -> Curve:
    """Curve measured by FEATS."""
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
    """Coverage of the confidence intervals on noisy curves of known parameters."""
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
    by_name = zip(
        fitted, np.mean(hits, axis=0), np.mean(wide, axis=0), np.array(off).T, strict=True
    )
    parameters = {
        name: {
            "within 68 %": float(share[0]),
            "within 95 %": float(share[1]),
            "open": float(ends),
            "median error": float(np.median(np.abs(errors))),
        }
        for name, share, ends, errors in by_name
    }
    return {"points": points, "noise": noise, "parameters": parameters}


HEIGHT = 4.0
SECTION = """### Fitted

What `ruffini calibrate` fits to the same four points, by quadratic elements; ν is FEATS' {poisson}
where it is not fitted. The goal is an error of at most {goal:100*.0f} % at each depth, and also at
each depth that the fit has not seen.

{verdict}

{fits}

In brackets is the 95 % interval of the profile likelihood; *open* stands where the range of the
parameter ends first ({ranges}). Four points leave one to three degrees of freedom, so that
intervals are wide and rest on normal errors. *Left out*: error at each depth of the fit to the
three others.

The source does not say at what friction the curve was taken, how the first touch was found or how
thick that gel was, and four points do not tell these apart: less friction, a thicker gel and a
softer law each lower the force at 2 mm beside that at 1 mm.

A curve of 31 points from Taxim (`tests/reference/taxim_force_depth.csv`) is not fitted: which
indenter it was taken with is not stated.

## Do the intervals hold what they say?

{draws} curves each, drawn from the tables without friction: E from 0.1 to 1 MPa, offset from -0.1
to 0.1 mm, ν from 0.42 to 0.49 where it is fitted, {noise:100*.0f} % of noise. *No end*: share of
95 % intervals that reach an end of the range. In nineteen of twenty runs of {draws} draws, a share
of 68 % is found within {chance[0]:100*.0f} and {chance[1]:100*.0f} %, and one of 95 % within
{chance[2]:100*.0f} and {chance[3]:100*.0f} %. Intervals that reach an end of the range hold the
truth more often than they say. Curves are drawn and fitted with one table: a wrong friction,
thickness or law, which measurements may have, is not in these shares.

{coverage}

{made}"""
UNITS = {
    "young": (1e-6, "E", "MPa"),
    "offset": (1e3, "offset", "mm"),
    "poisson": (1.0, "ν", ""),
    "friction": (1.0, "μ", ""),
    "thickness": (1.0, "thickness", "×"),
}
"""Factor, symbol and unit of a parameter on the page."""


def written(name: str, *values: float | None) -> str:
    """Values of a parameter in its unit."""
    factor, _, unit = UNITS[name]
    ends = ["open" if value is None else f"{round(factor * value, 6):.3g}" for value in values]
    return f"{' to '.join(ends)} {unit * (ends[-1] != 'open')}".rstrip()


def within(found: dict[str, Any]) -> list[bool]:
    """Returns whether a fit meets the goal with all depths, and with each left out."""
    return [max(np.abs(found[key])) <= GOAL for key in ("errors", "left out")]


def chance(draws: int) -> list[float]:
    """Ends of what nineteen of twenty shares lie in, drawn with 68 and with 95 %."""
    ends = [(share, end) for share in (0.68, 0.95) for end in (0.025, 0.975)]
    return [float(binom.ppf(end, draws, share)) / draws for share, end in ends]


def percents(errors: list[float]) -> str:
    """Errors in a cell."""
    return " ".join(f"{100 * error:+.1f}" for error in errors)


FITS = {
    "law": "{law}",
    "nodes": "{nodes}",
    "μ": lambda row: "fitted" if "friction" in row["fitted"] else f"{row['friction']:g}",
    "fitted": lambda row: "; ".join(
        f"{UNITS[name][1]} {written(name, value)} ({written(name, *row['intervals'][name])})"
        for name, value in row["values"].items()
    ),
    "errors (%)": lambda row: percents(row["errors"]),
    "left out (%)": lambda row: percents(row["left out"]),
    "goal met": lambda row: ("no", "by the fit", "yes")[sum(within(row))],
}
COVERAGE = {
    "points": "{points}",
    "fitted": "{fitted}",
    "parameter": lambda row: UNITS[row["name"]][1],
    "in 68 %": "{within 68 %:100*.0f} %",
    "in 95 %": "{within 95 %:100*.0f} %",
    "no end": "{open:100*.0f} %",
    "median error": lambda row: written(row["name"], row["median error"]),
}


def rows(part: dict[str, Any]) -> list[dict[str, str]]:
    """The fit without friction, and what is not fitted."""
    found = usual(part["fits"], 0.0)
    most, left = (100 * np.abs(found[key]).max() for key in ("errors", "left out"))
    row = {"what": "the same", "by": "FEATS, measured"}
    row |= {"ours": "the same with E and an offset in depth fitted, μ 0"}
    row |= {"difference": f"at most {most:.1f} %; {left:.1f} % at a depth left out"}
    row |= {"because": "too few points to tell friction, thickness and law apart"}
    other = {"what": "force of a GelSight with gel pad v6 at 31 depths", "by": "Taxim, measured"}
    other |= {"ours": "none", "difference": "–", "because": "its indenter is not stated"}
    return [row, other]


def section(part: dict[str, Any]) -> str:
    """The fits, and how far intervals can be trusted."""
    sizes = part["sizes"]
    found = [
        {"points": row["points"], "name": name, **figures}
        | {"fitted": ", ".join(UNITS[one][1] for one in row["parameters"])}
        for row in part["coverage"]
        for name, figures in row["parameters"].items()
    ]
    about = {
        "poisson": POISSON,
        "goal": GOAL,
        "ranges": ", ".join(f"{UNITS[n][1]} {written(n, *two)}" for n, two in RANGES.items()),
        "draws": sizes["draws"],
        "noise": part["coverage"][0]["noise"],
        "chance": chance(sizes["draws"]),
    }
    return text(
        SECTION,
        about,
        verdict=verdict(part["fits"]),
        fits=table(FITS, part["fits"]),
        coverage=table(COVERAGE, found),
        made=made(part, {"nodes": sizes["nodes"], "seed": sizes["seed"]}),
    )


def usual(fits: list[dict[str, Any]], friction: float) -> dict[str, Any]:
    """The fit of E and offset with that friction, on the finest mesh."""
    kind = (["young", "offset"], LAW, friction)
    some = [one for one in fits if (one["fitted"], one["law"], one["friction"]) == kind]
    return max(some, key=lambda one: one["nodes"])


def verdict(fits: list[dict[str, Any]]) -> str:
    """Lists the fits that meet the goal: E and offset alone, with and without friction; others."""
    lines = []
    for friction in (STICKY, 0.0):
        found = usual(fits, friction)
        most, left = (100 * np.abs(found[key]).max() for key in ("errors", "left out"))
        values = [f"{UNITS[n][1]} {written(n, value)}" for n, value in found["values"].items()]
        lines.append(
            f"with friction {friction:g} ({', '.join(values)}; {found['nodes']} nodes) the fit is "
            f"off by at most {most:.1f} %, and by {left:.1f} % at a depth left out"
        )
    by_fit, left_out = np.array([within(one) for one in fits]).T
    best = [
        f"{one['law']}, μ {one['friction']:g}, {', '.join(UNITS[n][1] for n in one['fitted'])}"
        for one, met in zip(fits, by_fit & left_out, strict=True)
        if met
    ]
    return (
        f"E and offset alone: {'; '.join(lines)}. Of {len(fits)} fits {by_fit.sum()} meet the goal "
        f"at the depths that they have seen, and {len(best)} also at those left out"
        f"{': ' * bool(best)}{'; '.join(best)}. So many were tried on four points that one of them "
        "meeting it says little."
    )


def draw(part: dict[str, Any], figure: Any) -> None:
    """Measured and fitted forces, the errors of fits, and shares of intervals."""
    left, middle, right = figure.subplots(1, 3)
    depths = 1e3 * np.array(part["depths"])
    left.plot(depths, part["forces"], "ko", label="measured (FEATS)")
    for colour, friction in enumerate((STICKY, 0.0)):
        found, kept = usual(part["fits"], friction), {"color": f"C{colour}"}
        name = f"E and offset fitted, μ {friction:g}"
        left.plot(np.linspace(0, 2, 41), found["curve"], label=name, **kept)
        middle.plot(depths, 100 * np.array(found["errors"]), "o-", label=name, **kept)
        others = 100 * np.array(found["left out"])
        middle.plot(depths, others, "x:", label="the same, fitted to the others", **kept)
    middle.axhspan(-100 * GOAL, 100 * GOAL, color="k", alpha=0.08)
    left.set(title="GelSight Mini, ball of 7.5 mm", xlabel="depth (mm)", ylabel="N")
    middle.set(title="Error of the force", xlabel="depth (mm)", ylabel="%")
    for row in part["coverage"]:
        names = [f"{UNITS[name][1]}, {level} %" for name in row["parameters"] for level in (68, 95)]
        figures = row["parameters"].values()
        shares = [100 * one[f"within {level} %"] for one in figures for level in (68, 95)]
        label = f"{row['points']} points, {len(row['parameters'])} parameters"
        right.plot(names, shares, "o", alpha=0.6, label=label)
    for level in (68, 95):
        right.axhline(level, color="k", lw=0.5)
    right.tick_params(axis="x", rotation=30)
    right.set(title="Intervals that hold the truth", ylabel="%", ylim=(40, 102))
    for axis in (left, middle, right):
        axis.grid(alpha=0.3)
        axis.legend(fontsize=6)
