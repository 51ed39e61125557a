"""Models of pads on indenters of families that no network was taught, of any size.

The truth is that of ``tests/reference/presses.py``, solved here for frames straight down of sixteen
presses (half an hour), or with --set what was stored of its set (hours). --weights
RUN/weights.safetensors … judges networks beside the shipped one. --quick asks one press.
"""

from __future__ import annotations

import sys
import time
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import Any

import numpy as np

import ruffini
from engine import COLOURS, ROOT, Rows, made, plt, readable, run, table, text
from ruffini import Press, PressError, Shape

sys.path.insert(0, str(ROOT / "tests/reference"))
import presses

PARTS = ("displacement", "stress", "force")
NETWORK, LINEAR = "network", "linear, on cells"
OTHERS = ("tab:orange", "tab:green", "tab:pink", "tab:purple", "tab:brown")
"""Colours of networks beside the shipped one."""
FIRST = 6000
"""Number of the first press that is solved here; the test set begins at 0."""
DOWN = (1, 3)
GROUPS: dict[str, Any] = {
    "all": lambda row: True,
    "feature 0.5 to 2 mm": lambda row: row["feature"] < 2e-3,
    "feature 2 to 5 mm": lambda row: 2e-3 <= row["feature"] < 5e-3,
    "feature over 5 mm": lambda row: row["feature"] >= 5e-3,
    "depth up to 50 µm": lambda row: row["depth"] <= 5e-5,
    "depth 50 µm to 0.8 mm": lambda row: 5e-5 < row["depth"] <= 8e-4,
    "depth over 0.8 mm": lambda row: row["depth"] > 8e-4,
    "truth known to 5 %": lambda row: max(row["truth"]) <= 0.05,
}
SIZES = (0.5, 1, 2, 5, 10)
"""Features that are marked (mm)."""
KNOWN = 0.10
"""Predicted error up to which an answer counts as known."""


def options(parser: ArgumentParser) -> None:
    """Adds options: presses, networks."""
    parser.add_argument("--weights", nargs="+", type=Path, default=[], help="other networks")
    parser.add_argument("--set", action="store_true", help="the test set, as far as it is there")
    parser.add_argument("--count", type=int, default=16, help="presses that are solved here")


def make(options: Namespace) -> dict[str, Any]:
    """Solves every press with every model."""
    others = {f"network {file.resolve().parent.name}": file for file in options.weights}
    if len(others) < len(options.weights) or len(others) > len(OTHERS):
        raise SystemExit(f"--weights: at most {len(OTHERS)}, from folders of other names")
    files = sorted(presses.HERE.glob("*.npz")) if options.set else []
    if options.set and not files:
        raise SystemExit(f"{presses.HERE}: no presses, make some by tests/reference/presses.py")
    count = 1 if options.quick else options.count
    numbers = [int(file.stem) for file in files] or [FIRST + n for n in range(count)]
    sizes = {"presses": len(numbers)} | ({"networks": ", ".join(others)} if others else {})
    rows = Rows.of("unseen", options, ["env-core/src", "tests/reference/presses.py"], sizes)
    last = (presses.JUDGED if options.set else DOWN)[-1]
    missing = [n for n in numbers if f"{n:06}/{last}" not in rows]
    run(rows, {f"press {n}": (judged, n, options.set, others) for n in missing})
    found = [{k: v for k, v in row.items() if k != "key"} for row in rows]
    note = {"note": options.note} if options.note else {}
    return rows.header | note | {"set": options.set, "rows": found, "table": groups(found)}


def models(case: presses.DrawnPress, others: dict[str, Path]) -> dict[str, Any]:
    """Models of the gel of a press, by name; `others` are weights beside the shipped ones."""
    gel = {name: getattr(case, name) for name in ("young", "poisson", "friction")}
    gel["sensor"] = presses.SENSOR
    shipped = {NETWORK: ruffini.Surrogate(**gel), LINEAR: ruffini.LinearPad(**gel)}
    return shipped | {name: ruffini.Surrogate.load(file, **gel) for name, file in others.items()}


def solved(case: presses.DrawnPress) -> dict[str, Any] | None:
    """Truth of the frames that go down; None if one of its models does not solve the press."""
    try:
        return presses.solve(case, DOWN)
    except PressError as error:
        print(error, flush=True)
        return None


