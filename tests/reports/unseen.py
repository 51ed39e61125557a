"""Models of pads on indenters of families that no network was taught, of any size.

Writes ``unseen.json``, ``unseen.md`` and ``unseen.svg`` beside itself. The truth is quadratic
finite elements on a mesh of 1,500 nodes refined towards the contact, solved here for frames
straight down (minutes), or what ``tests/reference/presses.py`` stored of its set (hours). Use::

    python tests/reports/unseen.py                # sixteen presses, the shipped network
    python tests/reports/unseen.py --set          # the presses of the test set that there are
    python tests/reports/unseen.py --weights RUN/weights.safetensors … --out FOLDER
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from kept import ROOT, header, made

import ruffini
from ruffini import Press, PressError, Shape

sys.path.insert(0, str(ROOT / "tests/reference"))
import presses

PARTS = ("displacement", "stress", "force")
NETWORK, LINEAR = "network", "linear, on cells"
MODELS = (NETWORK, LINEAR)
FIRST = 4300
"""Number of the first press that is solved here; the test set begins at 0."""
DOWN = (1, 3)
COLORS = ("tab:blue", "tab:gray", "tab:orange", "tab:green", "tab:red", "tab:purple", "tab:brown")
GROUPS: dict[str, Any] = {
    "all": lambda row: True,
    "feature 0.5 to 2 mm": lambda row: row["feature"] < 2e-3,
    "feature 2 to 5 mm": lambda row: 2e-3 <= row["feature"] < 5e-3,
    "feature over 5 mm": lambda row: row["feature"] >= 5e-3,
    "depth up to 50 µm": lambda row: row["depth"] <= 5e-5,
    "depth 50 µm to 0.8 mm": lambda row: 5e-5 < row["depth"] <= 8e-4,
    "depth over 0.8 mm": lambda row: row["depth"] > 8e-4,
    "truth known to 5 %": lambda row: row["truth"] and max(row["truth"]) <= 0.05,
}
SIZES = (0.5, 1, 2, 5, 10)
"""Features that are marked (mm)."""
KNOWN = 0.10
"""Predicted error up to which an answer counts as known."""


def main() -> None:
    """Asks every model every press of the set that is there."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument(
        "--weights", nargs="+", type=Path, default=[], help="networks beside the shipped one"
    )
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    parser.add_argument("--set", action="store_true", help="the test set, as far as it is there")
    parser.add_argument("--count", type=int, default=16, help="presses that are solved here")
    options = parser.parse_args()
    others = {f"network {file.resolve().parent.name}": file for file in options.weights}
    if len(others) < len(options.weights) or len(others) > len(COLORS) - len(MODELS):
        parser.error(f"--weights: at most {len(COLORS) - len(MODELS)}, from folders of other names")
    files = sorted(presses.HERE.glob("*.npz")) if options.set else []
    if options.set and not files:
        parser.error(f"{presses.HERE}: no presses, make some by tests/reference/presses.py")
    numbers = [int(file.stem) for file in files] or [FIRST + n for n in range(options.count)]
    rows = []
    for number in numbers:
        question = presses.Question.draw(number)
        if options.set:
            frames, truth = presses.JUDGED, np.load(presses.HERE / f"{number:03d}.npz")
        else:
            frames, truth = DOWN, solved(question)
        if truth is None:
            print(number, "truth not solved", flush=True)
            continue
        rows += judged(question, frames, truth, others)
        print(number, line(rows[-1]), flush=True)
    report = header(["env-core/src", "tests/reference/presses.py"], {"presses": len(numbers)})
    report |= {"set": options.set, "rows": rows, "table": table(rows)}
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "unseen.json").write_text(json.dumps(report, indent=1) + "\n")
    (options.out / "unseen.md").write_text(page(report))
    draw(rows, options.out / "unseen.svg")


def models(question: presses.Question, others: dict[str, Path]) -> dict[str, Any]:
    """Models of the gel of a press, by name; `others` are weights beside the shipped ones."""
    gel = {
        "sensor": presses.SENSOR,
        "young": question.young,
        "poisson": question.poisson,
        "friction": question.friction,
    }
    shipped = {NETWORK: ruffini.Surrogate(**gel), LINEAR: ruffini.LinearPad(**gel)}
    return shipped | {name: ruffini.Surrogate.load(file, **gel) for name, file in others.items()}


