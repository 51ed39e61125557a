"""Stable-Baselines3's PPO end to end, on one thread, and the environment's share of its time."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import cycle
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from ruffini.agents.params import params
from ruffini.agents.training import new_model
from timing import timed, touching

EPISODE = 100
"""Steps of a recording: an episode, unless it ends early."""
ROLLOUTS = 2
"""Rollouts that are measured, each with its update, after one to warm up."""


class Recording(VecEnvWrapper):
    """Plays an episode of random actions over and over: an environment that is free."""

    def __init__(self, venv: VecEnv):
        super().__init__(venv)
        random, shape = np.random.default_rng(0), (venv.num_envs, *venv.action_space.shape)
        self._first = venv.reset()
        self._steps = cycle(
            [venv.step(random.uniform(-1, 1, shape).astype(np.float32)) for _ in range(EPISODE)]
        )

    def reset(self):
        """The first observation."""
        return self._first

    def step_async(self, actions: np.ndarray) -> None:
        """Actions change nothing."""

    def step_wait(self):
        """The next recorded step."""
        observation, reward, done, info = next(self._steps)
        # PPO adds to the rewards in place.
        return observation, reward.copy(), done, info


class TimedEnv(VecEnvWrapper):
    """Adds up the time of an environment's steps, and notes how many rows touch."""

    def __init__(self, venv: VecEnv):
        super().__init__(venv)
        self.forget()

    def forget(self) -> None:
        """Begins anew."""
        self.spent, self.touching = 0.0, []

    def reset(self):
        """As the environment's."""
        return self.venv.reset()

    def step_wait(self):
        """A step, timed."""
        result, _, wall = timed(self.venv.step_wait)
        self.spent += wall
        self.touching.append(share_touching(result[0]))
        return result


class Collecting(BaseCallback):
    """Adds up the time of collecting, which the environment's steps are part of."""

    def _on_training_start(self) -> None:
        self.spent = 0.0

    def _on_rollout_start(self) -> None:
        self._begun = time.perf_counter()

    def _on_rollout_end(self) -> None:
        self.spent += time.perf_counter() - self._begun

    def _on_step(self) -> bool:
        return True


def share_touching(observation: Any) -> float:
    """Share of the rows in which a pad touches; flat observations begin with ``proprio``."""
    named = observation if isinstance(observation, dict) else {"proprio": observation}
    return float(touching(named).any(axis=1).mean())


def end_to_end(env_id: str, settings: dict[str, Any], free: bool, steps: int | None) -> dict:
    """Steps a second of PPO with the parameters of its task, or `steps` a rollout, and its time."""
    torch.set_num_threads(1)
    chosen = params(env_id).with_settings(settings | {"num_threads": 1})
    # The cost of touch is measured with tactile pads from the first step.
    chosen = replace(chosen, steps_without_touch=0, training={})
    if steps:
        chosen = replace(chosen, algorithm=chosen.algorithm | {"n_steps": steps})
    model = new_model(env_id, chosen, 0)
    monitored = model.get_vec_normalize_env().venv
    monitored.venv = env = TimedEnv(Recording(monitored.venv) if free else monitored.venv)
    rollout, clock = chosen.n_envs * chosen.algorithm["n_steps"], Collecting()
    model.learn(rollout)
    env.forget()
    begun = time.perf_counter()
    model.learn(ROLLOUTS * rollout, callback=clock, reset_num_timesteps=False)
    whole = time.perf_counter() - begun
    parts = {
        "environment": env.spent,
        "collecting": clock.spent - env.spent,
        "updating": whole - clock.spent,
    }
    done = ROLLOUTS * rollout
    return {
        "envs": chosen.n_envs,
        "steps": done,
        "rate": done / whole,
        "us": {name: 1e6 * spent / done for name, spent in parts.items()},
        "touch": float(np.mean(env.touching)),
    }
