"""Training from many seeds: what is reported of it, and what a run does not depend on."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import torch

import quickstart
import study
from ruffini.agents import CHECKPOINT
from ruffini.agents.params import params
from ruffini.agents.training import FirstWithoutTouch, train, untouched
from ruffini.sb3 import make_vec_env
from study import KINDS, RESULTS, SEEDS, rows_of
from study_pages import interquartile_mean, page

LIFT = "ruffini/GraspLift-v0"
COARSE = {"tactile": "compliance", "resolution": {"nodes": 100}}


def test_the_interquartile_mean_leaves_the_lowest_and_highest_quarter_out():
    scores = np.array([0.0, 0.1, 4.0, 5.0, 6.0, 7.0, 90.0, 100.0])
    assert interquartile_mean(scores) == 5.5


@pytest.mark.parametrize("env_id", KINDS)
def test_a_page_is_that_of_its_rows(env_id):
    rows = rows_of(env_id)
    if not rows:
        pytest.skip("no agents of it yet")
    name = env_id.split("/")[-1]
    kinds = [kind for kind in KINDS[env_id] if any(row["kind"] == kind for row in rows)]
    by_kind = {
        kind: sorted((r for r in rows if r["kind"] == kind), key=lambda r: r["seed"])
        for kind in kinds
    }
    assert page(by_kind, name) == (RESULTS / f"{name}.md").read_text()
    assert len({(row["kind"], row["seed"]) for row in rows}) == len(rows), "a seed twice"


def test_a_study_writes_to_its_folder_alone(tmp_path, monkeypatch):
    row = rows_of(LIFT)[0]
    (tmp_path / "GraspLift-v0.jsonl").write_text(json.dumps(row) + "\n")
    monkeypatch.setattr("sys.argv", ["study.py", "--out", str(tmp_path), "--pages"])
    study.main()
    made = {file.name for file in tmp_path.iterdir()}
    assert made == {f"GraspLift-v0.{suffix}" for suffix in ("jsonl", "md", "png")}
    assert f"| {row['seed']} |" in (tmp_path / "GraspLift-v0.md").read_text()


@pytest.mark.parametrize("env_id", KINDS)
def test_the_readme_says_what_the_rows_say(env_id):
    found = [row["success"] for row in rows_of(env_id) if row["kind"] == "touch"]
    assert len(found) >= SEEDS
    median, worst = 100 * np.median(found), 100 * min(found)
    says = f"[{median:.1f} %, the worst of {len(found)} seeds {worst:.1f} %]"
    page = f"policies/results/{env_id.split('/')[-1]}.md"
    assert f"{says}({page})" in (RESULTS.parents[1] / "README.md").read_text()


@pytest.mark.parametrize("env_id", KINDS)
def test_the_page_of_training_says_how_long_the_runs_of_a_study_took(env_id):
    rows = [row for row in rows_of(env_id) if row["kind"] == "touch"]
    minutes = [row["cpu"] / 60 for row in rows]
    rate = np.median([row["steps"] / row["cpu"] for row in rows])
    name = env_id.split("/")[-1]
    assert (
        f"| [{name.split('-')[0]}](../../policies/results/{name}.md) | {rows[0]['steps']:,} | "
        f"{np.median(minutes):.1f} | {min(minutes):.1f} to {max(minutes):.1f} | {rate:.0f} |\n"
    ) in (RESULTS.parents[1] / "py/docs/train.md").read_text()


def test_the_readme_says_what_the_quickstart_prints():
    lines = (RESULTS / "quickstart.jsonl").read_text().splitlines()
    found = [json.loads(line)["result"] for line in lines]
    for row in found:
        assert row["steps"] == params(LIFT).steps and row["evaluation"]["episodes"] == 200
    success = " and ".join(f"{100 * row['evaluation']['success']:.1f} %" for row in found)
    assert f"[{success} on two machines]" in (RESULTS.parents[1] / "README.md").read_text()


def test_an_agent_below_the_worst_seed_on_record_is_a_failure():
    sentence, status = quickstart.verdict(0.899, 0.90)
    assert status == 1 and "89.9%" in sentence and "90.0%" in sentence
    assert quickstart.verdict(0.90, 0.90) == ("", 0)
    assert quickstart.verdict(0.0, None) == ("", 0)
    bound = quickstart.least_success()
    touch = [row["success"] for row in rows_of(LIFT) if row["kind"] == "touch"]
    assert bound is not None and 0.5 < bound < min(touch)


def test_touch_begins_when_the_steps_with_rigid_pads_are_over():
    feeling = make_vec_env(LIFT, 2, seed=0, **COARSE)
    settings = {"tactile": "none", "observation": untouched(feeling.observation_space)}
    envs = FirstWithoutTouch(make_vec_env(LIFT, 2, seed=0, **settings), feeling, 6)
    first = envs.reset()
    assert set(first) == {"proprio", "object", "markers"} and not first["markers"].any()
    still = np.zeros((2, 5), np.float32)
    for _ in range(2):
        observation, _, dones, _ = envs.step(still)
        assert not dones.any() and not observation["markers"].any()
    observation, _, dones, infos = envs.step(still)
    assert dones.all() and all(info["TimeLimit.truncated"] for info in infos)
    assert infos[1]["terminal_observation"]["markers"].shape == (210,)
    # Rows with tactile pads have started: their first observations are those of a reset.
    again = make_vec_env(LIFT, 2, seed=0, **COARSE).reset()
    for name, values in again.items():
        np.testing.assert_array_equal(observation[name], values)
    _, _, dones, _ = envs.step(still)
    assert not dones.any()


def test_environments_without_and_with_touch_are_both_closed():
    rigid, feeling = (make_vec_env(LIFT, 2, tactile=name) for name in ("none", "surrogate"))
    FirstWithoutTouch(rigid, feeling, 20).close()
    assert rigid.envs.closed and feeling.envs.closed


def test_a_seed_gives_the_same_agent_on_any_number_of_threads(tmp_path: Path):
    weights = []
    for threads in (1, 2):
        model = train(LIFT, 3, tmp_path / str(threads), steps=2048, threads=threads)
        weights.append(torch.cat([p.detach().flatten() for p in model.policy.parameters()]))
    torch.testing.assert_close(*weights, rtol=0.0, atol=0.0)
    times = json.loads((tmp_path / "2" / "times.json").read_text())
    assert set(times) == {"environment", "collecting", "updating"}
    assert (tmp_path / "2" / CHECKPOINT / "curve.json").is_file()
