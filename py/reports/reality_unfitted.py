"""Force of a GelSight Mini under a ball by each model of the pad, nothing fitted."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from typing import Any

import numpy as np

from engine import Rows, made, run, table, text
from reality_curves import BALL, SENSOR, curve
from ruffini import Fem, LinearPad, Press, PressError, Surrogate, sensor

MADE_OF = [
    *("env-core", "py/src", "py/reports/reality_unfitted.py"),
    "tests/reference/feats_force_depth.csv",
]
CALIBRATION, RADIUS = "feats", 7.5e-3
MODELS = {"Fem": "finite elements", "LinearPad": "linear elasticity", "Surrogate": "network"}
"""Models by their class, and what the page calls them."""
FRICTIONS = (0.0, 0.2, 1.0, 2.0)
DEPTHS = np.arange(1, 23) * 1e-4
"""Load steps (m), beyond the deepest point, so that a force is found at another depth."""
SIZES = {"full": {"nodes": 2500, "refined": 2000}, "quick": {"nodes": 400, "refined": 300}}
"""About how many nodes finite elements have, and have on a mesh refined towards the contact."""
RINGS = (1e-3, 2e-3, 3e-3, 4e-3, 5e-3)
"""Radii towards which that is refined (m); at the last depth the ball touches about so far."""


def make(options: Namespace) -> dict[str, Any]:
    """Forces along the path by each model and friction."""
    sizes = SIZES[options.form]
    rows = Rows.of("reality_unfitted", options, MADE_OF, sizes)
    asked = [("Fem", sizes["nodes"], friction) for friction in FRICTIONS]
    asked += [("Fem", sizes["refined"], FRICTIONS[n]) for n in (0, -1)]
    asked += [(name, 0, friction) for name in list(MODELS)[1:] for friction in FRICTIONS]
    refined = sizes["refined"]
    cases = {f"{one[0]}, {one[1]}, {one[2]}": (*one, one[1] == refined) for one in asked}
    run(rows, {key: (solved, *case) for key, case in cases.items()})
    found, measured = {row["key"]: row for row in rows}, curve()
    about = {"depths": measured.depths.tolist(), "forces": measured.forces.tolist()}
    return rows.header | {"note": options.note, **about, "rows": [found[key] for key in cases]}


def solved(name: str, nodes: int, friction: float, refined: bool) -> dict[str, Any]:
    """Force of a model (N) by depth, and the error of it that a network predicts."""
    if name == "Fem":
        pad = sensor(SENSOR, CALIBRATION, nodes, around=rings(RINGS) if refined else None)
        model: Any = Fem(pad, friction=friction, element="p2")
    else:
        kind: Any = {"LinearPad": LinearPad, "Surrogate": Surrogate}[name]
        model = kind(SENSOR, CALIBRATION, friction=friction)
    path = [((0.0, 0.0, RADIUS - depth), (0.0, 0.0, 0.0, 1.0)) for depth in DEPTHS]
    frames = model.solve_path(Press(BALL, path))
    for frame in frames:
        if isinstance(frame, PressError):
            raise frame
    row = {
        "model": name,
        "nodes": nodes,
        "friction": friction,
        "vertices": len(model.body.mesh.vertices),
        "force": [float(-frame.wrench[2]) for frame in frames],
        "residual": max(float(frame.residual) for frame in frames),
    }
    if name == "Surrogate":
        row["predicted"] = [float(frame.predicted_error[2]) for frame in frames]
        row["known"] = [bool(model.is_in_distribution(frame)) for frame in frames]
    return row


def rings(radii: Sequence[float]) -> Any:
    """Points on the face around the middle (K, 3), to refine a mesh towards."""
    turn = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    circle = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    return np.vstack([np.zeros((1, 3)), *(radius * circle for radius in radii)])


HEIGHT = 2.8
SECTION = """## Force of a GelSight Mini under a ball

FEATS (Helmut et al. 2024) measured the normal force of a real GelSight Mini under a steel ball of
7.5 mm at four depths (`tests/reference/feats_force_depth.csv`).

### Nothing fitted

