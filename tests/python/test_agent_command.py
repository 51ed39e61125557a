"""`ruffini agent`: training in small, what a run holds, and what is refused."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import IDS
from drawn_agent import COARSE, HOLD, drawn

from ruffini import agents
from ruffini.agents import first_seed
from ruffini.agents.params import params
from ruffini.commands import main
from ruffini.evaluation import evaluate

EIGHT = ["--n-envs", "8", "--threads", "1"]
BLOCKED = "import sys; sys.modules['torch'] = sys.modules['stable_baselines3'] = None;"


def command(*words):
    """Runs the command in this process."""
    return main(["agent", *map(str, words)])


def without_torch(*words):
    """Runs the command where PyTorch and Stable-Baselines3 are not installed."""
    code = f"{BLOCKED}from ruffini.commands import main; sys.exit(main(sys.argv[1:]))"
    line = [sys.executable, "-c", code, *map(str, words)]
    return subprocess.run(line, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of two rollouts of 256 steps, of the 300 steps that were asked for."""
    pytest.importorskip("stable_baselines3")
    folder = tmp_path_factory.mktemp("agent") / "runs" / "short"
    words = ["--seed", 4, "--steps", 300, *EIGHT, "--settings", json.dumps(COARSE)]
    assert command("train", "hold-still", *words, "--out", folder) == 0
    return folder


def test_a_run_is_an_agent(run):
    agent = agents.load(run)
    assert agent.env_id == HOLD and agent.settings == COARSE
    assert (agent.card["seed"], agent.card["steps"], agent.card["threads"]) == (4, 512, 1)
    assert agent.card["evaluation"] == {} and agent.card["policy"] == "MultiInputPolicy"
    about = json.loads((run / agents.RUN).read_text())
    assert about["params"]["steps"] == 512 and about["params"]["environment"] == COARSE


