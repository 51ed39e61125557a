"""Paths of rigid shapes on a GelSight Mini, and what of the answers must not depend on them.

Every case takes the name of a model and returns a row; a press that is not solved gives its error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache, wraps
from itertools import pairwise
from typing import Any, Literal

import numpy as np

import ruffini
from ruffini import Deformation, Fem, LinearPad, Press, PressError, Shape, Surrogate
from ruffini._errors import apart

SENSOR = "gelsight-mini"
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
FACE_RADIUS = 0.133
"""Radius of the sensor's face across, in x (m)."""
ELEMENTS: dict[str, tuple[Literal["p1", "p1-bar", "p2"], int]] = {
    "Fem p1-bar 800": ("p1-bar", 800),
    "Fem p1-bar 1500": ("p1-bar", 1500),
    "Fem p1-bar 2500": ("p1-bar", 2500),
    "Fem p1-bar graded": ("p1-bar", 2500),
    "Fem p1 800": ("p1", 800),
    "Fem p2 900": ("p2", 900),
}
"""Element and nodes that are asked for; the graded mesh is finest under the block's edges."""
FAST = {"LinearPad": LinearPad, "Surrogate": Surrogate}
HALF = np.array([3e-3, 2e-3, 2e-3])
"""Half the edges of the block (m)."""
BESIDE = np.array([1e-3, -1e-3])
"""Place of first contact, from the middle of the pad (m)."""
DEPTH, DRAG = 5e-4, 6e-4
"""Depth of the pressed block, and distance over which it is dragged (m)."""

Row = dict[str, Any]


@cache
def model(name: str, friction: float = 0.0) -> Any:
    """The model of a name."""
    if name in FAST:
        return FAST[name](friction=friction)
    element, nodes = ELEMENTS[name]
    around = under_edges() if "graded" in name else None
    pad = ruffini.sensor(SENSOR, resolution=nodes, around=around)
    return Fem(pad, friction=friction, element=element)


def under_edges() -> np.ndarray:
    """Points of the face where the block's lower edges come to lie (K, 3)."""
    x, y = HALF[:2]
    along = [(a, b) for a in np.linspace(-x, x + DRAG, 12) for b in (-y, y)]
    across = [(a, b) for a in (-x, x, x + DRAG) for b in np.linspace(-y, y, 9)]
    return np.array([(*(BESIDE + point), 0.0) for point in along + across])


def block(radius: float) -> Shape:
    """The block, with its edges rounded."""
    sharp = Shape.cuboid(HALF)
    return sharp.rounded(radius) if radius else sharp


def solved(solver: Any, shape: Shape, places: Iterable[Iterable[float]]) -> list[Deformation]:
    """Answers along a path of an upright shape.

    Raises:
        PressError: If a frame is not solved.
    """
    answers: list[Any] = solver.solve_path(
        Press(shape, [(tuple(place), UPRIGHT) for place in places])
    )
    for answer in answers:
        if isinstance(answer, PressError):
            raise answer
    return answers


def work(answers: list[Deformation], before: tuple[float, ...] | None = None) -> float:
    """Work (J) that moving the shape from frame to frame puts into the gel.

    From where it is without force, at `before`, if that is given.
    """
    states = [(answer.wrench[:3], np.array(answer.pose[0])) for answer in answers]
    if before is not None:
        states.insert(0, (np.zeros(3), np.array(before)))
    return float(sum((f + g) @ (y - x) / 2 for (f, x), (g, y) in pairwise(states)))


def change(found: Deformation, other: Deformation) -> Row:
    """Relative differences of displacement and force."""
    return {
        "displacement": apart(found.displacement, other.displacement),
        "force": apart(found.wrench[:3], other.wrench[:3]),
    }


def case(function: Callable[..., Row]) -> Callable[..., Row]:
    """A case whose row has the number of nodes, or the kind of the error."""

    @wraps(function)
    def row(name: str, *arguments: Any) -> Row:
        try:
            return {"model": name} | function(name, *arguments)
        except PressError as error:
            return {"model": name, "failed": error.kind}

    return row


