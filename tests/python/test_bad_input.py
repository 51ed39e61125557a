"""Bad input of any kind raises a ``ValueError`` that states what was found and expected.

Of a file that is not there it is a ``FileNotFoundError``.
"""

from __future__ import annotations

import inspect
import math
import sys

import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError

import ruffini
from ruffini import dataset
from ruffini._schema import SETTINGS
from ruffini._words import plain_words
from ruffini.envs import GraspLiftEnv, GraspLiftVectorEnv
from ruffini.policies import scripted

JUNK = [
    None,
    True,
    -1,
    0,
    1e400,
    math.nan,
    -math.inf,
    1e30,
    10**400,
    "",
    "x",
    "sphere",
    b"bytes",
    [],
    {},
    (),
    [1],
    [2, 1],
    [math.nan, 1],
    [-5, 5],
    [1, 2, 3],
    [[1, 2]],
    ["a", "b"],
    {"a": 1},
    {"shape": "sphere"},
    {"shape": "blob", "radius": 1},
    {"shape": "sphere", "radius": -1},
    {"mesh": "none.obj"},
    {"mesh": 3},
    object(),
    lambda: 0,
    np.nan,
    np.array([1.0, np.inf]),
    np.zeros((2, 2)),
    1j,
    {1: 2},
    "\x00",
    "a.stl",
]
NAMES = [*SETTINGS, *GraspLiftVectorEnv._ARGUMENTS, "nonsense", "scene", "reward"]


def outcome(make, *arguments, **keywords) -> str:
    """``"fine"`` or the message of a bad value, name or file; anything else fails the test."""
    try:
        make(*arguments, **keywords)
    except FileNotFoundError as error:
        assert error.filename is not None, error
        return str(error)
    except ValueError as error:
        assert len(str(error)) > 10, error
        return str(error)
    except TypeError as error:
        assert "unexpected keyword argument" in str(error), error
        return str(error)
    return "fine"


def junk(random: np.random.Generator, depth: int = 0):
    """A value that is probably wrong."""
    pick = random.integers(10)
    if pick == 0 and depth < 3:
        return [junk(random, depth + 1) for _ in range(random.integers(4))]
    if pick == 1 and depth < 3:
        return {str(NAMES[random.integers(len(NAMES))]): junk(random, depth + 1)}
    if pick == 2:
        return float(random.normal() * 10.0 ** random.integers(-300, 300))
    return JUNK[random.integers(len(JUNK))]


@pytest.mark.parametrize("count", [300, pytest.param(10_000, marks=pytest.mark.slow)])
def test_bad_settings_are_refused_or_make_an_environment(count):
    random = np.random.default_rng(0)
    refused = 0
    for _ in range(count):
        names = random.choice(NAMES, random.integers(1, 3), replace=False)
        settings = {str(name): junk(random) for name in names}
        # A million rows are allowed, and not what this test is about.
        settings.setdefault("num_envs", 1)
        refused += outcome(GraspLiftVectorEnv, **settings) != "fine"
    assert refused > count / 2, f"only {refused} refused: the junk is too good"


def test_bad_actions_are_refused_and_change_nothing():
    env = GraspLiftEnv(obs="flat")
    envs = GraspLiftVectorEnv(3, obs="flat")
    env.reset(seed=0)
    envs.reset(seed=0)
    before = env.state(), envs.state()
    bad = [*JUNK, np.zeros(4), np.zeros((3, 4)), np.full(5, np.nan), np.full((3, 5), np.inf)]
    bad += [np.zeros((1, 5)), np.zeros((2, 3, 5)), np.array(["a"] * 5), np.zeros(5, complex)]
    for action in bad:
        for step in (env.step, envs.step):
            with np.errstate(all="ignore"):
                try:
                    message = outcome(step, action)
                except np.exceptions.ComplexWarning:
                    message = "a warning is an error here"
            assert message != "fine", action
    assert (env.state(), envs.state()) == before


def test_finite_actions_beyond_float32_count_as_the_nearer_bound():
    env = GraspLiftEnv(obs="flat", tactile="none")
    found = []
    for action in (np.full(5, 1e39), np.ones(5, np.float32), [10**39] * 5, np.full(5, 2.0)):
        env.reset(seed=0)
        found.append(env.step(np.asarray(action, np.float64))[0])
    for other in found[1:]:
        np.testing.assert_array_equal(found[0], other)
    assert "expected finite" in outcome(env.step, np.full(5, np.inf))


