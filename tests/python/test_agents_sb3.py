"""Agents against Stable-Baselines3: the same actions there, in numpy, and back."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.torch_layers import CombinedExtractor
from stable_baselines3.common.vec_env import (
    VecCheckNan,
    VecEnvWrapper,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
    is_vecenv_wrapped,
)
from tiny_agent import BLIND, HOLD, LIFT, TOUCH, exported, trained

from ruffini.agents import Agent, first_seed, load
from ruffini.agents.sb3 import export, from_sb3, to_sb3
from ruffini.evaluation import as_policy, evaluate
from ruffini.sb3 import AsymmetricPolicy, fields, make_vec_env, normalize
from ruffini.video import film

MARKERS = TOUCH | {"observation": ["wrench", "markers", "proprio"]}
KINDS = {
    "touch": {"env_id": HOLD, "settings": MARKERS},
    "two fields": {
        "env_id": LIFT,
        "settings": TOUCH | {"observation": ["stress", "object", "markers"]},
    },
    "as it is": {"env_id": HOLD, "settings": TOUCH, "extractor": CombinedExtractor},
    "flat": {"env_id": HOLD, "settings": TOUCH, "obs": "flat"},
    "rigid": {"env_id": LIFT, "settings": BLIND, "obs": "flat"},
    "relu": {"env_id": LIFT, "settings": BLIND, "activation_fn": torch.nn.ReLU},
    "elu": {"env_id": LIFT, "settings": BLIND, "activation_fn": torch.nn.ELU},
}
ROUNDING = 1e-5
"""Of single precision through three layers of features of order ten."""


@pytest.fixture(scope="module", params=KINDS)
def trio(request, tmp_path_factory):
    """A model, its normaliser and its agent, read from the file."""
    path = tmp_path_factory.mktemp("agents") / "tiny.safetensors"
    model, normaliser, agent = exported(path, **KINDS[request.param])
    read = load(path)
    assert read.card == agent.card
    return model, normaliser, read


def seen(agent, obs, steps=12):
    """Observations of episodes in which the agent acts with noise; the last ones random."""
    envs = make_vec_env(agent.env_id, 3, seed=7, obs=obs, **agent.settings)
    observation = envs.reset()
    for _ in range(steps):
        yield observation
        action, _ = agent.predict(observation, deterministic=False)
        observation, *_ = envs.step(action)
    drawn = np.random.default_rng(0)
    for scale in (1e-3, 1.0, 1e3):
        yield _random(drawn, observation, scale)


def _random(drawn, like, scale):
    if isinstance(like, dict):
        return {name: _random(drawn, values, scale) for name, values in like.items()}
    return (scale * drawn.standard_normal(like.shape)).astype(np.float32)


def kind(model):
    return "dict" if isinstance(model.policy.observation_space.sample(), dict) else "flat"


def test_an_agent_acts_as_the_model_does(trio):
    model, normaliser, agent = trio
    moved = 0.0
    for observation in seen(agent, kind(model)):
        expected, _ = model.predict(normaliser.normalize_obs(observation), deterministic=True)
        found, _ = agent.predict(observation)
        assert found.shape == (3, 5) and found.dtype == np.float32
        assert np.abs(found - expected).max() <= ROUNDING, (found, expected)
        moved = max(moved, float(np.ptp(found)))
    assert moved > 1e-3, "actions that do not depend on anything"


def test_dict_and_flat_observations_of_one_or_many_give_the_same_actions(trio):
    _, _, agent = trio
    for channels in list(seen(agent, "dict"))[:5]:
        flat = np.concatenate([channels[name] for name in agent.channels], axis=1)
        action, state = agent.predict(channels, state="kept")
        assert state == "kept"
        np.testing.assert_array_equal(agent.predict(flat)[0], action)
        alone, _ = agent.predict({name: values[1] for name, values in channels.items()})
        assert alone.shape == (5,)
        np.testing.assert_allclose(alone, action[1], atol=1e-6)
        np.testing.assert_array_equal(agent.predict(flat[1])[0], alone)


def test_drawn_actions_spread_as_the_models(trio):
    model, _, agent = trio
    observation = next(iter(seen(agent, "dict")))
    agent.seed(3)
    many = np.array([agent.predict(observation, deterministic=False)[0] for _ in range(500)])
    agent.seed(3)
    np.testing.assert_array_equal(agent.predict(observation, deterministic=False)[0], many[0])
    # Medians and quartiles are not affected by the clip at 1.
    mean, _ = agent.predict(observation)
    middle = np.median(many, axis=0)
    spread = np.exp(model.policy.log_std.detach().numpy())
    assert np.abs(middle - mean).max() < 5 * 1.25 * spread.max() / np.sqrt(500)
    inner = np.abs(mean) < 0.05
    quartiles = np.ptp(np.quantile(many, (0.25, 0.75), axis=0), axis=0) / 1.349
    ratio = (quartiles / spread)[inner]
    assert (np.abs(ratio - 1) < 0.25).all(), ratio


def test_a_model_made_from_an_agent_acts_as_the_one_it_was(trio):
    model, normaliser, agent = trio
    again = to_sb3(agent)
    fresh = again.get_vec_normalize_env()
    for observation in seen(agent, kind(model)):
        normal, expected = fresh.normalize_obs(observation), normaliser.normalize_obs(observation)
        tensor, _ = model.policy.obs_to_tensor(expected)
        np.testing.assert_array_equal(
            again.predict(normal, deterministic=True)[0],
            model.predict(expected, deterministic=True)[0],
        )
        with torch.no_grad():
            torch.testing.assert_close(
                again.policy.predict_values(again.policy.obs_to_tensor(normal)[0]),
                model.policy.predict_values(tensor),
                rtol=0,
                atol=0,
            )


def test_an_agent_goes_on_training(tmp_path):
    path = tmp_path / "tiny.safetensors"
    model, normaliser, agent = exported(path, settings=MARKERS)
    assert agent.card["steps"] == model.num_timesteps == 128
    again = to_sb3(agent, n_envs=4, learning_rate=1e-4)
    assert (again.n_envs, again.n_steps, again.learning_rate) == (4, 32, 1e-4)
    counted = again.get_vec_normalize_env().obs_rms["proprio"].count
    assert counted == normaliser.obs_rms["proprio"].count
    again.learn(128, reset_num_timesteps=False)
    assert again.num_timesteps == 256
    assert again.get_vec_normalize_env().obs_rms["proprio"].count == counted + 4 * 33
    envs = make_vec_env(HOLD, 2, seed=0, **(MARKERS | {"load": 0.5}))
    to_sb3(agent, envs).learn(64)
    with pytest.raises(ValueError, match=r"found channels .*, expected the environment's: "):
        to_sb3(agent, make_vec_env(HOLD, 2, **TOUCH))


def test_models_that_no_agent_can_stand_for_are_refused(tmp_path):
    about = {"env_id": LIFT, "settings": BLIND, "seed": 0, "threads": 1, "commit": ""}
    path = tmp_path / "tiny.safetensors"
    envs = make_vec_env(LIFT, 2, **BLIND)
    with pytest.raises(ValueError, match="found SAC, expected PPO"):
        export(SAC("MultiInputPolicy", envs, buffer_size=10), None, path, **about)
    model, normaliser = trained(LIFT, BLIND, steps=64, activation_fn=torch.nn.SiLU)
    with pytest.raises(ValueError, match="activation_fn: found SiLU, expected"):
        export(model, normaliser, path, **about)
    model, normaliser = trained(LIFT, BLIND, steps=64, share_features_extractor=False)
    with pytest.raises(ValueError, match="share_features_extractor: found False"):
        export(model, normaliser, path, **about)
    explored = PPO("MultiInputPolicy", envs, n_steps=32, use_sde=True, device="cpu")
    with pytest.raises(ValueError, match="use_sde: found True"):
        export(explored, None, path, **about)
    assert not path.exists()


def test_a_model_without_a_normaliser_is_an_agent_too(tmp_path):
    envs = make_vec_env(LIFT, 2, seed=0, **BLIND)
    model = PPO("MultiInputPolicy", envs, n_steps=32, device="cpu").learn(64)
    about = {"seed": 0, "threads": 1, "commit": "", "episodes": 1}
    path = tmp_path / "bare.safetensors"
    # Of the environments, too, a normalisation is taken only if there is one.
    for normaliser in (None, envs):
        export(model, normaliser, path, env_id=LIFT, settings=BLIND, **about)
        agent = Agent.read(path)
        for observation in seen(agent, "dict"):
            expected, _ = model.predict(observation, deterministic=True)
            assert np.abs(agent.predict(observation)[0] - expected).max() <= ROUNDING
    assert to_sb3(agent).get_vec_normalize_env().norm_obs is False


@pytest.mark.parametrize("obs", ["dict", "flat"])
def test_a_model_is_judged_on_observations_normalised_as_in_training(tmp_path, obs):
    model, normaliser = trained(LIFT, BLIND, obs=obs)
    about = {"seed": 0, "threads": 1, "commit": "", "env_id": LIFT, "settings": BLIND}
    agent = from_sb3(model, None, **about)
    envs = make_vec_env(LIFT, 2, obs=obs, **BLIND)
    raw = next(seen(agent, obs))
    expected, _ = agent.predict(raw)

    def off(policy):
        return np.abs(policy.predict(raw, deterministic=True)[0] - expected).max()

    assert off(as_policy(model, envs.observation_space)) <= ROUNDING < 100 * ROUNDING < off(model)
    model.save(tmp_path / "model.zip")
    normaliser.save(tmp_path / "model.pkl")
    alone = PPO.load(tmp_path / "model.zip", device="cpu")
    settings = BLIND | {"obs": obs}
    for judge in (
        lambda: evaluate(alone, LIFT, 3, **settings),
        lambda: from_sb3(alone, None, **about),
    ):
        with pytest.raises(ValueError, match="normalised observations, and no VecNormalize with"):
            judge()
    both = VecNormalize.load(tmp_path / "model.pkl", envs)
    again = PPO.load(tmp_path / "model.zip", both, device="cpu")
    assert off(as_policy(again)) <= ROUNDING
    assert evaluate(again, LIFT, 3, **settings) == evaluate(model, LIFT, 3, **settings)


class Flipped(VecEnvWrapper):
    """Turns actions round."""

    def reset(self):
        return self.venv.reset()

    def step_async(self, actions):
        self.venv.step_async(-actions)

    def step_wait(self):
        return self.venv.step_wait()


def judges(model, env_id, settings, folder):
    """All that judge a model."""
    about = {"seed": 0, "threads": 1, "commit": "", "env_id": env_id, "settings": settings}
    return [
        lambda: evaluate(model, env_id, 2, **settings),
        lambda: film(model, env_id, folder / "a.gif", range(1), **settings),
        lambda: export(model, None, folder / "a.safetensors", **about),
        lambda: export(model, model.get_env(), folder / "a.safetensors", **about),
    ]


@pytest.mark.parametrize("source", ["learnt", "from an agent"])
def test_a_model_that_lost_its_normaliser_is_not_judged(tmp_path, source):
    file = tmp_path / "model.zip"
    model, _ = trained(LIFT, BLIND)
    if source == "from an agent":
        about = {"seed": 0, "threads": 1, "commit": "", "env_id": LIFT, "settings": BLIND}
        model = to_sb3(from_sb3(model, None, **about))
    model.save(file)
    for envs, found in (
        (make_vec_env(LIFT, 2, **BLIND), "normalised observations, and no VecNormalize with it"),
        (normalize(make_vec_env(LIFT, 2, **BLIND)), "128 steps with a VecNormalize that has seen"),
    ):
        for judge in judges(PPO.load(file, envs, device="cpu"), LIFT, BLIND, tmp_path):
            with pytest.raises(ValueError, match=f"^policy: found a model (of|trained on) {found}"):
                judge()
    bare = VecNormalize(make_vec_env(LIFT, 2, **BLIND), norm_obs=False)
    assert evaluate(PPO.load(file, bare, device="cpu"), LIFT, 2, **BLIND)["episodes"] == 2


def test_a_model_whose_rewards_alone_were_normalised_is_judged_with_and_without(tmp_path):
    envs = VecNormalize(make_vec_env(LIFT, 2, seed=0, **BLIND), norm_obs=False)
    model = PPO("MultiInputPolicy", envs, n_steps=32, batch_size=32, device="cpu").learn(64)
    told = evaluate(model, LIFT, 2, **BLIND)
    model.save(tmp_path / "model.zip")
    again = PPO.load(tmp_path / "model.zip", envs, device="cpu")
    assert evaluate(again, LIFT, 2, **BLIND) == told


@pytest.mark.parametrize(
    "wrapper", [lambda envs: VecFrameStack(envs, 2), Flipped], ids=["frames", "actions"]
)
def test_a_model_that_acts_through_a_wrapper_is_not_judged_without_it(tmp_path, wrapper):
    envs = VecMonitor(wrapper(make_vec_env(LIFT, 2, obs="flat", **BLIND)))
    model = PPO("MlpPolicy", envs, n_steps=32, batch_size=32, device="cpu")
    for judge in judges(model, LIFT, BLIND | {"obs": "flat"}, tmp_path):
        with pytest.raises(ValueError, match=r"in a (VecFrameStack|Flipped), .*evaluate_policy"):
            judge()


def test_wrappers_that_change_nothing_are_no_matter():
    envs = VecCheckNan(VecMonitor(make_vec_env(LIFT, 2, **BLIND)))
    model = PPO("MultiInputPolicy", envs, n_steps=32, batch_size=32, device="cpu")
    assert evaluate(model, LIFT, 2, **BLIND)["episodes"] == 2


def test_a_model_of_other_observations_is_told_what_it_was_trained_on(tmp_path):
    model, _ = trained(LIFT, BLIND | {"observation": ["proprio"]}, steps=64)
    for judge in (
        lambda: evaluate(model, LIFT, 2, **BLIND),
        lambda: film(model, LIFT, tmp_path / "lift.gif", range(1), **BLIND),
    ):
        with pytest.raises(
            ValueError,
            match=r"trained on proprio \(14,\); the environment gives .*"
            r"object \(16,\).* pass observation=\['proprio'\]",
        ):
            judge()
    with pytest.raises(ValueError, match=r"gives observations \(14,\), .* pass the settings"):
        evaluate(model, LIFT, 2, **BLIND, observation=["proprio"], obs="flat")


def test_fields_of_touch_are_left_out_of_the_normalisation():
    channels = ["proprio", "markers", "wrench", "predicted_error"]
    coarse = {"tactile": "surrogate", "observation": channels}
    envs = normalize(make_vec_env(HOLD, 2, **coarse), gamma=0.9)
    assert fields(envs.observation_space) == ["markers"]
    assert set(envs.norm_obs_keys) == {"proprio", "wrench", "predicted_error"}
    assert (envs.norm_reward, envs.gamma) == (False, 0.9) and is_vecenv_wrapped(envs, VecMonitor)
    monitored = VecMonitor(make_vec_env(HOLD, 1, **BLIND))
    assert normalize(monitored).venv is monitored
    # Of flat observations nothing can be left out.
    flat = normalize(make_vec_env(HOLD, 2, obs="flat", **coarse))
    assert flat.obs_rms.mean.shape == flat.observation_space.shape


def test_privileged_channels_reach_the_value_function_alone(tmp_path):
    settings = TOUCH | {"observation": ["markers", "object", "proprio"]}
    envs = make_vec_env(HOLD, 2, seed=0, **settings)
    normaliser = normalize(envs)
    kwargs = {"privileged": ["object"], "net_arch": [8]}
    model = PPO(AsymmetricPolicy, normaliser, n_steps=32, policy_kwargs=kwargs, device="cpu")
    before = [p.detach().clone() for p in model.policy.vf_features_extractor.parameters()]
    model.learn(64)
    after = model.policy.vf_features_extractor.parameters()
    assert not all(torch.equal(a, b) for a, b in zip(before, after, strict=True))

    observation = normaliser.reset()
    other = observation | {"object": observation["object"] + 1.0}
    actions = [model.predict(seen, deterministic=True)[0] for seen in (observation, other)]
    np.testing.assert_array_equal(*actions)
    tensors = [model.policy.obs_to_tensor(seen)[0] for seen in (observation, other)]
    with torch.no_grad():
        assert not torch.equal(*(model.policy.predict_values(tensor) for tensor in tensors))

    about = {"seed": 0, "threads": 1, "commit": ""}
    asked = TOUCH | {"observation": ["markers", "proprio"]}
    agent = from_sb3(model, normaliser, env_id=HOLD, settings=asked, **about)
    agent.write(tmp_path / "tiny.safetensors")
    agent = load(tmp_path / "tiny.safetensors")
    assert agent.card["network"]["value"] is None and "object" not in agent.channels
    raw = normaliser.get_original_obs()
    found, _ = agent.predict({name: raw[name] for name in agent.channels})
    expected, _ = model.predict(normaliser.normalize_obs(raw), deterministic=True)
    assert np.abs(found - expected).max() <= ROUNDING
    further = to_sb3(agent)
    further.learn(64)
    assert from_sb3(further, further.get_vec_normalize_env(), env_id=HOLD, settings=asked, **about)


@pytest.mark.parametrize("privileged", [["wrench"], ["object", "proprio"], []])
def test_privileged_channels_are_some_of_the_observed_ones(privileged):
    envs = make_vec_env(HOLD, 1, tactile="none", observation=["object", "proprio"], obs="dict")
    with pytest.raises(
        ValueError, match=f"privileged: found {', '.join(privileged) or 'none'}, exp"
    ):
        PPO(AsymmetricPolicy, envs, policy_kwargs={"privileged": privileged}, device="cpu")


def test_runs_share_no_episodes_with_each_other_or_with_an_evaluation():
    firsts = [first_seed(seed, steps) for seed in range(300) for steps in (0, 2048)]
    assert min(firsts) >= 1 << 32, "evaluation seeds are below"
    assert min(np.diff(sorted(firsts))) >= 1 << 16, "room for as many environments"


def test_an_agent_goes_on_in_other_episodes():
    agent = load(LIFT)
    model = to_sb3(agent, n_envs=8)
    base = model.get_env()
    while hasattr(base, "venv"):
        base = base.venv
    first = first_seed(agent.card["seed"], agent.card["steps"])
    assert base._seeds[:2] == [first, first + 1]
