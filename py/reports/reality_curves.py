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
FRICTIONS = (0.0, 0.2, STICKY)
LAWS = ["neo-hookean", "stable-neo-hookean", "corotated", "linear"]
KINDS = {
    "E": ("young",),
    "E, offset": ("young", "offset"),
    "E, stand": ("young", "stiffness"),
    "E, offset, stand": ("young", "offset", "stiffness"),
}
"""Parameters that are fitted with each law and friction."""
SIZES: dict[str, dict[str, Any]] = {
    "full": {"nodes": 1000, "finer": 2000, "laws": LAWS, "draws": 100, "seed": 20261126},
    "quick": {"nodes": 200, "finer": 400, "laws": LAWS[:1], "draws": 5, "seed": 20261126},
}
GOAL = 0.05
"""Error of force that a fit shall stay below at every depth."""


def make(options: Namespace) -> dict[str, Any]:
    """Solved paths, fits to what was measured, and fits to drawn curves."""
    sizes = SIZES[options.form]
    rows = Rows.of("reality_curves", options, MADE_OF, sizes)
    asked = []
    for fitted, law, friction, nodes in _fits(sizes):
        held = {"poisson": POISSON, "friction": friction, "thickness": 1.0}
        asked += [(law, *at.values(), nodes) for at in _grid(fitted, held)]
    asked += [(LAW, poisson, 0.0, 1.0, sizes["nodes"]) for poisson in GRIDS["poisson"]]
    run(rows, {_key(*path): (solved, *path) for path in asked})
    paths = {row["key"]: np.array(row["force"]) for row in rows if "force" in row}

    def tabled(law: str, nodes: int, fitted: tuple[str, ...], held: dict[str, float]) -> Table:
        """A table of solved paths."""
        forces = [paths[_key(law, *at.values(), nodes)] for at in _grid(fitted, held)]
        grids = {name: np.array(grid) for name, grid in GRIDS.items() if name in fitted}
        values = np.array(forces) ** (2 / 3)
        return Table(DEPTHS, grids, values.reshape(*map(len, grids.values()), -1))

    fits = []
    for number, (fitted, law, friction, nodes) in enumerate(_fits(sizes)):
        held = {"poisson": POISSON, "friction": friction, "thickness": 1.0}
        found = fit(tabled(law, nodes, fitted, held), fitted, held)
        fits.append({"number": number, "law": law, "nodes": nodes, "friction": friction, **found})
    smooth = {"poisson": POISSON, "friction": 0.0, "thickness": 1.0}
    drawn = {
        f"draws {points} points, {', '.join(fitted)}": (
            *(drawn_fits, tabled(LAW, sizes["nodes"], fitted, smooth), points, fitted, sizes),
        )
        for points, fitted in (
            (4, ("young", "offset")),
            (4, ("young", "stiffness")),
            (20, ("young", "offset")),
            (20, ("young", "offset", "stiffness")),
            (20, ("young", "poisson", "offset")),
        )
    }
    run(rows, drawn)
    coverage = [row for row in rows if row["key"] in drawn]
    measured = curve()
    about = {"depths": measured.depths.tolist(), "forces": measured.forces.tolist()}
    about["paths"] = {key: force.tolist() for key, force in paths.items()}
    return rows.header | {"note": options.note, **about, "fits": fits, "coverage": coverage}


def _fits(sizes: dict[str, Any]) -> list[tuple[tuple[str, ...], str, float, int]]:
    """Parameters, law, friction and mesh of each fit."""
    nodes = sizes["nodes"]
    usual = itertools.product(KINDS.values(), sizes["laws"], FRICTIONS, [nodes])
    finer = itertools.product(KINDS.values(), [LAW], FRICTIONS, [sizes["finer"]])
    others = itertools.product(("poisson", "thickness"), (STICKY, 0.0))
    return [
        *usual,
        *finer,
        *((("young", name, "offset"), LAW, friction, nodes) for name, friction in others),
        (("young", "friction", "offset"), LAW, 0.0, nodes),
    ]


