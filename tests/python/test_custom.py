"""Tasks of one's own: the same rules for one environment and for many, against native ones."""

from __future__ import annotations

import pickle

import gymnasium as gym
import numpy as np
import pytest
from conftest import MODES, actions
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import check_env

import ruffini
from rollout_speed import LiftInPython
from ruffini.custom import CustomEnv, CustomVectorEnv, Task, register
from ruffini.policies import part

RIGID = {"tactile": "none", "observation": "proprio"}
TOOL = "tool centre position"


class Lift(LiftInPython):
    """GraspLift's reward, written in Python from what is observed."""

    settings = RIGID


class Low(Task):
    """Pays for a low hand, ends below a height, and begins where it has drawn."""

    settings = RIGID
    terms = {"low": 2.0}
    endings = ["down"]

    def draw(self, random):
        return {"start_height": random.uniform(0.12, 0.16), "object": random.choice([0, 2])}

    def reward(self, state):
        return {"low": 1 - state.part("proprio", TOOL)[:, 2]}

    def ending(self, state):
        return {"down": state.part("proprio", TOOL)[:, 2] < 0.1}

    def is_success(self, state):
        return state.part("proprio", TOOL)[:, 2] < 0.11


def lifting(envs, steps: int):
    """Scripted and random actions in turn, from what a native twin observes."""
    policy = ruffini.policies.scripted("ruffini/GraspLift-v0")
    for step, noise in zip(range(steps), actions(envs.num_envs, steps), strict=True):
        action, _ = policy.predict(envs.seen)
        yield action if step % 4 else np.clip(action + 0.3 * noise, -1, 1)


def test_a_single_channel_that_rules_read_may_be_given_by_its_name():
    class Heavy(Low):
        reads = "properties"

        def is_success(self, state):
            return state.part("properties", "mass") > 0

    envs = CustomVectorEnv(Heavy, 2)
    envs.reset(seed=0)
    *_, info = envs.step(np.zeros((2, 5)))
    assert info["is_success"].all() and "properties" not in envs.observation_space.spaces


@pytest.mark.parametrize("mode", MODES)
def test_rules_in_python_pay_what_the_native_ones_pay(mode):
    about = {"autoreset_mode": mode, "max_episode_steps": 70}
    native = gym.make_vec("ruffini/GraspLift-v0", num_envs=3, tactile="none", **about)
    own = CustomVectorEnv(Lift, 3, **about)
    native.seen, _ = native.reset(seed=0)
    observation, _ = own.reset(seed=0)
    assert list(observation) == ["proprio"] == list(own.single_observation_space.keys())
    paid = 0.0
    for action in lifting(native, 69 if mode == "Disabled" else 80):
        native.seen, reward, terminated, truncated, info = native.step(action)
        seen, mine, ended, cut, told = own.step(action)
        np.testing.assert_array_equal(seen["proprio"], native.seen["proprio"])
        np.testing.assert_allclose(mine, reward, atol=2e-6)
        np.testing.assert_array_equal(ended, terminated)
        np.testing.assert_array_equal(cut, truncated)
        paid += mine.sum()
        assert info.keys() == told.keys()
        for row in np.flatnonzero(info.get("_final_obs", ())):
            last, mine = info["final_obs"][row], told["final_obs"][row]
            np.testing.assert_array_equal(last["proprio"], mine["proprio"])
            assert list(mine) == ["proprio"]
    assert paid > 60, f"{paid}: nothing was lifted"


