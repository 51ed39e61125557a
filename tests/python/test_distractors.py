"""Objects beside the one to be grasped."""

from __future__ import annotations

import copy
import pickle
import re

import numpy as np
import pytest
from conftest import actions, flat

from ruffini.envs import GraspLiftEnv, GraspLiftVectorEnv

CHANNELS = ["proprio", "object", "properties", "distractors"]
POSE = 9
"""Entries of a pose: position and two columns of the rotation."""


def test_the_object_is_drawn_as_without_distractors():
    alone, beside = GraspLiftEnv(), GraspLiftEnv(distractors=2)
    for seed in range(3):
        first, second = alone.reset(seed=seed)[0], beside.reset(seed=seed)[0]
        assert flat(first).tobytes() == flat(second).tobytes()
        looks = alone.look(), beside.look()
        assert len(looks[1].pop("distractors")) == 2
        assert looks[0] == looks[1]


def test_no_distractors_are_the_default_to_the_bit():
    usual, none = GraspLiftVectorEnv(2), GraspLiftVectorEnv(2, distractors=0)
    first, second = usual.reset(seed=1)[0], none.reset(seed=1)[0]
    assert flat(first).tobytes() == flat(second).tobytes()
    for action in actions(2, 30):
        assert flat(usual.step(action)[0]).tobytes() == flat(none.step(action)[0]).tobytes()
    assert usual.state() == none.state()


def test_the_channel_has_the_pose_of_each_in_the_frame_of_the_wrist():
    env = GraspLiftEnv(distractors=3, observation=CHANNELS, tactile="none")
    observation, _ = env.reset(seed=4)
    look = env.look()
    yaw, tool = look["tool_yaw"], np.array(look["tool_position"])
    turn = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    poses = observation["distractors"].reshape(3, POSE)
    for pose, other in zip(poses, look["distractors"], strict=True):
        np.testing.assert_allclose(pose[:3], turn @ (other["position"] - tool), atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(pose[3:].reshape(2, 3), axis=1), 1, atol=1e-6)
        assert other["mass"] > 0 and other["size"] > 0


@pytest.mark.parametrize("tactile", ["none", "compliance"])
def test_rows_do_not_depend_on_the_batch_and_replay(tactile):
    settings = {
        "distractors": 2,
        "tactile": tactile,
        "observation": [*CHANNELS, "wrench"],
        "resolution": {"nodes": 100},
        "start_height": 0.065,
    }
    wide, narrow = GraspLiftVectorEnv(3, **settings), GraspLiftVectorEnv(1, **settings)
    wide.reset(seed=7), narrow.reset(seed=7)
    acts = actions(3, 30, seed=1)
    for action in acts:
        one, two = wide.step(action), narrow.step(action[:1])
        np.testing.assert_array_equal(flat(one[0])[:1], flat(two[0]))
        assert one[1][0] == two[1][0]
    saved, twins = wide.state(), [copy.deepcopy(wide), pickle.loads(pickle.dumps(wide))]
    fresh = GraspLiftVectorEnv(3, **settings)
    fresh.set_state(saved)
    for action in acts:
        expected = flat(wide.step(action)[0]).tobytes()
        for other in (fresh, *twins):
            assert flat(other.step(action)[0]).tobytes() == expected


def test_a_distractor_that_is_held_is_felt_and_earns_nothing():
    """The hand goes down over a distractor and closes, with the object elsewhere."""
    env = GraspLiftEnv(
        objects="sphere", size=1, distractors=1, position=(-0.05, -0.05), tactile="compliance",
        observation=["proprio", "object", "markers", "wrench", "distractors"],
    )  # fmt: skip
    observation, _ = env.reset(seed=2)
    touched = False
    for _ in range(90):
        place = observation["distractors"][:3]
        across = observation["object"][:2] - observation["distractors"][:2]
        # The fingers close across the line from the distractor to the object.
        yaw = np.arctan2(-across[0], across[1])
        yaw = (yaw + np.pi / 2) % np.pi - np.pi / 2
        over = np.hypot(*place[:2]) < 0.004 and abs(yaw) < 0.1
        down = np.clip(12 * place[2], -1, 1) if over or touched else 0.0
        closing = over and abs(place[2]) < 0.006
        grip = 0.1 if closing or touched else -0.5
        action = [*np.clip(12 * place[:2], -1, 1), down, np.clip(2 * yaw, -1, 1), grip]
        observation, _, terminated, _, info = env.step(np.array(action, np.float32))
        assert not terminated, info
        touched |= bool(closing)
        assert info["reward_terms"]["grasp"] == 0
    wrench = observation["wrench"].reshape(2, 6)
    assert (wrench[:, 2] < -0.5).all(), wrench
    assert np.abs(observation["markers"]).max() > 0


@pytest.mark.parametrize("wrong", [-1, 5, 1.5, "two", [1, 2], True])
def test_a_wrong_number_is_refused(wrong):
    expected = re.escape(", expected a whole number from 0 to 4")
    with pytest.raises(ValueError, match=f"distractors: found .*{expected}"):
        GraspLiftEnv(distractors=wrong)


def test_the_channel_needs_distractors():
    with pytest.raises(ValueError, match="distractors: found 0, expected 1 or more"):
        GraspLiftEnv(observation="distractors")


def test_a_picture_shows_them():
    alone, beside = (
        GraspLiftEnv(distractors=count, render_mode="rgb_array", tactile="none") for count in (0, 2)
    )
    alone.reset(seed=0), beside.reset(seed=0)
    changed = (alone.render() != beside.render()).any(axis=2).mean()
    assert 0.002 < changed < 0.5
    names = set(beside.surfaces())
    assert names == {"object", "distractor_1", "distractor_2"}
