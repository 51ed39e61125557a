"""Environment steps per second, by number of environments and threads, beside its peers.

Use::

    python policies/rollout_speed.py --json policies/results/rollout_speed.json
    python policies/rollout_speed.py --touch --json policies/results/touch_speed.json
    python policies/rollout_speed.py --infos --json infos_speed.json
    python policies/rollout_speed.py --custom --json custom_speed.json
    python policies/rollout_speed.py --cost --json policies/results/rollout_cost.json

Peers are measured in the same run if they are installed (``gymnasium-robotics`` with a ``mujoco``
below 3.12, ``envpool``) and named as missing if not. Actions are random; resets count as what they
cost. With ``--touch``, by model of touch and object, on one thread in some minutes: the scripted
policy grasps, lifts and holds, and only steps in which all pads of four environments touch are
counted, by processor time. With ``--infos``, the adapter for Stable-Baselines3 alone: what infos in
every step cost; with ``--custom``, what rules in Python cost, those of GraspLift written once more;
with ``--cost``, what 10⁸ steps of grasping cost, in some eight minutes on two cores (`scaling`),
and the table of it for ``py/docs/scale.md``.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from peers import PEERS, peer
from ruffini import TASKS, custom
from ruffini._schema import control_period
from ruffini.evaluation import about_this_run, usable_cores
from scaling import cost, table
from timing import (
    ENV_ID,
    make,
    mean_time,
    memory_per_environment,
    random_steps,
    resident_bytes,
    scripted_steps,
    steps_per_second,
    touching,
)

CONTROL_STEP = control_period()
"""Time that a step of it simulates (s)."""


class LiftInPython(custom.Task):
    """GraspLift's reward in Python; pays what the native one pays, to single precision."""

    terms: ClassVar[dict[str, float]] = {
        "reach": 0.1,
        "grasp": 0.1,
        "lift": 0.5,
        "hold": 0.2,
        "effort": 0.1,
    }
    reads = ("object",)

    def start(self, state: custom.State, rows: NDArray[np.intp]) -> None:
        """Restart the count of steps in which the object has been lifted."""
        if not hasattr(self, "lifted"):
            self.lifted = np.zeros(len(state.action))
        self.lifted[rows] = 0

    def reward(self, state: custom.State) -> dict[str, NDArray[Any]]:
        """The five terms."""
        forces = state.part("proprio", "normal force of each pad").min(axis=1)
        place = state.part("object", "position from the tool centre, in the wrist's frame")
        rise = state.part("object", "rise over the table")
        lift = np.where(forces > 0, np.clip(rise / 0.08, 0, 1), 0)
        self.lifted = np.where((rise >= 0.95 * 0.08) & (forces > 0), self.lifted + 1, 0)
        grip = np.abs(state.part("proprio", "grip force command"))
        return {
            "reach": 1 - np.tanh(np.linalg.norm(place, axis=1) / 0.103),
            "grasp": np.clip(forces, 0, 1),
            "lift": lift,
            "hold": np.minimum(self.lifted / 13, 1),
            "effort": np.clip(1 - grip / 40, 0, 1) * lift,
        }


def custom_cost(seconds: float) -> dict[str, Any]:
    """Steps per second (n = 64, one thread) with rules in Rust and in Python, taken in turn."""
    figures: dict[str, dict[str, float]] = {}
    scenes: dict[str, dict[str, Any]] = {"rigid": {"tactile": "none"}, "touch": {}}
    for name, settings in scenes.items():
        envs: dict[str, Any] = {
            "native": gym.make_vec(ENV_ID, num_envs=64, num_threads=1, **settings),
            "python": custom.CustomVectorEnv(LiftInPython, 64, num_threads=1, **settings),
        }
        rates: dict[str, list[float]] = {"native": [], "python": []}
        for _ in range(5):
            for kind, each in envs.items():
                each.reset(seed=0)
                rates[kind].append(steps_per_second(64, random_steps(each, 64), seconds))
        of = {kind: round(float(np.median(each)), 1) for kind, each in rates.items()}
        figures[name] = of | {"ratio": round(of["python"] / of["native"], 3)}
        print(f"{name}: {figures[name]}")
    return {"custom_n64_1_thread": figures}


TOUCH = {"none": 2000, "surrogate": 100, "surrogate, stress": 100, "compliance": 100}
"""Models of touch, one with a channel of stress, and steps for each; those with rigid pads take
tens of microseconds."""
OBJECTS = ("sphere", "cuboid", "cylinder", "cup")
GRIPS = 4
"""Environments whose pads all have to touch."""