@pytest.mark.parametrize("mode", MODES)
def test_a_row_equals_the_single_environment(mode):
    rows, steps = 3, 40
    envs = CustomVectorEnv(Low, rows, autoreset_mode=mode, objects=["sphere", "cup", "cuboid"])
    singles = [CustomEnv(Low, objects=["sphere", "cup", "cuboid"]) for _ in range(rows)]
    first, _ = envs.reset(seed=5)
    over = np.zeros(rows, bool)
    for row, env in enumerate(singles):
        observation, _ = env.reset(seed=5 + row)
        np.testing.assert_array_equal(observation["proprio"], first["proprio"][row])
        assert env.look()["object"] == envs.look(row)["object"] != "cup"
    ended = 0
    down = np.tile(np.array([0, 0, -0.5, 0, 0], np.float32), (rows, 1))
    down[1] *= 0.7
    for _ in range(steps):
        if mode == "Disabled" and over.any():
            envs.reset(options={"reset_mask": over.copy()})
            for row in np.flatnonzero(over):
                singles[row].reset()
            over[:] = False
        seen, reward, terminated, _, info = envs.step(down)
        for row, env in enumerate(singles):
            if over[row]:
                observation, _ = env.reset()
                over[row] = False
                assert reward[row] == 0 and not terminated[row]
            else:
                observation, alone, end, _, told = env.step(down[row])
                assert (alone, end) == (reward[row], terminated[row])
                last = info["final_info"] if mode == "SameStep" and end else info
                assert told["is_success"] == last["is_success"][row]
                assert told.get("ending") == ("down" if end else None)
                ended += end
                if end:
                    assert last["ending"][row] == "down"
                    if mode == "SameStep":
                        observation, _ = env.reset()
                    else:
                        over[row] = True
            np.testing.assert_array_equal(observation["proprio"], seen["proprio"][row])
    assert ended > 5


@pytest.mark.parametrize("mode", MODES)
def test_a_quantity_that_is_left_out_is_drawn_as_usual(mode):
    class Once(Low):
        """Gives the mass of each row's first episode alone."""

        def draw(self, random):
            self.calls = getattr(self, "calls", 0) + 1
            return {"mass": np.full(len(random), 0.05)} if self.calls == 1 else {}

    envs = CustomVectorEnv(Once, 2, autoreset_mode=mode)
    envs.reset(seed=0)
    assert [envs.look(row)["mass"] for row in range(2)] == [0.05, 0.05]
    envs.reset(seed=1)
    usual = gym.make_vec("ruffini/GraspLift-v0", num_envs=2, tactile="none")
    usual.reset(seed=1)
    masses = [[e.look(row)["mass"] for row in range(2)] for e in (envs, usual)]
    assert masses[0] == masses[1], masses


def test_a_registered_task_is_made_by_gymnasium_and_stable_baselines3():
    register("test/Low-v0", Low, max_episode_steps=30)
    try:
        env = gym.make("test/Low-v0")
        assert isinstance(env.unwrapped, CustomEnv)
        check_env(env.unwrapped, skip_render_check=True)
        envs = gym.make_vec("test/Low-v0", num_envs=2, obs="flat")
        assert isinstance(envs, CustomVectorEnv)
        assert envs.single_observation_space.shape == (14,)
        sb3 = pytest.importorskip("ruffini.sb3")
        wrapped = sb3.make_vec_env("test/Low-v0", n_envs=2, seed=0)
        wrapped.reset()
        for step in range(1, 32):
            *_, dones, infos = wrapped.step(np.zeros((2, 5), np.float32))
            assert all(info["reward_terms"].keys() == {"low"} for info in infos)
            assert dones.all() == dones.any() == (step == 30)
    finally:
        gym.registry.pop("test/Low-v0")


@pytest.mark.parametrize(("given", "expected"), [({}, 3), ({"max_episode_steps": 10}, 10)])
def test_make_and_make_vec_set_the_time_limit(given, expected):
    class Brief(Lift):
        """Ends after three steps."""

        settings = RIGID | {"max_episode_steps": 3}

    def ends(envs, rows):
        envs.reset(seed=0)
        still = np.zeros((*rows, 5), np.float32)
        return [bool(np.all(envs.step(still)[3])) for _ in range(expected)]

    register("test/Brief-v0", Brief)
    try:
        single = gym.make("test/Brief-v0", **given)
        batch = gym.make_vec("test/Brief-v0", num_envs=2, **given)
        unlimited = gym.make("test/Brief-v0", max_episode_steps=-1)
    finally:
        gym.registry.pop("test/Brief-v0")
    for envs, rows in ((single, ()), (batch, (2,)), (CustomEnv(Brief, **given), ())):
        assert ends(envs, rows) == [False] * (expected - 1) + [True]
    assert batch.spec.max_episode_steps == single.spec.max_episode_steps == expected
    assert not any(ends(unlimited, ()))


