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
    """Cost by scene and object, savings, scaling, training, peers."""
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
    return {
        "scenes": scenes,
        "savings": savings(scenes),
        "scaling": scaling,
        "sb3": training([row for row in rows if row["key"].startswith("sb3")]),
        "peers": [
            {key: value for key, value in row.items() if key != "key"}
            for row in rows
            if row["key"].startswith("peer")
        ],
    }


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


def training(rows: list[dict]) -> dict:
    """Runs of PPO by name, each with that in a free environment, and the environment's share."""
    found: dict = {}
    for row in rows:
        part = {key: value for key, value in row.items() if key not in ("key", "run", "free")}
        if "us" in part:
            part["share"] = part["us"]["environment"] / sum(part["us"].values())
        found.setdefault(row["run"], {})["free" if row["free"] else "ruffini"] = part
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
        *beside(report),
        made(report),
    ]
    return "\n\n".join(parts) + "\n"


def beside(report: dict) -> list[str]:
    """Sections on training and peers, where they were measured."""
    parts = []
    if report.get("sb3"):
        parts += [
            "## SB3 end to end",
            "Stable-Baselines3's PPO with the parameters of `policies/params.py`, one thread of "
            "torch and one of the environment: wall time, by step of one environment. The "
            "policy's own networks count as PPO's. A free environment plays one recorded episode "
            "over and over; it leaves PPO's caches warm, which physics does not. 'Touch' is the "
            "share of steps in which a pad touches: the policy is untrained, and in GraspLift a "
            "trained one touches far more often.",
            trained(report["sb3"]),
        ]
    if report.get("peers"):
        parts += [
            "## Peers",
            "Random actions on one thread, which seldom touch; resets included; wall time. A step "
            "of one is not a step of another: 'real time' is the simulated time over the wall's.",
            peers(report["peers"]),
        ]
    return parts


def conclusion(report: dict) -> str:
    """What dominates each scene, and the environment's share of training."""
    lines = []
    for name, things in report["scenes"].items():
        for thing, row in things.items():
            stage, us = max(row["stages"].items(), key=lambda x: x[1], default=("–", 0.0))
            lines.append(
                f"- {name}, {thing}: {row['rate']:,.0f} steps/s, {100 * us / row['us']:.0f} % of "
                f"it in {stage}."
            )
    text = "Steps a second of one thread, and where they go:\n\n" + "\n".join(lines)
    if report.get("sb3"):
        text += "\n\nTraining by Stable-Baselines3's PPO end to end on one thread:\n\n"
        text += "\n".join(share(name, run) for name, run in report["sb3"].items())
    return text


def share(name: str, run: dict) -> str:
    """The environment's share of a run, in a sentence."""
    whole, free = run["ruffini"], run["free"]
    if "missing" in whole or "missing" in free:
        return f"- {name}: {whole.get('missing') or free['missing']}."
    return (
        f"- {name}: {whole['rate']:,.0f} steps/s, {100 * whole['share']:.0f} % of it in ruffini, "
        f"the rest in SB3; {free['rate']:,.0f} steps/s in a free environment."
    )


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


def trained(found: dict) -> str:
    """Steps a second and time of training, beside a free environment."""
    head = ["run", "environments", "steps/s", "environment (µs)", "rest of collecting (µs)"]
    head += ["updating (µs)", "environment's share", "touch", "load"]
    rows = []
    for name, run in found.items():
        for kind, row in run.items():
            label = f"{name}, free" if kind == "free" else name
            if "missing" in row:
                rows.append([label, row["missing"], *[""] * (len(head) - 2)])
                continue
            us = [f"{row['us'][part]:,.0f}" for part in ("environment", "collecting", "updating")]
            touch = "" if kind == "free" else f"{100 * row['touch']:.1f} %"
            part = f"{100 * row['share']:.0f} %"
            rates = [str(row["envs"]), f"{row['rate']:,.0f}"]
            rows.append([label, *rates, *us, part, touch, f"{row['load']:.1f}"])
    return table(head, rows)


def peers(found: list[dict]) -> str:
    """Steps a second of environments by several packages."""
    rows = []
    for row in found:
        step = f"{1e3 * row['control step']:.0f}"
        if "missing" in row:
            rows.append([row["envs"], row["missing"], step, "", "", ""])
            continue
        versions = ", ".join(f"{name} {text}" for name, text in row.get("versions", {}).items())
        times = f"{row['rate'] * row['control step']:,.0f}"
        rows.append(
            [row["envs"], f"{row['rate']:,.0f}", step, times, versions, f"{row['load']:.1f}"]
        )
    head = ["environments", "steps/s", "step (ms)", "times real time", "version", "load"]
    return table(head, rows)
