"""Distributions of depth, force, shear and stress in a dataset, by family of objects."""

from __future__ import annotations

import re
import textwrap
from collections import Counter, defaultdict
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ruffini._plot import check
from ruffini._spaces import writing
from ruffini._words import counted

if TYPE_CHECKING:
    from ruffini.dataset import Dataset

_Columns = dict[str, NDArray[np.float64]]

QUANTITIES = {
    "depth": "closing of a pad over its thickness, of a finger over half the width",
    "force": "force (N)",
    "shear": "tangential over normal force",
    "stress": "peak von Mises stress (kPa)",
}
"""Labels of the plotted quantities; shear and stress are the larger of both sides'."""
_DEEPEST = "deepest displacement of the pad over its thickness"
"""Label of the depth of presses, whose force is the normal one."""


def by_family(data: Dataset) -> dict[str, _Columns]:
    """`QUANTITIES` of all frames (F,), by family in the order of the catalogue."""
    parts: dict[str, list[_Columns]] = defaultdict(list)
    for name in data.grasps:
        parts[family(name)].append(_of_grasp(data, name))
    return {
        name: {key: np.concatenate([part[key] for part in grasps]) for key in QUANTITIES}
        for name, grasps in parts.items()
    }


def family(grasp: str) -> str:
    """Family of the object in a grasp's name: ``hollow-lemon`` of ``hollow-lemon-1/003``."""
    return grasp.split("/")[0].rsplit("-", 1)[0]


def reasons(data: Dataset) -> Counter[str]:
    """Number of grasps that ended early, by their error message without its numbers."""
    unsolved = data.manifest["unsolved"]
    return Counter(re.sub(r"\d+(\.\d+)?(e[-+]?\d+)?", "#", grasp["error"]) for grasp in unsolved)


def _of_grasp(data: Dataset, name: str) -> _Columns:
    sides = ("first",) if data.presses else ("first", "second")
    wrenches = [data.column(name, f"{side}.wrench") for side in sides]
    parts = ("body",) if data.soft else sides
    stresses = [data.column(name, f"{part}.von_mises") for part in parts]
    if data.presses:
        # An indenter that rolls on has no closing.
        closing = -data.column(name, "first.displacement")[:, :, 2].min(axis=1)
        force = np.abs(wrenches[0][:, 2])
    else:
        closing, force = data.column(name, "closing"), data.column(name, "force")
    return {
        "depth": closing / _thickness(data, name),
        "force": force,
        "shear": np.max([_shear(wrench) for wrench in wrenches], axis=0),
        "stress": 1e-3 * np.max([stress.max(axis=1) for stress in stresses], axis=0),
    }


def _thickness(data: Dataset, name: str) -> float:
    """Thickness of a pad, or half the width of a soft object where it is grasped (m)."""
    if data.soft:
        return 0.5 * float(data.plan(name)["width"])
    return float(np.ptp(data.mesh(name).vertices[:, 2]))


def _shear(wrench: NDArray[np.float64]) -> NDArray[np.float64]:
    """Ratio of tangential to normal force (F,) of wrenches (F, 6); 0 without contact."""
    tangential, normal = np.hypot(wrench[:, 0], wrench[:, 1]), np.abs(wrench[:, 2])
    return np.divide(tangential, normal, out=np.zeros_like(normal), where=normal > 0)


def draw(data: Dataset, path: str | PathLike[str]) -> None:
    """Draw the quantities by family, and the reasons of unsolved grasps, to a .png or .svg file.

    Raises:
        ValueError: If no grasp is solved, the file has another ending or cannot be written, or
            matplotlib is missing.
    """
    check(path)
    from matplotlib.figure import Figure

    columns = by_family(data)
    if not columns:
        raise ValueError(f"{data.path}: found no solved grasp, expected one or more")
    height = 1.6 + 0.24 * len(columns)
    figure = Figure(figsize=(11, 2 * height), layout="constrained")
    grid = figure.add_gridspec(3, 2, height_ratios=[height, height, 0.9])
    for place, (key, label) in enumerate(QUANTITIES.items()):
        axes = figure.add_subplot(grid[divmod(place, 2)])
        label = _DEEPEST if data.presses and key == "depth" else label
        _boxes(axes, {name: of[key] for name, of in columns.items()}, label)
    _unsolved(figure.add_subplot(grid[2, :]), data)
    what = "presses" if data.presses else "grasps"
    figure.suptitle(f"{counted(len(data), 'frame')}, {what}: {len(data.grasps)}")
    with writing(Path(path)):
        figure.savefig(path, dpi=130)


def _boxes(axes: Any, values: dict[str, NDArray[np.float64]], label: str) -> None:
    """Draw box plots with whiskers at the 1st and 99th percentile, one family below another."""
    labels = [f"{name} ({len(of)})" for name, of in values.items()]
    axes.boxplot(
        list(values.values()),
        orientation="horizontal",
        tick_labels=labels,
        whis=(1, 99),
        widths=0.6,
        flierprops={"markersize": 2, "markeredgecolor": "0.5"},
        medianprops={"color": "C1"},
    )
    axes.invert_yaxis()
    axes.set_xlabel(label)
    axes.set_xlim(left=0)
    axes.grid(axis="x", alpha=0.3)


def _unsolved(axes: Any, data: Dataset) -> None:
    asked = len(data.grasps) + sum(grasp["frames"] == 0 for grasp in data.manifest["unsolved"])
    counts = reasons(data).most_common() or [("ended early", 0)]
    names = [textwrap.shorten(reason, 60) for reason, _ in counts]
    bars = axes.barh(names, [100 * count / asked for _, count in counts], color="C3")
    axes.bar_label(bars, [f"{count} of {asked}" for _, count in counts], padding=3)
    axes.invert_yaxis()
    axes.set_xlim(0, max(1.0, 120 * counts[0][1] / asked))
    axes.set_xlabel("those that ended before their last frame (%)")
