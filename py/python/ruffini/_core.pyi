from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "CHANNELS",
    "ENDINGS",
    "OBJECTS",
    "REWARD_TERMS",
    "Batch",
    "SimulationError",
    "__version__",
    "default_settings",
]

__version__: str
OBJECTS: list[str]
CHANNELS: list[str]
REWARD_TERMS: list[str]
ENDINGS: list[str]

class SimulationError(RuntimeError): ...

_Floats: TypeAlias = NDArray[np.float32]
_Bools: TypeAlias = NDArray[np.bool_]
_Component: TypeAlias = tuple[str, list[float], list[float], str]
_StepResult: TypeAlias = tuple[
    _Floats,
    NDArray[np.float64],
    _Bools,
    _Bools,
    NDArray[np.float64],
    _Bools,
    NDArray[np.uint8],
    list[tuple[int, _Floats]],
]

@final
class Batch:
    def __new__(cls, settings: str, num_envs: int, num_threads: int, autoreset: str) -> Batch: ...
    def layout(self) -> list[tuple[str, list[_Component]]]: ...
    def reset(self, seeds: list[int | None] | None, mask: _Bools | None) -> _Floats: ...
    def step(self, actions: _Floats) -> _StepResult: ...
    def save(self) -> list[bytes]: ...
    def load(self, states: list[bytes]) -> _Floats: ...
    def look(self, row: int) -> dict[str, Any] | None: ...
    def render(self, row: int, width: int, height: int) -> NDArray[np.uint8]: ...

def default_settings() -> str: ...
