"""Error of `ruffini.Fem` against converged values, and its cost, about 10 minutes.

Every case runs in a process of its own, on one thread. --quick is a subset within a minute.
"""

from __future__ import annotations

from argparse import Namespace
from itertools import product
from typing import Any

from engine import Rows, filled, made, plt, run, table, text
from fem_cases import MINI, SCENE, accuracy, closed_forms, mini, refinement, shallow, speed

ONE_THREAD = True
MADE_OF = ["env-core", "py/src", "py/reports/fem_cases.py", "tests/reports/flat-pad.toml"]
SIZES: dict[str, dict[str, Any]] = {
    "full": {
        "poisson": [0.3, 0.45, 0.48, 0.49, 0.499],
        "common": 700,
        "meshes": {
            "p1": [500, 1000, 3000],
            "p1-bar": [500, 1000, 2000, 3000, 5000, 10000],
            "p2": [500, 1000, 2000],
        },
        "mini": [["p1-bar", 3000], ["p2", 1500]],
        "speed": [1000, 3000, 10000],
        "refinement": [[2, 2, 1], [3, 3, 2], [5, 5, 3]],
        "shallow": [
            ["p1-bar", 2000, False],
            ["p1-bar", 5000, False],
            ["p1-bar", 2000, True],
            ["p2", 800, True],
        ],
    },
    "quick": {
        "poisson": [0.48],
        "common": 250,
        "meshes": {"p1": [500], "p1-bar": [500, 1000], "p2": []},
        "mini": [["p1-bar", 1000]],
        "speed": [1000],
        "refinement": [[2, 2, 1]],
        "shallow": [["p1-bar", 500, False]],
    },
}
FRICTIONS = (0.2, 1.0)
"""Coefficients of TacFlex while sliding and at rest."""
DATA = "p1-bar"
"""Element that data are made with."""
WITHIN = 0.05
"""Error of force that a mesh for data may have at any depth and Poisson's ratio up to 0.49."""


def make(options: Namespace) -> dict:
    """Cases of speed alone, the others two at a time."""
    sizes = SIZES[options.form]
    rows = Rows.of("fem", options, MADE_OF, sizes)
    calibrations = {gel["name"]: gel for gel in MINI["calibration"]}
    timed = {
        f"speed {nodes} nodes, friction {friction}": (speed, nodes, friction)
        for nodes in sizes["speed"]
        for friction in (0.0, 0.5)
    }
    pressed = list(product(calibrations, FRICTIONS, sizes["mini"]))
    others: dict[str, tuple] = {
        f"mini {name}, friction {friction}, {element} {nodes}": (
            mini,
            name,
            friction,
            element,
            nodes,
        )
        for name, friction, (element, nodes) in pressed
    }
    common = sizes["common"]
    others |= {f"refinement {p}": (refinement, common, tuple(p)) for p in sizes["refinement"]}
    others |= {
        f"shallow {element} {nodes}, {'graded' if graded else 'even'}": (
            shallow,
            element,
            nodes,
            graded,
        )
        for element, nodes, graded in sizes["shallow"]
    }
    others |= {f"accuracy {p}": (accuracy, common, sizes["meshes"], p) for p in sizes["poisson"]}
    run(rows, timed, jobs=1)
    run(rows, others, jobs=2)
    forms = {n: closed_forms(gel["young"], gel["poisson"]) for n, gel in calibrations.items()}
    cases = {row.pop("key"): row for row in rows}
    return rows.header | {"scene": SCENE, "closed_forms": forms, "cases": cases}


def cases(report: dict, kind: str) -> list[dict]:
    """Results of the cases of one kind."""
    return [case for name, case in report["cases"].items() if name.startswith(kind)]


def accuracies(report: dict) -> list[dict]:
    """Accuracy by Poisson's ratio, ascending."""
    return sorted(cases(report, "accuracy"), key=lambda case: case["poisson"])


def solved(case: dict) -> list[dict]:
    """The meshes of a Poisson's ratio that gave an answer."""
    return [row for row in case["rows"] if "failed" not in row]


