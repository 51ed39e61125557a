"""The models of a pad at its rim and beside it: balls over the edge of the face and on the wall.

Balls are lowered onto the rim of a GelSight Mini's pad, farther and farther out, and pressed
against its upright wall. The truth is quadratic elements on meshes refined around each press; how
far these are off can be told from such elements on half as many vertices. --quick asks one ball.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from typing import Any

import numpy as np

import ruffini
from engine import COLOURS, ROOT, Rows, made, plt, run, table, text
from ruffini import Fem, Press, PressError, Shape

sys.path.insert(0, str(ROOT / "tests/reference"))
import presses

MADE_OF = ["env-core", "tests/reference/presses.py", "py/reports/rim.py"]
FRICTION = 0.5
HALF = presses.OUTLINE["width"] / 2
DEPTH = 4e-4
"""Depth of all presses (m)."""
RADII = (2e-3, 4e-3)
OVER = (9e-3, 10e-3, 10.5e-3, 11e-3, 11.5e-3, 12e-3)
"""Distances of a ball's centre from the middle of the pad, across, when it is lowered (m)."""
BESIDE = (-1.5e-3, -2.5e-3)
"""Heights of a ball's centre when it is pressed against the wall (m)."""
VERTICES = {"truth": 1200, "coarser": 600}
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
STEPS = np.concatenate([[-1e-3], np.linspace(-3e-4, DEPTH, 10)])
"""Depths along a path (m); paths begin outside of the gel."""
MODELS = {"network": ruffini.Surrogate, "linear": ruffini.LinearPad}
PARTS = ("displacement", "stress", "force")
Case = tuple[str, float, float]
"""Where the ball comes from, its radius, and the place or height of its centre (m)."""


def options(parser: ArgumentParser) -> None:
    """Adds an option: processes."""
    parser.add_argument("--jobs", type=int, default=2, help="processes; 2 if not given")


def make(options: Namespace) -> dict[str, Any]:
    """Every press."""
    rows = Rows.of("rim", options, MADE_OF, {"friction": FRICTION, "depth": DEPTH})
    cases: list[Case] = [("above", radius, x) for radius in RADII for x in OVER]
    cases += [("beside", radius, z) for radius in RADII for z in BESIDE]
    few = cases[:1] if options.quick else cases
    run(rows, {f"{n:02}": (errors, *case) for n, case in enumerate(few)}, options.jobs)
    return rows.header | {"note": options.note, "presses": list(rows)}


def errors(side: str, radius: float, at: float) -> dict[str, Any]:
    """Errors of the models in the last frame, or what failed."""
    press = Press(Shape.sphere(radius), path(side, radius, at))
    found: dict[str, Any] = {"side": side, "radius": radius, "at": at}
    bodies = {
        name: ruffini.sensor(presses.SENSOR, resolution=count, around=press)
        for name, count in VERTICES.items()
    }
    solvers = {name: Fem(body, friction=FRICTION, element="p2") for name, body in bodies.items()}
    answers = {name: solver.solve_path(press)[-1] for name, solver in solvers.items()}
    if isinstance(truth := answers["truth"], PressError):
        return found | {"failed": truth.kind}
    found["force"] = truth.wrench[:3].tolist()
    for name, model in MODELS.items():
        pad = model(presses.SENSOR, friction=FRICTION)
        answer = pad.solve_path(press)[-1]
        if isinstance(answer, PressError):
            found[name] = {"refused": answer.kind}
            continue
        exact = solvers["truth"].carry(truth.history, pad.body.mesh)
        found[name] = apart(answer, exact, truth.wrench[:3])
        if answer.predicted_error:
            found["predicted"] = dict(zip(PARTS, answer.predicted_error, strict=True))
        if name == "network" and not isinstance(answers["coarser"], PressError):
            coarse = solvers["coarser"].carry(answers["coarser"].history, pad.body.mesh)
            fields = [presses.apart(*pair) for pair in zip(coarse, exact, strict=True)]
            fields.append(presses.apart(answers["coarser"].wrench[:3], truth.wrench[:3]))
            found["coarser"] = dict(zip(PARTS, fields, strict=True))
    return found


def apart(answer: Any, exact: Any, force: Any) -> dict[str, float]:
    """Relative errors of an answer."""
    pairs = zip((answer.displacement, answer.von_mises), exact, strict=True)
    off = [presses.apart(*pair) for pair in pairs]
    return dict(zip(PARTS, [*off, presses.apart(answer.wrench[:3], force)], strict=True))


