"""Episodes of the report on force that is the load, and the balance of an object in them.

Newton and Euler for an object of mass m, inertia I and centre of mass c that only the pads and a
known external force F on c touch:

    Σ f = m (c̈ + g ẑ) − F,        Σ (r − c) × f + τ = d(I ω)/dt.

The left sides are wrenches of both pads, the right sides follow from recorded poses. With poses
every T = 40 ms, the second difference of c over T² is the mean of c̈ over two steps, weighted by a
triangle with its peak in their middle; that of the orientation gives the same mean of d(I ω)/dt.
That mean of a smooth force is (f₋ + 10 f + f₊)/12 up to T⁴ (as in Numerov's and Störmer's method),
and that of F is summed over the 4 ms steps of the rigid bodies. A wrench that is read at the end of
a control step belongs to the beginning of its last 4 ms, so samples are first interpolated to that
much later.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from engine import KEPT
from ruffini._schema import control_period
from ruffini.commands import shapes
from ruffini.policies import part, scripted

LIFT, HOLD = "ruffini:ruffini/GraspLift-v0", "ruffini:ruffini/HoldStill-v0"
PERIOD, STEP, GRAVITY = control_period(), 0.004, 9.81
"""Time of a control step and of a step of the rigid bodies (s), and gravity (m/s²)."""
LIMIT = 5.0
"""Largest acceleration of the hand along an axis, where not set (m/s²)."""
SUBSTEPS = 4
"""Parts of a step in which the rigid-body engine moves bodies."""
ONSET = 0.5
"""Time in which load and shaking of HoldStill grow (s)."""
CENTERING = 2.0e4
"""Stiffness of the spring that keeps the fingers of the gripper centred (N/m)."""
ARM = 5e-3
"""Arm that turns a force into a torque to compare torques with: half the width of a contact (m)."""
CLEAR = 1e-3
"""Distance of an object from the table from which it is in the air (m)."""
_PADS = np.array([[[0, 0, 1], [1, 0, 0], [0, 1, 0]], [[0, 0, -1], [-1, 0, 0], [0, 1, 0]]], float)
"""Axes of the pads in the frame of the tool, as columns: y along the finger, z out of the gel."""
COMPACT = ("sphere", "cuboid", "cylinder", "prism", "ellipsoid")
OFF_CENTRE = {
    "bar": ("cuboid:0.011,0.036,0.011", 0.016),
    "long bar": ("cuboid:0.009,0.045,0.009", 0.022),
    "egg": ("ellipsoid:0.014,0.036,0.014", 0.014),
}
"""Shapes and the distance along their length from the grip to the centre (m)."""


@dataclass
class Record:
    """State at the end of each step of an episode."""

    mass: float
    inertia: np.ndarray
    """About the centre of mass, in the object's frame (3, 3) (kg m²)."""
    center: np.ndarray
    """Of mass, in the object's frame (3,) (m)."""
    surface: np.ndarray
    """Corners of the object, in its frame (V, 3) (m)."""
    look: dict[str, Any]
    step: float = STEP
    """Time of a step of the rigid bodies (s)."""
    period: float = PERIOD
    """Time of a control step (s)."""
    limit: float = LIMIT
    """Largest acceleration of the hand along an axis (m/s²)."""
    samples: dict[str, list[Any]] = field(default_factory=dict)
    ended: str = "the last step"

    def add(self, **values: Any) -> None:
        """Keeps the values of a sample."""
        for name, value in values.items():
            self.samples.setdefault(name, []).append(value)

    def arrays(self) -> dict[str, np.ndarray]:
        """Samples as arrays, the first axis that of time."""
        return {name: np.array(values) for name, values in self.samples.items()}


