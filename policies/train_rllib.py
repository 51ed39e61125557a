"""PPO with RLlib's new API stack, a native batch in each env runner.

Needs ``pip install ".[frameworks]"``. Use::

    python policies/train_rllib.py
    python policies/train_rllib.py --runners 8 --tactile surrogate
    python policies/train_rllib.py --runners 32 --address auto  # a cluster that runs

Hyper-parameters are those of the shipped agent of GraspLift, pads are rigid unless `--tactile` says
otherwise. Prints success over the episodes that ended in each rollout, and at last over 200 without
noise, and writes a checkpoint to ``policies/runs/rllib`` (`--out`).
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any


def command_line() -> argparse.ArgumentParser:
    """The options of the script."""
    parser = argparse.ArgumentParser(description="Train an agent with RLlib.")
    parser.add_argument("--env-id", default="ruffini/GraspLift-v0", help="environment")
    parser.add_argument("--steps", type=int, default=160 * 2048, help="environment steps")
    parser.add_argument("--seed", type=int, default=0, help="training seed")
    parser.add_argument("--n-envs", type=int, default=64, help="environments of a runner")
    parser.add_argument("--runners", type=int, default=0, help="processes; 0: in this one")
    parser.add_argument("--address", help="of a running cluster; this machine alone if not given")
    parser.add_argument("--tactile", default="none", help="model of touch")
    parser.add_argument("--episodes", type=int, default=200, help="evaluation episodes")
    parser.add_argument(
        "--out", type=Path, default=Path(__file__).parent / "runs/rllib", help="folder"
    )
    return parser


if __name__ == "__main__":
    # For --help, before what takes seconds to import or is not installed.
    command_line().parse_args()

import gymnasium as gym
import ray
from ray.rllib.algorithms.ppo import PPO, PPOConfig
from ray.rllib.callbacks.callbacks import RLlibCallback
from ray.rllib.connectors.env_to_module import MeanStdFilter
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

import ruffini  # noqa: F401  registers the environments
from ruffini.agents import first_seed

ROLLOUT = 32
"""Steps of each environment between updates."""


class Success(RLlibCallback):  # type: ignore[misc]
    """Counts episodes that ended in success, and seeds runners so that they share none."""

    def on_environment_created(self, *, env_runner: Any, **rest: Any) -> None:
        """Gives a runner seeds of its own: RLlib's are 1 apart, and row i of a batch adds i."""
        config = env_runner.config
        if not config.in_evaluation:
            rows = (env_runner.worker_index or 0) * config.num_envs_per_env_runner
            # What RLlib passes to the first reset.
            env_runner._seed = first_seed(config.seed) + rows

    def on_episode_end(self, *, episode: Any, metrics_logger: Any, **rest: Any) -> None:
        """Logs whether the episode succeeded."""
        success = float(episode.get_infos(-1)["is_success"])
        metrics_logger.log_value("success", success, reduce="mean", window=500)


def configuration(
    env_id: str, steps: int, seed: int, n_envs: int, runners: int, episodes: int, tactile: str
) -> PPOConfig:
    """Configuration of training for `steps` steps of all runners' environments together."""
    settings = {"obs": "flat", "tactile": tactile, "num_threads": 1 if runners else None}
    batch = ROLLOUT * n_envs * max(runners, 1)
    config = PPOConfig().environment(
        f"ruffini:{env_id}",  # The prefix imports the package in each runner.
        env_config=settings | {"max_episode_steps": 75},
    )
    config.env_runners(
        num_env_runners=runners,
        num_envs_per_env_runner=n_envs,
        gym_env_vectorize_mode="vector_entry_point",
        rollout_fragment_length=ROLLOUT,
        env_to_module_connector=lambda env, spaces, device: MeanStdFilter(),
    )
    config.rl_module(
        model_config=DefaultModelConfig(
            fcnet_hiddens=[128, 128],
            fcnet_activation="tanh",
            vf_share_layers=False,
            free_log_std=True,
        )
    )
    config.training(
        train_batch_size_per_learner=batch,
        minibatch_size=256,
        num_epochs=8,
        lr=[[0, 7e-4], [max(steps, 1), 3e-5]],
        gamma=0.95,
        lambda_=0.95,
        clip_param=0.2,
        use_kl_loss=False,
        entropy_coeff=0.0,
        vf_loss_coeff=0.5,
        vf_clip_param=float("inf"),
        grad_clip=0.5,
    )
    config.evaluation(
        evaluation_interval=10**9,  # Without one, `evaluate` acts with the noise of training.
        evaluation_num_env_runners=0,
        evaluation_duration=episodes,
        evaluation_duration_unit="episodes",
        evaluation_config={"explore": False, "env_config": settings},
    )
    return config.callbacks(Success).debugging(seed=seed, log_level="ERROR")


def train(algorithm: PPO, steps: int) -> float:
    """Trains for at least `steps` steps; success without noise in the episodes of evaluation."""
    done = 0
    while done < steps:
        found = algorithm.train()["env_runners"]
        done = int(found["num_env_steps_sampled_lifetime"])
        success = found.get("success", math.nan)
        ended = f"success {success:6.1%}" if math.isfinite(success) else "no episode ended"
        print(f"{done:>9,} steps  {ended}")
    return float(algorithm.evaluate()["env_runners"]["success"])


def machines(algorithm: PPO) -> set[str]:
    """Nodes of the cluster on which runners step environments."""
    place = algorithm.env_runner_group.foreach_env_runner(
        lambda _: ray.get_runtime_context().get_node_id(),
        local_env_runner=algorithm.config.num_env_runners == 0,
    )
    return set(place)


def main() -> None:
    """Parses the command line, trains, judges and saves."""
    parser = command_line()
    arguments = parser.parse_args()
    if min(arguments.steps, arguments.n_envs, arguments.episodes) < 1 or arguments.runners < 0:
        parser.error("--steps, --n-envs and --episodes: expected at least 1; --runners: 0 or more")
    try:
        settings = {"obs": "flat", "tactile": arguments.tactile}
        gym.make(arguments.env_id, **settings).close()
    except (gym.error.Error, ValueError) as error:
        parser.error(str(error))
    quiet = {"include_dashboard": False, "log_to_driver": False}
    ray.init(address=arguments.address, ignore_reinit_error=True, **quiet)
    algorithm = configuration(
        arguments.env_id,
        arguments.steps,
        arguments.seed,
        arguments.n_envs,
        arguments.runners,
        arguments.episodes,
        arguments.tactile,
    ).build_algo()
    try:
        print(f"{arguments.runners} runners on {len(machines(algorithm))} machines")
        print(f"success without noise {train(algorithm, arguments.steps):.1%}")
        algorithm.save_to_path(arguments.out.resolve())
    finally:
        algorithm.stop()


if __name__ == "__main__":
    main()
