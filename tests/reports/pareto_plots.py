"""The picture of the report on error against run time: pareto.svg from what pareto.json holds."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt

STYLES = {
    "closed form": ("s", "#7f7f7f"),
    "compliance": ("o", "#2b6cb0"),
    "network": ("*", "#c53030"),
    "other network": ("x", "#c53030"),
    "paper": ("P", "#b7791f"),
    "fem": ("^", "#2f855a"),
}
TITLES = {"displacement": "u", "stress": "σ", "force": "net force"}


def figure(report: dict, path: Path) -> None:
    """Median error against time: three errors of the first panel, then u of the others."""
    panels = list(report["panels"])
    shown = [(panels[0], what) for what in TITLES] + [(p, "displacement") for p in panels[1:]]
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": "pareto", "font.size": 8}):
        columns = max(4, -(-len(shown) // 2))
        picture, axes = plt.subplots(2, columns, figsize=(4 * columns, 8), layout="constrained")
        for axis in axes.flat[len(shown) :]:
            axis.set_axis_off()
        for (panel, what), axis in zip(shown, axes.flat, strict=False):
            scatter(axis, report["panels"][panel], what, report["fronts"][panel][what])
            axis.set(title=f"{panel}: {TITLES[what]}", xlabel="CPU ms a frame", ylabel="%")
        legend(axes.flat[0])
        picture.savefig(path, metadata={"Date": None})
        plt.close(picture)


def scatter(axis, found: dict, what: str, front: list[str]) -> None:
    """Every answerer's median, a bar up to its 95th percentile, and the front as a line."""
    known = [name for name, row in found.items() if "ms" in row and what in row["finest"]]
    for place, name in enumerate(sorted(known, key=lambda name: found[name]["ms"])):
        row = found[name]
        marker, colour = STYLES[row["kind"]]
        median, most = (100 * row["finest"][what][key] for key in ("median", "95 %"))
        axis.plot([row["ms"]] * 2, [median, most], color=colour, alpha=0.25, linewidth=1)
        size = 11 if marker == "*" else 5
        axis.plot(row["ms"], median, marker, color=colour, markersize=size)
        # Neighbours in time have their names above and below.
        over = (4, 3) if place % 2 else (-4, -9)
        axis.annotate(
            short(name), (row["ms"], median), xytext=over, textcoords="offset points", fontsize=6
        )
    line = [(found[name]["ms"], 100 * found[name]["finest"][what]["median"]) for name in front]
    axis.plot(*zip(*line, strict=True), color="black", linewidth=0.8, zorder=0)
    axis.set(xscale="log", yscale="log")
    axis.grid(alpha=0.3, which="both")


def short(name: str) -> str:
    """A name in few letters; the marker tells the family."""
    for long, brief in [("compliance, ", "c "), ("compliance", "c"), ("fem ", "")]:
        name = name.replace(long, brief)
    return name.replace(" sweeps", "×").replace(" sweep", "×")


def legend(axis) -> None:
    """Names of the kinds, and of the front."""
    for kind, (marker, colour) in STYLES.items():
        axis.plot([], [], marker, color=colour, label=kind)
    axis.plot([], [], color="black", linewidth=0.8, label="front")
    axis.legend(fontsize=7, loc="upper right")
