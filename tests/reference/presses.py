"""Presses whose truth is known with its error, by indenters of families no network was taught.

Use::

    python tests/reference/presses.py --count 200     # those that are missing; hours
    python tests/reference/presses.py --table         # how well the truth is known

Press n is drawn from n alone: family of the indenter, size of its smallest feature, direction,
place, gel, friction, depth, and how it moves on once it is down. One that would press with less
than 0.004 E t² (0.02 N on the GelSight Mini; E Young's modulus, t thickness) is drawn anew.

Displacement and force are those of linear elasticity with finely resolved contact
(``LinearPad(contact="fine")``), plus what the nonlinear law changes of quadratic finite elements on
one mesh. Most of the error of a mesh is the same by both laws, so that their difference on 900
nodes is as good as a solution on many more. Stress is that of quadratic elements on 1,500 nodes.
The error of the first is estimated by the difference on 500 nodes, that of the stress by elements
on 900. Meshes are graded towards where the undeformed face lies inside the indenter. Fields are
those on the pad's mesh of 1,000 nodes, on which the networks answer. A stopped run continues with
the first missing press.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tomllib
from indenters import FAMILIES, Surface
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import ruffini
from ruffini import Fem, LinearPad, Press, PressError, Shape, SoftBody

HERE = Path(__file__).resolve().parent / "presses"
ROOT = Path(__file__).resolve().parents[2]
SEED = 20261123
PAIRS, FINE = (500, 900), 1500
"""Nodes of the meshes on which the laws are compared, and of that for the stress, without those in
the middle of edges."""
MODEL_NODES = 1000
LEAST_FORCE = 0.004
"""Force at the full depth, of Young's modulus times thickness squared."""
SENSOR = "gelsight-mini"
FRAMES = (0.25, 0.5, 0.75, 1.0, 1.0, 1.0)
"""Share of the depth in each frame; in the last two it moves sideways, turns and rolls."""
JUDGED = (1, 3, 5)
STEPS = 4
"""Load steps from one frame to the next. Under a blade with friction 0.8, the displacement by one
step is 10 % off that by twelve, by four steps 0.6 %."""
OUTLINE = tomllib.loads((ROOT / f"env-core/assets/sensors/{SENSOR}.toml").read_text())["outline"]


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
    steps: list[tuple[NDArray[np.float64], NDArray[np.float64]]]
    """Poses after each load step: places (3,) in m and orientations (4,), xyzw."""

    @property
    def path(self) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Poses of the frames."""
        return self.steps[STEPS - 1 :: STEPS]

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

    def body(
        self, nodes: int, around: NDArray[np.float64] | None = None, law: str = "neo-hookean"
    ) -> SoftBody:
        """The pad of its gel."""
        pad = ruffini.sensor(SENSOR, resolution=nodes, around=around)
        return SoftBody(pad.mesh, self.young, self.poisson, law, pad.fixed)

    def presses(self) -> bool:
        """Returns whether the force at full depth, by linear elements, is more than the least."""
        body = self.body(PAIRS[-1], contact_guess(self))
        down = Press(Shape.mesh(*self.surface), self.path[:4])
        last = Fem(body, friction=self.friction).solve_path(down)[-1]
        least = LEAST_FORCE * self.young * OUTLINE["thickness"] ** 2
        return not isinstance(last, PressError) and bool(np.linalg.norm(last.wrench[:3]) > least)

    def press(self, frames: int = len(FRAMES)) -> Press:
        """Press of the first frames, each reached in `STEPS` load steps."""
        return Press(Shape.mesh(*self.surface), self.steps[: STEPS * frames])


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
    """Distance by which the shape has to be lowered from `pose` to touch the face (m)."""
    places = np.vstack([face(2e-4), [*spot, height(*spot)]])
    place, turn = pose[0], Rotation.from_quat(pose[1])
    near = places
    low, high = -5e-3, 5e-3
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
) -> list[tuple[NDArray, NDArray]]:
    """Leads the lowest vertex down over `spot`, then by `aside` and `last` about its place."""
    placed = turn.apply(vertices)
    lowest = placed[placed[:, 2].argmin()]
    touch = np.array([*spot, height(*spot)])
    start = touch - lowest
    start[2] -= first_touch(shape, (start, turn.as_quat()), spot)
    path = []
    for step in range(1, STEPS * len(FRAMES) + 1):
        share, more = min(step / STEPS / 4, 1), max(step / STEPS - 4, 0) / 2
        part = Rotation.from_rotvec(more * last.as_rotvec())
        place = touch + part.apply(start - touch) + [*(more * aside), -share * depth]
        path.append((place, (part * turn).as_quat()))
    return path


def contact_guess(case: DrawnPress) -> NDArray[np.float64]:
    """Places on the face that the indenter would cover if the gel deformed nowhere else (K, 3)."""
    places, shape, found = face(1e-4), Shape.mesh(*case.surface), []
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


Fields = list[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]]
"""Displacement, von Mises stress and force of some frames."""


def elements(case: DrawnPress, nodes: int, law: str, frames: Sequence[int]) -> Fields:
    """Answer of quadratic elements on so many nodes to some of the frames.

    Raises:
        PressError: If they do not solve the press.
    """
    model = ruffini.sensor(SENSOR, resolution=MODEL_NODES).mesh
    body = case.body(nodes, contact_guess(case), law)
    fem = Fem(body, friction=case.friction, element="p2")
    answers = checked(fem.solve_path(case.press(max(frames) + 1)))
    chosen = [answers[frame] for frame in frames]
    return [(*fem.carry(frame.history, model), frame.wrench[:3]) for frame in chosen]


def checked(answers: list) -> list:
    """Those of the load steps that end a frame.

    Raises:
        PressError: If one is an error.
    """
    if isinstance(answers[-1], PressError):
        raise answers[-1]
    return answers[STEPS - 1 :: STEPS]


def solve(case: DrawnPress, frames: Sequence[int] = JUDGED) -> dict[str, NDArray]:
    """Truth of some of the frames, its error, that of finite elements alone, and what it cost.

    Raises:
        PressError: If a model does not solve the press.
    """
    start = time.process_time()
    gel = {name: getattr(case, name) for name in ("young", "poisson", "friction")}
    pad = LinearPad(SENSOR, **gel, resolution=MODEL_NODES, contact="fine")
    linear = checked(pad.solve_path(case.press(max(frames) + 1)))
    truths, solved = [], []
    for nodes in PAIRS:
        laws = [elements(case, nodes, law, frames) for law in ("neo-hookean", "linear")]
        solved.append(laws[0])
        changes = zip(*laws, [linear[frame] for frame in frames], strict=True)
        truths.append(
            [(c.displacement + a[0] - b[0], c.wrench[:3] + a[2] - b[2]) for a, b, c in changes]
        )
    fine = elements(case, FINE, "neo-hookean", frames)
    (coarse, truth), stresses = truths, [[frame[1] for frame in of] for of in (solved[-1], fine)]

    def between(one: Sequence, other: Sequence) -> list[float]:
        return [apart(a, b) for a, b in zip(one, other, strict=True)]

    displacements, forces = (
        [[frame[part] for frame in of] for of in (coarse, truth)] for part in (0, 1)
    )
    alone = [[frame[part] for frame in fine] for part in (0, 2)]
    return {
        "displacement": np.array(displacements[1], dtype=np.float32),
        "von_mises": np.array(stresses[1], dtype=np.float32),
        "force": np.array(forces[1]),
        "error": np.array([between(*of) for of in (displacements, stresses, forces)]),
        "elements": np.array([between(alone[0], displacements[1]), between(alone[1], forces[1])]),
        "cpu_seconds": np.array(time.process_time() - start),
    }


def apart(one: NDArray, other: NDArray) -> float:
    """Distance of a field from another, relative to that one."""
    return float(np.linalg.norm(one - other) / max(np.linalg.norm(other), 1e-300))


def make(number: int) -> str:
    """Solves a press and writes its file; returns a line about it."""
    case = DrawnPress.draw(number)
    about = f"{number:3d} {case.family:9s} {1e3 * case.feature:5.2f} mm"
    about += f" {1e6 * case.depth:6.0f} µm"
    try:
        found = solve(case)
    except PressError as error:
        (HERE / f"{number:03d}.txt").write_text(f"{error}\n")
        return f"{about}: {error}"
    np.savez_compressed(HERE / f"{number:03d}.npz", **found)
    force = np.linalg.norm(found["force"][-1])
    off = ", ".join(f"{100 * part.max():.1f} %" for part in found["error"])
    return f"{about} {force:7.3f} N: {off} apart, {found['cpu_seconds'].sum():.0f} CPU s"


def table() -> None:
    """Prints the errors of the truth, u, stress and force, by size of feature."""
    kept = {int(file.stem): np.load(file)["error"] for file in sorted(HERE.glob("*.npz"))}
    features = {number: 1e3 * DrawnPress.draw(number).feature for number in kept}
    for low, high in ((0.5, 2), (2, 5), (5, 10), (0.5, 10)):
        chosen = [e for number, e in kept.items() if low <= features[number] < high]
        if not chosen:
            continue
        errors = 100 * np.concatenate(chosen, axis=1)
        parts = [f"{np.median(e):.2f} / {np.percentile(e, 95):.2f} %" for e in errors]
        print(f"{low} to {high} mm, {len(chosen)} presses: {', '.join(parts)} (median / 95 %)")
    print(f"unsolved: {[int(file.stem) for file in sorted(HERE.glob('*.txt'))]}")


def main() -> None:
    """Solves what has no file yet, or prints how well it is known."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=200, help="presses in all")
    parser.add_argument("--threads", type=int, default=2, help="presses solved at a time")
    parser.add_argument("--table", action="store_true", help="solve nothing")
    arguments = parser.parse_args()
    if arguments.table:
        table()
        return
    HERE.mkdir(exist_ok=True)
    done = {int(file.stem) for file in HERE.iterdir() if file.suffix in (".npz", ".txt")}
    missing = [number for number in range(arguments.count) if number not in done]
    with ProcessPoolExecutor(arguments.threads) as pool:
        for line in pool.map(make, missing):
            print(line, flush=True)


if __name__ == "__main__":
    main()