def test_a_shorter_run_has_the_same_share_of_steps_with_rigid_pads():
    pytest.importorskip("stable_baselines3")
    from ruffini.agents.training import _sized

    several = [params(env_id) for env_id in IDS]
    assert any(of.steps_without_touch for of in several)
    for of in several:
        half = _sized(of, of.steps // 2, None)
        assert half.steps_without_touch == pytest.approx(of.steps_without_touch / 2, abs=1)


def test_the_bar_of_a_run_ends_at_all_of_it(tmp_path, capfd):
    pytest.importorskip("stable_baselines3")
    words = ["--steps", 700, *EIGHT, "--settings", '{"tactile": "none"}', "--out", tmp_path / "a"]
    assert command("train", "GraspLift", *words) == 0
    out, err = capfd.readouterr()
    last = err.replace("\r", "\n").strip().splitlines()[-1]
    assert last.startswith("100%") and "768/768" in last, err
    assert out.startswith(f"ruffini/GraspLift-v0: PPO, in {tmp_path / 'a'}\n")
    assert f"ruffini play --policy {tmp_path / 'a'}" in out


def test_success_is_shown_once_every_environment_has_ended_an_episode(tmp_path, capfd):
    pytest.importorskip("stable_baselines3")
    # Episodes of at most 40 steps in rollouts of 32: the first ends early, if at all.
    settings = json.dumps({"tactile": "none", "max_episode_steps": 40})
    words = ["--steps", 512, *EIGHT, "--settings", settings, "--out", tmp_path / "a"]
    assert command("train", "HoldStill", *words) == 0
    bars = capfd.readouterr().err.replace("\r", "\n").splitlines()
    shown = [[bar for bar in bars if f" {steps}/512" in bar][-1] for steps in (256, 512)]
    assert "success not known yet" in shown[0], shown
    assert re.search(r"success \d+%, return \d", shown[1]), shown


def test_a_job_that_is_submitted_again_begins_or_ends_as_it_has_to(tmp_path, monkeypatch, capsys):
    pytest.importorskip("stable_baselines3")
    monkeypatch.chdir(tmp_path)
    words = ["train", "HoldStill", "--settings", json.dumps(COARSE), *EIGHT, "--resume"]
    assert command(*words, "--steps", 256) == 0
    assert "runs/HoldStill-v0-0: nothing to go on with, a new run" in capsys.readouterr().out
    assert command(*words) == 0
    assert "HoldStill-v0-0: has its 256 steps" in capsys.readouterr().out


def test_a_run_goes_on(run, tmp_path, capsys):
    pytest.importorskip("stable_baselines3")
    folder = tmp_path / "again"
    words = ["train", "HoldStill", "--settings", json.dumps(COARSE), *EIGHT, "--out", folder]
    assert command(*words, "--steps", 256) == 0
    assert command(*words, "--steps", 256) == 2
    assert "again holds a run: give --resume to go on, or another --out" in capsys.readouterr().err
    go_on = ["train", "HoldStill", "--resume", "--out", folder]
    assert command(*go_on) == 0
    assert "again: has its 256 steps" in capsys.readouterr().out
    assert command(*go_on, "--steps", 256) == 2
    assert "steps: found 256, expected more than the run's 256" in capsys.readouterr().err
    harder = ["--steps", 500, "--settings", '{"load": 0.5}']
    assert command(*go_on, *harder) == 0
    agent = agents.load(folder)
    assert agent.card["steps"] == 512 and agent.settings == COARSE | {"load": 0.5}
    curve = json.loads((folder / "checkpoint/curve.json").read_text())
    assert [point["steps"] for point in curve] == [256, 512]
    for wrong, text in (
        (["train", "GraspLift"], "task: found ruffini/GraspLift-v0, expected ruffini/HoldStill-v0"),
        (["train", "HoldStill", "--settings", '{"tactile": "none"}'], "found channels "),
        (["train", "HoldStill", "--seed", 5], "seed: found 5, expected 0, that of"),
    ):
        assert command(*wrong, "--steps", 1000, "--resume", "--out", folder) == 2
        assert text in capsys.readouterr().err


def test_a_run_goes_on_with_its_weights_statistics_and_optimiser_in_other_episodes(
    run, tmp_path, monkeypatch
):
    sb3 = pytest.importorskip("stable_baselines3")
    from ruffini.agents.sb3 import from_sb3

    folder, seen = tmp_path / "run", {}
    shutil.copytree(run, folder)
    before = agents.load(folder)

    def learn(model, *_, **__):
        base = model.get_env()
        while hasattr(base, "venv"):
            base = base.venv
        seen["seeds"] = base._seeds[:2]
        seen["optimiser"] = model.policy.optimizer.state_dict()["state"]
        about = {"env_id": before.env_id, "settings": before.settings, "seed": 4, "threads": 1}
        seen["agent"] = from_sb3(model, None, commit="", **about)
        raise KeyboardInterrupt

    monkeypatch.setattr(sb3.PPO, "learn", learn)
    assert command("train", "HoldStill", "--resume", "--steps", 1024, "--out", folder) == 130
    found = seen["agent"]
    assert found.card["steps"] == before.card["steps"] == 512
    assert found.card["normaliser"] == before.card["normaliser"]
    assert found.tensors.keys() == before.tensors.keys()
    for name, values in before.tensors.items():
        np.testing.assert_array_equal(found.tensors[name], values, err_msg=name)
    assert seen["optimiser"], "the optimiser begins anew"
    first = first_seed(4, 512)
    assert seen["seeds"] == [first, first + 1]


def test_a_kill_while_the_checkpoint_is_replaced_loses_one_checkpoint_alone(
    run, tmp_path, monkeypatch, capsys
):
    folder = tmp_path / "run"
    shutil.copytree(run, folder)
    done = agents.load(folder).card["steps"]
    replaced, words = Path.rename, ["train", "HoldStill", "--out", folder]

    def killed(path, target):
        if path.name == "checkpoint.new":
            raise SystemExit("killed")
        return replaced(path, target)

    with monkeypatch.context() as patch, pytest.raises(SystemExit, match="killed"):
        patch.setattr(Path, "rename", killed)
        command(*words, "--resume", "--steps", done + 256)
    assert not (folder / "checkpoint").exists()
    assert agents.load(folder).card["steps"] == done
    assert command(*words) == 2
    assert "run holds a run: give --resume to go on" in capsys.readouterr().err
    assert command(*words, "--resume", "--steps", done + 256) == 0
    assert agents.load(folder).card["steps"] == done + 256
    assert {file.name for file in folder.glob("checkpoint*")} == {"checkpoint"}


@pytest.mark.parametrize(
    "file",
    ["run.json", "checkpoint/curve.json", "checkpoint/model.zip", "checkpoint/normaliser.pkl"],
)
def test_a_damaged_file_of_a_run_is_named(run, tmp_path, capsys, file):
    shutil.copytree(run, tmp_path / "run")
    for content in ("{", "{}") if file == "run.json" else ("{",):
        (tmp_path / "run" / file).write_text(content)
        words = ["train", "HoldStill", "--resume", "--steps", 1000, "--out", tmp_path / "run"]
        assert command(*words) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"ruffini: {tmp_path / 'run' / file}: damaged, "), said
        assert said.count("\n") == 1, said


