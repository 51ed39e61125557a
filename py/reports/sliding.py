"""Sliding under a held object, by model, beside quadratic elements on a refined mesh, half an hour.

A hand has to grip harder where more of the contact slides, so agents act on ``slip``. Shapes are
dragged along a pad, and the motion of objects that an agent holds against a load that goes to and
fro is solved again by each model. --quick drags the ball and solves one episode, with two models.
"""

from __future__ import annotations

from argparse import Namespace
from typing import Any

import numpy as np

from engine import COLOURS, Rows, made, plt, run, table, text
from sliding_cases import (
    BALL,
    FRICTION,
    HELD,
    MODELS,
    PRESSED,
    REFERENCE,
    STEPS,
    USED,
    dragged,
    replayed,
)

ONE_THREAD = True
MADE_OF = ["env-core", "py/src", "py/reports/sliding_cases.py", "py/reports/load_cases.py"]
MADE_OF += ["py/python/ruffini/agents/HoldStill-v0.safetensors"]
QUICK = list(MODELS)[:2]
FIRST = 1
"""First step of an episode that is judged; the one before is the grip, which is simplified."""


def make(options: Namespace) -> dict[str, Any]:
    """Solves what is missing, the fastest models first."""
    rows = Rows.of("sliding", options, MADE_OF, {"steps": STEPS})
    models = QUICK if options.quick else list(MODELS)
    shapes, objects = (["ball"], ["sphere"]) if options.quick else (list(PRESSED), list(HELD))
    asked: dict[str, tuple[Any, ...]] = {}
    for model in models:
        asked |= {f"dragged/{shape}/{model}": (dragged, shape, model) for shape in shapes}
        asked |= {f"held/{name}/{model}": (replayed, name, model) for name in objects}
    run(rows, asked)
    held = {name: replays([row for row in rows if row.get("object") == name]) for name in objects}
    return rows.header | {"note": options.note, "dragged": shares(rows), "held": held}


def shares(rows: Rows) -> dict[str, Any]:
    """Share that slides by shape, model and friction used, and its error against the reference."""
    found: dict[str, Any] = {}
    for row in rows:
        if "shape" in row:
            there = np.interp(USED, row["used"], row["sliding"]).tolist()
            found.setdefault(row["shape"], {})[row["model"]] = {"shares": there}
    for models in found.values():
        for model in models.keys() - {REFERENCE} if REFERENCE in models else ():
            off = np.subtract(models[model]["shares"], models[REFERENCE]["shares"])
            models[model]["off"] = float(off[np.abs(off).argmax()])
    return found