def percent(share: float) -> str:
    """A signed share in percent."""
    return f"{100 * share:+.1f} %"


PAGE = """# Finite elements: how far from the truth, at what cost

Elements are linear (*p1*), linear in F-bar patches and so free of locking (*p1-bar*) or
quadratic (*p2*); *tacflex* and *feats* are two published calibrations of a GelSight Mini's gel.

{conclusion}

## Error by mesh

Flat pad 20.75 × 25.25 × 4 mm, E = {scene[young]:1e-6*g} MPa, {scene[law]}, ball of
{scene[radius]:1e3*.0f} mm, no friction, four frames of 0.25 mm. Truth at each ν: p2 on
{first[reference][vertices]} vertices. Displacement (u) and von Mises stress (σ) are carried to one
mesh of {first[common][vertices]} vertices and {first[common][tetrahedra]} tetrahedra, of which the
truth's mesh is a refinement; errors are relative L2 norms over its volume. A p2 answer is carried
by its vertices alone, which costs it part of its accuracy in u. Seconds are a mean over the frames
with another case running beside.

{accuracy}

## Shallow contact

The same ball and pad at ν = 0.48. *Graded* meshes are finest at three points within a millimetre of
the first touch. Errors of the force are against the closed form of a bonded layer by Dimitriadis et
al. (2002), which is for small strain. Where contact is narrower than two or three spacings of the
nodes, even meshes are far too stiff.

{shallow}

## Does the force converge to that of other solvers?

p2 at ν = 0.48, the truth above among meshes of its family: cells within 3.7 mm of the contact are
cut ever finer. In brackets how far each force is off the value on which NGSolve, GetFEM and
CalculiX agree under refinement (± 0.0005 N): figures that were given to us, computed elsewhere, of
which this repository has no input files. Contact gives by its softness, 0.3 % of the force at
0.5 mm and 0.1 % at 1 mm, which is not taken off.

{converges}

{refinement}

## Force of a GelSight Mini, nothing fitted

Ball of {scene[mini_radius]:1e3*g} mm at the apex, in steps of 0.25 mm; E, ν and law of each
published calibration. μ is TacFlex's coefficient while sliding and that at rest, each used as
Coulomb's one. Measured: FEATS (arXiv 2411.03315). The closed forms are for a flat face without
friction: Hertz on a half-space; a bonded layer by Dimitriadis et al. (2002), for the calibration's
ν and by their equation for ν = 0.5.

{mini}

## Cost of a frame

Flat pad, p1-bar, 15 frames of 0.1 mm: 1 mm down, 0.5 mm sideways. One thread, alone in this report;
*load* is the load average of the machine when the case began. Memory is the peak of the process,
Python included.

{speed}

{made}"""
SPEED = {
    "nodes": "{vertices}",
    "μ": "{friction}",
    "s a frame": "{seconds:.3f}",
    "slowest (s)": "{slowest_seconds:.3f}",
    "CPU s a frame": "{cpu_seconds:.3f}",
    "Newton steps": "{iterations:.1f}",
    "CPU s to set up": "{setup_cpu_seconds:.2f}",
    "peak (MiB)": "{peak_mib:.0f}",
    "of it before (MiB)": "{idle_mib:.0f}",
    "load": "{load:.1f}",
}
SHALLOW = {
    "element": "{element}",
    "vertices": "{vertices}",
    "mesh": lambda row: "graded" if row["graded"] else "even",
    "0.02 mm": "{errors[0.02]:100*+.1f} %",
    "0.1 mm": "{errors[0.1]:100*+.1f} %",
    "0.25 mm": "{errors[0.25]:100*+.1f} %",
    "0.5 mm": "{errors[0.5]:100*+.1f} %",
    "CPU s a frame": "{cpu_seconds:.2f}",
}
FORCE = "{depths[0.5][force]:.4f} ({depths[0.5][force_error]:100*+.1f} %)"
ACCURACY = {
    "element": "{element}",
    "vertices": "{vertices}",
    "F (N) at 0.5 mm": lambda row: row.get("failed") or filled(FORCE, row),
    "F (N) at 1 mm": FORCE.replace("0.5", "1.0"),
    "u at 0.5 mm": "{depths[0.5][displacement_error]:100*.1f} %",
    "u at 1 mm": "{depths[1.0][displacement_error]:100*.1f} %",
    "σ at 0.5 mm": "{depths[0.5][von_mises_error]:100*.1f} %",
    "σ at 1 mm": "{depths[1.0][von_mises_error]:100*.1f} %",
    "Newton steps": "{iterations:.1f}",
    "s a frame": "{seconds:.3f}",
    "CPU s a frame": "{cpu_seconds:.3f}",
}
TRUTH = """### ν = {poisson}: {reference[force][0.5]:.4f} N and {reference[force][1.0]:.4f} N

Forces of the reference at 0.5 and at 1 mm. It took {reference[cpu_seconds]:.1f} s of CPU for each
0.5 mm of depth.

{table}"""