def test_gymnasium_wraps_single_environments_in_turn_and_the_batch_as_a_whole():
    task, settings = "ruffini/GraspLift-v0", {"num_envs": 2, "obs": "flat", **RIGID}

    def half(env):
        return gym.wrappers.TransformReward(env, lambda reward: 0.5 * reward)

    with pytest.raises(gym.error.Error, match="wrappers argument"):
        gym.make_vec(task, wrappers=[half], **settings)
    turns = gym.make_vec(task, vectorization_mode="sync", wrappers=[half], **settings)
    batch = gym.make_vec(task, **settings)
    whole = gym.wrappers.vector.TransformReward(batch, lambda reward: 0.5 * reward)
    plain = gym.make_vec(task, **settings)
    rewards = []
    for envs in (turns, whole, plain):
        envs.reset(seed=0)
        rewards.append(envs.step(np.zeros((2, 5), np.float32))[1])
    np.testing.assert_array_equal(rewards[0], rewards[1])
    np.testing.assert_array_equal(rewards[1], 0.5 * rewards[2])


class Remembering(Low):
    """Observes the steps of the episode, and its last action, height and one term of the base."""

    terms = {"low": 2.0, "seen": 1.0}
    reads = ["properties"]
    observation = {
        "steps": Box(0, 1e6, (1,), np.float32),
        "last": Box(-9, 9, (7,), np.float32),
    }

    def start(self, state, rows):
        if not hasattr(self, "steps"):
            self.steps = np.zeros(len(state.action))
        self.steps[rows] = 0

    def reward(self, state):
        self.steps += 1
        return super().reward(state) | {"seen": self.steps}

    def observe(self, state):
        height = state.part("proprio", TOOL)[:, 2:]
        paid = state.base_terms["reach"][:, None]
        last = np.concatenate([state.action, height, paid], axis=1)
        return {"steps": self.steps, "last": last}


@pytest.fixture
def remembering():
    register("test/Remembering-v0", Remembering)
    yield "test/Remembering-v0"
    gym.registry.pop("test/Remembering-v0")


def test_own_observations_stand_between_those_of_the_base_and_those_that_rules_read(remembering):
    env = gym.make(remembering)
    check_env(env.unwrapped, skip_render_check=True)
    names = [name for name, _ in env.unwrapped.channels()]
    assert names == ["proprio", "steps", "last", "properties"]
    assert set(env.observation_space) == set(names[:-1])
    assert env.observation_space["last"] == Remembering.observation["last"]
    seen, _ = env.reset(seed=0)
    np.testing.assert_array_equal(seen["last"][:5], 0)
    down = np.array([0, 0, -1, 0, 0], np.float32)
    seen, *_ = env.step(down)
    flat = CustomVectorEnv(Remembering, 1, obs="flat")
    flat.reset(seed=[0])
    whole, *_ = flat.step(down[None])
    np.testing.assert_array_equal(whole[0], np.concatenate(list(seen.values())))
    assert part(seen, "last", "last", env.unwrapped.channels()).shape == (7,)
    assert seen["last"][5] == part(seen, "proprio", TOOL)[2]


