"""Trains an agent with Stable-Baselines3.

Use::

    python policies/train.py --algo ppo --seed 0
    python policies/train.py --algo ppo --seed 0 --resume

``--settings`` may differ when a run goes on, in ranges but not in channels: first an easy task,
then the hard one.

A run is a folder: ``model.zip`` and ``normaliser.pkl`` (replaced together at every checkpoint),
``run.json`` (what was run) and ``curve.json`` (steps, seconds, success, return).
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecMonitor, VecNormalize
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn
from tqdm import tqdm

from evaluate import about_this_run
from params import Params, params
from ruffini._schema import TACTILE_CHANNELS
from ruffini.sb3 import TouchExtractor, fields, make_vec_env

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {"ppo": PPO, "sac": SAC}
RUNS = Path(__file__).parent / "runs"
CHECKPOINT = "checkpoint"


def run_folder(env_id: str, algorithm: str, seed: int) -> Path:
    """Where a run keeps its files unless told otherwise."""
    return RUNS / f"{env_id.split('/')[-1]}-{algorithm}-{seed}"


def make_environment(
    env_id: str,
    chosen: Params,
    seed: int,
    n_envs: int,
    threads: int | None = None,
    without_touch: int = 0,
) -> VecNormalize:
    """The environments that an agent trains in, the first steps with rigid pads if so asked.

    Fields of touch are not normalised.
    """
    obs = "dict" if chosen.policy == "MultiInputPolicy" else "flat"
    settings = {"obs": obs, "num_threads": threads} | chosen.environment | chosen.training
    envs: VecEnv = make_vec_env(env_id, n_envs=n_envs, seed=seed, **settings)
    # An agent that is shown touch alone learns nothing without.
    rest = untouched(envs.observation_space)
    if without_touch > 0 and settings.get("tactile") != "none" and rest:
        rigid = settings | {"tactile": "none", "observation": rest}
        first = make_vec_env(env_id, n_envs=n_envs, seed=seed, **rigid)
        envs = FirstWithoutTouch(first, envs, without_touch)
    monitored = VecMonitor(Timed(envs), info_keywords=("is_success",))
    keys = None
    if isinstance(envs.observation_space, gym.spaces.Dict):
        felt = fields(envs.observation_space)
        keys = [name for name in envs.observation_space if name not in felt]
    gamma = chosen.algorithm["gamma"]
    return VecNormalize(monitored, norm_reward=False, gamma=gamma, norm_obs_keys=keys)


def untouched(space: gym.Space[Any]) -> list[str]:
    """Names of the channels that rigid pads have, too."""
    channels = list(space) if isinstance(space, gym.spaces.Dict) else []
    return [name for name in channels if name not in TACTILE_CHANNELS]


class FirstWithoutTouch(VecEnvWrapper):
    """Steps environments with rigid pads for a while, then those that feel.

    The channels of touch are 0 until then. When the pads change, all episodes are truncated.

    Args:
        rigid: Environments without the channels of touch.
        feeling: The same with them.
        steps: Steps with rigid pads, of all environments together.
    """

    def __init__(self, rigid: VecEnv, feeling: VecEnv, steps: int) -> None:
        super().__init__(rigid, observation_space=feeling.observation_space)
        assert isinstance(feeling.observation_space, gym.spaces.Dict), "channels of touch"
        self.feeling = feeling
        self.left = steps
        self.space = feeling.observation_space

    def _with_touch(self, observation: VecEnvObs) -> dict[str, Any]:
        assert isinstance(observation, dict), "of a space of channels"
        rows = next(iter(observation.values())).shape[:-1]
        sizes = {name: (*rows, *(box.shape or ())) for name, box in self.space.items()}
        return {name: np.zeros(size, np.float32) for name, size in sizes.items()} | observation

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seeds both."""
        self.feeling.seed(seed)
        return self.venv.seed(seed)

    def reset(self) -> VecEnvObs:
        """Starts an episode in every row."""
        return self._with_touch(self.venv.reset())

    def step_wait(self) -> VecEnvStepReturn:
        """Takes one step; after the last with rigid pads every row starts anew."""
        observation, reward, dones, infos = self.venv.step_wait()
        if self.venv is self.feeling:
            return observation, reward, dones, infos
        observation = self._with_touch(observation)
        for row in np.flatnonzero(dones):
            last = infos[row]["terminal_observation"]
            infos[row]["terminal_observation"] = self._with_touch(last)
        self.left -= self.num_envs
        if self.left > 0:
            return observation, reward, dones, infos
        for row in np.flatnonzero(~dones):
            last = {name: values[row] for name, values in observation.items()}
            infos[row] |= {"terminal_observation": last, "TimeLimit.truncated": True}
        self.venv.close()
        self.venv = self.feeling
        return self.venv.reset(), reward, np.ones_like(dones), infos


