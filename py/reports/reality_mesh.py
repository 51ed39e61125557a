"""The gel of another simulator, on its own mesh and with its material, by our finite elements."""

from __future__ import annotations

import itertools
from argparse import Namespace
from typing import Any

import numpy as np

from engine import ROOT, Rows, made, run, table, text
from reality_unfitted import RADIUS, rings
from ruffini import Fem, Press, PressError, Shape, SoftBody, TetMesh, sensor

MADE_OF = [
    *("env-core", "py/src", "py/reports/reality_mesh.py"),
    "tests/reference/vitac_gelsight_mini.msh",
]
FILE = ROOT / "tests/reference/vitac_gelsight_mini.msh"
YOUNG, POISSON, LAW = 3e5, 0.3, "neo-hookean"
"""Of their parameter files."""
FRICTION = 2.0
DEPTHS = {"0.5": 5e-4, "1": 1e-3}
STEPS = np.arange(1, 11) * 1e-4
MEASURED = {"0.5": 1.650, "1": 5.964}
"""Force of a real GelSight Mini under the same ball (N), by FEATS."""
SIZES = {"full": {"nodes": 3000, "shortest": 5e-4}, "quick": {"nodes": 400, "shortest": 2e-3}}
"""About how many nodes our pad has, and how long edges of theirs are where it is cut finer (m)."""
RINGS = (1e-3, 2e-3, 3e-3)
"""Radii towards which ours is refined (m)."""
GROWTH = 0.4
"""Length of an edge of theirs, cut finer, over its distance from the middle of the face."""


def make(options: Namespace) -> dict[str, Any]:
    """Facts of both meshes, and the press on each."""
    sizes = SIZES[options.form]
    rows = Rows.of("reality_mesh", options, MADE_OF, sizes)
    cases = {
        "theirs, linear": (their_mesh(), "p1"),
        "theirs, quadratic": (their_mesh(), "p2"),
        "theirs cut finer, quadratic": (their_mesh(sizes["shortest"]), "p2"),
        "ours, quadratic": (our_mesh(sizes["nodes"]), "p2"),
    }
    run(rows, {key: (pressed, *case) for key, case in cases.items()})
    found = {row["key"]: row for row in rows}
    return rows.header | {"note": options.note, "rows": [found[key] for key in cases]}


def their_mesh(shortest: float = np.inf) -> TetMesh:
    """Their mesh, edges near the middle of its face cut until they are about `shortest` (m)."""
    mesh = TetMesh.read(FILE)
    vertices, tets = mesh.vertices, mesh.tets.astype(int)
    middle = np.array([0.0, 0.0, vertices[:, 2].max()])
    corners = list(itertools.combinations(range(4), 2))
    while True:
        pairs = np.sort(tets[:, corners].reshape(-1, 2), axis=1)
        edges, of_tets, around = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
        of_tets = of_tets.reshape(-1, 6)
        ends = vertices[edges]
        wanted = np.maximum(shortest, GROWTH * np.linalg.norm(ends.mean(axis=1) - middle, axis=1))
        excess = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / wanted
        if (excess <= 1).all():
            return TetMesh(vertices, tets)
        # An edge is cut, in all tetrahedra around it, if it is the longest of each by that measure.
        rank = np.argsort(np.argsort(excess))
        longest = of_tets[np.arange(len(tets)), rank[of_tets].argmax(axis=1)]
        chosen = (np.bincount(longest, minlength=len(edges)) == around) & (excess > 1)
        middles = len(vertices) + np.cumsum(chosen) - 1
        cut = chosen[longest]
        vertices = np.vstack([vertices, ends[chosen].mean(axis=1)])
        halves = [
            np.where(tets[cut] == end[:, None], middles[longest[cut], None], tets[cut])
            for end in edges[longest[cut]].T
        ]
        tets = np.vstack([tets[~cut], *halves])


def our_mesh(nodes: int) -> TetMesh:
    """Mesh of our pad, refined towards the contact."""
    return sensor("gelsight-mini", resolution=nodes, around=rings(RINGS)).mesh


def pressed(mesh: TetMesh, element: str) -> dict[str, Any]:
    """Force (N) and largest displacement (m) under a ball by depth."""
    height = mesh.vertices[:, 2]
    base = np.flatnonzero(height < height.min() + 1e-6)
    place = mesh.vertices
    top = float(place[:, 2].max())
    body = SoftBody(mesh, YOUNG, POISSON, LAW, base)
    path = [((0.0, 0.0, top + RADIUS - depth), (0.0, 0.0, 0.0, 1.0)) for depth in STEPS]
    frames = Fem(body, friction=FRICTION, element=element).solve_path(
        Press(Shape.sphere(RADIUS), path)
    )
    for frame in frames:
        if isinstance(frame, PressError):
            raise frame
    at = {name: frames[int(np.argmin(np.abs(STEPS - depth)))] for name, depth in DEPTHS.items()}
    face = place[place[:, 2] > top - 1e-6]
    return {
        "vertices": len(place),
        "tetrahedra": len(mesh.tets),
        "held": len(base),
        "extents": np.ptp(place, axis=0).tolist(),
        "face": np.ptp(face, axis=0)[:2].tolist(),
        "nearest": float(np.hypot(*face[:, :2].T).min()),
        "volume": volume(mesh),
        "force": {name: float(-frame.wrench[2]) for name, frame in at.items()},
        "peak": {
            name: float(np.linalg.norm(frame.displacement, axis=1).max())
            for name, frame in at.items()
        },
        "residual": max(float(frame.residual) for frame in frames),
    }


