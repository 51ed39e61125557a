"""The picture of the report on error against run time: pareto.svg from what pareto.json holds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt


@dataclass(frozen=True)
class Series:
    """Answerers that differ in one thing, joined by a line."""

    marker: str
    colour: str
    members: dict[str, str]
    """What stands beside each point, by the answerer's name."""


BLUE, RED, BROWN, GREEN, LIGHT = "#2b6cb0", "#c53030", "#b7791f", "#2f855a", "#81c784"
SERIES = {
    "closed form of a bonded layer": Series("s", "#7f7f7f", {"bonded layer": ""}),
    "linear answer, by nodes": Series(
        "o", "#90cdf4", {"compliance 1000": "1000", "compliance": ""}
    ),
    "linear answer, by sweeps": Series(
        "o",
        BLUE,
        {"compliance": "0", "compliance, 1 sweep": "1"}
        | {f"compliance, {sweeps} sweeps": f"{sweeps}" for sweeps in (3, 6, 12)},
    ),
    "linear answer without friction": Series("s", BLUE, {"compliance, no friction": ""}),
    "linear answer at nodes": Series("D", BLUE, {"compliance at nodes": ""}),
    "linear answer on cells": Series("P", BLUE, {"linear, on cells": ""}),
    "network, by channels": Series(
        "*",
        RED,
        {"network, 16 channels": "16", "network": "32", "network, 48 channels": "48"},
    ),
    "network by Candle's layers": Series("x", RED, {"network, by Candle": ""}),
    "the paper's networks": Series(
        "X",
        BROWN,
        {
            "paper's Baseline": "base",
            "paper's A": "A",
            "paper's B": "B",
            "paper's B, 32 channels": "B 32",
            "paper's B, 8 rounds": "B 8",
        },
    ),
    "finite elements p1": Series("v", LIGHT, {"fem p1 2000": "2000"}),
    "finite elements p2, by nodes": Series(
        "s", LIGHT, {"fem p2 500": "500", "fem p2 1000": "1000"}
    ),
    "finite elements p1-bar, by nodes": Series(
        "^", GREEN, {f"fem p1-bar {n}": f"{n}" for n in (500, 1000, 2000, 3000)}
    ),
    "the same on 2,000, by tolerance": Series(
        "<",
        GREEN,
        {"fem p1-bar 2000, 1 mN": "", "fem p1-bar 2000, 10 µN": "", "fem p1-bar 2000": ""},
    ),
}
LOOSE = ("the paper's networks",)
"""Series whose points are not joined."""
TITLES = {"displacement": "u", "stress": "σ", "force": "net force"}


def figure(report: dict, path: Path) -> None:
    """Median error against time: three errors of the first panel, then u of the others."""
    panels = list(report["panels"])
    shown = [(panels[0], what) for what in TITLES] + [(p, "displacement") for p in panels[1:]]
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": "pareto", "font.size": 8}):
        columns = max(4, -(-(len(shown) + 1) // 2))
        picture, axes = plt.subplots(2, columns, figsize=(4 * columns, 8), layout="constrained")
        for axis in axes.flat[len(shown) :]:
            axis.set_axis_off()
        for (panel, what), axis in zip(shown, axes.flat, strict=False):
            scatter(axis, report["panels"][panel], what, report["fronts"][panel][what])
            axis.set(title=f"{panel}: {TITLES[what]}", xlabel="CPU ms a frame", ylabel="%")
        legend(axes.flat[-1])
        picture.savefig(path, metadata={"Date": None})
        plt.close(picture)


def scatter(axis, found: dict, what: str, front: list[str]) -> None:
    """Every answerer's median, a bar up to its 95th percentile, and the front as a band."""
    for title, series in SERIES.items():
        known = [name for name in series.members if what in found.get(name, {}).get("finest", {})]
        medians = [100 * found[name]["finest"][what]["median"] for name in known]
        times = [found[name]["ms"] for name in known]
        line = "" if title in LOOSE else "-"
        axis.plot(times, medians, series.marker + line, color=series.colour, lw=0.8, **size(series))
        for name, ms, median in zip(known, times, medians, strict=True):
            most = 100 * found[name]["finest"][what]["95 %"]
            axis.plot([ms] * 2, [median, most], color=series.colour, alpha=0.2, linewidth=1)
            axis.annotate(
                series.members[name],
                (ms, median),
                xytext=(4, 3),
                textcoords="offset points",
                fontsize=6,
                color=series.colour,
            )
    line = [(found[name]["ms"], 100 * found[name]["finest"][what]["median"]) for name in front]
    axis.plot(*zip(*line, strict=True), color="black", linewidth=6, alpha=0.15, zorder=0)
    axis.set(xscale="log", yscale="log")
    axis.yaxis.set_major_formatter("{x:g}")
    axis.yaxis.set_minor_formatter("{x:g}")
    axis.tick_params(axis="y", which="minor", labelsize=6)
    axis.grid(alpha=0.3, which="both")


def size(series: Series) -> dict[str, float]:
    """How large its markers are."""
    return {"markersize": 9 if series.marker == "*" else 5}


def legend(axis) -> None:
    """Names of the series, and of the front, on an axis of their own."""
    for title, series in SERIES.items():
        axis.plot([], [], series.marker, color=series.colour, label=title, **size(series))
    axis.plot([], [], color="black", linewidth=6, alpha=0.15, label="front")
    axis.plot([], [], color="grey", alpha=0.4, linewidth=1, label="median to 95th percentile")
    axis.legend(fontsize=8, loc="center left", frameon=False)