def nodes(solver: Any) -> int:
    """Nodes of a model's mesh."""
    return len(solver.body.mesh.vertices)


@case
def drag(name: str, radius: float, steps: int) -> Row:
    """The block is pressed down, dragged along x in so many frames, and back in as many."""
    solver, far = model(name), DRAG / steps * np.arange(1, steps + 1)
    aside = np.r_[far, far[-2::-1], 0.0]
    down = [(*BESIDE, HALF[2] - depth) for depth in np.linspace(DEPTH / 5, DEPTH, 5)]
    moved = [(BESIDE[0] + x, BESIDE[1], HALF[2] - DEPTH) for x in aside]
    answers = solved(solver, block(radius), down + moved)
    before, loop = answers[4], answers[4:]
    pressing = work(answers[:5], (*BESIDE, HALF[2]))
    return {
        "nodes": nodes(solver),
        "before": before.wrench[:3].tolist(),
        "after": answers[-1].wrench[:3].tolist(),
        "change": change(answers[-1], before),
        "pressing": pressing,
        "work": work(loop),
        "work of pressing": work(loop) / pressing,
        "x": [0.0, *aside.tolist()],
        "aside": [float(answer.wrench[0]) for answer in loop],
    }


@case
def deeper(name: str, radius: float) -> Row:
    """A ball is pressed at once, and after 0.2 mm more: the largest changes over six depths."""
    solver, ball, changes = model(name), Shape.sphere(radius), []
    for depth in np.arange(3, 9) * 1e-4:
        at, below = ((*BESIDE, radius - down) for down in (depth, depth + 2e-4))
        [straight] = solved(solver, ball, [at])
        changes.append(change(solved(solver, ball, [below, at])[-1], straight))
    largest = {part: max(of[part] for of in changes) for part in changes[0]}
    return {"nodes": nodes(solver), "changes": changes, "largest": largest}


@case
def cycle(name: str, friction: float) -> Row:
    """A ball of 10 mm is pressed to 1 mm and released in frames of 20 µm."""
    solver, radius = model(name, friction), 0.01
    depths = np.arange(1, 51) * 2e-5
    down = [(*BESIDE, radius - depth) for depth in depths]
    answers = solved(solver, Shape.sphere(radius), down + down[-2::-1])
    # From the last frame, 20 µm deep, the shape leaves on the path that led to the first.
    rest = (*BESIDE, radius)
    pressing = work(answers[: len(down)], rest)
    lost = pressing + work(answers[len(down) - 1 :]) - work(answers[-1:], rest)
    return {"nodes": nodes(solver), "pressing": pressing, "lost": lost / pressing}


@case
def ripple(name: str, depth: float) -> Row:
    """A ball of 4 mm is moved over 3 mm of the face, at the same depth below it."""
    solver, radius = model(name), 4e-3
    x = np.linspace(0, 3e-3, 16)
    face = np.sqrt(FACE_RADIUS**2 - x**2) - FACE_RADIUS
    along = [(a, 0.0, radius + z - depth) for a, z in zip(x, face, strict=True)]
    answers = solved(solver, Shape.sphere(radius), [(0.0, 0.0, radius - depth / 2), *along])[1:]
    force = np.array([-answer.wrench[2] for answer in answers])
    return {
        "nodes": nodes(solver),
        "mean": float(force.mean()),
        "peak to peak": float(np.ptp(force) / force.mean()),
        "x": x.tolist(),
        "force": force.tolist(),
    }


@case
def pull(name: str) -> Row:
    """Share of the contact force at nodes that pull, under a ball of 4 mm that only presses."""
    solver, radius = model(name), 4e-3
    down = [(1e-3, -2e-3, radius - depth) for depth in (DEPTH / 2, DEPTH)]
    answer = solved(solver, Shape.sphere(radius), down)[-1]
    normal = answer.contact_force[:, 2]
    return {
        "nodes": nodes(solver),
        "force": float(-answer.wrench[2]),
        "pulling": float(normal[normal > 0].sum() / -answer.wrench[2]),
        "sum": float(abs(1 - normal.sum() / answer.wrench[2])),
    }
