"""The native batch: equal to single environments, and as Gymnasium expects a vector environment."""

from __future__ import annotations

import json
import pickle
import threading
from functools import cache
from inspect import signature

import gymnasium as gym
import numpy as np
import pytest
from conftest import MODES, actions, flat
from fresh import fresh
from gymnasium.vector import AutoresetMode

from ruffini import _rows
from ruffini.envs import GraspLiftEnv, GraspLiftVectorEnv

ROWS, STEPS = 3, 50
SETTINGS = {"max_episode_steps": 20, "observation": ["proprio", "object", "wrench", "properties"]}


@cache
def single_rollout(row: int, mode: str) -> list[tuple]:
    """Steps of the single environment of a row, whose caller resets it according to `mode`."""
    env = GraspLiftEnv(**SETTINGS)
    observation, _ = env.reset(seed=7 + row)
    log, over = [flat(observation).tobytes()], False
    for action in actions(ROWS, STEPS)[:, row]:
        if over and mode == "NextStep":
            observation, _ = env.reset()
            log.append((flat(observation).tobytes(), 0.0, False, False, None))
            over = False
            continue
        observation, reward, terminated, truncated, _ = env.step(action)
        over = terminated or truncated
        last = None
        if over and mode != "NextStep":
            last = flat(observation).tobytes()
            observation, _ = env.reset()
        log.append((flat(observation).tobytes(), reward, terminated, truncated, last))
    return log


def batch_rollout(mode: str, threads: int) -> list[list[tuple]]:
    envs = GraspLiftVectorEnv(ROWS, threads, autoreset_mode=mode, **SETTINGS)
    observation, _ = envs.reset(seed=7)
    logs = [[flat(observation)[row].tobytes()] for row in range(ROWS)]
    for action in actions(ROWS, STEPS):
        observation, reward, terminated, truncated, info = envs.step(action)
        over = terminated | truncated
        last = [None] * ROWS
        if mode == "SameStep" and over.any():
            last = [flat(o).tobytes() if o is not None else None for o in info["final_obs"]]
        if mode == "Disabled" and over.any():
            last = [flat(observation)[row].tobytes() if over[row] else None for row in range(ROWS)]
            observation, _ = envs.reset(options={"reset_mask": over})
        for row in range(ROWS):
            seen = flat(observation)[row].tobytes()
            flags = bool(terminated[row]), bool(truncated[row])
            logs[row].append((seen, float(reward[row]), *flags, last[row]))
    return logs


@pytest.mark.parametrize("threads", [1, 2, 4])
@pytest.mark.parametrize("mode", MODES)
def test_a_row_equals_the_single_environment_bit_for_bit(mode, threads):
    logs = batch_rollout(mode, threads)
    for row in range(ROWS):
        alone = single_rollout(row, mode)
        for step, (ours, theirs) in enumerate(zip(logs[row], alone, strict=True)):
            assert ours == theirs, f"row {row}, step {step}"


def test_seeds_can_be_given_one_by_one():
    envs = GraspLiftVectorEnv(2)
    both, _ = envs.reset(seed=[11, 4])
    alone, _ = GraspLiftEnv().reset(seed=4)
    np.testing.assert_array_equal(flat(both)[1], flat(alone))


def test_a_seed_is_gymnasiums_own_too():
    envs = GraspLiftVectorEnv(2, tactile="none")
    envs.reset(seed=5)
    assert envs.np_random_seed == 5


def test_make_vec_takes_the_native_batch_with_its_time_limit():
    envs = gym.make_vec("ruffini/GraspLift-v0", num_envs=2, max_episode_steps=5)
    assert isinstance(envs, GraspLiftVectorEnv)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    envs.reset(seed=0)
    ends = [envs.step(np.zeros((2, 5)))[3].all() for _ in range(6)]
    assert ends == [False] * 4 + [True, False]
    assert envs.spec.max_episode_steps == 5
    again = gym.make_vec(envs.spec, num_envs=2)
    assert again.spec.max_episode_steps == 5
    assert gym.make_vec("ruffini/GraspLift-v0").spec.max_episode_steps == 100