def solved(question: presses.Question) -> dict[str, Any] | None:
    """Finite elements' answer to the frames that go down; None if they do not solve the press."""
    body = question.body(presses.FINE, presses.contact_guess(question))
    fem = ruffini.Fem(body, friction=question.friction, element="p2")
    frames = fem.solve_path(Press(Shape.mesh(*question.surface), question.path[:4]))
    if isinstance(frames[-1], PressError):
        return None
    mesh = ruffini.sensor(presses.SENSOR, resolution=presses.MODEL_NODES).mesh
    judged = [frames[frame] for frame in DOWN]
    fields = [fem.carry(frame.history, mesh) for frame in judged]
    return {
        "displacement": [field[0] for field in fields],
        "von_mises": [field[1] for field in fields],
        "wrench": np.array([frame.wrench for frame in judged]),
    }


def judged(
    question: presses.Question, frames: tuple[int, ...], truth: Any, others: dict[str, Path]
) -> list[dict[str, Any]]:
    """A row for each frame of a press that has a truth."""
    press = Press(Shape.mesh(*question.surface), question.path)
    answers = {}
    for name, model in models(question, others).items():
        model.solve(Press(Shape.mesh(*question.surface), question.path[:1]))
        start = time.process_time()
        answers[name] = (
            model.solve_path(press),
            (time.process_time() - start) / len(presses.FRAMES),
        )
    rows = []
    for place, frame in enumerate(frames):
        exact = (
            truth["displacement"][place],
            truth["von_mises"][place],
            truth["wrench"][place, :3],
        )
        row: dict[str, Any] = {
            "press": question.number,
            "frame": frame,
            "family": question.family,
            "feature": question.feature,
            "depth": question.depth * presses.FRAMES[frame],
            "young": question.young,
            "poisson": question.poisson,
            "friction": question.friction,
            "force": float(np.linalg.norm(exact[2])),
            "truth": [float(e) for e in truth["error"][:, place]] if "error" in truth else None,
            "errors": {},
            "seconds": {},
        }
        for name, (path, seconds) in answers.items():
            row["seconds"][name] = seconds
            found = path[frame] if frame < len(path) else path[-1]
            if isinstance(found, PressError):
                row["errors"][name] = None
                continue
            fields = (found.displacement, found.von_mises, found.wrench[:3])
            row["errors"][name] = [presses.apart(a, b) for a, b in zip(fields, exact, strict=True)]
            if name == NETWORK and found.predicted_error is not None:
                row["predicted"] = list(found.predicted_error)
        rows.append(row)
    return rows


def names(rows: list[dict[str, Any]]) -> list[str]:
    """The models that were asked."""
    return list(rows[0]["errors"]) if rows else []


