"""The text of the datasets' report: dataset.md from what dataset.json holds."""

from __future__ import annotations

import numpy as np
from kept import made, table

WHOLE = 63 * 100 * 50
"""Frames of the paper's dataset."""
ERRORS = {"force": "force", "u": "u", "sigma": "σ", "peak": "peak σ"}


def markdown(report: dict) -> str:
    """Costs, the truth's own error, what datasets hold, how it was made."""
    parts = [
        "# Datasets: cost, truth, contents",
        "## Time and disk",
        about_cost(report),
        cost_table(report),
        "![cost and error](dataset.svg)",
        *about_kills(report),
        *judged(report),
        *(held(name, found) for name, found in report["datasets"].items()),
        made(report | {"sizes": {"finest": " ".join(map(str, report["sizes"]["finest"]))}}),
    ]
    return "\n\n".join(parts) + "\n"


def about_cost(report: dict) -> str:
    """What was made, and what its times are worth."""
    sizes = report["sizes"]["cost"]
    return (
        f"{sizes['objects']} objects × {sizes['grasps']} grasps × {sizes['frames']} frames by two "
        "pads, p1-bar. Wall time is that of the machine as loaded as it was; CPU time is less "
        "disturbed by others."
    )


def costs(report: dict) -> list[dict]:
    """Rows of cost."""
    rows = [row for row in report["rows"] if row["key"].startswith("cost")]
    return sorted(rows, key=lambda row: (row["truth"], row["threads"]))


def cost_table(report: dict) -> str:
    """Time and disk of 1,000 frames, and of the paper's dataset."""
    head = ["truth / model nodes", "threads", "wall s / 1,000", "CPU s / 1,000", "MB / 1,000"]
    lines = []
    for row in costs(report):
        share = 1000 / row["frames"]
        days, disk = (
            WHOLE / row["frames"] * row["wall"] / 86400,
            WHOLE / row["frames"] * row["bytes"],
        )
        lines.append(
            [
                f"{row['truth']} / {row['model']}",
                str(row["threads"]),
                f"{share * row['wall']:.0f}",
                f"{share * row['cpu']:.0f}",
                f"{share * row['bytes'] / 1e6:.0f}",
                f"{days:.1f} days, {disk / 1e9:.0f} GB",
            ]
        )
    return table([*head, "63 × 100 × 50"], lines)


def about_kills(report: dict) -> list[str]:
    """What kills and a second run changed, where that was tried."""
    changed = {True: "the same bytes", False: "**other bytes**"}
    return [
        f"A generation of {row['files']} files, killed at {row['kills']} random moments and taken "
        f"up again after each, ends with {changed[row['same']]}; made a second time, with "
        f"{changed[row['twice']]}."
        for row in report["rows"]
        if row["key"] == "kills"
    ]


def rungs(report: dict) -> dict[tuple[str, int], list[dict]]:
    """Rows of the truth's error by element and nodes asked for."""
    found: dict[tuple[str, int], list[dict]] = {}
    for row in report["rows"]:
        if row["key"].startswith("truth"):
            found.setdefault((row["element"], row["nodes"]), []).append(row)
    return found


def judged(report: dict) -> list[str]:
    """How far the truth is from a finer mesh, where a grasp has been judged."""
    if not report["truth"]:
        return []
    head = "## How far the truth is from a finer mesh"
    return [head, about_truth(report), truth_table(report)]


def about_truth(report: dict) -> str:
    """What was solved again, and against what."""
    element, nodes = report["sizes"]["finest"]
    rows = [row for of in rungs(report).values() for row in of]
    grasps = sorted({row["grasp"] for row in rows})
    depths = [depth for row in rows for depth in row["depths"]]
    return (
        f"Frames of {len(grasps)} grasps ({', '.join(grasps)}), {100 * min(depths):.0f} to "
        f"{100 * max(depths):.0f} % of the pad's thickness deep, solved again at the same poses of "
        f"the pads and compared with {element} on at most {nodes} nodes, which is no limit itself. "
        "Median and worst frame; displacement u and von Mises stress σ in relative L² norm on the "
        "model mesh, to which both are carried as their elements know them (`Fem.carry`)."
    )


def accuracy(rows: list[dict]) -> dict:
    """Median and worst error of each element and mesh, its cost and what it left unsolved."""
    found = {}
    for (element, _), own in rungs({"rows": rows}).items():
        solved = [row for row in own if "errors" in row]
        if not solved:
            continue
        frames = [frame for row in solved for frame in row["errors"]]
        columns = {name: [frame[name] for frame in frames] for name in ERRORS}
        found[f"{element} {solved[0]['vertices']}"] = {
            name: {"median": float(np.median(of)), "worst": max(of)} for name, of in columns.items()
        } | {
            "cpu": float(np.mean([row["cpu"] for row in solved])),
            "grasps": len(own),
            "failed": len(own) - len(solved),
        }
    return found


def truth_table(report: dict) -> str:
    """Median and worst error of each mesh, its cost and what it left unsolved."""
    lines = []
    for mesh, of in report["truth"].items():
        pairs = [(of[name]["median"], of[name]["worst"]) for name in ERRORS]
        cells = [f"{100 * median:.1f} / {100 * worst:.1f} %" for median, worst in pairs]
        lines.append([mesh, *cells, f"{of['cpu']:.1f}", f"{of['failed']} of {of['grasps']}"])
    head = ["element, nodes", *ERRORS.values(), "CPU s a frame", "unsolved"]
    return table(head, lines)


def held(name: str, found: dict) -> str:
    """What a dataset holds."""
    config, worst, asked = found["config"], found["imbalance"], found["grasps"]
    low, high = config["force"]
    text = (
        f"{config['objects']} objects × {config['grasps']} grasps × at most {config['frames']} "
        f"frames, {low:g} to {high:g} N, {config['density']:g} kg/m³, commit "
        f"{found['commit'] or 'unknown'}: {found['frames']} frames, "
        f"{found['bytes'] / 1e6:.0f} MB. {found['unsolved']} of {asked} grasps ended early "
        f"({100 * found['unsolved'] / asked:.1f} %)"
    )
    text += "".join(f"; {count}: {reason}" for reason, count in found["reasons"].items())
    text += (
        f". Over all frames, Σ contact force is within {worst['contact']:.1e} N of a pad's wrench, "
        f"and an object is out of balance by {worst['force']:.1e} N and {worst['torque']:.1e} N m "
        "at most. Median and largest of all frames:"
    )
    lines = []
    for family, of in found["families"].items():
        cells = [f"{100 * x:.0f} %" for x in of["depth"][1:]] + [
            f"{x:.1f}" for x in of["force"][1:]
        ]
        cells += [f"{x:.2f}" for x in of["shear"][1:]] + [f"{x:.0f}" for x in of["stress"][1:]]
        pairs = zip(cells[::2], cells[1::2], strict=True)
        lines.append([family, *(" / ".join(pair) for pair in pairs)])
    head = ["family", "depth", "force (N)", "tangential / normal", "peak stress (kPa)"]
    picture = f"![distributions](dataset-{name}.png)"
    return "\n\n".join([f"## {name}", text, table(head, lines), picture])
