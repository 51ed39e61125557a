"""Grasping with soft tactile fingertips: vectorised Gymnasium environments, soft-body mechanics.

Rigid shapes press a soft body (`SoftBody`, or the gel pad of a `sensor`): a `Press` of a `Shape`. A
model returns the `Deformation`: `Fem`, finite elements, `Compliance`, fast and linear, or
`Surrogate`, a network that corrects the linear solution. `PaperNetwork` is a network that uses no
linear solution and outputs no forces. Two pads hold one of the `objects` in a `Grasp`. Lengths are
in m, forces in N, stresses in Pa. In the shell, `ruffini press` solves one press.

Importing registers the environments; from a worker process use the prefix form,
``gymnasium.make("ruffini:ruffini/GraspLift-v0")``.
"""

import importlib
from typing import TYPE_CHECKING, Any

from gymnasium.envs.registration import register

from ruffini._core import (
    OBJECTS,
    Antipodal,
    Compliance,
    Deformation,
    Fem,
    Grasp,
    Grasped,
    History,
    LinearPad,
    Object,
    PaperAnswer,
    PaperNetwork,
    Press,
    PressError,
    Shape,
    SimulationError,
    Skin,
    SoftBody,
    SoftSurrogate,
    Surrogate,
    TetMesh,
    Transfer,
    __version__,
    objects,
    sensor,
)
from ruffini._errors import relative_error
from ruffini._plot import plot
from ruffini._schema import CHANNELS, REWARD_TERMS, TACTILE_CHANNELS, TASKS
from ruffini._trained_gels import OutsideTrainingWarning

__all__ = [
    "CHANNELS",
    "OBJECTS",
    "REWARD_TERMS",
    "TACTILE_CHANNELS",
    "TASKS",
    "Antipodal",
    "Compliance",
    "Deformation",
    "Fem",
    "Grasp",
    "Grasped",
    "History",
    "LinearPad",
    "Object",
    "OutsideTrainingWarning",
    "PaperAnswer",
    "PaperNetwork",
    "Press",
    "PressError",
    "Shape",
    "SimulationError",
    "Skin",
    "SoftBody",
    "SoftSurrogate",
    "Surrogate",
    "TetMesh",
    "Transfer",
    "__version__",
    "objects",
    "plot",
    "relative_error",
    "sensor",
]

for _name, _task in TASKS.items():
    register(
        id=f"ruffini/{_name}-v0",
        entry_point=f"ruffini.envs:{_name}Env",
        vector_entry_point=f"ruffini.envs:{_name}VectorEnv",
        max_episode_steps=_task["max_episode_steps"],
    )

_MODULES = (
    "agents",
    "custom",
    "dataset",
    "envs",
    "evaluation",
    "policies",
    "sb3",
    "surrogate",
    "video",
)
"""Modules that are imported at first use: environments need none of them."""

if TYPE_CHECKING:
    from ruffini import agents as agents
    from ruffini import custom as custom
    from ruffini import dataset as dataset
    from ruffini import envs as envs
    from ruffini import evaluation as evaluation
    from ruffini import policies as policies
    from ruffini import sb3 as sb3
    from ruffini import surrogate as surrogate
    from ruffini import video as video
else:

    def __getattr__(name: str) -> Any:
        """Import a module of the package."""
        if name in _MODULES:
            return importlib.import_module(f"ruffini.{name}")
        raise AttributeError(f"module 'ruffini' has no attribute {name!r}")

    def __dir__() -> list[str]:
        """Names of the package, its modules included."""
        return sorted({*globals(), *_MODULES})
