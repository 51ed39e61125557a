"""Dependence of answers on the path that led to them, and on where the mesh's nodes lie.

Two minutes of one core. A block is dragged without friction and back, a ball pressed deeper and
back, pressed and released, and moved along the face; and the nodes that pull at a ball which only
presses are counted. --quick asks the coarsest finite elements and the linear pad alone.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from functools import partial
from typing import Any

from engine import COLOURS, Rows, filled, made, plt, run, table, text
from engine.pages import Column
from paths_cases import cycle, deeper, drag, pull, ripple

MADE_OF = ["env-core", "py/reports/paths_cases.py"]
COARSE, FINER, FINEST = (f"Fem p1-bar {nodes}" for nodes in (800, 1500, 2500))
GRADED, PLAIN, QUADRATIC = "Fem p1-bar graded", "Fem p1 800", "Fem p2 900"
LINEAR, NETWORK = "LinearPad", "Surrogate"
USUAL = (COARSE, FINER, QUADRATIC, LINEAR, NETWORK)
FEW = (COARSE, FINER, LINEAR, NETWORK)
FEWER = (COARSE, LINEAR, NETWORK)
QUICK = (COARSE, LINEAR)
Variant = tuple[tuple[str, ...], tuple[Any, ...]]
CASES: dict[str, tuple[Callable[..., dict[str, Any]], dict[str, Variant]]] = {
    "drag": (
        drag,
        {
            "sharp": ((COARSE, FINER, GRADED, QUADRATIC, LINEAR, NETWORK), (0.0, 6)),
            "sharp, finer frames": (FEWER, (0.0, 24)),
            "rounded by 0.1 mm": (FEW, (1e-4, 6)),
            "rounded by 0.5 mm": (FEW, (5e-4, 6)),
        },
    ),
    "deeper": (deeper, {f"{r} mm": (FEWER, (1e-3 * r,)) for r in (4, 6, 10)}),
    "cycle": (cycle, {f"friction {mu:g}": (FEWER, (mu,)) for mu in (0.0, 0.8)}),
    "ripple": (ripple, {f"{d} mm": (USUAL, (1e-3 * d,)) for d in (0.2, 0.5)}),
    "pull": (pull, {"ball": ((COARSE, FINER, FINEST, PLAIN, QUADRATIC, LINEAR, NETWORK), ())}),
}
"""Of each case its function, and variants with their models and arguments."""


DRAWN = {
    COARSE: COLOURS["fem"],
    FINER: COLOURS["paper"],
    LINEAR: COLOURS["linear"],
    NETWORK: COLOURS["network"],
}
"""Colours of the models in the picture."""


def make(options: Namespace) -> dict[str, Any]:
    """Every variant of every case with every model."""
    rows = Rows.of("paths", options, MADE_OF, {})
    asked = {
        (case, variant, name): (function, name, *arguments)
        for case, (function, variants) in CASES.items()
        for variant, (models, arguments) in variants.items()
        for name in models
        if name in QUICK or not options.quick
    }
    run(rows, {": ".join(keys): call for keys, call in asked.items()})
    by_key = {row["key"]: row for row in rows}
    found: dict[str, Any] = {}
    for case, variant, name in asked:
        row = by_key[f"{case}: {variant}: {name}"]
        found.setdefault(case, {}).setdefault(variant, {})[name] = row
    return rows.header | {"note": options.note, "cases": found}


PAGE = """# Do answers depend on the path that led to them?

Gel that is pressed without friction is elastic: its force should depend on where the object is, and
not on how it came there, and moving the object away and back should cost no work. With friction the
way matters, but moving in a closed loop can only cost work, never gain it. Finite elements, the
linear pad and the network keep to this only in part. This page tells how far, on the GelSight
Mini's pad.

*Fem* is `Fem` with elements `p1-bar` (its default), `p1` or `p2` on about so many nodes;
`LinearPad` is linear elasticity with contact on cells, `Surrogate` the network that corrects it.
Friction is 0 where no other is said.

![Sideways force of a dragged block, and ripple under a ball](paths.svg)

Squares are where the block is back at its place.

## A sharp edge that is dragged, and back

A block of 6 × 4 × 4 mm is pressed 0.5 mm deep in five frames, dragged 0.6 mm along x in six, and
brought back to the same place in six. *Change* is that of the answer between the two visits of the
place, relative L² norm; *work* is what the loop put into the gel, which should be 0, beside what
pressing down did. In the finer frames the block moves 0.025 mm at a time.

