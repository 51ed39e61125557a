"""The text and the picture of the report on one episode as every model of touch tells it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from kept import made, table

matplotlib.use("svg")
import matplotlib.pyplot as plt

CHANNELS = ("markers", "stress", "traction", "wrench")


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """The rows, and their median errors by object, model and channel."""
    found: dict[str, Any] = {}
    for row in rows:
        for model, told in row.get("models", {}).items():
            errors = {what: float(np.median(values)) for what, values in told["errors"].items()}
            found.setdefault(row["key"].split("/")[1], {})[model] = errors
    return {"medians": found, "rows": rows}


def markdown(report: dict[str, Any]) -> str:
    """The page."""
    sizes = report["sizes"]
    head = ["object", "model", *CHANNELS, "indentation", "model against world"]
    head += ["object apart (µm)", "ms a step", "FEM", "ended by"]
    parts = [
        "# One episode as every model of touch tells it",
        "Relative L² error of each channel, both pads, against finite elements on "
        f"{sizes['nodes of the truth']} nodes in the same steps of the same actions, median / 95th "
        "percentile; of a wrench, its force. *Indentation* is how deep the object stands in the "
        "undeformed faces at that force. A step is judged where the pads bear more than "
        f"{sizes['least force']} N together. *Model against world* is how far the forces of a "
        "model are from those that move the object in the same step, before they are corrected. "
        "Time is the median processor time of a touching step of one environment with all four "
        "channels and `slip`, and so with stress.",
        table(head, [line for row in report["rows"] if "models" in row for line in lines(row)]),
        "![errors along the episode](episode.svg)",
        "## A hold of 60 s",
        "Without load or shaking: what changed between the first second and the last, of channels "
        "relative to their size.",
        table(
            ["object", "model", "markers", "wrench", "object (µm)"],
            [still(row) for row in report["rows"] if "models" not in row],
        ),
        made(report),
    ]
    return "\n\n".join(parts) + "\n"


def lines(row: dict[str, Any]) -> list[list[str]]:
    """A row of the table for each model of an episode."""
    found = []
    for model, told in row["models"].items():
        errors = [spread(told["errors"][what]) for what in (*CHANNELS, "indentation", "world")]
        apart = 1e6 * max(told["object_apart"], default=float("nan"))
        times = [f"{1e3 * told['seconds']:.2f}", f"{1e3 * row['fem']['seconds']:.0f}"]
        name = row["key"].split("/")[1]
        found.append([name, model, *errors, f"{apart:.0f}", *times, told["ended"]])
    return found


def still(row: dict[str, Any]) -> list[str]:
    """A row of the table of holds."""
    changed = [f"{row[channel]:.1e}" for channel in ("markers", "wrench")]
    return [*row["key"].split("/")[1:], *changed, f"{1e6 * row['object']:.3f}"]


def spread(errors: list[float]) -> str:
    """Median and 95th percentile in per cent."""
    if not errors:
        return "–"
    return " / ".join(f"{100 * x:.1f}" for x in np.percentile(errors, [50, 95]))


def figure(report: dict[str, Any], path: Path) -> None:
    """Errors along the episodes, a row an object and a column a channel."""
    episodes = [row for row in report["rows"] if "models" in row]
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": "episode", "font.size": 8}):
        size = (3 * len(CHANNELS), 2.2 * len(episodes))
        picture, axes = plt.subplots(
            len(episodes), len(CHANNELS), figsize=size, layout="constrained", squeeze=False
        )
        for line, row in zip(axes, episodes, strict=True):
            name = row["key"].split("/")[1]
            for axis, channel in zip(line, CHANNELS, strict=True):
                for model, told in row["models"].items():
                    errors = [100 * error for error in told["errors"][channel]]
                    axis.plot(told["steps"], errors, label=model, lw=1.2)
                if channel == "wrench":
                    axis.set_yscale("log")
                else:
                    axis.set_ylim(bottom=0)
                axis.set(title=f"{name}: {channel}", xlabel="control step", ylabel="error (%)")
                axis.grid(alpha=0.3)
        axes[0][0].legend(fontsize=7)
        picture.savefig(path, metadata={"Date": None})
        plt.close(picture)