@pytest.mark.parametrize(
    ("settings", "parts"),
    [
        ({"mass": (0.2, 0.1)}, ["mass", "[0.2, 0.1]", "rising range"]),
        ({"mass": 2e9}, ["expected one number or a rising range [low, high] within 0.000001 to"]),
        ({"lift_height": 9}, ["lift_height: found 9, expected one number from 0.001 to 1"]),
        (
            {"sensor_errors": {"markers": {"dead": 1.5}}},
            ["sensor_errors.markers.dead: found 1.5, expected one number from 0 to 1"],
        ),
        (
            {"sensor_errors": {"markers": {"delay": 26}}},
            ["sensor_errors.markers.delay: found 26, expected a whole number from 0 to 25"],
        ),
        (
            {"resolution": {"nodes": 4000}},
            ["found 4000, expected 1000, the nodes of the network; ", "take 100 to 20000"],
        ),
        (
            {"objects": "jar-1"},
            ["jar-1 is a solid of ruffini.objects(), whose surface() makes a mesh file"],
        ),
        ({"mass": 1e-4}, ["mass", "0.0001", "40 N"]),
        ({"observation": "taste"}, ["observation", "taste", "proprio, object"]),
        ({"observation": []}, ["observation", "no channel"]),
        ({"objects": "pear"}, ["object", "pear", "sphere, cuboid"]),
        ({"objects": "pear.ply"}, ["mesh file: found pear.ply", ".obj or .stl"]),
        (
            {"tactile": "none", "observation": "predicted_error"},
            ["observation", 'predicted_error needs tactile="surrogate"'],
        ),
        ({"objects": [{"shape": "sphere"}]}, ["objects", "missing field `radius`"]),
        ({"objects": [{"shape": "sphere", "radius": 0.3}]}, ["objects", "0.6", "opening of 0.08"]),
        ({"gripper": {"max_force": -1}}, ["gripper.max_force", "-1", "0.01 to 200"]),
        ({"gripper": {"colour": 1}}, ["gripper", "colour", "pad_width"]),
        ({"physics": {"time_step": 0.003}}, ["physics.time_step", "whole number of steps"]),
        ({"physics": {"iterations": 3}}, ["physics.iterations", "3", "4 or more"]),
        ({"reward_weights": {"reach": -1}}, ["reward", "-1", "0 to 1e6"]),
        ({"size": 1.0, "mass": math.nan}, ["mass: found nan", "finite numbers"]),
        ({"obs": "image"}, ["obs", "image", "'dict' or 'flat'"]),
        ({"nonsense": 1}, ["nonsense", "mass"]),
        ({"width": 5}, ["width", "5", "16 to 4096"]),
        ({"max_episode_steps": 0}, ["max_episode_steps", "0", "1 to 1000000"]),
        ({"max_episode_steps": "x"}, ["found 'x', expected a whole number from 1"]),
        ({"sensor_errors": {"markers": 3}}, ["markers: found integer `3`, expected a mapping"]),
        (
            {"sensor_errors": {"markers": {"noise": {"markers": 1e-5}}}},
            ["sensor_errors.markers.noise: found markers, expected one number or a rising"],
        ),
        (
            {"observation": "wrench", "sensor_errors": {"wrench": {"gain": {"force": [1, 2, 3]}}}},
            ["sensor_errors.wrench.gain: found [1,2,3] for force, expected one number or a"],
        ),
        ({"gripper": {"max_force": "x"}}, ['max_force: found string "x", expected a number']),
        ({"friction": (0.5, 5)}, ["friction: found [0.5, 5.0], expected up to 4 with tactile"]),
    ],
)
def test_a_message_names_the_setting_what_was_found_and_what_was_expected(settings, parts):
    message = outcome(GraspLiftEnv, **settings)
    for part in parts:
        assert part in message, message


