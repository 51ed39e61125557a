"""Pictures of reports, all in one style; a file changes only with its figures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("svg")
from matplotlib import pyplot as plt

BLUE, RED, BROWN, GREEN, LIGHT = "#2b6cb0", "#c53030", "#b7791f", "#2f855a", "#81c784"
COLOURS = {
    "network": RED,
    "linear": BLUE,
    "paper": BROWN,
    "fem": GREEN,
    "surrogate": RED,
    "compliance": BLUE,
    "linear, on cells": BLUE,
    "surrogate-fine": BROWN,
}
"""Of models, by the names that reports give them."""


def readable(axis: Any) -> None:
    """A grid and plain numbers for logarithmic axes that span few decades."""
    axis.grid(alpha=0.3, which="both")
    for numbers in (axis.xaxis, axis.yaxis):
        numbers.set_major_formatter("{x:g}")
        numbers.set_minor_formatter(
            lambda x, _: f"{x:g}" if f"{x:g}".strip("0.")[:1] in ("2", "5") else ""
        )


def save(figure: Callable[[dict[str, Any]], Any], report: dict[str, Any], file: Path) -> None:
    """Draws the figure of a report into a file."""
    # Glyphs as text and a fixed seed, so that the same figures make the same bytes.
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": file.stem, "font.size": 8}):
        picture = figure(report)
        picture.savefig(file, metadata={"Date": None})
        plt.close(picture)