def touch_speed(seconds: float) -> dict[str, Any]:
    """Steps per second by model of touch: by object while all pads touch, and while none does."""
    return {
        "touching": {model: {name: grasping(model, name) for name in OBJECTS} for model in TOUCH},
        "untouched": {model: untouched(model, seconds / 30) for model in TOUCH},
    }


def touch(model: str) -> dict[str, Any]:
    """Settings of a model of touch."""
    tactile, _, stress = model.partition(", ")
    observation = TASKS["GraspLift"]["usual_channels"]
    return {"tactile": tactile} | ({"observation": [*observation, stress]} if stress else {})


def grasping(model: str, name: str) -> dict[str, Any]:
    """Steps a second of processor time with all pads touching, and how the episodes ended."""
    envs = make(GRIPS, 1, objects=[name], **touch(model))
    spent, counted, episodes, lifted = 0.0, 0, 0, 0
    for step in islice(scripted_steps(envs, ENV_ID), TOUCH[model]):
        if touching(step.observation).all():
            spent += step.processor
            counted += GRIPS
        episodes += int(step.over.sum())
        lifted += int(step.info["is_success"][step.over].sum()) if step.over.any() else 0
    row = {
        "steps_per_second": counted / spent if spent else None,
        "steps": counted,
        "episodes": episodes,
        "lifted": lifted,
    }
    print(model, name, row, flush=True)
    return row


def untouched(model: str, seconds: float) -> float:
    """Steps a second of processor time of a hand that stays over the object, the best of five.

    Raises:
        RuntimeError: If a pad touches.
    """
    envs = make(GRIPS, 1, objects=["sphere"], **touch(model))
    still = np.zeros((GRIPS, 5), np.float32)

    def step(_count: int) -> None:
        observation, *_ = envs.step(still)
        if touching(observation).any():
            raise RuntimeError("a pad touches")

    best = GRIPS / min(mean_time(step, seconds, time.process_time) for _ in range(5))
    print({"tactile": model, "untouched": best}, flush=True)
    return best