def solid(vertices: np.ndarray, faces: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Volume, centre and inertia about it at density 1 of a closed surface."""
    corners = vertices[faces]
    sixths = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    total = corners.sum(axis=1)
    volume, center = sixths.sum(), sixths @ total / 4 / sixths.sum()
    squares = np.einsum("fki,fkj->fij", corners, corners) + np.einsum("fi,fj->fij", total, total)
    second = np.einsum("f,fij->ij", sixths, squares) / 20 - volume * np.outer(center, center)
    return float(volume), center, np.trace(second) * np.eye(3) - second


def turned(quaternion: Any) -> np.ndarray:
    """Matrix (3, 3) of a rotation, a quaternion (x, y, z, w)."""
    x, y, z, w = np.asarray(quaternion, float)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * (w * cross + cross @ cross)


def turn(rotation: np.ndarray) -> np.ndarray:
    """Axis times angle (3,) of a rotation matrix of less than half a turn (rad)."""
    sine = 0.5 * np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    size = float(np.linalg.norm(sine))
    angle = float(np.arctan2(size, 0.5 * (np.trace(rotation) - 1)))
    return sine * (angle / size if size > 1e-12 else 1.0)


def external(look: dict[str, Any], time: np.ndarray) -> np.ndarray:
    """Load and shaking of HoldStill on the centre of mass at times (K,) (s): (K, 3) (N)."""
    if "load" not in look:
        return np.zeros((len(time), 3))
    swing = np.sin(2 * np.pi * look["shaking_frequency"] * time)
    force = swing[:, None] * np.array(look["shaking"]) - look["load"] * np.array([0, 0, 1.0])
    return np.clip(time / ONSET, 0, 1)[:, None] * force


def begin(
    task: str, thing: str, model: str, seed: int, **settings: Any
) -> tuple[gymnasium.Env, Any, Record]:
    """An environment at the start of an episode, and its record with the first sample."""
    named = off_centre(thing) if thing in OFF_CENTRE else thing
    env = gymnasium.make(
        task,
        objects=[named],
        tactile=model,
        observation=["proprio", "object", "wrench", "slip"],
        disable_env_checker=True,
        max_episode_steps=1000,
        **settings,
    )
    observation, _ = env.reset(seed=seed)
    look = env.unwrapped.look()
    vertices, faces, _ = env.unwrapped.surfaces()["object"]
    volume, center, inertia = solid(vertices, faces)
    record = Record(look["mass"], inertia * look["mass"] / volume, center, vertices, look)
    sample(env, observation, record)
    return env, observation, record


def off_centre(name: str) -> str:
    """Mesh file of a shape whose frame, and so the grip, is beside its centre."""
    form, aside = OFF_CENTRE[name]
    vertices, faces = shapes.shape(form).surface()
    file: Path = KEPT / f"load-{name.replace(' ', '-')}.obj"
    file.parent.mkdir(parents=True, exist_ok=True)
    points = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in vertices + np.array([0, aside, 0])]
    triangles = [f"f {a} {b} {c}" for a, b, c in faces + 1]
    file.write_text("\n".join([*points, *triangles]) + "\n")
    return str(file)


def sample(env: gymnasium.Env, observation: Any, record: Record) -> None:
    """Adds the state after a step to a record."""
    look = env.unwrapped.look()
    rotation = turned(look["object_quaternion"])
    place = np.array(look["object_position"])
    center = place + rotation @ record.center
    felt = np.array(observation["wrench"], float).reshape(2, 6)
    engine = np.array(look["pad_wrenches"], float)
    pads = faces_of(look, engine)

    def in_world(channel: str, component: str) -> np.ndarray:
        return tool(look) @ np.array(part(observation, channel, component), float)

    record.add(
        center=center,
        rotation=rotation,
        felt=on_object(felt, pads, center),
        engine=on_object(engine, pads, center),
        slip=np.array(observation["slip"], float),
        normal=-felt[:, 2],
        grip=float(part(observation, "proprio", "grip force command")),
        tool=np.array(look["tool_position"], float),
        hand=in_world("proprio", "tool centre velocity, in the wrist's frame"),
        velocity=in_world("object", "velocity, in the wrist's frame"),
        spin=in_world("object", "angular velocity, in the wrist's frame"),
        lowest=float((record.surface @ rotation.T + place)[:, 2].min()),
        in_hand=tool(look).T @ (center - look["tool_position"]),
    )


def tool(look: dict[str, Any]) -> np.ndarray:
    """Axes of the tool in the world, as columns."""
    cosine, sine = np.cos(look["tool_yaw"]), np.sin(look["tool_yaw"])
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])


def faces_of(look: dict[str, Any], engine: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Centre (m) and axes of each pad's face in the world.

    What `look` says of the fingers is their opening; by how much both are aside of the tool follows
    from the force on them, which the spring between them bears.
    """
    frame = tool(look)
    aside = (engine[0, 2] - engine[1, 2]) / (2 * CENTERING)
    found = []
    for k in (0, 1):
        along = (k - 0.5) * look["opening"] + aside
        found.append((np.array(look["tool_position"]) + along * frame[:, 0], frame @ _PADS[k]))
    return found


def on_object(wrenches: np.ndarray, pads: Any, center: np.ndarray) -> np.ndarray:
    """Sum (6,) on the object about its centre, in the world, of wrenches (2, 6) on the pads."""
    sum_ = np.zeros(6)
    for wrench, (place, axes) in zip(wrenches, pads, strict=True):
        force, torque = -axes @ wrench[:3], -axes @ wrench[3:]
        sum_[:3] += force
        sum_[3:] += torque + np.cross(place - center, force)
    return sum_


def balance(record: Record) -> dict[str, np.ndarray]:
    """Wrenches (K, 6) that the motion needs and that are felt, and the scale of forces, by sample.

    Left out are those in or beside which a pad does not touch, or the object may touch the table.
    """
    arrays, period = record.arrays(), record.period
    center, rotation = arrays["center"], arrays["rotation"]
    count = len(center) - 3
    acceleration = (center[2:] - 2 * center[1:-1] + center[:-2]) / period**2
    momentum = []
    for before, after in pairwise(rotation):
        way = turn(after @ before.T)
        half = spun(0.5 * way) @ before
        momentum.append(half @ record.inertia @ half.T @ (way / period))
    spin = np.diff(np.array(momentum).reshape(-1, 3), axis=0)[:-1] / period
    fine = round(period / record.step)
    j = np.arange(1, 2 * fine)
    weight = np.minimum(j, 2 * fine - j) / fine**2
    pushed = np.array(
        [weight @ external(record.look, i * period + j * record.step) for i in range(count)]
    ).reshape(-1, 3)
    force = record.mass * (acceleration[:-1] + np.array([0, 0, GRAVITY])) - pushed
    scale = record.mass * (GRAVITY + np.linalg.norm(acceleration[:-1], axis=1))
    scale += np.linalg.norm(pushed, axis=1)

    judged = in_hand(arrays)
    found = {"step": np.arange(1, count + 1), "needed": np.c_[force, spin], "scale": scale}
    found |= {of: mean(record, arrays[of], 10) + unseen(record) for of in ("felt", "engine")}
    found |= {"slip": arrays["slip"][1:-2], "grip": arrays["grip"][1:-2]}
    return {name: values[judged] for name, values in found.items()}


def in_hand(arrays: dict[str, np.ndarray]) -> np.ndarray:
    """Returns of each sample with three neighbours whether the pads alone touch the object."""
    touching = (arrays["normal"] > 0).all(axis=1) & (arrays["lowest"] > CLEAR)
    return touching[:-3] & touching[1:-2] & touching[2:-1] & touching[3:]


def mean(record: Record, wrenches: np.ndarray, middle: float) -> np.ndarray:
    """Mean of wrenches (K, 6) over two steps, with 1, `middle` and 1 as weights."""
    late = wrenches[:-1] + record.step / record.period * np.diff(wrenches, axis=0)
    return (late[:-2] + middle * late[1:-1] + late[2:]) / (middle + 2)


def unseen(record: Record) -> np.ndarray:
    """Inertial wrench in the hand that :func:`mean` of wrenches at the ends of steps lacks (K, 6).

    The hand reaches the velocity of a command within the step, at up to its limit of acceleration,
    so that mostly none is left at the end, while the change of the motion over two steps has all.
    """
    arrays = record.arrays()
    change = np.diff(arrays["hand"], axis=0, prepend=arrays["hand"][:1])
    beyond = np.abs(change) - record.limit * (record.period - record.step)
    at_end = np.zeros((len(change), 6))
    at_end[:, :3] = record.mass * np.sign(change) * beyond.clip(0.0) / record.step
    whole = record.mass * np.diff(arrays["tool"], 2, axis=0)[:-1] / record.period**2
    lacking = -mean(record, at_end, 10)
    lacking[:, :3] += whole
    return lacking


def balance_of_velocities(record: Record) -> dict[str, np.ndarray]:
    """As :func:`balance` without an external force, from recorded velocities.

    The change of momentum and angular momentum over two steps is the plain mean of the wrench, here
    by Simpson's rule.
    """
    arrays = record.arrays()
    turn = arrays["rotation"]
    spin = np.einsum("kij,jl,kml,km->ki", turn, record.inertia, turn, arrays["spin"])
    acceleration, torque = (
        (of[2:] - of[:-2])[:-1] / (2 * record.period) for of in (arrays["velocity"], spin)
    )
    found = {"scale": record.mass * (GRAVITY + np.linalg.norm(acceleration, axis=1))}
    found["needed"] = np.c_[record.mass * (acceleration + np.array([0, 0, GRAVITY])), torque]
    found |= {of: mean(record, arrays[of], 4) for of in ("felt", "engine")}
    judged = in_hand(arrays)
    return {name: values[judged] for name, values in found.items()}


def unit(vector: np.ndarray) -> np.ndarray:
    """The direction of a vector."""
    return vector / max(float(np.linalg.norm(vector)), 1e-300)


def spun(way: np.ndarray) -> np.ndarray:
    """Rotation matrix of axis times angle (3,) (rad)."""
    angle = float(np.linalg.norm(way))
    return turned([*(np.sin(angle / 2) * unit(way)), np.cos(angle / 2)])


def excess(record: Record) -> dict[str, dict[str, float]]:
    """Error of the load under even acceleration of the hand, over the inertial force, by axis.

    Judged are samples of which the acceleration is that of the hand and along one axis of the tool.
    """
    found = balance(record)
    acceleration = found["needed"][:, :3] / record.mass - np.array([0, 0, GRAVITY])
    by_axis = {}
    for axis, name in enumerate(("along the grip", "across it", "up")):
        rest = np.delete(acceleration, axis, axis=1)
        along = acceleration[:, axis]
        even = abs(abs(along) - ACCELERATION) < 0.02 * ACCELERATION
        even &= (abs(rest) < 0.02 * ACCELERATION).all(axis=1)
        by_axis[name] = {"samples": int(even.sum())} | {
            of: float(
                np.median(((found[of] - found["needed"])[even, axis] / along[even]) / record.mass)
            )
            for of in ("felt", "engine")
            if even.any()
        }
    return by_axis


def errors(found: dict[str, np.ndarray], of: str) -> tuple[np.ndarray, np.ndarray]:
    """Relative errors of force and torque of `felt` or `engine`."""
    apart = found[of] - found["needed"]
    force = np.linalg.norm(apart[:, :3], axis=1) / found["scale"]
    return force, np.linalg.norm(apart[:, 3:], axis=1) / (ARM * found["scale"])


def still(rate: float = 0.0) -> np.ndarray:
    """An action that leaves the hand where it is and changes the grip."""
    return np.array([0, 0, 0, 0, rate], np.float32)


def hanging(thing: str, model: str, seed: int, steps: int = 40) -> Record:
    """Held without load or shaking."""
    quiet: dict[str, Any] = {"load": 0.0, "shaking": 0.0, "friction": (0.5, 1.2)}
    env, _, record = begin(HOLD, thing, model, seed, **quiet)
    return held(env, record, [still()] * steps)


def trembling(thing: str, model: str, grip: float, seed: int = 3) -> dict[str, float]:
    """Ranges of the felt vertical force (N) and of the height (m) of what is held still for long.

    Both over the second half of 120 steps under a steady load of 1 N.
    """
    steady: dict[str, Any] = {"load": 1.0, "shaking": 0.0, "friction": 0.9}
    env, _, record = begin(HOLD, thing, model, seed, start_grip=grip, **steady)
    arrays = held(env, record, [still()] * 120).arrays()
    felt, height = arrays["felt"][60:, 2], arrays["in_hand"][60:, 2]
    found = {"load": record.mass * GRAVITY + record.look["load"], "moves": float(np.ptp(height))}
    return found | {"least": float(felt.min()), "most": float(felt.max())}


def shaken(thing: str, model: str, seed: int, steps: int = 75) -> Record:
    """Held under a load and shaking, as HoldStill draws them, with 8 N."""
    env, _, record = begin(HOLD, thing, model, seed, start_grip=8.0, friction=(0.3, 1.2))
    return held(env, record, [still()] * steps)


def lifted(thing: str, model: str, seed: int, steps: int = 90) -> Record:
    """Lifted and held by the scripted policy, with all limits of the hand as they are."""
    env, observation, record = begin(LIFT, thing, model, seed, friction=(0.5, 1.2))
    return carried(env, observation, record, steps, lambda _, action: action)


def moved(
    thing: str, model: str, seed: int, step: float = STEP, substeps: int = SUBSTEPS
) -> Record:
    """Lifted, then moved to and fro along the grip, across it and up, at an even 1 m/s²."""
    limits: dict[str, Any] = {"gripper": {"max_acceleration": ACCELERATION}, "yaw": 0.0}
    limits["physics"] = {"time_step": step, "iterations": substeps}
    env, observation, record = begin(LIFT, thing, model, seed, friction=(0.5, 1.2), **limits)
    record.step, record.limit = step, ACCELERATION
    turns = [way for axis in (0, 1, 2) for way in (axis, ~axis, ~axis, axis)]

    def shuttle(time: int, action: Any) -> Any:
        way = turns[time // SPAN % len(turns)]
        action[:4] = 0.0
        action[way if way >= 0 else ~way] = 1.0 if way >= 0 else -1.0
        return action

    return carried(env, observation, record, 140, shuttle)


ACCELERATION, SPAN = 1.0, 5
"""Acceleration of the hand (m/s²), and control steps for which it is kept."""


def carried(env: Any, observation: Any, record: Record, steps: int, after: Any) -> Record:
    """Lifts by the scripted policy; what it does when the object is up goes through `after`."""
    policy, up = scripted(LIFT.partition(":")[2]), 0
    for _ in range(steps):
        action = policy.predict({name: of[None] for name, of in observation.items()})[0][0]
        up += up > 0 or bool(part(observation, "object", "rise over the table") > 0.09)
        if up > 12:
            action = after(up - 13, action)
        observation = advance(env, record, action)
        if observation is None:
            break
    env.close()
    return record


def pivoting(thing: str, model: str, seed: int, period: float = PERIOD) -> Record:
    """Gripped beside its centre, the grip loosened until it swings about both contacts."""
    start, low = 10.0, 1.0
    settings: dict[str, Any] = {"load": 0.0, "shaking": 0.0, "friction": (0.5, 1.0)}
    settings |= {"start_grip": start, "least_grip": low, "mass": (0.03, 0.08)}
    settings |= {"physics": {"control_period": period}}
    env, _, record = begin(HOLD, thing, model, seed, **settings)
    record.period = period
    return held(env, record, [still(-0.1)] * round(60 * PERIOD / period))


def loosened(start: float, steps: int) -> list[np.ndarray]:
    """Actions that take the grip from `start` (N) to nothing along a line."""
    grips = start * (1 - np.arange(steps + 1) / steps)
    rates = np.log(np.maximum(grips[1:], 1e-3) / np.maximum(grips[:-1], 1e-3)) / (10.0 * PERIOD)
    return [still(max(rate, -1.0)) for rate in rates]


def sliding(thing: str, model: str, seed: int) -> Record:
    """Held under a steady load, the grip loosened along a line until the object is dropped."""
    steady: dict[str, Any] = {"load": 1.0, "shaking": 0.0, "friction": ROUGH[seed % len(ROUGH)]}
    steady |= {"start_grip": START, "least_grip": 0.05, "mass": (0.05, 0.1)}
    env, _, record = begin(HOLD, thing, model, seed, **steady)
    return held(env, record, [still()] * SETTLED + loosened(START, LOOSENING))


ROUGH = (0.3, 0.5, 0.7, 0.9, 0.4, 0.6, 0.8, 0.35, 0.55, 0.75)
"""Friction coefficients of the seeds of a loosened grip."""
START, SETTLED, LOOSENING = 15.0, 20, 150
"""Grip at the start (N), steps before it is loosened, and steps in which it goes to nothing."""


def advance(env: gymnasium.Env, record: Record, action: Any) -> Any:
    """Takes a step; the observation, or None at the end of the episode."""
    observation, _, terminated, truncated, info = env.step(action)
    if terminated or truncated:
        record.ended = str(info.get("press_error") or info.get("ending") or "the last step")
    if terminated:
        return None
    sample(env, observation, record)
    return None if truncated else observation


def held(env: gymnasium.Env, record: Record, actions: list[np.ndarray]) -> Record:
    """Takes given actions."""
    for action in actions:
        if advance(env, record, action) is None:
            break
    env.close()
    return record


CASES: dict[str, tuple[Callable[[str, str, int], Record], tuple[str, ...]]] = {
    "hanging": (hanging, COMPACT),
    "shaken": (shaken, COMPACT),
    "lifted": (lifted, COMPACT),
    "moved": (moved, COMPACT),
    "pivoting": (pivoting, tuple(OFF_CENTRE)),
    "sliding": (sliding, COMPACT),
}
"""Function that makes an episode, and its objects, by the name of a case."""


def onset(record: Record) -> dict[str, Any]:
    """Steps and grips at which a loosened grip slips, and those predicted by Coulomb's law.

    The grip is the force commanded to each finger; steps count from where it begins to fall.
    """
    arrays = record.arrays()
    load = record.mass * GRAVITY + record.look["load"]
    grip, slip = arrays["grip"], arrays["slip"].max(axis=1)
    # Along the faces of the pads, across the fingers and up. What turns into place at the start of
    # a grip stops again.
    way = np.linalg.norm(np.diff(arrays["in_hand"][:, 1:], axis=0, prepend=np.nan), axis=1)
    after = np.arange(len(grip)) > SETTLED
    limit = load / (2 * record.look["friction"])

    def first(which: np.ndarray) -> int | None:
        found = np.flatnonzero(which & after)
        return int(found[0]) if len(found) else None

    steps = {
        "predicted": first(grip <= limit),
        "first slip": first(slip > 0.1),
        "gross slip": first(np.logical_and.accumulate((way > 1e-4)[::-1])[::-1]),
    }
    found: dict[str, Any] = {"load": load, "limit": limit, "ended": record.ended}
    for name, at in steps.items():
        found[name] = None if at is None else at - SETTLED
        found[f"grip at {name}"] = None if at is None else float(grip[at])
        found[f"slip at {name}"] = None if at is None else float(slip[at])
    return found
