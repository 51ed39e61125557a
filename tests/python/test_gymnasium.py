"""The single environment as Gymnasium and Stable-Baselines3 check it."""

from __future__ import annotations

import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from conftest import WHOLE, actions, flat
from gymnasium.utils.env_checker import check_env

from ruffini.envs import GraspLiftEnv, GraspLiftVectorEnv
from ruffini.evaluation import evaluate
from ruffini.policies import RandomPolicy, scripted

RIGID = {"tactile": "none"}


def test_gymnasium_finds_nothing_to_warn_about(env_id, choice):
    check_env(gym.make(env_id, render_mode="rgb_array", **choice).unwrapped)


@pytest.mark.parametrize("choice", WHOLE, indirect=True)
def test_stable_baselines_finds_nothing_to_warn_about(env_id, choice):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(gym.make(env_id, **choice))


def test_the_prefix_form_makes_the_same_environment():
    env = gym.make("ruffini:ruffini/GraspLift-v0")
    assert isinstance(env.unwrapped, GraspLiftEnv)


@pytest.mark.parametrize("choice", WHOLE, indirect=True)
def test_observations_stay_in_their_space(env_id, choice):
    env = gym.make(env_id, disable_env_checker=True, **choice)
    observation, _ = env.reset(seed=3)
    for action in actions(1, 60)[:, 0]:
        assert observation in env.observation_space, observation
        observation, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            assert observation in env.observation_space, observation
            observation, _ = env.reset()


@pytest.mark.filterwarnings("default")
def test_a_window_shows_every_step(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame = pytest.importorskip("pygame")
    env = gym.make("ruffini/GraspLift-v0", render_mode="human", width=160, height=120, **RIGID)
    assert env.render_mode == "human"
    env.reset(seed=0)
    for action in actions(1, 3)[:, 0]:
        env.step(action)
        shown = pygame.surfarray.array3d(pygame.display.get_surface()).transpose(1, 0, 2)
        np.testing.assert_array_equal(shown, env.unwrapped.render())
    env.close()


@pytest.mark.filterwarnings("default")
def test_a_window_that_nobody_sees_is_warned_of(monkeypatch):
    pygame = pytest.importorskip("pygame")
    env = gym.make("ruffini/GraspLift-v0", render_mode="human", width=160, height=120, **RIGID)
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env.reset(seed=0)
    monkeypatch.delenv("SDL_VIDEODRIVER")
    monkeypatch.setattr(pygame.display, "get_driver", lambda: "offscreen")
    with pytest.warns(UserWarning, match="no display was found.*`ruffini play --video"):
        env.step(env.action_space.sample())
    monkeypatch.setenv("SDL_VIDEODRIVER", "offscreen")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env.step(env.action_space.sample())
    env.close()


@pytest.mark.filterwarnings("default")
def test_without_pygame_one_line_says_what_to_install():
    code = "import sys; sys.modules['pygame'] = None; import gymnasium, ruffini;"
    code += "gymnasium.make('ruffini/GraspLift-v0', render_mode='human', tactile='none')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    last = done.stderr.splitlines()[-1]
    assert last.startswith("ValueError: ") and last.endswith('with pip install "ruffini[human]"')
    for make in (GraspLiftEnv, GraspLiftVectorEnv):
        with pytest.raises(ValueError, match=r'with pip install "ruffini\[human\]"$'):
            make(render_mode="human")


@pytest.mark.parametrize("limit", [7, 150])
def test_make_sets_the_time_limit(limit):
    env = gym.make("ruffini/GraspLift-v0", max_episode_steps=limit, observation="time", mass=0.1)
    env.reset(seed=0)
    still = np.zeros(5, np.float32)
    for step in range(1, limit + 1):
        observation, _, terminated, truncated, _ = env.step(still)
        assert (terminated, truncated) == (False, step == limit), step
    assert observation["time"] == pytest.approx(0.04 * limit)


def test_a_registration_without_a_time_limit_has_that_of_the_task():
    gym.register("test/Lift-v0", entry_point="ruffini.envs:GraspLiftEnv")
    try:
        env = gym.make("test/Lift-v0", objects="sphere", mass=0.1, **RIGID)
        env.reset(seed=0)
    finally:
        gym.registry.pop("test/Lift-v0")
    ends = [env.step(np.zeros(5, np.float32))[3] for _ in range(100)]
    assert ends == [False] * 99 + [True]


def test_the_frame_rate_is_that_of_the_steps():
    task, rigid = "ruffini/GraspLift-v0", {"tactile": "none"}
    fast = rigid | {"physics": {"control_period": 0.02, "time_step": 0.002}}
    for settings, rate in ((rigid, 25), (fast, 50), (rigid, 25)):
        for envs in (gym.make(task, **settings), gym.make_vec(task, num_envs=2, **settings)):
            assert envs.metadata["render_fps"] == envs.unwrapped.metadata["render_fps"] == rate
            assert envs.metadata["render_modes"] == ["rgb_array"]


def test_a_seed_starts_the_same_stream_of_episodes():
    first, second = GraspLiftEnv(), GraspLiftEnv()
    for env in (first, second):
        env.reset(seed=5)
    ours, theirs = (flat(env.reset()[0]) for env in (first, second))
    np.testing.assert_array_equal(ours, theirs)
    assert not np.array_equal(ours, flat(first.reset(seed=5)[0]))


def test_reward_is_the_weighted_mean_of_the_terms_in_info():
    weights = {"reach": 1.0, "grasp": 2.0, "lift": 3.0, "hold": 4.0, "effort": 5.0}
    env = GraspLiftEnv(reward_weights=weights)
    env.reset(seed=0)
    _, reward, _, _, info = env.step(actions(1, 1)[0, 0])
    terms = info["reward_terms"]
    mean = sum(weights[name] * terms[name] for name in weights) / sum(weights.values())
    assert reward == pytest.approx(mean)


def test_the_picture_shows_what_happens():
    env = gym.make("ruffini/GraspLift-v0", render_mode="rgb_array", width=160, height=120)
    env.reset(seed=0)
    before = env.render()
    assert (before.shape, before.dtype) == ((120, 160, 3), np.uint8)
    assert before.std() > 10
    for _ in range(20):
        env.step(np.array([0, 0, -1, 0, 0], np.float32))
    changed = np.abs(env.render().astype(int) - before).max(axis=2) > 20
    assert changed.mean() > 0.02, f"{changed.mean():.1%} of the pixels changed"


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_a_video_can_be_recorded(tmp_path):
    pytest.importorskip("moviepy")
    env = gym.make("ruffini/GraspLift-v0", render_mode="rgb_array", width=160, height=128)
    env = gym.wrappers.RecordVideo(env, str(tmp_path / "videos"), lambda episode: True)
    env.reset(seed=0)
    for action in actions(1, 5)[:, 0]:
        env.step(action)
    env.close()
    assert [file.suffix for file in (tmp_path / "videos").iterdir()] == [".mp4"]


def test_the_scripted_policy_grasps():
    task, rigid = "ruffini/GraspLift-v0", {"tactile": "none"}
    result = evaluate(scripted(task), task, 64, **rigid)
    assert result["success"] >= 0.95, result
    assert evaluate(RandomPolicy(), task, 64, **rigid)["success"] < 0.1
