"""Presses by indenters of families no network was taught, and the truth about a press.

Press n is drawn from n alone: family of the indenter, size of its smallest feature, direction,
place, gel, friction, depth, and how it moves on once it is down. One that would press with less
than 0.004 E t² (0.02 N on the GelSight Mini; E Young's modulus, t thickness) is drawn anew.

The truth is made as the labels of the training data, on finer meshes: linear elasticity with finely
resolved contact, plus what the nonlinear law changes of quadratic finite elements on one mesh. Most
of the error of a mesh is the same by both laws, so that their difference needs fewer nodes than a
solution. Meshes are graded towards where the undeformed face lies inside the indenter. Fields are
those on the pad's mesh of 1,000 nodes, on which the networks answer.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomllib
from indenters import FAMILIES, Surface
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import ruffini
from ruffini import Fem, Press, PressError, Shape, SoftBody
from ruffini._core import solve_press
from ruffini._errors import apart

ROOT = Path(__file__).resolve().parents[2]
SEED = 20261123
LABELS = ROOT / "tests/reference/indentations.toml"
"""Configuration of the training data, in which meshes have 500 and 3,000 nodes."""
FINER = {"truth_nodes": 900, "truth_linear_nodes": 5000, "truth_across": 14.0}
"""Its nodes, without those in the middle of edges, on which the laws are compared, those of linear
elasticity, and the distances between nodes across what the indenter covers, for the truth."""
LEAST_FORCE = 0.004
"""Force at the full depth, of Young's modulus times thickness squared."""
NODES = 900
"""Nodes of the elements by which that force is judged."""
SENSOR = "gelsight-mini"
FRAMES = (0.25, 0.5, 0.75, 1.0, 1.0, 1.0)
"""Share of the depth in each frame; in the last two it moves sideways, turns and rolls."""
STEPS = 4
"""Load steps from one frame to the next. Under a blade with friction 0.8, the displacement by one
step is 10 % off that by twelve, by four steps 0.6 %."""
OUTLINE = tomllib.loads((ROOT / f"env-core/assets/sensors/{SENSOR}.toml").read_text())["outline"]

Pose = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Place (3,) in m and orientation (4,), xyzw."""
Fields = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Displacement (V, 3) in m, von Mises stress (T,) in Pa and force (3,) in N of a frame."""


