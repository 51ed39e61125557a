"""Pictures of tetrahedral meshes by matplotlib: surfaces, sections, light."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import ruffini

SIDES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
"""Corners of a tetrahedron's four sides, counter-clockwise from outside."""


@dataclass
class Part:
    """Triangles to draw."""

    triangles: np.ndarray
    """Corners (F, 3, 3) in mm."""
    colors: np.ndarray
    """Red, green, blue and opacity (F, 4)."""


def surface(mesh: ruffini.TetMesh) -> np.ndarray:
    """Corners (F, 3) of the sides that belong to one tetrahedron only."""
    sides = mesh.tets[:, SIDES].reshape(-1, 3)
    _, first, count = np.unique(
        np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True
    )
    return sides[first[count == 1]]


def at_nodes(mesh: ruffini.TetMesh, values: np.ndarray) -> np.ndarray:
    """Values (T,) of the tetrahedra averaged at the nodes (V,), by volume."""
    a, b, c, d = np.moveaxis(mesh.vertices[mesh.tets], 1, 0)
    volume = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)
    count = len(mesh.vertices)
    total = np.bincount(mesh.tets.ravel(), np.repeat(volume * values, 4), count)
    return total / np.bincount(mesh.tets.ravel(), np.repeat(volume, 4), count)


def section(mesh: ruffini.TetMesh, places: np.ndarray, values: np.ndarray):
    """What of the mesh lies at y = 0 at rest, as triangles with corners of their own.

    Args:
        mesh: The mesh at rest.
        places: Where its vertices are (V, 3).
        values: Values at the vertices (V,).

    Returns:
        Corners (x, z) of F triangles, one after the other (3 F, 2), and the values there (3 F,).
    """
    height, known = mesh.vertices[:, 1], np.column_stack([places[:, [0, 2]], values])
    above = height > 0
    corners = []
    for tet in mesh.tets[np.ptp(above[mesh.tets].astype(int), axis=1) == 1]:
        cuts = []
        for i, j in combinations(tet, 2):
            if above[i] != above[j]:
                share = height[i] / (height[i] - height[j])
                cuts.append((1 - share) * known[i] + share * known[j])
        x, z = (np.array(cuts)[:, :2] - np.mean(cuts, axis=0)[:2]).T
        first, *rest = (cuts[k] for k in np.argsort(np.arctan2(z, x)))
        for second, third in pairwise(rest):
            corners += [first, second, third]
    found = np.array(corners)
    return found[:, :2], found[:, 2]


def cuboid(half: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Triangles (F, 3, 3) of a box, finely divided for a painter's order by their middles."""
    t = np.linspace(-1, 1, 13)
    triangles = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1, 1):
            corners = np.zeros((12, 12, 4, 3))
            corners[..., axis] = side
            for k, (i, j) in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)]):
                corners[:, :, k, u] = t[i : i + 12, None]
                corners[:, :, k, v] = t[None, j : j + 12]
            flat = corners.reshape(-1, 4, 3)[:, ::side]
            triangles += [flat[:, [0, 1, 2]], flat[:, [0, 2, 3]]]
    return np.concatenate(triangles) * half + centre


def draw(ax, parts: list[Part], azimuth: float, elevation: float, size: np.ndarray) -> None:
    """Draws all parts as one, seen from afar, so that near triangles cover far ones.

    Shown is a box of `size` (mm) round the origin.
    """
    triangles = np.concatenate([part.triangles for part in parts])
    colors = np.concatenate([part.colors for part in parts])
    across = np.cross(*np.moveaxis(np.diff(triangles, axis=1), 1, 0))
    normal = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    eye = direction(azimuth, elevation)
    lit = 0.72 + 0.28 * np.clip(normal @ direction(azimuth + 25, elevation + 35), 0, 1)
    colors = np.column_stack([colors[:, :3] * lit[:, None], colors[:, 3]])
    seen = normal @ eye > 0
    shown = Poly3DCollection(triangles[seen], facecolors=colors[seen], zsort="average")
    shown.set_edgecolor(np.where(colors[seen, 3:] < 1, 0, colors[seen]))
    shown.set_linewidth(0.4)
    ax.add_collection3d(shown)
    x, y, z = ((-half, half) for half in size / 2)
    ax.set(xlim=x, ylim=y, zlim=z)
    ax.set_box_aspect(tuple(size), zoom=1.35)
    ax.set_proj_type("ortho")
    ax.view_init(elevation, azimuth)
    ax.set_axis_off()


def direction(azimuth: float, elevation: float) -> np.ndarray:
    """Unit vector of two angles (degrees)."""
    a, e = np.radians([azimuth, elevation])
    return np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
