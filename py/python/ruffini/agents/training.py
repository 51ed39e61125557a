"""Training of agents by PPO of Stable-Baselines3; needs the extra ``train``.

A run is a folder: ``run.json`` (what is run), ``times.json`` and ``checkpoint``, whose files are
replaced together: ``model.zip``, ``normaliser.pkl``, ``curve.json`` (steps, seconds, success,
return), and ``agent.safetensors``, the agent as it is then. `ruffini.agents.load` takes the folder.
"""

from __future__ import annotations

import json
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.utils import LinearSchedule, set_random_seed
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecMonitor, VecNormalize
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn
from tqdm import tqdm

from ruffini._schema import TACTILE_CHANNELS
from ruffini._settings import plain, read_json
from ruffini._spaces import MOST_STEPS, check_count, replace_file
from ruffini.agents import CHECKPOINT, CHECKPOINT_AGENT, RUN, Agent, checkpoint, first_seed
from ruffini.agents.params import Params, params
from ruffini.agents.sb3 import from_sb3, to_sb3
from ruffini.evaluation import about_this_run, usable_cores
from ruffini.sb3 import AsymmetricPolicy, TouchExtractor, make_vec_env, normalize

__all__ = ["FirstWithoutTouch", "new_model", "resume", "train"]

SAVE_EVERY = 600.0
"""Longest time between two checkpoints (s), beside that of a rollout."""


@contextmanager
def _on_one_thread() -> Iterator[None]:
    """Have PyTorch compute on one thread, and give back those that it had."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@_on_one_thread()
def train(
    env_id: str,
    seed: int,
    folder: Path,
    *,
    steps: int | None = None,
    n_envs: int | None = None,
    settings: dict[str, Any] | None = None,
    threads: int | None = None,
    agent: Agent | None = None,
) -> PPO:
    """Train an agent with the hyper-parameters of its task, and keep the run in a folder.

    A checkpoint is saved at the start, after each tenth of the steps, every `SAVE_EVERY` seconds,
    and by an interrupt. In the main thread SIGTERM is an interrupt, too, and SIGUSR1 has one saved
    at the end of the rollout. The environments step on many threads and the network learns
    on one: its layers are too small to share, and sums by several threads would differ in their
    last bits, so that a seed would not give the same agent on another number of cores. PyTorch has
    its number of threads back afterwards.

    Args:
        env_id: Id of the environment.
        seed: Seed of the run.
        folder: Folder of the run.
        steps: Steps of all environments together, made whole rollouts; those of the
            hyper-parameters if not given. The share of them with rigid pads stays the same.
        n_envs: Number of environments, likewise.
        settings: Keyword arguments of the environment.
        threads: Threads on which the environments step; one a core if not given.
        agent: Agent that is trained further, with its network and its normalisation; `settings`
            are changes of its own.

    Raises:
        ValueError: If the task is unknown, a setting is invalid, or the channels of the
            environment are not those of the agent.
    """
    chosen = _sized(params(env_id), steps, n_envs)
    if agent is not None:
        form = "flat" if agent.card["policy"] == "MlpPolicy" else "dict"
        chosen = replace(chosen, steps_without_touch=0, privileged=[])
        settings = agent.settings | (settings or {}) | {"obs": form}
    chosen = chosen.with_settings(settings or {})
    model = new_model(env_id, chosen, seed, threads, agent)
    about = {
        "env": env_id,
        "seed": seed,
        "trained_by": [] if agent is None else [agent.card["commit"]],
        "steps_before": 0 if agent is None else agent.card["steps"],
    }
    return _learn(model, chosen, [], folder, about, threads)


@_on_one_thread()
def resume(
    folder: Path,
    *,
    steps: int | None = None,
    n_envs: int | None = None,
    settings: dict[str, Any] | None = None,
    threads: int | None = None,
) -> PPO:
    """Go on with a run from its last checkpoint, in other episodes than before.

    Args:
        folder: Folder of the run.
        steps: Steps in all; those of the run if not given.
        n_envs: Number of environments, likewise.
        settings: Changes of the environment's settings, with the same channels.
        threads: Threads on which the environments step; one a core if not given.

    Raises:
        ValueError: If the run has its steps, or its policy does not fit the settings.
    """
    about = read_json(folder / RUN)
    with _reading(folder / RUN):
        chosen = Params(**about.pop("params"))
    without_touch = chosen.steps_without_touch
    chosen = replace(_sized(chosen, steps, n_envs), steps_without_touch=without_touch)
    chosen = chosen.with_settings((settings or {}) | {"obs": chosen.obs})
    saved = checkpoint(folder)
    with _reading(saved / "model.zip"):
        done = PPO.load(saved / "model.zip", device="cpu").num_timesteps
    with _reading(saved / "curve.json"):
        curve = json.loads((saved / "curve.json").read_text())
    if _whole(chosen) <= done:
        raise ValueError(f"steps: found {chosen.steps}, expected more than the run's {done}")
    chosen = replace(chosen, steps_without_touch=chosen.steps_without_touch - done)
    envs = make_environment(about["env"], chosen, about["seed"], threads)
    # Bounds follow the settings: an agent may go on under harder ones, with the same channels.
    seen = envs.observation_space
    if isinstance(seen, gym.spaces.Dict):
        names = [name for name in seen if name not in chosen.privileged]
        seen = gym.spaces.Dict({name: seen[name] for name in names})
    Agent.read(saved / CHECKPOINT_AGENT).check(seen)
    with _reading(saved / "normaliser.pkl"):
        normalised = VecNormalize.load(str(saved / "normaliser.pkl"), envs.venv)
    normalised.observation_space = envs.observation_space
    spaces = {"observation_space": envs.observation_space, "action_space": envs.action_space}
    model = PPO.load(saved / "model.zip", env=normalised, device="cpu", custom_objects=spaces)
    # The environments start anew: other episodes than before, from a stream of their own.
    normalised.seed(again := first_seed(about["seed"], done))
    set_random_seed(again % 2**32)
    chosen = replace(chosen, steps_without_touch=chosen.steps_without_touch + done)
    return _learn(model, chosen, curve, folder, about, threads)


def _sized(chosen: Params, steps: int | None, n_envs: int | None) -> Params:
    """Hyper-parameters for other numbers of steps and environments, where given."""
    if steps is not None:
        check_count("steps", steps, MOST_STEPS)
        without_touch = round(chosen.steps_without_touch * steps / chosen.steps)
        chosen = replace(chosen, steps=steps, steps_without_touch=without_touch)
    if n_envs is not None:
        check_count("n_envs", n_envs)
        chosen = replace(chosen, n_envs=n_envs)
    return chosen


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Raise a ``ValueError`` of one line that names the file where reading it fails."""
    try:
        yield
    except Exception as error:  # Those of zip, pickle and torch have no other kind in common.
        found = " ".join(str(error).split())
        raise ValueError(f"{path}: damaged, {type(error).__name__}: {found}") from error