TETRAHEDRON = "v 0 0 0\nv 20 0 0\nv 0 20 0\nv 0 0 20\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.mark.parametrize(
    ("settings", "found", "near"),
    [
        ({"frction": 0.5}, "'frction'", "friction"),
        ({"observation": "Proprio"}, "observation: found Proprio", "proprio"),
        ({"observation": ["proprio", "marker"]}, "observation: found marker", "markers"),
        ({"tactile": "surogate"}, "tactile: unknown variant `surogate`", "surrogate"),
        ({"objects": ["cup", "shpere"]}, 'object: found "shpere"', "sphere"),
        ({"objects": {"shape": "shpere"}}, "objects[0]: unknown variant `shpere`", "sphere"),
        (
            {"objects": {"shape": "sphere", "radus": 1}},
            "objects[0]: unknown field `radus`",
            "radius",
        ),
        (
            {"objects": {"mesh": "a.stl", "scal": 1}},
            "objects[0]: unknown field `scal`",
            "scale",
        ),
        ({"sensor": "gelsight"}, "sensor: found gelsight", "gelsight-mini"),
        ({"material": "tacflx"}, "material: found tacflx", "tacflex"),
        ({"material": "feat"}, "material: found feat", "feats"),
        ({"material": {"yung": 1e5}}, "material: unknown field `yung`", "young"),
        ({"gripper": {"max_forc": 3}}, "gripper.max_forc: unknown field `max_forc`", "max_force"),
        ({"reward_weights": {"lft": 3}}, "reward_weights: found lft", "lift"),
        ({"sensor_errors": {"marker": {}}}, "sensor_errors: found marker", "markers"),
        (
            {"sensor_errors": {"markers": {"nois": 3}}},
            "sensor_errors.markers.nois: unknown field `nois`",
            "noise",
        ),
        (
            {"observation": "wrench", "sensor_errors": {"wrench": {"drift": {"torqe": 1e-4}}}},
            "sensor_errors.wrench.drift: found torqe",
            "torque",
        ),
        ({"resolution": {"marker": 3}}, "resolution.marker: unknown field `marker`", "markers"),
        (
            {"physics": {"iteration": 8}},
            "physics.iteration: unknown field `iteration`",
            "iterations",
        ),
        ({"workspace": {"lo": 3}}, "workspace.lo: unknown field `lo`", "low"),
    ],
)
def test_the_nearest_known_word_is_named(settings, found, near):
    message = outcome(GraspLiftEnv, **settings)
    assert f"{found}, did you mean {near!r}? expected " in message, message


def test_arguments_of_the_constructor_are_among_the_known_words():
    for make in (GraspLiftEnv, GraspLiftVectorEnv):
        own = inspect.signature(make).parameters.values()
        own = [each.name for each in own if each.kind is each.POSITIONAL_OR_KEYWORD]
        assert f"expected one of {', '.join(own)}, mass, " in outcome(make, nonsense=1)
        assert "clearance" not in outcome(make, nonsense=1), "a setting of another task"
    for name, near in (("num_thread", "num_threads"), ("nenvs", "num_envs"), ("with", "width")):
        assert f"{name!r}, did you mean {near!r}?" in outcome(GraspLiftVectorEnv, **{name: 3})
    many = outcome(GraspLiftVectorEnv, num_threads=1025)
    assert many == "num_threads: found 1025, expected a whole number from 1 to 1024"
    assert "'env_kwargs', expected one of num_envs" in outcome(GraspLiftVectorEnv, env_kwargs={})


def test_the_nearest_known_word_is_named_elsewhere(tmp_path):
    assert "did you mean 'NextStep'?" in outcome(GraspLiftVectorEnv, autoreset_mode="next-step")
    assert "did you mean 'ruffini/" in outcome(scripted, "ruffini/GraspLft-v0")
    config = tmp_path / "a.toml"
    for text, near in (("truth_noodes = 3\n", "truth_nodes"), ("[[gels]]\nyoug = 1e5\n", "young")):
        config.write_text(text)
        assert f"did you mean {near!r}?" in outcome(dataset.shards, config)
    mesh = ruffini.TetMesh.of_shape(ruffini.Shape.sphere(1e-2), spacing=5e-3)
    for ask, near in (
        (lambda: ruffini.SoftBody(mesh, 1e5, 0.3, law="neohookean"), "neo-hookean"),
        (lambda: ruffini.sensor("gelsight-mimi"), "gelsight-mini"),
        (lambda: ruffini.LinearPad("digti"), "digit"),
        (lambda: ruffini.Surrogate(calibration="feat"), "feats"),
    ):
        assert f", did you mean {near!r}? expected " in outcome(ask)
    for ask in (dataset.estimate, dataset.generate):
        assert "`objcts`, did you mean 'objects'?" in outcome(ask, tmp_path / "out", objcts=2)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "message",
    [
        "load: found 1, expected nothing: GraspLift has no such setting",
        "observation: found proprio, expected one or more of proprio, object, each once",
        "actions: found shape (4,), expected (5,)",
        "mass: found x, expected one or two finite numbers",
    ],
)
def test_a_message_about_something_else_stays_as_it_is(message):
    assert plain_words(message) == message


