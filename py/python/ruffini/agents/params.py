"""Hyper-parameters of PPO by environment, tuned on seeds 0 to 4 alone."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any


@dataclass(frozen=True)
class Params:
    """Everything that a training run is made of, beside its seed."""

    steps: int
    """Environment steps, whole rollouts of all environments."""
    n_envs: int
    """Environments stepped together."""
    algorithm: dict[str, Any]
    """Keyword arguments of the algorithm."""
    environment: dict[str, Any] = field(default_factory=dict)
    """Keyword arguments of the environment."""
    training: dict[str, Any] = field(default_factory=dict)
    """Keyword arguments of the environment while it trains, and not when the agent is judged."""
    privileged: list[str] = field(default_factory=list)
    """Channels that the value function sees while it trains, and the agent does not."""
    steps_without_touch: int = 0
    """Of the steps, those at the beginning with rigid pads, which cost a tenth; the channels of
    touch are 0 in them."""
    final_learning_rate: float | None = None
    """Learning rate at the end, to which it falls linearly; constant if not given."""

    @property
    def obs(self) -> str:
        """Form of the observations; if not given, ``flat`` with rigid pads, else ``dict``."""
        usual = "flat" if self.environment.get("tactile") == "none" else "dict"
        return str(self.environment.get("obs", usual))

    @property
    def rollout(self) -> int:
        """Steps of all environments between two updates."""
        return int(self.n_envs * self.algorithm["n_steps"])

    def with_settings(self, settings: dict[str, Any]) -> Params:
        """With other keyword arguments of the environment; what is observed is not privileged."""
        environment = self.environment | settings
        observed = environment.get("observation") or []
        observed = [observed] if isinstance(observed, str) else observed
        privileged = [name for name in self.privileged if name not in observed]
        return replace(self, environment=environment, privileged=privileged)


CLOSING: dict[str, Any] = {
    "n_steps": 32,
    "batch_size": 256,
    "n_epochs": 10,
    "learning_rate": 7e-4,
    # What a drop costs later must not hide what a lift pays now.
    "gamma": 0.95,
    "gae_lambda": 0.95,
    "policy_kwargs": {"net_arch": [64, 64], "log_std_init": -0.5},
}
"""PPO for tasks whose grip changes by factors."""

PARAMS: dict[str, Params] = {
    "ruffini/GraspLift-v0": Params(
        # Reaching and lifting are learnt with rigid pads in a minute, then with tactile ones.
        steps=160 * 2048,
        steps_without_touch=80 * 2048,
        n_envs=64,
        algorithm={
            # 2,048 steps a rollout; an update of eight epochs costs a third of one.
            "n_steps": 32,
            "batch_size": 256,
            "n_epochs": 8,
            "learning_rate": 7e-4,
            # Lifting pays at once; a longer horizon finds it later, from some seeds too late.
            "gamma": 0.95,
            "gae_lambda": 0.95,
            # Less noise than the default 0, under which light objects are thrown about.
            "policy_kwargs": {"net_arch": [128, 128], "log_std_init": -0.5},
        },
        # An object is up after 50 steps; the rest of 100 would be spent holding it.
        training={"max_episode_steps": 75},
        final_learning_rate=3e-5,
    ),
    # Touch takes nearly all of the time: fewer steps, and more learnt from each.
    "ruffini/GraspFragile-v0": Params(
        steps=147 * 2048,
        n_envs=64,
        algorithm=CLOSING,
        final_learning_rate=3e-5,
    ),
    # A press of a soft object takes ten times as long as one of a pad: fewer steps still.
    "ruffini/GraspSoft-v0": Params(
        steps=30 * 1024,
        n_envs=32,
        algorithm=CLOSING,
        final_learning_rate=3e-5,
    ),
    "ruffini/HoldStill-v0": Params(
        steps=100 * 2048,
        n_envs=64,
        algorithm=CLOSING
        | {
            "n_epochs": 8,
            "gamma": 0.98,
            # A hand that shakes lets go.
            "policy_kwargs": {"net_arch": [64, 64], "log_std_init": -1.0},
        },
        final_learning_rate=3e-5,
    ),
    "ruffini/InsertPeg-v0": Params(
        # Success still rises after two thirds of these.
        steps=220 * 2048,
        n_envs=64,
        algorithm=CLOSING
        | {
            "n_epochs": 8,
            "gamma": 0.98,
            "policy_kwargs": {"net_arch": [128, 128], "log_std_init": -0.7},
        },
        # Where the hole is, and the peg in the hand: what an episode is worth depends on it most.
        privileged=["insertion"],
        final_learning_rate=3e-5,
    ),
}


def params(env_id: str) -> Params:
    """The hyper-parameters for an environment.

    Raises:
        ValueError: If there are none.
    """
    if env_id not in PARAMS:
        raise ValueError(f"task: found {env_id}, expected one of {', '.join(PARAMS)}")
    return PARAMS[env_id]