def replays(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Sliding in each step by model, and how far it and the force are from the reference.

    ``episode`` is what the agent felt, of which the network's own solution differs by what is
    simplified.
    """
    felt = rows[0]["felt"]
    by_model = {row["model"]: row for row in rows}
    found: dict[str, Any] = {"friction": rows[0]["friction"], "models": {}}
    own = by_model["network"]
    found["episode"] = {"sliding": felt["sliding"]} | differences(own, felt)
    for model in MODELS:
        if row := by_model.get(model):
            found["models"][model] = {"sliding": row["sliding"], "seconds": row["seconds"]}
            if model != REFERENCE and REFERENCE in by_model:
                found["models"][model] |= differences(row, by_model[REFERENCE])
    return found


def differences(row: dict[str, Any], other: dict[str, Any]) -> dict[str, float]:
    """Mean difference of sliding with its mean size, and median difference of force, relative."""
    slides = np.subtract(row["sliding"], other["sliding"])[FIRST:]
    forces, others = (np.array(one["force"])[FIRST:] for one in (row, other))
    off = np.linalg.norm(forces - others, axis=1) / np.linalg.norm(others, axis=1)
    grips = forces[:, 2] / others[:, 2] - 1
    return {
        "more": float(slides.mean()),
        "apart": float(np.abs(slides).mean()),
        "force": float(np.median(off)),
        "normal": float(np.median(grips)),
    }


PAGE = """# Which model is right about sliding

`slip` is the share of the normal force that is carried where the pad slides. An agent that feels
more of it grips harder. Here the models of touch are compared with the reference, quadratic
elements on a mesh that is refined under the contact (about 1,500 nodes).

## Dragged

A ball of {ball} mm radius, pressed 0.5 mm into the pad, and a flat block, pressed 0.15 mm, are
dragged along the finger, with friction {friction}; columns are the fraction of the greatest
friction that is used.

{drag}

## Held against a load that goes to and fro

The agent of HoldStill holds one object of each family with the network; the motion of the object
in the first pad, {steps} control steps with one pose each, is solved again by every model. The grip
before the first step is replaced by a press straight down, followed by the motion along the face
until then. *Slip* is the mean difference from the reference and, in brackets, the mean of its size;
*force* is the median difference of the force vector and, in brackets, of its normal part.

{held}

![slip in each step, by model](sliding.svg)

The first row of an object says how far the network's own solution of the simplified motion is from
what the agent felt in the episode: smaller differences mean nothing. The last row is the
reference's elements on a coarser refined mesh, of about 1,000 nodes.

The reference's own error may be several times what that row says, as 1,500 nodes are only some 13 %
finer than 1,000: three times, if it falls with the square of the spacing. So the reference does not
tell whether the network's force is right to 3 %, nor its slip to 0.1; where refining changes slip,
it lowers it, towards the network's. The even mesh of an environment is too coarse for the rim of a
contact, where sliding begins, and too stiff, by more than that.

It is one episode of each object, one agent, and the motion that the network's forces led to.

{made}"""


def page(report: dict[str, Any]) -> str:
    """Tables of both."""
    return text(
        PAGE,
        report,
        ball=f"{1e3 * BALL:.0f}",
        friction=str(FRICTION),
        steps=str(STEPS),
        drag=drags(report["dragged"]),
        held=holds(report["held"]),
        made=made(report),
    )


def drags(found: dict[str, Any]) -> str:
    """Sliding by shape, model and friction that is used, and of a half-space."""
    lines = [
        {"shape": shape, "model": model} | models[model]
        for shape, models in found.items()
        for model in MODELS
        if model in models
    ]
    closed = [float((1 - (1 - used) ** (2 / 3)) ** 1.5) for used in USED]
    name = "half-space, closed form (Cattaneo, Mindlin)"
    lines.append({"shape": "ball", "model": name, "shares": closed})
    columns = {"shape": "{shape}", "model": "{model}"}
    columns |= {f"{used:.0%}": f"{{shares[{place}]:.2f}}" for place, used in enumerate(USED)}
    return table(columns | {"largest error": "{off:+.2f}"}, lines, absent="")


def holds(found: dict[str, Any]) -> str:
    """Differences in sliding and force by object and model."""
    lines = [
        {"object": name, "model": model} | row
        for name, of in found.items()
        for model, row in {"network, against the episode": of["episode"], **of["models"]}.items()
        if "more" in row
    ]
    columns = {
        "object": "{object}",
        "model": "{model}",
        "slip": "{more:+.2f} ({apart:.2f})",
        "force": "{force:100*.1f} % ({normal:100*+.1f} %)",
    }
    return table(columns, lines)


def figure(report: dict[str, Any]):
    """Sliding in each step of the episodes, by model."""
    styles = {
        "network": (COLOURS["surrogate"], "-"),
        "finite elements of an environment": (COLOURS["paper"], "-"),
        "the same, finer": (COLOURS["paper"], "--"),
        "quadratic, less refined": (COLOURS["fem"], "--"),
        REFERENCE: ("black", "-"),
    }
    held = report["held"]
    picture, axes = plt.subplots(
        1, len(held), figsize=(2.8 * len(held) + 0.4, 3.2), layout="constrained", squeeze=False
    )
    for axis, (name, of) in zip(axes[0], held.items(), strict=True):
        for model, row in of["models"].items():
            colour, line = styles[model]
            axis.plot(row["sliding"], line, color=colour, lw=1.2, label=model)
        axis.set(title=f"{name}, friction {of['friction']:.2f}", xlabel="control step", ylim=(0, 1))
        axis.grid(alpha=0.3)
    axes[0][0].set_ylabel("slip")
    picture.legend(*axes[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return picture