@dataclass(frozen=True)
class DrawnPress:
    """One press, as drawn."""

    number: int
    family: str
    feature: float
    """Smallest feature of the indenter (m)."""
    young: float
    poisson: float
    friction: float
    depth: float
    """Distance past first touch (m)."""
    surface: Surface
    steps: list[Pose]
    """Pose of first touch, and that after each load step."""

    @property
    def gel(self) -> dict[str, float]:
        """Young's modulus (Pa), Poisson's ratio and friction."""
        return {"young": self.young, "poisson": self.poisson, "friction": self.friction}

    @property
    def shape(self) -> Shape:
        """The indenter."""
        return Shape.mesh(*self.surface)

    @property
    def path(self) -> list[Pose]:
        """Poses of the frames."""
        return self.steps[STEPS::STEPS]

    @classmethod
    def draw(cls, number: int) -> DrawnPress:
        """The press of that number: the first of its draws that presses hard enough."""
        for attempt in range(1000):
            case = cls._draw(number, np.random.default_rng([SEED, number, attempt]))
            if case is not None and case.presses():
                return case
        raise RuntimeError(f"press {number}: no draw presses hard enough")

    @classmethod
    def _draw(cls, number: int, random: np.random.Generator) -> DrawnPress:
        family = list(FAMILIES)[number % len(FAMILIES)]
        feature = float(np.exp(random.uniform(np.log(0.5e-3), np.log(10e-3))))
        surface = FAMILIES[family](feature, random)
        # One in five gels is as soft as 10 kPa, one in five as stiff as 3 MPa at most.
        kind = random.integers(5)
        span = {0: (1e4, 1e5), 1: (1e6, 3e6)}.get(int(kind), (1.5e5, 6e5))
        young = float(np.exp(random.uniform(*np.log(span))))
        poisson = float(random.choice([0.3, 0.4, 0.45, 0.47, 0.475, 0.49, 0.499]))
        friction = float(random.choice([0, 0.2, 0.4, 0.6, 0.8, 1.0, 2.0]))
        depth = float(np.exp(random.uniform(np.log(5e-6), np.log(2e-3))))
        turn = Rotation.random(random_state=int(random.integers(2**31)))
        spot = random.uniform(-1, 1, 2) * (7e-3, 9e-3)
        aside = random.uniform(-1, 1, 2) * depth
        twist, roll = np.radians(random.uniform(-10, 10)), np.radians(random.uniform(-8, 8, 2))
        if depth < 1e-4:
            twist, roll = 0.1 * twist, 0.1 * roll
        last = Rotation.from_rotvec([*roll, twist])
        steps = poses(Shape.mesh(*surface), surface[0], turn, spot, depth, aside, last)
        return cls(number, family, feature, young, poisson, friction, depth, surface, steps)

    def presses(self) -> bool:
        """Returns whether the force at full depth, by linear elements, is more than the least."""
        pad = ruffini.sensor(SENSOR, resolution=NODES, around=contact_guess(self))
        body = SoftBody(pad.mesh, self.young, self.poisson, fixed=pad.fixed)
        down = Press(self.shape, self.path[:4])
        last = Fem(body, friction=self.friction).solve_path(down)[-1]
        least = LEAST_FORCE * self.young * OUTLINE["thickness"] ** 2
        return not isinstance(last, PressError) and bool(np.linalg.norm(last.wrench[:3]) > least)

    def press(self, frames: int = len(FRAMES)) -> Press:
        """Press of the first frames, each reached in `STEPS` load steps."""
        return Press(self.shape, self.steps[1 : 1 + STEPS * frames])


def height(x: NDArray, y: NDArray) -> NDArray:
    """Height of the face over the apex (m), as the sensor's file describes it."""

    def sagitta(p: NDArray, radius: float) -> NDArray:
        return p**2 / (radius + np.sqrt(np.maximum(radius**2 - p**2, 0)))

    beyond = [
        np.maximum(np.abs(p) - (OUTLINE[extent] / 2 - OUTLINE["rim_width"]), 0)
        for p, extent in ((x, "width"), (y, "length"))
    ]
    over = np.minimum(np.hypot(*beyond), OUTLINE["rim_width"])
    crown = sagitta(x, OUTLINE["radius_across"]) + sagitta(y, OUTLINE["radius_along"])
    return -crown - sagitta(over, OUTLINE["rim_radius"])


def face(spacing: float) -> NDArray[np.float64]:
    """Places on the face, so far apart (P, 3)."""
    halves = [OUTLINE["width"] / 2, OUTLINE["length"] / 2]
    line = [np.linspace(-h, h, int(2 * h / spacing)) for h in halves]
    x, y = (p.reshape(-1) for p in np.meshgrid(*line, indexing="ij"))
    return np.stack([x, y, height(x, y)], axis=-1)


def first_touch(shape: Shape, pose: tuple[NDArray, NDArray], spot: NDArray) -> float:
    """Distance by which the shape has to be lowered from `pose`, where it touches the face over the
    spot, to touch it at all (m); below zero if it has to be raised. Farther down, a small shape
    would have passed."""
    places = np.vstack([face(2e-4), [*spot, height(*spot)]])
    place, turn = pose[0], Rotation.from_quat(pose[1])
    near = places
    low, high = -5e-3, 1e-4
    for step in range(24):
        middle = (low + high) / 2
        inside = turn.inv().apply(near - (place - [0, 0, middle]))
        distance = shape.distance(inside)[0]
        low, high = (low, middle) if distance.min() < 0 else (middle, high)
        if step < 8:
            near = near[distance < distance.min() + 2 * (high - low) + 1e-4]
    return low


