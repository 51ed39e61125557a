"""Models of pads on indenters of families that no network was taught, of any size.

The truth is that of ``tests/reference/presses.py``, for frames straight down. It is kept beside the
rows, so that another network is judged within minutes. --weights RUN/weights.safetensors … judges
networks beside the shipped one. --truth only judges the truth by quadratic elements, on the presses
of `pareto`. --quick asks one press, of another set.
"""

from __future__ import annotations

import json
import sys
import time
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import Any

import numpy as np

import ruffini
import unseen_truth
from engine import COLOURS, KEPT, OUT, ROOT, Rows, made, plt, quantiles, readable, run, table, text
from engine.rows import header
from ruffini import Press, PressError
from ruffini._errors import apart

sys.path.insert(0, str(ROOT / "tests/reference"))
import presses

PARTS = ("displacement", "stress", "force")
NETWORK, LINEAR = "network", "linear, on cells"
OTHERS = ("tab:orange", "tab:green", "tab:pink", "tab:purple", "tab:brown")
"""Colours of networks beside the shipped one."""
FIRST = 9000
"""Number of the first press. Nothing may be chosen by these presses, so that they begin anew where
something was: those from 6000 and from 8000 on were looked at before."""
DOWN = (1, 3)
"""Frames: half the depth, and all of it."""
PHYSICS = ("compliance", "contact", "dataset", "deformation", "fem", "geometry")
REFERENCE = [
    f"tests/reference/{name}" for name in ("presses.py", "indenters.py", "indentations.toml")
]
MADE_OF = ["env-core", "py/reports/unseen.py", *REFERENCE]
TRUTH_OF = [*(f"env-core/src/{part}" for part in PHYSICS), *REFERENCE]
"""Sources of the truth, which is solved anew when they change."""
GROUPS: dict[str, Any] = {
    "all": lambda row: True,
    "feature 0.5 to 2 mm": lambda row: row["feature"] < 2e-3,
    "feature 2 to 5 mm": lambda row: 2e-3 <= row["feature"] < 5e-3,
    "feature over 5 mm": lambda row: row["feature"] >= 5e-3,
    "depth up to 50 µm": lambda row: row["depth"] <= 5e-5,
    "depth 50 µm to 0.8 mm": lambda row: 5e-5 < row["depth"] <= 8e-4,
    "depth over 0.8 mm": lambda row: row["depth"] > 8e-4,
    "force up to 0.1 N": lambda row: row["force"] <= 0.1,
    "force 0.1 to 2 N": lambda row: 0.1 < row["force"] <= 2,
    "force over 2 N": lambda row: row["force"] > 2,
    "Poisson's ratio up to 0.4": lambda row: row["poisson"] <= 0.4,
    "Poisson's ratio 0.45 to 0.475": lambda row: 0.4 < row["poisson"] <= 0.475,
    "Poisson's ratio from 0.49": lambda row: row["poisson"] > 0.475,
    "truth known to 5 %": lambda row: max(row["truth"]) <= 0.05,
}
SIZES = (0.5, 1, 2, 5, 10)
"""Features that are marked (mm)."""
KNOWN = 0.10
"""Predicted error up to which an answer counts as known."""


def options(parser: ArgumentParser) -> None:
    """Adds options: presses, networks."""
    parser.add_argument("--weights", nargs="+", type=Path, default=[], help="other networks")
    parser.add_argument("--count", type=int, default=48, help="presses; 48 if not given")
    parser.add_argument("--truth", action="store_true", help="judge the truth alone")
    parser.add_argument("--jobs", type=int, default=2, help="processes; 2 if not given")


def make(options: Namespace) -> dict[str, Any]:
    """Solves every press with every model."""
    others = {f"network {file.resolve().parent.name}": file for file in options.weights}
    if len(others) < len(options.weights) or len(others) > len(OTHERS):
        raise SystemExit(f"--weights: at most {len(OTHERS)}, from folders of other names")
    if options.truth:
        return of_truth(options)
    count = 1 if options.quick else options.count
    sizes = {"presses": count} | ({"networks": ", ".join(others)} if others else {})
    rows = Rows.of("unseen", options, MADE_OF, sizes)
    kept = KEPT / "presses" / header(TRUTH_OF, {})["commit"]
    first = 0 if options.quick else FIRST
    numbers = range(first, first + count)
    run(rows, {f"{n:06}": (judged, n, others, kept) for n in numbers}, options.jobs)
    about = ("press", "family", "feature", "young", "poisson", "friction", "seconds")
    found = [{name: row[name] for name in about} | frame for row in rows for frame in row["frames"]]
    ended = {row["press"]: row["ended"] for row in rows if row["ended"]}
    note = {"note": options.note} if options.note else {}
    before = OUT / "unseen.json"
    kept_part = json.loads(before.read_text()).get("truth") if before.exists() else None
    own = {} if kept_part is None or options.quick else {"truth": kept_part}
    return rows.header | note | {"ended": ended, "rows": found, "table": groups(found)} | own


def of_truth(options: Namespace) -> dict[str, Any]:
    """The report that there is, with the errors of the truth."""
    rows = Rows.of("unseen-truth", options, [*TRUTH_OF, "py/reports/unseen_truth.py"], {})
    kept = KEPT / options.form / f"truth-{rows.header['commit']}"
    numbers = unseen_truth.numbers()
    run(rows, {str(n): (unseen_truth.judged, n, DOWN, kept) for n in numbers}, options.jobs)
    found = {"commit": rows.header["commit"], **unseen_truth.summary(list(rows))}
    return json.loads((OUT / "unseen.json").read_text()) | {"truth": found}


