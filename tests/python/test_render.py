"""Pictures: cameras by name and by pose, and the inset of touch beside the scene."""

from __future__ import annotations

import itertools
from functools import partial

import gymnasium as gym
import numpy as np
import pytest

from ruffini._core import CAMERAS
from ruffini.envs import GraspLiftEnv, GraspLiftVectorEnv

SIZE = {"render_mode": "rgb_array", "width": 320, "height": 240}
LIFT, HOLD = "ruffini/GraspLift-v0", "ruffini/HoldStill-v0"
CORNER = {"position": (0.30, -0.42, 0.28), "target": (0, 0, 0.09), "field_of_view": 0.6}


def blue(picture) -> int:
    """Number of pixels of a rigid object."""
    red, green, blue = picture.astype(int).reshape(-1, 3).T
    return int(((blue > green + 20) & (green > red)).sum())


@pytest.mark.parametrize("env_id", [LIFT, HOLD])
def test_every_named_camera_shows_the_object(env_id):
    env = gym.make(env_id, **SIZE).unwrapped
    for seed in range(3):
        env.reset(seed=seed)
        pictures = [env.render(camera) for camera in CAMERAS]
        for k, picture in enumerate(pictures):
            assert blue(picture) > 80, f"{CAMERAS[k]}: {blue(picture)} pixels of the object"
            assert all((np.abs(picture - other) > 0).mean() > 0.2 for other in pictures[:k])


def test_the_default_camera_is_where_its_pose_says():
    env = GraspLiftEnv(**SIZE)
    env.reset(seed=0)
    picture = env.render()
    np.testing.assert_array_equal(env.render("corner"), picture)
    same = GraspLiftEnv(**SIZE | {"width": np.int64(320)})
    same.reset(seed=0)
    np.testing.assert_array_equal(same.render(), picture)
    np.testing.assert_array_equal(env.render(CORNER), picture)
    np.testing.assert_array_equal(env.render({**CORNER, "position": [0.3, -0.42, 0.28]}), picture)


def test_a_camera_of_the_hand_moves_with_it():
    env = GraspLiftEnv(**SIZE, objects="sphere", position=0.0, start=0.0, tactile="none")
    env.reset(seed=0)
    far = {camera: blue(env.render(camera)) for camera in ("front", "palm")}
    for _ in range(15):
        env.step(np.array([0, 0, -1, 0, 0], np.float32))
    assert blue(env.render("palm")) > 1.2 * far["palm"]
    assert blue(env.render("front")) <= 1.02 * far["front"]


def test_a_camera_may_look_straight_down():
    env = GraspLiftEnv(**SIZE, camera={"position": np.array([0, 0, 1]), "target": [0, 0, 0]})
    env.reset(seed=0)
    assert env.render().std() > 10


def test_rows_take_the_camera_of_the_batch_or_another():
    envs = GraspLiftVectorEnv(2, **SIZE, camera="side")
    envs.reset(seed=3)
    env = GraspLiftEnv(**SIZE)
    env.reset(seed=4)
    np.testing.assert_array_equal(envs.render()[1], env.render("side"))
    np.testing.assert_array_equal(envs.picture(1, CORNER), env.render())
    np.testing.assert_array_equal(envs.call("render", camera="palm")[1], env.render("palm"))


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ("wirst", r"camera: found 'wirst', did you mean 'wrist'\? expected one of corner, front"),
        (3, "camera: found 3, expected one of corner, .*, or a mapping with position, target"),
        (None, "camera: found None"),
        ({}, "camera.position: found None, expected three numbers"),
        ({"position": (0, 0, 1)}, "camera.target: found None, expected three numbers"),
        ({**CORNER, "fov": 1}, r"camera: found 'fov', expected position, target, field_of_view"),
        ({**CORNER, "postion": 1}, r"found 'postion', did you mean 'position'\?"),
        ({**CORNER, "target": (0, 0)}, r"camera.target: found \(0, 0\), expected three numbers"),
        ({**CORNER, "target": (0, 0, np.nan)}, "camera.target: found .*, expected three numbers"),
        ({**CORNER, "position": "here"}, "camera.position: found 'here', expected three numbers"),
        ({**CORNER, "target": CORNER["position"]}, "expected another point than the position"),
        ({**CORNER, "field_of_view": 45}, "camera.field_of_view: found 45, expected 0.01 to 3 rad"),
    ],
)
def test_a_camera_that_is_none_is_refused(camera, message):
    with pytest.raises(ValueError, match=message):
        gym.make(LIFT, camera=camera, **SIZE)
    env = GraspLiftEnv(**SIZE)
    env.reset(seed=0)
    if camera is not None:
        with pytest.raises(ValueError, match=message):
            env.render(camera)


def test_a_camera_or_a_row_that_is_none_is_refused_without_a_render_mode():
    env, envs = GraspLiftEnv(tactile="none"), GraspLiftVectorEnv(3, tactile="none")
    for draw in (env.render, envs.render, partial(envs.picture, 0)):
        assert draw() is None and draw("wrist") is None
        with pytest.raises(ValueError, match="found 'wrst', did you mean 'wrist'"):
            draw("wrst")
    for row, of_row in itertools.product(
        (-1, 3, "a", True), (envs.picture, envs.look, envs.surfaces)
    ):
        with pytest.raises(IndexError, match=f"row: found {row!r}, expected 0 to 2"):
            of_row(row)


def ink(picture) -> np.ndarray:
    """Places of the pixels of letters in the corner of the inset, beside its colour bar."""
    corner = picture[8:100, -90:-16]
    return np.argwhere((corner == (40, 40, 48)).all(axis=2))


def test_the_scale_of_the_inset_has_numbers():
    env = gym.make(HOLD, **SIZE, objects="sphere").unwrapped
    env.reset(seed=0)
    env.step(np.zeros(5, np.float32))
    rows = ink(env.render())[:, 0]
    top, bottom = (rows < 20).sum(), (rows > 70).sum()
    assert top > 40 and bottom > 10 and top + bottom == len(rows), f"{top} and {bottom} pixels"


def test_the_inset_shows_a_soft_object():
    env = gym.make("ruffini/GraspSoft-v0", **SIZE, objects="sphere").unwrapped
    env.reset(seed=0)
    assert len(ink(env.render())) == 0
    over = False
    while not over:
        picture = env.render()
        _, _, over, _, _ = env.step(np.array([0, 0, 0, 0, 1], np.float32))
    assert len(ink(picture)) > 50
    # Orange of stress in the middle of the inset.
    red, green, blue = picture[8:90, -90:-20].astype(int).reshape(-1, 3).T
    assert ((red > green + 40) & (green > blue)).sum() > 50
