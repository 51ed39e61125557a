"""The Stable-Baselines3 adapter."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO, SAC
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecMonitor

from ruffini.envs import GraspLiftEnv
from ruffini.sb3 import TouchExtractor, make_vec_env

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


def test_attributes_and_methods_honour_indices():
    envs = make_vec_env(ID, 3, render_mode="rgb_array", width=64, height=48)
    envs.reset()
    assert envs.get_attr("num_envs", [0, 2]) == [3, 3]
    assert envs.env_is_wrapped(Monitor) == [False] * 3
    assert envs.env_is_wrapped(Monitor, 1) == [False]
    third = envs.envs.look(2)
    assert envs.env_method("look", indices=[2]) == [third]
    assert envs.env_method("state", indices=2) == [envs.envs.state()[2]]
    with pytest.raises(ValueError, match="expected all"):
        envs.set_attr("label", 1, indices=0)
    envs.set_attr("label", 1)
    assert envs.get_attr("label") == [1] * 3
    assert [image.shape for image in envs.get_images()] == [(48, 64, 3)] * 3


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


def test_sac_learns_on_flat_observations():
    envs = make_vec_env(ID, 2, seed=0, max_episode_steps=20, obs="flat")
    SAC("MlpPolicy", envs, learning_starts=20, buffer_size=1000, batch_size=32).learn(60)


def test_a_stopped_run_goes_on_from_its_checkpoint(tmp_path):
    from train import train

    first = train(ID, "ppo", 0, tmp_path, steps=8192)
    assert first.num_timesteps == 8192
    second = train(ID, "ppo", 0, tmp_path, steps=16384, resume=True)
    assert second.num_timesteps == 16384
    assert (tmp_path / "checkpoint" / "model.zip").is_file()