def test_returned_arrays_are_the_callers_own():
    envs = GraspLiftVectorEnv(2, obs="flat")
    first, _ = envs.reset(seed=0)
    kept = first.copy()
    acts = actions(2, 3)
    second, reward, *_ = envs.step(acts[0])
    np.testing.assert_array_equal(first, kept)
    for array in (first, second, reward):
        array[:] = 7.0
    third, *_ = envs.step(acts[1])
    twin = GraspLiftVectorEnv(2, obs="flat")
    twin.reset(seed=0)
    twin.step(acts[0])
    np.testing.assert_array_equal(third, twin.step(acts[1])[0])


def test_every_info_has_its_mask():
    envs = GraspLiftVectorEnv(2, autoreset_mode="SameStep", max_episode_steps=3)
    envs.reset(seed=0)
    for step in range(6):
        *_, info = envs.step(np.zeros((2, 5)))
        for key in info:
            assert key.startswith("_") or info[f"_{key}"].shape == (2,), key
        assert ("final_obs" in info) == (step % 3 == 2)
        if "final_info" in info:
            assert "is_success" in info["final_info"]
            assert "is_success" not in info


def same_infos(ours: dict, theirs: dict, where: str) -> None:
    """Raises unless both vector infos have the same keys, masks, values and types."""
    assert ours.keys() == theirs.keys(), where
    for key, value in theirs.items():
        if isinstance(value, dict):
            same_infos(ours[key], value, f"{where}, {key}")
            continue
        assert ours[key].dtype == value.dtype, f"{where}, {key}"
        if key == "final_obs":
            for found, expected in zip(ours[key], value, strict=True):
                assert (found is None) == (expected is None), f"{where}, {key}"
                if expected is not None:
                    np.testing.assert_array_equal(flat(found), flat(expected))
        else:
            np.testing.assert_array_equal(ours[key], value, f"{where}, {key}")


ERRORS = {
    "noise": (1e-3, 2e-3),
    "gain": (0.9, 1.1),
    "offset": 1e-3,
    "drift": (1e-3, 2e-3),
    "hysteresis": 1e-3,
    "delay": 2,
}
"""Every error of a channel that is drawn per episode or step."""


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("name", ["GraspLift", "HoldStill"])
def test_infos_are_those_of_gymnasiums_own_vector_environment(name, mode):
    env_id = f"ruffini/{name}-v0"
    settings = {"max_episode_steps": 12, "observation": "proprio", "tactile": "none"}
    if name == "HoldStill":
        settings["sensor_errors"] = {"proprio": ERRORS}
    ours = gym.make_vec(env_id, num_envs=ROWS, autoreset_mode=mode, **settings)
    singles = [lambda: gym.make(env_id, **settings)] * ROWS
    theirs = gym.vector.SyncVectorEnv(singles, autoreset_mode=mode)
    acts = actions(ROWS, STEPS)
    # One row opens its hand: in HoldStill it drops the object.
    acts[:, 1, 4] = -1
    ends, keys, resets = [np.zeros(ROWS, bool)], set(), 0
    for envs in (ours, theirs):
        assert envs.reset(seed=7)[1] == {}
    for step, action in enumerate(acts):
        # A mask resets rows in the middle of their episodes, and a row that has ended.
        if step == 7 or (ends[-1][0] and resets < 2):
            resets, some = resets + 1, np.array([True, False, True])
            found, expected = (
                envs.reset(seed=11, options={"reset_mask": some.copy()}) for envs in (ours, theirs)
            )
            np.testing.assert_array_equal(flat(found[0]), flat(expected[0]))
        found, expected = ours.step(action), theirs.step(action)
        np.testing.assert_array_equal(flat(found[0]), flat(expected[0]))
        for ours_of, theirs_of in zip(found[1:4], expected[1:4], strict=True):
            np.testing.assert_array_equal(ours_of, theirs_of)
        same_infos(found[4], expected[4], f"step {step}")
        ends.append(found[2] | found[3])
        keys |= found[4].keys() | found[4].get("final_info", {}).keys()
    assert (np.sum(ends, axis=0) >= 3).all()
    assert any(some.any() and not some.all() for some in ends), "rows ended together"
    assert name == "GraspLift" or "ending" in keys


LONG = {"observation": "markers", "tactile": "compliance", "resolution": {"nodes": 300}}
"""An observation of more numbers than 7 bits count."""


