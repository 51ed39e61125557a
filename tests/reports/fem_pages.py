"""The text of the finite-element report: fem.md from what fem.json holds."""

from __future__ import annotations

DATA = "p1-bar"
"""Element that data are made with."""
WITHIN = 0.05
"""Error of force that a mesh for data may have at any depth and Poisson's ratio up to 0.49."""


def markdown(report: dict) -> str:
    """Conclusion, tables and how they were made."""
    parts = [
        "# Finite elements: how far from the truth, at what cost",
        conclusion(report),
        "## Error by mesh",
        about_accuracy(report),
        *(accuracy_table(case) for case in accuracies(report)),
        "## Does the force converge to that of other solvers?",
        about_refinement(report),
        refinement_table(report),
        "## Force of a GelSight Mini, nothing fitted",
        about_mini(report),
        mini_table(report),
        "## Cost of a frame",
        "Flat pad, p1-bar, 15 frames of 0.1 mm: 1 mm down, 0.5 mm sideways. One thread, alone in "
        "this report; load is that of the whole machine when the case began. Memory is the peak "
        "of the process, Python included.",
        speed_table(report),
        made(report),
    ]
    return "\n\n".join(parts) + "\n"


def cases(report: dict, kind: str) -> list[dict]:
    """Results of the cases of one kind."""
    return [case for name, case in report["cases"].items() if name.startswith(kind)]


def accuracies(report: dict) -> list[dict]:
    """Accuracy by Poisson's ratio, ascending."""
    return sorted(cases(report, "accuracy"), key=lambda case: case["poisson"])