def _grid(fitted: tuple[str, ...], held: dict[str, float]) -> list[dict[str, float]]:
    """Parameters of a table: all that are held or on its grid, in the order of `held`."""
    axes = [name for name in GRIDS if name in fitted]
    corners = itertools.product(*(GRIDS[name] for name in axes))
    return [{**held, **dict(zip(axes, corner, strict=True))} for corner in corners]


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
    depths = problem.indentation(found.values, 0, np.linspace(0.0, 2e-3, 41))
    force = found.values["young"] * tabled.force({**held, **found.values}, depths)
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
        true = {"young": random.uniform(1e5, 1e6), "offset": random.uniform(-1e-4, 1e-4)}
        if "poisson" in fitted:
            true["poisson"] = random.uniform(0.42, 0.49)
        if "stiffness" in fitted:
            true["stiffness"] = np.exp(random.uniform(*np.log([5e4, 5e5])))
        true = {name: true[name] for name in fitted}
        other = {**held, **true}
        drawn = Problem([Curve("", BALL, depths, depths)], [tabled], fitted, other)
        [force] = drawn.forces(true)
        force += noise * (force + 0.02 * force.max()) * random.normal(size=points)
        drawn = Problem([Curve("", BALL, depths, force.clip(0.0))], [tabled], fitted, other)
        found = drawn.fit()
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
where it is not fitted. E scales all forces. An *offset* is added to all depths: the first touch was
noticed late or early. A *stand* yields like a spring behind gel or ball (housing, window, test
stand): at a force F the gel takes the depth less F/k. The goal is an error of at most
{goal:100*.0f} % at each depth, and also at each depth that the fit has not seen.

Largest errors (%) with all four depths fitted, and of each depth by the fit to the three others;
bold where both meet the goal:

{matrix}

**What the four points show.** {verdict}

**What they do not show.** That it is a stand. It was thought of when the errors had been seen, and
{count} fits were tried on four points. {rivals} Friction, the thickness of that gel and how the
first touch was found are not stated either, and k takes what they leave: it is {ends} with the
frictions of the table. With offset and stand no point is left to judge by: the errors of depths
left out are those of three unknowns by three points.

**What would show it.** A steel plate in the place of the gel, in the same stand: force by way is
then a line, and its slope is k, which `--stiffness` holds. Or a second ball: E and k have to come
out the same, which they would not if the gel were softer than its law at large strains. Or the
width of the contact in the camera's picture, which tells how deep the gel is pressed whatever the
stand does.

All parameters of the fits on the finest mesh, and of those with a third parameter of the gel:

{fits}

In brackets is the 95 % interval of the profile likelihood; *open* stands where the range of the
parameter ends first ({ranges}). Four points leave one to three degrees of freedom, so that
intervals are wide and rest on normal errors. *Left out*: error at each depth of the fit to the
three others.

A curve of 31 points from Taxim (`tests/reference/taxim_force_depth.csv`) is not fitted: which
indenter it was taken with is not stated.

## Do the intervals hold what they say?

{draws} curves each, drawn from the tables without friction: E from 0.1 to 1 MPa, offset from -0.1
to 0.1 mm, ν from 0.42 to 0.49 and k from 50 to 500 N/mm, each where it is fitted,
{noise:100*.0f} % of noise. *No end*: share of 95 % intervals that reach an end of the range. In
nineteen of twenty runs of {draws} draws, a share of 68 % is found within {chance[0]:100*.0f} and
{chance[1]:100*.0f} %, and one of 95 % within {chance[2]:100*.0f} and {chance[3]:100*.0f} %.
Intervals that reach an end of the range hold the truth more often than they say. Curves are drawn
and fitted with one table: a wrong friction, thickness or law, which measurements may have, is not
in these shares.

{coverage}

