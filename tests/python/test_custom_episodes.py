"""Episodes of tasks of one's own: what is drawn, seeds and endings."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import MODES
from gymnasium.spaces import Box

from ruffini.custom import CustomEnv, CustomVectorEnv, Task

RIGID = {"tactile": "none", "objects": "sphere"}
STILL = np.zeros((2, 5), np.float32)


class Paid(Task):
    """Pays one a step; ends where the action says so."""

    terms = {"one": 1.0}
    endings = ["pushed", "turned"]

    def reward(self, state):
        return {"one": 1.0}

    def ending(self, state):
        return {"pushed": state.action[:, 0] == 1.0, "turned": state.action[:, 3] == 1.0}


class Drawn(Paid):
    def draw(self, random):
        return {"mass": random.uniform(0.05, 0.15)}


def masses(envs, seed, episodes=4):
    """Masses (N, episodes) of a batch whose episodes have two steps."""
    envs.reset(seed=seed)
    seen = [[envs.look(row)["mass"]] for row in range(2)]
    while min(map(len, seen)) < episodes:
        *_, terminated, truncated, _ = envs.step(STILL)
        over = terminated | truncated
        if envs.autoreset_mode.value == "NextStep" and over.any():
            envs.step(STILL)
        if envs.autoreset_mode.value == "Disabled" and over.any():
            envs.reset(options={"reset_mask": over})
        for row in np.flatnonzero(over):
            seen[row].append(envs.look(row)["mass"])
    return np.array([row[:episodes] for row in seen])


@pytest.mark.parametrize("mode", MODES)
def test_every_episode_is_drawn_anew_and_a_seed_draws_the_same_again(mode):
    envs = CustomVectorEnv(Drawn, 2, autoreset_mode=mode, max_episode_steps=2, **RIGID)
    first = masses(envs, 7)
    assert len(np.unique(first)) == first.size, first
    np.testing.assert_array_equal(masses(envs, 7), first)
    assert not np.isin(masses(envs, 90), first).any()


class Slippery(Paid):
    """Draws once a start with which the hand holds nothing."""

    base = "HoldStill"
    times = 0

    def draw(self, random):
        self.times += 1
        is_first = self.times == 1
        return {"mass": 0.5 if is_first else 0.05, "friction": 0.01 if is_first else 1.0}


def test_a_start_that_cannot_be_is_not_drawn_for_ever():
    ranges = {"mass": (0.05, 0.5), "friction": (0.01, 1.0), "tactile": "none"}
    envs = CustomVectorEnv(Slippery, 1, **ranges)
    with pytest.raises(ValueError, match="does not hold in any of 20 draws"):
        envs.reset(seed=0)
    envs.reset()


@pytest.mark.parametrize("mode", MODES)
def test_an_ending_in_the_last_step_is_a_truncation_too_and_begins_one_episode(mode):
    ours, twin = (
        CustomVectorEnv(Paid, 2, autoreset_mode=mode, max_episode_steps=2, **RIGID)
        for _ in range(2)
    )
    push = STILL.copy()
    push[0, 0] = 1.0
    for envs in (ours, twin):
        envs.reset(seed=3)
        envs.step(STILL)
    *_, terminated, truncated, info = ours.step(push)
    *_, cut, _ = twin.step(STILL)
    assert (terminated.tolist(), truncated.tolist()) == ([True, False], [True, True])
    assert cut.all()
    told = info["final_info"] if mode == "SameStep" else info
    assert told["ending"].tolist() == ["pushed", None]
    for envs in (ours, twin):
        if mode == "Disabled":
            envs.reset(options={"reset_mask": np.ones(2, bool)})
        envs.step(STILL)
    assert [ours.look(row) for row in range(2)] == [twin.look(row) for row in range(2)]


def test_of_two_endings_the_first_is_told_and_of_the_bases_and_ones_own_the_bases():
    env = CustomEnv(Paid, **RIGID)
    env.reset(seed=0)
    both = np.array([1, 0, 0, 1, 0], np.float32)
    assert env.step(both)[4]["ending"] == "pushed"

    class Held(Paid):
        base = "HoldStill"

    let_go, steps = np.array([0, 0, 0, 0, -1], np.float32), 0
    env = CustomEnv(Held, **RIGID)
    env.reset(seed=0)
    while not env.step(let_go)[2]:
        steps += 1
    env.reset(seed=0)
    for _ in range(steps):
        env.step(let_go)
    let_go[0] = 1.0
    assert env.step(let_go)[4]["ending"] == "dropped"


class Telling(Paid):
    """Observes what the base says, and a number that rounding leads beyond its box."""

    base = "HoldStill"
    observation = {"told": Box(0, 9, (2,), np.float32), "one": Box(0, 1, (1,), np.float32)}

    def observe(self, state):
        told = np.stack([state.base_success, state.base_terms["still"]], axis=1)
        return {"told": told, "one": np.full(len(told), 1 + 5e-6)}


def test_what_the_base_told_is_forgotten_at_the_start_and_rounding_stays_in_the_box():
    settings = RIGID | {"mass": 0.15, "friction": 0.5, "load": 0.5, "shaking": 0.1}
    env = CustomEnv(Telling, start_grip=4.0, **settings)
    env.reset(seed=0)
    for _ in range(30):
        seen, *_ = env.step(STILL[0])
    assert seen["told"][0] == 1 and seen["told"][1] > 0
    assert seen["one"] == 1 and env.observation_space["one"].contains(seen["one"])
    assert env.reset()[0]["told"].tolist() == [0, 0]
    for ask in (env.state, lambda: env.set_state(b"")):
        with pytest.raises(ValueError, match="state: Telling keeps numbers of its own"):
            ask()
