"""Sliding under a held object, by model, beside quadratic elements on a refined mesh, half an hour.

A hand has to grip harder where more of the contact slides, so agents act on ``slip``. Shapes are
dragged along a pad, and the motion of objects that an agent holds against a load that goes to and
fro is solved again by each model. Shapes are lowered deep, too, and then dragged. --quick drags a
ball, lowers one and solves one episode, with two models.
"""

from __future__ import annotations

from argparse import Namespace
from typing import Any

import numpy as np

from engine import COLOURS, Rows, made, plt, run, table, text
from sliding_cases import (
    BALL,
    DEEP,
    DEEP_STEPS,
    DEPTHS,
    DRAG,
    ENVIRONMENT,
    FALLEN,
    FRICTION,
    HELD,
    LINEAR,
    LOWERED,
    LOWERED_FRICTION,
    MIDDLING,
    MODELS,
    PRESSED,
    REFERENCE,
    SHOWN,
    STEPS,
    USED,
    deep,
    dragged,
    lowered,
    replayed,
)

ONE_THREAD = True
MADE_OF = ["env-core", "py/src", "py/reports/sliding_cases.py", "py/reports/load_cases.py"]
MADE_OF += ["py/python/ruffini/agents/HoldStill-v0.safetensors"]
QUICK = ["network", ENVIRONMENT]
FIRST = 1
"""First step of an episode that is judged; the one before is the grip, which is simplified."""


def make(options: Namespace) -> dict[str, Any]:
    """Solves what is missing, the fastest models first."""
    rows = Rows.of("sliding", options, MADE_OF, {"steps": STEPS})
    models = QUICK if options.quick else list(MODELS)
    shapes, objects = (["ball"], ["sphere"]) if options.quick else (list(PRESSED), list(HELD))
    balls = list(LOWERED)[:1] if options.quick else list(LOWERED)
    asked: dict[str, tuple[Any, ...]] = {}
    for model in models:
        asked |= {f"dragged/{shape}/{model}": (dragged, shape, model) for shape in shapes}
        asked |= {f"lowered/{ball}/{model}": (lowered, ball, model) for ball in balls}
        asked |= {f"held/{name}/{model}": (replayed, name, model) for name in objects}
    for model in () if options.quick else ("network", LINEAR, REFERENCE):
        asked |= {f"deep/{shape}/{model}": (deep, shape, model) for shape in DEEP}
    run(rows, asked)
    held = {name: replays([row for row in rows if row.get("object") == name]) for name in objects}
    report = {"note": options.note, "dragged": shares(rows), "lowered": lowest(rows)}
    return rows.header | report | {"deep": deepest(rows), "held": held}


def lowest(rows: Rows) -> dict[str, Any]:
    """Share that slides and force (N) at the reported depths, by ball and model."""
    found: dict[str, Any] = {}
    for row in rows:
        if "lowered" in row:
            shown = {name: [row[name][i] for i in SHOWN] for name in ("sliding", "force")}
            found.setdefault(row["lowered"], {})[row["model"]] = shown
    return found


def deepest(rows: Rows) -> dict[str, Any]:
    """Share that slides after lowering, and its mean error in all steps, by shape and model."""
    of = {(row["deep"], row["model"]): row["sliding"] for row in rows if "deep" in row}
    return {
        shape: {
            model: {
                "lowered": of[shape, model][DEEP_STEPS - 1],
                "dragged": of[shape, model][-1],
                "off": float(np.abs(np.subtract(of[shape, model], of[shape, REFERENCE])).mean()),
            }
            for model in (LINEAR, "network", REFERENCE)
        }
        for shape in DEEP
        if (shape, REFERENCE) in of
    }


