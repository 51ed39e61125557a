"""RLlib and TorchRL run the environments as they are, with touch: where they are installed."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import gymnasium as gym
import pytest

ID = "ruffini:ruffini/GraspLift-v0"
POLICIES = Path(__file__).resolve().parents[2] / "policies"
SCRIPTS = {"cleanrl": "torch", "rllib": "ray.rllib", "torchrl": "torchrl.envs"}
"""Scripts that train with another library, and the module without which they cannot run."""


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


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_of_one_file_trains_judges_and_saves(name, tmp_path, monkeypatch, capsys):
    pytest.importorskip(SCRIPTS[name])
    script = str(POLICIES / f"train_{name}.py")
    small = ["--steps", "512", "--n-envs", "8", "--episodes", "4", "--out", str(tmp_path / "run")]
    monkeypatch.setattr(sys, "argv", [script, *small])
    runpy.run_path(script, run_name="__main__")
    printed = capsys.readouterr().out
    assert "512 steps" in printed
    assert "%" in printed.splitlines()[-1], "success"
    assert any((tmp_path / "run").iterdir())


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_refuses_what_it_cannot_train_with_in_a_line(name, monkeypatch, capsys):
    pytest.importorskip(SCRIPTS[name])
    script = str(POLICIES / f"train_{name}.py")
    for option, value, told in (
        ("--steps", "0", "--steps, --n-envs and --episodes: expected at least 1"),
        ("--env-id", "ruffini/No-v0", "`No`"),
        ("--tactile", "eyes", "eyes"),
    ):
        monkeypatch.setattr(sys, "argv", [script, option, value])
        with pytest.raises(SystemExit) as stop:
            runpy.run_path(script, run_name="__main__")
        assert stop.value.code == 2
        assert told in capsys.readouterr().err.splitlines()[-1]


class Seeded(gym.vector.VectorWrapper):
    """Keeps the seed of its first reset."""

    seed: int | None = None

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        self.seed = seed if self.seed is None else self.seed
        return self.env.reset(seed=seed, options=options)


def test_neighbouring_seeds_of_the_one_file_share_no_episodes():
    pytest.importorskip("torch")
    cleanrl = runpy.run_path(str(POLICIES / "train_cleanrl.py"))
    made = {"num_envs": 4, "obs": "flat", "tactile": "none", "autoreset_mode": "SameStep"}
    firsts = []
    for seed in (100, 101):
        envs = Seeded(gym.make_vec(ID, **made))
        cleanrl["Rollouts"](envs, cleanrl["Agent"](envs.single_observation_space.shape[0], 5), seed)
        firsts.append(envs.seed)
    assert abs(firsts[0] - firsts[1]) >= 4 and min(firsts) >= 1 << 32, firsts


def test_runners_of_rllib_have_rows_of_their_own(monkeypatch):
    # What the callback reads of a runner, where Ray is not installed.
    for name in (
        "ray",
        "ray.rllib",
        "ray.rllib.algorithms",
        "ray.rllib.algorithms.ppo",
        "ray.rllib.callbacks",
        "ray.rllib.callbacks.callbacks",
        "ray.rllib.connectors",
        "ray.rllib.connectors.env_to_module",
        "ray.rllib.core",
        "ray.rllib.core.rl_module",
        "ray.rllib.core.rl_module.default_model_config",
    ):
        module = MagicMock(RLlibCallback=object)
        monkeypatch.setitem(sys.modules, name, module)
    callback = runpy.run_path(str(POLICIES / "train_rllib.py"))["Success"]()
    rows: list[int] = []
    for seed, worker in ((100, 1), (100, 2), (101, 1), (101, 2)):
        config = SimpleNamespace(seed=seed, in_evaluation=False, num_envs_per_env_runner=64)
        runner = SimpleNamespace(config=config, worker_index=worker, _seed=seed + worker)
        callback.on_environment_created(env_runner=runner, env=None, env_context={})
        rows += range(runner._seed, runner._seed + 64)
    assert len(set(rows)) == len(rows) == 256
    runner.config.in_evaluation, runner._seed = True, 7
    callback.on_environment_created(env_runner=runner)
    assert runner._seed == 7


def test_advantages_of_the_one_file_agree_with_stable_baselines3():
    torch = pytest.importorskip("torch")
    buffers = pytest.importorskip("stable_baselines3.common.buffers")
    cleanrl = runpy.run_path(str(POLICIES / "train_cleanrl.py"))
    random = torch.Generator().manual_seed(0)
    steps, rows = 12, 3
    rewards, values = torch.randn(2, steps, rows, generator=random)
    over = (torch.rand(steps, rows, generator=random) < 0.2).float()
    last = torch.randn(rows, generator=random)
    found = cleanrl["advantages"](rewards, values, last, over)
    box = gym.spaces.Box(-1, 1, (1,))
    gae = {"gamma": cleanrl["GAMMA"], "gae_lambda": cleanrl["LAMBDA"]}
    buffer = buffers.RolloutBuffer(steps, box, box, n_envs=rows, **gae)
    buffer.rewards, buffer.values = rewards.numpy(), values.numpy()
    # Stable-Baselines3 marks the step that follows an end.
    buffer.episode_starts[1:] = over[:-1].numpy()
    buffer.compute_returns_and_advantage(last, over[-1].numpy())
    torch.testing.assert_close(found, torch.from_numpy(buffer.advantages))
