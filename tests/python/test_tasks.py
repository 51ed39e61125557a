"""The tasks beyond GraspLift: specifications, seeds, batches, endings, plans and policies."""

from __future__ import annotations

import pickle
import re
from typing import Any, get_args, get_type_hints

import gymnasium as gym
import numpy as np
import pytest
from conftest import IDS, MODES, NEEDED, actions, flat

import ruffini.envs
from ruffini._schema import ENDINGS, SETTINGS, TASKS
from ruffini._settings import Range, Settings
from ruffini.evaluation import evaluate
from ruffini.policies import part, scripted

FRAGILE, HOLD = "ruffini/GraspFragile-v0", "ruffini/HoldStill-v0"
SOFT: dict[str, Any] = NEEDED[FRAGILE]
SQUEEZE = "ruffini/GraspSoft-v0"
BALL = {"objects": "sphere", "position": 0.0}
CASES = [(FRAGILE, SOFT), (HOLD, {}), (HOLD, SOFT), (SQUEEZE, NEEDED[SQUEEZE])]


def grasping(step: int, grip: float) -> np.ndarray:
    """Down to the object, close, stay."""
    if step < 7:
        return np.array([0, 0, -0.9, 0, -0.2], np.float32)
    return np.array([0, 0, 0, 0, grip], np.float32)


@pytest.mark.parametrize("env_id", IDS)
def test_every_id_is_made_by_all_three_forms_and_says_what_it_is(env_id):
    settings = NEEDED.get(env_id, {})
    name = env_id.split("/")[1].removesuffix("-v0")
    single, vector = (getattr(ruffini.envs, f"{name}{kind}") for kind in ("Env", "VectorEnv"))
    assert type(gym.make(env_id, **settings).unwrapped) is single
    assert type(gym.make(f"ruffini:{env_id}", **settings).unwrapped) is single
    assert type(gym.make_vec(env_id, num_envs=2, **settings)) is vector
    for heading in ("Action", "Observation", "Reward", "Start", "End", "Settings"):
        assert f"## {heading}" in single.__doc__
    assert "{" + "terms}" not in single.__doc__


@pytest.mark.parametrize("task", TASKS)
def test_a_docstring_has_every_term_channel_and_setting_with_its_default(task):
    described, text = TASKS[task], getattr(ruffini.envs, f"{task}Env").__doc__
    for term in described["terms"]:
        assert f"| ``{term['name']}`` | {term['weight']} |" in text
    for channel in described["channels"]:
        assert f"| ``{channel['name']}`` |" in text
    usual = {setting["name"]: setting["default"] for setting in TASKS["GraspLift"]["settings"]}
    for setting in described["settings"]:
        if task == "GraspLift" or usual.get(setting["name"]) != setting["default"]:
            assert f"| ``{setting['name']}`` |" in text
    _, _, table = text.partition("## Settings")
    for row in re.findall(r"^ *\| ``(.+) \|$", table, re.MULTILINE):
        cells = row.split(" | ")
        assert len(cells) == 5 and all(cells), row


def test_channels_are_all_that_environments_accept():
    accepted = set()
    for env_id in IDS:
        with pytest.raises(ValueError, match="observation: found nothing, expected one") as refusal:
            gym.make(env_id, observation="nothing")
        names = str(refusal.value).partition("one or more of ")[2].removesuffix(", each once")
        accepted |= {*names.split(", ")}
    assert accepted == {*ruffini.CHANNELS}
    assert len(ruffini.CHANNELS) == len(accepted)
    assert {"squeeze", "insertion", *ruffini.TACTILE_CHANNELS} <= accepted


def test_the_first_docstring_has_every_setting_and_every_entry_of_one():
    text, settings = ruffini.envs.GraspLiftEnv.__doc__, set(get_type_hints(Settings))
    named = set(re.findall(r"^ *\| ``(\w+)[\w.]*`` \|", text, re.MULTILINE))
    own = {each["name"] for task in TASKS.values() for each in task["settings"]}
    shared = {each["name"] for each in TASKS["GraspLift"]["settings"]}
    assert settings - (own - shared) <= named
    for entry in ("gripper.max_force", "workspace.low", "physics.gravity", "resolution.image"):
        assert f"| ``{entry}`` |" in text


