"""RLlib and TorchRL run the environments as they are, with touch: where they are installed."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import pytest

ID = "ruffini:ruffini/GraspLift-v0"


def test_an_unknown_setting_is_named_as_python_does():
    # TorchRL offers every environment a frameskip and takes it back if the name is refused so.
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip', expected one of"):
        gym.make(ID, frameskip=1)


@pytest.mark.filterwarnings("default")
def test_rllib_trains_on_the_native_batch():
    ppo = pytest.importorskip("ray.rllib.algorithms.ppo")
    settings = {"obs": "flat", "max_episode_steps": 10}
    runners = {"num_envs_per_env_runner": 4, "gym_env_vectorize_mode": "vector_entry_point"}
    sizes = {"train_batch_size_per_learner": 128, "minibatch_size": 64, "num_epochs": 1}
    config = ppo.PPOConfig().environment(ID, env_config=settings)
    config = config.env_runners(num_env_runners=0, **runners).training(**sizes)
    algorithm = config.build_algo()
    try:
        found = algorithm.train()["env_runners"]
    finally:
        algorithm.stop()
    # Rows are reset on the step after their end: episodes have no step too many.
    assert found["num_episodes"] >= 8
    assert found["episode_len_min"] == found["episode_len_max"] == 10


@pytest.mark.filterwarnings("default")
def test_torchrl_steps_and_resets_single_and_batch():
    envs = pytest.importorskip("torchrl.envs")
    from torchrl.envs.utils import check_env_specs

    alone = envs.GymEnv(ID, max_episode_steps=5)
    check_env_specs(alone)
    assert alone.rollout(12).shape == (5,)
    batch = gym.make_vec(ID, num_envs=3, max_episode_steps=5, autoreset_mode="Disabled")
    batch = envs.GymWrapper(batch)
    check_env_specs(batch)
    rollout = batch.rollout(12, break_when_any_done=False)
    assert rollout["next", "done"].sum(1).flatten().tolist() == [2, 2, 2]
    assert rollout["markers"].shape == (3, 12, 210)


class WithoutInfos(gym.vector.VectorWrapper):
    """Leaves no info but the last observation of an episode."""

    @property
    def autoreset_mode(self) -> Any:
        return self.env.autoreset_mode

    def step(self, actions: Any) -> Any:
        *rest, info = self.env.step(actions)
        return *rest, {k: v for k, v in info.items() if k.lstrip("_") == "final_obs"}


@pytest.mark.filterwarnings("default")
def test_torchrl_takes_no_batch_with_dict_infos_or_observations_that_resets_in_the_same_step():
    envs = pytest.importorskip("torchrl.envs")
    settings = {"max_episode_steps": 5, "tactile": "none", "observation": "time"}
    same = {"autoreset_mode": "SameStep"}

    def native(**more: Any) -> Any:
        return gym.make_vec(ID, num_envs=2, **same, **settings, **more)

    singles = [lambda: gym.make(ID, **settings, obs="flat")] * 2
    # The terms of the reward are a dict in info: TorchRL reads each info as one tensor.
    refusals = []
    for batch in (native(obs="flat"), gym.vector.SyncVectorEnv(singles, **same)):
        with pytest.raises((AttributeError, TypeError)) as refusal:
            envs.GymWrapper(batch).rollout(6, break_when_any_done=False)
        refusals.append((refusal.type, str(refusal.value)))
    assert refusals[0] == refusals[1], "gymnasium's own batch fails otherwise"
    # Without infos, it loses the last observation of an episode if that is a dict.
    ends = {}
    for obs, key in (("flat", "observation"), ("dict", "time")):
        batch = envs.GymWrapper(WithoutInfos(native(obs=obs)))
        ends[obs] = batch.rollout(6, break_when_any_done=False)["next", key][0, 4].item()
    assert ends == {"flat": pytest.approx(5 * 0.04), "dict": 0.0}