def volume(mesh: TetMesh) -> float:
    """Volume of a mesh (m³)."""
    corners = mesh.vertices[mesh.tets]
    return float(np.linalg.det(corners[:, 1:] - corners[:, :1]).sum() / 6)


SECTION = """## The gel mesh of another simulator

ManiSkill-ViTac 2025 simulates the gel of a GelSight Mini on a mesh of {theirs[vertices]} vertices
and {theirs[tetrahedra]} tetrahedra (`tests/reference/vitac_gelsight_mini.msh`): {size}, its face
flat over {flat} and bevelled around that, {theirs[volume]:1e9*.0f} mm³ (ours:
{ours[volume]:1e9*.0f} mm³, its face slightly domed). Its parameters
(`Track_1/configs/parameters/peg_insertion.yaml`) are E 0.3 MPa and ν 0.3. Here that material, taken
as neo-Hookean, is on both meshes; the base is held, and a ball of 7.5 mm is pressed into the middle
in steps of 0.1 mm with friction {friction:g}, by our finite elements and our contact. Their solver,
contact and friction are not compared. *Peak* is the largest displacement of a vertex. In brackets:
difference from ours.

{table}

{verdict}

{made}"""


def versus(row: dict[str, Any], ours: dict[str, Any], key: str, depth: str) -> float:
    """Relative difference of a row's figure from ours."""
    return float(row[key][depth] / ours[key][depth] - 1)


def rows(part: dict[str, Any]) -> list[dict[str, str]]:
    """Their mesh as it is, and cut finer, under our finite elements."""
    theirs, _, finer, ours = part["rows"]
    off = [
        " and ".join(f"{100 * versus(r, ours, 'force', d):+.1f} %" for d in DEPTHS)
        for r in (theirs, finer)
    ]
    row = {"what": "gel mesh of a GelSight Mini", "by": "ManiSkill-ViTac, a simulator"}
    row |= {"ours": "force on their mesh by linear elements, against that on ours"}
    row |= {"difference": f"{off[0]}; cut finer and quadratic {off[1]}"}
    return [row | {"because": "a mesh that is too coarse; what is left, the shape of the gel"}]


def section(part: dict[str, Any]) -> str:
    """The presses in a table, and what their differences come from."""
    theirs, ours = part["rows"][0], part["rows"][-1]

    def cell(row: dict[str, Any], key: str, depth: str) -> str:
        value = f"{row[key][depth]:.3f} N" if key == "force" else f"{1e3 * row[key][depth]:.3f} mm"
        return value + f" ({100 * versus(row, ours, key, depth):+.1f} %)" * (row is not ours)

    columns = {"mesh, elements": "{key}", "vertices": "{vertices}", "tetrahedra": "{tetrahedra}"}
    names = {"force": "force", "peak": "peak"}
    for (key, words), depth in itertools.product(names.items(), DEPTHS):
        columns[f"{words} at {depth} mm"] = lambda row, key=key, depth=depth: cell(row, key, depth)
    about = {"theirs": theirs, "ours": ours, "friction": FRICTION}
    return text(
        SECTION,
        about,
        size=" × ".join(f"{1e3 * length:.4g}" for length in theirs["extents"]) + " mm",
        flat=" × ".join(f"{1e3 * length:.4g}" for length in theirs["face"]) + " mm",
        table=table(columns, part["rows"]),
        verdict=verdict(part["rows"]),
        made=made(part),
    )


def verdict(rows: list[dict[str, Any]]) -> str:
    """Parts of the difference that are due to the mesh, the shape of the gel and the material."""
    linear, _, finer, ours = rows

    def both(row: dict[str, Any], other: dict[str, Any], key: str = "force") -> str:
        return " and ".join(f"{100 * versus(row, other, key, depth):+.1f} %" for depth in DEPTHS)

    real = {"force": MEASURED}
    return (
        "**The mesh**: with one shape and one material, linear elements on their mesh have forces "
        f"{both(linear, finer)} (at 0.5 and 1 mm) beside quadratic ones on that mesh cut finer to "
        f"{finer['vertices']} vertices. The vertices of theirs lie some millimetres apart, the "
        f"nearest to the middle of the face {1e3 * linear['nearest']:.2f} mm beside it, so that "
        "one of them sinks deeper than the ball. **The shape**: what is left between theirs, cut "
        f"finer, and ours is {both(finer, ours)}. **The material**: a real Mini had "
        f"{MEASURED['0.5']:.3f} and {MEASURED['1']:.3f} N under such a ball (FEATS, above). From "
        f"that their mesh with their material is {both(linear, real)}, and cut finer "
        f"{both(finer, real)}: the coarse mesh, which is too stiff, makes up for a material that "
        "is softer than that gel."
    )