def new_model(
    env_id: str, chosen: Params, seed: int, threads: int | None = None, agent: Agent | None = None
) -> PPO:
    """Create a model with its environments: a fresh one, or that of an agent."""
    envs = make_environment(env_id, chosen, seed, threads)
    arguments: dict[str, Any] = {"seed": seed, "device": "cpu", **chosen.algorithm}
    if chosen.final_learning_rate is not None:
        first, last = chosen.algorithm["learning_rate"], chosen.final_learning_rate
        arguments["learning_rate"] = LinearSchedule(first, last, 1.0)
    if agent is not None:
        model = to_sb3(agent, envs.venv, **arguments)
        model.num_timesteps = 0
        return model
    policy: str | type[AsymmetricPolicy] = "MlpPolicy"
    if chosen.obs != "flat":
        policy = "MultiInputPolicy"
        given: dict[str, Any] = {"features_extractor_class": TouchExtractor}
        if chosen.privileged:
            policy, given["privileged"] = AsymmetricPolicy, chosen.privileged
        arguments["policy_kwargs"] = arguments["policy_kwargs"] | given
    model = PPO(policy, envs, **arguments)
    # PPO seeds them with its own seed.
    envs.seed(first_seed(seed))
    return model


def make_environment(
    env_id: str, chosen: Params, seed: int, threads: int | None = None
) -> VecNormalize:
    """Create the environments of a run, the first steps with rigid pads if chosen."""
    settings = {"num_threads": threads} | chosen.training | chosen.environment
    settings |= {"obs": chosen.obs}
    if chosen.obs == "dict" and chosen.privileged:
        settings["observation"] = [*observed(env_id, settings), *chosen.privileged]
    made: dict[str, Any] = {"n_envs": chosen.n_envs, "seed": seed}
    envs: VecEnv = make_vec_env(env_id, **made, **settings)
    # An agent that is shown touch alone learns nothing without.
    rest = untouched(envs.observation_space)
    if chosen.steps_without_touch > 0 and settings.get("tactile") != "none" and rest:
        first = make_vec_env(env_id, **made, **_rigid(settings, rest))
        envs = FirstWithoutTouch(first, envs, chosen.steps_without_touch)
    monitored = VecMonitor(Timed(envs), info_keywords=("is_success",))
    return normalize(monitored, gamma=chosen.algorithm["gamma"])