{made}"""
UNITS = {
    "young": (1e-6, "E", "MPa"),
    "offset": (1e3, "offset", "mm"),
    "poisson": (1.0, "ν", ""),
    "friction": (1.0, "μ", ""),
    "thickness": (1.0, "thickness", "×"),
    "stiffness": (1e-3, "k", "N/mm"),
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
MATRIX = {
    "law": "{law}",
    "nodes": "{nodes}",
    "μ": "{friction:g}",
} | {
    kind: lambda row, fitted=fitted: largest(found_of(row["fits"], fitted, row), bold=True)
    for kind, fitted in KINDS.items()
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


def found_of(
    fits: list[dict[str, Any]], fitted: tuple[str, ...], row: dict[str, Any]
) -> dict[str, Any]:
    """The fit of these parameters with the law, mesh and friction of `row`."""
    kept = {"fitted": list(fitted)} | {name: row[name] for name in ("law", "nodes", "friction")}
    return next(one for one in fits if all(one[name] == kept[name] for name in kept))


def most(found: dict[str, Any]) -> list[float]:
    """Largest error of a fit, and of its depths left out, in per cent."""
    return [100 * float(np.abs(found[key]).max()) for key in ("errors", "left out")]


def largest(found: dict[str, Any], bold: bool = False) -> str:
    """Both in a cell."""
    marks = "**" * (bold and all(within(found)))
    return f"{marks}{' / '.join(f'{one:.1f}' for one in most(found))}{marks}"


def finest(fits: list[dict[str, Any]], kind: str) -> list[dict[str, Any]]:
    """Fits of a kind on the finest mesh, by friction."""
    nodes = max(one["nodes"] for one in fits)
    rows = [{"law": LAW, "nodes": nodes, "friction": friction} for friction in FRICTIONS]
    return [found_of(fits, KINDS[kind], row) for row in rows]


def listed(name: str, found: list[dict[str, Any]]) -> str:
    """Smallest and largest value of a parameter in some fits."""
    values = sorted(one["values"][name] for one in found)
    return written(name, values[0], values[-1])


def rows(part: dict[str, Any]) -> list[dict[str, str]]:
    """Fits with an offset and with a stand, and what is not fitted."""
    causes = {
        "offset": "a stand that yields, or a gel that is softer at large strains",
        "stand": "not known; that it is a stand is a guess, which a steel plate would check",
    }
    named, found = {"offset": "an offset in depth", "stand": "a stand that yields"}, []
    for name, because in causes.items():
        errors = [most(one) for one in finest(part["fits"], f"E, {name}")]
        ends = [f"{min(some):.1f} to {max(some):.1f} %" for some in zip(*errors, strict=True)]
        row = {"what": "the same", "by": "FEATS, measured", "because": because}
        row |= {"ours": f"the same with E and {named[name]} fitted, μ 0 to {STICKY:g}"}
        found.append(row | {"difference": f"at most {ends[0]}; {ends[1]} at a depth left out"})
    other = {"what": "force of a GelSight with gel pad v6 at 31 depths", "by": "Taxim, measured"}
    other |= {"ours": "none", "difference": "–", "because": "its indenter is not stated"}
    return [*found, other]


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
        "count": len(part["fits"]),
        "ends": listed("stiffness", finest(part["fits"], "E, stand")),
        "draws": sizes["draws"],
        "noise": part["coverage"][0]["noise"],
        "chance": chance(sizes["draws"]),
    }
    return text(
        SECTION,
        about,
        verdict=verdict(part["fits"]),
        rivals=rivals(part["fits"]),
        matrix=table(MATRIX, cells(part["fits"])),
        fits=table(FITS, detailed(part["fits"])),
        coverage=table(COVERAGE, found),
        made=made(part, {"nodes": sizes["nodes"], "seed": sizes["seed"]}),
    )


def cells(fits: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Each law, mesh and friction with which all kinds are fitted."""
    kept = [one for one in fits if tuple(one["fitted"]) == KINDS["E"]]
    kept.sort(key=lambda one: (LAWS.index(one["law"]), -one["nodes"], one["friction"]))
    return [
        {name: one[name] for name in ("law", "nodes", "friction")} | {"fits": fits} for one in kept
    ]


