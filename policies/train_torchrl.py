"""PPO with TorchRL's own parts on a native batch; ``pip install ".[frameworks]"``.

Use::

    python policies/train_torchrl.py
    python policies/train_torchrl.py --env-id ruffini/HoldStill-v0 --tactile surrogate

Hyper-parameters are those of the shipped agent of GraspLift, pads are rigid unless `--tactile` says
otherwise. Prints success over 200 evaluation seeds, and writes the agent to ``agent.pt`` in
``policies/runs/torchrl`` (`--out`).
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from tensordict.nn import AddStateIndependentNormalScale, TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, ReplayBuffer, SamplerWithoutReplacement
from torchrl.envs import GymWrapper, RewardSum, TransformedEnv, VecNormV2
from torchrl.modules import MLP, IndependentNormal, ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

import ruffini
from ruffini.evaluation import evaluate, line

ROLLOUT, BATCH, EPOCHS = 32, 256, 8
"""Steps of each environment between updates; size of a minibatch; passes over a rollout."""
RATES = 7e-4, 3e-5
"""Learning rate at the beginning and at the end."""


class Agent:
    """Actor, critic and normalisation of observations.

    Args:
        env: Environments, of flat observations, that are trained in.
    """

    def __init__(self, env: Any) -> None:
        inputs = env.observation_spec["observation"].shape[-1]
        actions = env.action_spec.shape[-1]
        sizes: dict[str, Any] = {"num_cells": [128, 128], "activation_class": nn.Tanh}
        mean = nn.Sequential(
            MLP(in_features=inputs, out_features=actions, **sizes),
            AddStateIndependentNormalScale(actions, scale_mapping="exp", init_value=-0.5),
        )
        for weights in (mean[0][-1].weight, mean[0][-1].bias):
            nn.init.normal_(weights, std=0.01 / len(weights))
        self.actor = ProbabilisticActor(
            TensorDictModule(mean, in_keys=["observation"], out_keys=["loc", "scale"]),
            in_keys=["loc", "scale"],
            distribution_class=IndependentNormal,
            return_log_prob=True,
        )
        critic = MLP(in_features=inputs, out_features=1, **sizes)
        self.critic = ValueOperator(critic, in_keys=["observation"])
        self.mean = mean
        self.normaliser = VecNormV2(["observation"], decay=1.0, reduce_batch_dims=True)
        self.env = TransformedEnv(env, self.normaliser)
        self.env.append_transform(RewardSum())

    @torch.no_grad()
    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (N, 5) without noise, as `ruffini.evaluation.evaluate` asks for them."""
        loc, scale = self.normaliser.loc["observation"], self.normaliser.scale["observation"]
        action, _ = self.mean((torch.from_numpy(observation) - loc) / scale)
        return action.clamp(-1, 1).numpy(), state


def train(env_id: str, steps: int, seed: int, n_envs: int, **settings: Any) -> Agent:
    """Trains an agent on whole rollouts, at least `steps` steps of all environments together."""
    torch.manual_seed(seed)
    settings |= {"obs": "flat", "max_episode_steps": 75}
    # TorchRL resets rows itself, by a mask.
    envs = gym.make_vec(env_id, num_envs=n_envs, autoreset_mode="Disabled", **settings)
    env = GymWrapper(envs)
    env.set_seed(seed)
    agent = Agent(env)
    advantage = GAE(gamma=0.95, lmbda=0.95, value_network=agent.critic)
    losses = ClipPPOLoss(
        agent.actor,
        agent.critic,
        clip_epsilon=0.2,
        entropy_bonus=False,
        critic_coeff=0.5,
        loss_critic_type="l2",
        normalize_advantage=True,
    )
    optimiser = torch.optim.Adam(losses.parameters(), lr=RATES[0], eps=1e-5)
    size = ROLLOUT * n_envs
    updates = -(-steps // size)
    collector = Collector(
        agent.env, agent.actor, frames_per_batch=size, total_frames=updates * size
    )
    storage = LazyTensorStorage(size)
    memory = ReplayBuffer(storage=storage, sampler=SamplerWithoutReplacement(), batch_size=BATCH)
    started = time.monotonic()
    for i, rollout in enumerate(collector):
        optimiser.param_groups[0]["lr"] = RATES[0] + (RATES[1] - RATES[0]) * i / updates
        with torch.no_grad():
            advantage(rollout)
        memory.extend(rollout.reshape(-1))
        for _ in range(EPOCHS):
            for batch in memory:
                found = losses(batch)
                optimiser.zero_grad()
                (found["loss_objective"] + found["loss_critic"]).backward()
                nn.utils.clip_grad_norm_(losses.parameters(), 0.5)
                optimiser.step()
        memory.empty()
        if (i + 1) % 10 == 0 or i + 1 == updates:
            over = rollout["next", "done"]
            total = rollout["next", "episode_reward"][over].mean()
            done, seconds = (i + 1) * size, time.monotonic() - started
            print(f"{done:>9,} steps  return {total:6.2f}  {done / seconds:6,.0f} steps/s")
    collector.shutdown()
    return agent


def main() -> None:
    """Parses the command line, trains, judges and saves."""
    parser = argparse.ArgumentParser(description="Train an agent with TorchRL.")
    parser.add_argument("--env-id", default="ruffini/GraspLift-v0", help="environment")
    parser.add_argument("--steps", type=int, default=160 * 2048, help="environment steps")
    parser.add_argument("--seed", type=int, default=0, help="training seed")
    parser.add_argument("--n-envs", type=int, default=64, help="environments stepped together")
    parser.add_argument("--tactile", default="none", help="model of touch")
    parser.add_argument("--episodes", type=int, default=200, help="evaluation episodes")
    parser.add_argument(
        "--out", type=Path, default=Path(__file__).parent / "runs/torchrl", help="folder"
    )
    arguments = parser.parse_args()
    if min(arguments.steps, arguments.n_envs, arguments.episodes) < 1:
        parser.error("--steps, --n-envs and --episodes: expected at least 1")
    torch.set_num_threads(1)  # The layers are too small to share.
    settings = {"tactile": arguments.tactile}
    try:
        agent = train(
            arguments.env_id, arguments.steps, arguments.seed, arguments.n_envs, **settings
        )
        found = evaluate(agent, arguments.env_id, arguments.episodes, obs="flat", **settings)
    except (gym.error.Error, ValueError, ruffini.SimulationError) as error:
        parser.error(str(error))
    print(line("trained", found))
    arguments.out.mkdir(parents=True, exist_ok=True)
    torch.save(
        {"actor": agent.actor.state_dict(), "normaliser": agent.normaliser.state_dict()},
        arguments.out / "agent.pt",
    )


if __name__ == "__main__":
    main()
