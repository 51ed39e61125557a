"""Meshes of boxes, and what presses them, for tests."""

from __future__ import annotations

import itertools

import numpy as np

import ruffini
from ruffini import Shape

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
DOWN = (1.0, 0.0, 0.0, 0.0)
"""Turned by half a turn about x."""
RADIUS = 4e-3
BALL = Shape.sphere(RADIUS)


def ball_at(x: float, depth: float):
    """Pose of the ball pressed `depth` deep into a face at z = 0."""
    return (x, 0.0, RADIUS - depth), UPRIGHT


PLATE = Shape.half_space()


def plate_at(depth: float):
    """Pose of a plate that faces down, pressed `depth` deep; the block is 4 mm thick."""
    return (0.0, 0.0, -depth), DOWN


def box(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> ruffini.TetMesh:
    """A box cut by coordinate planes, each cell into six tetrahedra round a diagonal (Kuhn),
    mirrored from cell to cell so that no direction is preferred."""
    sizes = np.array([len(x), len(y), len(z)])
    vertices = np.stack(np.meshgrid(x, y, z, indexing="ij"), -1).reshape(-1, 3)
    cells = np.stack(np.meshgrid(*(np.arange(n - 1) for n in sizes), indexing="ij"), -1)
    cells = cells.reshape(-1, 1, 3)
    ways = np.array([np.eye(3, dtype=int)[list(p)] for p in itertools.permutations(range(3))])
    corners = np.concatenate([np.zeros((6, 1, 3), int), ways.cumsum(axis=1)], axis=1)
    tets = []
    for way in corners:
        places = cells + np.where(cells % 2 == 0, way, 1 - way)
        tets.append(np.ravel_multi_index(np.moveaxis(places, -1, 0), sizes))
    return ruffini.TetMesh(vertices, np.concatenate(tets))


def graded(half: float, count: int, ratio: float) -> np.ndarray:
    """`count` + 1 coordinates from -half to half, `ratio` times as dense in the middle."""
    t, c = np.linspace(-1, 1, count + 1), (ratio - 1) / (ratio + 1)
    return half * ((1 - c) * t + c * t * abs(t))


def block(cells: int = 2) -> ruffini.TetMesh:
    """An 8 x 8 x 4 mm block, its upper face at z = 0."""
    side = np.linspace(-4e-3, 4e-3, 2 * cells + 1)
    return box(side, side, np.linspace(-4e-3, 0, cells + 1))


def gel(cells: int = 2, **options) -> ruffini.SoftBody:
    """The block, bonded underneath, of 0.2 MPa."""
    mesh = block(cells)
    base = np.flatnonzero(mesh.vertices[:, 2] < -3.999e-3)
    return ruffini.SoftBody(mesh, **{"young": 2e5, "poisson": 0.45, "fixed": base} | options)


CORNER = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
"""Faces of a tetrahedron."""
SHAPES = {
    "sphere": BALL,
    "cuboid": Shape.cuboid([1e-3, 2e-3, 3e-3]),
    "cylinder": Shape.cylinder(3e-3, 2e-3),
    "capsule": Shape.capsule(2e-3, 2e-3),
    "cone": Shape.cone(3e-3, 2e-3),
    "prism": Shape.prism(6, 3e-3, 2e-3),
    "annulus": Shape.annulus(4e-3, 2e-3, 2e-3),
    "ellipsoid": Shape.ellipsoid((2e-3, 3e-3, 4e-3)),
    "cup": Shape.cup(3e-3, 4e-3, 3e-3, 5e-4),
    "rounded cuboid": Shape.cuboid([1e-3, 2e-3, 3e-3]).rounded(4e-4),
    "rounded cup": Shape.cup(3e-3, 4e-3, 3e-3, 5e-4).rounded(2e-4),
    "star_shaped": Shape.star_shaped([3e-3, 3e-3, 4e-3], [(0.1, [2.0, 0.0, 1.0], 0.5)]),
    "half_space": PLATE,
    "mesh": Shape.mesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * 5e-3, CORNER),
}