@pytest.mark.parametrize("mode", MODES)
def test_own_observations_begin_and_end_with_their_episodes(mode):
    envs = CustomVectorEnv(Remembering, 3, autoreset_mode=mode, max_episode_steps=30)
    envs.reset(seed=0)
    steps, ended = np.zeros(3), np.zeros(3, bool)
    ends = 0
    for action in actions(3, 80):
        action[:, 2] = np.maximum(action[:, 2] - 0.8, -1)
        if mode == "Disabled" and ended.any():
            first, _ = envs.reset(options={"reset_mask": ended})
            steps[ended] = 0
            np.testing.assert_array_equal(first["steps"][:, 0], steps)
            assert (first["last"][ended, :5] == 0).all() and first["last"][~ended, :5].any(1).all()
        seen, _, terminated, truncated, info = envs.step(action)
        began = ended & (mode == "NextStep")
        steps = np.where(began, 0, steps + 1)
        ended = terminated | truncated
        if mode == "SameStep":
            for row in np.flatnonzero(ended):
                last = info["final_obs"][row]
                assert last["steps"] == steps[row]
                np.testing.assert_array_equal(last["last"][:5], np.float32(action[row]))
            began = ended
            steps[ended] = 0
        ends += ended.sum()
        np.testing.assert_array_equal(seen["steps"][:, 0], steps)
        np.testing.assert_array_equal(
            seen["last"][:, :5], np.where(began[:, None], 0, np.float32(action))
        )
        np.testing.assert_array_equal(
            seen["last"][:, 5], part(seen, "proprio", TOOL, envs.channels())[:, 2]
        )
    assert ends > 3


class Aiming(Low):
    """Observes a height that it draws at each start, and its last action."""

    observation = {"aim": Box(0, 1, (1,), np.float32), "last": Box(-1, 1, (5,), np.float32)}

    def start(self, state, rows):
        if not hasattr(self, "aim"):
            self.aim = np.zeros(len(state.action))
        self.aim[rows] = state.random.uniform()

    def observe(self, state):
        return {"aim": self.aim, "last": state.action}


def test_numbers_of_ones_own_are_drawn_at_the_start_with_every_mode():
    drawn = []
    for mode in ("NextStep", "SameStep"):
        envs = CustomVectorEnv(Aiming, 3, autoreset_mode=mode, max_episode_steps=9)
        seen, _ = envs.reset(seed=5)
        aims = [[aim] for aim in seen["aim"][:, 0].tolist()]
        for _ in range(60):
            seen, *_ = envs.step(np.full((3, 5), 3.0))
            assert seen["last"].max() <= 1
            for row, aim in enumerate(seen["aim"][:, 0].tolist()):
                aims[row] += [aim] * (aim != aims[row][-1])
        drawn.append([row[:4] for row in aims])
        assert len({aim for row in aims for aim in row}) >= 12
    env = CustomEnv(Aiming)
    first = [env.reset(seed=6)[0]["aim"][0], *(env.reset()[0]["aim"][0] for _ in range(3))]
    assert drawn[0] == drawn[1] and drawn[0][1] == first


def test_stable_baselines3_sees_own_observations_of_the_last_state(remembering):
    sb3 = pytest.importorskip("ruffini.sb3")
    envs = sb3.make_vec_env(remembering, n_envs=2, max_episode_steps=5)
    envs.reset()
    for _ in range(5):
        seen, _, dones, infos = envs.step(np.zeros((2, 5)))
    assert dones.all() and (seen["steps"] == 0).all()
    assert all(info["terminal_observation"]["steps"] == 5 for info in infos)


@pytest.mark.parametrize("obs", ["dict", "flat"])
def test_agents_of_a_task_with_channels_that_only_rules_read_are_exported(
    remembering, obs, tmp_path
):
    pytest.importorskip("stable_baselines3")
    from tiny_agent import exported

    _, _, agent = exported(tmp_path / "a.safetensors", remembering, {}, obs=obs)
    env = gym.make(remembering, obs=obs)
    seen, _ = env.reset(seed=0)
    batch = seen[None] if obs == "flat" else {name: values[None] for name, values in seen.items()}
    action, _ = agent.predict(batch, deterministic=True)
    assert action.shape == (1, 5)


def test_a_module_that_registers_a_task_may_stand_before_its_id():
    sb3 = pytest.importorskip("ruffini.sb3")
    envs = sb3.make_vec_env("ruffini:ruffini/GraspLift-v0", 2, tactile="none")
    assert envs.reset()["proprio"].shape == (2, 14)
    with pytest.raises(ModuleNotFoundError, match="nothing_such"):
        sb3.make_vec_env("nothing_such:ruffini/GraspLift-v0", 2)