What each model says with the material that FEATS published (calibration `feats` of the sensor:
neo-Hookean, E 0.428 MPa, ν 0.475), the ball pressed straight into the apex in steps of 0.1 mm, and
depths taken as they are written. *Finite elements* are quadratic, *linear elasticity* is
`LinearPad`, the *network* is `Surrogate`; errors are of the measured force. Other elements, another
calibration and closed forms are on [another page](fem.md#force-of-a-gelsight-mini-nothing-fitted).

{table}

**Finite elements against the measurement.** {elements}

{shift}

{source}

**The faster models against the finite elements**, at the same friction, from the first to the last
of the four depths. {linear} {network}

{made}"""
TABLE = {
    "by": "{by}",
    "μ": "{friction}",
    "vertices": "{vertices}",
    **{f"{1e3 * depth:g} mm": f"{{cells[{n}]}}" for n, depth in enumerate(curve().depths)},
}


def at_points(part: dict[str, Any], row: dict[str, Any], key: str = "force") -> Any:
    """Values of a row at the measured depths (4,)."""
    return np.interp(part["depths"], DEPTHS, row[key])


def errors(part: dict[str, Any], row: dict[str, Any], other: dict[str, Any] | None = None) -> Any:
    """Errors of the force (4,) of the measured one, or of another row's."""
    return at_points(part, row) / (part["forces"] if other is None else at_points(part, other)) - 1


def rows_of(part: dict[str, Any], name: str, size: str = "nodes") -> list[dict[str, Any]]:
    """Rows of a model by friction; of finite elements on one of two meshes."""
    nodes = part["sizes"][size] if name == "Fem" else 0
    return [row for row in part["rows"] if (row["model"], row["nodes"]) == (name, nodes)]


def rows(part: dict[str, Any]) -> list[dict[str, str]]:
    """Finite elements with nothing fitted."""
    found = rows_of(part, "Fem")
    off = spanned([errors(part, row) for row in found])
    ends = f"μ {found[0]['friction']:g} to {found[-1]['friction']:g}"
    row = {"what": "force of a GelSight Mini under a ball at four depths", "by": "FEATS, measured"}
    row |= {"ours": f"finite elements with FEATS' material, nothing fitted, {ends}"}
    row |= {"difference": off, "because": "friction, which is not stated, where it is deep"}
    row["because"] += "; where it is shallow, not known: the first touch, or the material"
    return [row]


def section(part: dict[str, Any]) -> str:
    """The forces in a table, and what can be said of their errors."""
    told = [{"by": "measured", "friction": "", "vertices": ""}]
    told[0]["cells"] = [f"{force:.3f} N" for force in part["forces"]]
    for name, words in MODELS.items():
        for row in rows_of(part, name):
            pairs = zip(at_points(part, row), errors(part, row), strict=True)
            cells = [f"{force:.3f} ({100 * error:+.1f} %)" for force, error in pairs]
            told.append({"by": words, **row, "friction": f"{row['friction']:g}", "cells": cells})
    return text(
        SECTION,
        {},
        table=table(TABLE, told),
        elements=elements(part),
        shift=shift(part),
        source=source(part),
        linear=linear(part),
        network=network(part),
        made=made(part),
    )


def spanned(values: Any) -> str:
    """The least and the largest of some shares in per cent."""
    return f"{100 * np.min(values):+.1f} to {100 * np.max(values):+.1f} %"


def elements(part: dict[str, Any]) -> str:
    """Errors against depth and friction, and the part that is due to the mesh."""
    rows, refined = rows_of(part, "Fem"), rows_of(part, "Fem", "refined")
    found = np.array([errors(part, row) for row in rows])
    forces = np.array([at_points(part, row) for row in rows])
    change = 100 * (forces.max(axis=0) / forces.min(axis=0) - 1)
    sliding = 100 * np.abs(errors(part, rows[-1], rows[-2])).max()
    pairs = [(a, b) for a in refined for b in rows if a["friction"] == b["friction"]]
    mesh = 100 * max(np.abs(errors(part, *pair)).max() for pair in pairs)
    checked = " and ".join(f"{row['friction']:g}" for row in refined)
    first, last = (f"{1e3 * part['depths'][n]:g} mm" for n in (0, -1))
    return (
        f"At {first} all are off by {spanned(found[:, 0])}, at {last} by {spanned(found[:, -1])}. "
        f"Friction changes the force by {change[0]:.1f} % at {first} and by {change[-1]:.0f} % at "
        f"{last} (from 1 to 2 by at most {sliding:.2f} % anywhere). The measurement's is not "
        f"known, so it can be the reason for much of the error at {last}, but not for that at "
        f"{first}. The mesh is the reason for neither: on one refined towards the contact, of "
        f"{refined[0]['vertices']} vertices, forces with μ {checked} change "
        f"by at most {mesh:.1f} %. Another E would scale all forces alike, which takes away no "
        "errors of opposite signs."
    )


def shift(part: dict[str, Any]) -> str:
    """Further depth at which finite elements have the measured forces."""
    rows = rows_of(part, "Fem")
    # The root of the force is nearly straight in depth.
    roots = [np.sqrt([0.0, *row["force"]]) for row in rows]
    depths = np.array([np.interp(np.sqrt(part["forces"]), root, [0, *DEPTHS]) for root in roots])
    found = 1e3 * (depths - part["depths"])
    lines = [
        f"{', '.join(f'{value:+.3f}' for value in values)} mm with μ {row['friction']:g}"
        for row, values in zip(rows, found, strict=True)
    ]
    nearest = int(np.argmin(np.ptp(found, axis=1)))
    return (
        "They have the measured forces at other depths, which differ from those of the four points "
        f"by {'; '.join(lines)}. Had the measurement noticed the first touch late, and were there "
        "no other error, the four would be one number. Nearest to that comes μ "
        f"{rows[nearest]['friction']:g}, from {found[nearest].min():+.3f} to "
        f"{found[nearest].max():+.3f} mm."
    )


def source(part: dict[str, Any]) -> str:
    """The fit by which FEATS found the material, and the material that it would give here."""
    row = rows_of(part, "Fem")[-1]
    force, measured = at_points(part, row), np.array(part["forces"])
    factor = float(force @ measured / (force @ force))
    return (
        "FEATS found this material by finite elements of its own, tied to the ball, and least "
        "squares of newtons, to which the first point adds little "
        "(`src/calculix/src/hyperelasticity_identification` of its code, commit 035fb9e). By the "
        f"same sum ours, with the most friction, would need {factor:.2f} times its E. So the two "
        "finite element models of this gel differ from each other, too; in what is not known."
    )


def linear(part: dict[str, Any]) -> str:
    """Linear elasticity against finite elements."""
    pairs = zip(rows_of(part, "LinearPad"), rows_of(part, "Fem"), strict=True)
    found = np.array([errors(part, *pair) for pair in pairs])
    return (
        f"Linear elasticity is off by {spanned(found[:, 0])} and, where the ball is half of the "
        f"gel deep, by {spanned(found[:, -1])}: it assumes small strains, so the error grows with "
        "depth."
    )


def network(part: dict[str, Any]) -> str:
    """The network against finite elements, and what it says of itself."""
    rows = rows_of(part, "Surrogate")
    found = np.array([errors(part, *pair) for pair in zip(rows, rows_of(part, "Fem"), strict=True)])
    told = np.array([at_points(part, row, "predicted") for row in rows])
    known = np.array([at_points(part, row, "known") for row in rows]) > 0.5
    inside = int((np.abs(found) < told).sum())
    pairs = zip(part["depths"], known.all(axis=0), strict=True)
    beyond = [f"{1e3 * depth:g} mm" for depth, all_known in pairs if not all_known]
    return (
        f"The network, which corrects it, is off by {spanned(found[:, 0])} and "
        f"{spanned(found[:, -1])}, and by at most {100 * np.abs(found[:, :-1]).max():.1f} % before "
        f"the last depth. {inside} of these {found.size} errors are below the one that it "
        f"predicts, {100 * told.min():.0f} to {100 * told.max():.0f} % of the force; at "
        f"{' and '.join(beyond) or 'no depth'} it says itself that the press lies outside of most "
        "of its training data (`network.is_in_distribution`). It has learnt from finite elements "
        "and from no measurement: where it is nearer to the measurement than they are, its own "
        "error happens to have the right sign."
    )


def draw(part: dict[str, Any], figure: Any) -> None:
    """Error of the force by depth, a panel for each model."""
    for axis, (name, words) in zip(figure.subplots(1, 3, sharey=True), MODELS.items(), strict=True):
        for row in rows_of(part, name):
            depths = 1e3 * np.array(part["depths"])
            axis.plot(depths, 100 * errors(part, row), "o-", label=f"μ {row['friction']:g}")
        axis.axhline(0, color="k", lw=0.5)
        axis.set(title=f"Nothing fitted: {words}", xlabel="depth (mm)", ylabel="error of force (%)")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=6)