def page(report: dict) -> str:
    """Conclusion, tables and how they were made."""
    at = accuracies(report)
    return text(
        PAGE,
        report | {"first": at[0]},
        conclusion="\n".join([met(report), mesh_for_data(report), mini_met(report)]),
        accuracy="\n\n".join(
            text(TRUTH, case, table=table(ACCURACY, case["rows"], absent="")) for case in at
        ),
        shallow=table(SHALLOW, cases(report, "shallow")),
        converges=converges(report),
        refinement=refinement_table(report),
        mini=mini_table(report),
        speed=table(SPEED, cases(report, "speed")),
        made=made(report, {}),
    )


def at_048(report: dict) -> dict:
    """The accuracy at the Poisson's ratio of which others' converged force is known."""
    return next(case for case in accuracies(report) if case["poisson"] == 0.48)


def met(report: dict) -> str:
    """Compares the reference with the converged force of other solvers."""
    reference = at_048(report)["reference"]
    found = ", ".join(
        f"{reference['force'][depth]:.4f} N at {depth} mm (converged {force} N, "
        f"{percent(reference['force'][depth] / force - 1)})"
        for depth, force in report["scene"]["converged"].items()
    )
    return f"1. The reference, p2 on {reference['vertices']} vertices at ν = 0.48, gives {found}."


def worst_errors(report: dict) -> list[dict]:
    """For each mesh for data: its worst errors up to ν = 0.49, and its cost."""
    found: dict = {}
    for case in accuracies(report):
        for row in case["rows"]:
            if row["element"] == DATA and case["poisson"] <= 0.49:
                found.setdefault(row["vertices"], []).append(row)
    meshes = []
    for vertices, rows in sorted(found.items()):
        if any("failed" in row for row in rows):
            continue
        depths = [depth for row in rows for depth in row["depths"].values()]
        mesh = {
            part: max(abs(depth[f"{part}_error"]) for depth in depths)
            for part in ("force", "displacement", "von_mises")
        }
        cost = max(row["cpu_seconds"] for row in rows)
        meshes.append(mesh | {"vertices": vertices, "cpu_seconds": cost})
    return meshes


DATA_MESH = """2. For data: {choice} has {vertices} nodes, with at most {force:100*.1f} % of error
in force, {displacement:100*.0f} % in displacement and {von_mises:100*.0f} % in von Mises stress, at
{cpu_seconds:1e3*.0f} ms of CPU a frame; finer meshes have {finer}."""
FINER = "{force:100*.1f} % in force and {displacement:100*.0f} % in displacement ({vertices} nodes)"


