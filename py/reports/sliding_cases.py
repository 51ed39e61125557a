"""Cases of `sliding`: shapes that are dragged, and the motion of a held object, solved again."""

from __future__ import annotations

import math
from functools import cache, partial
from typing import Any

import gymnasium
import numpy as np
from scipy.spatial.transform import Rotation

import ruffini
from load_cases import faces_of, turned
from ruffini import Fem, Press, Shape, agents
from timing import timed

SPACING, HALF = 5e-4, (0.0085, 0.0105)
"""Spacing of the points that meshes are refined at, and half the face that has them (m)."""
BESIDE = 1e-3
"""Distance beside the contact to which meshes are refined (m)."""
MIDDLE = 2 / 3
"""Part of the face that a mesh is refined at, across and along, where it is not at the contact."""
ENVIRONMENT = "finite elements of an environment"
MIDDLING = "quadratic, refined in the middle"
REFERENCE = "quadratic, refined under the contact"
MODELS: dict[str, tuple[str, int, str | None] | None] = {
    "network": None,
    ENVIRONMENT: ("p1-bar", 1000, None),
    MIDDLING: ("p2", 600, "middle"),
    "quadratic, refined, fewer nodes": ("p2", 1000, "contact"),
    REFERENCE: ("p2", 1500, "contact"),
}
"""Element, about how many nodes, and where the mesh is refined."""
BALL, FRICTION = 0.018, 0.6
"""Radius of a ball that is dragged (m), as of the sphere that is grasped, and friction."""
PRESSED = {
    "ball": (Shape.sphere(BALL), BALL, 5e-4),
    "block": (Shape.cuboid((0.02, 0.02, 0.015)), 0.015, 1.5e-4),
}
"""Shapes that are dragged, height of the middle, depth (m)."""
DRAG = [4e-5 * step for step in range(1, 13)]
"""Distances that they are dragged along the finger, and back (m)."""
USED = (0.2, 0.4, 0.6)
"""Fractions of the greatest friction at which sliding is reported."""
FALLEN = (0.2, 0.4, 0.6, 0.8)
"""Fractions of it by which the tangential force has fallen since it was greatest, likewise."""
HELD = {"sphere": 10_003, "cylinder": 10_001, "cuboid": 10_000, "prism": 10_004}
"""First evaluation seed of HoldStill with each object."""
STEPS = 25
"""Control steps of an episode that are solved again: 1 s, half a period of the shaking to two."""
LOWERED = {"5 mm": 5e-3, "10 mm": 0.01, "20 mm": 0.02}
"""Radii of balls that are lowered, and nothing else (m)."""
LOWERED_FRICTION = 0.5
DEPTHS = [1.5e-4 * step for step in range(1, 9)]
"""Depths to which they are lowered one after the other (m)."""
SHOWN = (1, 3, 5, 7)
"""Numbers of the depths that are reported."""
LINEAR = "linear solution"
"""What the network corrects; only of shapes that are lowered deep and dragged."""
HALF_ROOT = math.sqrt(0.5)
UPRIGHT, ACROSS, ALONG = (
    (0.0, 0.0, 0.0, 1.0),
    (0.0, HALF_ROOT, 0.0, HALF_ROOT),
    (HALF_ROOT, 0.0, 0.0, HALF_ROOT),
)
"""Orientations: as made, and lying across and along the finger."""
DEEP = {
    "ball of 3 mm": (Shape.sphere(3e-3), UPRIGHT, 3e-3, 8e-4),
    "ball of 7 mm": (Shape.sphere(7e-3), UPRIGHT, 7e-3, 1e-3),
    "ball of 15 mm": (Shape.sphere(0.015), UPRIGHT, 0.015, 1.2e-3),
    "lying cylinder": (Shape.cylinder(5e-3, 4e-3), ACROSS, 5e-3, 8e-4),
    "lying capsule": (Shape.capsule(4e-3, 3e-3), ACROSS, 4e-3, 1e-3),
    "ellipsoid": (Shape.ellipsoid((8e-3, 5e-3, 4e-3)), UPRIGHT, 4e-3, 8e-4),
    "prism on a face": (Shape.prism(6, 8e-3, 5e-3), ACROSS, 8e-3 * math.cos(math.pi / 6), 4e-4),
    "prism on an edge": (Shape.prism(6, 8e-3, 5e-3), ALONG, 8e-3, 1e-3),
    "block": (Shape.cuboid((6e-3, 6e-3, 5e-3)), UPRIGHT, 5e-3, 4e-4),
}
"""Shapes that are lowered and then dragged, their orientation, height of the middle, depth (m)."""
DEEP_STEPS, DEEP_DRAG = 6, [1e-4 * step for step in range(1, 9)]
"""Steps down to that depth, and distances that they are then dragged along the finger (m)."""
Pose = tuple[Any, Any]


