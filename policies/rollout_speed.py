"""Environment steps per second, by number of environments and threads, beside its peers.

Use::

    python policies/rollout_speed.py --json policies/results/rollout_speed.json
    python policies/rollout_speed.py --infos --json infos_speed.json
    python policies/rollout_speed.py --custom --json custom_speed.json

Peers are measured in the same run if they are installed (``gymnasium-robotics`` with a ``mujoco``
below 3.12, ``envpool``) and named as missing if not. Actions are random; resets count as what they
cost. With ``--infos``, the adapter for Stable-Baselines3 alone: what infos in every step cost; with
``--custom``, what rules in Python cost, those of GraspLift written once more.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ruffini import custom
from ruffini.envs import GraspLiftVectorEnv
from ruffini.evaluation import about_this_run
from ruffini.policies import scripted

ENV_ID = "ruffini/GraspLift-v0"
CONTROL_STEP = 0.04
"""Time that a step of it simulates (s)."""


def make(n: int, threads: int, **settings: Any) -> GraspLiftVectorEnv:
    """N environments on so many threads, reset."""
    rigid = {"tactile": "none"}
    envs = gym.make_vec(ENV_ID, num_envs=n, num_threads=threads, **rigid | settings)
    assert isinstance(envs, GraspLiftVectorEnv)
    envs.reset(seed=0)
    return envs


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


def _stepped(envs: Any, actions: NDArray[np.float32], i: int) -> None:
    envs.step(actions[i % len(actions)])


def custom_cost(seconds: float) -> dict[str, dict[str, float]]:
    """Steps per second (n = 64, one thread) with rules in Rust and in Python, taken in turn."""
    random = np.random.default_rng(0)
    actions = random.uniform(-1, 1, (16, 64, 5)).astype(np.float32)
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
                step = partial(_stepped, each, actions)
                rate = steps_per_second(64, step, seconds)
                rates[kind].append(rate)
        of = {kind: round(float(np.median(each)), 1) for kind, each in rates.items()}
        figures[name] = of | {"ratio": round(of["python"] / of["native"], 3)}
        print(f"{name}: {figures[name]}")
    return figures


def steps_per_second(n: int, step: Callable[[int], Any], seconds: float) -> float:
    """Rate of `step`, which steps n environments, after a tenth of the time to warm up."""
    rate = 0.0
    for budget in (0.1 * seconds, seconds):
        count, start = 0, time.perf_counter()
        while (elapsed := time.perf_counter() - start) < budget:
            step(count)
            count += 1
        rate = n * count / max(elapsed, 1e-9)
    return rate


def random_rollout(n: int, threads: int, seconds: float, **settings: Any) -> float:
    """Steps per second under random actions."""
    envs = make(n, threads, **settings)
    # A shape is prepared when it is first drawn, for half a second; 64 draws meet all of them.
    for _ in range(64 // n):
        envs.reset()
    random = np.random.default_rng(0)
    actions = random.uniform(-1, 1, (16, n, 5)).astype(np.float32)
    return steps_per_second(n, lambda i: envs.step(actions[i % 16]), seconds)


def scripted_rollout(n: int, threads: int, seconds: float) -> float:
    """Steps per second while grasping, lifting and holding; the policy's own time is left out."""
    envs, policy = make(n, threads), scripted("ruffini/GraspLift-v0")
    observation, _ = envs.reset(seed=0)
    spent, count = 0.0, 0
    while spent < seconds:
        actions, _ = policy.predict(observation)
        start = time.perf_counter()
        observation, *_ = envs.step(actions)
        spent += time.perf_counter() - start
        count += 1
    return n * count / spent


class Recorded:
    """Answers every step with one recorded result, in no time."""

    def __init__(self, result: Any) -> None:
        self._result = result

    def step(self, actions: Any) -> Any:
        """The recorded result."""
        return self._result


def python_share(seconds: float) -> float:
    """Share of a batched step (n = 64, one thread) that is spent outside the native call."""
    envs = make(64, 1)
    actions = np.zeros((64, 5), np.float32)
    whole = steps_per_second(64, lambda _: envs.step(actions), seconds)
    envs._batch = Recorded(envs._batch.step(actions))  # type: ignore[assignment]
    python = steps_per_second(64, lambda _: envs.step(actions), seconds)
    return whole / python


def processor_microseconds(step: Callable[[int], Any], seconds: float) -> float:
    """Processor time of a `step` on this thread (µs), whatever else the machine does."""
    count, start = 0, time.thread_time()
    while (spent := time.thread_time() - start) < seconds:
        step(count)
        count += 1
    return 1e6 * spent / count


