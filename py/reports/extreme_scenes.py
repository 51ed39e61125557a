"""Extreme scenes of the environment, drawn from a seed, and their outcomes.

Masses, friction, time steps and grips over all that is accepted; wild actions, held ones, and the
scripted grasp. Checked: observations finite and within their space, rewards in [0, 1], endings
named, an untouched object at rest, the same scene again bit for bit.
"""

from __future__ import annotations

import math
import warnings

import numpy as np

import ruffini
import ruffini.envs
from extreme import WrongError, spread
from ruffini._schema import control_period
from ruffini._vector import NativeVectorEnv
from ruffini.policies import scripted
from ruffini.policies._parts import part

STEPS = (1 / 60, 1 / 100, 1 / 250, 1 / 500, 1 / 1000)
TACTILE = ("none", "compliance", "surrogate")
TASKS = ("GraspLift", "GraspFragile", "HoldStill")
"""Tasks in which two fingers with pads hold an object."""


def draw(random: np.random.Generator) -> dict:
    """A scene, and the actions in it."""
    tactile = str(random.choice(TACTILE, p=[0.6, 0.05, 0.35]))
    task = "GraspLift" if tactile == "none" else str(random.choice(TASKS))
    hold = tactile == "none" and random.random() < 0.1
    step = float(random.choice(STEPS))
    # Fewer iterations than one a millisecond are refused.
    least = math.ceil(step / 1.05e-3) if random.random() < 0.9 else 1
    steps = 1500 if hold else int(random.integers(5, 100 if tactile == "none" else 40))
    return {
        "answerer": "environment",
        "task": task,
        "tactile": tactile,
        "objects": [str(random.choice(ruffini.OBJECTS))],
        "mass": spread(random, *((1e-3, 0.3) if task == "HoldStill" else (1e-5, 1e3))),
        "friction": float(random.choice([0.01, random.uniform(0.01, 4.2)])),
        "size": float(random.uniform(0.5, 1.2)),
        "time step": step,
        "iterations": least * int(random.choice([1, 2, 4])),
        "grip": spread(random, 6.0 if task == "HoldStill" else 0.1, 100.0),
        "actions": str(random.choice(["wild", "bang", "huge", "scripted", "still"])),
        "steps": steps,
        "seed": int(random.integers(2**31)),
    }


def answered(case: dict) -> dict:
    """Checked outcome of a scene.

    Raises:
        ValueError: If it is refused.
        WrongError: If a check fails.
    """
    first = played(case, case["steps"])
    if case["seed"] % 8 == 0 and first != played(case, case["steps"]):
        raise WrongError("the same scene twice is not the same")
    if first["shift"] > 1e-3 and case["friction"] >= 0.1:
        raise WrongError(f"an untouched object moves by {first['shift']:.1e} m")
    ended = sorted(set(first["endings"]))
    verdict = "refused" if ended else "solved"
    return {"verdict": verdict, "why": ", ".join(ended), "shift": first["shift"]}


def played(case: dict, steps: int) -> dict:
    """A scene's steps: how its episodes ended, and how far an untouched object moved (m)."""
    envs = scene(case)
    observation, _ = envs.reset(seed=case["seed"])
    random, policy = np.random.default_rng(case["seed"]), scripted(f"ruffini/{case['task']}-v0")
    start, endings, touched, state = place(envs), [], False, None
    ended = np.zeros(1, bool)
    for _ in range(steps):
        if case["actions"] == "scripted":
            action, state = policy.predict(observation, state, ended)
        else:
            action = act(case["actions"], random)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            observation, reward, ended, _, info = envs.step(action)
        check(envs, observation, reward)
        if ended.any():
            endings.append(named(info))
        forces = part(observation, "proprio", "normal force of each pad")
        touched = touched or (forces > 0.0).any()
    still = case["actions"] == "still" and not touched and not endings
    shift = float(np.linalg.norm(place(envs) - start)) if still else 0.0
    return {"endings": endings, "shift": shift, "last": [x.tobytes() for x in observation.values()]}


def scene(case: dict) -> NativeVectorEnv:
    """The environment of a case.

    Raises:
        ValueError: If it is refused.
    """
    step = case["time step"]
    return getattr(ruffini.envs, f"{case['task']}VectorEnv")(
        1,
        num_threads=1,
        objects=case["objects"],
        mass=case["mass"],
        friction=case["friction"],
        size=case["size"],
        tactile=case["tactile"],
        max_episode_steps=1_000_000,
        gripper={"max_force": case["grip"]},
        physics={
            "control_period": step * math.ceil(control_period() / step - 1e-9),
            "time_step": step,
            "iterations": case["iterations"],
        },
    )


def place(envs: NativeVectorEnv) -> np.ndarray:
    """Position of the object (m)."""
    seen = envs.look(0)
    assert seen is not None, "after a reset there is a scene"
    return np.array(seen["object_position"])


def act(kind: str, random: np.random.Generator) -> np.ndarray:
    """The next action (1, 5), by nobody's policy."""
    if kind == "still":
        return np.zeros((1, 5), np.float32)
    wild = random.uniform(-1, 1, (1, 5))
    if kind == "bang":
        wild = np.sign(wild)
    return (wild * (1e30 if kind == "huge" else 1.0)).astype(np.float32)


def check(envs: NativeVectorEnv, observation: dict, reward: np.ndarray) -> None:
    """Raises `WrongError` where a step cannot be one."""
    for name, values in observation.items():
        if not np.isfinite(values).all():
            raise WrongError(f"{name} is not finite")
        space = envs.single_observation_space[name]
        if not space.contains(values[0]):
            worst = int(np.argmax(np.maximum(space.low - values[0], values[0] - space.high)))
            raise WrongError(f"{name}[{worst}] is {values[0, worst]:.3e}, out of its space")
    if not (np.isfinite(reward).all() and 0.0 <= reward[0] <= 1.0):
        raise WrongError(f"a reward of {reward[0]}")


def named(info: dict) -> str:
    """Reason for which an episode ended."""
    ending = str(info.get("ending", [""])[0])
    if not ending:
        raise WrongError("an episode ended without a reason")
    if ending == "press_failed":
        return f"{ending}: {info['press_error'][0]}"
    return ending
