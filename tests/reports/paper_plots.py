"""The picture of the comparison with the paper: paper.svg from what paper.json holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
from paper_pages import answerers, runs_on, times, title

matplotlib.use("svg")
import matplotlib.pyplot as plt

COLOURS = {"Baseline": "C0", "A": "C1", "B": "C2", "B told the force": "C4", "corrector": "C3"}
COLOURS["linear answer"] = "k"
FIELDS = ["displacement u", "von Mises stress σ"]


def figure(report: dict[str, Any], path: Path) -> None:
    """Errors on novel objects against time trained, and against time a press."""
    # Glyphs as text and a fixed seed: the file changes only with the figures.
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": "paper", "font.size": 8}):
        picture, axes = plt.subplots(2, 2, figsize=(10, 7), sharey=True, layout="constrained")
        for field, (left, right) in enumerate(axes):
            learning(report, field, left)
            cost(report, field, right)
            left.set_ylabel(f"median relative error of {FIELDS[field]} (%)")
            for axis in (left, right):
                axis.grid(alpha=0.3, which="both")
                for numbers in (axis.xaxis, axis.yaxis):
                    numbers.set_major_formatter("{x:g}")
                    numbers.set_minor_formatter(
                        lambda x, _: f"{x:g}" if f"{x:g}"[0] in "25" else ""
                    )
        axes[0][0].set_title("Novel objects: error by training, 40 frames")
        axes[0][1].set_title("Novel objects: error by cost, all frames (bars to 95th percentile)")
        picture.savefig(path, metadata={"Date": None})
        plt.close(picture)


def learning(report: dict[str, Any], field: int, axis: Any) -> None:
    """Error against CPU seconds of training; further seeds dashed."""
    for run in runs_on(report):
        name, seed = title(run).split(", seed ")
        x = [point["seconds"] for point in run["curve"]]
        y = [100 * point["errors"]["novel"][field]["median"] for point in run["curve"]]
        style = "-" if seed == "0" else "--"
        label = name if seed == "0" else None
        axis.loglog(x, y, style, color=COLOURS[name], label=label, marker=".")
    linear = dict(answerers(report, "novel")).get("linear answer")
    if linear:
        error = 100 * linear["all"][key(field)]["median"]
        axis.axhline(error, color="k", linestyle=":", label="linear answer")
    axis.set_xlabel("CPU s of training, one thread")
    axis.legend(fontsize=7)


def cost(report: dict[str, Any], field: int, axis: Any) -> None:
    """Error against the time of a press, the linear answer's included where it is corrected."""
    typical = times()
    for full, judged in answerers(report, "novel"):
        name = full.split(", seed")[0]
        label = name if full in (name, f"{name}, seed 0") else None
        own = judged.get("seconds") or 0.0
        x = 1e3 * (own + (typical["linear"] if name in ("corrector", "linear answer") else 0.0))
        found = judged["all"][key(field)]
        y = 100 * found["median"]
        up = [[0], [100 * found["p95"] - y]]
        axis.errorbar([x], [y], up, color=COLOURS[name], marker="o", capsize=2, label=label)
    axis.axvline(
        1e3 * typical["truth"], color="grey", linestyle=":", label="finite elements (truth)"
    )
    axis.set(xscale="log", yscale="log", xlabel="ms a press, one thread")
    axis.legend(fontsize=7)


def key(field: int) -> str:
    """Name of a field in a summary."""
    return ("displacement", "stress")[field]