def mesh_for_data(report: dict) -> str:
    """The coarsest mesh within the error allowed, or the finest where none is."""
    meshes = worst_errors(report)
    fit = [mesh for mesh in meshes if mesh["force"] <= WITHIN]
    mesh, most = (fit or meshes[-1:])[0], f"within {100 * WITHIN:.0f} %"
    choice = f"no {DATA} mesh is {most}, and the finest"
    if fit:
        choice = f"the coarsest {DATA} mesh whose force is {most} of the reference at 0.5 and 1 mm "
        choice += "and every ν up to 0.49"
    finer = ", ".join(filled(FINER, other) for other in meshes[meshes.index(mesh) + 1 :])
    return text(DATA_MESH, mesh, choice=choice, finer=finer or "not been run")


def best_mini(report: dict) -> list[dict]:
    """The Mini's cases in the last and best of the elements run."""
    element = report["sizes"]["mini"][-1][0]
    return [case for case in cases(report, "mini") if case["element"] == element]


def mini_met(report: dict) -> str:
    """The best and the worst of the calibrations against the measured force."""
    measured = report["scene"]["measured"]
    spans = [(off([case["force"]], measured), case) for case in best_mini(report)]
    spans.sort(key=lambda span: max(abs(e) for errors in span[0].values() for e in errors))
    best, worst = (
        filled("{calibration} with μ = {friction} on {vertices} vertices of {element}", case)
        + f", {span([error for some in errors.values() for error in some])}"
        for errors, case in (spans[0], spans[-1])
    )
    return f"3. Unfitted, the Mini's measured force is met best by {best}, and worst by {worst}."


def off(forces: list[dict], true: dict) -> dict[str, list[float]]:
    """Relative errors of forces by depth."""
    return {depth: [force[depth] / exact - 1 for force in forces] for depth, exact in true.items()}


def span(errors: list[float]) -> str:
    """Least and largest."""
    return f"{percent(min(errors))} to {percent(max(errors))}"


def refinements(report: dict) -> list[dict]:
    """The truth at ν = 0.48 and the meshes of its family, the coarsest first."""
    family = [at_048(report)["reference"], *cases(report, "refinement")]
    return sorted(family, key=lambda case: case["vertices"])


def converges(report: dict) -> str:
    """Differences of the finest meshes and of those for data from the converged value."""
    true = report["scene"]["converged"]
    finest = [case["force"] for case in refinements(report)[-3:]]
    rows = [row for row in solved(at_048(report)) if row["element"] == DATA][-2:]
    data = [{depth: row["depths"][depth]["force"] for depth in true} for row in rows]
    found = [
        ", ".join(f"{span(errors)} at {depth} mm" for depth, errors in off(forces, true).items())
        for forces in (finest, data)
    ]
    return (
        f"The finest {len(finest)} meshes of p2 are off by {found[0]}; "
        f"the finest {len(data)} of {DATA} by {found[1]}."
    )


def force_columns(true: dict, heading: str, digits: int) -> dict[str, Any]:
    """Columns of a force by depth, in brackets what it is off the true one."""

    def column(depth: str, exact: float):
        def cell(row: dict) -> str:
            force = row["force"][depth]
            beside = " N" if row["force"] is true else f" ({percent(force / exact - 1)})"
            return f"{force:.{digits}f}{beside}"

        return cell

    return {heading.format(depth): column(depth, exact) for depth, exact in true.items()}


def refinement_table(report: dict) -> str:
    """Force by mesh at ν = 0.48."""
    forces = force_columns(report["scene"]["converged"], "F at {} mm", 4)
    columns = {"vertices": "{vertices}", **forces, "CPU s a frame": "{cpu_seconds:.1f}"}
    return table(columns, refinements(report))


def mini_table(report: dict) -> str:
    """Force by depth: measured, computed, closed forms."""
    measured = report["scene"]["measured"]
    rows: list[dict] = [{"calibration": "measured", "force": measured}]
    for name, forms in report["closed_forms"].items():
        runs = [case for case in cases(report, "mini") if case["calibration"] == name]
        rows += sorted(runs, key=lambda case: (case["element"], case["friction"]))
        about = {"calibration": name, "friction": 0}
        rows += [about | {"element": f.capitalize(), "force": forms[f]} for f in forms]
    columns = {"calibration": "{calibration}", "by": "{element}", "μ": "{friction}"}
    columns |= {"vertices": "{vertices}"} | force_columns(measured, "{} mm", 3)
    return table(columns, rows, absent="")