{drag}

{drag_told}

## A ball pressed deeper, and back

A ball is pressed to a depth at once, and 0.2 mm deeper and back to it. Largest change of the answer
in %, displacement / force, over depths of 0.3 to 0.8 mm, by the ball's radius.

{deeper}

{deeper_told}

## A ball pressed and released

A ball of 10 mm is pressed 1 mm deep in frames of 20 µm, and released in as many. *Lost* is the
share of the work of pressing that does not come back; without friction it should be 0. Below 0 the
cycle gives more than it took, which no gel can.

{cycle}

{cycle_told}

## A ball moved along the face

A ball of 4 mm is moved over 3 mm of the face without friction, 0.2 or 0.5 mm below it everywhere,
in steps of 0.2 mm. *Ripple* is the largest normal force less the smallest, over the mean. The gel
becomes a little thinner on the way, which makes less of it than the linear pad shows.

{ripple}

{ripple_told}

## Nodes that pull

A ball of 4 mm presses 0.5 mm deep without friction, so the force on every node should point into
the gel. *Pulling* is the sum of normal forces at nodes that are pulled outwards, over the net
force.

{pull}

{pull_told}

{made}"""


TOLD = {
    "drag": """Under a sharp edge no model comes back to where it was, and all are left with a
sideways force that was not there before. Frames a quarter as long change nothing for
the linear pad and the network, and make finite elements worse: {finer[Fem p1-bar 800]:100*.0f} % in
place of {sharp[Fem p1-bar 800]:100*.0f} %. Finer meshes do not help the displacement either; on the
mesh that is finest under the edges the loop takes {loop_sharp[Fem p1-bar graded]:100*.0f} % of the
work of pressing, about half of what it takes on 780 nodes.

A likely reason, which fits this but is not proved by it: gel rises beside the block as it moves on,
and meets its side when it comes back. It is then pushed along, and cannot get below a corner at
which the side ends at once; a real skin would slip round it.

Rounded edges give it a slope to slip on. With 0.5 mm all models come back: the linear pad
within {large[LinearPad]:100*.2f}, the network within {large[Surrogate]:100*.2f}, finite elements on
780 nodes within {large[Fem p1-bar 800]:100*.2f} %, and on 1,292 within
{large[Fem p1-bar 1500]:100*.2f} %. A radius of 0.1 mm, less than contact points lie
apart, is enough for finite elements to come nearer, {small[Fem p1-bar 800]:100*.0f} and
{small[Fem p1-bar 1500]:100*.0f} %, and does nothing for the linear pad. Coming back does not mean
that all was well on the way: those loops take up to {loop_small[Fem p1-bar 1500]:100*.0f} % of the
work of pressing.

**What to do:** real edges are round, so round those of an object that is dragged, by half a
millimetre or as they really are, and solve on another mesh to see how far the answer depends on
it.""",
    "deeper": """Finite elements come back to the same answer. The linear pad, and the network that
corrects it, choose the size of the cells on which they solve contact by what touches, and change it
later on the way back than on the way there. So two answers at one pose can be those of two
grids.""",
    "cycle": """Finite elements give back what they took, and with friction a little less. The
linear pad and the network give back a little more than they took where the grid of cells changes.
With friction, too, if the figure is below 0: that gain is larger than what friction took.""",
    "ripple": """The ripple of finite elements follows their nodes, which lie 1 to 1.4 mm apart: the
shallower contact is one or two of these wide, and 1,292 nodes have nearly as much of it as 780. The
network has {ripple[Surrogate]:100*.1f} % in the deeper contact. Where a force has to be smooth over
such a way, use the network, the linear pad or quadratic elements.""",
    "pull": """Contact points of `p1-bar` lie on a face that is smoothed between nodes, and hand
