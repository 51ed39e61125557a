"""Slip marker by marker while a load along the pads grows.

Where bodies of like elasticity touch on a circle of radius a, pressed by N and pulled along it by
T < μN, the middle up to the radius c sticks and the ring around it slides (Cattaneo 1938, Mindlin
1949):

    c = a (1 − T/μN)^(1/3),   so that 1 − (1 − T/μN)^(2/3) of the area slides,

and so do ellipses of contact. Here a marker in contact has slipped once the object moved past it by
20 µm along the pad since the load began to grow, and all slides when all of them have.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

import load_cases as cases
import ruffini

PERIOD = 4e-3
"""Time of a control step (s), of which 125 follow the growth of the load."""
GRIP, FRICTION, MASS = 8.0, 0.5, 0.03
"""Grip (N), friction coefficient, and mass (kg) of the object."""
MOST = 1.25
"""Load at the end, over that at which all slides by Coulomb's law."""
MARKERS = (13, 19)
"""Markers across and along a pad, 1 mm apart."""
CLOSE = 3e-5
"""Distance from the object at which a marker counts as in contact (m)."""
SLIPPED = 2e-5
"""Way past a marker from which it counts as slipped: a third of a GelSight Mini's pixel (m)."""
RATIOS = (0.2, 0.4, 0.6, 0.8, 0.9)
"""Loads T/μN at which shares of slipped markers are compared."""


def predicted(ratio: Any) -> Any:
    """Share of the area of contact that slides at T/μN, by Cattaneo and Mindlin."""
    return 1 - np.maximum(1 - np.asarray(ratio), 0.0) ** (2 / 3)


def state(env: Any, observation: Any, rest: np.ndarray) -> dict[str, Any]:
    """Pose of the object, and the pads' axes and markers (2, M, 3) (m) in the world."""
    look = env.unwrapped.look()
    pads = cases.faces_of(look, np.array(look["pad_wrenches"], float))
    moved = rest + np.array(observation["markers"], float).reshape(2, -1, 3)
    return {
        "center": np.array(look["object_position"]),
        "rotation": cases.turned(look["object_quaternion"]),
        "axes": np.array([axes for _, axes in pads]),
        "moved": moved,
        "markers": np.array(
            [place + of @ axes.T for of, (place, axes) in zip(moved, pads, strict=True)]
        ),
    }


def passed(before: dict[str, Any], now: dict[str, Any]) -> np.ndarray:
    """Way of the object past each marker between states, along x and y of its pad (2, M, 2) (m)."""
    turn = now["rotation"] @ before["rotation"].T
    carried = now["center"] + (before["markers"] - before["center"]) @ turn.T
    ways = np.einsum("kmi,kij->kmj", carried - before["markers"], before["axes"])
    return (ways - (now["moved"] - before["moved"]))[:, :, :2]


def touching(shape: ruffini.Shape, now: dict[str, Any]) -> np.ndarray:
    """Returns of each marker whether it is in contact (2, M)."""
    points = (now["markers"] - now["center"]) @ now["rotation"]
    distance, _ = shape.distance(points.reshape(-1, 3))
    return np.reshape(distance < CLOSE, points.shape[:2])


def loaded(thing: str, model: str) -> dict[str, Any]:
    """Onset of slip of the markers under an object whose load grows along a line until all slides.

    Returns the steps and loads of the first slip and of gross slip, `None` where it does not come,
    shares of slipped markers at `RATIOS`, the course of load and share, and `slip` before the load.
    """
    env = gymnasium.make(
        cases.HOLD,
        objects=[thing],
        tactile=model,
        observation=["wrench", "markers", "slip"],
        load=MOST * 2 * FRICTION * GRIP - MASS * cases.GRAVITY,
        shaking=0.0,
        friction=FRICTION,
        start_grip=GRIP,
        mass=MASS,
        size=1.0,
        resolution={"markers": MARKERS},
        physics={"control_period": PERIOD},
        disable_env_checker=True,
    )
    observation, _ = env.reset(seed=0)
    rest = np.array(env.unwrapped.skin()["markers"]).reshape(-1, 3)
    shape, before, way, course = ruffini.Shape.named(thing), None, np.zeros(()), []
    unloaded = float(observation["slip"].max())
    for step in range(round(cases.ONSET / PERIOD) + 1):
        now = state(env, observation, rest)
        way = way + passed(before or now, now)
        held = touching(shape, now)
        pressed = -np.array(observation["wrench"], float).reshape(2, 6)[:, 2].sum()
        if not held.any() or pressed <= 0:
            break
        pushed = cases.external(env.unwrapped.look(), np.array([step * PERIOD]))[0, 2]
        ratio = (MASS * cases.GRAVITY - pushed) / (FRICTION * pressed)
        course.append([ratio, float((np.linalg.norm(way, axis=2) > SLIPPED)[held].mean())])
        observation, _, ended, *_ = env.step(cases.still())
        before = now
        if ended:
            break
    env.close()
    found = judged(np.array(course))
    return found | {"object": thing, "model": model, "slip unloaded": unloaded}


def judged(course: np.ndarray) -> dict[str, Any]:
    """Onset of slip in a course of loads and shares (K, 2)."""
    ratio, share = course.T

    def first(which: np.ndarray) -> int | None:
        found = np.flatnonzero(which)
        return int(found[0]) if len(found) else None

    steps = {"first slip": first(share > 0), "gross slip": first(share == 1)}
    steps["predicted"] = first(ratio >= 1)
    found: dict[str, Any] = dict(steps)
    found |= {
        f"load at {name}": None if at is None else float(ratio[at]) for name, at in steps.items()
    }
    begun, end, law = steps.values()
    found["steps between"] = None if begun is None or end is None else end - begun
    found["predicted between"] = None if begun is None or law is None else law - begun
    at = {of: first(ratio >= of) for of in RATIOS}
    found["shares"] = {str(of): None if k is None else float(share[k]) for of, k in at.items()}
    return found | {"course": [[float(f"{x:.3g}") for x in row] for row in course]}
