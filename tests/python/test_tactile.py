"""Tactile fingers: spaces, zeros, seeds, snapshots, batches, settings and the plan."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import tomllib
from conftest import actions, flat
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import ruffini
from ruffini._schema import ENDINGS, SHARED_CHANNELS
from ruffini.custom import CustomVectorEnv, Task
from ruffini.envs import GraspLiftEnv, GraspLiftVectorEnv

SENSORS = Path(__file__).parents[2] / "env-core/assets/sensors"
COARSE = {"nodes": 300}
COMPLIANT: dict[str, Any] = {"tactile": "compliance", "resolution": COARSE}
FELT = ["markers", "marker_pixels", "displacement", "stress", "tet_stress", "traction", "wrench"]
FELT += ["slip"]
OVER_OBJECT: dict[str, Any] = {
    "objects": "sphere",
    "position": 0.0,
    "start": 0.0,
    "start_height": 0.08,
    **COMPLIANT,
}


def everything(**settings: Any) -> dict[str, Any]:
    channels = [*SHARED_CHANNELS, *ruffini.TACTILE_CHANNELS]
    if settings.get("sensor") == "digit":
        channels.remove("image")
    if settings.get("tactile", "compliance") != "surrogate":
        channels.remove("predicted_error")
    return {**OVER_OBJECT, "observation": channels, **settings}


def grasping(step: int, grip: float = 0.1) -> np.ndarray:
    """Down to the object, close, lift."""
    if step < 7:
        return np.array([0, 0, -0.9, 0, -0.2], np.float32)
    return np.array([0, 0, 0.2 if step > 14 else 0.0, 0, grip], np.float32)


@pytest.mark.parametrize("tactile", ["compliance", "fem"])
@pytest.mark.parametrize("obs", ["dict", "flat"])
def test_gymnasium_finds_nothing_to_warn_about(tactile, obs):
    env = gym.make("ruffini/GraspLift-v0", obs=obs, **everything(tactile=tactile))
    check_env(env.unwrapped, skip_render_check=True)


def test_markers_are_seen_by_default_and_are_about_two_hundred():
    env = gym.make("ruffini/GraspLift-v0", tactile="compliance", resolution=COARSE)
    assert set(env.observation_space) == {"proprio", "object", "markers"}
    assert env.observation_space["markers"].shape == (210,)


@pytest.mark.parametrize("sensor", ["gelsight-mini", "digit"])
def test_observations_stay_in_their_space_and_are_zero_without_contact(sensor):
    env = GraspLiftEnv(**everything(sensor=sensor))
    observation, _ = env.reset(seed=1)
    touched = 0
    for step in range(25):
        assert observation in env.observation_space, step
        force = np.abs(observation["wrench"]).max()
        for channel in FELT:
            assert np.any(observation[channel]) == (force > 0), (step, channel)
        assert np.any(observation["depth"])
        touched += force > 0
        observation, *_ = env.step(grasping(step))
    assert touched > 10, f"touched in {touched} of 25 steps"


def test_the_wrench_is_that_of_the_traction_and_close_to_the_grip():
    env = GraspLiftEnv(**everything())
    env.reset(seed=1)
    for step in range(25):
        observation, *_ = env.step(grasping(step))
    cells = env.skin()["grid"]
    spacing = [np.diff(np.unique(cells[:, axis].round(9)))[0] for axis in (0, 1)]
    area = spacing[0] * spacing[1]
    traction = observation["traction"].reshape(2, -1, 3).astype(float)
    wrench = observation["wrench"].reshape(2, 6)
    np.testing.assert_allclose(traction.sum(1) * area, wrench[:, :3], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(-wrench[:, 2], 4.0, atol=0.4)


def test_places_of_the_channels_have_their_sizes():
    env = GraspLiftEnv(**everything())
    skin, spaces = env.skin(), env.observation_space
    assert spaces["markers"].shape == (2 * skin["markers"].size,)
    assert spaces["marker_pixels"].shape == (2 * len(skin["markers"]) * 2,)
    assert spaces["displacement"].shape == (2 * skin["surface"].size,)
    assert spaces["stress"].shape == (2 * len(skin["grid"]),)
    assert spaces["depth"].shape == (2 * len(skin["depth"]),)
    assert spaces["image"].shape == (2 * len(skin["image"]) * 3,)
    env.reset(seed=0)
    assert np.all(np.abs(skin["markers"][:, :2]) < 0.011)
    assert GraspLiftEnv(tactile="none").skin() is None


def test_the_image_is_the_background_until_something_touches():
    camera = tomllib.loads((SENSORS / "gelsight-mini.toml").read_text())["camera"]
    env = GraspLiftEnv(**everything(resolution={**COARSE, "image": (12, 16)}))
    observation, _ = env.reset(seed=1)
    half = 0.5 * max(camera["pixels"]) * camera["pixel"]
    x, y = env.skin()["image"].T / half
    image = camera["image"]
    powers = np.stack([x**a * y**b for a, b in image["background_terms"]], axis=1)
    still = powers @ np.array(image["background"])
    left, right = observation["image"].reshape(2, -1, 3)
    np.testing.assert_allclose(left, still, atol=1e-5)
    np.testing.assert_array_equal(left, right)
    for step in range(25):
        observation, *_ = env.step(grasping(step))
    pressed = observation["image"].reshape(2, 16, 12, 3)
    changed = np.abs(pressed - still.reshape(16, 12, 3)).max(axis=-1)
    assert changed[:, 6:10, 4:8].max() > 0.1, "nothing is seen where the ball is"
    assert changed[:, 0].max() < 0.02, "something is seen far from it"


@pytest.mark.parametrize("image", [(240, 320), (30, 80)])
def test_marker_pixels_are_the_motion_of_markers_in_pixels_of_the_image(image):
    camera = tomllib.loads((SENSORS / "gelsight-mini.toml").read_text())["camera"]
    size = camera["pixel"] * np.array(camera["pixels"]) / image
    settings = {**OVER_OBJECT, "resolution": {**COARSE, "markers": (7, 9), "image": image}}
    env = GraspLiftEnv(observation=["markers", "marker_pixels"], **settings)
    observation, _ = env.reset(seed=1)
    assert not observation["marker_pixels"].any()
    for step in range(20):
        observation, *_ = env.step(grasping(step))
    motion = observation["markers"].reshape(2, 9, 7, 3)[..., :2] / size
    assert np.abs(motion).max() > 0.1
    seen = observation["marker_pixels"].reshape(2, 9, 7, 2)
    np.testing.assert_allclose(seen, motion, rtol=1e-5, atol=1e-6)


def test_a_sensor_without_colours_has_no_image():
    with pytest.raises(ValueError, match=r"sensor: found .*digit.*, expected .* camera\.image"):
        GraspLiftEnv(sensor="digit", observation=["image"])


def test_a_seed_gives_the_same_touch_again():
    first, second = GraspLiftEnv(**everything()), GraspLiftEnv(**everything())
    for env in (first, second):
        env.reset(seed=3)
    for step in range(15):
        ours, theirs = (flat(env.step(grasping(step))[0]) for env in (first, second))
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {
            "gel_stiffness": (0.5, 2.0),
            "sensor_errors": {
                "markers": {"noise": (1e-5, 2e-5), "offset": 1e-5, "delay": 2},
                "wrench": {"drift": (0.1, 0.2), "hysteresis": 0.5},
            },
        },
    ],
)
def test_a_snapshot_in_mid_grasp_replays_bit_for_bit(settings):
    env = GraspLiftEnv(**everything(**settings))
    env.reset(seed=2)
    for step in range(14):
        env.step(grasping(step))
    copy, state = pickle.loads(pickle.dumps(env)), env.state()
    later = [flat(env.step(grasping(step))[0]) for step in range(14, 22)]
    env.set_state(state)
    for replay in (env, copy):
        again = [flat(replay.step(grasping(step))[0]) for step in range(14, 22)]
        np.testing.assert_array_equal(again, later)
    assert np.any(env.step(grasping(22))[0]["markers"])


def test_a_reset_forgets_what_was_felt():
    used, fresh = GraspLiftEnv(**everything()), GraspLiftEnv(**everything())
    used.reset(seed=2)
    for step in range(16):
        used.step(grasping(step))
    np.testing.assert_array_equal(flat(used.reset(seed=4)[0]), flat(fresh.reset(seed=4)[0]))
    assert used.state() == fresh.state()


@pytest.mark.parametrize("threads", [1, 3])
def test_a_row_of_a_batch_equals_the_single_environment(threads):
    envs = GraspLiftVectorEnv(3, num_threads=threads, **everything())
    rows, _ = envs.reset(seed=5)
    singles = [GraspLiftEnv(**everything()) for _ in range(3)]
    for i, env in enumerate(singles):
        np.testing.assert_array_equal(flat(rows)[i], flat(env.reset(seed=5 + i)[0]))
    for step in range(16):
        rows, *_ = envs.step(np.stack([grasping(step)] * 3))
        for i, env in enumerate(singles):
            np.testing.assert_array_equal(flat(rows)[i], flat(env.step(grasping(step))[0]))
    assert np.any(rows["markers"])


def test_a_quiet_hold_does_not_creep():
    settings: dict[str, Any] = {"objects": "sphere", "load": 0.0, "shaking": 0.0}
    settings |= {"start_grip": 4.0, "friction": 0.7}
    env = gym.make("ruffini/HoldStill-v0", observation=["object", "markers"], **settings)
    env.reset(seed=3)
    still = np.zeros(5, np.float32)
    seen = [env.step(still)[0] for _ in range(90)]
    first, last = ({k: np.float64(v) for k, v in seen[i].items()} for i in (24, 89))
    creep = np.linalg.norm(last["markers"] - first["markers"])
    assert creep < 1e-5 * np.linalg.norm(first["markers"])
    assert np.linalg.norm((last["object"] - first["object"])[:3]) < 1e-8


def test_random_steps_never_yield_what_is_not_a_number():
    mode = AutoresetMode.SAME_STEP
    objects = ["sphere", "cuboid", "annulus", "cup"]
    settings = everything(objects=objects, position=0.01, start=0.01, yaw=(-3.0, 3.0))
    settings |= {"gripper": {"max_force": 10.0}, "resolution": {"nodes": 150}}
    envs = GraspLiftVectorEnv(8, autoreset_mode=mode, **settings)
    envs.reset(seed=0)
    touched = 0
    for action in actions(8, 60):
        action[:, :2] *= 0.2
        rows, reward, terminated, _, info = envs.step(action)
        assert envs.observation_space.contains(rows) and np.isfinite(reward).all()
        touched += int((np.abs(rows["wrench"]).max(axis=1) > 0).sum())
        for row in np.flatnonzero(terminated):
            assert info["final_info"]["ending"][row] in ENDINGS
    assert touched > 24, f"touched in {touched} of 480 steps"


@pytest.mark.parametrize("tactile", ["compliance", "fem", "surrogate"])
def test_a_stiffer_gel_is_that_of_a_stiffer_material(tactile):
    # HoldStill begins with the object in the hand.
    settings: dict[str, Any] = {"observation": ["markers", "stress", "wrench"], "tactile": tactile}
    if tactile != "surrogate":
        settings["resolution"] = COARSE
    rows = []
    for gel in (
        {"material": {"young": 3e5, "poisson": 0.47}, "gel_stiffness": 2.0},
        {"material": {"young": 6e5, "poisson": 0.47}},
        {"material": {"young": 3e5, "poisson": 0.47}},
    ):
        env = gym.make("ruffini/HoldStill-v0", **settings, **gel)
        seen = [env.reset(seed=3)[0]]
        seen += [env.step(np.zeros(5, np.float32))[0] for _ in range(4)]
        rows.append({name: np.array([one[name] for one in seen]) for name in seen[0]})
    scaled, stiff, soft = rows
    for name, values in stiff.items():
        assert values.any(), name
        # Solvers stop at a residual in newtons, so the last digits differ.
        np.testing.assert_allclose(scaled[name], values, rtol=0.0, atol=2e-3 * abs(values).max())
    assert abs(soft["markers"]).max() > 1.2 * abs(stiff["markers"]).max()


def test_the_stiffness_of_the_gel_is_drawn_at_each_reset_and_changes_no_other_draw():
    def episodes(**settings: Any) -> tuple[np.ndarray, np.ndarray]:
        make = {"observation": ["properties", "wrench"], **COMPLIANT, **settings}
        env = gym.make_vec("ruffini/HoldStill-v0", num_envs=4, obs="flat", **make)
        # What is felt first follows the springs of Rapier, which are as stiff as the gel.
        seen = np.array([env.reset(seed=0)[0], env.reset()[0], env.reset()[0]])
        return seen[..., :5], seen[..., 5:]

    usual, drawn = episodes(), episodes(gel_stiffness=(0.5, 2.0))
    np.testing.assert_array_equal(usual[0], drawn[0])
    ratios = np.linalg.norm(drawn[1], axis=-1) / np.linalg.norm(usual[1], axis=-1)
    assert (ratios != 1.0).all() and len(np.unique(ratios)) == 12
    np.testing.assert_array_equal(drawn[1], episodes(gel_stiffness=(0.5, 2.0))[1])
    for task, settings in [("GraspLift", {"tactile": "none"}), ("GraspSoft", {})]:
        with pytest.raises(ValueError, match=r"gel_stiffness: .*1 where no pad is soft"):
            gym.make(f"ruffini/{task}-v0", gel_stiffness=1.5, **settings)


def test_sensor_errors_change_what_is_seen_and_nothing_else():
    errors = {"markers": {"noise": 1e-5, "gain": (0.8, 1.2), "dead": 0.1, "delay": 1}}
    settings = {**COMPLIANT, "observation": ["proprio", "markers"]}

    def rollout(count: int, **more: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        env = gym.make_vec("ruffini/HoldStill-v0", num_envs=count, **settings, **more)
        env.reset(seed=[5 + i for i in range(count)])
        # The second episode: what was drawn for the first changes it no more than the first.
        seen, rewards = [env.reset()[0]], []
        for _ in range(6):
            observation, reward, *_ = env.step(np.zeros((count, 5), np.float32))
            seen.append(observation)
            rewards.append(reward)
        proprio, markers = (np.array([o[name] for o in seen]) for name in ("proprio", "markers"))
        return proprio, markers, np.array(rewards)

    (proprio, true, rewards) = rollout(3)
    faulty = rollout(3, sensor_errors=errors)
    np.testing.assert_array_equal(faulty[0], proprio)
    np.testing.assert_array_equal(faulty[2], rewards)
    seen = faulty[1].reshape(7, 3, 2, 35, 3)
    true = true.reshape(7, 3, 2, 35, 3)
    dead = (seen == 0).all(axis=(0, 4))
    assert 0.02 < dead.mean() < 0.25
    for row in range(3):
        for pad in range(2):
            alive = ~dead[row, pad]
            reported, late = seen[1:, row, pad, alive], true[:-1, row, pad, alive]
            gain = (reported * late).sum() / (late * late).sum()
            assert 0.78 < gain < 1.22
            assert 0.9e-5 < (reported - gain * late).std() < 1.1e-5
    # Rows are as alone, and a seed brings the same errors again.
    np.testing.assert_array_equal(rollout(1, sensor_errors=errors)[1][:, 0], faulty[1][:, 0])
    env = gym.make("ruffini/HoldStill-v0", sensor_errors=errors, **settings)
    env.reset(seed=5)
    np.testing.assert_array_equal(env.reset()[0]["markers"], faulty[1][0, 0])


def test_drift_starts_at_each_reset_and_is_what_is_set_after_a_second():
    settings: dict[str, Any] = {"objects": "sphere", "load": 0.0, "shaking": 0.0}
    settings |= {"start_grip": 4.0, "friction": 0.7, "observation": "markers", **COMPLIANT}

    def episodes(**more: Any) -> np.ndarray:
        env = gym.make_vec("ruffini/HoldStill-v0", num_envs=3, obs="flat", **settings, **more)
        films = []
        for seed in (5, None):
            seen = [env.reset(seed=seed)[0]]
            seen += [env.step(np.zeros((3, 5), np.float32))[0] for _ in range(25)]
            films.append(seen)
        return np.array(films, np.float64)

    drift = episodes(sensor_errors={"markers": {"drift": 1e-5}}) - episodes()
    assert not drift[:, 0].any()
    assert (drift[:, 1] != 0).mean() > 0.99
    # 1,260 numbers: a tenth is five standard errors.
    np.testing.assert_allclose(drift[:, 25].std(), 1e-5, rtol=0.1)


def test_noise_of_an_episode_is_not_that_of_another_one():
    settings: dict[str, Any] = {"objects": "sphere", "load": 0.0, "shaking": 0.0}
    settings |= {"start_grip": 4.0, "friction": 0.7, "observation": "wrench", "tactile": "none"}

    def episodes(**more: Any) -> np.ndarray:
        env = gym.make("ruffini/HoldStill-v0", obs="flat", **settings, **more)
        films = []
        for seed in (5, None, None, None):
            seen = [env.reset(seed=seed)[0]]
            seen += [env.step(np.zeros(5, np.float32))[0] for _ in range(40)]
            films.append(np.concatenate(seen))
        return np.array(films, np.float64)

    noise = episodes(sensor_errors={"wrench": {"noise": 0.01}}) - episodes()
    noise /= noise.std(axis=1, keepdims=True)
    for i in range(4):
        for j in range(i):
            # All shifts of one against the other; 492 numbers: a quarter is five standard errors.
            shifted = np.correlate(noise[i], noise[j], "full") / noise.shape[1]
            assert np.abs(shifted).max() < 0.25, (i, j)


def test_the_network_predicts_its_errors_and_other_models_refuse_to():
    settings: dict[str, Any] = {"observation": ["wrench", "predicted_error"], "objects": "sphere"}
    env = gym.make("ruffini/GraspLift-v0", **settings)
    observation, _ = env.reset(seed=0)
    assert not observation["predicted_error"].any()
    held = gym.make("ruffini/HoldStill-v0", **settings, load=0.0, shaking=0.0)
    held.reset(seed=0)
    for _ in range(5):
        observation = held.step(np.zeros(5, np.float32))[0]
    errors = observation["predicted_error"].reshape(2, 3)
    assert (errors > 1e-3).all()
    assert (errors < 1).all()
    for tactile in ("fem", "compliance"):
        with pytest.raises(ValueError, match="only model that predicts") as refused:
            gym.make("ruffini/GraspLift-v0", **settings, tactile=tactile, resolution=COARSE)
        assert "predicted_error" in str(refused.value)


def test_errors_by_quantity_are_of_it_alone():
    errors = {
        "wrench": {"noise": {"force": 0.02, "torque": 1e-4}, "gain": {"torque": (1.5, 2.0)}},
        "object": {"offset": {"rise": 0.1}},
        "proprio": {"noise": {"grip": 0.5}},
    }
    channels = {"wrench": 6, "object": 16, "proprio": 14}
    settings: dict[str, Any] = {"objects": "sphere", "observation": [*channels], **COMPLIANT}
    settings |= {"start_grip": 8.0, "friction": 0.9, "max_episode_steps": 1000}

    def episode(**more: Any) -> dict[str, np.ndarray]:
        env = gym.make("ruffini/HoldStill-v0", **settings, **more)
        seen = [env.reset(seed=3)[0]]
        seen += [env.step(np.zeros(5, np.float32))[0] for _ in range(200)]
        return {
            name: np.array([of[name] for of in seen], np.float64).reshape(201, -1, size)
            for name, size in channels.items()
        }

    def apart(settings: Any) -> dict[str, np.ndarray]:
        seen = episode(sensor_errors=settings)
        return {name: seen[name] - true[name] for name in channels}

    true = episode()
    found = apart(errors)
    # 1,206 numbers: a tenth is five standard errors.
    assert found["wrench"][..., :3].std() == pytest.approx(0.02, rel=0.1)
    # A gain from 1.5 to 2 is the torque once or half of it again, beside its noise.
    torque, ours = true["wrench"][..., 3:], found["wrench"][..., 3:]
    for pad in (0, 1):
        gain = 1 + (ours[:, pad] * torque[:, pad]).sum() / (torque[:, pad] ** 2).sum()
        assert 1.45 < gain < 2.05
        rest = ours[:, pad] - (gain - 1) * torque[:, pad]
        assert rest.std() == pytest.approx(1e-4, rel=0.15)
    changed = {name: (of != 0).any(axis=(0, 1)) for name, of in found.items()}
    assert np.flatnonzero(changed["object"]).tolist() == [15]
    assert np.flatnonzero(changed["proprio"]).tolist() == [11]
    # The same for all quantities is that of the channel, to the bit.
    one, two = (0.1, 0.2), {"force": (0.1, 0.2), "torque": (0.1, 0.2)}
    names = ("noise", "gain", "offset", "drift", "hysteresis")
    channel, quantities = (apart({"wrench": dict.fromkeys(names, of)}) for of in (one, two))
    np.testing.assert_array_equal(channel["wrench"], quantities["wrench"])


def test_hysteresis_keeps_what_is_seen_behind_what_is_true():
    def grasp(**more: Any) -> np.ndarray:
        env = GraspLiftEnv(observation=["markers"], **OVER_OBJECT, **more)
        seen = [env.reset(seed=1)[0]["markers"]]
        seen += [
            env.step(grasping(step, -0.1 if step > 20 else 0.1))[0]["markers"] for step in range(26)
        ]
        return np.array(seen, np.float64)

    true, half = grasp(), 5e-5
    seen = grasp(sensor_errors={"markers": {"hysteresis": half}})
    lagging = [true[0]]
    for now in true[1:]:
        lagging.append(np.clip(lagging[-1], now - half, now + half))
    assert np.abs(seen - true).max() > 0.99 * half
    np.testing.assert_allclose(seen, lagging, rtol=0.0, atol=1e-9)


class Paid(Task):
    """Pays one in every step."""

    terms = {"one": 1.0}

    def reward(self, state):
        return {"one": 1.0}


def test_a_press_without_an_answer_ends_its_episode_by_name_and_pays_nothing():
    # The full grip drives the edges of a thin ring through the elements of a coarse mesh.
    shape = {"shape": "annulus", "outer": 0.02, "inner": 0.0197, "half_height": 0.01}
    ring = everything(objects=[shape], tactile="fem", resolution={"nodes": 100})
    env, envs = GraspLiftEnv(**ring), CustomVectorEnv(Paid, 2, **ring)
    env.reset(seed=0)
    envs.reset(seed=0)
    for step in range(25):
        action = np.stack([grasping(step, 1.0), grasping(0)])
        observation, reward, terminated, _, info = env.step(action[0])
        _, paid, done, _, infos = envs.step(action)
        assert observation in env.observation_space
        if terminated:
            break
        assert paid.tolist() == [1.0, 1.0]
    assert terminated and info["ending"] == "press_failed"
    assert info["press_error"] in ("not-converged", "step-too-long", "inverted", "penetrated")
    assert done.tolist() == [True, False]
    assert (reward, paid.tolist()) == (0.0, [0.0, 1.0])
    assert infos["reward_terms"]["one"].tolist() == [0.0, 1.0]
    assert infos["ending"].tolist() == ["press_failed", None]
    assert infos["press_error"].tolist() == [info["press_error"], None]
    assert infos["_press_error"].tolist() == [True, False]


def test_the_plan_shows_the_stages_that_are_asked_for():
    env = gym.make("ruffini/GraspLift-v0", **{**OVER_OBJECT, "observation": ["markers", "stress"]})
    env.reset(seed=0)
    for step in range(20):
        env.step(grasping(step))
    stages = ["scene", "press", "model compliance", "correction"]
    stages += ["channel markers", "channel stress", "reward"]
    plan = env.unwrapped.plan(forget=True)
    assert [name for name, _, _ in plan] == stages
    assert all(runs > 0 and microseconds > 0 for _, runs, microseconds in plan)
    assert all(runs == 0 for _, runs, _ in env.unwrapped.plan())
    assert [name for name, *_ in GraspLiftEnv(tactile="none", observation="time").plan()] == [
        "scene",
        "channel time",
        "reward",
    ]


def test_a_picture_shows_stress_beside_the_scene_and_changes_nothing():
    size = {"render_mode": "rgb_array", "width": 320, "height": 240}
    env = GraspLiftEnv(**{**OVER_OBJECT, "observation": "markers"}, **size)
    env.reset(seed=1)
    corner = (slice(0, 100), slice(-100, None))
    untouched = env.render()[corner]
    for step in range(20):
        env.step(grasping(step, 0.2))
    before = env.state()
    env.plan(forget=True)
    picture = env.render()
    assert env.state() == before
    # The picture's own answer is no part of what a step costs.
    assert all(runs == 0 for _, runs, _ in env.plan())
    # Without touch there is sky in the corner; with it a dark patch on a light pad.
    assert untouched.min() > 200
    assert (picture[corner].min(axis=2) < 120).mean() > 0.02
    blind = GraspLiftEnv(**{**OVER_OBJECT, "tactile": "none"}, **size)
    blind.reset(seed=1)
    for step in range(20):
        blind.step(grasping(step, 0.2))
    assert blind.render()[corner].min() > 200


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"tactile": "touchy"}, "tactile: unknown variant `touchy`, expected one of `none`"),
        ({"tactile": 3}, "tactile"),
        ({"sensor": "gelsight"}, "sensor: found gelsight, did you mean 'gelsight-mini'"),
        ({"material": "steel"}, "material: found steel, expected one of tacflex, feats"),
        ({"material": {"young": 1e5}}, "missing field `poisson`"),
        ({"material": {"young": -1.0, "poisson": 0.3}}, "young"),
        ({"material": {"young": 0.3, "poisson": 0.3}}, r"material.young: .*; it is in Pa: 0.3 MPa"),
        ({"material": {"young": 300, "poisson": 0.3}}, "; it is in Pa: 300 kPa is 3e5"),
        ({"material": {"young": 1e5, "poisson": 0.6}}, "poisson: found 0.6"),
        ({"material": 3}, "expected a calibration's name or the numbers young and poisson"),
        ({"resolution": {"nodes": 5}}, "resolution.nodes: found 5, expected 100 to"),
        ({"resolution": {"markers": [0, 7]}}, "resolution.markers"),
        ({"resolution": {"cells": 3}}, "unknown field `cells`"),
        ({"observation": ["marker"]}, "observation: found marker"),
        ({"observation": ["markers"], "tactile": "none"}, "set tactile"),
        ({"gripper": {"pad_width": 0.03}}, "as the sensor gelsight-mini has it"),
    ],
)
def test_bad_settings_are_named(settings, message):
    with pytest.raises(ValueError, match=message.replace("[", r"\[")):
        GraspLiftEnv(**{**OVER_OBJECT, **settings})


@pytest.mark.parametrize(
    ("setting", "file"), [("sensor", "none.toml"), ("network", "none.safetensors")]
)
def test_a_file_that_is_not_there_is_no_setting(setting, file):
    with pytest.raises(FileNotFoundError, match=file) as raised:
        gym.make("ruffini/GraspLift-v0", **{setting: file})
    assert raised.value.filename == file


def test_a_network_of_ones_own_is_felt_with():
    weights = Path(__file__).parents[2] / "env-core/assets/weights/pads.safetensors"
    settings = {"objects": "sphere", "observation": ["markers", "wrench"], "start": 0.0}
    felt = []
    for chosen in ({}, {"network": weights}):
        envs = gym.make_vec("ruffini/HoldStill-v0", num_envs=1, **settings, **chosen)
        felt.append(envs.reset(seed=0)[0])
        envs.close()
    for name in ("markers", "wrench"):
        assert np.abs(felt[0][name]).max() > 0
        np.testing.assert_array_equal(felt[0][name], felt[1][name])
    agent = Path(ruffini.agents.__file__).parent / "HoldStill-v0.safetensors"
    for wrong, text in (
        ({"network": agent}, "HoldStill-v0.safetensors"),
        ({"network": weights, "tactile": "compliance"}, "network: found .*, expected none where"),
    ):
        with pytest.raises(ValueError, match=text):
            gym.make("ruffini/GraspLift-v0", **wrong)
    with pytest.raises(ValueError, match="the fingers are rigid"):
        gym.make("ruffini/GraspSoft-v0", network=weights)
