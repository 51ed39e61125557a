"""`ruffini.evaluation`: success over fixed seeds."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest

from ruffini import evaluation
from ruffini.evaluation import FIRST_SEED, about_this_run, bootstrap, evaluate, line, wilson
from ruffini.video import film

LIFT = "ruffini/GraspLift-v0"
SHORT = {"tactile": "none", "max_episode_steps": 7}


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
    assert line("still", result).startswith("still      ")


def test_a_seed_has_one_episode_in_whichever_batch():
    whole = evaluate(Still(), LIFT, 2, first_seed=5, **SHORT)
    parts = [evaluate(Still(), LIFT, 1, first_seed=5 + row, **SHORT) for row in range(2)]
    mean = np.mean([part["return"] for part in parts])
    assert abs(whole["return"] - mean) < 1e-3, (whole["return"], mean)


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


def test_every_early_ending_is_counted_once():
    class LetsGo:
        """Opens the hand."""

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            action = np.zeros((len(observation["proprio"]), 5), np.float32)
            action[:, 4] = -1.0
            return action, state

    dropped = evaluate(LetsGo(), "ruffini/HoldStill-v0", 4, tactile="none", friction=0.2, load=1.5)
    assert dropped["endings"] == {"dropped": 4}
    assert evaluate(Still(), LIFT, 3, **SHORT)["endings"] == {}


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