def test_type_checkers_know_the_settings_that_rust_has():
    types = get_type_hints(Settings)
    assert set(types) == set(SETTINGS)
    kinds = {each["name"]: each["kind"] for task in TASKS.values() for each in task["settings"]}
    for name, kind in kinds.items():
        assert types[name] == {"range": Range, "number": float, "count": int}[kind], name
    [tactile] = (each for each in TASKS["GraspLift"]["others"] if each["name"] == "tactile")
    assert list(get_args(types["tactile"])) == re.findall(r'"(\w+)"', tactile["range"])


def test_parts_of_observations_go_by_name():
    env = gym.make("ruffini/GraspLift-v0", tactile="none").unwrapped
    observation, _ = env.reset(seed=0)
    for channel, components in env.channels():
        if channel == "properties":
            continue
        found = [part(observation, channel, name) for name, *_ in components]
        joined = np.concatenate([np.atleast_1d(values) for values in found])
        np.testing.assert_array_equal(joined, observation[channel])
    with pytest.raises(KeyError, match="colour"):
        part(observation, "proprio", "colour")


def test_parts_of_what_pads_feel_go_by_name_too():
    felt = {"observation": ["wrench", "slip"], "tactile": "compliance"}
    env = gym.make("ruffini/GraspLift-v0", **felt).unwrapped
    observation = {"wrench": np.arange(12.0), "slip": np.arange(2.0)}
    found = part(observation, "wrench", "force, +x pad", env.channels())
    np.testing.assert_array_equal(found, [6, 7, 8])
    slides = "share of the normal force where the pad slides, +x pad: 1"
    assert part(observation, "slip", slides, env.channels()) == 1
    with pytest.raises(KeyError, match=r"did you mean 'force, \+x pad"):
        part(observation, "wrench", "force, x pad", env.channels())


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("env_id", "settings"), CASES)
def test_a_row_equals_the_single_environment_bit_for_bit(env_id, settings, mode):
    # Ten steps an episode, and a grip that drops one object and not the other.
    rows, settings = 2, settings | {"objects": "sphere", "max_episode_steps": 10}
    acts = np.stack([[grasping(step % 11, 0.4), grasping(step % 11, -0.2)] for step in range(24)])
    envs = gym.make_vec(env_id, num_envs=rows, autoreset_mode=mode, **settings)
    first, _ = envs.reset(seed=3)
    for row in range(rows):
        alone = gym.make(env_id, disable_env_checker=True, **settings).unwrapped
        observation, _ = alone.reset(seed=3 + row)
        np.testing.assert_array_equal(flat(first)[row], flat(observation))
    singles = [type(alone)(**settings) for _ in range(rows)]
    over = np.zeros(rows, bool)
    for row, env in enumerate(singles):
        env.reset(seed=3 + row)
    for action in acts:
        seen, reward, terminated, truncated, _ = envs.step(action)
        for row, env in enumerate(singles):
            if over[row] and mode == "NextStep":
                ours = flat(env.reset()[0]), 0.0, False, False
            else:
                observation, *rest, _ = env.step(action[row])
                ours = flat(observation), *rest
                if mode == "SameStep" and (rest[1] or rest[2]):
                    ours = flat(env.reset()[0]), *rest
            np.testing.assert_array_equal(flat(seen)[row], ours[0])
            assert (reward[row], terminated[row], truncated[row]) == ours[1:]
        over = terminated | truncated
        if mode == "Disabled" and over.any():
            envs.reset(options={"reset_mask": over})
            for row in np.flatnonzero(over):
                singles[row].reset()


@pytest.mark.parametrize(("env_id", "settings"), CASES)
def test_a_reset_forgets_and_a_copy_goes_on(env_id, settings):
    settings = settings | {"objects": "sphere"}
    used, fresh = (gym.make(env_id, **settings).unwrapped for _ in range(2))
    used.reset(seed=2)
    steps, grip = (range(12), 0.1) if env_id == FRAGILE else (range(7, 12), 0.5)
    for step in steps:
        used.step(grasping(step, grip))
    copy = pickle.loads(pickle.dumps(used))
    for step in range(12, 16):
        ours, theirs = (flat(env.step(grasping(step, grip))[0]) for env in (used, copy))
        np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(flat(used.reset(seed=4)[0]), flat(fresh.reset(seed=4)[0]))
    assert used.state() == fresh.state()


