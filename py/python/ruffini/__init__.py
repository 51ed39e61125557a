"""Grasping with soft tactile fingertips: vectorised Gymnasium environments in Rust.

Importing registers the environments; from a worker process use the prefix form,
``gymnasium.make("ruffini:ruffini/GraspLift-v0")``.
"""

from gymnasium.envs.registration import register

from ruffini._core import CHANNELS, OBJECTS, REWARD_TERMS, SimulationError, __version__

__all__ = [
    "CHANNELS",
    "OBJECTS",
    "REWARD_TERMS",
    "SimulationError",
    "__version__",
]

register(
    id="ruffini/GraspLift-v0",
    entry_point="ruffini.envs:GraspLiftEnv",
    vector_entry_point="ruffini.envs:GraspLiftVectorEnv",
)
