"""The shipped network on pads that it was not trained on, beside those that it was.

Ten minutes of one core. Every pad is pressed by the same shapes to the same shares of its
thickness. The truth is quadratic finite elements on a mesh of 1,200 nodes refined towards the
contact, in four load steps; on the Mini 800 nodes are solved, too, which tells how well it is
known. Pads that the network refuses are listed with its message. --quick asks one press of one pad.
"""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

import ruffini
from engine import COLOURS, KEPT, ROOT, Rows, made, plt, readable, run, table, text
from pareto_cases import MINI, MODEL_NODES, Case, Fields, Gel, straight
from ruffini import Deformation, Fem, LinearPad, PressError, SoftBody, Surrogate

MADE_OF = ["env-core", "py/reports/sensors.py", "py/reports/pareto_cases.py"]
MINI_PAD, DIGIT_PAD, SOFTER = "Mini", "DIGIT", "Poisson's ratio 0.40"
FLAT = dict.fromkeys(("radius_along", "radius_across"), float("inf"))
FLAT |= dict.fromkeys(("rim_width", "rim_radius"), 0.0)
PADS: dict[str, tuple[str, dict[str, float]]] = {
    MINI_PAD: ("gelsight-mini", {}),
    DIGIT_PAD: ("digit", {}),
    SOFTER: ("gelsight-mini", {"poisson": 0.40}),
    "3.5 mm thick": ("gelsight-mini", {"thickness": 0.0035}),
    "5 mm thick": ("gelsight-mini", {"thickness": 0.005}),
    "radius 50 mm": ("gelsight-mini", {"radius_along": 0.05, "radius_across": 0.05}),
    "15 × 15 × 3 mm": ("gelsight-mini", {"length": 0.015, "width": 0.015, "thickness": 0.003}),
    "30 × 20 × 5 mm": ("gelsight-mini", {"length": 0.03, "width": 0.02, "thickness": 0.005}),
    "flat": ("gelsight-mini", FLAT),
    "3 mm thick": ("gelsight-mini", {"thickness": 0.003}),
    "15 × 15 mm": ("gelsight-mini", {"length": 0.015, "width": 0.015}),
}
"""A built-in sensor, and the entries of its file that differ, of each pad."""
TRAINED = (MINI_PAD, DIGIT_PAD, SOFTER)
"""Pads that the network was trained on, by tests/reference/indentations.toml."""
PRESSES = [(("ball", radius), share) for radius in (3, 8) for share in (0.05, 0.15, 0.30)]
PRESSES += [(("block", 5), 0.10)]
"""Shape with its radius or half an edge (mm), and depth as a share of the thickness."""
TRUTH_NODES, COARSE = 1200, 800
PARTS = ("displacement", "stress", "force")
MODELS: dict[str, Any] = {"network": Surrogate, "linear": LinearPad}


def make(options: Namespace) -> dict[str, Any]:
    """Every press of every pad."""
    sizes = {"nodes of the truth": TRUTH_NODES, "friction": MINI.friction}
    rows = Rows.of("sensors", options, MADE_OF, sizes)
    few = slice(0, 1 if options.quick else None)
    messages = {pad: refusal(pad) for pad in list(PADS)[few]}
    taken = [pad for pad, message in messages.items() if message is None]
    presses = list(enumerate(PRESSES[few]))
    run(rows, {f"{pad}, press {n}": (errors, pad, *press) for pad in taken for n, press in presses})
    found = sorted(rows, key=lambda row: list(PADS).index(row["pad"]))
    groups = {pad: [pad] for pad in taken}
    groups |= {"trained": TRAINED, "not trained": [pad for pad in taken if pad not in TRAINED]}
    summaries = {
        name: summary(row for row in found if row["pad"] in of) for name, of in groups.items()
    }
    known = [row["truth"] for row in found if "truth" in row]
    return rows.header | {
        "note": options.note,
        "rows": found,
        "pads": {name: of for name, of in summaries.items() if of},
        "truth": {part: max(of[part] for of in known) for part in PARTS} if known else None,
        "refused": {pad: message for pad, message in messages.items() if message is not None},
    }


