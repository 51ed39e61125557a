"""Snapshots of environments of one's own tasks, and success where the base has ended an episode."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from ruffini.custom import CustomEnv, CustomVectorEnv, State, Task

STILL = np.zeros(5, np.float32)
RIGID: dict[str, Any] = {"tactile": "none", "objects": "sphere"}


class Paid(Task):
    """Pays one in every step and always succeeds; the first action ends the episode if it is 1."""

    terms = {"one": 1.0}
    endings = "pushed"

    def reward(self, state: State) -> dict[str, float]:
        return {"one": 1.0}

    def ending(self, state: State) -> dict[str, Any]:
        return {"pushed": state.action[:, 0] == 1.0}

    def is_success(self, state: State) -> Any:
        return np.ones(len(state.action), np.bool_)


class PaidStill(Paid):
    base = "HoldStill"


def test_an_environment_restored_elsewhere_goes_on_as_the_one_that_was_saved() -> None:
    saved, other = CustomEnv(Paid, **RIGID), CustomEnv(Paid, **RIGID)
    saved.reset(seed=0)
    saved.step(STILL)
    other.set_state(saved.state())
    push = np.array([1, 0, 0, 0, 0], np.float32)
    for env in (saved, other):
        _, reward, terminated, _, info = env.step(push)
        assert (reward, terminated) == (1.0, True)
        assert info["is_success"] and info["ending"] == "pushed"


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_restored_rows_are_paid_as_the_ones_that_were_saved(mode: AutoresetMode) -> None:
    def make() -> CustomVectorEnv:
        return CustomVectorEnv(Paid, 2, num_threads=1, autoreset_mode=mode, **RIGID)

    saved, other = make(), make()
    saved.reset(seed=0)
    actions = np.zeros((2, 5), np.float32)
    saved.step(actions)
    running = saved.state()
    actions[0, 0] = 1.0
    saved.step(actions)
    ended = saved.state()
    actions[:] = 0.0
    states = [running] if mode == AutoresetMode.DISABLED else [running, ended, running]
    for state in states:
        rewards = []
        for env in (saved, other):
            env.set_state(state)
            rewards.append(env.step(actions)[1].tolist())
        restarts = state is ended and mode == AutoresetMode.NEXT_STEP
        assert rewards == [[0.0 if restarts else 1.0, 1.0]] * 2, (mode, rewards)


def test_what_the_base_ends_early_has_not_succeeded() -> None:
    mode = AutoresetMode.SAME_STEP
    env = CustomVectorEnv(PaidStill, 4, num_threads=1, autoreset_mode=mode, **RIGID)
    env.reset(seed=0)
    open_hand = np.zeros((4, 5), np.float32)
    open_hand[:, 4] = -1.0
    ends = 0
    for _ in range(60):
        *_, terminated, truncated, info = env.step(open_hand)
        over = terminated | truncated
        if over.any():
            # Of rows that have ended, `info` itself has no say.
            told = info["final_info"]
            assert not told["is_success"][terminated].any() and told["ending"][terminated].all()
            ends += int(terminated.sum())
        if not over.all():
            assert info["is_success"][~over].all()
    assert ends > 4