def path(side: str, radius: float, at: float) -> list[Any]:
    """Poses of a ball on its way into the gel."""
    if side == "beside":
        return [([HALF + radius - depth, 0, at], UPRIGHT) for depth in STEPS]
    x = np.linspace(-HALF, HALF, 4001)
    x = x[np.abs(x - at) < radius]
    touching = (presses.height(x, np.zeros(1)) + np.sqrt(radius**2 - (x - at) ** 2)).max()
    return [([at, 0, touching - depth], UPRIGHT) for depth in STEPS]


PAGE = """# At the rim of a pad, and beside it

Balls of radius 2 and 4 mm, pressed {depth} mm deep into the pad of a GelSight Mini, friction
{friction}: lowered onto the rim, whose side is {half} mm from the middle of the pad, and pressed
against the wall below it. Relative L² errors of displacement / von Mises stress / net force in %.
*Network* is `Surrogate()`, *linear* `LinearPad()`; both have contact on the face alone. What is
mostly on the wall they refuse; *predicted* is the network's `predicted_error`. The truth is
quadratic elements on 1,200 vertices, refined around the press; *truth, coarser* is how far such
elements on 600 are from it.

![errors by place](rim.svg)

{presses}

{within} of {count} errors of the network are at most what it predicts.

{made}"""


def page(report: dict[str, Any]) -> str:
    """A table of all presses."""
    known = [press for press in report["presses"] if "predicted" in press]
    both = [
        [press[who][part] for who in ("network", "predicted")] for press in known for part in PARTS
    ]
    columns = {
        "ball": lambda press: f"{1e3 * press['radius']:g} mm",
        "comes from": "{side}",
        "centre": lambda press: (
            f"{1e3 * press['at']:g} mm {'across' if press['side'] == 'above' else 'high'}"
        ),
        "force": force,
        "network": lambda press: shown(press, "network"),
        "predicted": lambda press: shown(press, "predicted"),
        "linear": lambda press: shown(press, "linear"),
        "(truth, coarser)": lambda press: shown(press, "coarser"),
    }
    return text(
        PAGE,
        report,
        depth=f"{1e3 * DEPTH:g}",
        friction=FRICTION,
        half=f"{1e3 * HALF:.1f}",
        presses=table(columns, report["presses"], absent=""),
        within=sum(error <= predicted for error, predicted in both),
        count=len(both),
        made=made(report),
    )


def force(press: dict[str, Any]) -> str:
    """Net force of the truth, or why there is none."""
    if "failed" in press:
        return f"truth not solved: {press['failed']}"
    return f"{np.linalg.norm(press['force']):.2f} N"


def shown(press: dict[str, Any], who: str) -> str:
    """Errors in per cent, or how the model refused."""
    errors = press.get(who, {})
    if "refused" in errors:
        return f"refused: {errors['refused']}"
    return " / ".join(f"{100 * errors[part]:.0f}" for part in PARTS) if errors else ""


def figure(report: dict[str, Any]):
    """Errors by place of the balls that come from above, and what the network predicts."""
    picture, axes = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained")
    lines = {"network": "-", "linear": "-", "predicted": ":"}
    for axis, part in zip(axes, PARTS, strict=True):
        for radius, mark in zip(RADII, "o^", strict=True):
            for who, line in lines.items():
                of = [
                    (1e3 * press["at"], 100 * press[who][part])
                    for press in report["presses"]
                    if press["side"] == "above"
                    and press["radius"] == radius
                    and part in press.get(who, {})
                ]
                colour = COLOURS["network" if who == "predicted" else who]
                label = f"{who}, ball {1e3 * radius:g} mm"
                if of:
                    x, y = zip(*of, strict=True)
                    axis.plot(x, y, f"{mark}{line}", ms=4, color=colour, label=label)
        axis.axvline(1e3 * HALF, color="black", lw=0.8)
        axis.set(
            title=part, xlabel="centre of the ball (mm); the side is the line", ylabel="error (%)"
        )
        axis.set_ylim(bottom=0)
        axis.grid(alpha=0.3)
    handles, labels = axes[0].get_legend_handles_labels()
    picture.legend(handles, labels, ncols=3, loc="outside lower center")
    return picture
