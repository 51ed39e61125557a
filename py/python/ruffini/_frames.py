"""Data of one frame of a dataset.

V vertices and T tetrahedra of the mesh that fields are stored on; SI units. A pose is a position
and a quaternion (x, y, z, w), 7 numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ruffini._core import TetMesh

_Left = dict[str, float]
HOME = np.array([0.0, 0, 0, 0, 0, 0, 1])
"""Pose of what is not moved."""


@dataclass(frozen=True, eq=False)
class Body:
    """A soft body in one frame, in the coordinate frame of its mesh."""

    displacement: NDArray[np.float32]
    """Displacement of the vertices (V, 3) (m)."""
    von_mises: NDArray[np.float32]
    """Von Mises stress in the tetrahedra (T,) (Pa)."""
    contact_force: NDArray[np.float32]
    """Contact forces on the vertices (V, 3) (N)."""
    residual: float
    """Norm of the residual force in the body (N)."""
    iterations: int
    """Newton steps taken, over all load steps."""
    anchors: NDArray[np.float32]
    """Points that stick by friction (A, 2, 3): the point of the undeformed body in its frame, and
    the point to which it sticks in the frame of the rigid shape (m)."""

    def write(
        self, path: str | PathLike[str], mesh: TetMesh, pose: NDArray[np.float64] = HOME
    ) -> None:
        """Write the mesh and the fields at a pose (7,) to a .vtu or .npz file.

        Raises:
            ValueError: If the file has another ending or cannot be written.
        """
        fields: dict[str, NDArray[Any]] = {
            "displacement": turned(pose, self.displacement),
            "contact_force": turned(pose, self.contact_force),
            "von_mises": self.von_mises,
        }
        TetMesh(turned(pose, mesh.vertices) + pose[:3], mesh.tets).write(path, fields)


@dataclass(frozen=True, eq=False)
class Pad(Body):
    """One pad in one frame, in the frame of the pad."""

    wrench: NDArray[np.float64]
    """Force (N) and torque (N m) of the object on the pad (6,)."""
    press: NDArray[np.float64]
    """Pose of the object in the frame of the pad (7,)."""
    pose: NDArray[np.float64]
    """Pose of the pad in the frame of the object at its start (7,)."""


@dataclass(frozen=True, eq=False)
class Finger:
    """One rigid finger in one frame: a box whose face has its normal along z."""

    wrench: NDArray[np.float64]
    """Force (N) and torque (N m) of the object on the finger (6,), in the frame of the finger."""
    pose: NDArray[np.float64]
    """Pose of the middle of its face in the frame of the object at its start (7,)."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One solved frame of a grasp."""

    grasp: str
    """Name of the grasp: object and number."""
    number: int
    """Number of the frame in the grasp, from 0."""
    gel: int
    """Number of the gel; see `Dataset.mesh`."""
    force: float
    """Force with which the pads are pressed together (N)."""
    closing: float
    """Closing of each pad since it touched (m)."""
    residual: float
    """Residual force on the object (N)."""
    object: NDArray[np.float64]
    """Pose of the object relative to its start (7,)."""
    load: NDArray[np.float64]
    """Weight of the object: force (N) and torque about its origin (N m) (6,)."""
    pads: tuple[Pad, Pad]
    """The two pads."""

    def imbalance(self) -> dict[str, float]:
        """Imbalance of forces and torques in the frame.

        Returns:
            ``contact``: magnitude of the sum of a pad's nodal contact forces minus the force of its
            wrench, the larger of both pads (N). ``force`` and ``torque``: magnitudes of the
            resultants of both pads and the weight on the object, which is free and at rest, so that
            they should be zero (N, N m about its origin).
        """
        sums = [pad.contact_force.sum(axis=0, dtype=np.float64) for pad in self.pads]
        off = [total - pad.wrench[:3] for total, pad in zip(sums, self.pads, strict=True)]
        left = _left(self.pads, self.object[:3], self.load)
        return {"contact": float(max(map(np.linalg.norm, off)))} | left

    def write(self, path: str | PathLike[str], mesh: TetMesh) -> list[Path]:
        """Write each pad with its fields, placed around the object's start, to a file of its own.

        Returns:
            The files: ``a-first.vtu`` and ``a-second.vtu`` for the path ``a.vtu``.

        Raises:
            ValueError: If the file is no .vtu or .npz or cannot be written.
        """
        path = Path(path)
        files = [path.with_stem(f"{path.stem}-{side}") for side in ("first", "second")]
        for pad, file in zip(self.pads, files, strict=True):
            pad.write(file, mesh, pad.pose)
        return files