def test_a_copy_goes_on_as_the_original():
    envs = CustomVectorEnv(Low, 2, autoreset_mode="SameStep")
    envs.reset(seed=1)
    down = np.tile(np.array([0, 0, -0.6, 0, 0], np.float32), (2, 1))
    envs.step(down)
    twin = pickle.loads(pickle.dumps(envs))
    for _ in range(30):
        one, two = envs.step(down), twin.step(down)
        np.testing.assert_array_equal(one[0]["proprio"], two[0]["proprio"])
        np.testing.assert_array_equal(one[1], two[1])


def test_a_single_ending_may_be_given_by_its_name():
    env = CustomEnv(case(endings="down", ending=lambda self, state: {"down": np.ones(1, bool)}))
    env.reset(seed=0)
    *_, info = env.step(np.zeros(5, np.float32))
    assert info["ending"] == "down"


def watching(observe, **boxes):
    """A task whose own observations are wrong in some way."""
    boxes = boxes or {"far": Box(0, 1, (2,), np.float32)}
    return case(observation=boxes, observe=lambda self, state: observe)


class Shaken(Task):
    """A task on a base whose episodes begin in the hand."""

    base = "HoldStill"
    settings = RIGID
    terms = {"still": 1.0}

    def reward(self, state):
        return {"still": state.base_terms["still"]}


def case(**members):
    """A task that is wrong in some way."""
    return type("Wrong", (Low,), members)


@pytest.mark.parametrize(
    ("task", "message"),
    [
        (case(terms={}), r"Wrong.terms: found \{\}, expected names with finite weights"),
        (case(terms={"low": np.nan}), "Wrong.terms: found .*nan"),
        (case(terms={"low": "x"}), "Wrong.terms: found {'low': 'x'}, expected names with finite"),
        (case(ending=Task.ending), r"Wrong.endings: found \['down'\] and no method `ending`"),
        (case(base="Juggle"), "Wrong.base: found 'Juggle', expected one of GraspLift"),
        (case(reads=["marker"]), "Wrong.reads: found 'marker', did you mean 'markers'"),
        (case(reward=lambda self, state: {"high": 1}), r"reward: found \['high'\], expected .*low"),
        (
            case(reward=lambda self, state: {"low": np.float32(1.0)}),
            r"reward low: found float32 of shape \(\), expected .* \(2,\), .* or one float for all",
        ),
        (case(reward=lambda self, state: {"low": np.full(2, np.nan)}), "low: found nan in row 0"),
        (
            case(ending=lambda self, state: {"up": [True] * 2}),
            "ending: found 'up', expected",
        ),
        (case(ending=lambda self, state: {"down": [1, 0]}), r"down: found int64 of shape \(2,\)"),
        (case(is_success=lambda self, state: True), r"is_success: found bool of shape \(\)"),
        (
            case(draw=lambda self, random: {"mass": np.full(2, 9.0)}),
            "mass: found 9, expected",
        ),
        (case(draw=lambda self, random: [0.1, 0.2]), "draw: found list, expected numbers by name"),
        (case(ending=lambda self, state: [True, False]), "ending: found list, expected booleans"),
        (
            case(draw=lambda self, random: {"mass": np.full(3, 0.1)}),
            r"draw mass: found float64 of shape \(3,\), expected numbers of shape \(2,\)",
        ),
        (case(draw=lambda self, random: {"mass": np.full(2, np.nan)}), "draw mass: found .*nan"),
        (
            case(draw=lambda self, random: {"smell": np.ones(2)}),
            "draw: found 'smell', expected what GraspLift draws",
        ),
        (
            case(draw=lambda self, random: {"object": np.full(2, 0.5)}),
            "draw object: found 0.5, expected a whole number within 0 to",
        ),
        (case(reward=Task.reward), "Wrong.reward: found none, expected a method that returns"),
        (case(reads=None), "Wrong.reads: found None, expected a list of names"),
        (case(endings=[1]), r"Wrong.endings: found \[1\], expected a list of names"),
        (case(endings=["down", "down"]), "Wrong.endings: found 'down', which is there twice"),
        (
            case(endings=["engine_error", "down"]),
            "Wrong.endings: found 'engine_error', which is a built-in task's, expected others",
        ),
        (watching({"near": 0}), r"observe: found \['near'\], expected the channels \['far'\]"),
        (watching([1]), r"observe: found list, expected the channels \['far'\]"),
        (
            watching({"far": np.ones(2)}),
            r"observe far: found float64 of shape \(2,\), expected numbers of shape \(2, 2\)",
        ),
        (watching({"far": [[0, 1], [1, 1e39]]}), r"observe far: found 1e\+39 in row 1, expected"),
        (
            watching({"far": [[0, 2], [1, 1]]}),
            "far: found 2 in row 0, expected .* from 0 to 1, its",
        ),
        (
            watching({}, far=Box(0, 1, (2, 2))),
            r"Wrong.observation 'far': found Box.*, expected Box",
        ),
        (watching({}, markers=Box(0, 1)), "'markers': found a built-in channel's name"),
        (case(observation=["far"]), r"Wrong.observation: found \['far'\], expected boxes by name"),
        (
            case(observation={"far": Box(0, 1, (2,))}),
            r"Wrong.observation: found \['far'\] and no method `observe`",
        ),
        (
            case(observe=lambda self, state: {}),
            "Wrong.observe: found no `observation`, expected boxes",
        ),
        (
            type("Wrong", (Task,), vars(Shaken) | {"draw": lambda self, random: {"yaw": 1.0}}),
            "draw: found 'yaw', expected what HoldStill draws: object, mass",
        ),
        (case(endings=[f"{n}" for n in range(255)]), "Wrong.endings: found 255, expected at most"),
    ],
)
def test_wrong_rules_say_what_was_found_and_expected(task, message):
    def step() -> None:
        envs = CustomVectorEnv(task, 2)
        envs.reset(seed=0)
        envs.step(np.zeros((2, 5), np.float32))

    with pytest.raises(ValueError, match=message):
        step()


