"""Snapshots, pickles and copies go on where the original stood."""

from __future__ import annotations

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from conftest import actions, flat

import ruffini
from ruffini.envs import GraspLiftEnv, GraspLiftVectorEnv
from ruffini.policies import scripted


def follow(envs, acts) -> list[bytes]:
    return [flat(envs.step(action)[0]).tobytes() for action in acts]


FELT = ("sphere", "cuboid")
"""Objects that are held with tactile pads: a round one, and one with edges."""


def held(objects: str, tactile: str) -> GraspLiftVectorEnv:
    """Two environments whose object is in the hand."""
    envs = GraspLiftVectorEnv(2, objects=objects, tactile=tactile)
    observation, _ = envs.reset(seed=1)
    policy = scripted("ruffini/GraspLift-v0")
    for _ in range(55):
        observation, *_ = envs.step(policy.predict(observation)[0])
    return envs


@pytest.mark.parametrize("name", ruffini.OBJECTS)
def test_a_held_object_replays_bit_for_bit(name):
    tactile = "surrogate" if name in FELT else "none"
    envs = held(name, tactile)
    saved = envs.state()
    acts = actions(2, 20, seed=2)
    first = follow(envs, acts)
    envs.set_state(saved)
    assert follow(envs, acts) == first
    fresh = GraspLiftVectorEnv(2, objects=name, tactile=tactile)
    fresh.set_state(saved)
    assert follow(fresh, acts) == first


@pytest.mark.parametrize("twin_of", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_like_the_original(twin_of):
    for env in (GraspLiftEnv(obs="flat"), GraspLiftVectorEnv(1, obs="flat")):
        env.reset(seed=3)
        acts = actions(1, 150, seed=4)
        acts = acts[:, 0] if isinstance(env, GraspLiftEnv) else acts
        follow(env, acts[:10])
        twin = twin_of(env)
        assert follow(twin, acts[10:90]) == follow(env, acts[10:90])
        after, again = env.reset()[0], twin.reset()[0]
        np.testing.assert_array_equal(after, again)


def test_a_state_that_does_not_fit_is_refused_and_changes_nothing():
    env = GraspLiftEnv()
    env.reset(seed=0)
    good = env.state()
    other = GraspLiftEnv(mass=0.1)
    other.reset(seed=0)
    middle = len(good) // 2
    flipped = good[:middle] + bytes([good[middle] ^ 255]) + good[middle + 1 :]
    bad = [b"", b"x" * 100, good[:-1], good[:20], good + b"x", flipped, other.state(), "text", None]
    for state in bad:
        with pytest.raises(ValueError, match="state"):
            env.set_state(state)
    assert env.state() == good
    with pytest.raises(ValueError, match=r"state\[1\]: found str, expected bytes"):
        GraspLiftVectorEnv(2, tactile="none").set_state([good, "text"])


def test_an_environment_that_was_never_reset_has_no_state():
    lift = "ruffini/GraspLift-v0"
    for envs in (gym.make(lift).unwrapped, gym.make_vec(lift, 2)):
        with pytest.raises(ValueError, match=r"^state: found an environment that was never reset"):
            envs.state()
        with pytest.raises(ValueError):
            envs.set_state([b"damaged"] * 2 if hasattr(envs, "num_envs") else b"damaged")
        starts = []
        for _ in range(2):
            envs.reset()
            starts.append(envs.state())
        assert starts[0] != starts[1]


def test_a_state_fits_however_the_environment_was_made():
    made = gym.make("ruffini/GraspLift-v0", max_episode_steps=500).unwrapped
    row = GraspLiftVectorEnv(1)
    row.reset(seed=0)
    acts = actions(1, 120)
    np.testing.assert_array_equal(
        flat(made.set_state(row.state()[0])), flat(row.set_state(row.state()))[0]
    )
    ends = [made.step(action)[3] for action in acts[:, 0]]
    assert not any(ends)