def judged(number: int, stored: bool, others: dict[str, Path]) -> list[dict[str, Any]]:
    """A row for each frame of a press; none where it has no truth."""
    case = presses.DrawnPress.draw(number)
    frames = presses.JUDGED if stored else DOWN
    truth = np.load(presses.HERE / f"{number:03d}.npz") if stored else solved(case)
    if truth is None:
        print(number, "truth not solved", flush=True)
        return []
    answers, seconds = {}, {}
    for name, model in models(case, others).items():
        model.solve(Press(Shape.mesh(*case.surface), case.path[:1]))
        start = time.process_time()
        answers[name] = presses.at_frames(model.solve_path(case.press()))
        seconds[name] = (time.process_time() - start) / len(case.steps)
    asked = ("family", "feature", "young", "poisson", "friction")
    rows = []
    for place, frame in enumerate(frames):
        exact = [truth[name][place] for name in ("displacement", "von_mises", "force")]
        row: dict[str, Any] = {
            "key": f"{number:06}/{frame}",
            "press": number,
            "frame": frame,
            **{name: getattr(case, name) for name in asked},
            "depth": case.depth * presses.FRAMES[frame],
            "force": float(np.linalg.norm(exact[2])),
            "truth": [float(e) for e in truth["error"][:, place]],
            "elements": [float(e) for e in truth["elements"][:, place]],
            "errors": {},
            "seconds": seconds,
        }
        for name, path in answers.items():
            found = path[min(frame, len(path) - 1)]
            row["errors"][name] = None
            if not isinstance(found, PressError):
                fields = (found.displacement, found.von_mises, found.wrench[:3])
                pairs = zip(fields, exact, strict=True)
                row["errors"][name] = [presses.apart(a, b) for a, b in pairs]
                if name == NETWORK and found.predicted_error is not None:
                    row["predicted"] = list(found.predicted_error)
        rows.append(row)
    return rows


def names(rows: list[dict[str, Any]]) -> list[str]:
    """Names of the models."""
    return list(rows[0]["errors"]) if rows else []