def test_a_plain_number_counts_for_all_rows():
    task = case(reward=lambda self, state: {"low": -1}, draw=lambda self, random: {"mass": 0.13})
    envs = CustomVectorEnv(task, 2)
    envs.reset(seed=0)
    assert [envs.look(row)["mass"] for row in range(2)] == [0.13, 0.13]
    np.testing.assert_array_equal(envs.step(np.zeros((2, 5), np.float32))[1], [-2.0, -2.0])


def test_a_rule_reads_what_soft_pads_feel_by_name():
    def reward(self, state):
        assert np.shares_memory(state.part("wrench", "force, -x pad"), state.channels["wrench"])
        seen.append((state.part("wrench", "force, +x pad"), state.channels["wrench"]))
        return {"low": np.zeros(2)}

    # The minus sign of a name may be typed as a hyphen.
    seen: list = []
    felt = {"tactile": "compliance", "observation": ["proprio", "wrench"]}
    envs = CustomVectorEnv(case(reward=reward), 2, **felt)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 5), np.float32))
    force, wrench = seen[-1]
    assert force.shape == (2, 3)
    assert np.shares_memory(force, wrench[:, 6:9]) and not np.shares_memory(force, wrench[:, :6])


@pytest.mark.parametrize(
    ("channel", "component", "message"),
    [
        ("propri", TOOL, "channel: found 'propri', did you mean 'proprio'"),
        ("proprio", "yaw rates", "component: found 'yaw rates', did you mean"),
        ("properties", "mass", "found 'properties', expected one of proprio: .*`reads`"),
        (
            "stress",
            "von Mises stress, -x pad",
            "found 'stress', expected one of proprio: .*`reads`",
        ),
    ],
)
def test_an_unknown_part_of_the_state_is_named_with_the_nearest(channel, component, message):
    envs = CustomVectorEnv(case(reward=lambda self, state: state.part(channel, component)), 2)
    envs.reset(seed=0)
    with pytest.raises(KeyError, match=message):
        envs.step(np.zeros((2, 5), np.float32))