def models(case: presses.DrawnPress, others: dict[str, Path]) -> dict[str, Any]:
    """Models of the gel of a press, by name; `others` are weights beside the shipped ones."""
    gel: dict[str, Any] = {"sensor": presses.SENSOR} | case.gel
    shipped = {NETWORK: ruffini.Surrogate(**gel), LINEAR: ruffini.LinearPad(**gel)}
    return shipped | {name: ruffini.Surrogate.load(file, **gel) for name, file in others.items()}


def solved(case: presses.DrawnPress, kept: Path) -> dict[str, np.ndarray]:
    """Truth of the frames that go down, kept in a file."""
    file = kept / f"{case.number:06}.npz"
    if not file.exists():
        kept.mkdir(parents=True, exist_ok=True)
        path = [case.steps[0], *case.path]
        np.savez(file, **presses.truth(case.gel, case.shape, path, DOWN))
    with np.load(file) as found:
        return dict(found)


def judged(number: int, others: dict[str, Path], kept: Path) -> dict[str, Any]:
    """Drawn press, and the errors of every model in each frame whose truth is known."""
    case = presses.DrawnPress.draw(number)
    truth = solved(case, kept)
    answers, seconds = {}, {}
    for name, model in models(case, others).items():
        model.solve(Press(case.shape, case.path[:1]))
        start = time.process_time()
        answers[name] = presses.at_frames(model.solve_path(case.press(DOWN[-1] + 1)))
        seconds[name] = (time.process_time() - start) / (len(case.steps) - 1)
    frames = []
    for place, frame in enumerate(DOWN[: len(truth["force"])]):
        exact = [truth[name][place] for name in ("displacement", "von_mises", "force")]
        row: dict[str, Any] = {
            "frame": frame,
            "depth": case.depth * presses.FRAMES[frame],
            "force": float(np.linalg.norm(exact[2])),
            "truth": truth["error"][place].tolist(),
            "errors": {},
        }
        for name, path in answers.items():
            found = path[min(frame, len(path) - 1)]
            row["errors"][name] = None
            if not isinstance(found, PressError):
                fields = (found.displacement, found.von_mises, found.wrench[:3])
                pairs = zip(fields, exact, strict=True)
                row["errors"][name] = [apart(a, b) for a, b in pairs]
                if name == NETWORK and found.predicted_error is not None:
                    row["predicted"] = list(found.predicted_error)
        frames.append(row)
    asked = ("family", "feature", *case.gel)
    return {
        "press": number,
        **{name: getattr(case, name) for name in asked},
        "seconds": seconds,
        "truth_seconds": float(truth["seconds"]),
        "ended": str(truth["ended"]),
        "frames": frames,
    }


def names(rows: list[dict[str, Any]]) -> list[str]:
    """Names of the models."""
    return list(rows[0]["errors"]) if rows else []


def groups(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Median and 95th percentile of the errors by group of presses and model."""

    def spread(errors: list[list[float]]) -> dict[str, list[float]]:
        columns = zip(*errors, strict=True)
        return {part: [*quantiles(of).values()] for part, of in zip(PARTS, columns, strict=True)}

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
    found["unsolved"] = {
        name: sum(row["errors"][name] is None for row in rows) for name in names(rows)
    }
    return found


PAGE = """# Indenters that no network was taught

Closed meshes of eight families, with features of 0.5 to 10 mm, in any orientation, pressed straight
down, 5 µm to 2 mm deep, into the pad of a GelSight Mini; Young's modulus 10 kPa to 3 MPa, Poisson's
ratio 0.3 to 0.499, friction 0 to 2. Each is judged at half its depth and at all of it. Neither
the network nor its training was chosen by these presses.

The truth (`tests/reference/presses.py`) is made as the labels of the training data are, on finer
meshes: linear elasticity on 5,000 nodes with contact on up to 800 cells, plus the difference
between nonlinear and linear quadratic elements on one mesh of 900 nodes, refined towards the
contact, which is nearly free from the error of that mesh. Rows *truth* show how far it is from that
by the meshes of the training data, of 3,000 and 500 nodes. The cells of contact are the same in
both, and are not part of that.

{truth}

*network* is `Surrogate()`, *linear, on cells* the answer that it corrects, `LinearPad()`. Relative
errors in %, median and 95th percentile.

![errors by size of the feature, and predicted against true errors](unseen.svg)

{errors}

{predicted}

Frames not solved: {unsolved}. {ended}

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
    two = "(truth, by coarser meshes)"
    columns += [("model", lambda row: two if row["name"] == "truth" else row["name"])]
    for part, title in zip(PARTS, ("u", "stress", "force"), strict=True):
        columns += [(title, f"{{errors[{part}][0]:100*.1f}}")]
        columns += [("95 %", f"{{errors[{part}][1]:100*.1f}}")]
    return text(
        PAGE,
        report,
        errors=table(columns, rows),
        truth=unseen_truth.paragraph(report["truth"]) if "truth" in report else "",
        predicted=predicted(found["predicted"]) if "predicted" in found else "",
        unsolved=", ".join(f"{name} {count}" for name, count in found["unsolved"].items()),
        ended=unknown(report),
        made=made(report),
    )


def unknown(report: dict[str, Any]) -> str:
    """Number of the presses whose truth is not known to the end."""
    if not report["ended"]:
        return ""
    presses = report["sizes"]["presses"]
    lost = len(DOWN) * presses - len(report["rows"])
    return (
        f"{lost} frames of {len(report['ended'])} of the {presses} presses have no truth and are "
        f"left out: finite elements did not converge."
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