their force to the nodes around with weights of both signs. Its sum and its torque are exact, but
single nodes pull as if the gel stuck to the ball. `p1` and `p2` show none of it here.""",
}
"""Text under the tables."""


def page(report: dict[str, Any]) -> str:
    """Tables of all cases, and what they tell."""
    cases = report["cases"]
    tables = {case: sheet(case, cases[case]) for case in CASES}
    told = {f"{case}_told": told_of(words, cases) for case, words in TOLD.items()}
    return text(PAGE, report, made=made(report), **tables, **told)


SHORT = {
    "sharp": "sharp",
    "finer": "sharp, finer frames",
    "small": "rounded by 0.1 mm",
    "large": "rounded by 0.5 mm",
}
"""Names of the dragged blocks where text tells their changes."""


def told_of(words: str, cases: dict[str, Any]) -> str:
    """Paragraphs with their figures; nothing if a quick run or a failed press lacks one of them."""
    figures: dict[str, dict[str, Any]] = {}
    for name, variant in SHORT.items():
        solved = {of: row for of, row in cases["drag"].get(variant, {}).items() if "change" in row}
        figures[name] = {of: row["change"]["displacement"] for of, row in solved.items()}
        figures[f"loop_{name}"] = {of: row["work of pressing"] for of, row in solved.items()}
    ripples = cases["ripple"].get("0.5 mm", {})
    deep = {name: row["peak to peak"] for name, row in ripples.items() if "peak to peak" in row}
    try:
        return text(words, figures | {"ripple": deep})
    except KeyError:
        return ""


Variants = dict[str, dict[str, dict[str, Any]]]
"""Rows of a case by variant and model."""
FORMS = {
    "deeper": "{largest[displacement]:100*.1f} / {largest[force]:100*.1f}",
    "cycle": "{lost:100*.1f} %",
    "ripple": "{peak to peak:100*.1f} %",
}
"""Cells of tables with a column for each variant."""
DRAGGED: dict[str, Column] = {
    "edge": "{variant}",
    "model": "{model}",
    "nodes": "{nodes:,}",
    "force in x / z before (N)": lambda row: sides(row["before"]),
    "after (N)": lambda row: sides(row["after"]),
    "change of displacement": "{change[displacement]:100*.0f} %",
    "of force": "{change[force]:100*.0f} %",
    "work": "{work:1e3*.3f} mJ",
    "of that of pressing": "{work of pressing:100*.1f} %",
}
PULLED: dict[str, Column] = {
    "model": "{model}",
    "nodes": "{nodes:,}",
    "net force": "{force:.2f} N",
    "pulling": "{pulling:100*.1f} %",
}


def sheet(case: str, variants: Variants) -> str:
    """The table of a case."""
    if case in ("drag", "pull"):
        flat = [row | {"variant": of} for of, rows in variants.items() for row in rows.values()]
        return table(DRAGGED if case == "drag" else PULLED, flat, absent="not solved")
    models = dict.fromkeys(name for rows in variants.values() for name in rows)
    found = [{of: rows[name] for of, rows in variants.items()} | {"": name} for name in models]
    columns: dict[str, Any] = {"model": lambda row: row[""]}
    columns |= {of: partial(cell, of, FORMS[case]) for of in variants}
    return table(columns, found, absent="not solved")


def sides(force: list[float]) -> str:
    """Components in x and z (N), without the sign of what rounds to 0."""
    return " / ".join(f"{round(part, 2) + 0.0:.2f}" for part in (force[0], force[2]))


def cell(variant: str, form: str, row: dict[str, Any]) -> str:
    """Cell of a table for a variant."""
    return filled(form, row[variant])


def figure(report: dict[str, Any]) -> Any:
    """Sideways force of the dragged block, and the normal force of the moved ball."""
    picture, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
    cases = report["cases"]
    for axis, edge in zip(axes, ("sharp", "rounded by 0.5 mm"), strict=False):
        for name, row in cases["drag"][edge].items():
            if name in DRAWN and "failed" not in row:
                x = [1e3 * place for place in row["x"]]
                axis.plot(x, row["aside"], ".-", color=DRAWN[name], label=name)
                axis.plot(x[-1], row["aside"][-1], "s", color=DRAWN[name])
        axis.set(title=f"block, edges {edge}", xlabel="dragged by (mm)", ylabel="force in x (N)")
    axes[1].sharey(axes[0])
    for name, row in cases["ripple"]["0.2 mm"].items():
        if name in DRAWN and "failed" not in row:
            relative = [force / row["mean"] for force in row["force"]]
            x = [1e3 * place for place in row["x"]]
            axes[2].plot(x, relative, ".-", color=DRAWN[name], label=name)
    axes[2].set(title="ball, 0.2 mm deep", xlabel="moved by (mm)", ylabel="normal force over mean")
    for axis in axes:
        axis.grid(alpha=0.3)
    axes[0].legend()
    return picture