def test_a_mesh_of_ones_own_can_be_grasped(tmp_path):
    file = tmp_path / "part.obj"
    file.write_text(TETRAHEDRON)
    env = GraspLiftEnv(objects={"mesh": file, "scale": 0.001, "centred": True})
    env.reset(seed=0)
    assert env.look()["object"] == str(file)
    assert outcome(GraspLiftEnv, objects=[str(file)]).startswith("mesh size: found 20")


def test_a_mesh_beside_its_origin_is_refused_or_centred(tmp_path):
    file = tmp_path / "part.obj"
    vertices, faces = ruffini.Shape.named("cuboid").surface()
    for share, sound in ((0.0, True), (0.2, True), (0.5, False), (30.0, False)):
        moved = vertices + np.array([0.0, 0.0, share * np.ptp(vertices[:, 2])])
        lines = [f"v {x} {y} {z}" for x, y, z in moved]
        lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
        file.write_text("\n".join(lines))
        said = outcome(GraspLiftEnv, objects=str(file))
        assert (said == "fine") if sound else said.startswith(f"mesh origin: found {file} around")
        env = GraspLiftEnv(objects={"mesh": file, "centred": True}, position=0.0, size=1)
        env.reset(seed=0)
        height = env.look()["object_position"][2]
        assert abs(height - 0.5 * np.ptp(vertices[:, 2])) < 1e-3


def test_a_shape_of_ones_own_is_described_in_words():
    env = GraspLiftEnv(objects={"shape": "cuboid", "half_extents": [0.02, 0.01, 0.03]})
    env.reset(seed=0)
    assert env.look()["object"] == "cuboid, half extents 0.02 × 0.01 × 0.03 m"


def test_an_object_may_have_rounded_edges():
    block = {"shape": "cuboid", "half_extents": [0.02, 0.01, 0.03]}
    env = GraspLiftEnv(objects=block | {"edge_radius": 0.001})
    env.reset(seed=0)
    words = "cuboid, edge radius 0.001 m, half extents 0.02 × 0.01 × 0.03 m"
    assert env.look()["object"] == words
    assert "expected less than half" in outcome(GraspLiftEnv, objects=block | {"edge_radius": 0.01})
    ball = {"shape": "sphere", "radius": 0.02, "edge_radius": 0.001}
    assert "unknown field `edge_radius`" in outcome(GraspLiftEnv, objects=ball)


def test_what_makes_a_large_object_fit_is_named(tmp_path):
    file = tmp_path / "part.obj"
    file.write_text(TETRAHEDRON)
    assert "millimetres needs the scale 0.001" in outcome(GraspLiftEnv, objects=[str(file)])
    large = outcome(GraspLiftEnv, objects={"shape": "sphere", "radius": 0.05})
    assert "the setting size scales it, here below 0.80" in large


def test_an_object_too_small_to_be_grasped_is_a_wrong_unit(tmp_path):
    file = tmp_path / "part.obj"
    file.write_text(TETRAHEDRON)
    part = {"mesh": str(file), "scale": 1e-5, "centred": True}
    small = outcome(GraspLiftEnv, objects=part)
    assert "0.180 mm along its longest side, expected 2 mm or more" in small
    assert "scale is the length of a mesh file's unit" in small


def test_a_closed_environment_says_so():
    env, envs = GraspLiftEnv(tactile="none"), GraspLiftVectorEnv(2, tactile="none")
    env.reset(seed=0)
    envs.reset(seed=0)
    for each in (env, envs):
        action = each.action_space.sample()
        each.close()
        each.close()
        with pytest.raises(ClosedEnvironmentError, match="step: found a closed environment"):
            each.step(action)
        with pytest.raises(ClosedEnvironmentError, match="reset: found a closed environment"):
            each.reset()