def test_settings_are_checked_before_pytorch_is_loaded(tmp_path):
    words = ["train", "HoldStill", "--settings", '{"lod": 1}', "--out", tmp_path / "none"]
    done = without_torch("agent", *words)
    assert done.returncode == 2 and "did you mean 'load'?" in done.stderr, done.stderr


def test_what_only_the_value_function_sees_is_not_the_agents(tmp_path):
    pytest.importorskip("stable_baselines3")
    folder = tmp_path / "asymmetric"
    words = ["train", "insert-peg", *EIGHT, "--out", folder]
    settings = json.dumps({"tactile": "compliance", "resolution": {"nodes": 150}})
    assert command(*words, "--steps", 256, "--settings", settings) == 0
    assert command(*words, "--steps", 512, "--resume") == 0
    agent = agents.load(folder)
    assert list(agent.channels) == ["proprio", "wrench"]
    about = json.loads((folder / agents.RUN).read_text())
    assert about["params"]["privileged"] == ["insertion"]
    seen = json.dumps({"observation": ["proprio", "insertion"], "tactile": "compliance"})
    told = [*words[:-1], tmp_path / "told", "--steps", 256, "--settings", seen]
    assert command(*told) == 0
    assert list(agents.load(tmp_path / "told").channels) == ["proprio", "insertion"]
    assert (
        command(*words[:2], "--from", folder, *EIGHT, "--steps", 256, "--out", tmp_path / "b") == 0
    )


def test_an_interrupt_keeps_what_was_learnt(tmp_path, monkeypatch, capsys):
    sb3 = pytest.importorskip("stable_baselines3")
    train, calls = sb3.PPO.train, []

    def interrupted(model):
        calls.append(model.num_timesteps)
        if len(calls) == 2:
            raise KeyboardInterrupt
        train(model)

    monkeypatch.setattr(sb3.PPO, "train", interrupted)
    words = ["train", "GraspLift", "--settings", '{"tactile": "none"}', *EIGHT, "--out", tmp_path]
    assert command(*words, "--steps", 2560) == 130
    assert f"{tmp_path}: --resume goes on from the last checkpoint" in capsys.readouterr().err
    assert agents.load(tmp_path).card["steps"] == 512
    assert command("train", "GraspLift", "--resume", "--steps", 768, "--out", tmp_path) == 0
    assert agents.load(tmp_path).card["steps"] == 768


def test_steps_with_rigid_pads_take_what_is_of_the_gel():
    pytest.importorskip("stable_baselines3")
    from ruffini.agents.training import make_environment, params

    of_gel = {"gel_stiffness": [0.8, 1.25], "tactile": "compliance", "resolution": {"nodes": 150}}
    errors = {"markers": {"noise": 1e-6}, "proprio": {"noise": 1e-3}}
    chosen = params("ruffini/GraspLift-v0").with_settings(of_gel | {"sensor_errors": errors})
    assert chosen.steps_without_touch > 0
    envs = make_environment("ruffini/GraspLift-v0", chosen, seed=0, threads=1)
    assert not envs.reset()["markers"].any()