def test_too_much_stress_ends_the_episode_by_name_and_the_limit_is_drawn():
    # Of touch, only the limit asks for stress.
    env = gym.make(FRAGILE, **SOFT, observation=["proprio", "stress_limit"]).unwrapped
    limits = set()
    for seed in range(3):
        observation, _ = env.reset(seed=seed)
        limit = env.look()["stress_limit"]
        assert observation["stress_limit"][0] == np.float32(limit)
        limits.add(limit)
        for _ in range(60):
            _, _, terminated, _, info = env.step(np.array([0, 0, 0, 0, 1], np.float32))
            if terminated:
                break
        assert info["ending"] == "stress_exceeded"
        assert not info["is_success"]
    assert len(limits) == 3


def test_a_fragile_grip_changes_by_its_rate_and_a_hand_that_lets_go_has_dropped():
    env = gym.make(FRAGILE, **SOFT, grip_rate=5.0, start_grip=0.5, least_grip=0.5).unwrapped
    env.reset(seed=0)
    for step in range(1, 4):
        observation, *_ = env.step(np.array([0, 0, 0, 0, 0.5], np.float32))
        grip = part(observation, "proprio", "grip force command")
        np.testing.assert_allclose(grip, 0.5 * np.exp(0.1 * step), rtol=1e-6)
    for _ in range(60):
        # Up with a grip that holds nothing.
        _, _, terminated, _, info = env.step(np.array([0, 0, 1, 0, -1], np.float32))
        if terminated:
            break
    assert info["ending"] == "dropped"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"safety_factor": 10.0}, "safety_factor: found 10, a grip of .* N on .*, expected 20 N"),
        ({"safety_factor": 0.5}, "safety_factor: found 0.5, expected one number from 1 to 100"),
        ({"margin": (2.0, 1.0)}, "margin: found"),
        ({"start_grip": 21.0}, "start_grip: found 21"),
        ({"grip_rate": 0.0}, "grip_rate: found 0"),
        ({"friction": 0.0}, "safety_factor: found"),
        ({"slip_limit": 1e-3}, "slip_limit: found .*: GraspFragile has no such setting"),
        ({"yaw": 0.3}, "yaw: found 0.3, expected nothing: GraspFragile has no such setting"),
    ],
)
def test_settings_that_no_fragile_grasp_has_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        gym.make(FRAGILE, **SOFT, **settings)


def gripping(observation: dict, force: float) -> np.ndarray:
    """The grip on its way to `force` (N), which an action multiplies by e^0.4 at most."""
    change = np.log(force / part(observation, "proprio", "grip force command")) / 0.4
    return np.array([0, 0, 0, 0, np.clip(change, -1, 1)], np.float32)


def test_a_softer_object_is_deformed_more_by_the_same_force():
    felt = {}
    for young in (4e4, 1.2e5):
        env = gym.make(SQUEEZE, **BALL, young=young, mass=0.04, friction=0.8).unwrapped
        observation, _ = env.reset(seed=0)
        assert not observation["squeeze"].any()
        assert env.look()["young"] == young
        for _ in range(40):
            observation, _, terminated, _, info = env.step(gripping(observation, 0.6))
            assert not terminated, info
        pressed = part(observation, "proprio", "normal force of each pad")
        np.testing.assert_allclose(pressed, 0.6, rtol=0.1)
        felt[young] = observation["squeeze"]
    # Between the depth of the contacts, which by Hertz goes as (F/E)^(2/3), and the bulk, as F/E.
    ratio = felt[4e4][0] / felt[1.2e5][0]
    assert 3 ** (2 / 3) < ratio < 3, f"{ratio} times the deformation of a third of the stiffness"