def detailed(fits: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Fits on the finest mesh, and those of a third parameter of the gel."""
    others = [one for one in fits if tuple(one["fitted"]) not in KINDS.values()]
    return [*(one for kind in KINDS for one in finest(fits, kind)), *others]


def verdict(fits: list[dict[str, Any]]) -> str:
    """Tells of the fits on the finest mesh with an offset, with a stand, and with both."""
    kinds = ("E, offset", "E, stand", "E, offset, stand")
    offset, stand, both = (finest(fits, kind) for kind in kinds)

    def told(found: list[dict[str, Any]]) -> str:
        columns = zip(*map(most, found), strict=True)
        ends = [", ".join(f"{one:.1f}" for one in some) for some in columns]
        return f"at most {ends[0]} %, and by {ends[1]} % at a depth left out"

    late, soft = (
        sum(all(within(found_of(fits, KINDS[kind], row))) for row in cells(fits))
        for kind in kinds[:2]
    )
    frictions = ", ".join(f"{friction:g}" for friction in FRICTIONS)
    return (
        f"With μ {frictions} ({LAW}, {stand[0]['nodes']} nodes), fits of E and an offset are off "
        f"by {told(offset)}; those of E and a stand, as many parameters, by {told(stand)}. Of the "
        f"{len(cells(fits))} rows {soft} meet the goal with a stand, and {late} with an offset. "
        f"With a stand E is {listed('young', stand)}, with an offset {listed('young', offset)}. "
        f"Where both are fitted the offset comes out as {listed('offset', both)}, with wide "
        "intervals. So with friction the model is too stiff where the ball is deep, which a first "
        "touch that was noticed late does not explain; what does grows with the force, as the "
        "yielding of a stand does."
    )


def rivals(fits: list[dict[str, Any]]) -> str:
    """Tells of fits that meet the goal without a stand, and of stands that may be rigid."""
    met = [
        f"{', '.join(UNITS[name][1] for name in one['fitted'])} with the law {one['law']} and "
        f"μ {one['friction']:g} ({largest(one)})"
        for one in fits
        if all(within(one)) and "stiffness" not in one["fitted"]
    ]
    ends = [(one["friction"], one["intervals"]["stiffness"][1]) for one in finest(fits, "E, stand")]
    rigid = ", ".join(f"{friction:g}" for friction, end in ends if end is None)
    return (
        f"Without a stand the goal is met by {'; '.join(met) or 'none'}."
        + f" With μ {rigid} a rigid stand lies in the 95 % interval of k." * bool(rigid)
    )


def draw(part: dict[str, Any], figure: Any) -> None:
    """Measured and fitted forces, the errors of fits, and shares of intervals."""
    left, *errors, right = figure.subplots(1, 4)
    depths = 1e3 * np.array(part["depths"])
    left.plot(depths, part["forces"], "ko", label="measured (FEATS)")
    for colour, kind in enumerate(("E, offset", "E, stand")):
        for found, style in zip(finest(part["fits"], kind), (":", "--", "-"), strict=True):
            label = f"{kind}, μ {found['friction']:g}"
            kept = {"color": f"C{colour}", "linestyle": style, "label": label}
            if found["friction"] == STICKY:
                left.plot(np.linspace(0, 2, 41), found["curve"], **kept)
            for axis, key in zip(errors, ("errors", "left out"), strict=True):
                axis.plot(depths, 100 * np.array(found[key]), marker="o", ms=3, **kept)
    left.set(title="GelSight Mini, ball of 7.5 mm", xlabel="depth (mm)", ylabel="N")
    for axis, title in zip(errors, ("all four depths fitted", "each depth left out"), strict=True):
        axis.axhspan(-100 * GOAL, 100 * GOAL, color="k", alpha=0.08)
        axis.set(title=f"Error of the force, {title}", xlabel="depth (mm)", ylabel="%")
    for row in part["coverage"]:
        names = [f"{UNITS[name][1]}, {level} %" for name in row["parameters"] for level in (68, 95)]
        figures = row["parameters"].values()
        shares = [100 * one[f"within {level} %"] for one in figures for level in (68, 95)]
        label = f"{row['points']} points: {', '.join(UNITS[n][1] for n in row['parameters'])}"
        right.plot(names, shares, "o", alpha=0.6, label=label)
    for level in (68, 95):
        right.axhline(level, color="k", lw=0.5)
    right.tick_params(axis="x", rotation=60)
    right.set(title="Intervals that hold the truth", ylabel="%", ylim=(40, 102))
    for axis in (left, *errors, right):
        axis.grid(alpha=0.3)
        axis.legend(fontsize=6)
