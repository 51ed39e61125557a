"""Motion of a gel's face beside contact, by ANSYS and by our finite elements."""

from __future__ import annotations

import tempfile
from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine import ROOT, Rows, grid, made, run, text
from ruffini import Fem, Press, PressError, Shape, SoftBody, sensor

MADE_OF = ["env-core", "py/src", "py/reports/reality_face.py", "tests/reference/taxim_ansys.npz"]
FIELDS = ROOT / "tests/reference/taxim_ansys.npz"
PAD = """name = "dome"
[outline]
length = 0.022
width = 0.022
thickness = {thickness}
radius_along = 0.0259
radius_across = 0.0259
rim_width = 0.0
rim_radius = inf
[gel]
density = 1000.0
[[calibration]]
name = "assumed"
young = 1e5
poisson = 0.47
law = "neo-hookean"
[friction]
static = 1.0
[markers]
across = 3
along = 3
pitch = 2e-3
[camera]
pixels = [40, 40]
pixel = 5e-4
"""
"""A dome as round as the one in the files; its sides, beyond 11 mm, are cut off."""
DISTANCES = (0.5, 0.7, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0)
"""From the middle of contact (mm); all motion is given over that at `UNIT`."""
UNIT = 1.0
RING = 0.2
"""Half of the width of a ring, of its radius."""
SUNK, SHEARED = 1.1e-4, 8e-5
"""Depth and shear of our press (m), about the largest motion in the files."""
FRICTION = 2.0
REFINED = (0.2, 0.5, 1.0, 2.0, 3.0, 4.5, 6.0)
"""Radii towards which our mesh is graded (mm)."""
CASES = {
    "ν 0.45": (5.5e-3, 0.45, 5e-4),
    "ν 0.47": (5.5e-3, 0.47, 5e-4),
    "ν 0.49": (5.5e-3, 0.49, 5e-4),
    "ν 0.47, ball of 1 mm": (5.5e-3, 0.47, 1e-3),
    "ν 0.47, 6.5 mm thick": (6.5e-3, 0.47, 5e-4),
}
"""Thickness (m), Poisson's ratio and radius of the ball (m)."""
SIZES = {"full": {"nodes": 1500}, "quick": {"nodes": 500}}


def make(options: Namespace) -> dict[str, Any]:
    """Rings of the files and of each of our presses."""
    sizes = SIZES[options.form]
    rows = Rows.of("reality_face", options, MADE_OF, sizes)
    names = list(CASES)[1:2] if options.quick else list(CASES)
    cases = {name: (pressed, *CASES[name], sizes["nodes"]) for name in names}
    run(rows, {"ANSYS": (ansys,), **cases})
    found = {row["key"]: row for row in rows}
    ordered = [found[name] for name in ("ANSYS", *names)]
    return rows.header | {"note": options.note, "rows": ordered}


def rings(
    place: NDArray[np.float64], down: NDArray[np.float64], aside: NDArray[np.float64]
) -> dict[str, Any]:
    """Means on rings of the motion into the gel, away from the middle, and along a shear.

    Args:
        place: From the middle of contact, in the plane of the face (V, 2), in m.
        down: Motion by the press: into the gel, and in the plane (V, 3), in m.
        aside: Motion by the shear, along it (V,), in m.
    """
    r = np.hypot(*place.T)
    outward = (down[:, 1:] * place).sum(axis=1) / np.maximum(r, 1e-9)
    fits = []
    for distance in DISTANCES:
        on = np.abs(1e3 * r / distance - 1) < RING
        # A straight line in the distance, read in the middle of the ring.
        lines = np.column_stack([np.ones(on.sum()), 1e3 * r[on] - distance])
        motion = np.column_stack([down[on, 0], outward[on], aside[on]])
        line = np.linalg.lstsq(lines, motion, rcond=None)[0]
        fits.append((line[0], (motion - lines @ line)[:, 0].std()))
    table = np.array([fit[0] for fit in fits])
    at = DISTANCES.index(UNIT)
    sunk, _, shear = table[at]
    peak = down[:, 0].max()
    return {
        "deepest": float(peak),
        "into": (table[:, 0] / sunk).tolist(),
        "outward": (table[:, 1] / sunk).tolist(),
        "shear": (table[:, 2] / shear).tolist(),
        "deepest over unit": float(peak / sunk),
        "uneven": float(fits[at][1] / sunk),
        "nodes": int((np.abs(1e3 * r / UNIT - 1) < RING).sum()),
    }


def ansys() -> dict[str, Any]:
    """Those of the files, whose z points into the gel."""
    with np.load(FIELDS) as file:
        place, pressed, both = (file[k].astype(float) for k in ("position", "pressed", "sheared"))
    weight = np.maximum(pressed[:, 2], 0) ** 2
    middle = (place[:, :2] * weight[:, None]).sum(axis=0) / weight.sum()
    aside = (both - pressed)[:, :2]
    largest = aside[np.argmax(np.hypot(*aside.T))]
    along = aside @ largest / np.hypot(*largest)
    found = rings(place[:, :2] - middle, pressed[:, [2, 0, 1]], along)
    near = np.sort(np.hypot(*(place[:, :2] - place[np.argmax(pressed[:, 2]), :2]).T))
    touched = int((pressed[:, 2] > 0.5 * pressed[:, 2].max()).sum())
    off = np.hypot(*(place[np.argmax(pressed[:, 2]), :2] - middle))
    return found | {"spacing": float(near[1:7].mean()), "touched": touched, "off": float(off)}


