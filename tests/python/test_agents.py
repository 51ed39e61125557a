"""`ruffini.agents`: those that come with the package, and files that are none."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from conftest import IDS
from drawn_agent import COARSE, HOLD, card, drawn, tensors

from ruffini import __version__, agents
from ruffini._core import read_tensors, write_tensors
from ruffini.agents import FORMAT, MOST_BYTES, Agent, Card, environment_id, load

SAID = ("episodes", "first_seed", "success", "interval", "return")


def test_every_task_has_an_agent_in_the_package():
    assert agents.names() == [env_id.split("/")[1] for env_id in IDS]


def test_agents_that_come_with_the_package_are_whole():
    for name in agents.names():
        agent = load(name)
        size = len(agent.to_bytes())
        assert size <= MOST_BYTES, f"{name}: {size} bytes, at most {MOST_BYTES}"
        assert agent.env_id == environment_id(name) == f"ruffini/{name}"
        assert set(agent.card) == set(Card.__annotations__)
        told = agent.card["evaluation"]
        assert set(SAID) <= set(told) and told["episodes"] >= 200, told
        low, high = told["interval"]
        assert 0 <= low <= told["success"] <= high <= 1
        assert re.fullmatch(r"[0-9a-f]{7,}(, [0-9a-f]{7,})*", agent.card["commit"])
        assert agent.card["threads"] >= 1 and agent.card["steps"] > 0
        env = gym.make(agent.env_id, **agent.settings)
        agent.check(env.observation_space)
        action, _ = agent.predict(env.reset(seed=0)[0])
        assert action.shape == (5,) and np.abs(action).max() <= 1


def test_observing_the_stress_of_every_tetrahedron_ends_no_lift():
    """One folded tetrahedron passed the bound, which ended this episode at its 11th step."""
    agent = load("GraspLift")
    seen = [*agent.channels, "tet_stress"]
    env = gym.make("ruffini/GraspLift-v0", **{**agent.settings, "observation": seen})
    observation, _ = env.reset(seed=10004)
    over = False
    while not over:
        observation, _, terminated, truncated, info = env.step(agent.predict(observation)[0])
        over = terminated or truncated
    assert info["is_success"] and not terminated, info.get("ending")


def test_a_task_has_many_spellings():
    for name in ("GraspLift", "grasp-lift", "grasp_lift", "GraspLift-v0", "ruffini/GraspLift-v0"):
        assert environment_id(name) == "ruffini/GraspLift-v0"
    assert environment_id("ruffini:ruffini/HoldStill-v0") == "ruffini/HoldStill-v0"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("GraspLft", "task: found 'GraspLft', did you mean 'GraspLift'? expected one of"),
        ("GraspLift-v9", "task: found 'GraspLift-v9'"),
        ("", "task: found ''"),
        ("runs/none", "run: found none in runs/none, expected the folder of a training run"),
        (__file__, "test_agents.py, expected the path of a .safetensors file, the folder of a run"),
        (".safetensors/", "the path of a .safetensors file, the folder of a run, or one of: "),
    ],
)
def test_an_unknown_agent_is_named_with_those_that_are_known(name, text):
    with pytest.raises(ValueError) as raised:
        load(name)
    assert text in str(raised.value) and "\n" not in str(raised.value)


def test_a_file_that_is_not_there_is_no_agent():
    with pytest.raises(FileNotFoundError, match=r"none\.safetensors"):
        load("none.safetensors")


def test_a_file_brings_back_the_agent(tmp_path):
    agent = drawn()
    path = tmp_path / "one.safetensors"
    path.write_bytes(agent.to_bytes())
    again = load(path)
    assert again.card == agent.card and again.channels == agent.channels
    for name, values in agent.tensors.items():
        assert again.tensors[name].dtype == values.dtype
        np.testing.assert_array_equal(again.tensors[name], values)
    assert again.to_bytes() == agent.to_bytes()
    env = gym.make(HOLD, **COARSE)
    observation, _ = env.reset(seed=0)
    np.testing.assert_array_equal(again.predict(observation)[0], agent.predict(observation)[0])


def changed(**parts):
    made = card()
    for name, value in parts.items():
        made[name] = made[name] | value if isinstance(value, dict) else value
    return made


@pytest.mark.parametrize(
    ("made", "text"),
    [
        (changed(format=FORMAT + 1), f"found format {FORMAT + 1}, of ruffini {__version__}"),
        ({}, f"found no card, expected that of an agent of format {FORMAT}"),
        ([1], "found no card"),
        ({"format": FORMAT}, "found no ruffini, commit, env"),
        (changed(network={"activation": "Sine"}), "an activation of Tanh, ReLU, ELU"),
        (changed(network={"order": ["proprio"]}), "expected each of proprio, wrench, slip"),
        (changed(network={"policy": [17]}), "policy.0.bias: found (16,), expected (17,)"),
        (changed(network={"policy": 3}), "its card is not that of an agent"),
        (changed(network={"touch": {"slip": []}}), "its card is not that of an agent"),
        (changed(channels={"slip": 3}), "normaliser.slip.mean: found (2,), expected (3,)"),
        (changed(normaliser={"channels": ["slip"]}), "found (14,), expected none"),
    ],
)
def test_a_card_that_does_not_fit_is_refused(tmp_path, made, text):
    path = tmp_path / "bad.safetensors"
    path.write_bytes(write_tensors(tensors(card()), json.dumps(made)))
    with pytest.raises(ValueError) as raised:
        load(path)
    assert text in str(raised.value) and "bad.safetensors" in str(raised.value)


@pytest.mark.parametrize("name", agents.names())
def test_the_action_of_a_row_does_not_depend_on_the_others(name):
    agent, random = agents.load(name), np.random.default_rng(0)
    rows = {
        name: random.normal(size=(48, size)).astype(np.float32)
        for name, size in agent.card["channels"].items()
    }
    together, _ = agent.predict(rows)
    alone = [agent.predict({name: row[i] for name, row in rows.items()})[0] for i in range(48)]
    assert (together == np.array(alone)).all(), np.abs(together - alone).max()


def test_numbers_that_are_not_finite_are_refused():
    made = tensors(card())
    made["policy.1.bias"][2] = np.nan
    with pytest.raises(ValueError, match=r"policy\.1\.bias: found numbers that are not finite"):
        Agent(card(), made)


def test_damaged_files_are_refused(tmp_path):
    whole, path = drawn().to_bytes(), tmp_path / "bad.safetensors"
    header = int.from_bytes(whole[:8], "little")
    huge = (2**63).to_bytes(8, "little")
    flipped = bytearray(whole)
    flipped[header + 20] ^= 1  # a weight that is finite still
    for damaged in (b"", whole[:-1], whole[: header // 2], whole + b"0", huge + whole[8:], flipped):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"bad\.safetensors: data: found .*, expected"):
            load(path)
    with pytest.raises(ValueError, match="Is a directory"):
        (tmp_path / "folder.safetensors").mkdir()
        load(tmp_path / "folder.safetensors")


def test_tensors_cross_as_they_are():
    given = {
        "one": np.array(0.25, np.float32),
        "none": np.zeros((0, 3), np.float32),
        "turned": np.arange(6.0).reshape(2, 3).T,
    }
    found, text = read_tensors(write_tensors(given, "ä card"))
    assert text == "ä card" and found.keys() == given.keys()
    for name, values in given.items():
        assert (found[name].dtype, found[name].shape) == (values.dtype, values.shape)
        np.testing.assert_array_equal(found[name], values)
    with pytest.raises(ValueError, match="whole: found int64, expected float32 or float64"):
        write_tensors({"whole": np.arange(3)}, "")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda seen: {k: v for k, v in seen.items() if k != "slip"}, "expected also slip"),
        (lambda seen: seen | {"slip": np.zeros((2, 3))}, r"\(2, 3\), expected \(2,\) or \(N, 2\)"),
        (lambda seen: seen | {"slip": np.zeros((3, 2))}, "as many rows of each"),
        (lambda seen: np.zeros((2, 27)), r"found shape \(2, 27\), expected \(28,\) or \(N, 28\)"),
        (
            lambda seen: seen | {"slip": np.full((2, 2), np.nan)},
            r"observation\['slip'\]: found nan in 4 of 4 numbers, expected finite",
        ),
        (lambda seen: np.zeros(()), r"found shape \(\), expected \(28,\)"),
    ],
)
def test_other_observations_are_refused(change, text):
    agent = drawn()
    seen = {name: np.zeros((2, size), np.float32) for name, size in agent.channels.items()}
    assert agent.predict(seen)[0].shape == (2, 5)
    with pytest.raises(ValueError, match=text):
        agent.predict(change(seen))


def test_environments_with_other_channels_are_refused():
    agent = drawn()
    agent.check(gym.make(HOLD, **COARSE).observation_space)
    agent.check(gym.make(HOLD, obs="flat", **COARSE).observation_space)
    rigid = gym.make(HOLD, tactile="none").observation_space
    with pytest.raises(ValueError, match=r"found channels .*slip \(2\).*, expected the env"):
        agent.check(rigid)
    with pytest.raises(ValueError, match=r"found observations of 28 numbers, expected the env"):
        agent.check(gym.make(HOLD, tactile="none", obs="flat").observation_space)


def test_agents_and_their_files_are_part_of_the_package():
    folder = Path(agents.__file__).parent
    ignored = ["git", "-C", str(folder), "check-ignore", "-q", "GraspLift-v0.safetensors"]
    found = subprocess.run(ignored, capture_output=True, check=False).returncode
    # 0 is ignored, 1 is not, 128 is no repository.
    assert found in (1, 128)


def test_agents_need_no_torch():
    code = (
        "import sys; sys.modules['torch'] = sys.modules['stable_baselines3'] = None;"
        "import ruffini.agents, ruffini.evaluation, ruffini.commands"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