def gel_of(pad: str) -> Gel:
    """Gel of a pad, whose sensor is a file where it differs from a built-in one."""
    sensor, changes = PADS[pad]
    if not changes:
        return replace(MINI, sensor=sensor)
    lines = (ROOT / f"env-core/assets/sensors/{sensor}.toml").read_text()
    # The first entry of a name is the file's own, the outline's or the default calibration's.
    for entry, value in ({"name": f'"{pad}"'} | changes).items():
        lines, _ = re.subn(rf"(?m)^{entry} = .*$", f"{entry} = {value}", lines, count=1)
    file = KEPT / "sensors" / f"{pad}.toml"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(lines)
    return replace(MINI, sensor=str(file), poisson=changes.get("poisson", MINI.poisson))


def refusal(pad: str) -> str | None:
    """Message with which the network refuses the pad, if it does."""
    try:
        Surrogate(**vars(gel_of(pad)))
    except ValueError as error:
        return str(error)
    return None


def errors(pad: str, shape: tuple[str, int], share: float) -> dict[str, Any]:
    """Errors of the network and its linear solution, and those that the network predicts."""
    gel = gel_of(pad)
    mesh = ruffini.sensor(gel.sensor, resolution=MODEL_NODES).mesh
    depth = share * float(np.ptp(mesh.vertices[:, 2]))
    [case] = straight(pad, gel, [shape], [depth])
    found: dict[str, Any] = {"pad": pad, "press": case.name, "share": share, "depth": depth}
    true = truth(case, mesh, TRUTH_NODES)
    if true is None:
        return found | {"failed": ["truth"]}
    found["force"] = float(np.linalg.norm(true.force[-1]))
    if pad == MINI_PAD and (coarse := truth(case, mesh, COARSE)):
        found["truth"] = apart(coarse, true)
    for name, model in MODELS.items():
        answer = model(**vars(gel)).solve_path(case.press())[-1]
        if isinstance(answer, PressError):
            return found | {"failed": [name]}
        found[name] = apart(fields(answer, answer.displacement, answer.von_mises), true)
        if answer.predicted_error is not None:
            found["predicted"] = dict(zip(PARTS, answer.predicted_error, strict=True))
    return found


def truth(case: Case, mesh: ruffini.TetMesh, nodes: int) -> Fields | None:
    """Quadratic elements refined towards where the undeformed face is inside the shape."""
    line, (place, _) = np.arange(-9e-3, 9.1e-3, 2e-4), case.path[-1]
    face = np.stack(np.meshgrid(line, line, [0.0]), axis=-1).reshape(-1, 3)
    around = face[case.shape.distance(face - place)[0] <= 0]
    pad = ruffini.sensor(case.gel.sensor, resolution=nodes, around=around)
    body = SoftBody(pad.mesh, case.gel.young, case.gel.poisson, fixed=pad.fixed)
    fem = Fem(body, friction=case.gel.friction, element="p2")
    answer = fem.solve_path(case.press())[-1]
    if isinstance(answer, PressError):
        return None
    return fields(answer, *fem.carry(answer.history, mesh))


def fields(answer: Deformation, displacement: np.ndarray, stress: np.ndarray) -> Fields:
    """Fields of one frame on the mesh of the network."""
    return Fields(displacement[None], stress[None], answer.wrench[None, :3])


def apart(found: Fields, true: Fields) -> dict[str, float]:
    """Relative errors."""
    off = found.errors(true, range(1))
    return {part: off[part][0] for part in PARTS}


def summary(rows: Iterable[dict[str, Any]]) -> dict[str, Any] | None:
    """Median and largest errors of the rows, and how often the network is worse or mistaken."""
    solved = [row for row in rows if "failed" not in row]
    if not solved:
        return None
    found: dict[str, Any] = {"presses": len(solved)}
    for name in MODELS:
        of = {part: [row[name][part] for row in solved] for part in PARTS}
        found[name] = {
            part: {"median": float(np.median(off)), "worst": max(off)} for part, off in of.items()
        }
    for name, than in (("worse", "linear"), ("within", "predicted")):
        found[name] = {
            part: sum(
                (row["network"][part] > row[than][part]) == (name == "worse") for row in solved
            )
            for part in PARTS
        }
    return found