def random_rollout(n: int, threads: int, seconds: float, **settings: Any) -> float:
    """Steps per second under random actions."""
    envs = make(n, threads, **settings)
    # A shape is prepared when it is first drawn, for half a second; 64 draws meet all of them.
    for _ in range(64 // n):
        envs.reset()
    return steps_per_second(n, random_steps(envs, n), seconds)


def scripted_rollout(n: int, threads: int, seconds: float) -> float:
    """Steps per second while grasping, lifting and holding; the policy's own time is left out."""
    steps, spent, count = scripted_steps(make(n, threads), ENV_ID), 0.0, 0
    while spent < seconds:
        spent += next(steps).wall
        count += 1
    return n * count / spent


class Recorded:
    """A batch that answers every step with one recorded result, in no time."""

    def __init__(self, batch: Any, result: Any) -> None:
        self._batch = batch
        self._result = result

    def step(self, actions: Any) -> Any:
        """The recorded result."""
        return self._result

    def __getattr__(self, name: str) -> Any:
        """Whatever else an environment asks of its batch."""
        return getattr(self._batch, name)


def python_share(seconds: float) -> float:
    """Share of a batched step (n = 64, one thread) that is spent outside the native call."""
    envs = make(64, 1)
    actions = np.zeros((64, 5), np.float32)
    whole = steps_per_second(64, lambda _: envs.step(actions), seconds)
    envs._batch = Recorded(envs._batch, envs._batch.step(actions))  # type: ignore[assignment]
    python = steps_per_second(64, lambda _: envs.step(actions), seconds)
    return whole / python


def infos_microseconds(n: int, seconds: float) -> dict[str, float]:
    """Processor times of a step of n rigid environments (µs), medians over turns.

    ``native`` is the native call under random actions; the others are what the adapter for
    Stable-Baselines3 adds with these infos, over a recorded step in which no episode ends.
    """
    from ruffini.sb3 import Infos, make_vec_env

    def adapter(infos: Infos) -> Callable[[int], Any]:
        vec_env = make_vec_env(
            ENV_ID, n, seed=0, infos=infos, num_threads=1, tactile="none", observation="proprio"
        )
        vec_env.reset()
        batch = vec_env.envs._batch
        vec_env.envs._batch = Recorded(batch, random_steps(batch, n)(0))  # type: ignore[assignment]
        return random_steps(vec_env, n)

    steps: dict[str, Callable[[int], Any]] = {
        "native": random_steps(make(n, 1, observation="proprio")._batch, n),
        "every step": adapter("every step"),
        "episode ends": adapter("episode ends"),
    }
    turns: dict[str, list[float]] = {name: [] for name in steps}
    for _ in range(10):
        for name, step in steps.items():
            turns[name].append(1e6 * mean_time(step, seconds / 10, time.thread_time))
    return {name: round(float(np.median(times)), 1) for name, times in turns.items()}


def infos_cost(seconds: float) -> dict[str, Any]:
    """Cost of infos in every step, by the number of environments."""
    found: dict[str, Any] = {}
    for n in (64, 256):
        times = infos_microseconds(n, seconds)
        more = times["every step"] - times["episode ends"]
        whole = times["native"] + times["every step"]
        found[str(n)] = {"microseconds": times, "share_of_a_step": round(more / whole, 4)}
        print(f"n = {n:5d}: " + ", ".join(f"{name} {time} µs" for name, time in times.items()))
        print(f"           infos in every step are {more / whole:.1%} of a step")
    return {"infos_rigid_1_thread": found}


def memory_growth(steps: int) -> float:
    """Bytes by which so many environment steps grow the process, after as many to warm up."""
    envs = make(256, usable_cores())
    step = random_steps(envs, 256)
    for i in range(steps // 256):
        step(i)
    before = resident_bytes()
    for i in range(steps // 256):
        step(i)
    return float(resident_bytes() - before)


def write(file: Path | None, figures: dict[str, Any]) -> None:
    """Writes figures and what they were measured on to a file, if there is one."""
    if file:
        file.parent.mkdir(exist_ok=True)
        file.write_text(json.dumps(about_this_run() | figures, indent=1) + "\n")


def rollouts(seconds: float, quick: bool) -> dict[str, Any]:
    """Steps per second by number of environments and threads, memory, and peers."""
    cores = usable_cores()
    sizes = [1, 64] if quick else [1, 16, 64, 256, 1024]
    threads = sorted({t for t in (1, 2, 4, cores) if t <= cores})
    per_environment = round(memory_per_environment())
    rates: dict[str, dict[str, float]] = {}
    for n in sizes:
        row = {str(t): round(random_rollout(n, t, seconds), 1) for t in threads if t <= n}
        rates[str(n)] = row
        print(f"n = {n:5d}: " + ", ".join(f"{v:,.0f} /s on {t}" for t, v in row.items()))
    one, most = rates["64"]["1"], rates["64"][str(threads[-1])]
    figures: dict[str, Any] = {
        "random_actions": rates,
        "scripted_grasp_n64_1_thread": round(scripted_rollout(64, 1, seconds), 1),
        "efficiency_n64": round(most / one / threads[-1], 3),
        "python_share_n64": round(python_share(seconds), 4),
        "bytes_per_environment": per_environment,
    }
    steps = 20_000 if quick else 1_000_000
    figures["memory_growth"] = {"steps": steps, "bytes": memory_growth(steps)}
    figures["peers_1_thread"] = {name: peer(name, seconds) for name in PEERS}
    for name, value in figures.items():
        if name != "random_actions":
            print(f"{name}: {value}")
    return figures


def main() -> None:
    """Measures, prints, writes."""
    parser = argparse.ArgumentParser(description="Measure environment steps per second.")
    parser.add_argument("--json", type=Path, help="file to write the figures to")
    parser.add_argument("--quick", action="store_true", help="a tenth of the time, fewer sizes")
    alone = parser.add_mutually_exclusive_group()
    for option, measure, what in (
        ("--touch", touch_speed, "speed while pads touch, by model of touch"),
        ("--infos", infos_cost, "cost of SB3's infos"),
        ("--custom", custom_cost, "cost of rules in Python"),
    ):
        text = f"the {what} alone"
        alone.add_argument(option, action="store_const", dest="alone", const=measure, help=text)
    text = "the cost of 10⁸ steps alone, in some eight minutes on two cores"
    alone.add_argument("--cost", action="store_true", help=text)
    arguments = parser.parse_args()
    seconds = 0.3 if arguments.quick else 3.0
    if arguments.cost:
        usual = "a minute" if arguments.quick else "eight minutes"
        print(f"This takes about {usual} on two cores, longer on more of them.", flush=True)
        start = time.monotonic()
        found = cost(arguments.quick)
        write(arguments.json, found)
        print(table(found))
        print(f"It took {time.monotonic() - start:.0f} s.")
    elif arguments.alone:
        write(arguments.json, arguments.alone(seconds))
    else:
        write(arguments.json, rollouts(seconds, arguments.quick))


if __name__ == "__main__":
    main()
