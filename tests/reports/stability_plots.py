"""The picture of the stability report: stability.svg from what stability.json holds."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
from stability_pages import short

TITLES = {
    "young": "Young's modulus from (Pa)",
    "poisson": "Poisson's ratio from",
    "friction": "friction from",
    "depth": "depth from (share of thickness)",
    "mesh": "mesh",
    "kind": "how it is led",
}
COLOURS = {"solved": "#4c9f70", "wrong or silent": "#b3232c", "refused by name": "#e3b23c"}


def figure(report: dict, path: Path) -> None:
    """Verdicts by answerer and by what was asked."""
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": "stability", "font.size": 8}):
        picture, axes = plt.subplots(2, 4, figsize=(13, 6), layout="constrained")
        parts = {"answerer": report["by answerer"]}
        parts |= {TITLES[name]: report["axes"][name] for name in TITLES}
        parts |= {"scene: time step (s)": report["scenes"].get("time step", {})}
        for (title, counted), axis in zip(parts.items(), axes.flat, strict=True):
            bars(axis, title, counted)
        picture.legend(*axes[0, 0].get_legend_handles_labels(), ncols=3, loc="outside lower center")
        picture.savefig(path, metadata={"Date": None})
        plt.close(picture)


def bars(axis, title: str, counted: dict) -> None:
    """Share of each verdict, class by class, with the number of presses."""
    for place, counts in enumerate(counted.values()):
        total, left = sum(counts.values()), 0.0
        bad = total - counts.get("solved", 0) - counts.get("refused", 0)
        for (label, colour), count in zip(
            COLOURS.items(), [counts.get("solved", 0), bad, counts.get("refused", 0)], strict=True
        ):
            share = 100 * count / total
            axis.barh(place, share, left=left, color=colour, label=label if place == 0 else None)
            left += share
        axis.text(99, place, f"n = {total}", ha="right", va="center", fontsize=6)
    axis.set_yticks(range(len(counted)), [short(name) for name in counted])
    axis.invert_yaxis()
    axis.set(title=title, xlim=(0, 100), xlabel="% of presses")
