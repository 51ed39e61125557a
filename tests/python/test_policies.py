"""Scripted and random policies: state, single observations, tensors."""

from __future__ import annotations

import warnings

import gymnasium as gym
import numpy as np
import pytest

from ruffini import TASKS
from ruffini.evaluation import evaluate
from ruffini.policies import RandomPolicy, scripted

COARSE = {"tactile": "compliance"}
FRAGILE = "ruffini/GraspFragile-v0"


def observed(task, rows=3):
    settings = {"objects": "sphere"} if task == "GraspSoft" else COARSE
    envs = gym.make_vec(f"ruffini/{task}-v0", num_envs=rows, num_threads=1, **settings)
    return envs.reset(seed=3)[0]


@pytest.mark.parametrize("task", TASKS)
def test_a_policy_says_whether_it_keeps_a_state_and_takes_one_observation(task):
    policy, seen = scripted(task), observed(task)
    actions, state = policy.predict(seen)
    assert policy.is_stateful == (state is not None)
    for row in range(3):
        alone = {name: values[row] for name, values in seen.items()}
        first, following = policy.predict(alone, None, True)
        np.testing.assert_allclose(first, actions[row], rtol=1e-6)
        second, _ = policy.predict(alone, following)
        assert first.shape == second.shape == (5,)


def test_a_random_policy_takes_one_observation():
    seen = observed("GraspLift")
    assert RandomPolicy().predict(seen)[0].shape == (3, 5)
    alone = {name: values[0] for name, values in seen.items()}
    assert RandomPolicy().predict(alone)[0].shape == (5,)
    assert RandomPolicy().predict(np.zeros((2, 30), np.float32))[0].shape == (2, 5)


def test_an_episode_of_a_random_policy_is_the_same_alone_and_among_others():
    settings = {"tactile": "none", "max_episode_steps": 10}
    together = evaluate(RandomPolicy(), "GraspLift", 3, **settings)["outcomes"]
    assert together[2] != together[1]
    for each in together:
        alone = evaluate(RandomPolicy(), "GraspLift", 1, first_seed=each["seed"], **settings)
        assert alone["outcomes"] == [each]
    seen = {"proprio": np.zeros((1, 13), np.float32)}
    assert np.ptp([RandomPolicy(seed).predict(seen)[0] for seed in range(4)], axis=0).min() > 0


def test_calls_without_the_state_that_a_policy_keeps_are_warned_of_once():
    policy, seen = scripted(FRAGILE), observed("GraspFragile")
    policy.predict(seen)
    with pytest.warns(UserWarning, match="found two calls in a row without a state"):
        policy.predict(seen)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        policy.predict(seen)
        stateless = scripted("GraspLift")
        for _ in range(3):
            stateless.predict(observed("GraspLift"))
        _, state = scripted(FRAGILE).predict(seen, None, np.ones(3, bool))
        policy.predict(seen, state, np.zeros(3, bool))


def test_tensors_are_taken_as_arrays_are():
    torch = pytest.importorskip("torch")
    for task in ("GraspLift", "GraspFragile"):
        seen = observed(task)
        tensors = {name: torch.as_tensor(values) for name, values in seen.items()}
        found, expected = (scripted(task).predict(each)[0] for each in (tensors, seen))
        assert isinstance(found, np.ndarray)
        np.testing.assert_array_equal(found, expected)


def test_with_every_automatic_reset_the_page_finds_the_last_step():
    # The line of `scale.md` counts as many successes where rows restart within the step.
    policy, counted = scripted("GraspLift"), {}
    for mode in ("NextStep", "SameStep"):
        settings = {"tactile": "none", "observation": ["proprio", "object"]}
        envs = gym.make_vec(
            "ruffini/GraspLift-v0", num_envs=4, num_threads=1, autoreset_mode=mode, **settings
        )
        seen, _ = envs.reset(seed=0)
        won = ended = 0
        for _ in range(102):
            seen, _, terminated, truncated, info = envs.step(policy.predict(seen)[0])
            over = terminated | truncated
            last = info.get("final_info", info)
            won += last.get("is_success", over)[over].sum()
            ended += over.sum()
        counted[mode] = won, ended
    assert counted["NextStep"] == counted["SameStep"] == (4, 4)


def test_an_ending_in_the_last_step_truncates_in_a_batch_as_by_make():
    settings = {**COARSE, "objects": "sphere"}
    grip = np.ones(5, np.float32)

    def until_over(env, action):
        env.reset(seed=0)
        for step in range(1, 60):
            _, _, terminated, truncated, _ = env.step(action)
            if np.any(terminated):
                return step, bool(np.all(truncated))
        raise AssertionError("no episode ended")

    steps, truncated = until_over(gym.make(FRAGILE, **settings), grip)
    assert not truncated
    limited = {"max_episode_steps": steps, **settings}
    assert until_over(gym.make(FRAGILE, **limited), grip) == (steps, True)
    assert until_over(gym.make_vec(FRAGILE, 1, **limited), grip[None]) == (steps, True)