STYLES = {"p1": ":", "p1-bar": "-", "p2": "--"}


def figure(report: dict):
    """Errors by mesh at each Poisson's ratio, the Mini's force, seconds a frame."""
    picture, axes = plt.subplots(2, 3, figsize=(12, 7), layout="constrained")
    errors = {"force": "force", "displacement": "displacement", "von_mises": "von Mises stress"}
    for (key, title), axis in zip(errors.items(), axes.flat, strict=False):
        error_plot(accuracies(report), f"{key}_error", axis)
        axis.set(title=f"Error of {title} at 1 mm", xlabel="vertices", ylabel="%")
    # In the first panel it would cover a point; colours are the same in all three.
    axes[0][1].legend(title="p1 dotted, p2 dashed", fontsize=7)
    cost_plot(accuracies(report), axes[1][0])
    mini_plot(report, axes[1][1])
    speed_plot(report, axes[1][2])
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    return picture


def error_plot(at: list[dict], key: str, axis) -> None:
    """One error at 1 mm against the vertices of the mesh."""
    for colour, case in enumerate(at):
        for element, style in STYLES.items():
            rows = [row for row in solved(case) if row["element"] == element]
            x = [row["vertices"] for row in rows]
            y = [100 * abs(row["depths"]["1.0"][key]) for row in rows]
            label = f"ν {case['poisson']}" if element == DATA else None
            axis.loglog(x, y, style, marker=".", color=f"C{colour}", label=label)


def cost_plot(at: list[dict], axis) -> None:
    """CPU seconds a frame against the error of displacement, all Poisson's ratios."""
    for colour, element in enumerate(STYLES):
        rows = [row for case in at for row in solved(case) if row["element"] == element]
        x = [row["cpu_seconds"] for row in rows]
        y = [100 * row["depths"]["1.0"]["displacement_error"] for row in rows]
        axis.loglog(x, y, ".", color=f"C{colour}", label=element)
    axis.set(title="Error of displacement by cost", xlabel="CPU s a frame", ylabel="%")
    axis.legend()


def mini_plot(report: dict, axis) -> None:
    """Measured force, every calibration, closed forms."""
    measured = report["scene"]["measured"]
    x, forms = [float(depth) for depth in measured], report["closed_forms"]
    axis.loglog(x, list(measured.values()), "ko", label="measured (FEATS)")
    for case in best_mini(report):
        name, friction = case["calibration"], case["friction"]
        style = "-" if friction >= 1 else "--"
        label = f"{name}, μ {friction}, {case['element']}"
        y = [case["force"][depth] for depth in measured]
        axis.loglog(x, y, style, color=f"C{list(forms).index(name)}", label=label)
    for form, style in [("hertz", ":"), ("dimitriadis", "-.")]:
        for colour, name in enumerate(forms):
            y = [forms[name][form][depth] for depth in measured]
            label = f"{form.capitalize()}, {name}"
            axis.loglog(x, y, style, color=f"C{colour}", label=label)
    axis.set(title="GelSight Mini, ball of 7.5 mm", xlabel="depth (mm)", ylabel="N")
    axis.legend(fontsize=6, handlelength=4)


def speed_plot(report: dict, axis) -> None:
    """CPU seconds a frame against nodes."""
    for friction, marker in [(0.0, "o"), (0.5, "s")]:
        rows = [case for case in cases(report, "speed") if case["friction"] == friction]
        rows.sort(key=lambda case: case["vertices"])
        x, y = ([row[key] for row in rows] for key in ("vertices", "cpu_seconds"))
        axis.loglog(x, y, marker=marker, label=f"{DATA}, μ {friction}")
    axis.set(title="Cost of a 0.1 mm frame", xlabel="nodes", ylabel="CPU s")
    axis.legend()
