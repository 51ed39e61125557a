"""What a dataset holds of one frame.

V vertices and T tetrahedra of the mesh that fields are stored on; SI units. A pose is a position
and a quaternion (x, y, z, w), 7 numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini._core import TetMesh


@dataclass(frozen=True)
class Pad:
    """One pad in one frame, in the frame of the pad."""

    displacement: NDArray[np.float32]
    """Displacement of the vertices (V, 3) (m)."""
    von_mises: NDArray[np.float32]
    """Von Mises stress in the tetrahedra (T,) (Pa)."""
    contact_force: NDArray[np.float32]
    """Forces of the object on the vertices (V, 3) (N)."""
    wrench: NDArray[np.float64]
    """Force (N) and torque (Nm) of the object on the pad (6,)."""
    press: NDArray[np.float64]
    """Pose of the object in the frame of the pad (7,)."""
    pose: NDArray[np.float64]
    """Pose of the pad in the frame of the object at its start (7,)."""
    residual: float
    """Force out of balance in the pad (N)."""

    anchors: NDArray[np.float32]
    """Where friction holds the skin (A, 2, 3): a point of the undeformed pad in its frame, and the
    place on the object that it sticks to, in the frame of the object (m)."""

    def wrench_about(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Force and torque of the object on the pad (6,) about a `place` (3,), in its frame."""
        force, torque = _turned(self.pose, self.wrench.reshape(2, 3))
        return np.concatenate([force, torque + np.cross(self.pose[:3] - place, force)])


@dataclass(frozen=True)
class Frame:
    """One solved frame of a grasp."""

    grasp: str
    """Name of the grasp: object and number."""
    number: int
    """Number of the frame in the grasp, from 0."""
    gel: int
    """Number of the gel, see `Dataset.mesh`."""
    force: float
    """Force with which the pads are pressed together (N)."""
    closing: float
    """Closing of each pad since it touched (m)."""
    residual: float
    """Force on the object out of balance (N)."""
    object: NDArray[np.float64]
    """Pose of the object against that of its start (7,)."""
    pads: tuple[Pad, Pad]
    """The two pads."""

    def imbalance(self) -> dict[str, float]:
        """How far the frame is from balance.

        Returns:
            ``contact``: what the contact forces on the vertices of a pad add up to, less the force
            of its wrench, the larger of the two pads' (N). ``force`` and ``torque`` of both pads on
            the object, which is free and at rest (N, N m about its origin).
        """
        sums = [pad.contact_force.sum(axis=0, dtype=np.float64) for pad in self.pads]
        off = [total - pad.wrench[:3] for total, pad in zip(sums, self.pads, strict=True)]
        wrenches = [pad.wrench_about(self.object[:3]) for pad in self.pads]
        force, torque = np.split(np.sum(wrenches, axis=0), 2)
        return {
            "contact": float(max(map(np.linalg.norm, off))),
            "force": float(np.linalg.norm(force)),
            "torque": float(np.linalg.norm(torque)),
        }

    def write(self, path: str | PathLike[str], mesh: TetMesh) -> list[Path]:
        """Writes each pad with its fields, placed about the object's start, to a file of its own.

        Returns:
            The files: ``a-first.vtu`` and ``a-second.vtu`` for the path ``a.vtu``.

        Raises:
            ValueError: If the file is no .vtu or .npz or cannot be written.
        """
        path = Path(path)
        files = [path.with_stem(f"{path.stem}-{side}") for side in ("first", "second")]
        for pad, file in zip(self.pads, files, strict=True):
            placed = _turned(pad.pose, mesh.vertices) + pad.pose[:3]
            fields: dict[str, NDArray[Any]] = {
                "displacement": _turned(pad.pose, pad.displacement),
                "contact_force": _turned(pad.pose, pad.contact_force),
                "von_mises": pad.von_mises,
            }
            TetMesh(placed, mesh.tets).write(file, fields)
        return files


def _turned(pose: NDArray[np.float64], vectors: NDArray[Any]) -> NDArray[np.float64]:
    """Vectors (N, 3) in the frame at `pose`, as seen from outside."""
    axis, real = pose[3:6], pose[6]
    across = np.cross(axis, vectors)
    turned: NDArray[np.float64] = vectors + 2 * (real * across + np.cross(axis, across))
    return turned