@pytest.fixture
def saves(monkeypatch):
    """Steps at which checkpoints are saved by runs of 256 steps a rollout, and what a test adds.

    ``saves.after`` has what is done after a number of rollouts.
    """
    sb3 = pytest.importorskip("stable_baselines3")
    from ruffini.agents import training

    class Saves(list):
        after = {}

    found, save, train = Saves(), training.RunMonitor.save, sb3.PPO.train

    def noted(monitor):
        save(monitor)
        found.append(monitor.num_timesteps)

    def then(model):
        train(model)
        found.after.get(model.num_timesteps // 256, lambda: None)()

    monkeypatch.setattr(training.RunMonitor, "save", noted)
    monkeypatch.setattr(sb3.PPO, "train", then)
    return found


def interrupt():
    raise KeyboardInterrupt


RIGID = ["train", "GraspLift", "--settings", '{"tactile": "none"}', *EIGHT, "--steps", 25600]


def test_a_run_saves_at_its_start_and_once_in_a_while(saves, tmp_path, monkeypatch):
    from ruffini.agents import training

    saves.after = {3: interrupt}
    assert command(*RIGID, "--out", tmp_path / "seldom") == 130
    assert saves == [0, 768]
    saves.clear()
    monkeypatch.setattr(training, "SAVE_EVERY", 0.0)
    assert command(*RIGID, "--out", tmp_path / "often") == 130
    assert saves == [0, 256, 512, 768, 768]


def test_a_signal_has_a_checkpoint_saved(saves, tmp_path, capsys):
    before = [signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGUSR1)]
    send = {
        1: lambda: os.kill(os.getpid(), signal.SIGUSR1),
        3: lambda: os.kill(os.getpid(), signal.SIGTERM),
    }
    saves.after = send
    assert command(*RIGID, "--out", tmp_path) == 130
    # The second rollout is whole; the fourth ends at its first step, of eight environments.
    assert saves == [0, 512, 776]
    assert "--resume goes on from the last checkpoint" in capsys.readouterr().err
    assert agents.load(tmp_path).card["steps"] == 776
    assert before == [signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGUSR1)]


def test_a_run_that_was_killed_before_it_learnt_is_resumed_or_begun(run, tmp_path, capsys, saves):
    folder = tmp_path / "killed"

    def killed():
        raise SystemExit("killed")

    saves.after = {1: killed}
    words = ["train", "HoldStill", *EIGHT, "--out", folder, "--steps"]
    with pytest.raises(SystemExit, match="killed"):
        command(*words, 25600, "--from", run, "--settings", '{"load": 0.5}')
    before = agents.load(run).card["steps"]
    assert agents.load(folder).card["steps"] == before
    saves.after = {}
    assert command(*words, 256, "--resume") == 0
    agent = agents.load(folder)
    assert agent.card["steps"] == before + 256 and agent.settings == COARSE | {"load": 0.5}
    # Killed before its first checkpoint, or never begun.
    for kept in ([agents.RUN], []):
        shutil.rmtree(folder / "checkpoint")
        if not kept:
            (folder / agents.RUN).unlink()
        capsys.readouterr()
        assert command(*words, 256, "--resume", "--settings", json.dumps(COARSE)) == 0
        assert "killed: nothing to go on with, a new run" in capsys.readouterr().out
        assert agents.load(folder).card["steps"] == 256


def test_evaluate_takes_task_and_settings_from_the_run(run, tmp_path, capsys):
    file = tmp_path / "result.json"
    assert command("evaluate", run, "--episodes", 3, "--seed", 5, "--json", file) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"{HOLD}: PPO, 512 steps, seed 4; 3 episodes from seed 5\nshort ")
    result = json.loads(file.read_text())
    expected = evaluate(agents.load(run), HOLD, 3, first_seed=5, **COARSE)
    assert {name: result[name] for name in expected} == expected
    assert result["settings"] == COARSE and result["policy"] == "short" and result["commit"]
    changed = ["--settings", '{"load": 0.5}', "--json", file]
    assert command("evaluate", run, "--episodes", 1, *changed) == 0
    assert json.loads(file.read_text())["settings"] == COARSE | {"load": 0.5}


