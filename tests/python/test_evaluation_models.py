"""Models of Stable-Baselines3 that are judged without what they act through are refused."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import ruffini
from ruffini.evaluation import evaluate

sb3 = pytest.importorskip("stable_baselines3")
vec_env = pytest.importorskip("stable_baselines3.common.vec_env")
torch = pytest.importorskip("torch")
RIGID = {"tactile": "none", "objects": "sphere", "max_episode_steps": 3}
LIFT = "ruffini/GraspLift-v0"
LOW = np.full(5, -0.1, np.float32)


to_sb3 = pytest.importorskip("ruffini.agents.sb3").to_sb3


def model(env, policy="MlpPolicy"):
    envs = vec_env.DummyVecEnv([env])
    return sb3.PPO(policy, envs, n_steps=4, batch_size=4, n_epochs=1, seed=0)


def flat(**settings):
    return gym.make(LIFT, obs="flat", **RIGID, **settings)


def test_a_policy_without_its_model_is_refused():
    agent = ruffini.agents.load("GraspLift")
    whole = to_sb3(agent, n_envs=8)
    with pytest.raises(ValueError, match=r"found the .*Policy of a model by itself"):
        evaluate(whole.policy, agent.env_id, 1, **agent.settings)


@pytest.mark.parametrize(
    ("wrapped", "text"),
    [
        (lambda: gym.wrappers.TransformAction(flat(), lambda a: -a, None), "in a TransformAction"),
        (lambda: gym.wrappers.NormalizeObservation(flat()), "in a NormalizeObservation"),
        (lambda: gym.wrappers.RescaleAction(flat(), LOW, -LOW), "in a RescaleAction"),
    ],
)
def test_a_wrapper_of_single_environments_is_seen(wrapped, text):
    with pytest.raises(ValueError, match=text):
        evaluate(model(wrapped), LIFT, 1, obs="flat", **RIGID)


def test_wrappers_that_only_watch_are_taken():
    watched = model(lambda: gym.wrappers.RecordEpisodeStatistics(flat()))
    assert evaluate(watched, LIFT, 1, obs="flat", **RIGID)["episodes"] == 1


def test_a_wrapper_in_another_process_is_seen():
    small = {"n_steps": 4, "batch_size": 4, "n_epochs": 1}
    for wrapper, text in (
        (gym.wrappers.NormalizeObservation, "in a NormalizeObservation"),
        (gym.wrappers.RecordEpisodeStatistics, None),
    ):
        envs = vec_env.SubprocVecEnv([lambda wrapper=wrapper: wrapper(flat())])
        made = sb3.PPO("MlpPolicy", envs, **small)
        try:
            if text is None:
                assert evaluate(made, LIFT, 1, obs="flat", **RIGID)["episodes"] == 1
                continue
            with pytest.raises(ValueError, match=text):
                evaluate(made, LIFT, 1, obs="flat", **RIGID)
        finally:
            envs.close()


def test_a_loaded_model_of_observations_without_bounds_is_refused(tmp_path):
    model(lambda: gym.wrappers.NormalizeObservation(flat())).save(tmp_path / "m.zip")
    with pytest.raises(ValueError, match="found one trained on observations without bounds"):
        evaluate(sb3.PPO.load(tmp_path / "m.zip"), LIFT, 1, obs="flat", **RIGID)


def test_a_loaded_model_with_other_actions_is_refused(tmp_path):
    model(lambda: gym.wrappers.RescaleAction(flat(), LOW, -LOW)).save(tmp_path / "m.zip")
    with pytest.raises(ValueError, match=r"actions from -0\.1 to 0\.1, expected -1 to 1"):
        evaluate(sb3.PPO.load(tmp_path / "m.zip"), LIFT, 1, obs="flat", **RIGID)


def test_flat_observations_in_another_order_are_refused():
    there, back = ["proprio", "object"], ["object", "proprio"]
    trained = model(lambda: flat(observation=there))
    assert evaluate(trained, LIFT, 1, obs="flat", observation=there, **RIGID)["episodes"] == 1
    with pytest.raises(ValueError, match="flat observations in another order"):
        evaluate(trained, LIFT, 1, obs="flat", observation=back, **RIGID)


def test_the_encoder_of_touch_keeps_a_pad_together_over_frames():
    from ruffini.sb3 import TouchExtractor, make_vec_env

    single = make_vec_env(LIFT, n_envs=1)
    stacked = vec_env.VecFrameStack(single, 3)
    encoder = TouchExtractor(stacked.observation_space, frames=3)
    seen = {
        name: torch.zeros(1, *box.shape, requires_grad=name == "markers")
        for name, box in stacked.observation_space.items()
    }
    values = encoder(seen)
    width = 32
    names = list(stacked.observation_space)
    before = sum(
        stacked.observation_space[name].shape[0] for name in names[: names.index("markers")]
    )
    values[0, before : before + width].sum().backward()
    reached = seen["markers"].grad.reshape(3, 2, -1).abs().sum(-1) > 0
    np.testing.assert_array_equal(reached, [[True, False]] * 3)
    with pytest.raises(ValueError, match="frames: found 4, expected a divisor"):
        TouchExtractor(stacked.observation_space, frames=4)


def test_few_values_in_many_frames_are_no_field():
    from ruffini.sb3 import fields, make_vec_env, normalize

    seen = ["proprio", "slip", "markers"]
    tactile = {"tactile": "compliance", "resolution": {"nodes": 150}}
    stacked = vec_env.VecFrameStack(make_vec_env(LIFT, 1, observation=seen, **tactile), 4)
    assert fields(stacked.observation_space, 4) == ["markers"]
    assert normalize(stacked).norm_obs_keys == ["proprio", "slip"]


def test_films_have_the_rate_of_the_environment():
    from ruffini.sb3 import make_vec_env

    physics = {"control_period": 0.02}
    assert make_vec_env(LIFT, 1, tactile="none", physics=physics).metadata["render_fps"] == 50


def test_arguments_that_are_asked_for_elsewhere_say_where():
    for name, text in (("seed", "expected first_seed"), ("num_envs", "expected episodes")):
        with pytest.raises(TypeError, match=text):
            evaluate(lambda seen: seen, LIFT, 1, **{name: 1})
    with pytest.raises(TypeError, match=r"'seed', expected reset\(seed=\.\.\.\)"):
        gym.make(LIFT, seed=0)
    with pytest.raises(TypeError, match=r"'num_envs', expected it in gymnasium\.make_vec"):
        gym.make(LIFT, num_envs=3)
