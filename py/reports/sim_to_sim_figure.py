"""Figure of `sim_to_sim`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from engine import COLOURS, plt
from sim_to_sim_cases import UNSOLVED

WON = {
    "won with both": ("o", COLOURS["fem"]),
    "won with the network alone": ("v", COLOURS["surrogate"]),
    "won with finite elements alone": ("^", COLOURS["linear"]),
    "won with neither": ("x", "black"),
    "a press not solved": ("s", COLOURS["paper"]),
}
"""Marker and colour of a seed, by its outcome."""
LEGEND: dict[str, Any] = {"ncols": len(WON), "loc": "outside lower center"}


def figure(report: dict[str, Any]):
    """Differences with their intervals, and the returns of each seed with both models."""
    policies = report["policies"]
    lines = math.ceil(len(policies) / 3)
    heights = [0.8 + 0.2 * len(policies), 2.7 * lines]
    picture = plt.figure(figsize=(10, sum(heights) + 0.4), layout="constrained")
    upper, lower = picture.subfigures(2, 1, height_ratios=heights)
    differ = upper.subplots(1, 2, sharey=True)
    for axis, of, times, unit in zip(
        differ, ("success", "return"), (100, 1), (" (points)", ""), strict=True
    ):
        for height, found in enumerate(policies.values()):
            middle, ends = found[of]["difference"], found[of]["interval"]
            axis.plot([times * end for end in ends], [height] * 2, color=COLOURS["fem"], lw=2)
            axis.plot(times * middle, height, "o", color=COLOURS["fem"], ms=5)
        axis.axvline(0, color="black", lw=0.8)
        axis.set(xlabel=f"{of}: finite elements less network{unit}")
        axis.grid(alpha=0.3, axis="x")
    labels = [f"{name} ({found['seeds']} seeds)" for name, found in policies.items()]
    differ[0].set_yticks(range(len(policies)), labels)
    differ[0].set_ylim(len(policies) - 0.5, -0.5)
    axes = lower.subplots(lines, 3, squeeze=False).ravel()
    by_key = {row["key"]: row for row in report["rows"]}
    drawn: dict[str, Any] = {}
    for axis in axes[len(policies) :]:
        axis.set_axis_off()
    for axis, name in zip(axes, policies, strict=False):
        points = [
            pair
            for key in by_key
            if key.startswith(name.replace(" ", "/")) and (pair := returns(key, by_key))
        ]
        for of, (marker, colour) in WON.items():
            at = np.array([pair[1:] for pair in points if pair[0] == of]).T
            if len(at):
                drawn[of] = axis.plot(*at, marker, color=colour, ms=4, label=of, alpha=0.7)[0]
        ends = [min(min(pair[1:]) for pair in points), max(max(pair[1:]) for pair in points)]
        axis.plot(ends, ends, color="black", lw=0.8)
        axis.set(title=name, xlabel="return with the network", ylabel="with finite elements")
        axis.grid(alpha=0.3)
    drawn = {of: drawn[of] for of in WON if of in drawn}
    lower.legend(drawn.values(), list(drawn), **LEGEND)
    return picture


def returns(key: str, rows: dict[str, Any]) -> tuple[str, float, float] | None:
    """Outcome of the seed of a key of finite elements, and the returns with both models."""
    if not key.endswith("/fem") or key.replace("/fem", "/surrogate") not in rows:
        return None
    fem, network = rows[key], rows[key.replace("/fem", "/surrogate")]
    won = {
        (True, True): "won with both",
        (False, True): "won with the network alone",
        (True, False): "won with finite elements alone",
        (False, False): "won with neither",
    }[fem["success"], network["success"]]
    if UNSOLVED in (fem["ending"], network["ending"]):
        won = "a press not solved"
    return won, network["return"], fem["return"]