def dragged(shape: str, model: str) -> dict[str, Any]:
    """Share of the normal force that slides under what is pressed, dragged, and dragged back."""
    presser, above, depth = PRESSED[shape]
    upright = (0.0, 0.0, 0.0, 1.0)
    down = [([0.0, 0.0, above - depth * part], upright) for part in (0.25, 0.5, 0.75, 1.0)]
    path = down + [([0.0, y, above - depth], upright) for y in [*DRAG, *DRAG[-2::-1], 0.0]]
    frames, spent = solved(model, FRICTION, presser, path)
    frames = frames[len(down) - 1 :]
    used = [frame.wrench[1] / (FRICTION * abs(frame.wrench[2])) for frame in frames]
    return {
        "shape": shape,
        "model": model,
        "seconds": spent,
        "used": used,
        "sliding": [frame.sliding for frame in frames],
        "force": float(frames[len(DRAG)].wrench[2]),
    }


def lowered(ball: str, model: str) -> dict[str, Any]:
    """Share of the normal force that slides under a ball that is lowered along its axis."""
    radius, upright = LOWERED[ball], (0.0, 0.0, 0.0, 1.0)
    path = [([0.0, 0.0, radius - depth], upright) for depth in DEPTHS]
    frames, spent = solved(model, LOWERED_FRICTION, Shape.sphere(radius), path)
    return {
        "lowered": ball,
        "model": model,
        "seconds": spent,
        "sliding": [frame.sliding for frame in frames],
        "force": [float(-frame.wrench[2]) for frame in frames],
    }


def deep(name: str, model: str) -> dict[str, Any]:
    """Share of the normal force that slides under a shape that is lowered and then dragged."""
    shape, turn, above, depth = DEEP[name]
    down = [(1 + step) / DEEP_STEPS * depth for step in range(DEEP_STEPS)]
    path = [([0.0, 0.0, above - low], turn) for low in down]
    path += [([0.0, y, above - depth], turn) for y in DEEP_DRAG]
    frames, spent = solved(model, LOWERED_FRICTION, shape, path)
    return {
        "deep": name,
        "model": model,
        "seconds": spent,
        "sliding": [frame.sliding for frame in frames],
        "force": [[float(x) for x in frame.wrench[:3]] for frame in frames],
    }


def replayed(name: str, model: str) -> dict[str, Any]:
    """Sliding and force (N) in steps of an episode with the network, solved again by a model.

    The grip before the first step is replaced by a press straight down, followed by the motion
    along the face that the hand had allowed until then.
    """
    held = episode(HELD[name])
    path: list[Pose] = held["path"]
    place, rotation = path[0]
    straight = (np.array([0.0, 0.0, place[2]]), rotation)
    frames, spent = solved(model, held["friction"], held["shape"], [straight, *path])
    frames = frames[1:]
    return {
        "object": name,
        "model": model,
        "friction": held["friction"],
        "seconds": spent,
        "sliding": [frame.sliding for frame in frames],
        "force": [[float(x) for x in frame.wrench[:3]] for frame in frames],
        "felt": {"sliding": held["sliding"], "force": held["force"]},
    }