def table(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Median and 95th percentile of the errors by group of presses and model."""
    found: dict[str, Any] = {}
    for group, belongs in GROUPS.items():
        chosen = [row for row in rows if belongs(row)]
        found[group] = {"frames": len(chosen)}
        for name in names(rows):
            errors = np.array([row["errors"][name] for row in chosen if row["errors"][name]])
            if len(errors):
                found[group][name] = {
                    part: [float(np.quantile(errors[:, i], q)) for q in (0.5, 0.95)]
                    for i, part in enumerate(PARTS)
                }
        truth = np.array([row["truth"] for row in chosen if row["truth"]])
        if len(truth):
            found[group]["truth"] = {
                part: [float(np.quantile(truth[:, i], q)) for q in (0.5, 0.95)]
                for i, part in enumerate(PARTS)
            }
    both = [(row["predicted"], row["errors"][NETWORK]) for row in rows if "predicted" in row]
    if both:
        said, had = (np.array(part) for part in zip(*both, strict=True))
        sure = said.max(axis=1) <= KNOWN
        found["predicted"] = {
            "within": [float(share) for share in (had <= said).mean(axis=0)],
            "known": int(sure.sum()),
            "known_within": float((had[sure].max(axis=1) <= KNOWN).mean()) if sure.any() else None,
        }
    found["unsolved"] = {
        name: sum(row["errors"][name] is None for row in rows) for name in names(rows)
    }
    return found


def line(row: dict[str, Any]) -> str:
    """A frame in words."""
    parts = [
        f"{name} " + "/".join(f"{100 * error:.1f}" for error in errors) if errors else f"{name} -"
        for name, errors in row["errors"].items()
    ]
    return f"{row['family']} {1e3 * row['feature']:.1f} mm: {', '.join(parts)} %"


def page(report: dict[str, Any]) -> str:
    """The report as Markdown."""
    rows = []
    for group in GROUPS:
        of = report["table"][group]
        if not of["frames"]:
            continue
        for name in (*names(report["rows"]), "truth"):
            if name in of:
                cells = [" | ".join(f"{100 * e:.1f}" for e in of[name][part]) for part in PARTS]
                title = "(two meshes of the truth apart)" if name == "truth" else name
                rows.append(f"| {group} ({of['frames']}) | {title} | {' | '.join(cells)} |")
    lines = [
        "# Indenters that no network was taught",
        "",
        "Closed meshes of eight families, with features of 0.5 to 10 mm, in any orientation,",
        "pressed 5 µm to 2 mm deep into the pad of a GelSight Mini and moved on sideways;",
        "Young's modulus 10 kPa to 3 MPa, Poisson's ratio 0.3 to 0.499, friction 0 to 2. Truth:",
        "quadratic finite elements on a mesh refined towards the contact",
        "(`tests/reference/presses.py`); on two meshes it differs by 3 to 12 % where contact is",
        "sharp or small, so smaller errors than that mean little here. *network* is",
        "`Surrogate()`, *linear, on cells* the answer that it corrects, `LinearPad()`. Relative",
        "errors in %, median and 95th percentile."
        + (" Frames down and sideways." if report["set"] else " Frames straight down."),
        "",
        "![errors by size of the feature, and predicted against true errors](unseen.svg)",
        "",
        "| presses (frames) | model | u | 95 % | stress | 95 % | force | 95 % |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
        *rows,
        "",
    ]
    if "predicted" in report["table"]:
        found = report["table"]["predicted"]
        shares = ", ".join(f"{100 * share:.0f}" for share in found["within"])
        lines += [
            f"The network predicts its own errors; {shares} % of those in u, stress and force are",
            "at most what it predicts (fitted to 95 on presses of families that it was taught).",
            f"It counts {found['known']} frames as known to 10 %"
            + (
                f", and is within 10 % in {100 * found['known_within']:.0f} % of them."
                if found["known"]
                else "."
            ),
            "",
        ]
    unsolved = ", ".join(f"{name} {count}" for name, count in report["table"]["unsolved"].items())
    lines += [f"Frames not solved: {unsolved}.", "", made({**report, "note": ""}), ""]
    return "\n".join(lines)


def draw(rows: list[dict[str, Any]], file: Path) -> None:
    """Errors by size of the feature, and predicted against true errors."""
    figure, axes = plt.subplots(1, 4, figsize=(14, 3.6), constrained_layout=True)
    for axis, (i, part) in zip(axes, enumerate(PARTS), strict=False):
        for name, color in zip(names(rows), COLORS, strict=False):
            told = [row for row in rows if row["errors"][name]]
            x = [1e3 * row["feature"] for row in told]
            y = [100 * row["errors"][name][i] for row in told]
            axis.loglog(x, y, "o", ms=3, color=color, label=name, alpha=0.7)
        axis.set(title=part, xlabel="smallest feature (mm)", ylabel="relative error (%)")
        axis.set_xticks(SIZES, [f"{size:g}" for size in SIZES])
        axis.minorticks_off()
        axis.grid(alpha=0.3)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    both = [
        (p, e)
        for row in rows
        if "predicted" in row
        for p, e in zip(row["predicted"], row["errors"][NETWORK], strict=True)
    ]
    if both:
        said, had = 100 * np.array(both).T
        axes[3].loglog(said, had, "o", ms=3, color="tab:blue")
        ends = [0.3, 300]
        axes[3].loglog(ends, ends, color="black", lw=1)
    axes[3].set(title="predicted errors", xlabel="predicted (%)", ylabel="true (%)")
    axes[3].grid(alpha=0.3)
    figure.savefig(file)


if __name__ == "__main__":
    main()