def test_evaluate_takes_policies_that_are_not_learnt(capsys):
    words = ["--task", "grasp-lift", "--settings", '{"tactile": "none"}', "--episodes", 4]
    assert command("evaluate", "scripted", *words) == 0
    out = capsys.readouterr().out
    assert out.startswith("ruffini/GraspLift-v0: scripted policy; 4 episodes from seed 10000\n")
    assert "scripted                  100.0%" in out
    assert command("evaluate", "random", *words[2:]) == 0
    assert "random                      0.0%" in capsys.readouterr().out


def test_export_writes_an_agent_with_its_success(run, tmp_path, capsys):
    file = tmp_path / "out.safetensors"
    assert command("export", run, "--episodes", 3, "--out", file) == 0
    agent = agents.load(file)
    told = evaluate(agents.load(run), HOLD, 3, **COARSE)
    assert agent.card["evaluation"] == {
        k: v for k, v in told.items() if k not in ("env", "outcomes")
    }
    assert capsys.readouterr().out.splitlines()[1] == f"{file}: {file.stat().st_size} bytes"
    for name, values in agents.load(run).tensors.items():
        np.testing.assert_array_equal(agent.tensors[name], values)


def test_all_but_training_goes_without_torch(run, tmp_path):
    file = tmp_path / "out.safetensors"
    for words in (
        ["agent", "evaluate", run, "--episodes", 1],
        ["agent", "export", run, "--episodes", 1, "--out", file],
        ["play", "HoldStill", "--policy", run, "--episodes", 1],
        ["play", "--policy", file, "--episodes", 1],
    ):
        done = without_torch(*words)
        assert done.returncode == 0, done.stderr
    done = without_torch("agent", "train", "HoldStill", "--out", tmp_path / "none")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1 and 'pip install "ruffini[train]"' in done.stderr


def test_without_torch_the_module_for_stable_baselines3_says_what_to_install():
    code = BLOCKED + "import ruffini.sb3"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    last = done.stderr.splitlines()[-1]
    assert last.endswith('ruffini.sb3: found no torch: pip install "ruffini[train]"'), last


def test_a_run_plays_without_a_card_to_compare_with(run, capsys):
    assert main(["play", "--policy", str(run), "--episodes", "2"]) == 0
    head, found = capsys.readouterr().out.splitlines()
    assert head == f"{HOLD}: PPO, 512 steps, seed 4; 2 episodes from seed 10000"
    assert found.startswith("agent ")


def test_an_agent_is_trained_further(run, tmp_path, monkeypatch, capsys):
    pytest.importorskip("stable_baselines3")
    from ruffini.agents import training

    monkeypatch.setattr(training, "about_this_run", lambda: {"commit": "def5678"})
    folder = tmp_path / "further"
    words = ["--from", run, "--steps", 256, *EIGHT, "--out", folder]
    assert command("train", "HoldStill", *words, "--settings", '{"load": 0.5}') == 0
    first, agent = agents.load(run), agents.load(folder)
    assert agent.settings == COARSE | {"load": 0.5}
    assert agent.card["steps"] == first.card["steps"] + 256
    assert agent.card["commit"] == f"{first.card['commit']}, def5678"
    before, after = (one.card["normaliser"]["count"] for one in (first, agent))
    assert after == before + 8 * 33, "its statistics go on"
    weights = [one.tensors["policy.0.weight"] for one in (first, agent)]
    assert 0 < np.abs(weights[1] - weights[0]).max() < 0.1, "its weights, a little changed"
    # Steps are those of this run, without what the agent had learnt before.
    about = json.loads((folder / agents.RUN).read_text())
    about["params"]["steps"] = 512
    (folder / agents.RUN).write_text(json.dumps(about))
    for _ in range(2):
        assert command("train", "HoldStill", "--resume", "--out", folder) == 0
        assert agents.load(folder).card["steps"] == first.card["steps"] + 512
    assert "further: has its 512 steps" in capsys.readouterr().out
    other = ["--from", run, "--settings", '{"observation": "proprio"}', "--out", tmp_path / "b"]
    assert command("train", "HoldStill", *other) == 2
    assert "found channels " in capsys.readouterr().err