def _rigid(settings: dict[str, Any], channels: list[str]) -> dict[str, Any]:
    """Settings with rigid pads, which have no gel, and errors of those `channels` alone."""
    of_gel = ("gel_stiffness", "network", "sensor_errors")
    rigid = {name: value for name, value in settings.items() if name not in of_gel}
    errors = settings.get("sensor_errors") or {}
    if kept := {name: errors[name] for name in channels if name in errors}:
        rigid["sensor_errors"] = kept
    return rigid | {"tactile": "none", "observation": channels}


def observed(env_id: str, settings: dict[str, Any]) -> list[str]:
    """Names of the channels of an environment with these settings."""
    single = {name: value for name, value in settings.items() if name != "num_threads"}
    env = gym.make(env_id, **single)
    env.close()
    assert isinstance(env.observation_space, gym.spaces.Dict), "asked for"
    return list(env.observation_space)


def untouched(space: gym.Space[Any]) -> list[str]:
    """Names of the channels that rigid pads have, too."""
    channels = list(space) if isinstance(space, gym.spaces.Dict) else []
    return [name for name in channels if name not in TACTILE_CHANNELS]


class FirstWithoutTouch(VecEnvWrapper):
    """Steps environments with rigid pads for a while, then those with tactile ones.

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

    def close(self) -> None:
        """Closes both."""
        self.venv.close()
        self.feeling.close()

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


class RunMonitor(BaseCallback):
    """Progress bar, learning curve, checkpoints, and where the time goes.

    The last, in ``times.json``, are seconds of this process: ``environment`` steps,
    ``collecting`` beside them (the policy acts, observations are scaled, rollouts are stored),
    ``updating`` the networks.
    """

    def __init__(
        self,
        folder: Path,
        curve: list[dict[str, float]],
        environment: Timed,
        agent: Callable[[], Agent],
        bar: tqdm,
    ) -> None:
        super().__init__()
        self.environment, self.agent, self.bar = environment, agent, bar
        self.collected = 0.0
        self.begun = 0.0
        self.folder, self.curve = folder, curve
        self.before = curve[-1]["seconds"] if curve else 0.0
        self.started = self.saved_at = time.monotonic()
        self.saved = 0
        self.is_due = self.is_stopped = False

    def _on_training_start(self) -> None:
        self.ended = np.zeros(self.training_env.num_envs, bool)
        # A run that is killed before its first tenth is resumed like any other.
        self.save()

    def _on_step(self) -> bool:
        if self.is_stopped:
            raise KeyboardInterrupt
        self.ended |= self.locals["dones"]
        return True

    def _on_rollout_start(self) -> None:
        self.begun = time.monotonic()

    def _on_rollout_end(self) -> None:
        self.collected += time.monotonic() - self.begun
        self.bar.update(self.num_timesteps - self.bar.n)
        shown = "success not known yet"
        episodes = list(self.model.ep_info_buffer or ())
        if episodes:
            seconds = self.before + time.monotonic() - self.started
            success = float(np.mean([episode["is_success"] for episode in episodes]))
            mean_return = float(np.mean([episode["r"] for episode in episodes]))
            point = {"steps": self.num_timesteps, "seconds": round(seconds, 2)}
            self.curve.append(point | {"success": success, "return": round(mean_return, 3)})
            # Episodes that end early have failed: until every row has ended one, a success rate
            # would be theirs alone.
            if self.ended.all():
                shown = f"success {success:.0%}, return {mean_return:.1f}"
        self.bar.set_postfix_str(shown)
        is_late = time.monotonic() - self.saved_at >= SAVE_EVERY
        if self.is_due or is_late or self.num_timesteps - self.saved >= self.bar.total / 10:
            self.save()

    def _on_training_end(self) -> None:
        self.save()
        whole, inside = time.monotonic() - self.started, self.environment.spent
        times = {"environment": inside, "collecting": self.collected - inside}
        times["updating"] = whole - self.collected
        replace_file(self.folder / "times.json", json.dumps(times))

    def save(self) -> None:
        """Writes a whole new checkpoint beside the old one, then takes its place."""
        fresh = self.folder / f"{CHECKPOINT}.new"
        shutil.rmtree(fresh, ignore_errors=True)
        fresh.mkdir(parents=True)
        self.model.save(fresh / "model.zip")
        normaliser = self.model.get_vec_normalize_env()
        assert normaliser is not None, "make_environment normalises"
        normaliser.save(str(fresh / "normaliser.pkl"))
        (fresh / "curve.json").write_text(json.dumps(self.curve))
        self.agent().write(fresh / CHECKPOINT_AGENT)
        current, old = self.folder / CHECKPOINT, self.folder / f"{CHECKPOINT}.old"
        # Where `current` is missing, `old` is the last checkpoint: see `last_checkpoint`.
        if current.exists():
            shutil.rmtree(old, ignore_errors=True)
            current.rename(old)
        fresh.rename(current)
        shutil.rmtree(old, ignore_errors=True)
        self.saved, self.saved_at, self.is_due = self.num_timesteps, time.monotonic(), False

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Heed SIGTERM at the next step, and SIGUSR1 at the end of the rollout."""
        names = {"SIGTERM": "is_stopped", "SIGUSR1": "is_due"}
        # Windows has no SIGUSR1, and only the main thread may take signals.
        heeded = {
            getattr(signal, name): flag for name, flag in names.items() if hasattr(signal, name)
        }
        if threading.current_thread() is not threading.main_thread():
            heeded = {}
        before = {
            number: signal.signal(number, lambda *_, flag=flag: setattr(self, flag, True))
            for number, flag in heeded.items()
        }
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def _learn(
    model: PPO,
    chosen: Params,
    curve: list[dict[str, float]],
    folder: Path,
    about: dict[str, Any],
    threads: int | None,
) -> PPO:
    """Train until the model has the steps of `chosen`."""
    chosen = replace(chosen, steps=_whole(chosen))
    commit = about_this_run()["commit"]
    about |= {"trained_by": list(dict.fromkeys([*about["trained_by"], commit]))}
    about |= {"threads": threads or min(usable_cores(), chosen.n_envs), "params": asdict(chosen)}
    folder.mkdir(parents=True, exist_ok=True)
    # A run whose file is cut off could not be resumed.
    replace_file(folder / RUN, json.dumps(about, indent=1, default=plain))

    def agent() -> Agent:
        made = from_sb3(
            model,
            model.get_vec_normalize_env(),
            env_id=about["env"],
            settings=chosen.environment,
            seed=about["seed"],
            threads=about["threads"],
            commit=", ".join(about["trained_by"]),
        )
        made.card["steps"] += about["steps_before"]
        return made

    # A logger of its own would leave an empty folder in that of temporary files.
    model.set_logger(Logger(folder=None, output_formats=[]))
    done = model.num_timesteps
    with tqdm(total=chosen.steps, initial=done, unit=" steps", smoothing=0.1) as bar:
        progress = RunMonitor(folder, curve, _timed(model), agent, bar)
        with progress.listening():
            try:
                model.learn(chosen.steps - done, callback=progress, reset_num_timesteps=False)
            except KeyboardInterrupt:
                if progress.n_calls > 0:
                    progress.save()
                raise
    return model


def _whole(chosen: Params) -> int:
    """Steps of a run: the whole rollouts that contain the chosen number of steps."""
    return -(-chosen.steps // chosen.rollout) * chosen.rollout


def _timed(model: PPO) -> Timed:
    """The wrapper of a model's environments that measures their time."""
    envs = model.get_env()
    while not isinstance(envs, Timed):
        assert isinstance(envs, VecEnvWrapper), "make_environment measures"
        envs = envs.venv
    return envs