def test_a_closed_environment_is_of_no_use_and_holds_no_memory():
    env, envs = (
        GraspLiftEnv(tactile="none", render_mode="rgb_array"),
        GraspLiftVectorEnv(2, tactile="none", render_mode="rgb_array"),
    )
    for each in (env, envs):
        each.reset(seed=0)
        state, batch = each.state(), each._batch
        each.close()
        assert sys.getrefcount(batch) <= 2, "the environment holds its batch"
        for name, *arguments in (
            ("render",),
            ("state",),
            ("set_state", state),
            *(("look",), ("plan",), ("skin",), ("channels",), ("surfaces",)),
        ):
            with pytest.raises(ClosedEnvironmentError, match=f"^{name}: found a closed env"):
                getattr(each, name)(*arguments)


def test_unknown_options_of_a_reset_are_refused_with_the_nearest_word():
    env, envs = GraspLiftEnv(tactile="none"), GraspLiftVectorEnv(2, tactile="none")
    env.reset(seed=0, options={})
    with pytest.raises(ValueError, match="'sed', expected none; did you mean 'seed', an argument"):
        env.reset(options={"sed": 3})
    with pytest.raises(ValueError, match="expected none; it is a setting of the environment"):
        env.reset(options={"friction": 0.3})
    for name in ("mass", "x", "object"):
        with pytest.raises(ValueError, match=r"a start is chosen by the method `draw` of a ruff"):
            env.reset(options={name: 0})
    with pytest.raises(ValueError, match="did you mean 'reset_mask', an option"):
        envs.reset(options={"reset_msk": np.ones(2, bool)})


def test_terms_of_the_reward_have_no_negative_zero():
    env = GraspLiftEnv(tactile="none")
    for seed in range(3):
        env.reset(seed=seed)
        for _ in range(5):
            *_, info = env.step(np.zeros(5, np.float32))
            assert all(math.copysign(1, term) > 0 for term in info["reward_terms"].values())


def test_channels_print_as_a_table():
    env = GraspLiftEnv(tactile="none")
    head, *rows = str(env.channels()).splitlines()
    assert head.split() == ["channel", "component", "numbers", "from", "to", "unit"]
    assert len(rows) == sum(len(components) for _, components in env.channels())
    assert rows[0].startswith(env.channels()[0][0])


@pytest.mark.parametrize("name", ["part.obj", "part.stl", "part.OBJ", "part.ply", "part"])
def test_bad_mesh_files_are_refused(tmp_path, name):
    random = np.random.default_rng(0)
    good = TETRAHEDRON.encode()
    files = [b"", b"\x00" * 100, b"solid\n", good[:40], good[:-12], good.replace(b"4", b"9")]
    files += [good.replace(b"20", b"nan"), good.replace(b"20", b"0"), b"f 1 2 3\n" * 1000]
    files += [b"v 1e308 1e308 1e308\n" * 3 + b"f 1 2 3\n", b"\xff" * 84 + b"\x00" * 50]
    files += [random.bytes(int(random.integers(1, 400))) for _ in range(150)]
    file = tmp_path / name
    for content in files:
        file.write_bytes(content)
        assert outcome(GraspLiftEnv, objects=[{"mesh": str(file)}]) != "fine", content
    file.unlink()
    assert str(file) in outcome(GraspLiftEnv, objects=[{"mesh": str(file)}])
    file.mkdir()
    assert outcome(GraspLiftEnv, objects=[{"mesh": str(file)}]) != "fine"


def test_seeds_and_masks_are_checked():
    envs = GraspLiftVectorEnv(2)
    for seed in (-1, [1], [1, 2, 3], [1, "a"], [-1, 0], ["a", "b"], [1.5, 2], 1.5, 2**64, "7"):
        with pytest.raises(ValueError, match="seed"):
            envs.reset(seed=seed)
    with pytest.raises(ValueError, match="seed"):
        GraspLiftEnv().reset(seed=-1)
    with pytest.raises(ValueError, match="options"):
        envs.reset(options=[1])
    envs.reset(seed=[3, None])
    for mask in ([True, False], np.ones(3, bool), np.ones(2), np.zeros(2, bool), "ab", 5):
        with pytest.raises(ValueError, match="reset_mask"):
            envs.reset(options={"reset_mask": mask})


def test_a_step_before_a_reset_is_refused():
    with pytest.raises(ValueError, match="a reset before it"):
        GraspLiftVectorEnv(2).step(np.zeros((2, 5)))
    with pytest.raises(ValueError, match="a row that was reset"):
        GraspLiftEnv(render_mode="rgb_array").render()
