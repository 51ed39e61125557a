"""The shipped network on plain shapes, by their size and depth, and by their place on the pad.

Balls and blocks in the middle of the pad, and by its sides and in its corner. The truth is that of
``tests/reference/presses.py``; beside the network stands the linear solution that it corrects.
--quick asks the smallest ball alone.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Collection
from typing import Any

import numpy as np

import ruffini
from engine import COLOURS, ROOT, Rows, made, plt, run, table, text
from ruffini import Press, PressError, Shape

sys.path.insert(0, str(ROOT / "tests/reference"))
import presses

MADE_OF = ["env-core", "tests/reference/presses.py", "py/reports/shapes.py"]
GEL = {"young": 3e5, "poisson": 0.47, "friction": 0.8}
Indenter = tuple[str, float, float]
"""Ball or block, its radius or half its edge (mm), and the depth of the press (mm)."""
MIDDLE: list[Indenter] = [
    *(
        ("ball", radius, depth)
        for radius in (1, 3, 6, 12)
        for depth in (0.1, 0.4, 1, 2)
        if depth < 2 * radius
    ),
    *(("block", 5, depth) for depth in (0.1, 0.4)),
]
"""Presses in the middle alone; under a block's edges finite elements seldom converge beyond."""
EVERYWHERE: list[Indenter] = [
    *(("ball", radius, radius / 10) for radius in (2, 5, 8)),
    ("block", 1.5, 0.2),
]
"""Presses at every place."""
HALF = np.array([presses.OUTLINE["width"], presses.OUTLINE["length"]]) / 2
APART = 2e-3
"""Distance of an indenter's centre from a side (m)."""
PLACES = {
    "middle": (1e-3, 0.0),
    "beside a long side": (HALF[0] - APART, 0.0),
    "beside a short side": (0.0, HALF[1] - APART),
    "corner": (HALF[0] - APART, HALF[1] - APART),
}
"""Places of the indenter's centre (m)."""
SHARES = (0.25, 0.5, 0.75, 1.0)
"""Parts of the depth at which a press has a frame; the last is judged."""
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
MODELS = {"network": ruffini.Surrogate, "linear": ruffini.LinearPad}
PARTS = ("displacement", "stress", "force")
TITLES = ("displacement", "von Mises stress", "force, + too large")


def options(parser: ArgumentParser) -> None:
    """Adds an option: processes."""
    parser.add_argument("--jobs", type=int, default=2, help="processes; 2 if not given")


def make(options: Namespace) -> dict[str, Any]:
    """Every press, by place."""
    rows = Rows.of("shapes", options, MADE_OF, {"friction": GEL["friction"]})
    cases = [("middle", indenter) for indenter in MIDDLE]
    cases += [(place, indenter) for place in PLACES for indenter in EVERYWHERE]
    few = cases[:1] if options.quick else cases
    run(rows, {f"{n:02}": (errors, *case) for n, case in enumerate(few)}, options.jobs)
    found: dict[str, Any] = {place: {} for place in PLACES}
    for row in rows:
        found[row["place"]][row["press"]] = {
            name: row[name]
            for name in ("depth", "force", *MODELS, "truth", "failed")
            if name in row
        }
    return rows.header | {"note": options.note, "places": found}


def errors(place: str, indenter: Indenter) -> dict[str, Any]:
    """Errors of the models in the last frame, of force with its sign, or what failed."""
    kind, size, depth = indenter
    half, spot = 1e-3 * size, np.array(PLACES[place])
    shape = Shape.sphere(half) if kind == "ball" else Shape.cuboid((half, half, half))
    found: dict[str, Any] = {"place": place, "press": named(indenter), "depth": 1e-3 * depth}
    path = down(shape, half, spot, 1e-3 * depth)
    last = len(SHARES) - 1
    truth = presses.truth(GEL, shape, path, [last])
    if not len(truth["force"]):
        return found | {"failed": ["truth"]}
    exact = [truth[name][0] for name in ("displacement", "von_mises", "force")]
    found["force"] = float(np.linalg.norm(exact[2]))
    found["truth"] = dict(zip(PARTS, truth["error"][0].tolist(), strict=True))
    for name, model in MODELS.items():
        answer = model(presses.SENSOR, **GEL).solve_path(Press(shape, path[1:]))[-1]
        if isinstance(answer, PressError):
            return found | {"failed": [name]}
        force = np.linalg.norm(answer.wrench[:3]) / found["force"] - 1
        off = [presses.apart(answer.displacement, exact[0])]
        off += [presses.apart(answer.von_mises, exact[1]), float(force)]
        found[name] = dict(zip(PARTS, off, strict=True))
    return found


