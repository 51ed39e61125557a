"""InsertPeg: insertion, endings, and settings that are refused."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

from ruffini.policies import part, scripted

ID = "ruffini/InsertPeg-v0"
KNOWN = {"hole_error": 0.0, "hole_yaw_error": 0.0, "peg_offset": 0.0, "peg_tilt": 0.0}
SEEN = {"observation": ["proprio", "wrench", "insertion", "object"]}
TIP = "middle of the peg's tip from the hole's mouth, in the hole's frame"
FORCE = "force of the fixture on the peg, in the hole's frame"
ON_PADS = [f"force, {side} pad" for side in ("−x", "+x")]


def down(env, seconds, aside=0.0, grip=0.0):
    """Goes down until the time is over or the episode ends."""
    for _ in range(int(seconds / 0.04)):
        action = np.array([aside, 0, -1, 0, grip], np.float32)
        observation, _, terminated, _, info = env.step(action)
        if terminated:
            break
    return observation, info


@pytest.mark.parametrize("tactile", ["none", "surrogate"])
@pytest.mark.parametrize("peg", ["square-peg", "round-peg", "hexagonal-peg"])
def test_a_peg_over_its_hole_goes_in_without_a_force(peg, tactile):
    env = gym.make(ID, objects=peg, tactile=tactile, **KNOWN, **SEEN).unwrapped
    observation, _ = env.reset(seed=0)
    tip = part(observation, "insertion", TIP)
    assert abs(tip[:2]).max() < 2e-4 and 1e-3 < tip[2] < 6.5e-3
    observation, info = down(env, 0.9)
    assert info["is_success"] and part(observation, "insertion", TIP)[2] < -0.01
    assert abs(part(observation, "insertion", FORCE)).max() < 1.0


@pytest.mark.parametrize("tactile", ["none", "surrogate"])
def test_a_peg_beside_its_hole_is_felt_and_pressed_too_hard(tactile):
    settings = KNOWN | {"hole_error": 3e-3, "start_grip": 20.0, "friction": 1.0, "mass": 0.05}
    env = gym.make(ID, objects="square-peg", tactile=tactile, **settings, **SEEN).unwrapped
    env.reset(seed=0)
    felt = []
    for _ in range(40):
        observation, _, terminated, _, info = env.step(np.array([0, 0, -0.4, 0, 0], np.float32))
        up = sum(part(observation, "wrench", name)[1] for name in ON_PADS)
        felt.append((up, part(observation, "insertion", FORCE)[2]))
        if terminated:
            break
    assert info["ending"] == "overloaded" and not info["is_success"]
    pads, fixture = np.array(felt).T
    pressed = fixture > 5.0
    # What the fixture bears, and the weight, hang on the pads.
    np.testing.assert_allclose(pads[pressed] + 0.49, fixture[pressed], rtol=0.15)
    assert abs(fixture[:3]).max() == 0.0


@pytest.mark.parametrize(("depth", "ending"), [(4e-3, "wedged"), (1.6e-2, "jammed")])
def test_a_peg_that_is_pushed_aside_in_its_hole_wedges_or_jams(depth, ending):
    settings = KNOWN | {"start_grip": 20.0, "friction": 1.0, "force_limit": 10.0}
    env = gym.make(ID, objects="square-peg", tactile="none", **settings, **SEEN).unwrapped
    observation, _ = env.reset(seed=0)
    while part(observation, "insertion", TIP)[2] > -depth:
        observation, *_ = env.step(np.array([0, 0, -1, 0, 0], np.float32))
    for _ in range(40):
        observation, _, terminated, _, info = env.step(np.array([0, 1, 0, 0, 0], np.float32))
        if terminated:
            break
    assert info["ending"] == ending


def test_a_peg_that_is_let_go_is_dropped():
    env = gym.make(ID, tactile="none", least_grip=0.01, friction=0.1, **KNOWN).unwrapped
    env.reset(seed=0)
    for _ in range(100):
        _, _, terminated, _, info = env.step(np.array([0, 0, 1, 0, -1], np.float32))
        if terminated:
            break
    assert info["ending"] == "dropped"


def test_the_scripted_policy_finds_a_hole():
    policy, state = scripted(ID), None
    envs = gym.make_vec(ID, num_envs=4, hole_error=(1e-3, 1.5e-3), peg_tilt=0.0)
    observation, _ = envs.reset(seed=3)
    best = np.zeros(4, bool)
    for _ in range(149):
        action, state = policy.predict(observation, state)
        observation, *_, info = envs.step(action)
        best |= info["is_success"]
    assert best.sum() >= 3


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"objects": "cup"}, "objects: found cup, expected one of square-peg, round-peg, hexag"),
        (
            {"objects": {"shape": "sphere", "radius": 0.006}},
            "found sphere, radius 0.006 m, expected one of",
        ),
        (
            {"objects": {"shape": "cylinder", "radius": 0.006, "half_height": 0.05}},
            "expected a peg of 0.0514 to 0.0670 m",
        ),
        ({"clearance": 0.0}, "clearance: found 0, expected one number or a rising range [low,"),
        ({"insert_depth": 0.03}, "insert_depth: found 0.03"),
        ({"friction": 0.0}, "friction"),
        ({"hole_error": (2e-3, -2e-3)}, "hole_error"),
    ],
)
def test_what_cannot_be_inserted_is_refused(settings, message):
    settings = (
        settings
        if isinstance(settings.get("objects"), (str, type(None)))
        else settings | {"objects": [settings["objects"]]}
    )
    with pytest.raises(ValueError) as error:
        gym.make(ID, **settings)
    assert message in str(error.value)
