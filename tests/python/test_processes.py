"""Workers run however they are started, and nothing starts threads before it must."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor

import gymnasium as gym
import numpy as np
import pytest
from fresh import fresh

from ruffini.envs import GraspLiftVectorEnv

CONTEXTS = ["fork", "forkserver", "spawn"]


def work(seed: int) -> bytes:
    """A worker's whole job: make, reset, step on two threads."""
    envs = gym.make_vec("ruffini:ruffini/GraspLift-v0", num_envs=4, num_threads=2, obs="flat")
    envs.reset(seed=seed)
    return envs.step(np.zeros((4, 5)))[0].tobytes()


def in_workers(method: str) -> bytes:
    """Work of two workers that start after this process has stepped."""
    work(0)
    inherited = GraspLiftVectorEnv(4, 2)
    inherited.reset(seed=0)
    inherited.step(np.zeros((4, 5)))
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(method)) as pool:
        return b"".join(pool.map(work, [0, 0]))


@pytest.mark.parametrize("method", CONTEXTS)
def test_workers_run_after_the_parent_has_stepped(method):
    assert fresh(in_workers, method) == 2 * work(0)


def test_a_fresh_session_knows_the_modules_and_imports_none_before_it_is_asked():
    code = (
        "import sys, ruffini; before = 'ruffini.envs' in sys.modules; "
        "print(before, ruffini.envs.GraspLiftEnv.__name__, 'agents' in dir(ruffini), "
        "hasattr(ruffini, 'nothing'))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "GraspLiftEnv", "True", "False"]


INHERITED = GraspLiftVectorEnv(4, 2, obs="flat")


def step_inherited() -> bytes:
    return INHERITED.step(np.zeros((4, 5)))[0].tobytes()


def steps_of_a_child_and_its_parent() -> bytes:
    INHERITED.reset(seed=0)
    step_inherited()
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork")) as pool:
        theirs = pool.submit(step_inherited).result()
    return theirs + step_inherited()


def test_a_forked_child_steps_the_batch_that_its_parent_stepped():
    both = fresh(steps_of_a_child_and_its_parent)
    assert both and both[: len(both) // 2] == both[len(both) // 2 :]


def step_asynchronously(method: str) -> bytes:
    INHERITED.reset(seed=0)
    step_inherited()
    envs = gym.make_vec(
        "ruffini:ruffini/GraspLift-v0",
        num_envs=2,
        vectorization_mode="async",
        vector_kwargs={"context": method},
    )
    observation, _ = envs.reset(seed=0)
    envs.step(np.zeros((2, 5), np.float32))
    envs.close()
    return repr(observation["proprio"].shape).encode()


@pytest.mark.parametrize("method", CONTEXTS)
def test_async_vector_env_runs(method):
    assert fresh(step_asynchronously, method) == b"(2, 14)"


def threads() -> int:
    return len(os.listdir("/proc/self/task"))


def threads_by_stage() -> bytes:
    """Threads that a batch of environments brings when it is made, and when it is reset."""
    before = threads()
    envs = GraspLiftVectorEnv(4, 3)
    made = threads()
    envs.reset(seed=0)
    return bytes([made - before, threads() - before])


@pytest.mark.skipif(not os.path.isdir("/proc/self/task"), reason="counts threads in /proc")
def test_threads_start_with_the_first_step_that_needs_them():
    assert list(fresh(threads_by_stage)) == [0, 3]
