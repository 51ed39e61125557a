"""Time of environment steps, on the clock and of the processor, and memory of the process."""

from __future__ import annotations

import ctypes
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ruffini.envs import GraspLiftVectorEnv
from ruffini.policies import part, scripted

ENV_ID = "ruffini/GraspLift-v0"
FELT = 0.05
"""Force from which a pad counts as touching (N)."""


def make(n: int, threads: int, **settings: Any) -> GraspLiftVectorEnv:
    """N environments on so many threads, reset."""
    rigid = {"tactile": "none"}
    envs = gym.make_vec(ENV_ID, num_envs=n, num_threads=threads, **rigid | settings)
    assert isinstance(envs, GraspLiftVectorEnv)
    envs.reset(seed=0)
    return envs


class Timed(NamedTuple):
    """Result of a call, and the time that it took."""

    result: Any
    processor: float
    """Processor time of all threads (s)."""
    wall: float
    """Time on the clock (s)."""


def timed(function: Callable[..., Any], *arguments: Any) -> Timed:
    """Calls a function once."""
    begun, clock = time.process_time(), time.perf_counter()
    result = function(*arguments)
    return Timed(result, time.process_time() - begun, time.perf_counter() - clock)


def mean_time(
    step: Callable[[int], Any], seconds: float, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Mean time of a `step` (s) over so many seconds of a clock; it is called with its number."""
    done, start = 0, clock()
    while (elapsed := clock() - start) < seconds:
        step(done)
        done += 1
    return elapsed / done


def steps_per_second(n: int, step: Callable[[int], Any], seconds: float) -> float:
    """Rate of `step`, which steps n environments, after a tenth of the time to warm up."""
    mean_time(step, 0.1 * seconds)
    return n / mean_time(step, seconds)


def random_steps(envs: Any, n: int) -> Callable[[int], Any]:
    """Function of a number i that steps n environments with the i-th of 16 random actions."""
    actions = np.random.default_rng(0).uniform(-1, 1, (16, n, 5)).astype(np.float32)
    return lambda i: envs.step(actions[i % 16])


class Step(NamedTuple):
    """A step of a batch, without the time of the policy."""

    observation: dict[str, Any]
    over: NDArray[np.bool_]
    """Rows whose episode ended (N,)."""
    info: dict[str, Any]
    processor: float
    """Processor time (s)."""
    wall: float
    """Time on the clock (s)."""


def scripted_steps(envs: Any, env_id: str) -> Iterator[Step]:
    """Steps of an environment's scripted policy from seed 0 on, without end, in mode NextStep."""
    policy, state = scripted(env_id), None
    observation, _ = envs.reset(seed=0)
    first, over = np.ones(envs.num_envs, bool), np.zeros(envs.num_envs, bool)
    while True:
        action, state = policy.predict(observation, state, first)
        first = over  # The step after an episode's last one begins the next.
        (observation, _, terminated, truncated, info), *took = timed(envs.step, action)
        over = terminated | truncated
        yield Step(observation, over, info, *took)


def touching(observation: dict[str, Any]) -> NDArray[np.bool_]:
    """Pads that touch, (N, 2)."""
    return part(observation, "proprio", "normal force of each pad") > FELT


def resident_bytes() -> int:
    """Memory of this process that is in use."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


class _Malloc(ctypes.Structure):
    """The GNU C library's `struct mallinfo2`."""

    _fields_ = (
        *((name, ctypes.c_size_t) for name in ("arena", "ordblks", "smblks", "hblks", "hblkhd")),
        *((name, ctypes.c_size_t) for name in ("usmblks", "fsmblks", "uordblks", "fordblks")),
        ("keepcost", ctypes.c_size_t),
    )


def allocated_bytes() -> int:
    """Memory that was allocated and not freed, to the byte.

    Other than the memory in use it does not grow while the allocator of each thread still gathers
    what it keeps for later. Python's small objects are counted if PYTHONMALLOC is `malloc`.
    """
    mallinfo = ctypes.CDLL(None).mallinfo2
    mallinfo.restype = _Malloc
    found = mallinfo()
    return int(found.uordblks + found.hblkhd)


def memory_per_environment(n: int = 512, **settings: Any) -> float:
    """Bytes that each of n environments adds after a few steps, if they are the first."""
    before = resident_bytes()
    envs = make(n, 1, **settings)
    for _ in range(10):
        envs.step(np.zeros((n, 5), np.float32))
    return (resident_bytes() - before) / n
