"""The picture of the datasets' report: dataset.svg from what dataset.json holds."""

from __future__ import annotations

from pathlib import Path

import matplotlib
from dataset_pages import ERRORS, costs

matplotlib.use("svg")
import matplotlib.pyplot as plt
from matplotlib.ticker import NullFormatter


def figure(report: dict, path: Path) -> None:
    """Time of 1,000 frames by threads, and error against cost by mesh."""
    # Glyphs as text and a fixed seed: the file changes only with the figures.
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": "dataset", "font.size": 8}):
        picture, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
        cost_plot(report, left)
        right.set_visible(bool(report["truth"]))
        if report["truth"]:
            truth_plot(report, right)
        for axis in (left, right):
            axis.grid(alpha=0.3)
        picture.savefig(path, metadata={"Date": None})
        plt.close(picture)


def cost_plot(report: dict, axis) -> None:
    """Wall and CPU minutes of 1,000 frames by number of threads, a colour to a mesh."""
    rows = costs(report)
    for colour, mesh in enumerate(sorted({(row["truth"], row["model"]) for row in rows})):
        own = [row for row in rows if (row["truth"], row["model"]) == mesh]
        threads = [row["threads"] for row in own]
        for time, style in {"wall": "-", "cpu": ":"}.items():
            minutes = [row[time] / 60 * 1000 / row["frames"] for row in own]
            label = f"{mesh[0]} / {mesh[1]} nodes" if time == "wall" else None
            axis.plot(threads, minutes, style, marker=".", color=f"C{colour}", label=label)
    axis.set(title="1,000 frames", xlabel="threads", ylabel="minutes", yscale="log")
    axis.set_xticks(sorted({row["threads"] for row in rows}))
    axis.legend(title="CPU dotted")


def truth_plot(report: dict, axis) -> None:
    """Median error of each field against CPU seconds a frame, meshes named."""
    points = []
    for mesh, of in report["truth"].items():
        medians = {key: 100 * of[key]["median"] for key in ERRORS}
        points.append((of["cpu"], medians, mesh.replace(" ", "\n")))
    points.sort(key=lambda point: point[0])
    for key, name in ERRORS.items():
        line = [(cpu, medians[key]) for cpu, medians, _ in points]
        axis.loglog(*zip(*line, strict=True), "o", label=name)
    for cpu, medians, name in points:
        axis.annotate(name, (cpu, max(medians.values())), fontsize=7)
    element, nodes = report["sizes"]["finest"]
    title = f"median difference to {element} on {nodes} nodes"
    axis.set(title=title, xlabel="CPU s a frame", ylabel="%")
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.legend()
