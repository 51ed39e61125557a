"""What a sensor reports of an answer of the mechanics API: the channels of the environments."""

from __future__ import annotations

import pickle
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import ruffini
from ruffini import Fem, LinearPad, Press, PressError, Shape, Skin, Surrogate

ROOT = Path(__file__).parents[2]
RADIUS, PLACE = 5e-3, np.array([2e-3, -3e-3])


def press(depth: float, apex: float = 0.0) -> Press:
    """A ball at a place, so deep below the apex."""
    path = [([*PLACE, apex + RADIUS - d], (0, 0, 0, 1)) for d in (0.5 * depth, depth)]
    return Press(Shape.sphere(RADIUS), path)


@pytest.fixture(scope="module")
def model():
    return Surrogate()


@pytest.fixture(scope="module")
def skin(model):
    return Skin(model.body, resolution={"image": (120, 160), "depth": (60, 80)})


@pytest.fixture(scope="module")
def answer(model):
    return model.solve(press(8e-4))[0]


def test_a_pad_at_rest_is_that_of_an_environment():
    names = [name for name in CHANNELS if name != "predicted_error"]
    env = gym.make("ruffini/GraspLift-v0", observation=[*names], objects="sphere").unwrapped
    observation, _ = env.reset(seed=0)
    skin = Skin(Surrogate().body)
    for name in names:
        both = observation[name].reshape(2, -1)
        np.testing.assert_array_equal(skin.read(name).astype(np.float32).ravel(), both[0], name)
    for name, places in env.skin().items():
        np.testing.assert_array_equal(skin.places[name], places)


CHANNELS = {
    "markers": (7, 5, 3),
    "marker_pixels": (7, 5, 2),
    "displacement": None,
    "stress": (12, 10),
    "tet_stress": None,
    "traction": (12, 10, 3),
    "wrench": (6,),
    "slip": (1,),
    "depth": (32, 24),
    "image": (80, 60, 3),
    "predicted_error": (3,),
}


@pytest.mark.parametrize("name", CHANNELS)
def test_channels_have_the_shapes_of_one_finger(name, model, answer):
    found = Skin(model.body).read(name, answer)
    assert CHANNELS[name] in (None, found.shape)
    assert np.isfinite(found).all() and found.any()


def test_channels_are_those_of_the_answer(model, skin, answer):
    np.testing.assert_array_equal(skin.read("wrench", answer), answer.wrench)
    np.testing.assert_array_equal(skin.read("tet_stress", answer), answer.von_mises)
    np.testing.assert_array_equal(skin.read("slip", answer), [answer.sliding])
    np.testing.assert_array_equal(skin.read("predicted_error", answer), answer.predicted_error)
    vertices = model.body.mesh.vertices
    nodes = [np.argmin(np.linalg.norm(vertices - at, axis=1)) for at in skin.places["surface"]]
    np.testing.assert_array_equal(skin.read("displacement", answer), answer.displacement[nodes])


def test_traction_bears_the_force(skin, answer):
    grid = skin.places["grid"].reshape(12, 10, 2)
    area = np.diff(grid[0, :2, 0])[0] * np.diff(grid[:2, 0, 1])[0]
    force = skin.read("traction", answer).sum(axis=(0, 1)) * area
    np.testing.assert_allclose(force, answer.wrench[:3], atol=0.02 * abs(answer.wrench[2]))


def test_the_depth_under_a_ball_is_the_ball(skin, answer):
    apart = np.linalg.norm(skin.places["depth"] - PLACE, axis=1)
    depth, rest = (skin.read("depth", of).ravel() for of in (answer, None))
    bottom = answer.pose[0][2] - np.sqrt(RADIUS**2 - np.minimum(apart, RADIUS) ** 2)
    inside = apart < 1e-3
    assert inside.sum() > 5
    np.testing.assert_allclose(depth[inside], bottom[inside], rtol=0, atol=2e-5)
    assert (depth[inside] < rest[inside] - 4e-4).all()


def test_the_image_changes_where_the_ball_presses_and_is_that_of_finite_elements(skin, answer):
    apart = np.linalg.norm(skin.places["image"] - PLACE, axis=1).reshape(160, 120)
    image, rest = skin.read("image", answer), skin.read("image")
    changed = np.abs(image - rest).max(axis=2)
    assert changed[apart < 2e-3].mean() > 10 * changed[apart > 8e-3].mean()
    around = press(8e-4)
    body = ruffini.sensor("gelsight-mini", resolution=1500, around=around)
    true = Fem(body, friction=1.0).solve(around)[0]
    fine = Skin(body, resolution={"image": (120, 160)}).read("image", true)
    assert np.abs(image - fine).mean() < 0.15 * np.abs(fine - rest).mean()


def test_pads_of_any_model_and_sensor_have_a_skin():
    linear = LinearPad("digit", resolution=600)
    skin = Skin(linear.body, "digit")
    assert repr(skin) == f"<ruffini.Skin of digit, {len(linear.body.mesh.vertices)} nodes>"
    found = skin.read("markers", linear.solve(press(3e-4))[0])
    assert found[..., 2].min() < -2e-5