def test_a_rule_that_is_misspelt_is_warned_of():
    with pytest.warns(
        UserWarning, match="Wrong: 'is_sucess' is no rule.*did you mean 'is_success'"
    ):
        CustomEnv(case(is_sucess=lambda self, state: state.base_success))


def test_what_is_no_task_is_refused():
    for make in (CustomEnv, lambda task: register("test/No-v0", task)):
        with pytest.raises(ValueError, match="task: found 3, expected a subclass"):
            make(3)
        with pytest.raises(ValueError, match=r"Wrong\.base: found 'Juggle'"):
            make(case(base="Juggle"))
    with pytest.raises(ValueError, match=r"found \{'low': 1\}, expected none: Low has its"):
        CustomEnv(Low, reward_weights={"low": 1})
    with pytest.raises(TypeError, match="unexpected keyword argument 'colour'"):
        CustomEnv(Low, colour=1)
    env = CustomEnv(Lift)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="state: Lift keeps numbers of its own"):
        env.state()
    with pytest.raises(ValueError, match="state: Lift keeps numbers of its own"):
        env.set_state(b"")


class Level(ruffini.custom.Task):
    base, terms = "GraspLift", {"lift": 1.0}
    level = 0.0

    def reward(self, state):
        return {"lift": state.base_terms["lift"]}

    def draw(self, random):
        return {"mass": 0.05 + 0.1 * self.level}


def test_attributes_of_a_task_are_reached_and_set_by_every_way():
    env = CustomEnv(Level, tactile="none")
    wrapped = gym.wrappers.TimeLimit(env, 9)
    envs = CustomVectorEnv(Level, num_envs=2, tactile="none")
    ways = [
        (env, lambda value: setattr(env, "level", value)),
        (env, lambda value: setattr(env.task, "level", value)),
        (env, lambda value: wrapped.set_wrapper_attr("level", value)),
        (envs, lambda value: envs.set_attr("level", value)),
        (envs, lambda value: setattr(envs.task, "level", value)),
    ]
    for each, change in ways:
        for value in (0.5, 1.0):
            change(value)
            each.reset(seed=0)
            assert each.look()["mass"] == pytest.approx(0.05 + 0.1 * value)
            assert each.level == each.task.level == value
    assert envs.get_attr("level") == (1.0, 1.0)
    assert pickle.loads(pickle.dumps(env)).level == 1.0
    assert not hasattr(env, "reward") and not hasattr(env, "levle") and Level.level == 0.0


def test_attributes_that_would_change_nothing_are_refused():
    env, envs = CustomEnv(Level, tactile="none"), CustomVectorEnv(Level, 2, tactile="none")
    wrapped = gym.wrappers.TimeLimit(env, 9)
    for change in (wrapped.set_wrapper_attr, envs.set_attr):
        with pytest.raises(ValueError, match=r"levle: found no such attribute, did you mean 'lev"):
            change("levle", 1.0)
    built_in = gym.make("ruffini/GraspLift-v0", tactile="none")
    for each in (wrapped, built_in):
        with pytest.raises(ValueError, match="mass: found a change of a setting, expected a new"):
            each.set_wrapper_attr("mass", 0.1)
        with pytest.raises(ValueError, match="mass: found a change of a setting, expected a new"):
            each.unwrapped.mass = 0.1


def test_an_object_that_is_drawn_by_name_is_refused_with_what_is_meant():
    class Cup(Level):
        def draw(self, random):
            return {"object": "cup"}

    with pytest.raises(ValueError, match=r"draw object: found 'cup', expected places in the set"):
        CustomEnv(Cup, tactile="none").reset(seed=0)
