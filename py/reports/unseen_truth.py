"""Truth of ``tests/reference/presses.py`` against quadratic elements alone, on other presses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import pareto_cases
from engine import quantiles, text
from pareto_cases import FIRST, presses
from ruffini._errors import apart

COUNT = 14
"""Presses; those of `pareto`, whose solutions are taken where they are kept."""
NODES = 2000
"""Vertices of the mesh of quadratic elements."""
PARTS = ("displacement", "stress", "force")
PAGE = """Against quadratic elements alone, on {nodes:,} vertices graded towards the contact, the
truth is off by {errors} in {count} frames of {presses} other presses (median, in brackets the 95th
percentile). Solutions by these elements on half as many vertices are a row of
[pareto.md](pareto.md), from which their own error can be told. Where the truth errs as the labels
of the training data do, the errors of the network here are smaller than they should be: against
these elements they stand in pareto.md, too."""


def judged(number: int, down: tuple[int, ...], kept: Path) -> dict[str, Any]:
    """Errors of the truth of a press, by frame (F, 3); none where either is not solved."""
    case = pareto_cases.unseen(number)
    exact = pareto_cases.true(case, NODES, kept)
    drawn = presses.DrawnPress.draw(number)
    found = presses.truth(drawn.gel, drawn.shape, [drawn.steps[0], *drawn.path], down)
    errors: list[list[float]] = []
    if exact is not None:
        for place, frame in zip(range(len(found["force"])), case.judged, strict=False):
            pairs = (
                (found["displacement"][place], exact.displacement[frame]),
                (found["von_mises"][place], exact.stress[frame]),
                (found["force"][place], exact.force[frame]),
            )
            errors.append([apart(np.asarray(one), np.asarray(other)) for one, other in pairs])
    return {"press": number, "family": drawn.family, "errors": errors}


def numbers() -> range:
    """Numbers of the presses."""
    return range(FIRST, FIRST + COUNT)


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Median and 95th percentile by part, beside the rows."""
    frames = [errors for row in rows for errors in row["errors"]]
    spread = {
        part: quantiles(column)
        for part, column in zip(PARTS, zip(*frames, strict=True), strict=True)
    }
    return {"errors": spread, "frames": len(frames), "rows": rows, "nodes": NODES}


def paragraph(found: dict[str, Any]) -> str:
    """Sentences of the page on it."""
    spread = {
        part: [100 * found["errors"][part][share] for share in ("median", "95 %")] for part in PARTS
    }
    errors = ", ".join(f"{m:.1f} % ({most:.1f}) in {part}" for part, (m, most) in spread.items())
    return text(
        PAGE,
        found,
        errors=errors,
        count=found["frames"],
        presses=sum(bool(row["errors"]) for row in found["rows"]),
    )