def down(shape: Shape, half: float, spot: np.ndarray, depth: float) -> list[presses.Pose]:
    """Poses of first touch over a spot of the face, and straight below."""
    place = np.array([*spot, presses.height(*spot) + half])
    place[2] -= presses.first_touch(shape, (place, UPRIGHT), spot)
    return [(place - [0, 0, share * depth], UPRIGHT) for share in (0.0, *SHARES)]


PAGE = """# The network of pads on plain shapes

Balls (radius) and blocks (half an edge) pressed straight down into the pad of a GelSight Mini,
friction {sizes[friction]}. Errors in %: of displacement / von Mises stress, relative L², / force,
positive where it is too large. *Network* is `Surrogate()`, *linear* the answer that it corrects,
`LinearPad()`. The truth is that of [unseen.md](unseen.md): linear elasticity with finely resolved
contact, plus what the nonlinear law changes of finite elements; *by coarser meshes* is how far it
is from that by the meshes of the training data.

## By size and depth

In the middle of the pad.

{sizes_and_depths}

## By place

The same presses in the middle of the pad, with their centre {apart} mm from one of its sides, and
from two. There the face falls off, and gel can give way to the side.

![errors by place](shapes.svg)

{by_place}

{made}"""


def page(report: dict[str, Any]) -> str:
    """A table by size and depth, one by place, and their medians."""
    return text(
        PAGE,
        report,
        apart=f"{1e3 * APART:g}",
        sizes_and_depths=listed(report, ["middle"], MIDDLE),
        by_place=listed(report, PLACES, EVERYWHERE),
        made=made(report),
    )


def listed(report: dict[str, Any], places: Collection[str], indenters: list[Indenter]) -> str:
    """A row a press at each place, and median errors, that of the force without its sign."""
    names = [named(indenter) for indenter in indenters]
    rows = [
        {"place": place, "press": press} | of
        for place in places
        for press, of in report["places"][place].items()
        if press in names
    ]
    known = [row for row in rows if "failed" not in row]
    if len(known) > 1:
        medians = {
            who: {part: float(np.median([abs(row[who][part]) for row in known])) for part in PARTS}
            for who in (*MODELS, "truth")
        }
        rows.append({"place": "all", "press": "**median**", **medians})
    columns: dict[str, Any] = {"place": "{place}"} if len(places) > 1 else {}
    columns["press"] = "{press}"
    columns["force"] = lambda row: (
        f"not solved by {', '.join(row['failed'])}" if "failed" in row else f"{row['force']:.2f} N"
    )
    for who, heading in [*((who, who) for who in MODELS), ("truth", "(truth, by coarser meshes)")]:
        columns[heading] = lambda row, who=who: shown(row[who], who in MODELS and row in known)
    return table(columns, rows, absent="")


def shown(errors: dict[str, float], signed: bool) -> str:
    """Errors in per cent, that of the force with its sign if wanted."""
    u, stress, force = (100 * errors[part] for part in PARTS)
    return f"{u:.1f} / {stress:.1f} / {force:{'+' if signed else ''}.1f}"


def named(indenter: Indenter) -> str:
    """A press by its indenter and depth."""
    kind, size, depth = indenter
    return f"{kind} {size:g} mm, {depth:g} mm deep"


def figure(report: dict[str, Any]):
    """Errors by place, a mark for each indenter and a colour for each model."""
    picture, axes = plt.subplots(1, 3, figsize=(11, 3.6), layout="constrained")
    marks = dict(zip(map(named, EVERYWHERE), "o^sD", strict=True))
    for axis, part, title in zip(axes, PARTS, TITLES, strict=True):
        for press, mark in marks.items():
            for step, who in enumerate(MODELS):
                of = [report["places"][place].get(press, {}).get(who) for place in PLACES]
                places = [x for x, errors in enumerate(of) if errors]
                axis.plot(
                    [x + 0.2 * step - 0.1 for x in places],
                    [100 * of[x][part] for x in places],
                    mark,
                    ms=4,
                    color=COLOURS[who],
                    label=f"{who}, {press}",
                    alpha=0.8,
                )
        axis.set_xticks(range(len(PLACES)), [place.replace(" a ", " a\n") for place in PLACES])
        axis.set(title=title, ylabel="error (%)", xlim=(-0.5, len(PLACES) - 0.5))
        axis.axhline(0, color="black", lw=0.8)
        axis.grid(alpha=0.3, axis="y")
    handles, labels = axes[0].get_legend_handles_labels()
    picture.legend(
        handles[::2] + handles[1::2],
        labels[::2] + labels[1::2],
        ncols=4,
        loc="outside lower center",
    )
    return picture