def test_a_squeezed_object_resists_with_the_force_that_its_model_says():
    env = gym.make(SQUEEZE, **BALL, young=6e4, friction=0.8).unwrapped
    observation, _ = env.reset(seed=0)
    for _ in range(40):
        observation, *_ = env.step(gripping(observation, 0.6))
    state = env.look()
    assert 0 < observation["squeeze"][2] < observation["squeeze"][1] < state["stress_limit"]
    # The same squeeze, asked of the model: a ball of 18 mm that stands on the table between faces.
    finger = ruffini.Shape.cuboid([0.020_75 / 2, 0.025_25 / 2, 0.006])
    away = state["opening"] / 2 + 0.006
    turned = (
        ((away, 0, 0), (0, -(0.5**0.5), 0, 0.5**0.5)),
        ((-away, 0, 0), (0, 0.5**0.5, 0, 0.5**0.5)),
    )
    model = ruffini.SoftSurrogate(ruffini.Shape.sphere(0.018), young=6e4, friction=0.8)
    (answer,) = model.solve(ruffini.Press([finger, finger], [list(turned)]))
    force = -answer.contact_force[model.body.mesh.vertices[:, 0] > 0, 0].sum()
    pressed = part(observation, "proprio", "normal force of each pad")
    np.testing.assert_allclose(pressed, 0.6, rtol=0.05)
    np.testing.assert_allclose(pressed, force, rtol=0.05)


def test_crushing_ends_the_episode_by_name():
    env = gym.make(SQUEEZE, **BALL, young=3e4).unwrapped
    env.reset(seed=0)
    for _ in range(60):
        _, _, terminated, _, info = env.step(np.array([0, 0, 0, 0, 1], np.float32))
        if terminated:
            break
    assert info["ending"] == "stress_exceeded"
    assert info["reward_terms"]["gentle"] == 0
    assert not info["is_success"]


def test_gentleness_is_paid_for_while_lifting_alone():
    env = gym.make(SQUEEZE, **BALL, young=6e4, mass=0.03, friction=0.9).unwrapped
    observation, _ = env.reset(seed=0)
    paid = []
    for step in range(45):
        action = gripping(observation, 0.6)
        action[2] = 0.5 if step >= 25 else 0.0
        observation, _, terminated, _, info = env.step(action)
        assert not terminated, info
        paid.append(info["reward_terms"]["gentle"])
    assert observation["squeeze"][1] > 0
    assert max(paid[:25]) < 0.02 and 0.2 < paid[-1] < 1, paid


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"tactile": "fem"}, "tactile: found .*fem.*, expected surrogate"),
        ({"size": 1.1}, "size: found .*, expected 1"),
        ({"young": 0.0}, "young: found 0, expected one number or a rising range"),
        ({"crush": 2.0}, "crush: found 2, expected"),
        ({"observation": "markers"}, "observation: found markers"),
        ({"load": 1.0}, "load: found .*: GraspSoft has no such setting"),
    ],
)
def test_settings_that_no_soft_object_has_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        gym.make(SQUEEZE, **settings)


def test_a_wall_that_is_too_thin_to_be_squeezed_is_told_by_file_and_thickness(tmp_path):
    file = tmp_path / "cup.obj"
    vertices, faces = ruffini.Shape.cup(0.018, 0.018, 0.025, 0.0008).surface()
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
    file.write_text("\n".join(lines))
    said = r"objects: found \S+cup.obj, a wall (\S+) mm thick, expected (\S+) mm or more everywhere"
    with pytest.raises(ValueError, match=said) as error:
        gym.make(SQUEEZE, objects=str(file))
    thickness, least = map(float, re.search(said, str(error.value)).groups())
    assert 0.75 < thickness < 0.81 < 1.0 < least
    named = {"shape": "cup", "bottom": 0.018, "rim": 0.018, "half_height": 0.025, "wall": 0.0008}
    with pytest.raises(ValueError, match=r"objects: found cup, .* a wall 0.80 mm thick"):
        gym.make(SQUEEZE, objects=named)


def test_the_picture_shows_the_squeezed_object():
    env = gym.make(SQUEEZE, **BALL, young=6e4, render_mode="rgb_array").unwrapped
    observation, _ = env.reset(seed=0)
    stressed = []
    for steps in (0, 30):
        for _ in range(steps):
            observation, *_ = env.step(gripping(observation, 2.0))
        red, green, blue = env.render().reshape(-1, 3).astype(int).T
        # Between the cream of an object at rest and the orange of the fingers.
        stressed.append(((red > green + 25) & (green > blue + 25) & (green > 130)).sum())
    assert stressed[0] < 50 and stressed[1] > 200, f"{stressed} stressed pixels"


def test_a_fragile_grasp_needs_touch():
    with pytest.raises(ValueError, match="tactile: found none, expected surrogate, compliance"):
        gym.make(FRAGILE, tactile="none")