@cache
def episode(seed: int) -> dict[str, Any]:
    """Motion of the object in the frame of the first pad, as the agent of HoldStill holds it.

    Raises:
        RuntimeError: If the seed draws another object than expected.
    """
    agent = agents.load("HoldStill")
    settings = agent.settings | {"tactile": "surrogate"}
    env = gymnasium.make("ruffini/HoldStill-v0", disable_env_checker=True, **settings)
    observation, _ = env.reset(seed=seed)
    look = env.unwrapped.look()
    if HELD.get(look["object"]) != seed:
        raise RuntimeError(f"seed {seed} draws a {look['object']}, not what HELD says")
    vertices, *_ = env.unwrapped.surfaces()["object"]
    found: dict[str, Any] = {"path": [], "sliding": [], "force": []}
    state = None
    for _ in range(STEPS):
        look = env.unwrapped.look()
        found["path"].append(in_pads(look)[0])
        found["sliding"].append(float(observation["slip"][0]))
        found["force"].append([float(x) for x in observation["wrench"][:3]])
        batch = {name: values[None] for name, values in observation.items()}
        action, state = agent.predict(batch, state)
        observation, *_ = env.step(action[0])
    env.close()
    return found | {"shape": sized(look, vertices), "friction": look["friction"]}


def in_pads(look: dict[str, Any]) -> list[Pose]:
    """Pose of the object in the frame of each pad."""
    position, axes = np.array(look["object_position"]), turned(look["object_quaternion"])
    return [
        (own.T @ (position - center), Rotation.from_matrix(own.T @ axes).as_quat())
        for center, own in faces_of(look, np.array(look["pad_wrenches"], float))
    ]


def sized(look: dict[str, Any], vertices: Any) -> Shape:
    """Shape of the object."""
    half = np.asarray(vertices).max(0)
    radius = float(np.hypot(*vertices[:, :2].T).max())
    match look["object"]:
        case "sphere":
            return Shape.sphere(float(half[0]))
        case "cylinder":
            return Shape.cylinder(radius, float(half[2]))
        case "prism":
            return Shape.prism(8, radius, float(half[2]))
    return Shape.cuboid(tuple(half))


def solved(
    model: str, friction: float, shape: Shape, path: list[Pose]
) -> tuple[list[ruffini.Deformation], float]:
    """Solution of every frame, and the time that they took (s).

    Raises:
        RuntimeError: If a frame is not solved.
    """
    made = ruffini.LinearPad if model == LINEAR else ruffini.Surrogate
    solver: Any = made(friction=friction)
    if kind := MODELS.get(model):
        element, nodes, refined = kind
        around = middle() if refined == "middle" else None
        around = beneath(shape, path) if refined == "contact" else around
        pad = ruffini.sensor("gelsight-mini", resolution=nodes, around=around)
        solver = Fem(pad, friction=friction, element=element)
    frames, spent, _ = timed(partial(solver.solve_path, Press(shape, path)))
    if isinstance(frames[-1], ruffini.PressError):
        raise RuntimeError(f"{model}: {frames[-1]}")
    return frames, spent


def middle() -> Any:
    """Points in the middle of the face (K, 3), at which a mesh is refined (m)."""
    nodes = np.asarray(ruffini.sensor("gelsight-mini", resolution=100).mesh.vertices)
    half = 0.5 * MIDDLE * np.ptp(nodes[:, :2], axis=0)
    across, along = (np.linspace(-h, h, math.ceil(2 * h / 1e-3) + 1) for h in half)
    face = np.stack([*np.meshgrid(across, along), np.zeros((len(along), len(across)))], axis=-1)
    return face.reshape(-1, 3)


def beneath(shape: Shape, path: list[Pose]) -> Any:
    """Points of the face (K, 3) that the shape covers in some frame, and beside them (m)."""
    across, along = (np.arange(-half, half + 1e-9, SPACING) for half in HALF)
    face = np.stack([*np.meshgrid(across, along), np.zeros((len(along), len(across)))], axis=-1)
    face = face.reshape(-1, 3)
    is_near = np.zeros(len(face), bool)
    for place, rotation in path:
        own = (face - np.asarray(place)) @ turned(rotation)
        distance, _ = shape.distance(own)
        is_near |= distance < 0.0
    covered = face[is_near]
    apart = np.linalg.norm(face[:, None] - covered[None], axis=-1).min(1)
    return face[apart <= BESIDE]