@pytest.mark.parametrize("obs", [{"observation": "time"}, {"obs": "flat"}, LONG])
@pytest.mark.parametrize("through", ["state", "pickle"])
def test_a_batch_put_back_knows_which_rows_start_anew(through, obs):
    settings = {"max_episode_steps": 4, "tactile": "none", **obs}
    envs = GraspLiftVectorEnv(2, **settings)
    envs.reset(seed=0)
    still = np.zeros((2, 5), np.float32)
    for _ in range(2):
        envs.step(still)
    envs.reset(options={"reset_mask": np.array([False, True])})
    has_info = []
    for _ in range(5):
        if through == "pickle":
            twin = pickle.loads(pickle.dumps(envs))
        else:
            twin = GraspLiftVectorEnv(2, **settings)
            twin.set_state(envs.state())
        *_, found = twin.step(still)
        *_, expected = envs.step(still)
        same_infos(found, expected, f"after {len(has_info)} steps")
        has_info.append(found["_is_success"].tolist())
    # The first row's third step is its last but one; the second row has begun anew.
    assert has_info == [[True, True]] * 2 + [[False, True]] + [[True, True]] + [[True, False]]


def test_a_seed_beside_a_mask_leaves_the_other_rows_streams_alone():
    envs, twin = GraspLiftVectorEnv(2, obs="flat"), GraspLiftVectorEnv(2, obs="flat")
    for both in (envs, twin):
        both.reset(seed=0)
    envs.reset(seed=5, options={"reset_mask": np.array([False, True])})
    np.testing.assert_array_equal(envs.reset()[0][0], twin.reset()[0][0])


def test_common_wrappers_work():
    envs = GraspLiftVectorEnv(4, obs="flat", max_episode_steps=10)
    envs = gym.wrappers.vector.RecordEpisodeStatistics(envs)
    envs = gym.wrappers.vector.NormalizeObservation(envs)
    envs.reset(seed=0)
    for action in actions(4, 10):
        *_, info = envs.step(action)
    np.testing.assert_array_equal(info["episode"]["l"], [10] * 4)


def test_gymnasiums_benchmark_runs():
    performance = pytest.importorskip("gymnasium.utils.performance")
    if not hasattr(performance, "benchmark_vector_step"):
        pytest.skip("gymnasium 1.2 has no benchmark of vector environments")
    assert performance.benchmark_vector_step(GraspLiftVectorEnv(8), target_duration=1, seed=0) > 100


def test_every_row_has_a_picture():
    envs = GraspLiftVectorEnv(2, render_mode="rgb_array", width=64, height=48)
    envs.reset(seed=0)
    frames = envs.render()
    assert [frame.shape for frame in frames] == [(48, 64, 3)] * 2
    assert not np.array_equal(*frames)


def test_what_is_of_a_row_is_that_of_the_row_by_any_name():
    envs = GraspLiftVectorEnv(4, tactile="none", objects=["sphere", "cup", "cuboid"])
    envs.reset(seed=0)
    for surfaces, row in zip(envs.call("surfaces"), range(4), strict=True):
        np.testing.assert_array_equal(surfaces["object"][0], envs.surfaces(row)["object"][0])
    assert len({len(surfaces["object"][0]) for surfaces in envs.call("surfaces")}) > 1
    methods = [name for name in dir(envs) if callable(getattr(envs, name)) and name[0] != "_"]
    of_row = {name for name in methods if "row" in signature(getattr(envs, name)).parameters}
    # `render` is that of a row.
    assert of_row - {"picture"} == {"look", "surfaces", "presses"} <= set(_rows._METHODS)
    for name in _rows._METHODS:
        assert f"``{name}``" in type(envs).call.__doc__, name


def test_attributes_are_got_and_set_for_all_rows():
    envs = GraspLiftVectorEnv(3, tactile="none", render_mode="rgb_array")
    assert envs.get_attr("render_mode") == ("rgb_array",) * 3
    envs.set_attr("note", 5)
    envs.set_attr("note", [6, 6, 6])
    assert envs.get_attr("note") == (6, 6, 6)
    for values in ([1, 2, 3], [1, 1], [], [np.zeros(2), np.ones(2), np.zeros(2)]):
        with pytest.raises(ValueError, match=r"note: found .*, expected one value, which all rows"):
            envs.set_attr("note", values)
    for values in (np.arange(2), [np.arange(2)] * 3, tuple(np.arange(2) for _ in range(3))):
        envs.set_attr("note", values)
        np.testing.assert_array_equal(envs.get_attr("note"), [[0, 1]] * 3)


