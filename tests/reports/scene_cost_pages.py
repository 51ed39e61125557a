"""The figures and the text of the report on what a scene costs."""

from __future__ import annotations

from collections import defaultdict

from kept import made, table

FULL = "network, all channels"
LEFT_OUT = {
    "displacement": "network, all but displacement",
    "stress": "network, all but stress",
    "depth": "network, all but depth",
    "all channels but markers": "network, markers",
    "touch": "rigid",
}


def summary(rows: list[dict]) -> dict:
    """Cost by scene and object, savings, scaling."""
    scenes: dict = defaultdict(dict)
    for row in rows:
        if row["key"].startswith("cost") and row["us"]:
            part = {key: row[key] for key in ("us", "stages", "MiB", "peak MiB", "steps", "load")}
            scenes[row["scene"]][row["object"]] = part | {"rate": 1e6 / row["us"]}
    scaling = [
        {key: row[key] for key in ("scene", "envs", "threads", "rate", "load")}
        for row in rows
        if row["key"].startswith("scaling")
    ]
    order = sorted(scenes, key=lambda name: -scenes[name]["sphere"]["rate"])
    scenes = {name: scenes[name] for name in order}
    return {"scenes": scenes, "savings": savings(scenes), "scaling": scaling}


def savings(scenes: dict) -> dict:
    """What leaving something out saves (µs), and what that stage took in the full scene."""
    found: dict = {}
    for thing, whole in scenes.get(FULL, {}).items():
        for part, other in LEFT_OUT.items():
            if thing in scenes.get(other, {}):
                saved = whole["us"] - scenes[other][thing]["us"]
                found.setdefault(part, {})[thing] = {
                    "saved": saved,
                    "share": saved / whole["us"],
                    "stage": whole["stages"].get(part),
                }
    return found


def markdown(report: dict) -> str:
    """Conclusion and tables."""
    parts = [
        "# What a scene costs",
        conclusion(report),
        "![cost of scenes](scene_cost.svg)",
        "## By scene",
        f"{report['sizes']['environments']} environments on one thread, scripted grasp, only steps "
        "in which all pads touch; processor time. Memory is what the scene adds to the process.",
        scenes(report["scenes"]),
        "## By stage",
        "µs in a step of one environment, as `env.unwrapped.plan()` lists it.",
        stages(report["scenes"]),
        "## What leaving something out saves",
        f"Against '{FULL}'; 'stage' is what the plan says that it takes.",
        saved(report["savings"]),
        "## Environments and threads",
        "Wall time, the whole machine's load when it began beside it.",
        scaled(report["scaling"]),
        made(report),
    ]
    return "\n\n".join(parts) + "\n"


def conclusion(report: dict) -> str:
    """What dominates each scene."""
    lines = []
    for name, things in report["scenes"].items():
        for thing, row in things.items():
            stage, us = max(row["stages"].items(), key=lambda x: x[1], default=("–", 0.0))
            lines.append(
                f"- {name}, {thing}: {row['rate']:,.0f} steps/s, {100 * us / row['us']:.0f} % of "
                f"it in {stage}."
            )
    return "Steps a second of one thread, and where they go:\n\n" + "\n".join(lines)


def scenes(found: dict) -> str:
    """Rates and memory."""
    rows = [
        [
            f"{name}, {thing}",
            f"{row['rate']:,.0f}",
            f"{row['us']:,.0f}",
            f"{row['MiB']:.0f}",
            f"{row['peak MiB']:.0f}",
        ]
        for name, things in found.items()
        for thing, row in things.items()
    ]
    return table(["scene", "steps/s", "µs a step", "MiB", "peak MiB of the process"], rows)


def stages(found: dict) -> str:
    """Time by stage."""
    rows = [
        (f"{name}, {thing}", row) for name, things in found.items() for thing, row in things.items()
    ]
    names = list(dict.fromkeys(stage for _, row in rows for stage in row["stages"]))
    cells = [
        [name, *(f"{row['stages'][s]:,.0f}" if s in row["stages"] else "" for s in names)]
        for name, row in rows
    ]
    return table(["scene", *names], cells)


def saved(found: dict) -> str:
    """Savings by what is left out."""
    rows = []
    for part, things in found.items():
        for thing, row in things.items():
            stage = f"{row['stage']:,.0f}" if row["stage"] is not None else "–"
            share = f"{100 * row['share']:.0f} %"
            rows.append([f"{part}, {thing}", f"{row['saved']:,.0f}", share, stage])
    return table(["left out", "saved (µs)", "of the step", "stage (µs)"], rows)


def scaled(rows: list[dict]) -> str:
    """Steps a second by environments and threads."""
    cells = [
        [
            row["scene"],
            str(row["envs"]),
            str(row["threads"]),
            f"{row['rate']:,.0f}",
            f"{row['load']:.1f}",
        ]
        for row in rows
    ]
    return table(["scene", "environments", "threads", "steps/s", "load"], cells)