@pytest.mark.parametrize(
    ("env_id", "settings", "channels", "terms"),
    [
        (
            FRAGILE,
            SOFT,
            ["proprio", "wrench", "stress_ratio"],
            ["grasp", "lift", "hold"],
        ),
        (
            SQUEEZE,
            NEEDED[SQUEEZE],
            ["proprio", "wrench", "squeeze"],
            ["touch", "lift", "hold", "gentle"],
        ),
        (HOLD, SOFT, ["proprio", "wrench", "slip"], ["still", "grip_economy"]),
        (HOLD, {"tactile": "none"}, ["proprio", "wrench"], ["still", "grip_economy"]),
    ],
)
def test_the_plan_shows_what_the_task_asks_for(env_id, settings, channels, terms):
    env = gym.make(env_id, **settings).unwrapped
    env.reset(seed=0)
    *_, info = env.step(np.array([0, 0, 0, 0, 0.5], np.float32))
    feels = settings.get("tactile") != "none"
    model = "model soft" if env_id == SQUEEZE else "model compliance"
    touch = ["press", model, "correction"] if feels else []
    peak = ["peak stress"] if env_id == FRAGILE else []
    names = ["scene", *touch, *peak, *(f"channel {name}" for name in channels), "reward"]
    assert [name for name, *_ in env.plan()] == names
    assert [name for name, _ in env.channels()] == channels
    assert list(info["reward_terms"]) == terms


def test_a_held_object_is_felt_from_the_first_observation():
    env = gym.make(HOLD, **SOFT, observation=["wrench", "markers"]).unwrapped
    for seed in range(10):
        observation, _ = env.reset(seed=seed)
        wrench = observation["wrench"].reshape(2, 6)
        assert np.any(observation["markers"])
        # The grip, and the weight that hangs on the gel.
        look = env.look()
        np.testing.assert_allclose(-wrench[:, 2], 5.0, rtol=0.15)
        np.testing.assert_allclose(-wrench[:, 1].sum(), 9.81 * look["mass"], rtol=0.15)
    assert {"load", "shaking", "shaking_frequency"} <= look.keys()
    # The shape stands as deep in both faces, and no deeper than a gel of 4 mm gives to 5 N.
    left, right = look["indentations"]
    assert 1e-4 < left < 1e-3
    np.testing.assert_allclose(left, right, rtol=0.1)


@pytest.mark.parametrize(("env_id", "settings"), CASES)
def test_random_actions_stay_within_the_spaces_and_end_by_name(env_id, settings):
    envs = gym.make_vec(env_id, num_envs=2, autoreset_mode="SameStep", **settings)
    envs.reset(seed=0)
    for action in actions(2, 40):
        rows, reward, terminated, _, info = envs.step(action)
        assert envs.observation_space.contains(rows)
        assert ((reward >= 0) & (reward <= 1)).all()
        for row in np.flatnonzero(terminated):
            assert info["final_info"]["ending"][row] in ENDINGS


def towards(force: Any, observation: dict[str, np.ndarray]) -> np.ndarray:
    """Actions (N, 5) that bring the grip to a force (N) by a factor of exp(0.4) a step at most."""
    action = np.zeros((len(observation["proprio"]), 5), np.float32)
    grip = part(observation, "proprio", "grip force command")
    action[:, 4] = np.clip(np.log(force / grip) / 0.4, -1, 1)
    return action


class Watched(dict):
    """Observations that take note of what is read of them."""

    def __init__(self, observation: dict[str, np.ndarray]) -> None:
        super().__init__(observation)
        self.read: set[str] = set()

    def __getitem__(self, name: str) -> np.ndarray:
        self.read.add(name)
        return super().__getitem__(name)


@pytest.mark.parametrize("env_id", IDS)
def test_a_scripted_policy_names_the_channels_that_it_reads(env_id):
    policy = scripted(env_id)
    envs = gym.make_vec(env_id, num_envs=2, **NEEDED.get(env_id, {}))
    observation = Watched(envs.reset(seed=0)[0])
    policy.predict(observation)
    reads = policy.reads
    assert observation.read == {*reads}
    expected = f"expected the channels {', '.join(reads)} of N environments"
    lost = {name: values for name, values in observation.items() if name != reads[-1]}
    first = {name: values[0] for name, values in observation.items()}
    mixed = first | {reads[0]: observation[reads[0]][None]}
    flat_ones = np.concatenate(list(observation.values()), axis=1)
    for wrong, found in (
        (lost, f"found no {reads[-1]} among {', '.join(lost)}"),
        (mixed, f"found {reads[0]} of shape {mixed[reads[0]].shape}"),
        (flat_ones, f"found an array of shape {flat_ones.shape}"),
    ):
        with pytest.raises(ValueError, match=re.escape(f"observation: {found}, {expected}")):
            policy.predict(wrong)


