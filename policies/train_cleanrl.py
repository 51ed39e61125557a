"""PPO in one file, in the manner of CleanRL: PyTorch and the native batch, no framework.

Use::

    python policies/train_cleanrl.py
    python policies/train_cleanrl.py --env-id ruffini/HoldStill-v0 --tactile surrogate

To be read, copied and changed. Observations are flat, hyper-parameters are those of the shipped
agent of GraspLift, and pads are rigid, which costs a tenth of touch, unless `--tactile` says
otherwise. Prints success over 200 evaluation seeds, and writes the agent to ``agent.pt`` in
``policies/runs/cleanrl`` (`--out`).
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
from torch import Tensor, nn
from torch.distributions import Independent, Normal

import ruffini  # noqa: F401  registers the environments
from ruffini.agents import first_seed
from ruffini.evaluation import evaluate, line

ROLLOUT, BATCH, EPOCHS = 32, 256, 8
"""Steps of each environment between updates; size of a minibatch; passes over a rollout."""
GAMMA, LAMBDA = 0.95, 0.95
CLIP, VALUE_WEIGHT, MAX_GRADIENT = 0.2, 0.5, 0.5
RATES = 7e-4, 3e-5
"""Learning rate at the beginning and at the end."""
HIDDEN, LOG_STD = 128, -0.5
EPISODE = 75
"""Longest episode while training: an object is up after 50 steps."""


def network(inputs: int, outputs: int, scale: float) -> nn.Sequential:
    """A perceptron with two hidden layers; `scale` is that of the last layer's weights."""
    sizes = [inputs, HIDDEN, HIDDEN, outputs]
    layers: list[nn.Module] = []
    for i in range(3):
        layer = nn.Linear(sizes[i], sizes[i + 1])
        nn.init.orthogonal_(layer.weight, scale if i == 2 else 2**0.5)
        nn.init.zeros_(layer.bias)
        layers += [layer, nn.Tanh()]
    return nn.Sequential(*layers[:-1])


class Agent(nn.Module):
    """Policy and value of normalised observations (N, inputs), and their normalisation."""

    mean: Tensor
    variance: Tensor
    count: Tensor

    def __init__(self, inputs: int, actions: int) -> None:
        super().__init__()
        self.actor = network(inputs, actions, 0.01)
        self.critic = network(inputs, 1, 1.0)
        self.log_std = nn.Parameter(torch.full((actions,), LOG_STD))
        self.register_buffer("mean", torch.zeros(inputs, dtype=torch.float64))
        self.register_buffer("variance", torch.ones(inputs, dtype=torch.float64))
        self.register_buffer("count", torch.tensor(1e-4, dtype=torch.float64))

    def learn_scale(self, observation: NDArray[np.float32]) -> None:
        """Updates mean and variance of observations (Chan, Golub and LeVeque 1979)."""
        batch = torch.from_numpy(observation).double()
        total, apart = self.count + len(batch), batch.mean(0) - self.mean
        squares = self.variance * self.count + batch.var(0, correction=0) * len(batch)
        self.variance = (squares + apart**2 * self.count * len(batch) / total) / total
        self.mean = self.mean + apart * len(batch) / total
        self.count = total

    def normal(self, observation: NDArray[np.float32]) -> Tensor:
        """Normalised observations."""
        apart = torch.from_numpy(observation).double() - self.mean
        return (apart / (self.variance + 1e-8).sqrt()).clamp(-10, 10).float()

    def policy(self, observation: Tensor) -> Any:
        """Distribution of actions (N, 5), a `torch.distributions.Independent`."""
        return Independent(Normal(self.actor(observation), self.log_std.exp()), 1)

    def value(self, observation: Tensor) -> Tensor:
        """Expected return (N,)."""
        value: Tensor = self.critic(observation)
        return value.squeeze(-1)

    @torch.no_grad()
    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (N, 5) without noise, as `ruffini.evaluation.evaluate` asks for them."""
        return self.actor(self.normal(observation)).clamp(-1, 1).numpy(), state


def advantages(rewards: Tensor, values: Tensor, last: Tensor, over: Tensor) -> Tensor:
    """Generalised advantage estimates (T, N); `over` is 1 where an episode ended in that step."""
    found, following, ahead = torch.zeros_like(rewards), last, torch.zeros_like(last)
    for t in reversed(range(len(rewards))):
        goes_on = 1 - over[t]
        delta = rewards[t] + GAMMA * following * goes_on - values[t]
        ahead = delta + GAMMA * LAMBDA * goes_on * ahead
        found[t], following = ahead, values[t]
    return found


class Rollouts:
    """Collects steps of all environments with an agent.

    Args:
        envs: Environments that are reset in the step in which an episode ends.
        agent: Agent; its normalisation learns from what is seen.
        seed: Seed of the run.
    """

    def __init__(self, envs: gym.vector.VectorEnv[Any, Any, Any], agent: Agent, seed: int) -> None:
        self.envs, self.agent = envs, agent
        # Row i adds i: runs of neighbouring seeds share no episodes.
        raw, _ = envs.reset(seed=first_seed(seed))
        agent.learn_scale(raw)
        self.observation = agent.normal(raw)
        self.successes: list[bool] = []

    @torch.no_grad()
    def collect(self) -> tuple[Tensor, ...]:
        """Observations, actions, log-probabilities, advantages and returns of `ROLLOUT` steps."""
        rows: list[tuple[Tensor, ...]] = []
        for _ in range(ROLLOUT):
            before, policy = self.observation, self.agent.policy(self.observation)
            action = policy.sample()
            raw, reward, terminated, truncated, info = self.envs.step(action.clamp(-1, 1).numpy())
            if "final_obs" in info:
                self.successes += info["final_info"]["is_success"][info["_final_info"]].tolist()
                # Time that is up is no end of the task: what would have followed is estimated.
                cut = np.flatnonzero(truncated & ~terminated)
                if len(cut):
                    final = self.agent.normal(np.stack(list(info["final_obs"][cut])))
                    reward[cut] += GAMMA * self.agent.value(final).numpy()
            told = torch.from_numpy(reward).float()
            over = torch.from_numpy(terminated | truncated).float()
            chance = policy.log_prob(action)
            rows.append((before, action, chance, told, self.agent.value(before), over))
            self.agent.learn_scale(raw)
            self.observation = self.agent.normal(raw)
        seen, actions, chances, rewards, values, over = (
            torch.stack(x) for x in zip(*rows, strict=True)
        )
        last = self.agent.value(self.observation)
        found = advantages(rewards, values, last, over)
        columns = seen, actions, chances, found, found + values
        return tuple(column.flatten(0, 1) for column in columns)


def update(agent: Agent, optimiser: torch.optim.Optimizer, rollout: tuple[Tensor, ...]) -> None:
    """Several passes of PPO's clipped loss over a rollout (Schulman et al. 2017)."""
    for _ in range(EPOCHS):
        order = torch.randperm(len(rollout[0]))
        for first in range(0, len(order), BATCH):
            chosen = order[first : first + BATCH]
            seen, actions, chances, ahead, returns = (column[chosen] for column in rollout)
            ratio = (agent.policy(seen).log_prob(actions) - chances).exp()
            ahead = (ahead - ahead.mean()) / (ahead.std() + 1e-8)
            gain = torch.min(ratio * ahead, ratio.clamp(1 - CLIP, 1 + CLIP) * ahead).mean()
            loss = VALUE_WEIGHT * nn.functional.mse_loss(agent.value(seen), returns) - gain
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), MAX_GRADIENT)
            optimiser.step()