def shares(rows: Rows) -> dict[str, Any]:
    """Share that slides by shape, model and friction used, there and back, with its errors."""
    found: dict[str, Any] = {}
    for row in rows:
        if "shape" in row:
            there, back = slice(len(DRAG) + 1), slice(len(DRAG), None)
            fallen = row["used"][len(DRAG)] - np.array(row["used"][back])
            found.setdefault(row["shape"], {})[row["model"]] = {
                "there": np.interp(USED, row["used"][there], row["sliding"][there]).tolist(),
                "back": np.interp(FALLEN, fallen, row["sliding"][back]).tolist(),
            }
    for shape, models in found.items():
        right = HALF_SPACE if shape == "ball" else models.get(REFERENCE)
        for model in models.values() if right else ():
            for way in ("there", "back"):
                off = np.subtract(model[way], right[way])
                model[f"{way}_off"] = float(off[np.abs(off).argmax()])
    return found


def half_space(used: float) -> float:
    """Share that slides under a ball on a half-space where this much of the friction is used.

    What is outside of c = a (1 − Q/μP)^{1/3} slides, which bears (1 − c²/a²)^{3/2} of the normal
    force (Mindlin 1949).
    """
    return (1 - (1 - used) ** (2 / 3)) ** 1.5


HALF_SPACE = {
    "there": [half_space(used) for used in USED],
    "back": [half_space(fallen / 2) for fallen in FALLEN],
}
"""That, and with a falling force, which slides back as half of the change did (Mindlin and
Deresiewicz 1953)."""


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
more of it grips harder. Here the models of touch are compared with closed forms, and with a
reference: quadratic elements on a mesh that is refined under the contact (about 1,500 nodes).

## Dragged there and back

A ball of {ball} mm radius, pressed 0.5 mm into the pad, and a flat block, pressed 0.15 mm, are
dragged along the finger, with friction {friction}, and back. *Used* is the part of the greatest
friction that is used on the way there, *fallen* by how much of it the force has fallen on the way
back. The errors, the largest of a row, are against the closed form of a ball on a half-space
(Cattaneo 1938, Mindlin 1949, Mindlin and Deresiewicz 1953), and against the last model for the
block.

{drag}

At the rim the pressure is small and the shear is large. Sliding begins there, and begins there anew
when the force turns: the closed form says that next to nothing slides then. Elements spread what
the rim bears over their own width, so the coarser they are, the more seems to slide. {turned}

## Lowered, and not dragged

Balls are lowered along their axis, with friction {lowered_friction}. Nothing drags them, but the
gel is pushed aside under them. *Slip* at depths of {depths} mm.

{lower}

Linear elasticity pushes the gel aside too far under deep balls, and cells seem to slide that stick.
Where the network's forces have less friction than those of its linear solution, such cells are
counted as sticking, unless the contact slides or turns as a whole.

{deep}

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
reference's elements on a coarser refined mesh, of about 1,000 nodes. {less}

The reference's own error may be three times what that row says, as 1,500 nodes are only some 13 %
finer than 1,000, and three it is if it falls with the square of the spacing. In force that is 3 %.
In slip it is not right where the force turns, as the ball above shows, and the network may well be
nearer to the truth there than the reference.

It is one episode of each object, one agent, and the motion that the network's forces led to.

{made}"""


DEEPER = """Other shapes, lowered by 0.4 to 1.2 mm and then dragged along the finger by 0.8 mm. The
way in which such cells are counted was chosen on shapes of the same kinds, but of other sizes.
*Lowered* and *dragged* is slip at the end of either, *mean error* that of its difference from the
quadratic, refined elements in all steps: {linear} for the linear solution and {network} for the
network in the mean of all shapes.