def test_a_flat_agent_is_trained_further(tmp_path):
    pytest.importorskip("stable_baselines3")
    settings = json.dumps(COARSE | {"obs": "flat"})
    words = ["train", "HoldStill", "--steps", 256, *EIGHT]
    assert command(*words, "--settings", settings, "--out", tmp_path / "a") == 0
    assert command(*words, "--from", tmp_path / "a", "--out", tmp_path / "b") == 0
    agent = agents.load(tmp_path / "b")
    assert agent.card["policy"] == "MlpPolicy" and agent.settings == COARSE


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["train", "HoldStil"], "task: found 'HoldStil', did you mean 'HoldStill'?"),
        (["train", "HoldStill", "--steps", "0"], "steps: found 0, expected a whole number from 1"),
        (
            ["train", "HoldStill", "--n-envs", "-1"],
            "n-envs: found -1, expected a whole",
        ),
        (["train", "HoldStill", "--seed", "-1"], "seed: found -1, expected a whole number"),
        (["train", "HoldStill", "--seed", str(2**32)], "a whole number from 0 below 2**32"),
        (["train", "HoldStill", "--settings", "load"], "settings: found 'load', expected JSON"),
        (["train", "HoldStill", "--settings", '{"lod": 1}'], "'lod', did you mean 'load'?"),
        (["train", "HoldStill", "--settings", '{"load": -1}'], "load: "),
        (["train", "HoldStill", "--from", "GraspLft"], "did you mean 'GraspLift'?"),
        (["train", "HoldStill", "--out", "FILE"], "File exists"),
        (["evaluate", "scritped"], "'scritped', did you mean 'scripted'? expected trained"),
        (["evaluate", "GrapsLift"], "'GrapsLift', did you mean 'GraspLift'?"),
        (["evaluate", "RUNS/shrt"], "RUNS/shrt, did you mean 'RUNS/short'? expected the folder"),
        (["evaluate", "FILE", "--task", "GraspLift"], f"found one of {HOLD}, expected one of ruf"),
        (["evaluate", "FILE", "--task", "Juggle"], "task: found 'Juggle', expected one of Grasp"),
        (["evaluate", "FILE", "--settings", '{"tactile": "none"}'], "found channels "),
        (["evaluate", "FILE", "--settings", '{"tactil": 1}'], "did you mean 'tactile'?"),
        (["evaluate", "scripted", "--settings", '{"observation": "proprio"}'], "the scripted"),
        (
            ["evaluate", "FILE", "--episodes", "0"],
            "episodes: found 0, expected a whole",
        ),
        (["evaluate", "FILE", "--json", "RUNS/none/a.json"], "json: RUNS/none/a.json: No such"),
        (["export", "RUNS/short", "--out", "a.onnx"], "found a.onnx, expected a .safetensors file"),
        (["export", "RUNS/shrt", "--out", "a.safetensors"], "did you mean 'RUNS/short'?"),
        (["export", "GraspLift", "--out", "a.safetensors"], "found none in GraspLift, expected"),
        (["export", "RUNS/begun", "--out", "a.safetensors"], "no checkpoint in RUNS/begun"),
        (["export", "RUNS/short", "--out", "none/a.safetensors"], "out: none/a.safetensors: No"),
    ],
)
def test_bad_input_is_one_line(tmp_path, monkeypatch, capsys, words, text):
    monkeypatch.chdir(tmp_path)
    for name in ("short", "begun"):
        (tmp_path / "RUNS" / name).mkdir(parents=True)
        (tmp_path / "RUNS" / name / agents.RUN).write_text("{}")
    (tmp_path / "RUNS/short/checkpoint").mkdir()
    file = tmp_path / "one.safetensors"
    file.write_bytes(drawn().to_bytes())
    found = sorted(os.listdir(tmp_path))
    assert command(*(str(file) if word == "FILE" else word for word in words)) == 2
    out, err = capsys.readouterr()
    assert text in err and err.count("\n") == 1 and out == "", err
    assert sorted(os.listdir(tmp_path)) == found


@pytest.mark.parametrize("word", ["train", "evaluate"])
def test_what_is_trained_has_to_be_said(word, capsys):
    assert main([word, "set", "run", "--epochs", "3"]) == 2
    told = f"{word}: expected ruffini agent {word}, or for models of the gel ruffini network {word}"
    assert capsys.readouterr().err == f"ruffini: {told}\n"