def train(envs: gym.vector.VectorEnv[Any, Any, Any], steps: int, seed: int) -> Agent:
    """Trains an agent on whole rollouts, at least `steps` steps of all environments together."""
    torch.manual_seed(seed)
    inputs, actions = envs.single_observation_space.shape, envs.single_action_space.shape
    assert inputs is not None and actions is not None, "boxes"
    agent = Agent(inputs[0], actions[0])
    optimiser = torch.optim.Adam(agent.parameters(), eps=1e-5)
    rollouts = Rollouts(envs, agent, seed)
    size = ROLLOUT * envs.num_envs
    updates, started = -(-steps // size), time.monotonic()
    for i in range(updates):
        optimiser.param_groups[0]["lr"] = RATES[0] + (RATES[1] - RATES[0]) * i / updates
        update(agent, optimiser, rollouts.collect())
        if (i + 1) % 10 == 0 or i + 1 == updates:
            done, seconds = (i + 1) * size, time.monotonic() - started
            success = float(np.mean(rollouts.successes[-500:] or [False]))
            print(f"{done:>9,} steps  success {success:6.1%}  {done / seconds:6,.0f} steps/s")
    return agent


def main() -> None:
    """Parses the command line, trains, judges and saves."""
    parser = argparse.ArgumentParser(description="Train an agent with PPO in one file.")
    parser.add_argument("--env-id", default="ruffini/GraspLift-v0", help="environment")
    parser.add_argument("--steps", type=int, default=160 * 2048, help="environment steps")
    parser.add_argument("--seed", type=int, default=0, help="training seed")
    parser.add_argument("--n-envs", type=int, default=64, help="environments stepped together")
    parser.add_argument("--tactile", default="none", help="model of touch")
    parser.add_argument("--episodes", type=int, default=200, help="evaluation episodes")
    parser.add_argument(
        "--out", type=Path, default=Path(__file__).parent / "runs/cleanrl", help="folder"
    )
    arguments = parser.parse_args()
    if min(arguments.steps, arguments.n_envs, arguments.episodes) < 1:
        parser.error("--steps, --n-envs and --episodes: expected at least 1")
    torch.set_num_threads(1)  # The layers are too small to share.
    settings = {"obs": "flat", "tactile": arguments.tactile}
    batch = settings | {"num_envs": arguments.n_envs, "max_episode_steps": EPISODE}
    try:
        envs = gym.make_vec(arguments.env_id, autoreset_mode="SameStep", **batch)
    except (gym.error.Error, ValueError) as error:
        parser.error(str(error))
    agent = train(envs, arguments.steps, arguments.seed)
    print(line("trained", evaluate(agent, arguments.env_id, arguments.episodes, **settings)))
    arguments.out.mkdir(parents=True, exist_ok=True)
    torch.save(agent.state_dict(), arguments.out / "agent.pt")


if __name__ == "__main__":
    main()
