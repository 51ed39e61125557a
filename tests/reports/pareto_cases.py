"""The presses of the report on error against run time, in panels, and how an answer is judged.

Every answer is carried to the model mesh of 1,000 nodes (V, T) and compared there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pareto_answerers import Gel

import ruffini
from ruffini import Deformation, PaperAnswer, Press, Shape, Transfer
from ruffini.dataset import Dataset

DATA = Path.home() / ".cache/ruffini/grasps-63x10x10"
MINI = Gel("gelsight-mini", 3e5, 0.47, 0.8)
SHAPES = [("ball", size) for size in (4, 2, 3, 6, 8, 10)] + [("block", 4), ("block", 5)]
"""What is pressed straight down, and its size (mm)."""
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
MODEL_NODES = 1000
STILL = 1e-9
"""Displacement under which a press counts as none (m)."""


@dataclass(frozen=True)
class Case:
    """A shape led along a path into a gel."""

    panel: str
    name: str
    gel: Gel
    shape: Shape
    path: list
    judged: range
    """The frames that count."""
    ball: tuple[float, np.ndarray] | None = None
    """Radius and depths (m), where a ball presses straight down."""

    def press(self) -> Press:
        """What is asked."""
        return Press(self.shape, self.path)


def cases(quick: bool, most: int) -> Iterator[Case]:
    """The presses, at most so many a panel; in the quick form one of each of three panels."""
    few = slice(0, 1 if quick else most)
    if not quick:
        yield from held_out(most)
    half = [1.6e-3, 2.0e-3, 2.4e-3]
    yield from straight("deep", MINI, SHAPES[few], half)
    shallow = [5e-6, 2e-5, 5e-5]
    yield from straight("tiny", MINI, SHAPES[few], shallow)
    usual = [3e-4, 6e-4, 1e-3]
    for name, young, poisson in [] if quick else [("soft", 2e4, 0.45), ("stiff", 5e6, 0.49)]:
        gel = Gel("gelsight-mini", young, poisson, 0.8)
        yield from straight(name, gel, SHAPES[few], usual)
    yield from straight("no contact", MINI, [("ball", 6)], [-1e-3, -1e-4])


def held_out(count: int) -> Iterator[Case]:
    """Grasps of objects of families that the network never saw, one of each object, one pad,
    three of ten frames.
    """
    if not DATA.exists():
        return
    data = Dataset(DATA)
    gels = [
        Gel(g["sensor"], g["young"], g["poisson"], g["friction"])
        for g in data.manifest["config"]["gels"]
    ]
    shapes = {thing.name: thing.shape for thing in ruffini.objects()}
    first: dict[str, str] = {}
    for grasp in sorted(data.splits["novel-14"]["test"]):
        first.setdefault(grasp.split("/")[0], grasp)
    for thing, grasp in list(first.items())[:count]:
        poses = [data[index].pads[0].press for index in data.frames(grasp)[1::4]]
        path = [(pose[:3], pose[3:]) for pose in poses]
        frames = range(len(path))
        yield Case("held-out", grasp, gels[data.gel(grasp)], shapes[thing], path, frames)


def straight(panel: str, gel: Gel, shapes: list, depths: list[float]) -> Iterator[Case]:
    """Balls and blocks of so many mm (radius, half an edge) pressed down beside the middle.

    The way to the first depth is walked in four frames that do not count.
    """
    pad = ruffini.sensor(gel.sensor, resolution=2000).mesh.vertices
    for kind, size in shapes:
        half = 1e-3 * size
        shape = Shape.sphere(half) if kind == "ball" else Shape.cuboid((half, half, half))
        ways = [*np.linspace(0, depths[0], 5)[1:-1], *depths]
        path = [((1e-3, 0.0, pad[:, 2].max() + half - depth), UPRIGHT) for depth in ways]
        judged = range(len(ways) - len(depths), len(ways))
        ball = (half, np.array(ways)) if kind == "ball" and depths[0] > 0 else None
        yield Case(panel, f"{kind} {size} mm", gel, shape, path, judged, ball)


class Fields:
    """An answer on the model mesh: displacement (F, V, 3), stress (F, T), force (F, 3), which is
    not a number where it is not said.
    """

    def __init__(self, displacement: np.ndarray, stress: np.ndarray, force: np.ndarray):
        self.displacement, self.stress, self.force = displacement, stress, force
        self.known: list[bool] | None = None
        """Whether a network says that it knows (F)."""

    @classmethod
    def carried(
        cls, gel: Gel, mesh: ruffini.TetMesh, frames: list[Deformation | PaperAnswer]
    ) -> Fields:
        """Those of an answer on another mesh, or on the model mesh itself."""
        model = ruffini.sensor(gel.sensor, resolution=MODEL_NODES).mesh
        silent = np.full(6, np.nan)
        force = np.array([getattr(frame, "wrench", silent)[:3] for frame in frames])
        moved, stress = [f.displacement for f in frames], [f.von_mises for f in frames]
        if len(mesh.vertices) != len(model.vertices):
            carry = Transfer(mesh, model)
            moved = [carry.interpolate(u) for u in moved]
            stress = [carry.average(s) for s in stress]
        return cls(np.array(moved), np.array(stress), force)

    @classmethod
    def read(cls, path: Path) -> Fields:
        """Those in a file."""
        with np.load(path) as kept:
            return cls(*(kept[name] for name in ("displacement", "stress", "force")))

    def write(self, path: Path) -> None:
        """Keeps them in a file."""
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, displacement=self.displacement, stress=self.stress, force=self.force)

    def errors(self, truth: Fields, frames: range) -> dict[str, list[float]]:
        """Relative errors of the frames that count; absolute ones where the truth is nothing."""
        found: dict[str, list[float]] = {}
        for frame in frames:
            for what, error in self._of(truth, frame).items():
                found.setdefault(what, []).append(error)
        return found

    def _of(self, truth: Fields, frame: int) -> dict[str, float]:
        mine, true = (
            (fields.displacement[frame], fields.stress[frame], fields.force[frame])
            for fields in (self, truth)
        )
        if np.abs(true[0]).max() < STILL:
            return {"still": float(np.abs(mine[0]).max())}
        names = ("displacement", "stress", "force")
        off = {
            name: float(np.linalg.norm(m - t) / np.linalg.norm(t))
            for name, m, t in zip(names, mine, true, strict=True)
            if np.isfinite(m).all()
        }
        off["peak"] = float(abs(mine[1].max() / true[1].max() - 1))
        return off if self.known is None else off | {"known": float(self.known[frame])}