def pressed(thickness: float, poisson: float, radius: float, nodes: int) -> dict[str, Any]:
    """Those of a ball pressed into our dome and moved on sideways, quadratic elements."""
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    around = 1e-3 * np.vstack([[[0, 0, 0]], *(part * ring for part in REFINED)])
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "dome.toml"
        file.write_text(PAD.format(thickness=thickness))
        pad = sensor(str(file), resolution=nodes, around=around)
    body = SoftBody(pad.mesh, 1e5, poisson, "neo-hookean", pad.fixed)
    upright = (0, 0, 0, 1)
    deep = radius - SUNK
    path = [([0, 0, radius - part * SUNK], upright) for part in (0.5, 1.0)]
    path += [([part * SHEARED, 0, deep], upright) for part in (0.5, 1.0)]
    answers = Fem(body, friction=FRICTION, element="p2").solve_path(
        Press(Shape.sphere(radius), path)
    )
    down, both = (_solved(answers[n]).displacement for n in (1, 3))
    place = body.mesh.vertices
    sagitta = np.sqrt(0.0259**2 - place[:, :2] ** 2) - 0.0259
    face = (place[:, 2] > sagitta.sum(axis=1) - 2e-5) & (np.hypot(place[:, 0], place[:, 1]) < 9e-3)
    down, both, place = down[face], both[face], place[face]
    into = np.column_stack([-down[:, 2], down[:, 0], down[:, 1]])
    return rings(place[:, :2], into, both[:, 0] - down[:, 0])


def _solved(answer: Any) -> Any:
    if isinstance(answer, PressError):
        raise answer
    return answer


HEIGHT = 3.2
SECTION = """## Motion of the face beside a small contact

Taxim (Si and Yuan 2022) holds ANSYS fields of a dome of radius 25.9 mm, 5.5 mm high over its rim,
under a small indenter (`tests/reference/taxim_ansys.npz`: nodes within 9 mm, beyond 2.2 mm every
third). Neither indenter nor material nor thickness is in the files, the files' names say 0.3 mm,
and no node moves by more than {ansys[deepest]:1e3*.3f} mm: {ansys[touched]} nodes,
{ansys[spacing]:1e3*.2f} mm apart, move by more than half of that, and the deepest lies
{ansys[off]:1e3*.2f} mm beside the middle of the imprint. So depth, force and the shape of contact
cannot be compared. What is left is how motion decays with distance, which far from a small contact
depends on the thickness and on Poisson's ratio alone.

Ours: a dome as round, taken as {thickness:1e3*.1f} mm thick and bonded to a flat base, under a ball
of 0.5 mm pressed {sunk:1e3*.2f} mm deep and moved {sheared:1e3*.2f} mm sideways, quadratic
elements. Motion on rings, over the motion into the gel (for *shear*, over that along the shear) at
1 mm.

{table}

The sheared field less the pressed one is *shear*. {verdict} Nothing was fitted; thickness and
Poisson's ratio are assumed. Nearer than 1 mm the outward motion has the other sign: by ANSYS the
face moves away from the indenter, in ours it sticks to it and is drawn in; whether theirs slides is
not in the files.

{made}"""
KINDS = {"into": "into the gel", "outward": "outward", "shear": "shear"}


def rows(part: dict[str, Any]) -> list[dict[str, str]]:
    """The model with Poisson's ratio in the middle."""
    ansys = part["rows"][0]
    [ours] = [row for row in part["rows"] if row["key"] == "ν 0.47"]
    off = ", ".join(f"{100 * apart(ours, ansys, kind):.1f} % {of}" for kind, of in KINDS.items())
    row = {"what": "decay of motion around a small contact", "by": "Taxim, by ANSYS"}
    row |= {"ours": "finite elements, ν 0.47, nothing fitted", "difference": off}
    return [row | {"because": "thickness, ν and sliding, none of which is stated"}]


def section(part: dict[str, Any]) -> str:
    """The decays in a table, and how far they are apart."""
    head = ["motion", "", *(f"{distance:g} mm" for distance in DISTANCES)]
    cells = [
        [words, row["key"], *(f"{value:.3f}" for value in row[kind])]
        for kind, words in KINDS.items()
        for row in part["rows"]
    ]
    about = {
        "ansys": part["rows"][0],
        "thickness": CASES["ν 0.47"][0],
        "sunk": SUNK,
        "sheared": SHEARED,
    }
    return text(
        SECTION, about, table=grid(head, cells), verdict=verdict(part["rows"]), made=made(part)
    )


def apart(row: dict[str, Any], other: dict[str, Any], kind: str) -> float:
    """Largest difference from 1 to 7 mm, of the motion at 1 mm."""
    start = DISTANCES.index(UNIT)
    return float(np.abs(np.subtract(row[kind], other[kind])[start:]).max())


def verdict(rows: list[dict[str, Any]]) -> str:
    """Difference of each of our models from ANSYS."""
    parts = [
        f"{row['key']}: "
        + ", ".join(
            f"{100 * apart(row, rows[0], kind):.1f} % {words}" for kind, words in KINDS.items()
        )
        for row in rows[1:]
    ]
    return f"Largest difference from 1 mm on, of the motion at 1 mm: {'; '.join(parts)}."


def draw(part: dict[str, Any], figure: Any) -> None:
    """Decay of each motion."""
    for axis, (kind, words) in zip(figure.subplots(1, 3), KINDS.items(), strict=True):
        for row in part["rows"]:
            style = "ko" if row["key"] == "ANSYS" else "-"
            axis.plot(DISTANCES, row[kind], style, label=row["key"])
        axis.set(title=f"Motion of the face, {words}", xlabel="mm from the middle")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=6)