def groups(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Median and 95th percentile of the errors by group of presses and model."""

    def spread(errors: list[list[float]]) -> dict[str, list[float]]:
        columns = zip(*errors, strict=True)
        return {
            part: [float(np.quantile(of, q)) for q in (0.5, 0.95)]
            for part, of in zip(PARTS, columns, strict=True)
        }

    found: dict[str, Any] = {}
    for group, belongs in GROUPS.items():
        chosen = [row for row in rows if belongs(row)]
        found[group] = {"frames": len(chosen)}
        for name in names(rows):
            if errors := [row["errors"][name] for row in chosen if row["errors"][name]]:
                found[group][name] = spread(errors)
        if chosen:
            found[group]["truth"] = spread([row["truth"] for row in chosen])
    if both := [(row["predicted"], row["errors"][NETWORK]) for row in rows if "predicted" in row]:
        said, had = (np.array(part) for part in zip(*both, strict=True))
        sure = said.max(axis=1) <= KNOWN
        found["predicted"] = {
            "within": [float(share) for share in (had <= said).mean(axis=0)],
            "known": int(sure.sum()),
            "known_within": float((had[sure].max(axis=1) <= KNOWN).mean()) if sure.any() else None,
        }
    found["elements"] = [
        [float(np.quantile([row["elements"][part] for row in rows], q)) for q in (0.5, 0.95)]
        for part in range(2)
    ]
    found["unsolved"] = {
        name: sum(row["errors"][name] is None for row in rows) for name in names(rows)
    }
    return found


PAGE = """# Indenters that no network was taught

Closed meshes of eight families, with features of 0.5 to 10 mm, in any orientation, pressed 5 µm to
2 mm deep into the pad of a GelSight Mini and moved on sideways; Young's modulus 10 kPa to 3 MPa,
Poisson's ratio 0.3 to 0.499, friction 0 to 2. {frames}

The truth (`tests/reference/presses.py`): displacement and force are linear elasticity with contact
on up to 800 cells plus the difference between nonlinear and linear finite elements on one mesh,
which is nearly free from the error of that mesh; stress is that of quadratic elements on 1,500
nodes. Quadratic elements on 1,500 nodes alone, refined towards the contact, are {elements} off this
truth in displacement and {elements_force} in force (median, 95th percentile): contact that is small
beside the mesh. Rows *truth* show how far the truth is from that by a coarser mesh. What the truth
does not see: far from the contact the linear model differs by 2 to 3 % in displacement from finite
elements, and it is part of both truth and network.

*network* is `Surrogate()`, *linear, on cells* the answer that it corrects, `LinearPad()`. Relative
errors in %, median and 95th percentile.

![errors by size of the feature, and predicted against true errors](unseen.svg)

{errors}

{predicted}

Frames not solved: {unsolved}.

{made}"""
PREDICTED = """The network predicts its own errors; {shares} % of those in u, stress and force are
at most what it predicts (fitted to 95 on presses of families that it was taught). It counts {known}
frames as known to 10 %{within}."""


def page(report: dict[str, Any]) -> str:
    """Errors by group and model, and calibration of the predicted errors."""
    found = report["table"]
    rows = [
        {"of": found[group], "group": group, "name": name, "errors": found[group][name]}
        for group in GROUPS
        for name in (*names(report["rows"]), "truth")
        if name in found[group]
    ]
    columns: list[tuple[str, Any]] = [("presses (frames)", "{group} ({of[frames]})")]
    two = "(truth, by a coarser mesh)"
    columns += [("model", lambda row: two if row["name"] == "truth" else row["name"])]
    for part, title in zip(PARTS, ("u", "stress", "force"), strict=True):
        columns += [(title, f"{{errors[{part}][0]:100*.1f}}")]
        columns += [("95 %", f"{{errors[{part}][1]:100*.1f}}")]
    return text(
        PAGE,
        report,
        frames="Frames down and sideways." if report["set"] else "Frames straight down.",
        errors=table(columns, rows),
        elements=" / ".join(f"{100 * e:.0f} %" for e in found["elements"][0]),
        elements_force=" / ".join(f"{100 * e:.0f} %" for e in found["elements"][1]),
        predicted=predicted(found["predicted"]) if "predicted" in found else "",
        unsolved=", ".join(f"{name} {count}" for name, count in found["unsolved"].items()),
        made=made(report),
    )


def predicted(found: dict[str, Any]) -> str:
    """Calibration of the network's predicted errors."""
    shares = ", ".join(f"{100 * share:.0f}" for share in found["within"])
    within = ""
    if found["known"]:
        within = f", and is within 10 % in {100 * found['known_within']:.0f} % of them"
    return text(PREDICTED, {**found, "within": within}, shares=shares)


def figure(report: dict[str, Any]):
    """Errors by size of the feature, and predicted against true errors."""
    rows = report["rows"]
    picture, axes = plt.subplots(1, 4, figsize=(14, 3.6), layout="constrained")
    colours = iter(OTHERS)
    drawn = {name: COLOURS.get(name) or next(colours) for name in names(rows)}
    for i, (axis, part) in enumerate(zip(axes, PARTS, strict=False)):
        for name, colour in drawn.items():
            some = [row for row in rows if row["errors"][name]]
            x = [1e3 * row["feature"] for row in some]
            y = [100 * row["errors"][name][i] for row in some]
            axis.loglog(x, y, "o", ms=3, color=colour, label=name, alpha=0.7)
        axis.set(title=part, xlabel="smallest feature (mm)", ylabel="relative error (%)")
    picture.legend(*axes[0].get_legend_handles_labels(), ncols=7, loc="outside lower center")
    if sure := [row for row in rows if "predicted" in row]:
        said = 100 * np.ravel([row["predicted"] for row in sure])
        had = 100 * np.ravel([row["errors"][NETWORK] for row in sure])
        axes[3].loglog(said, had, "o", ms=3, color=COLOURS[NETWORK])
        axes[3].loglog([0.3, 300], [0.3, 300], color="black", lw=1)
    axes[3].set(title="predicted errors", xlabel="predicted (%)", ylabel="true (%)")
    for axis in axes:
        readable(axis)
    for axis in axes[:3]:
        axis.set_xticks(SIZES, [f"{size:g}" for size in SIZES])
        axis.xaxis.minorticks_off()
    return picture