PAGE = """# The network on other pads

The network was trained on presses of the GelSight Mini's pad (Poisson's ratio 0.3 to 0.499) and of
the DIGIT's. Here it is asked, as it is shipped, on pads of another thickness, curvature or outline
too, which are the Mini's but for what their names say; *trained* are the three that were in its
training data, *not trained* the others. Balls of 3 and 8 mm radius are pressed to 5, 15 and 30 % of
the thickness, and a block 10 mm wide (half an edge 5 mm) to 10 %, 1 mm beside the middle, with
Young's modulus 0.30 MPa, Poisson's ratio 0.47 where no other is said, and friction
{sizes[friction]}. Errors do not depend on Young's modulus: force and stress are in proportion to
it.

Truth: quadratic finite elements on a mesh of {sizes[nodes of the truth]:,} nodes refined towards
the contact, in four load steps. {known} Relative L² errors of the last frame in displacement / von
Mises stress / force in %; *linear* is the answer that the network corrects, `LinearPad()`.

![errors by pad](sensors.svg)

{pads}

*Worse*: presses on which the network is farther off than its linear solution. *As predicted*:
presses on which it is at most as far off as its `predicted_error`, which on presses like its
training data holds for 95 in 100.

{losing}

## Every press

{presses}

## Pads that the network refuses

{refused}

{made}"""
KNOWN = """On the Mini, {coarse} nodes give an answer that differs from it by at most
{displacement:100*.1f} / {stress:100*.1f} / {force:100*.1f} % on one press, so smaller
differences say nothing."""
LOSING = """By its median error, the network is worse than its linear solution on: {pads}."""
ALL_WON = """By its median, the network is nearer to the reference than its linear solution on every
pad, in displacement, stress and force."""


def page(report: dict[str, Any]) -> str:
    """Errors by pad, of every press, and what is refused."""
    known = report["truth"]
    pads = [{"pad": pad, **of} for pad, of in report["pads"].items()]
    return text(
        PAGE,
        report,
        known=text(KNOWN, known, coarse=str(COARSE)) if known else "",
        pads=table(of_pads(), pads),
        losing=losing(report["pads"]),
        presses=table(of_presses(), report["rows"], absent=""),
        refused="\n".join(f"- {pad}: {said}." for pad, said in report["refused"].items())
        or "None.",
        made=made(report),
    )


def of_pads() -> dict[str, Any]:
    """Columns of the table of pads."""
    columns: dict[str, Any] = {"pad": "{pad}", "presses": "{presses}"}
    for high in ("median", "worst"):
        columns |= {
            f"{name}, {high}": " / ".join(f"{{{name}[{part}][{high}]:100*.1f}}" for part in PARTS)
            for name in MODELS
        }
    named = {"worse": "worse", "as predicted": "within"}
    return columns | {
        title: " / ".join(f"{{{key}[{part}]}}" for part in PARTS) for title, key in named.items()
    }


def of_presses() -> dict[str, Any]:
    """Columns of the table of presses."""
    columns: dict[str, Any] = {"pad": "{pad}", "press": "{press}", "depth (mm)": "{depth:1e3*.2f}"}
    columns["force"] = lambda row: (
        f"not solved by {', '.join(row['failed'])}" if "failed" in row else f"{row['force']:.2f} N"
    )
    return columns | {
        name: " / ".join(f"{{{name}[{part}]:100*.1f}}" for part in PARTS)
        for name in (*MODELS, "predicted")
    }


def losing(pads: dict[str, Any]) -> str:
    """Pads on which the network's median error is larger than that of its linear solution."""
    lost = {
        pad: [
            part for part in PARTS if of["network"][part]["median"] > of["linear"][part]["median"]
        ]
        for pad, of in pads.items()
    }
    named = "; ".join(f"{pad} ({', '.join(parts)})" for pad, parts in lost.items() if parts)
    return text(LOSING, {}, pads=named) if named else text(ALL_WON, {})


def figure(report: dict[str, Any]):
    """Errors of every press by pad."""
    picture, axes = plt.subplots(1, 3, figsize=(12, 3.8), sharey=True, layout="constrained")
    solved = [row for row in report["rows"] if "failed" not in row]
    pads = list(dict.fromkeys(row["pad"] for row in solved))
    for axis, part in zip(axes, PARTS, strict=True):
        for name, aside in (("network", -0.15), ("linear", 0.15)):
            x = [pads.index(row["pad"]) + aside for row in solved]
            y = [100 * row[name][part] for row in solved]
            axis.semilogy(x, y, "o", ms=3, color=COLOURS[name], alpha=0.7, label=name)
            for place, pad in enumerate(pads):
                median = 100 * report["pads"][pad][name][part]["median"]
                axis.hlines(median, place + aside - 0.12, place + aside + 0.12, COLOURS[name])
        axis.set(title=part)
        readable(axis)
        axis.set_xticks(range(len(pads)), pads, rotation=40, ha="right")
        axis.xaxis.set_major_formatter(plt.FixedFormatter(pads))
    axes[0].set(ylabel="relative error (%), bars: medians")
    axes[0].legend()
    return picture
