from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

__version__: str
OBJECTS: list[str]
CHANNELS: list[str]
REWARD_TERMS: list[str]
ENDINGS: list[str]

class SimulationError(RuntimeError): ...

Floats: TypeAlias = NDArray[np.float32]
Bools: TypeAlias = NDArray[np.bool_]
Component: TypeAlias = tuple[str, list[float], list[float], str]
StepResult: TypeAlias = tuple[
    Floats,
    NDArray[np.float64],
    Bools,
    Bools,
    NDArray[np.float64],
    Bools,
    NDArray[np.uint8],
    list[tuple[int, Floats]],
]

class Batch:
    def __new__(
        cls, settings: str, num_envs: int, num_threads: int, autoreset: str
    ) -> Batch: ...
    def layout(self) -> list[tuple[str, list[Component]]]: ...
    def reset(self, seeds: list[int | None] | None, mask: Bools | None) -> Floats: ...
    def step(self, actions: Floats) -> StepResult: ...
    def save(self) -> list[bytes]: ...
    def load(self, states: list[bytes]) -> Floats: ...
    def look(self, row: int) -> dict[str, Any] | None: ...
    def render(self, row: int, width: int, height: int) -> NDArray[np.uint8]: ...

def default_settings() -> str: ...
