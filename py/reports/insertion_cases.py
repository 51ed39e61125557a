"""Episodes of the report on insertion in which a held peg is moved, and the balance of the peg.

What the block pushes the peg with is read from the channel ``insertion``, so that the load of the
pads is known on the block, too: m (a − g) less the block's force. The block's torque is not
observed. Where the peg stands on the flat top of the block, the torque that pads feel says where
the block's force acts, and that has to be at the lowest part of the tip.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import load_cases as cases
from ruffini.policies import part, scripted

TASK = "ruffini:ruffini/InsertPeg-v0"
PEGS = ("square-peg", "round-peg", "hexagonal-peg")
PRESS, DRAG = 4.0, 0.5
"""Force of the block that is kept while a peg is dragged over it (N), and the action that drags."""
SLOWLY = 12.8
"""Force (N) too much for which the hand goes up at its speed: half as hard as the scripted one."""
MOST = 10.0
"""Greatest force with which a peg is pressed on the block (N)."""
TOUCHED = 0.1
"""Force of the block from which a peg counts as touching it (N)."""
SPAN = 5
"""Control steps for which a motion is kept."""
FORCE = "force of the fixture on the peg, in the hole's frame"
YAW = "yaw of the hand from the hole's"
ASIDE: dict[str, Any] = {"start": 0.016}
"""Place of a peg over the block with all of its tip."""
ROOM = {"low": (-0.06, -0.06, 0.0337), "high": (0.06, 0.06, 0.2)}
"""Box in which the hand moves (m)."""
FAST: dict[str, Any] = {"gripper": {"max_speed": 0.2}}
"""A hand that reaches its speed in several control steps."""


def begin(peg: str, model: str, seed: int, **settings: Any) -> tuple[gymnasium.Env, Any, Any]:
    """An environment at the start of an episode, its observation and the record of its motion."""
    settings.setdefault("workspace", ROOM)
    env = gymnasium.make(
        TASK,
        objects=[peg],
        tactile=model,
        observation=["proprio", "object", "wrench", "slip", "insertion"],
        disable_env_checker=True,
        **settings,
    )
    observation, _ = env.reset(seed=seed)
    look = env.unwrapped.look()
    vertices, faces, _ = env.unwrapped.surfaces()["object"]
    volume, center, inertia = cases.solid(vertices, faces)
    record = cases.Record(look["mass"], inertia * look["mass"] / volume, center, vertices, look)
    record.limit = 1.0
    sample(env, observation, record)
    return env, observation, record


def sample(env: gymnasium.Env, observation: Any, record: cases.Record) -> None:
    """Adds the state after a step, and the block's force in the world."""
    cases.sample(env, observation, record)
    yaw = env.unwrapped.look()["tool_yaw"] - float(part(observation, "insertion", YAW))
    block = cases.tool({"tool_yaw": yaw}) @ np.array(part(observation, "insertion", FORCE), float)
    record.add(block=block)


def play(
    env: gymnasium.Env, observation: Any, record: cases.Record, steps: int, act: Callable[..., Any]
) -> cases.Record:
    """Takes steps by `act(time, observation)`, until the episode ends."""
    for time in range(steps):
        observation, _, terminated, truncated, info = env.step(
            np.asarray(act(time, observation), np.float32)
        )
        if terminated:
            record.ended = str(info.get("press_error") or info.get("ending"))
            break
        sample(env, observation, record)
        if truncated:
            break
    env.close()
    return record


def load(observation: Any) -> float:
    """Upward force that the pads feel (N)."""
    wrench = np.reshape(observation["wrench"], (2, 6))
    return float(wrench[:, 1].sum())


def pressing(observation: Any, wanted: float) -> float:
    """Action down or up that keeps the upward force that pads feel."""
    return float(np.clip((load(observation) - wanted) / SLOWLY, -0.6, 0.6))


def held(peg: str, model: str, seed: int) -> cases.Record:
    """Held still over the block."""
    return play(*begin(peg, model, seed), 40, lambda *_: np.zeros(5))