def test_a_batch_has_the_time_limit_that_make_gives_a_single_environment():
    settings = {"tactile": "none", "observation": "time"}
    for given, limit, steps in ((None, 100, 100), (3, 3, 3), (-1, None, None)):
        envs = gym.make_vec("ruffini/GraspLift-v0", max_episode_steps=given, **settings)
        again = gym.make_vec(envs.spec)
        alone = gym.make("ruffini/GraspLift-v0", max_episode_steps=given, **settings)
        for env in (envs, again, alone):
            assert env.spec.max_episode_steps == limit, (given, env)
            env.reset(seed=0)
        ends = [envs.step(np.zeros((1, 5)))[3].any() for _ in range(105)]
        assert (ends.index(True) + 1 if any(ends) else None) == steps, given
    for wrong in (0, -2, 1.5, True):
        for make in (GraspLiftVectorEnv, GraspLiftEnv):
            with pytest.raises(
                ValueError, match=f"max_episode_steps: found {wrong}, expected a wh"
            ):
                make(max_episode_steps=wrong, **settings)


def test_an_ended_row_must_be_reset_when_autoreset_is_disabled():
    envs = GraspLiftVectorEnv(2, autoreset_mode="Disabled", max_episode_steps=1)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 5)))
    with pytest.raises(ValueError, match="row 0 without a running episode"):
        envs.step(np.zeros((2, 5)))
    with pytest.raises(ValueError, match="reset_mask"):
        envs.reset(options={"reset_mask": np.zeros(2, bool)})


def test_an_object_that_is_pushed_off_the_table_is_lost_by_name():
    envs = GraspLiftVectorEnv(64, tactile="none", objects="sphere", friction=0.2)
    envs.reset(seed=0)
    push = np.zeros((64, 5), np.float32)
    push[:, 4], push[::2, 0], push[1::2, 0] = -1, -1, 1
    lost = 0
    for step in range(99):
        push[:, 2] = -1 if step < 12 else 0
        *_, terminated, _, info = envs.step(push)
        for row in np.flatnonzero(terminated):
            assert info["ending"][row] == "object_lost" and not info["is_success"][row]
            assert np.abs(envs.look(row)["object_position"][:2]).max() > 0.25
            lost += 1
    assert lost > 2


def test_a_call_while_another_thread_steps_says_so():
    envs = GraspLiftVectorEnv(512, num_threads=1, tactile="none")
    envs.reset(seed=0)
    still, said = np.zeros((512, 5), np.float32), []

    def until_one_is_refused(call):
        for _ in range(100):
            try:
                call()
            except RuntimeError as error:
                said.append(str(error))
            if said:
                return

    worker = threading.Thread(target=until_one_is_refused, args=[lambda: envs.step(still)])
    worker.start()
    until_one_is_refused(envs.state)
    worker.join()
    assert "found in another call, expected one thread at a time" in said[0]
    envs.step(still)


def memory() -> bytes:
    """Bytes of one of the first environments, and what each 25,600 steps more add to many."""
    from timing import allocated_bytes, make, memory_per_environment, random_steps

    one = memory_per_environment(256)
    step = random_steps(make(256, 8), 256)
    allocated = []
    for _ in range(5):
        for i in range(100):
            step(i)
        allocated.append(allocated_bytes())
    return json.dumps([one, np.diff(allocated).tolist()]).encode()


def test_memory_does_not_grow(monkeypatch):
    # What is allocated is counted, for on many cores what is in use grows for longer: by what the
    # allocator of each thread keeps for later.
    monkeypatch.setenv("PYTHONMALLOC", "malloc")
    one, grown = json.loads(fresh(memory))
    assert one < 1e6, f"{one:.0f} bytes"
    # A leak grows each time, other than what episodes at different steps hold.
    assert min(grown) < 5e5, f"bytes in 25,600 steps: {grown}"