def infos_microseconds(n: int, seconds: float) -> dict[str, float]:
    """Processor times of a step of n rigid environments (µs), medians over turns.

    ``native`` is the native call under random actions; the others are what the adapter for
    Stable-Baselines3 adds with these infos, over a recorded step in which no episode ends.
    """
    from stable_baselines3.common.vec_env import VecEnv

    from ruffini.sb3 import Infos, make_vec_env

    random = np.random.default_rng(0)
    actions = random.uniform(-1, 1, (16, n, 5)).astype(np.float32)

    def adapter(infos: Infos) -> VecEnv:
        vec_env = make_vec_env(
            ENV_ID, n, seed=0, infos=infos, num_threads=1, tactile="none", observation="proprio"
        )
        vec_env.reset()
        step = vec_env.envs._batch.step(actions[0])
        vec_env.envs._batch = Recorded(step)  # type: ignore[assignment]
        return vec_env

    batch = make(n, 1, observation="proprio")._batch
    every, ends = adapter("every step"), adapter("episode ends")
    steps: dict[str, Callable[[int], Any]] = {
        "native": lambda i: batch.step(actions[i % 16]),
        "every step": lambda i: every.step(actions[i % 16]),
        "episode ends": lambda i: ends.step(actions[i % 16]),
    }
    turns: dict[str, list[float]] = {name: [] for name in steps}
    for _ in range(10):
        for name, step in steps.items():
            turns[name].append(processor_microseconds(step, seconds / 10))
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
    return found


def resident_bytes() -> int:
    """Memory of this process that is in use."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def memory_per_environment(n: int = 512) -> float:
    """Bytes that each of n environments adds after a few steps, if they are the first."""
    before = resident_bytes()
    envs = make(n, 1)
    for _ in range(10):
        envs.step(np.zeros((n, 5), np.float32))
    return (resident_bytes() - before) / n


def memory_growth(steps: int) -> float:
    """Bytes by which so many environment steps grow the process, after as many to warm up."""
    envs = make(256, os.cpu_count() or 1)
    actions = np.random.default_rng(0).uniform(-1, 1, (64, 256, 5)).astype(np.float32)
    for i in range(steps // 256):
        envs.step(actions[i % 64])
    before = resident_bytes()
    for i in range(steps // 256):
        envs.step(actions[i % 64])
    return float(resident_bytes() - before)


def fetch_pick_and_place(seconds: float) -> float:
    """MuJoCo's FetchPickAndPlace in one environment."""
    import gymnasium_robotics

    gym.register_envs(gymnasium_robotics)
    env = gym.make("FetchPickAndPlace-v4")
    env.reset(seed=0)

    def step(_count: int) -> None:
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        if terminated or truncated:
            env.reset()

    return steps_per_second(1, step, seconds)


def panda_pick_cube(seconds: float) -> float:
    """Envpool's PandaPickCube, 16 environments on one thread."""
    import envpool

    env = envpool.make_gymnasium("PandaPickCube-v1", num_envs=16, num_threads=1, seed=0)
    env.reset()
    random = np.random.default_rng(0)
    shape = (16, *env.action_space.shape)
    return steps_per_second(16, lambda _: env.step(random.uniform(-1, 1, shape)), seconds)


@dataclass(frozen=True)
class Peer:
    """Environments of another package on one thread."""

    packages: tuple[str, ...]
    """Modules that it needs."""
    control_step: float
    """Time that a step simulates (s)."""
    measure: Callable[[float], float]
    """Steps per second, measured for so many seconds."""


PEERS = {
    "FetchPickAndPlace, 1 environment": Peer(
        ("gymnasium_robotics", "mujoco"), 0.04, fetch_pick_and_place
    ),
    "envpool PandaPickCube, 16 environments": Peer(("envpool",), 0.02, panda_pick_cube),
}


def peer(name: str, seconds: float) -> float | str:
    """Steps per second of a peer, or why there is none."""
    for package in PEERS[name].packages:
        if importlib.util.find_spec(package) is None:
            return f"{package} is not installed"
    try:
        return round(PEERS[name].measure(seconds), 1)
    except Exception as error:  # A peer that fails must not take the measurement with it.
        return f"failed: {error!r}"


def write(file: Path | None, figures: dict[str, Any]) -> None:
    """Writes figures and what they were measured on to a file, if there is one."""
    if file:
        file.parent.mkdir(exist_ok=True)
        file.write_text(json.dumps(about_this_run() | figures, indent=1) + "\n")


def main() -> None:
    """Measures, prints, writes."""
    parser = argparse.ArgumentParser(description="Measure environment steps per second.")
    parser.add_argument("--json", type=Path, help="file to write the figures to")
    parser.add_argument("--quick", action="store_true", help="a tenth of the time, fewer sizes")
    parser.add_argument("--infos", action="store_true", help="the cost of SB3's infos alone")
    parser.add_argument("--custom", action="store_true", help="the cost of rules in Python alone")
    arguments = parser.parse_args()
    seconds, cores = (0.3 if arguments.quick else 3.0), os.cpu_count() or 1
    if arguments.custom:
        write(arguments.json, {"custom_n64_1_thread": custom_cost(seconds)})
        return
    if arguments.infos:
        write(arguments.json, {"infos_rigid_1_thread": infos_cost(seconds)})
        return
    sizes = [1, 64] if arguments.quick else [1, 16, 64, 256, 1024]
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
        "growth_steps": 20_000 if arguments.quick else 1_000_000,
    }
    figures["growth_bytes"] = memory_growth(figures["growth_steps"])
    figures["peers_1_thread"] = {name: peer(name, seconds) for name in PEERS}
    for name, value in figures.items():
        if name != "random_actions":
            print(f"{name}: {value}")
    write(arguments.json, figures)


if __name__ == "__main__":
    main()