def moved(peg: str, model: str, seed: int) -> cases.Record:
    """Moved and turned at random, each motion for a fifth of a second."""
    drawn = np.random.default_rng(seed).uniform(-1.0, 1.0, (20, 5))
    drawn[:, 4] = 0.0
    drawn[:2] = [0, 0, 1, 0, 0]
    return play(*begin(peg, model, seed), 100, lambda time, _: drawn[time // SPAN])


def shaken(peg: str, model: str, seed: int) -> cases.Record:
    """Moved to and fro along the three axes at an even 1 m/s², with a faster hand."""
    ways = [way for axis in (0, 1, 2) for way in (axis, ~axis, ~axis, axis)]

    def shuttle(time: int, _: Any) -> Any:
        action, time = np.zeros(5), time - 20
        if time < 0:
            action[2] = 0.3 if time < -SPAN else 0.0
        else:
            way = ways[time // SPAN % len(ways)]
            action[way if way >= 0 else ~way] = 1.0 if way >= 0 else -1.0
        return action

    return play(*begin(peg, model, seed, **FAST), 140, shuttle)


def loosened(peg: str, model: str, seed: int) -> cases.Record:
    """Lifted off, then the grip falls along a line until the peg has slid out."""
    settings: dict[str, Any] = {"least_grip": 0.05, "friction": cases.ROUGH[seed % 10]}
    fall = [action[4] * 2.0 for action in cases.loosened(10.0, 100)]

    def loosen(time: int, _: Any) -> Any:
        return [0, 0, 1.0 * (time < 25), 0, fall[time - 30] if time >= 30 else 0.0]

    return play(*begin(peg, model, seed, **settings), 130, loosen)


def pressed(peg: str, model: str, seed: int) -> cases.Record:
    """Pressed on the block with a force that grows, and falls again."""
    wanted = np.r_[np.full(15, 1.0), np.linspace(1.0, MOST, 40), np.linspace(MOST, 1.0, 40)]

    def press(time: int, observation: Any) -> Any:
        return [0, 0, pressing(observation, wanted[time]), 0, 0]

    return play(*begin(peg, model, seed, **ASIDE), len(wanted), press)


def dragged(peg: str, model: str, seed: int) -> cases.Record:
    """Pressed on the block and dragged over it, along the pads' faces and across them."""
    ways = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])

    def drag(time: int, observation: Any) -> Any:
        aside = DRAG * ways[(time - 20) // 10 % 4] if time >= 20 else np.zeros(2)
        return [*aside, pressing(observation, PRESS), 0, 0]

    return play(*begin(peg, model, seed, **ASIDE), 100, drag)


def pushed(peg: str, model: str, seed: int) -> cases.Record:
    """Gripped weakly and pushed on the block, so that it slides up between the pads."""
    settings: dict[str, Any] = {"start_grip": 5.0, "friction": (0.3, 0.5)} | ASIDE
    start = begin(peg, model, seed, **settings)
    return play(*start, 70, lambda *_: [0, 0, -0.2, 0, 0])


def inserted(peg: str, model: str, seed: int) -> cases.Record:
    """Searched for a hole and inserted by the scripted policy, as the task is."""
    policy, state = scripted(TASK), None
    env, observation, record = begin(peg, model, seed, workspace={})

    def act(_: int, observation: Any) -> Any:
        nonlocal state
        batch = {name: values[None] for name, values in observation.items()}
        action, state = policy.predict(batch, state)
        return action[0]

    return play(env, observation, record, 150, act)


AIR: dict[str, Callable[[str, str, int], cases.Record]] = {
    "held": held,
    "moved": moved,
    "shaken": shaken,
    "loosened": loosened,
}
BLOCK: dict[str, Callable[[str, str, int], cases.Record]] = {
    "pressed": pressed,
    "dragged": dragged,
    "pushed": pushed,
    "inserted": inserted,
}


FLAT = ("pressed", "dragged", "pushed")
"""Cases in which the peg stands on the flat top of the block."""
TOP = 0.02
"""Height of the block (m)."""
LOW = 2e-5
"""Height over its lowest point up to which the tip may bear on the block (m)."""
FIRM = 1.0
"""Upward force of the block from which it is asked where it acts (N)."""


def balance(record: cases.Record) -> dict[str, NDArray[Any]]:
    """Balance of the load with the block's force, its size and its change, by sample.

    `most` is the largest of the block's forces that are averaged (N), `change` by how much it
    differs from that of the step before or after, at most, relative to the scale of forces.
    """
    arrays = record.arrays()
    judged, force = cases.in_hand(arrays), arrays["block"]
    block = cases.mean(record, np.pad(force, ((0, 0), (0, 3))), 10)[judged]
    found = cases.balance(record)
    found["needed"] = found["needed"] - block
    found["scale"] = found["scale"] + np.linalg.norm(block, axis=1)
    three = np.stack([force[:-3], force[1:-2], force[2:-1]])[:, judged]
    steps = np.linalg.norm(np.diff(three, axis=0), axis=2)
    found |= {"block": block[:, :3], "most": np.linalg.norm(three, axis=2).max(axis=0)}
    return found | {"change": steps.max(axis=0) / found["scale"]}


def aside(record: cases.Record, found: dict[str, NDArray[Any]], of: str) -> NDArray[Any]:
    """Distance (m) of the block's force, by the torque on the pads, from the tip's lowest part.

    The torque about the vertical is left out: friction that turns the tip bears it, too. Not a
    number where the block hardly bears the peg.
    """
    arrays, away = record.arrays(), np.full(len(found["step"]), np.nan)
    torque = (found["needed"] - found[of])[:, 3:]
    for k, (step, force) in enumerate(zip(found["step"], found["block"], strict=True)):
        if force[2] < FIRM:
            continue
        center = arrays["center"][step]
        surface = (record.surface - record.center) @ arrays["rotation"][step].T + center
        low = surface[surface[:, 2] < surface[:, 2].min() + LOW, :2]
        down = TOP - center[2]
        across = (down * force[0] - torque[k, 1]) / force[2]
        along = (torque[k, 0] + down * force[1]) / force[2]
        away[k] = outside(low, center[:2] + np.array([across, along]))
    return away


def outside(points: NDArray[Any], place: NDArray[Any]) -> float:
    """Distance of a place from the convex hull of points in the plane; 0 in it."""
    arms = points - place
    turns = np.sort(np.arctan2(arms[:, 1], arms[:, 0]))
    # In the hull, no half-plane is without points.
    if np.diff(turns, append=turns[0] + 2 * np.pi).max() < np.pi:
        return 0.0
    starts, ends = arms[:, None], arms[None]
    ways = ends - starts
    squares = np.maximum((ways**2).sum(axis=2), 1e-30)
    share = np.clip(-(starts * ways).sum(axis=2) / squares, 0.0, 1.0)
    return float(np.linalg.norm(starts + share[:, :, None] * ways, axis=2).min())
