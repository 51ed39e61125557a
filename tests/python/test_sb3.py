"""The Stable-Baselines3 adapter."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from conftest import actions

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO, SAC
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from ruffini import _rows
from ruffini.agents.sb3 import _checked
from ruffini.envs import GraspLiftEnv
from ruffini.sb3 import WEAK, AsymmetricPolicy, TouchExtractor, make_vec_env

ID = "ruffini/GraspLift-v0"


def test_finished_rows_bring_their_last_observation():
    envs = make_vec_env(ID, 2, seed=0, max_episode_steps=3, obs="flat")
    alone = GraspLiftEnv(obs="flat", max_episode_steps=3)
    envs.reset()
    alone.reset(seed=1)
    assert envs.reset_infos == [{}, {}]
    still = np.zeros((2, 5), np.float32)
    for _ in range(3):
        observation, reward, dones, infos = envs.step(still)
        last, *_ = alone.step(still[0])
    assert dones.all() and reward.dtype == np.float32
    np.testing.assert_array_equal(infos[1]["terminal_observation"], last)
    np.testing.assert_array_equal(observation[1], alone.reset()[0])
    assert infos[1]["TimeLimit.truncated"] is True
    assert infos[1]["is_success"] is False


def test_a_seed_takes_effect_at_the_next_reset():
    envs = make_vec_env(ID, 2, obs="flat")
    envs.seed(5)
    first = envs.reset()
    assert not np.array_equal(first, envs.reset())
    envs.seed(5)
    np.testing.assert_array_equal(first, envs.reset())


def test_options_of_a_reset_are_checked_as_by_the_single_environment():
    envs = VecMonitor(make_vec_env(ID, 2, obs="flat"))
    for given in ({"mass": 0.05}, [{}, {"mass": 0.05}]):
        with pytest.raises(ValueError, match="'mass', expected none; it is a setting of the envi"):
            envs.set_options(given)
    for none in (None, {}, [{}, {}]):
        envs.set_options(none)
    envs.reset()


def same_infos(ours: list[dict], theirs: list[dict], where: str) -> None:
    """Raises unless all rows have the same keys, values and types."""
    for row, (found, expected) in enumerate(zip(ours, theirs, strict=True)):
        assert found.keys() == expected.keys(), f"{where}, row {row}"
        for key, value in expected.items():
            assert type(found[key]) is type(value), f"{where}, row {row}, {key}"
            if key == "terminal_observation":
                np.testing.assert_equal(found[key], value)
            else:
                assert found[key] == value, f"{where}, row {row}, {key}"


def opening_hands(rows: int, steps: int) -> np.ndarray:
    """Random actions (steps, rows, 5); the second row opens its hand."""
    acts = actions(rows, steps)
    acts[:, 1, 4] = -1
    return acts


@pytest.mark.parametrize("obs", ["dict", "flat"])
@pytest.mark.parametrize("name", ["GraspLift", "HoldStill"])
def test_infos_are_those_of_the_dummy_vector_environment(name, obs):
    env_id = f"ruffini/{name}-v0"
    settings = {"max_episode_steps": 12, "tactile": "none", "obs": obs}
    ours = make_vec_env(env_id, 3, seed=7, **settings)
    theirs = DummyVecEnv([lambda: gym.make(env_id, **settings)] * 3)
    theirs.seed(7)
    np.testing.assert_equal(ours.reset(), theirs.reset())
    ended, truncated, endings = 0, 0, set()
    for step, action in enumerate(opening_hands(3, 40)):
        observation, reward, dones, infos = ours.step(action)
        expected = theirs.step(action)
        np.testing.assert_equal(observation, expected[0])
        np.testing.assert_array_equal(reward, expected[1])
        np.testing.assert_array_equal(dones, expected[2])
        same_infos(infos, expected[3], f"step {step}")
        assert ours.reset_infos == theirs.reset_infos
        ended += dones.sum()
        truncated += sum(info["TimeLimit.truncated"] for info in infos)
        endings |= {info.get("ending") for info in infos}
    assert ended >= 9 and truncated >= 6
    assert endings == ({None} if name == "GraspLift" else {None, "dropped"})


def test_infos_of_episode_ends_alone_are_those_of_every_step_there():
    settings = {"seed": 7, "max_episode_steps": 12, "tactile": "none"}
    every = make_vec_env("ruffini/HoldStill-v0", 3, **settings)
    ends = make_vec_env("ruffini/HoldStill-v0", 3, infos="episode ends", **settings)
    every.reset()
    ends.reset()
    for step, action in enumerate(opening_hands(3, 30)):
        *_, dones, expected = every.step(action)
        *_, found = ends.step(action)
        same_infos(found, [i if d else {} for i, d in zip(expected, dones, strict=True)], f"{step}")
    with pytest.raises(ValueError, match="infos: found 'never', expected 'every step' or"):
        make_vec_env(ID, 2, infos="never")


def rows_of(envs) -> list[bytes]:
    return list(envs.envs.state())


def test_reads_of_some_rows_are_those_rows_own():
    settings = {"render_mode": "rgb_array", "width": 64, "height": 48, "observation": "object"}
    envs = make_vec_env(ID, 3, seed=0, **settings)
    singles = DummyVecEnv([lambda: gym.make(ID, **settings)] * 3)
    singles.seed(0)
    envs.reset()
    singles.reset()
    assert envs.get_attr("num_envs", [0, 2]) == [3, 3]
    assert envs.env_is_wrapped(Monitor) == [False] * 3
    assert envs.env_is_wrapped(Monitor, 1) == [False]
    for rows in (None, 1, -1, np.int64(2), [2, 0], np.array([1])):
        asked = [rows] if isinstance(rows, np.integer) else rows
        for name in ("look", "state", "channels", "skin"):
            expected = singles.env_method(name, indices=asked)
            np.testing.assert_equal(envs.env_method(name, indices=rows), expected)
            np.testing.assert_equal([of() for of in envs.get_attr(name, rows)], expected)
        pictures = singles.env_method("render", indices=asked)
        np.testing.assert_array_equal(envs.env_method("render", indices=rows), pictures)
        for name in ("observation_space", "action_space", "render_mode"):
            assert envs.get_attr(name, rows) == singles.get_attr(name, asked), (name, rows)
    assert envs.env_method("look", indices=[]) == []
    for name in _rows._METHODS:
        assert f"``{name}``" in envs.env_method.__doc__, name
    assert [image.shape for image in envs.get_images()] == [(48, 64, 3)] * 3
    # As the batch returns without the adapter.
    assert list(envs.envs.call("look")) == singles.env_method("look")
    assert envs.envs.call("num_envs") == (3, 3, 3)


@pytest.mark.parametrize("obs", ["dict", "flat"])
def test_a_reset_of_some_rows_leaves_the_others_alone(obs):
    settings = {"tactile": "none", "obs": obs}
    envs = make_vec_env(ID, 3, seed=0, **settings)
    singles = DummyVecEnv([lambda: gym.make(ID, **settings)] * 3)
    singles.seed(0)
    envs.reset()
    singles.reset()
    acts = actions(3, 20)
    for seed, action in zip([None, 5], acts, strict=False):
        envs.step(action)
        singles.step(action)
        found = envs.env_method("reset", seed=seed, indices=[2, 0])
        expected = singles.env_method("reset", seed=seed, indices=[2, 0])
        for (ours, our_info), (theirs, their_info) in zip(found, expected, strict=True):
            np.testing.assert_equal(ours, theirs)
            assert our_info == their_info == {}
        assert rows_of(envs)[1] == singles.env_method("state")[1]
    for action in acts:
        found, expected = envs.step(action), singles.step(action)
        np.testing.assert_equal(found[0], expected[0])


def test_nothing_acts_on_the_whole_batch_when_some_rows_are_asked():
    envs = make_vec_env(ID, 3, seed=0, tactile="none")
    envs.reset()
    before = rows_of(envs)
    calls = [
        ("set_state", before[0]),
        ("set_state", before[:1]),
        ("plan", True),
        ("close",),
        ("call", "look"),
        ("step", np.zeros(5, np.float32)),
    ]
    for name, *arguments in calls:
        with pytest.raises(ValueError, match=name):
            envs.env_method(name, *arguments, indices=[1])
    for name in ("plan", "close", "unwrapped"):
        with pytest.raises(ValueError, match=f"found 2 of 3 rows, expected all: they share {name}"):
            envs.get_attr(name, [0, 1])
    with pytest.raises(ValueError, match="found 1 of 3 rows, expected all: they share label"):
        envs.set_attr("label", 1, indices=0)
    with pytest.raises(ValueError, match="step"):
        envs.env_method("step", np.zeros(5, np.float32))
    for rows in (3, [-4], [True, False, True], [0.0], ["0"]):
        with pytest.raises(ValueError, match="expected rows from -3 to 2"):
            envs.get_attr("num_envs", rows)
    with pytest.raises(ValueError, match="expected each row once"):
        envs.set_attr("label", 1, indices=[0, 1, -2])
    assert rows_of(envs) == before and not envs.has_attr("label")


def test_what_all_rows_are_asked_acts_on_all():
    envs = make_vec_env(ID, 2, seed=0, tactile="none", obs="flat")
    first = envs.reset()
    states = rows_of(envs)
    envs.step(np.zeros((2, 5), np.float32))
    assert len(envs.env_method("plan")) == 2
    for put_back in (states, list(reversed(states))):
        rows = None if put_back is states else [1, 0]
        found = envs.env_method("set_state", put_back, indices=rows)
        expected = first if put_back is states else first[::-1]
        np.testing.assert_array_equal(found, expected)
        assert rows_of(envs) == states
    envs.env_method("set_state", states[1])
    assert rows_of(envs) == [states[1]] * 2
    envs.set_attr("label", 1)
    assert envs.get_attr("label") == [1] * 2
    assert envs.get_attr("label", 1) == [1]


@pytest.mark.parametrize("name", ["mass", "friction", "max_episode_steps", "obs", "num_threads"])
def test_settings_are_not_changed_by_attributes(name):
    envs = VecMonitor(make_vec_env(ID, 2, tactile="none"))
    batch = envs.venv.envs
    for change in (
        lambda: envs.set_attr(name, 1),
        lambda: envs.set_attr(name, 1, indices=[0]),
        lambda: batch.set_attr(name, 1),
        lambda: batch.set_attr(name, [1, 1]),
    ):
        with pytest.raises(ValueError, match=f"^{name}: found a change of a setting, expected a n"):
            change()
    assert not hasattr(batch, name)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"nenvs": 2}, "found nenvs, expected n_envs"),
        ({"n_env": 2}, "found n_env, expected n_envs"),
        ({"env_kwargs": {"mass": 0.1}}, "found env_kwargs, expected its entries as arguments"),
        ({"monitor_dir": "a"}, "found monitor_dir, expected stable_baselines3.common.vec_env.VecM"),
        ({"vec_env_cls": DummyVecEnv}, "found vec_env_cls, expected none of them: rows are step"),
        ({"wrapper_class": gym.Wrapper}, "found wrapper_class, .* in ruffini.custom, .* VecEnvWr"),
    ],
)
def test_arguments_of_stable_baselines3_are_answered_with_what_takes_their_place(given, expected):
    with pytest.raises(ValueError, match=f"^make_vec_env: {expected}"):
        make_vec_env("ruffini/GraspLift-v0", **given)


@pytest.mark.parametrize("name", ["GraspLift", "ruffini/GraspLift-v7", "CartPole-v1"])
def test_an_unknown_environment_is_told_what_an_id_looks_like(name):
    with pytest.raises(
        (gym.error.UnregisteredEnv, ValueError), match=f"env_id: found '{name}', exp"
    ):
        make_vec_env(name)


def test_ppo_learns_on_dict_observations():
    envs = VecMonitor(make_vec_env(ID, 4, seed=0, max_episode_steps=20))
    PPO("MultiInputPolicy", envs, n_steps=64, batch_size=64, n_epochs=1).learn(512)


def test_the_encoder_of_touch_treats_both_pads_alike():
    import torch
    from gymnasium.spaces import Box, Dict

    sizes = {"proprio": 14, "markers": 210, "stress": 240}
    space = Dict({name: Box(-1, 1, (size,), np.float32) for name, size in sizes.items()})
    extractor = TouchExtractor(space)
    drawn = torch.Generator().manual_seed(0)
    given = {name: torch.rand(3, size, generator=drawn) for name, size in sizes.items()}
    features = extractor(given)
    assert features.shape == (3, extractor.features_dim) == (3, 14 + 2 * 2 * 32)
    swapped = given | {"markers": torch.roll(given["markers"], 105, dims=1)}
    # A space has its channels by name: 64 features of the markers come first.
    ours, theirs = features[:, :64], extractor(swapped)[:, :64]
    torch.testing.assert_close(torch.roll(ours, 32, dims=1), theirs)
    torch.testing.assert_close(features[:, 64:78], given["proprio"])


def test_ppo_learns_on_touch():
    settings = {"tactile": "compliance", "resolution": {"nodes": 300}, "max_episode_steps": 20}
    envs = make_vec_env("ruffini/HoldStill-v0", 2, seed=0, **settings)
    kwargs = {"features_extractor_class": TouchExtractor, "net_arch": [32]}
    PPO("MultiInputPolicy", envs, n_steps=16, batch_size=16, policy_kwargs=kwargs).learn(32)


def test_pictures_go_through_convolutions():
    import torch
    from gymnasium.spaces import Box, Dict

    frames, shape, size = 2, (20, 15, 3), 20 * 15 * 3
    sizes = {"image": 2 * 2 * size, "proprio": 28}
    space = Dict({name: Box(0, 1, (size,), np.float32) for name, size in sizes.items()})
    torch.manual_seed(0)
    extractor = TouchExtractor(space, frames=frames, pictures={"image": shape})
    image = torch.rand(3, frames, 2, *shape)
    given = {"image": image.flatten(1), "proprio": torch.zeros(3, 28)}
    features = extractor(given)[:, :64].reshape(3, 2, 32)
    # As a picture with all colours of both frames, pad by pad.
    for pad in range(2):
        seen = torch.cat([image[:, frame, pad].permute(0, 3, 1, 2) for frame in range(2)], dim=1)
        own = extractor._pads["image"].layers(seen)
        torch.testing.assert_close(features[:, pad], WEAK * own)
    for wrong, match in (
        ({"image": (20, 15)}, r"image \(20, 15\), expected rows, columns and colours of the 900"),
        ({"image": (15, 15, 3)}, r"found image \(15, 15, 3\)"),
        ({"depth": (20, 15, 1)}, "pictures: found depth, expected some of image, proprio"),
    ):
        with pytest.raises(ValueError, match=match):
            TouchExtractor(space, frames=frames, pictures=wrong)


def test_ppo_learns_on_pictures():
    given = {"resolution": {"image": (15, 20), "nodes": 300}, "tactile": "compliance"}
    observed = {"observation": ["proprio", "image"], "max_episode_steps": 20}
    envs = make_vec_env("ruffini/HoldStill-v0", 2, seed=0, **given, **observed)
    kwargs = {
        "features_extractor_class": TouchExtractor,
        "features_extractor_kwargs": {"pictures": {"image": (20, 15, 3)}},
    }
    model = PPO("MultiInputPolicy", envs, n_steps=16, batch_size=16, policy_kwargs=kwargs)
    [first, *_] = model.policy.features_extractor._pads["image"].layers
    before = first.weight.detach().clone()
    model.learn(32)
    assert (first.weight != before).any()
    with pytest.raises(ValueError, match="features_extractor_kwargs: found pictures, expected"):
        _checked(model)


def test_networks_of_channels_say_what_they_need():
    privileged = {"privileged": ["proprio"]}
    flat, dicts = (make_vec_env(ID, 1, obs=obs, tactile="none") for obs in ("flat", "dict"))
    for policy, kwargs in (
        (AsymmetricPolicy, privileged),
        ("MlpPolicy", {"features_extractor_class": TouchExtractor}),
    ):
        with pytest.raises(ValueError, match=r"observation_space: found Box .*expected a Dict"):
            PPO(policy, flat, policy_kwargs=kwargs, device="cpu")
    with pytest.raises(ValueError, match=r"privileged: found 'object', .* list .*\['object'\]"):
        PPO(AsymmetricPolicy, dicts, policy_kwargs={"privileged": "object"}, device="cpu")
    with pytest.raises(
        ValueError, match=r"policy: found AsymmetricPolicy .* expected PPO, A2C or TRPO"
    ):
        SAC(AsymmetricPolicy, dicts, policy_kwargs=privileged, buffer_size=10, device="cpu")


def test_an_asymmetric_policy_is_saved_and_loaded(tmp_path):
    dicts = make_vec_env(ID, 1, tactile="none")
    policy = AsymmetricPolicy(
        dicts.observation_space, dicts.action_space, lambda _: 0.0, privileged=["object"]
    )
    policy.save(str(tmp_path / "policy.pt"))
    again = AsymmetricPolicy.load(str(tmp_path / "policy.pt"), device="cpu")
    assert again.seen == ["proprio"]
    for name, values in policy.state_dict().items():
        np.testing.assert_array_equal(again.state_dict()[name], values)


def test_sac_learns_on_flat_observations():
    envs = make_vec_env(ID, 2, seed=0, max_episode_steps=20, obs="flat")
    SAC("MlpPolicy", envs, learning_starts=20, buffer_size=1000, batch_size=32).learn(60)
