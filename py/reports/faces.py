"""Faces of gel pressed by a ball: closed forms, and our finite elements. Lengths are pixels."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter

Array = NDArray[np.float64]
EXTENT = 140
"""Distance up to which a face is given."""
KEPT = Path(__file__).resolve().parents[2] / "target/reports/ball_face.npz"
BALL = 5e-4
"""Radius of the ball that finite elements press (m), an eighth of the gel's thickness."""
DEPTHS = np.arange(0.2, 1.61, 0.2)
"""Of it, in radii."""


def capped(r: Array, radius: float, contact: float) -> Array:
    """Slope of a ball's cap in a face that is flat outside contact."""
    inside = r / np.sqrt(np.maximum(radius**2 - r**2, 1e-9))
    return np.where(r < contact, inside, 0.0)


def hertz(r: Array, radius: float, contact: float) -> Array:
    """The same with the face of an elastic half space outside.

    There u(r) falls by (2/πR) (r asin(a/r) − √(r² − a²) a/r) a unit of length, scaled to meet the
    cap's slope at the edge (Johnson 1985, §3.5 and §4.2).
    """
    a = contact
    ratio = np.minimum(a / np.maximum(r, 1e-9), 1.0)
    fall = 2 / (np.pi * a) * (r * np.arcsin(ratio) - a * np.sqrt(1 - ratio**2))
    edge = a / np.sqrt(max(radius**2 - a**2, 1e-9))
    return np.where(r < a, capped(r, radius, np.inf), edge * fall)


def blurred(
    face: Callable[[Array], Array], deviation: float, slope: bool = True
) -> Callable[[Array], Array]:
    """Slope of a face of revolution after a Gaussian; the face is its slope or its height."""
    y, x = np.mgrid[-EXTENT : EXTENT + 1, -EXTENT : EXTENT + 1]
    r = np.hypot(x, y)
    fine = np.linspace(0, EXTENT * 1.5, 2101)
    if slope:
        steps = face(fine)
        heights = np.concatenate([[0], np.cumsum((steps[1:] + steps[:-1]) / 2 * np.diff(fine))])
    else:
        heights = face(fine)
    height = np.interp(r, fine, heights)
    line = np.gradient(gaussian_filter(height, deviation))[1][EXTENT, EXTENT:]
    line[-1] = 0
    away = np.arange(EXTENT + 1.0)
    return lambda distance: np.interp(distance, away, line)


@cache
def _solved() -> tuple[Array, Array, Array]:
    """Places of nodes of the face (V, 3) and their motions at each depth (N, V, 3), in radii.

    Kept in a file under `target/reports`, since it takes a minute.
    """
    if not KEPT.exists():
        KEPT.parent.mkdir(parents=True, exist_ok=True)
        place, moved = _press()
        np.savez(KEPT, place=place, moved=moved)
    with np.load(KEPT) as file:
        return _profiles(file["place"] / BALL, file["moved"] / BALL)


def _press() -> tuple[Array, Array]:
    """Nodes (V, 3) and their motions at each depth (N, V, 3), in m."""
    from ruffini import Fem, Press, Shape, sensor

    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    around = BALL * np.vstack([[[0, 0, 0]], 0.5 * ring, ring])
    gel = sensor("gelsight-mini", resolution=1500, around=around)
    path = [([0, 0, BALL * (1 - depth)], (0, 0, 0, 1)) for depth in DEPTHS]
    # Adhering, as on skin that is not greased.
    answers = Fem(gel, friction=1.0, element="p2").solve_path(Press(Shape.sphere(BALL), path))
    return gel.mesh.vertices, np.array([answer.displacement for answer in answers])


def _profiles(place: Array, motions: Array) -> tuple[Array, Array, Array]:
    """Distances (D,), depths (N,) and heights of the face (N, D), all in radii."""
    # The apex is at the origin; the face falls off with its radii across and along.
    across, along = 0.133 / BALL, 0.21 / BALL
    crown = -(place[:, 0] ** 2) / (2 * across) - place[:, 1] ** 2 / (2 * along)
    top = (place[:, 2] > crown - 0.04) & (np.hypot(place[:, 0], place[:, 1]) < 16)
    distances, heights = np.linspace(0, 8, 801), []
    edges = np.concatenate([np.arange(0, 1.6, 0.06), np.arange(1.6, 3, 0.15), np.arange(3, 9, 0.5)])
    for depth, motion in zip(DEPTHS, motions, strict=True):
        moved, z = (place + motion)[top], motion[top, 2]
        r = np.hypot(moved[:, 0], moved[:, 1])
        groups = [np.digitize(r, edges) == n for n in range(1, len(edges))]
        means = [(r[group].mean(), z[group].mean()) for group in groups if group.any()]
        line = np.array([(0, -depth), *(mean for mean in means if mean[0] > 0.03)])
        line[:, 1] = np.maximum.accumulate(line[:, 1])
        heights.append(PchipInterpolator(*line.T)(np.minimum(distances, line[-1, 0])))
    return distances, DEPTHS, np.array(heights)


def ball_faces(radius: float) -> list[Callable[[Array], Array]]:
    """Heights of the face under a ball of that radius, by depth in steps of a tenth of it."""
    distances, depths, heights = _solved()
    steps = np.arange(0.4, depths[-1] + 1e-9, 0.1)
    between = np.array([np.interp(steps, depths, column) for column in heights.T]).T
    return [lambda r, row=row: radius * np.interp(r / radius, distances, row) for row in between]
