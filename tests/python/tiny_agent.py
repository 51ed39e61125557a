"""Agents that were trained for a moment, so that there are some."""

from __future__ import annotations

from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from ruffini.sb3 import TouchExtractor, fields, make_vec_env

TOUCH = {"tactile": "compliance", "resolution": {"nodes": 150}, "max_episode_steps": 12}
BLIND = {"tactile": "none", "max_episode_steps": 12}
HOLD, LIFT = "ruffini/HoldStill-v0", "ruffini/GraspLift-v0"


def trained(env_id, settings, *, obs="dict", steps=128, extractor=TouchExtractor, **kwargs):
    """A model of PPO and its normaliser."""
    envs = make_vec_env(env_id, 2, seed=0, obs=obs, **settings)
    keys = None
    if obs == "dict":
        felt = fields(envs.observation_space) if extractor is TouchExtractor else []
        keys = [name for name in envs.observation_space if name not in felt]
        kwargs["features_extractor_class"] = extractor
    normaliser = VecNormalize(envs, norm_reward=False, norm_obs_keys=keys)
    policy = "MultiInputPolicy" if obs == "dict" else "MlpPolicy"
    policy_kwargs = {"net_arch": [24, 16], "log_std_init": -0.5} | kwargs
    sizes = {"n_steps": 32, "batch_size": 32, "n_epochs": 2, "learning_rate": 3e-3}
    model = PPO(policy, normaliser, seed=0, device="cpu", policy_kwargs=policy_kwargs, **sizes)
    return model.learn(steps), normaliser


def exported(path, env_id=HOLD, settings=TOUCH, **kwargs):
    """The model, its normaliser, and the agent that is written at `path`."""
    from ruffini.agents.sb3 import export

    model, normaliser = trained(env_id, settings, **kwargs)
    about = {"seed": 0, "threads": 1, "commit": "abc1234", "episodes": 2}
    return (
        model,
        normaliser,
        export(model, normaliser, path, env_id=env_id, settings=settings, **about),
    )
