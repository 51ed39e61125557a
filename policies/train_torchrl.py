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


def command_line() -> argparse.ArgumentParser:
    """The options of the script."""
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
    return parser


if __name__ == "__main__":
    # For --help, before what takes seconds to import or is not installed.
    command_line().parse_args()

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from tensordict.nn import AddStateIndependentNormalScale, TensorDictModule
from torch import Tensor, nn
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, ReplayBuffer, SamplerWithoutReplacement
from torchrl.envs import GymWrapper, ObservationTransform, RewardSum, TransformedEnv
from torchrl.modules import MLP, IndependentNormal, ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

import ruffini  # noqa: F401  registers the environments
from ruffini.agents import first_seed
from ruffini.evaluation import evaluate, line

ROLLOUT, BATCH, EPOCHS = 32, 256, 8
"""Steps of each environment between updates; size of a minibatch; passes over a rollout."""
RATES = 7e-4, 3e-5
"""Learning rate at the beginning and at the end."""


class Normalised(ObservationTransform):  # type: ignore[misc]
    """Observations less their running mean, by their running standard deviation.

    Args:
        inputs: Size of an observation.
    """

    mean: Tensor
    variance: Tensor
    count: Tensor

    def __init__(self, inputs: int) -> None:
        super().__init__(in_keys=["observation"], out_keys=["observation"])
        self.register_buffer("mean", torch.zeros(inputs, dtype=torch.float64))
        self.register_buffer("variance", torch.ones(inputs, dtype=torch.float64))
        self.register_buffer("count", torch.tensor(1e-4, dtype=torch.float64))
        self.learns = True

    def _apply_transform(self, observation: Tensor) -> Tensor:
        if self.learns:
            batch = observation.double()
            total, apart = self.count + len(batch), batch.mean(0) - self.mean
            squares = self.variance * self.count + batch.var(0, correction=0) * len(batch)
            self.variance = (squares + apart**2 * self.count * len(batch) / total) / total
            self.mean = self.mean + apart * len(batch) / total
            self.count = total
        apart = observation.double() - self.mean
        normal: Tensor = apart / (self.variance + 1e-8).sqrt()
        return normal.clamp(-10, 10).float()

    def _reset(self, tensordict: Any, tensordict_reset: Any) -> Any:
        return self._call(tensordict_reset)


class Agent:
    """Actor and critic of normalised observations, and their normalisation.

    Args:
        inputs: Size of an observation.
        actions: Size of an action.
    """

    def __init__(self, inputs: int, actions: int) -> None:
        self.normalised = Normalised(inputs)
        self.mean = nn.Sequential(
            perceptron(inputs, actions, 0.01),
            AddStateIndependentNormalScale(actions, scale_mapping="exp", init_value=-0.5),
        )
        self.actor = ProbabilisticActor(
            TensorDictModule(self.mean, in_keys=["observation"], out_keys=["loc", "scale"]),
            in_keys=["loc", "scale"],
            distribution_class=IndependentNormal,
            return_log_prob=True,
        )
        self.critic = ValueOperator(perceptron(inputs, 1, 1.0), in_keys=["observation"])

    @torch.no_grad()
    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """Actions (N, 5) without noise, as `ruffini.evaluation.evaluate` asks for them."""
        self.normalised.learns = False
        action, _ = self.mean(self.normalised._apply_transform(torch.from_numpy(observation)))
        return action.clamp(-1, 1).numpy(), state


def perceptron(inputs: int, outputs: int, scale: float) -> MLP:
    """A perceptron with two hidden layers; `scale` is that of the last layer's weights."""
    layers = MLP(
        in_features=inputs, out_features=outputs, num_cells=[128, 128], activation_class=nn.Tanh
    )
    linear = [layer for layer in layers if isinstance(layer, nn.Linear)]
    for layer in linear:
        nn.init.orthogonal_(layer.weight, scale if layer is linear[-1] else 2**0.5)
        nn.init.zeros_(layer.bias)
    return layers


def train(envs: gym.vector.VectorEnv[Any, Any, Any], steps: int, seed: int) -> Agent:
    """Trains an agent on whole rollouts, at least `steps` steps of all environments together."""
    torch.manual_seed(seed)
    env = TransformedEnv(GymWrapper(envs), RewardSum())
    agent = Agent(env.observation_spec["observation"].shape[-1], env.action_spec.shape[-1])
    env.append_transform(agent.normalised)
    # Row i adds i: runs of neighbouring seeds share no episodes.
    env.set_seed(first_seed(seed))
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
    size = ROLLOUT * envs.num_envs
    updates = -(-steps // size)
    collector = Collector(env, agent.actor, frames_per_batch=size, total_frames=updates * size)
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
    parser = command_line()
    arguments = parser.parse_args()
    if min(arguments.steps, arguments.n_envs, arguments.episodes) < 1:
        parser.error("--steps, --n-envs and --episodes: expected at least 1")
    torch.set_num_threads(1)  # The layers are too small to share.
    settings = {"obs": "flat", "tactile": arguments.tactile}
    batch = settings | {"num_envs": arguments.n_envs, "max_episode_steps": 75}
    try:
        # TorchRL resets rows itself, by a mask.
        envs = gym.make_vec(arguments.env_id, autoreset_mode="Disabled", **batch)
    except (gym.error.Error, ValueError) as error:
        parser.error(str(error))
    agent = train(envs, arguments.steps, arguments.seed)
    print(line("trained", evaluate(agent, arguments.env_id, arguments.episodes, **settings)))
    arguments.out.mkdir(parents=True, exist_ok=True)
    parts = {"actor": agent.actor.state_dict(), "normalised": agent.normalised.state_dict()}
    torch.save(parts, arguments.out / "agent.pt")


if __name__ == "__main__":
    main()