@pytest.mark.parametrize("env_id", IDS)
def test_an_episode_that_begins_has_a_state_of_its_own(env_id):
    policy, random = scripted(env_id), np.random.default_rng(0)
    space = gym.make_vec(env_id, num_envs=3, **NEEDED.get(env_id, {})).observation_space

    def drawn(name: str) -> np.ndarray:
        # Forces that each pad bears, as of what is held.
        return random.uniform(0.5, 1.0, space[name].shape).astype(np.float32)

    before, after = ({name: drawn(name) for name in policy.reads} for _ in range(2))
    _, state = policy.predict(before, None, np.ones(3, bool))
    first = np.array([False, True, False])
    action, following = policy.predict(after, state, first)
    for rows, (expected, expected_state) in (
        (first, policy.predict(after, None)),
        (~first, policy.predict(after, state)),
    ):
        np.testing.assert_array_equal(action[rows], expected[rows])
        for found, wanted in zip(following or (), expected_state or (), strict=True):
            np.testing.assert_array_equal(found[rows], wanted[rows])
    with pytest.raises(ValueError, match=r"episode_start: found shape \(2,\), expected \(3,\)"):
        policy.predict(after, state or (), first[:2])


class Proportional:
    """Grips by what it holds: so many times the largest shear of a pad lately."""

    def __init__(self, factor: float) -> None:
        self._factor = factor

    def predict(self, observation: Any, state: Any = None, **_: Any) -> tuple[np.ndarray, Any]:
        force = observation["wrench"].reshape(-1, 2, 6)
        shear = np.hypot(force[:, :, 0], force[:, :, 1]).max(axis=1)
        largest = shear if state is None else np.maximum(shear, 0.98 * state)
        return towards(np.maximum(self._factor * largest, 0.3), observation), largest


def test_no_grip_by_the_load_alone_holds_as_many_as_one_by_what_slides():
    sliding = evaluate(scripted(HOLD), HOLD, 48)
    assert sliding["success"] >= 0.9, sliding
    for factor in (1.8, 2.6):
        blind = evaluate(Proportional(factor), HOLD, 48)
        assert blind["interval"][1] < sliding["success"], (factor, blind)
        assert blind["return"] < sliding["return"] - 20.0, (factor, blind)


class Firm:
    """Grips fragile objects with the same force, then lifts."""

    def __init__(self, force: float) -> None:
        self._force = force

    def predict(self, observation: Any, state: Any = None, **_: Any) -> tuple[np.ndarray, Any]:
        step = state or 0
        action = towards(self._force, observation)
        action[:, 2] = 0.5 * (15 <= step < 35)
        return action, step + 1


def test_the_scripted_policy_lifts_what_is_fragile_and_no_constant_grip_does():
    written = evaluate(scripted(FRAGILE), FRAGILE, 24)
    assert written["success"] >= 0.9, written
    for force in (2.0, 3.0):
        constant = evaluate(Firm(force), FRAGILE, 24)
        assert constant["interval"][1] < written["success"], (force, constant)


def test_an_object_in_the_hand_is_held_whatever_is_drawn():
    cone = {"shape": "cone", "radius": 0.02, "half_height": 0.025}
    env = gym.make(HOLD, objects=cone, size=1, **SOFT)
    for seed in range(6):
        observation, _ = env.reset(seed=seed)
        assert np.abs(observation["wrench"].reshape(2, 6)).max(axis=1).min() > 0.1, seed


def test_an_object_that_the_hand_never_holds_is_refused():
    small = {"shape": "sphere", "radius": 0.002}
    with pytest.raises(ValueError, match=r"sphere, radius 0\.002 m, which the hand"):
        gym.make(HOLD, objects=["cup", small], size=1, **SOFT)