{table}"""


def page(report: dict[str, Any]) -> str:
    """Tables of all."""
    return text(
        PAGE,
        report,
        ball=f"{1e3 * BALL:.0f}",
        friction=str(FRICTION),
        steps=str(STEPS),
        drag=drags(report["dragged"]),
        lowered_friction=str(LOWERED_FRICTION),
        depths=", ".join(f"{1e3 * DEPTHS[i]:.1f}" for i in SHOWN),
        lower=lowers(report["lowered"]),
        deep=deeps(report["deep"]),
        turned=turn(report["dragged"]),
        held=holds(report["held"]),
        less=less(report["held"]),
        made=made(report),
    )


def drags(found: dict[str, Any]) -> str:
    """Sliding by shape, model and friction that is used, there and back, and of a half-space."""
    lines: list[dict[str, Any]] = [
        {"shape": shape, "model": model} | models[model]
        for shape, models in found.items()
        for model in MODELS
        if model in models
    ]
    lines.append({"shape": "ball", "model": "closed form, half-space"} | HALF_SPACE)
    lines.sort(key=lambda line: line["shape"])
    columns = {"shape": "{shape}", "model": "{model}"}
    columns |= {f"used {used:.0%}": f"{{there[{i}]:.2f}}" for i, used in enumerate(USED)}
    columns |= {"error": "{there_off:+.2f}"}
    columns |= {f"fallen {fallen:.0%}": f"{{back[{i}]:.2f}}" for i, fallen in enumerate(FALLEN)}
    return table(columns | {"error ": "{back_off:+.2f}"}, lines, absent="")


def lowers(found: dict[str, Any]) -> str:
    """Sliding and force by ball, model and depth."""
    lines = [
        {"ball": ball, "model": model} | found[ball][model]
        for ball in LOWERED
        for model in MODELS
        if model in found.get(ball, {})
    ]
    columns = {"radius": "{ball}", "model": "{model}"}
    columns |= {
        f"slip at {1e3 * DEPTHS[n]:.1f} mm": f"{{sliding[{i}]:.2f}}" for i, n in enumerate(SHOWN)
    }
    return table(columns | {"force at the last (N)": f"{{force[{len(SHOWN) - 1}]:.2f}}"}, lines)


def deeps(found: dict[str, Any]) -> str:
    """Text and table of shapes that are lowered deep and dragged."""
    if not found:
        return ""
    lines = [
        {"shape": shape}
        | {f"{key} {model}": row[key] for model, row in models.items() for key in row}
        for shape, models in found.items()
    ]
    columns = {"shape": "{shape}"}
    for key in ("lowered", "dragged"):
        for model, short in ((LINEAR, "linear"), ("network", "network"), (REFERENCE, "reference")):
            columns[f"{key}: {short}"] = f"{{{key} {model}:.2f}}"
    for model, short in ((LINEAR, "linear"), ("network", "network")):
        columns[f"mean error: {short}"] = f"{{off {model}:.2f}}"
    of_all = {
        model: float(np.mean([models[model]["off"] for models in found.values()]))
        for model in (LINEAR, "network")
    }
    return text(
        DEEPER,
        {},
        table=table(columns, lines),
        linear=f"{of_all[LINEAR]:.2f}",
        network=f"{of_all['network']:.2f}",
    )


def turn(found: dict[str, Any]) -> str:
    """Sentences about the ball's way there and back."""

    def said(way: str) -> str:
        off = {model: row[f"{way}_off"] for model, row in found["ball"].items()}
        return ", ".join(f"{name} by {off[name]:+.2f}" for name in MODELS if name in off)

    return (
        f"Under the ball the models are off, at most, on the way there: {said('there')}; after the "
        f"turn: {said('back')}."
    )


def less(found: dict[str, Any]) -> str:
    """Sentence on the steps in which the network says less than the reference."""
    differences = [
        np.subtract(of["models"]["network"]["sliding"], of["models"][REFERENCE]["sliding"])
        for of in found.values()
        if {"network", REFERENCE} <= of["models"].keys()
    ]
    if not differences:
        return ""
    off = np.concatenate(differences)
    return (
        f"The network's slip is below the reference's in {(off < 0).sum()} of {len(off)} steps, by "
        f"{-off.min():.2f} at most."
    )


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
        ENVIRONMENT: (COLOURS["paper"], "-"),
        MIDDLING: (COLOURS["fem"], "-"),
        "quadratic, refined, fewer nodes": ("black", "--"),
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