def table(head: list[str], rows: list[list[str]]) -> str:
    """A table of Markdown, numbers to the right."""
    lines = [head, ["---:"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def percent(share: float) -> str:
    """A signed share in percent."""
    return f"{100 * share:+.1f} %"


def conclusion(report: dict) -> str:
    """Three sentences: is the reference right, which mesh makes data, what the Mini says."""
    return "\n".join([reference_sentence(report), mesh_sentence(report), mini_sentence(report)])


def reference_sentence(report: dict) -> str:
    """How the reference meets the converged force of other solvers."""
    case = next(case for case in accuracies(report) if case["poisson"] == 0.48)
    reference, converged = case["reference"], report["scene"]["converged"]
    found = ", ".join(
        f"{reference['force'][depth]:.4f} N at {depth} mm (converged {force} N, "
        f"{percent(reference['force'][depth] / force - 1)})"
        for depth, force in converged.items()
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
        keys = ("force_error", "displacement_error", "von_mises_error")
        depths = [depth for row in rows for depth in row["depths"].values()]
        errors = {key: max(abs(depth[key]) for depth in depths) for key in keys}
        cost = max(row["cpu_seconds"] for row in rows)
        meshes.append({"vertices": vertices, "cpu_seconds": cost} | errors)
    return meshes


def mesh_sentence(report: dict) -> str:
    """The coarsest mesh within the error allowed, or the finest where none is."""
    meshes = worst_errors(report)
    fit = [mesh for mesh in meshes if mesh["force_error"] <= WITHIN]
    mesh = fit[0] if fit else meshes[-1]
    finer = ", ".join(
        f"{100 * other['force_error']:.1f} % in force and "
        f"{100 * other['displacement_error']:.0f} % in displacement ({other['vertices']} nodes)"
        for other in meshes[meshes.index(mesh) + 1 :]
    )
    choice = (
        f"the coarsest {DATA} mesh whose force is within {100 * WITHIN:.0f} % of the "
        "reference at 0.5 and 1 mm and every ν up to 0.49"
        if fit
        else f"no {DATA} mesh is within {100 * WITHIN:.0f} %, and the finest"
    )
    return (
        f"2. For data: {choice} has {mesh['vertices']} nodes, with at most "
        f"{100 * mesh['force_error']:.1f} % of error in force, "
        f"{100 * mesh['displacement_error']:.0f} % in displacement and "
        f"{100 * mesh['von_mises_error']:.0f} % in von Mises stress, at "
        f"{1e3 * mesh['cpu_seconds']:.0f} ms of CPU a frame; finer "
        f"meshes have {finer or 'not been run'}."
    )


def best_mini(report: dict) -> list[dict]:
    """The Mini's cases in the last and best of the elements run."""
    element = report["sizes"]["mini"][-1][0]
    return [case for case in cases(report, "mini") if case["element"] == element]


def mini_errors(report: dict, force: dict) -> list[float]:
    """Relative errors against the measured force by depth."""
    return [force[depth] / true - 1 for depth, true in report["scene"]["measured"].items()]


def mini_sentence(report: dict) -> str:
    """The best and the worst of the calibrations against the measured force."""
    spans = [(case, mini_errors(report, case["force"])) for case in best_mini(report)]
    spans.sort(key=lambda item: max(map(abs, item[1])))
    named = [
        f"{case['calibration']} with μ = {case['friction']} on {case['vertices']} vertices of "
        f"{case['element']}, {percent(min(errors))} to {percent(max(errors))}"
        for case, errors in (spans[0], spans[-1])
    ]
    best, worst = named
    return f"3. Unfitted, the Mini's measured force is met best by {best}, and worst by {worst}."


def about_accuracy(report: dict) -> str:
    """What was compared, and with what."""
    scene, case = report["scene"], accuracies(report)[0]
    return (
        f"Flat pad 20.75 × 25.25 × 4 mm, E = {scene['young'] / 1e6} MPa, {scene['law']}, ball of "
        f"{1e3 * scene['radius']:.0f} mm, no friction, four frames of 0.25 mm. Truth at each ν: p2 "
        f"on {case['reference']['vertices']} vertices. Displacement (u) and von Mises stress (σ) "
        f"are carried to one mesh of {case['common']['vertices']} vertices and "
        f"{case['common']['tetrahedra']} tetrahedra, of which the truth's mesh is a refinement; "
        "errors are relative L2 norms over its volume. A p2 answer is carried by its vertices "
        "alone, which costs it part of its accuracy in u. Seconds are a mean over the frames with "
        "another case running beside."
    )


FIELDS = ("displacement", "von_mises")


def accuracy_table(case: dict) -> str:
    """Errors of every mesh at one Poisson's ratio."""
    head = ["element", "vertices", "F at 0.5 mm", "F at 1 mm", "u at 0.5", "u at 1", "σ at 0.5"]
    head += ["σ at 1", "Newton steps", "s a frame", "CPU s a frame"]
    rows = []
    for row in case["rows"]:
        if "failed" in row:
            rows.append([row["element"], str(row["vertices"]), row["failed"]] + [""] * 8)
            continue
        half, full = row["depths"]["0.5"], row["depths"]["1.0"]
        fields = [depth[f"{field}_error"] for field in FIELDS for depth in (half, full)]
        rows.append(
            [row["element"], str(row["vertices"])]
            + [f"{depth['force']:.4f} ({percent(depth['force_error'])})" for depth in (half, full)]
            + [f"{100 * error:.1f} %" for error in fields]
            + [f"{row['iterations']:.1f}", f"{row['seconds']:.3f}", f"{row['cpu_seconds']:.3f}"]
        )
    reference = case["reference"]
    force, cost = reference["force"], reference["cpu_seconds"]
    truth = f"### ν = {case['poisson']}: {force['0.5']:.4f} N and {force['1.0']:.4f} N"
    truth += f"\n\nThe reference took {cost:.1f} s of CPU for each 0.5 mm."
    return f"{truth}\n\n{table(head, rows)}"


def refinements(report: dict) -> list[dict]:
    """The truth at ν = 0.48 and the meshes of its family, the coarsest first."""
    truth = next(case["reference"] for case in accuracies(report) if case["poisson"] == 0.48)
    return sorted([truth, *cases(report, "refinement")], key=lambda case: case["vertices"])


def about_refinement(report: dict) -> str:
    """What was refined, and whether the finest meshes and those for data meet the value."""
    converged = report["scene"]["converged"]
    rows = next(case for case in accuracies(report) if case["poisson"] == 0.48)["rows"]
    data = [row for row in rows if row["element"] == DATA and "failed" not in row][-2:]

    def off(forces: list[dict]) -> str:
        """The span of errors by depth."""
        spans = []
        for depth, true in converged.items():
            errors = [force[depth] / true - 1 for force in forces]
            spans.append(f"{percent(min(errors))} to {percent(max(errors))} at {depth} mm")
        return ", ".join(spans)

    finest = refinements(report)[-3:]
    by_data = [{depth: row["depths"][depth]["force"] for depth in converged} for row in data]
    return (
        "p2 at ν = 0.48, the truth above among meshes of its family: cells within 3.7 mm of the "
        "contact are cut ever finer. Beside each force what it is off the value on which NGSolve, "
        "GetFEM and CalculiX agree under refinement (± 0.0005 N). Contact gives by its softness, "
        "0.3 % of the force at 0.5 mm and 0.1 % at 1 mm, which is not taken off.\n\n"
        f"The finest {len(finest)} meshes of p2 are off by {off([f['force'] for f in finest])}; "
        f"the finest {len(data)} of {DATA} by {off(by_data)}."
    )


def refinement_table(report: dict) -> str:
    """Force by mesh at ν = 0.48."""
    converged = report["scene"]["converged"]
    head = ["vertices", *(f"F at {depth} mm" for depth in converged), "CPU s a frame"]
    rows = []
    for case in refinements(report):
        forces = [(case["force"][depth], true) for depth, true in converged.items()]
        found = [f"{force:.4f} ({percent(force / true - 1)})" for force, true in forces]
        rows.append([str(case["vertices"]), *found, f"{case['cpu_seconds']:.1f}"])
    return table(head, rows)


def about_mini(report: dict) -> str:
    """Where the measurement is from, and what each row is."""
    radius = 1e3 * report["scene"]["mini_radius"]
    return (
        f"Ball of {radius} mm at the apex, in steps of 0.25 mm; E, ν and law of each published "
        "calibration. μ is the sensor's static and its sliding coefficient, each used as Coulomb's "
        "one. Measured: FEATS (arXiv 2411.03315). The closed forms are for a flat face without "
        "friction: Hertz on a half-space; a bonded layer by Dimitriadis et al. (2002), for the "
        "calibration's ν and by their equation for ν = 0.5."
    )


def mini_table(report: dict) -> str:
    """Force by depth: measured, computed, closed forms."""
    measured = report["scene"]["measured"]
    head = ["calibration", "by", "μ", "vertices", *(f"{depth} mm" for depth in measured)]
    rows = [["measured", "", "", "", *(f"{force:.3f} N" for force in measured.values())]]

    def values(force: dict) -> list[str]:
        errors = mini_errors(report, force)
        return [f"{force[d]:.3f} ({percent(e)})" for d, e in zip(measured, errors, strict=True)]

    for name, forms in report["closed_forms"].items():
        runs = [case for case in cases(report, "mini") if case["calibration"] == name]
        for case in sorted(runs, key=lambda case: (case["element"], case["friction"])):
            about = [name, case["element"], str(case["friction"]), str(case["vertices"])]
            rows.append(about + values(case["force"]))
        rows += [[name, form.capitalize(), "0", "", *values(forms[form])] for form in forms]
    return table(head, rows)


def speed_table(report: dict) -> str:
    """Seconds, iterations and memory by mesh and friction."""
    head = ["nodes", "μ", "s a frame", "slowest", "CPU s a frame", "Newton steps"]
    head += ["CPU s to set up", "peak MiB", "of it before", "load"]
    rows = []
    for case in cases(report, "speed"):
        seconds = [f"{case[key]:.3f}" for key in ("seconds", "slowest_seconds", "cpu_seconds")]
        memory = [f"{case[key]:.0f}" for key in ("peak_mib", "idle_mib")]
        about = [str(case["vertices"]), str(case["friction"])]
        steps, setup = f"{case['iterations']:.1f}", f"{case['setup_cpu_seconds']:.2f}"
        rows.append([*about, *seconds, steps, setup, *memory, f"{case['load']:.1f}"])
    return table(head, rows)


def made(report: dict) -> str:
    """Machine, commit and versions."""
    machine = report["machine"]
    versions = ", ".join(f"{name} {number}" for name, number in report["versions"].items())
    return (
        f"Made by tests/reports/fem.py at {report['commit']} on {machine['cpu']}, "
        f"{machine['cores']} cores, {machine['system']}; {versions}."
    )
