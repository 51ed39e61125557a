"""Tetrahedral meshes: volumes, surfaces, fields on another mesh."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

import ruffini

SIDES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
"""Corners of a tetrahedron's four sides, counter-clockwise from outside."""


def volumes(mesh: ruffini.TetMesh, moved: np.ndarray | float = 0.0) -> np.ndarray:
    """Volumes of the tetrahedra (T,), with the vertices moved (V, 3)."""
    a, b, c, d = np.moveaxis((mesh.vertices + moved)[mesh.tets], 1, 0)
    return np.einsum("ti,ti->t", np.cross(b - a, c - a), d - a) / 6


def surface(mesh: ruffini.TetMesh) -> np.ndarray:
    """Corners (F, 3) of the sides that belong to one tetrahedron only."""
    sides = mesh.tets[:, SIDES].reshape(-1, 3)
    _, first, count = np.unique(
        np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True
    )
    return sides[first[count == 1]]


def nodal(mesh: ruffini.TetMesh, values: np.ndarray) -> np.ndarray:
    """Sums of values (T,) of the tetrahedra at the nodes (V,), a quarter to each corner."""
    return np.bincount(mesh.tets.ravel(), np.repeat(values / 4, 4), len(mesh.vertices))


def at_nodes(mesh: ruffini.TetMesh, values: np.ndarray) -> np.ndarray:
    """Values (T,) of the tetrahedra averaged at the nodes (V,), by volume."""
    return nodal(mesh, volumes(mesh) * values) / nodal(mesh, volumes(mesh))


def carried(
    answers: Iterable[Any], mesh: ruffini.TetMesh, to: ruffini.TetMesh
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Displacement (V, 3) and von Mises stress (T,) of answers on another mesh, or their own."""
    fields = [(answer.displacement, answer.von_mises) for answer in answers]
    if len(mesh.vertices) == len(to.vertices):
        return fields
    transfer = ruffini.Transfer(mesh, to)
    return [(transfer.interpolate(moved), transfer.average(stress)) for moved, stress in fields]


def difference(found: np.ndarray, truth: np.ndarray, weights: np.ndarray | float = 1.0) -> float:
    """Weighted L2 norm of a field's error over that of the field; both are (N, ...)."""
    norm = [np.sum(weights * np.sum(x.reshape(len(x), -1) ** 2, 1)) for x in (found - truth, truth)]
    return float(np.sqrt(norm[0] / norm[1]))
