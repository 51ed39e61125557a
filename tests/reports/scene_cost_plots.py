"""The picture of the report on what a scene costs: scene_cost.svg from what its JSON holds."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt


def figure(report: dict, path: Path) -> None:
    """Time by stage of every scene, and rates by threads."""
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": "scenes", "font.size": 8}):
        picture, axes = plt.subplots(
            1, 2, figsize=(12, 5.5), layout="constrained", width_ratios=[2, 1]
        )
        stages(axes[0], report["scenes"])
        threads(axes[1], report["scaling"])
        picture.savefig(path, metadata={"Date": None})
        plt.close(picture)


def stages(axis, scenes: dict) -> None:
    """A bar a scene, cut into its stages, by share, with its rate."""
    rows = [(f"{n}, {t}", row) for n, things in scenes.items() for t, row in things.items()]
    names = list(dict.fromkeys(stage for _, row in rows for stage in row["stages"]))
    for place, (_, row) in enumerate(rows):
        left = 0.0
        for stage in (name for name in names if name in row["stages"]):
            share = 100 * row["stages"][stage] / max(row["us"], sum(row["stages"].values()))
            axis.barh(
                place,
                share,
                left=left,
                color=f"C{names.index(stage) % 10}",
                hatch="//" if names.index(stage) > 9 else None,
            )
            left += share
        axis.text(101, place, f"{row['rate']:,.0f} steps/s", va="center", fontsize=7)
    for number, name in enumerate(names):
        axis.barh(0, 0, color=f"C{number % 10}", hatch="//" if number > 9 else None, label=name)
    axis.set_yticks(range(len(rows)), [name for name, _ in rows])
    axis.invert_yaxis()
    axis.set(xlim=(0, 122), xlabel="% of a step", title="Where a step's time goes")
    axis.legend(ncols=6, fontsize=6, loc="upper center", bbox_to_anchor=(0.45, -0.1))


def threads(axis, rows: list[dict]) -> None:
    """Rates by threads, a line for each number of environments."""
    lines: dict = {}
    for row in rows:
        lines.setdefault(f"{row['scene']}, {row['envs']} envs", []).append(row)
    for name, line in lines.items():
        axis.loglog([r["threads"] for r in line], [r["rate"] for r in line], ".-", label=name)
    axis.set(title="Environments and threads", xlabel="threads", ylabel="steps/s")
    axis.grid(alpha=0.3, which="both")
    axis.legend(fontsize=7)