def poses(
    shape: Shape,
    vertices: NDArray,
    turn: Rotation,
    spot: NDArray,
    depth: float,
    aside: NDArray,
    last: Rotation,
) -> list[Pose]:
    """Leads the lowest vertex down over `spot`, then by `aside` and `last` about its place."""
    placed = turn.apply(vertices)
    lowest = placed[placed[:, 2].argmin()]
    touch = np.array([*spot, height(*spot)])
    start = touch - lowest
    start[2] -= first_touch(shape, (start, turn.as_quat()), spot)
    path = []
    for step in range(STEPS * len(FRAMES) + 1):
        share, more = min(step / STEPS / 4, 1), max(step / STEPS - 4, 0) / 2
        part = Rotation.from_rotvec(more * last.as_rotvec())
        place = touch + part.apply(start - touch) + [*(more * aside), -share * depth]
        path.append((place, (part * turn).as_quat()))
    return path


def contact_guess(case: DrawnPress) -> NDArray[np.float64]:
    """Places on the face that the indenter would cover if the gel deformed nowhere else (K, 3)."""
    places, shape, found = face(1e-4), case.shape, []
    for place, turn in (case.path[frame] for frame in (3, 5)):
        inside = Rotation.from_quat(turn).inv().apply(places - place)
        distance = shape.distance(inside)[0]
        found.append(places[distance < max(0.0, distance.min() + 0.2 * case.depth)])
    points, apart = np.vstack(found), 1e-4
    # Meshes are refined towards 10,000 points at most.
    while len(points := thinned(points, apart)) > 10_000:
        apart *= 2
    return points


def thinned(points: NDArray, apart: float) -> NDArray[np.float64]:
    """One of the points in each cube of that size."""
    _, first = np.unique(np.floor(points / apart).astype(int), axis=0, return_index=True)
    return points[first]


def at_frames(answers: list) -> list:
    """Those of the load steps that end a frame, and an error."""
    return answers[STEPS - 1 :: STEPS] + [answers[-1]] * (len(answers) % STEPS > 0)


def truth(
    gel: Mapping[str, float], shape: Shape, path: Sequence[Pose], frames: Sequence[int]
) -> dict[str, NDArray]:
    """Fields of some of the frames of a press of the sensor's pad, up to the first not solved.

    Args:
        gel: Its Young's modulus (Pa), Poisson's ratio and friction.
        shape: What presses.
        path: Pose of first touch, and those of the frames.
        frames: Numbers of the frames.

    Returns:
        `displacement` (F, V, 3) in m, `von_mises` (F, T) in Pa and `force` (F, 3) in N; as `error`
        (F, 3) how far those by the meshes of the training data are off; in `ended` why the press
        ended early, if it did, and in `seconds` the processor time.
    """
    begun = time.process_time()
    last = max(frames) + 1
    both = [fields(gel, shape, path[: 1 + last], **sizes) for sizes in (FINER, {})]
    ends = [str(of[-1]) for of in both if isinstance(of[-1], PressError)]
    pairs = [pair for pair in zip(*both, strict=False) if all(isinstance(f, tuple) for f in pair)]
    chosen = [pairs[frame] for frame in frames if frame < len(pairs)]
    found = {
        name: np.array([exact[part] for exact, _ in chosen])
        for part, name in enumerate(("displacement", "von_mises", "force"))
    }
    error = [[apart(*part) for part in zip(label, exact, strict=True)] for exact, label in chosen]
    told = {"error": error, "ended": "; ".join(ends), "seconds": time.process_time() - begun}
    return found | {name: np.array(of) for name, of in told.items()}


def fields(
    gel: Mapping[str, float], shape: Shape, path: Sequence[Pose], **sizes: float
) -> list[Fields | PressError]:
    """Displacement, stress and force of the frames, by meshes of other sizes than the labels'."""
    settings = {"gels": [{"sensor": SENSOR, "share": 1.0, **gel}], **sizes}
    frames = solve_press(LABELS, json.dumps(settings), shape, path)
    return [f if isinstance(f, PressError) else (*f[:2], f[2][:3]) for f in frames]