class Timed(VecEnvWrapper):
    """Measures the time that environments take to step (s)."""

    spent = 0.0

    def reset(self) -> VecEnvObs:
        """Passes on."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """Takes one step and its time."""
        started = time.monotonic()
        result = self.venv.step_wait()
        self.spent += time.monotonic() - started
        return result


class Progress(BaseCallback):
    """Progress bar, learning curve, checkpoints, and where the time goes.

    The last, in ``times.json``, are seconds of this process: ``environment`` steps,
    ``collecting`` beside them (the policy acts, observations are scaled, rollouts are stored),
    ``updating`` the networks.
    """

    def __init__(
        self,
        folder: Path,
        total: int,
        curve: list[dict[str, float]],
        every: int,
        environment: Timed,
    ) -> None:
        super().__init__()
        self.environment = environment
        self.collected = 0.0
        self.begun = 0.0
        self.folder, self.total, self.curve, self.every = folder, total, curve, every
        self.before = curve[-1]["seconds"] if curve else 0.0
        self.started = time.monotonic()
        self.saved = 0

    def _on_training_start(self) -> None:
        self.saved = self.num_timesteps
        self.bar = tqdm(total=self.total, initial=self.num_timesteps, unit=" steps", smoothing=0.1)

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        self.begun = time.monotonic()

    def _on_rollout_end(self) -> None:
        self.collected += time.monotonic() - self.begun
        self.bar.update(min(self.num_timesteps, self.total) - self.bar.n)
        episodes = list(self.model.ep_info_buffer or ())
        # SAC ends a rollout at every step; a point a second is enough.
        seconds = self.before + time.monotonic() - self.started
        if episodes and (not self.curve or seconds - self.curve[-1]["seconds"] > 1.0):
            success = float(np.mean([episode["is_success"] for episode in episodes]))
            mean_return = float(np.mean([episode["r"] for episode in episodes]))
            point = {"steps": self.num_timesteps, "seconds": round(seconds, 2)}
            self.curve.append(point | {"success": success, "return": round(mean_return, 3)})
            self.bar.set_postfix_str(f"success {success:.0%}, return {mean_return:.1f}")
        if self.num_timesteps - self.saved >= self.every:
            self.save()

    def _on_training_end(self) -> None:
        self.save()
        self.bar.close()
        whole, inside = time.monotonic() - self.started, self.environment.spent
        times = {"environment": inside, "collecting": self.collected - inside}
        times["updating"] = whole - self.collected
        (self.folder / "times.json").write_text(json.dumps(times))

    def save(self) -> None:
        """Writes a whole new checkpoint beside the old one, then takes its place."""
        fresh = self.folder / f"{CHECKPOINT}.new"
        shutil.rmtree(fresh, ignore_errors=True)
        fresh.mkdir(parents=True)
        self.model.save(fresh / "model.zip")
        if isinstance(self.model, SAC):
            self.model.save_replay_buffer(fresh / "buffer.pkl")
        normaliser = self.model.get_vec_normalize_env()
        assert normaliser is not None, "make_environment normalises"
        normaliser.save(str(fresh / "normaliser.pkl"))
        (fresh / "curve.json").write_text(json.dumps(self.curve))
        current, old = self.folder / CHECKPOINT, self.folder / f"{CHECKPOINT}.old"
        shutil.rmtree(old, ignore_errors=True)
        if current.exists():
            current.rename(old)
        fresh.rename(current)
        shutil.rmtree(old, ignore_errors=True)
        self.saved = self.num_timesteps


def timed(model: BaseAlgorithm) -> Timed:
    """The wrapper of a model's environments that measures their time."""
    envs = model.get_env()
    while not isinstance(envs, Timed):
        assert isinstance(envs, VecEnvWrapper), "make_environment measures"
        envs = envs.venv
    return envs


