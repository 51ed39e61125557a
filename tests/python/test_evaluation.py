"""`ruffini.evaluation`: success over fixed seeds."""

from __future__ import annotations

import shutil
import subprocess

import gymnasium as gym
import numpy as np
import pytest

from ruffini import evaluation
from ruffini.evaluation import FIRST_SEED, about_this_run, bootstrap, evaluate, line, wilson
from ruffini.video import film

LIFT, HOLD = "ruffini/GraspLift-v0", "ruffini/HoldStill-v0"
SHORT = {"tactile": "none", "max_episode_steps": 7}
SHAKEN = {"tactile": "none", "objects": ["sphere", "cuboid"], "max_episode_steps": 60}
SHAKEN |= {"mass": 0.15, "friction": 0.5, "load": 0.5, "shaking": 0.1, "start_grip": 4.0}
SEEDS = range(30, 39)


class Still:
    """Rests."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros((len(observation["proprio"]), 5), np.float32), state


def test_the_interval_is_wilsons():
    # The score interval of 9 of 10, for z = 1.96.
    low, high = wilson(9, 10)
    assert abs(low - 0.5958) < 1e-4 and abs(high - 0.9821) < 1e-4, (low, high)
    assert wilson(0, 5)[0] == 0.0 and wilson(5, 5)[1] == 1.0


def test_a_bootstrapped_interval_encloses_the_statistic_and_is_the_same_on_every_call():
    values = [0.0, 0.1, 4.0, 5.0, 6.0, 7.0, 90.0, 100.0]

    def median(drawn):
        return np.median(drawn, axis=-1)

    low, high = bootstrap(values, median)
    assert (low, high) == bootstrap(values, median)
    assert 0.0 <= low < 5.5 < high <= 100.0
    assert bootstrap(np.full(5, 0.9), median, 100) == (0.9, 0.9)


def test_progress_is_told_after_every_step():
    told = []
    result = evaluate(Still(), LIFT, 3, progress=lambda *where: told.append(where), **SHORT)
    assert told == [(0, 3, step) for step in range(1, 7)] + [(3, 3, 7)]
    assert result["first_seed"] == FIRST_SEED and result["success"] == 0.0
    assert result["endings"] == {}
    assert line("still", result).startswith("still      ")


class Uneven:
    """Of three rows one holds, one lets go soon, and one when it has succeeded for a while.

    Odd rows hold in each later episode.
    """

    def __init__(self, rows):
        self.rows, self.starts, self.steps = rows, [], []
        self.until = np.array([99, 5, 40])[rows % 3]

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        assert deterministic, "judged without noise"
        if state is None:
            state = np.zeros(len(self.rows), int)
        else:
            self.until[episode_start & (self.rows % 2 == 1)] = 99
        state = np.where(episode_start, 0, state) + 1
        self.starts.append(np.array(episode_start))
        self.steps.append(state)
        action = np.zeros((len(self.rows), 5), np.float32)
        action[state > self.until, 4] = -1.0
        return action, state


def alone(seed, row):
    """Return, success, object and ending of one episode, stepped by itself."""
    env = gym.make(HOLD, disable_env_checker=True, **SHAKEN)
    policy, total, state = Uneven(np.array([row])), 0.0, None
    observation, _ = env.reset(seed=seed)
    name, first, over, once = env.unwrapped.look()["object"], np.ones(1, bool), False, False
    while not over:
        batch = {key: values[None] for key, values in observation.items()}
        action, state = policy.predict(batch, state, first)
        observation, reward, terminated, truncated, info = env.step(action[0])
        total, first, over = total + reward, np.zeros(1, bool), terminated or truncated
        once |= info["is_success"]
    return total, info["is_success"], once, name, info.get("ending")


def test_an_evaluation_is_that_of_its_episodes_one_by_one():
    policy = Uneven(np.arange(len(SEEDS)))
    told = evaluate(policy, HOLD, len(SEEDS), first_seed=SEEDS[0], **SHAKEN)
    found = zip(*map(alone, SEEDS, range(len(SEEDS))), strict=True)
    returns, success, once, names, endings = found
    dropped = [ending for ending in endings if ending]
    assert 0 < len(dropped) < len(SEEDS) and 0 < sum(success) < sum(once), (success, once)
    assert told["return"] == pytest.approx(np.mean(returns), abs=1e-3)
    assert told["success"] == np.mean(success)
    assert told["interval"][0] < told["success"] < told["interval"][1]
    assert told["endings"] == {"dropped": len(dropped)}
    of = {name: [s for s, n in zip(success, names, strict=True) if n == name] for name in names}
    assert told["by_object"] == {name: [sum(of[name]), len(of[name])] for name in sorted(of)}
    outcomes = told["outcomes"]
    assert [each["seed"] for each in outcomes] == list(SEEDS)
    assert [each["success"] for each in outcomes] == list(success)
    assert [each["ending"] for each in outcomes] == list(endings)
    assert [each["object"] for each in outcomes] == list(names)
    assert [each["return"] for each in outcomes] == pytest.approx(returns)
    limit = SHAKEN["max_episode_steps"]
    assert all((each["length"] < limit) == bool(each["ending"]) for each in outcomes)
    # Rows that dropped begin anew by themselves; elsewhere the policy's state goes on.
    first, *others = policy.starts
    assert first.all() and any(start.any() for start in others)
    assert not any(start[::3].any() for start in others)
    assert policy.steps[-1][0] == len(policy.steps)


def test_a_built_in_task_may_be_given_by_its_name():
    assert evaluate(Still(), "GraspLift", 1, **SHORT) == evaluate(Still(), LIFT, 1, **SHORT)


def test_a_function_of_observations_is_a_policy():
    def grip(observation):
        return np.full((len(observation["proprio"]), 5), 0.3, np.float32)

    class Grips:
        """Does the same."""

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return grip(observation), state

    assert evaluate(grip, LIFT, 2, **SHORT) == evaluate(Grips(), LIFT, 2, **SHORT)


@pytest.mark.parametrize("policy", [None, "scripted", Still])
def test_what_is_no_policy_is_told_what_one_needs(policy):
    with pytest.raises(TypeError, match=r"policy: found .*, expected a policy with predict\("):
        evaluate(policy, LIFT, 2, **SHORT)


@pytest.mark.parametrize("episodes", [0, -1, 1.5, None])
def test_a_wrong_number_of_episodes_is_named(episodes):
    with pytest.raises(ValueError, match=f"episodes: found {episodes}, expected a whole number"):
        evaluate(Still(), LIFT, episodes, **SHORT)


def test_a_film_needs_an_episode(tmp_path):
    with pytest.raises(ValueError, match="seeds: found none, expected at"):
        film(Still(), LIFT, tmp_path / "a.gif", seeds=[], **SHORT)


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")
def test_a_commit_from_which_the_sources_differ_is_marked(tmp_path, monkeypatch):
    module, result = tmp_path / "py/python/ruffini/evaluation.py", tmp_path / "tests/result.json"

    def commit() -> str:
        return about_this_run()["commit"]

    for file in (module, result):
        file.parent.mkdir(parents=True)
        file.write_text("one")
    monkeypatch.setattr(evaluation, "__file__", str(module))
    assert commit() == "unknown"
    me = ["-c", "user.name=me", "-c", "user.email=me@example.org"]
    for words in (["init", "-q"], ["add", "."], [*me, "commit", "-qm", "first"]):
        subprocess.run(["git", "-C", str(tmp_path), *words], check=True)
    clean = commit()
    assert len(clean) >= 7 and not clean.endswith("+")
    result.write_text("two")
    (module.parent / "untracked.py").touch()
    assert commit() == clean
    module.write_text("two")
    assert commit() == f"{clean}+"