@dataclass(frozen=True, eq=False)
class PressFrame:
    """One solved frame of an indenter's press."""

    grasp: str
    """Name of the press: indenter and number."""
    number: int
    """Number of the frame in the press, from 0."""
    gel: int
    """Number of the gel; see `Dataset.mesh`."""
    pad: Pad
    """The pad. Its anchors are on a mesh of the press's own and are left out."""

    def imbalance(self) -> dict[str, float]:
        """Magnitude of the sum of the nodal contact forces minus the force of the wrench (N)."""
        total = self.pad.contact_force.sum(axis=0, dtype=np.float64)
        return {"contact": float(np.linalg.norm(total - self.pad.wrench[:3]))}

    def write(self, path: str | PathLike[str], mesh: TetMesh) -> list[Path]:
        """Write the pad with its fields to a file.

        Raises:
            ValueError: If the file is no .vtu or .npz or cannot be written.
        """
        self.pad.write(path, mesh)
        return [Path(path)]


@dataclass(frozen=True, eq=False)
class SoftFrame:
    """One solved frame of a soft object's squeeze."""

    grasp: str
    """Name of the grasp: object and number."""
    number: int
    """Number of the frame in the grasp, from 0."""
    gel: int
    """Number of the material and finger in the configuration's ``gels``."""
    force: float
    """Mean force of the fingers along their normals (N)."""
    closing: float
    """Closing of each finger since it touched (m)."""
    motion: NDArray[np.float64]
    """Rigid motion that best fits that of the object's nodes (7,), by singular values."""
    deviation: float
    """Root mean square distance of the nodes from that rigid motion (m)."""
    body: Body
    """The object, in its frame at the start."""
    fingers: tuple[Finger, Finger]
    """The two fingers."""

    def imbalance(self) -> dict[str, float]:
        """Imbalance of forces and torques in the frame.

        Returns:
            ``contact``: magnitude of the sum of the nodal contact forces and the forces on the
            fingers (N). ``force`` and ``torque``: magnitudes of the resultants of the fingers on
            the object, which is free and at rest, so that they should be zero (N, N m about its
            origin).
        """
        total = self.body.contact_force.sum(axis=0, dtype=np.float64)
        fingers = sum(turned(finger.pose, finger.wrench[None, :3])[0] for finger in self.fingers)
        contact = float(np.linalg.norm(total + fingers))
        return {"contact": contact} | _left(self.fingers, np.zeros(3), np.zeros(6))

    def write(self, path: str | PathLike[str], mesh: TetMesh) -> list[Path]:
        """Write the object with its fields to a .vtu or .npz file.

        Returns:
            The file.

        Raises:
            ValueError: If the file has another ending or cannot be written.
        """
        self.body.write(path, mesh)
        return [Path(path)]


def _left(
    sides: tuple[Pad, Pad] | tuple[Finger, Finger],
    place: NDArray[np.float64],
    load: NDArray[np.float64],
) -> _Left:
    """Unbalanced force and torque about a `place` (3,) from both sides' wrenches and a load."""
    # The wrenches act on the sides, the load acts on the object.
    force, torque = -load.reshape(2, 3)
    for side in sides:
        own, turning = turned(side.pose, side.wrench.reshape(2, 3))
        force += own
        torque += turning + np.cross(side.pose[:3] - place, own)
    return {"force": float(np.linalg.norm(force)), "torque": float(np.linalg.norm(torque))}


def turned(pose: ArrayLike, vectors: NDArray[Any]) -> NDArray[np.float64]:
    """Vectors (..., 3) turned by the quaternion of a `pose` (7,), or by a quaternion (4,)."""
    *_, x, y, z, real = np.asarray(pose)
    axis = np.array([x, y, z])
    across = np.cross(axis, vectors)
    rotated: NDArray[np.float64] = vectors + 2 * (real * across + np.cross(axis, across))
    return rotated