def test_what_does_not_fit_is_named(model, skin, answer, tmp_path):
    with pytest.raises(ValueError, match="channel: found colour, expected one of markers, "):
        skin.read("colour")
    with pytest.raises(ValueError, match="answer: found 900 nodes and 3528 tetrahedra"):
        Skin(ruffini.sensor("gelsight-mini", resolution=300)).read("markers", answer)
    # The default pads of both sensors have as many nodes and tetrahedra.
    mini, digit = (ruffini.sensor(name) for name in ("gelsight-mini", "digit"))
    assert len(mini.mesh.tets) == len(digit.mesh.tets)
    other = ruffini.Compliance(digit).solve(press(3e-4))[0]
    with pytest.raises(ValueError, match="answer: found one on another mesh, expected one on the"):
        Skin(mini).read("depth", other)
    copy = pickle.loads(pickle.dumps(other))
    with pytest.raises(ValueError, match="answer: found one on another mesh, expected one on the"):
        Skin(mini).read("depth", copy)
    assert Skin(digit, "digit").read("depth", copy).shape == (32, 24)
    with pytest.raises(ValueError, match="answer: found list, expected a Deformation; one of"):
        skin.read("markers", [answer])
    with pytest.raises(ValueError, match="answer: found int, expected a Deformation"):
        skin.read("markers", 3)
    unsolved = model.solve(press(3.9e-3))[0]
    assert isinstance(unsolved, PressError)
    with pytest.raises(PressError, match=str(unsolved)[:20]):
        skin.read("markers", unsolved)
    cube = ruffini.TetMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2, 3]])
    with pytest.raises(ValueError, match="body: found another one, expected the pad of gels"):
        Skin(ruffini.SoftBody(cube, 1e5, 0.45, fixed=[0]))
    with pytest.raises(ValueError, match=r"resolution: found .*colour.*by name .*unknown field"):
        Skin(model.body, resolution={"colour": (3, 3)})
    with pytest.raises(ValueError, match="resolution: found nodes, expected none: they are the b"):
        Skin(model.body, resolution={"nodes": 500})
    with pytest.raises(ValueError, match=r"resolution: found .*, expected counts across and along"):
        Skin(model.body, resolution={"image": object()})
    counts = {"image": (np.int64(6), np.int64(8))}
    assert Skin(model.body, resolution=counts).read("image").shape == (8, 6, 3)
    with pytest.raises(ValueError, match=r"resolution.image: found \[0, 3\], expected 1 to 512"):
        Skin(model.body, resolution={"image": (0, 3)})
    with pytest.raises(ValueError, match=r"found digti, did you mean 'digit'\? expected one of"):
        Skin(model.body, "digti")
    thick = tmp_path / "thick.toml"
    text = (ROOT / "env-core/assets/sensors/gelsight-mini.toml").read_text()
    thick.write_text(text.replace("thickness = 0.004", "thickness = 0.005"))
    for name in ("digit", str(thick)):
        with pytest.raises(ValueError, match="body: found another one, expected the pad of gels"):
            Skin(ruffini.sensor(name, resolution=300), "gelsight-mini")


def test_presses_of_an_environment_give_its_forces():
    env = gym.make("ruffini/HoldStill-v0", objects="sphere", observation=["wrench"]).unwrapped
    assert env.presses() == [None, None]
    env.reset(seed=0)
    for _ in range(5):
        observation, *_ = env.step(np.zeros(5, np.float32))
    model = Surrogate(friction=env.look()["friction"])
    for press, wrench in zip(env.presses(), observation["wrench"].reshape(2, 6), strict=True):
        assert press.history is None and len(press.path) == 1
        found = model.solve(press)[0].wrench
        # The press begins from rest: what friction has built up by sliding is not in it.
        assert found[2] == pytest.approx(wrench[2], rel=0.02) and wrench[2] < -1.0
    body = ruffini.sensor("gelsight-mini", resolution=1500, around=press)
    assert Fem(body, friction=1.0).solve(press)[0].wrench[2] == pytest.approx(wrench[2], rel=0.15)


def test_forces_of_a_stiffer_gel_are_the_press_times_its_stiffness():
    settings = {"objects": "sphere", "observation": ["wrench"], "gel_stiffness": (2.0, 2.0)}
    env = gym.make("ruffini/HoldStill-v0", **settings).unwrapped
    env.reset(seed=0)
    for _ in range(5):
        observation, *_ = env.step(np.zeros(5, np.float32))
    look = env.look()
    assert look["gel_stiffness"] == 2.0
    found = Surrogate(friction=look["friction"]).solve([p for p in env.presses() if p])[0].wrench
    assert 2.0 * found[2] == pytest.approx(observation["wrench"].reshape(2, 6)[0, 2], rel=0.03)


def test_what_does_not_touch_or_is_rigid_has_no_press():
    envs = ruffini.envs.GraspLiftVectorEnv(2)
    envs.reset(seed=0)
    assert envs.call("presses") == ([None, None],) * 2
    assert envs.presses(1) == [None, None]
    with pytest.raises(IndexError):
        envs.presses(2)
    rigid = gym.make("ruffini/HoldStill-v0", tactile="none").unwrapped
    rigid.reset(seed=0)
    assert rigid.presses() == [None, None]
    soft = gym.make("ruffini/GraspSoft-v0").unwrapped
    soft.reset(seed=0)
    assert soft.presses() == [None, None]