def start(
    env_id: str,
    algorithm: str,
    chosen: Params,
    seed: int,
    n_envs: int,
    folder: Path,
    resume: bool,
    threads: int | None = None,
) -> tuple[BaseAlgorithm, list[dict[str, float]]]:
    """A new model, or the last checkpoint's with its learning curve."""
    saved, without_touch = folder / CHECKPOINT, chosen.steps_without_touch
    if resume:
        without_touch -= ALGORITHMS[algorithm].load(saved / "model.zip").num_timesteps
    envs = make_environment(env_id, chosen, seed, n_envs, threads, without_touch)
    if not resume:
        arguments: dict[str, Any] = {"seed": seed, "device": "cpu", **chosen.algorithm}
        if chosen.final_learning_rate is not None:
            first, last = chosen.algorithm["learning_rate"], chosen.final_learning_rate
            arguments["learning_rate"] = LinearSchedule(first, last, 1.0)
        if chosen.policy == "MultiInputPolicy":
            touch = {"features_extractor_class": TouchExtractor}
            arguments["policy_kwargs"] = arguments["policy_kwargs"] | touch
        return ALGORITHMS[algorithm](chosen.policy, envs, **arguments), []
    normalised = VecNormalize.load(str(saved / "normaliser.pkl"), envs.venv)
    # Bounds follow the settings: an agent may go on under harder ones, with the same channels.
    normalised.observation_space = envs.observation_space
    spaces = {"observation_space": envs.observation_space, "action_space": envs.action_space}
    model = ALGORITHMS[algorithm].load(
        saved / "model.zip", env=normalised, device="cpu", custom_objects=spaces
    )
    # The environments start anew: other episodes than before, from a stream of their own.
    normalised.seed(seed + 1_000_003 + model.num_timesteps)
    if isinstance(model, SAC):
        model.load_replay_buffer(saved / "buffer.pkl")
    return model, json.loads((saved / "curve.json").read_text())


def train(
    env_id: str,
    algorithm: str,
    seed: int,
    folder: Path,
    *,
    steps: int | None = None,
    n_envs: int | None = None,
    resume: bool = False,
    settings: dict[str, Any] | None = None,
    threads: int | None = None,
) -> BaseAlgorithm:
    """Trains to `steps` environment steps in all; an interrupt saves and stops early.

    The environments step on `threads` threads, one a core by default, and the network learns on
    one: its layers are too small to share, and sums by several threads would differ in their last
    bits, so that a seed would not give the same agent on another number of cores.
    """
    chosen = params(env_id, algorithm).with_settings(settings or {})
    steps, n_envs = steps or chosen.steps, n_envs or chosen.n_envs
    torch.set_num_threads(1)
    model, curve = start(env_id, algorithm, chosen, seed, n_envs, folder, resume, threads)
    folder.mkdir(parents=True, exist_ok=True)
    about = {"env": env_id, "algorithm": algorithm, "seed": seed, "n_envs": n_envs, "steps": steps}
    about |= {"policy": chosen.policy, "environment": chosen.environment}
    about |= {"training": chosen.training, "steps_without_touch": chosen.steps_without_touch}
    about |= {"final_learning_rate": chosen.final_learning_rate}
    about |= {"threads": threads or os.cpu_count()}
    before = json.loads((folder / "run.json").read_text()).get("trained_by", []) if resume else []
    about |= {"trained_by": list(dict.fromkeys([*before, about_this_run()["commit"]]))}
    (folder / "run.json").write_text(json.dumps(about | chosen.algorithm, indent=1))
    progress = Progress(folder, steps, curve, max(steps // 10, 1), timed(model))
    try:
        left = steps - model.num_timesteps
        model.learn(left, callback=progress, reset_num_timesteps=False)
    except KeyboardInterrupt:
        progress.save()
        print(f"stopped at {model.num_timesteps} steps; --resume goes on from there")
    return model


def main() -> None:
    """Parses the command line and trains."""
    parser = argparse.ArgumentParser(description="Train an agent.")
    parser.add_argument("--env", default="ruffini/GraspLift-v0", help="environment id")
    parser.add_argument("--algo", choices=sorted(ALGORITHMS), default="ppo")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, help="environment steps in all")
    parser.add_argument("--n-envs", type=int, help="environments stepped together")
    parser.add_argument("--out", type=Path, help="run folder")
    parser.add_argument("--resume", action="store_true", help="go on from the last checkpoint")
    parser.add_argument(
        "--settings", type=json.loads, default={}, help="the environment's, as JSON"
    )
    arguments = parser.parse_args()
    folder = arguments.out or run_folder(arguments.env, arguments.algo, arguments.seed)
    saved = (folder / CHECKPOINT).exists()
    if arguments.resume and not saved:
        parser.error(f"--resume: no checkpoint in {folder}")
    if saved and not arguments.resume:
        parser.error(f"{folder} holds a run: give --resume to go on, or another --out")
    try:
        params(arguments.env, arguments.algo)
    except ValueError as error:
        parser.error(str(error))
    train(
        arguments.env,
        arguments.algo,
        arguments.seed,
        folder,
        steps=arguments.steps,
        n_envs=arguments.n_envs,
        resume=arguments.resume,
        settings=arguments.settings,
    )
    print(f"run in {folder}")


if __name__ == "__main__":
    main()
