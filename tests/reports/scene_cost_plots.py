"""The picture of the report on what a scene costs: scene_cost.svg from what its JSON holds."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt


def figure(report: dict, path: Path) -> None:
    """Time by stage of every scene, rates by threads, and time of training."""
    runs = [
        ("free" if kind == "free" else name.replace(", ", "\n", 1), row["us"])
        for name, run in report.get("sb3", {}).items()
        for kind, row in run.items()
        if "us" in row
    ]
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": "scenes", "font.size": 8}):
        picture, axes = plt.subplot_mosaic(
            [["stages", "threads"], ["stages", "training" if runs else "threads"]],
            figsize=(12, 7.5),
            layout="constrained",
            width_ratios=[2, 1],
            height_ratios=[3, 2],
        )
        stages(axes["stages"], report["scenes"])
        threads(axes["threads"], report["scaling"])
        if runs:
            training(axes["training"], runs)
        picture.savefig(path, metadata={"Date": None})
        plt.close(picture)


def stages(axis, scenes: dict) -> None:
    """A row a scene: the time of each kind of stage, and the rate of the whole."""
    rows = [(f"{n}, {t}", row) for n, things in scenes.items() for t, row in things.items()]
    kinds = ("scene", "press", "model", "correction", "channel", "reward")
    for colour, kind in enumerate(kinds):
        for place, (_, row) in enumerate(rows):
            us = sum(time for stage, time in row["stages"].items() if stage.startswith(kind))
            if us > 0:
                label = "channels" if kind == "channel" else kind
                shown = axis.plot(us, place, "o", color=f"C{colour}", markersize=6)
                shown[0].set_label(label)
    for place, (_, row) in enumerate(rows):
        axis.plot(row["us"], place, "|", color="black", markersize=14)
        axis.annotate(
            f"{row['rate']:,.0f} steps/s",
            (row["us"], place),
            xytext=(6, -2),
            textcoords="offset points",
            fontsize=7,
        )
    axis.set_yticks(range(len(rows)), [name for name, _ in rows])
    axis.invert_yaxis()
    axis.set(xscale="log", xlabel="CPU µs in a step of one environment; | is the whole step")
    axis.set_title("Where a step's time goes")
    axis.set_xlim(right=6 * max(row["us"] for _, row in rows))
    axis.grid(alpha=0.3, axis="x", which="both")
    named = dict(zip(*reversed(axis.get_legend_handles_labels()), strict=True))
    axis.legend(
        named.values(),
        named.keys(),
        fontsize=7,
        ncols=6,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.09),
    )


def threads(axis, rows: list[dict]) -> None:
    """Rates by threads, a line for each number of environments."""
    lines: dict = {}
    for row in rows:
        lines.setdefault(f"{row['scene']}, {row['envs']} envs", []).append(row)
    for name, line in lines.items():
        axis.loglog([r["threads"] for r in line], [r["rate"] for r in line], ".-", label=name)
    axis.set(title="Environments and threads", xlabel="threads", ylabel="steps/s")
    axis.grid(alpha=0.3, which="both")
    axis.legend(fontsize=7, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.14))


def training(axis, runs: list) -> None:
    """A bar a run of PPO: the environment's time, what else collecting takes, and updating."""
    places, before = range(len(runs)), [0.0] * len(runs)
    for part in ("environment", "collecting", "updating"):
        times = [us[part] for _, us in runs]
        axis.barh(places, times, left=before, label=part)
        before = [sum(pair) for pair in zip(before, times, strict=True)]
    axis.set_yticks(places, [name for name, _ in runs])
    axis.invert_yaxis()
    axis.set(title="SB3's PPO end to end", xlabel="wall µs in a step of one environment")
    axis.grid(alpha=0.3, axis="x")
    axis.legend(fontsize=7)
