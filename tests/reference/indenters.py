"""Rigid indenters of families that no network was taught, as closed triangle meshes.

Each is drawn by a smallest feature in m (radius, width of an edge, a tooth or a wall), and stands
in its own frame: origin in its middle, z along its axis.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Surface = tuple[NDArray[np.float64], NDArray[np.uint32]]
"""Vertices (V, 3) in m and triangles (F, 3)."""
ROUND = 48
"""Segments of a circle."""


def lathe(radii: NDArray, heights: NDArray) -> Surface:
    """A surface about z from radii (Z, A) at heights (Z,), closed by a point at either end."""
    rings, around = radii.shape
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    place = [radii * np.cos(angle), radii * np.sin(angle), np.repeat(heights, around)]
    vertices = np.stack([part.reshape(-1) for part in place], axis=-1)
    ends = [[0, 0, heights[0]], [0, 0, heights[-1]]]
    first, last = rings * around, rings * around + 1
    faces = []
    for a in range(around):
        b = (a + 1) % around
        for z in range(rings - 1):
            low, high = z * around, (z + 1) * around
            faces += [[low + a, low + b, high + b], [low + a, high + b, high + a]]
        top = (rings - 1) * around
        faces += [[first, b, a], [last, top + a, top + b]]
    return np.vstack([vertices, ends]), np.array(faces, dtype=np.uint32)


def extrusion(outline: NDArray, height: float) -> Surface:
    """A prism about z over an outline (A, 2), all of which is seen from the origin."""
    around = len(outline)
    levels = [np.column_stack([outline, np.full(around, z)]) for z in (-height / 2, height / 2)]
    vertices = np.vstack([*levels, [[0, 0, -height / 2], [0, 0, height / 2]]])
    faces = []
    for a in range(around):
        b = (a + 1) % around
        faces += [[a, b, around + b], [a, around + b, around + a]]
        faces += [[2 * around, b, a], [2 * around + 1, around + a, around + b]]
    return vertices, np.array(faces, dtype=np.uint32)


def crystal(feature: float, random: np.random.Generator) -> Surface:
    """A double pyramid of 3 to 8 sides, blunt or sharp."""
    sides, slender = random.integers(3, 9), random.uniform(0.5, 1.5)
    vertices, faces = lathe(np.full((1, sides), feature), np.zeros(1))
    vertices[-2:, 2] = [-slender * feature, slender * feature]
    return vertices, faces


def ring(feature: float, random: np.random.Generator) -> Surface:
    """A torus of that radius of its tube."""
    tube, middle = feature, feature * random.uniform(1.5, 4)
    around, across = 2 * ROUND, ROUND // 2
    u = np.linspace(0, 2 * np.pi, around, endpoint=False)[:, None]
    v = np.linspace(0, 2 * np.pi, across, endpoint=False)[None]
    radius = middle + tube * np.cos(v)
    place = [radius * np.cos(u), radius * np.sin(u), tube * np.sin(v) + 0 * u]
    vertices = np.stack([part.reshape(-1) for part in place], axis=-1)
    faces = []
    for i in range(around):
        for j in range(across):
            a, b = i * across + j, (i + 1) % around * across + j
            c, d = (i + 1) % around * across + (j + 1) % across, i * across + (j + 1) % across
            faces += [[a, b, c], [a, c, d]]
    return vertices, np.array(faces, dtype=np.uint32)


def thread(feature: float, random: np.random.Generator) -> Surface:
    """A threaded rod; the feature is half of its pitch."""
    pitch, core = 2 * feature, feature * random.uniform(2, 5)
    heights = np.linspace(-2.5 * pitch, 2.5 * pitch, 5 * 8 + 1)
    angle = np.linspace(0, 2 * np.pi, ROUND, endpoint=False)
    phase = (heights[:, None] / pitch + angle / (2 * np.pi)) % 1
    return lathe(core + 0.6 * pitch * np.abs(2 * phase - 1), heights)


def gear(feature: float, random: np.random.Generator) -> Surface:
    """A toothed wheel; the feature is the width of a tooth."""
    teeth, width = int(random.integers(6, 15)), feature * random.uniform(1.5, 4)
    middle = feature * teeth / np.pi
    tooth = np.array([[0.0, -1], [0.15, 1], [0.45, 1], [0.6, -1]])
    angle = (np.arange(teeth)[:, None] + tooth[:, 0]) * 2 * np.pi / teeth
    radius = np.broadcast_to(middle + 0.5 * feature * tooth[:, 1], angle.shape)
    outline = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    return extrusion(outline.reshape(-1, 2), width)


def blade(feature: float, random: np.random.Generator) -> Surface:
    """A wedge whose edge is so wide."""
    edge, length = 0.5 * feature, feature * random.uniform(3, 8)
    height, slope = 3 * feature, random.uniform(0.1, 0.6)
    back = edge + slope * height
    outline = np.array([[height / 2, -edge], [height / 2, edge], [-height / 2, back]])
    return extrusion(np.vstack([outline, [[-height / 2, -back]]]), length)


def cross(feature: float, random: np.random.Generator) -> Surface:
    """Two bars across each other, of that width."""
    half, arm = 0.5 * feature, feature * random.uniform(1.2, 2.5)
    quarter = np.array([[arm, -half], [arm, half], [half, half]])
    turn = np.array([[0.0, -1], [1, 0]])
    outline = [quarter]
    for _ in range(3):
        outline.append(outline[-1] @ turn.T)
    return extrusion(np.vstack(outline), feature * random.uniform(1, 3))


def dumbbell(feature: float, random: np.random.Generator) -> Surface:
    """Two balls of that radius with a thinner neck between them."""
    apart = feature * random.uniform(1.1, 1.8)
    neck = feature * random.uniform(0.2, 0.5)
    end = apart + feature
    heights = -end * np.cos(np.linspace(0, np.pi, 2 * ROUND + 1)[1:-1])
    ball = np.sqrt(np.maximum(feature**2 - (np.abs(heights) - apart) ** 2, 0))
    inner = np.abs(heights) < apart
    radius = np.where(inner, np.maximum(ball, neck), ball)
    return lathe(np.repeat(radius[:, None], ROUND, axis=1), heights)


def studs(feature: float, random: np.random.Generator) -> Surface:
    """A plate with round studs of that radius on both sides."""
    pitch, count = feature * random.uniform(2.5, 4), 3
    cells = round(count * pitch / feature * 6)
    line = np.linspace(-count * pitch / 2, count * pitch / 2, cells + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    away = pitch * np.hypot(*((p / pitch + 0.5) % 1 - 0.5 for p in (x, y)))
    top = np.sqrt(np.maximum(feature**2 - away**2, 0))
    base = feature * random.uniform(0.3, 1)
    return _plate(line, base + top)


def _plate(line: NDArray, height: NDArray) -> Surface:
    """A plate with the same heights (N, N) over and under a square grid of lines (N,)."""
    size = len(line)
    x, y = np.meshgrid(line, line, indexing="ij")
    sides = [np.stack([x, y, sign * height], axis=-1).reshape(-1, 3) for sign in (1, -1)]
    number = np.arange(size * size).reshape(size, size)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    top = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    bottom = top[:, ::-1] + size * size
    rim = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
    after = np.roll(rim, -1)
    under = [rim + size * size, after + size * size]
    wall = np.concatenate(
        [np.stack([under[0], under[1], after], 1), np.stack([under[0], after, rim], 1)]
    )
    return np.vstack(sides), np.concatenate([top, bottom, wall]).astype(np.uint32)


FAMILIES = {
    "crystal": crystal,
    "ring": ring,
    "thread": thread,
    "gear": gear,
    "blade": blade,
    "cross": cross,
    "dumbbell": dumbbell,
    "studs": studs,
}
"""By name, from a smallest feature in m and a random generator."""
