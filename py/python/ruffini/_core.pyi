from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "CAMERAS",
    "OBJECTS",
    "Antipodal",
    "Batch",
    "Compliance",
    "Deformation",
    "Fem",
    "Grasp",
    "Grasped",
    "History",
    "LinearPad",
    "Object",
    "PaperAnswer",
    "PaperNetwork",
    "Press",
    "PressError",
    "Shape",
    "SimulationError",
    "SoftBody",
    "SoftSurrogate",
    "Surrogate",
    "TetMesh",
    "Transfer",
    "__version__",
    "check_mesh",
    "dataset_shards",
    "encode_gif",
    "estimate_dataset",
    "evaluate_surrogate",
    "fit_foundation",
    "generate_dataset",
    "objects",
    "read_sensor",
    "read_tensors",
    "schema",
    "sensor",
    "sensor_names",
    "sensor_template",
    "solve_press",
    "train_surrogate",
    "write_tensors",
]

__version__: str
OBJECTS: list[str]
CAMERAS: list[str]

class SimulationError(RuntimeError): ...

class PressError(SimulationError):
    kind: Literal[
        "invalid",
        "setting",
        "bad-state",
        "bad-mesh",
        "file",
        "not-converged",
        "step-too-long",
        "inverted",
        "penetrated",
        "network",
        "unreachable",
        "no-trial",
        "not-held",
        "interrupted",
        "panicked",
    ]

_Floats: TypeAlias = NDArray[np.float32]
_Bools: TypeAlias = NDArray[np.bool_]
_Component: TypeAlias = tuple[str, list[float], list[float], str]
_Camera: TypeAlias = str | tuple[list[float], list[float], float]
_StepResult: TypeAlias = tuple[
    _Floats,
    NDArray[np.float64],
    _Bools,
    _Bools,
    NDArray[np.float64],
    _Bools,
    NDArray[np.uint8],
    list[tuple[int, _Floats]],
    list[tuple[int, str]],
]

@final
class Batch:
    def __new__(cls, settings: str, num_envs: int, num_threads: int, autoreset: str) -> Batch: ...
    def reward_terms(self) -> list[str]: ...
    def layout(self) -> list[tuple[str, list[_Component]]]: ...
    def reset(self, seeds: list[int | None] | None, mask: _Bools | None) -> _Floats: ...
    def step(self, actions: _Floats) -> _StepResult: ...
    def give(self, name: str, values: NDArray[np.float64]) -> None: ...
    def end(self, mask: _Bools) -> None: ...
    def save(self) -> list[bytes]: ...
    def load(self, states: list[bytes]) -> _Floats: ...
    def ended(self) -> _Bools: ...
    def plan(self, forget: bool) -> list[tuple[str, float, float]]: ...
    def skin(self) -> dict[str, NDArray[np.float64]] | None: ...
    def look(self, row: int) -> dict[str, Any] | None: ...
    def surfaces(self, row: int) -> dict[str, tuple[_Array, NDArray[np.uint32], _Array | None]]: ...
    def render(self, row: int, width: int, height: int, camera: _Camera) -> NDArray[np.uint8]: ...

def schema() -> str: ...
def check_mesh(path: _Path, scale: float) -> tuple[float, list[float], float]: ...
def encode_gif(frames: Sequence[NDArray[np.uint8]], delay: int) -> bytes: ...
def read_tensors(data: bytes) -> tuple[dict[str, NDArray[Any]], str]: ...
def write_tensors(tensors: Mapping[str, NDArray[Any]], card: str) -> bytes: ...

_Array: TypeAlias = NDArray[np.float64]
_Path: TypeAlias = str | PathLike[str]
_Pose: TypeAlias = tuple[ArrayLike, ArrayLike]
_Frame: TypeAlias = _Pose | Sequence[_Pose]
_Law: TypeAlias = Literal["neo-hookean", "stable-neo-hookean", "corotated", "linear"]
_Element: TypeAlias = Literal["p1", "p1-bar", "p2"]

@final
class TetMesh:
    def __new__(cls, vertices: ArrayLike, tets: ArrayLike) -> TetMesh: ...
    @staticmethod
    def read(path: _Path, scale: float = 1.0) -> TetMesh: ...
    @staticmethod
    def of_shape(shape: Shape, spacing: float) -> TetMesh: ...
    def write(self, path: _Path, fields: Mapping[str, ArrayLike] | None = None) -> None: ...
    def at(self, points: ArrayLike, field: ArrayLike) -> _Array: ...
    @property
    def vertices(self) -> _Array: ...
    @property
    def tets(self) -> NDArray[np.uint32]: ...

@final
class Transfer:
    def __new__(cls, source: TetMesh, target: TetMesh) -> Transfer: ...
    def interpolate(self, nodal: ArrayLike) -> _Array: ...
    def spread(self, forces: ArrayLike) -> _Array: ...
    def average(self, per_tet: ArrayLike) -> _Array: ...

@final
class SoftBody:
    def __new__(
        cls,
        mesh: TetMesh,
        young: ArrayLike,
        poisson: float,
        law: _Law = "neo-hookean",
        fixed: ArrayLike | None = None,
    ) -> SoftBody: ...
    @property
    def mesh(self) -> TetMesh: ...
    @property
    def fixed(self) -> NDArray[np.uint32]: ...
    @property
    def law(self) -> _Law: ...

@final
class Shape:
    @staticmethod
    def sphere(radius: float) -> Shape: ...
    @staticmethod
    def cuboid(half_extents: ArrayLike) -> Shape: ...
    @staticmethod
    def cylinder(radius: float, half_height: float) -> Shape: ...
    @staticmethod
    def capsule(radius: float, half_height: float) -> Shape: ...
    @staticmethod
    def cone(radius: float, half_height: float) -> Shape: ...
    @staticmethod
    def prism(sides: int, radius: float, half_height: float) -> Shape: ...
    @staticmethod
    def annulus(outer: float, inner: float, half_height: float) -> Shape: ...
    @staticmethod
    def ellipsoid(semi_axes: ArrayLike) -> Shape: ...
    @staticmethod
    def cup(bottom: float, rim: float, half_height: float, wall: float) -> Shape: ...
    @staticmethod
    def star_shaped(
        semi_axes: ArrayLike, waves: Sequence[tuple[float, ArrayLike, float]]
    ) -> Shape: ...
    @staticmethod
    def half_space() -> Shape: ...
    @staticmethod
    def mesh(vertices: ArrayLike, faces: ArrayLike) -> Shape: ...
    @staticmethod
    def read(path: _Path, scale: float = 1.0) -> Shape: ...
    @staticmethod
    def named(name: str) -> Shape: ...
    def rounded(self, radius: float) -> Shape: ...
    def surface(self, segments: int = 64) -> tuple[_Array, NDArray[np.uint32]]: ...
    def distance(self, points: ArrayLike) -> tuple[_Array, _Array]: ...

@final
class Press:
    def __new__(
        cls,
        shapes: Shape | Sequence[Shape],
        path: Sequence[_Frame] | _Frame | None = None,
        *,
        pose: _Frame | None = None,
        force: float | None = None,
        direction: ArrayLike | None = None,
        history: History | None = None,
    ) -> Press: ...

@final
class History:
    def __new__(cls, state: bytes) -> History: ...
    def __bytes__(self) -> bytes: ...
    def __reduce__(self) -> tuple[type[History], tuple[bytes]]: ...

@final
class Deformation:
    @property
    def displacement(self) -> _Array: ...
    @property
    def von_mises(self) -> _Array: ...
    @property
    def contact_force(self) -> _Array: ...
    @property
    def wrench(self) -> _Array: ...
    @property
    def sliding(self) -> float: ...
    @property
    def pose(self) -> Any: ...
    @property
    def history(self) -> History: ...
    @property
    def iterations(self) -> int: ...
    @property
    def residual(self) -> float: ...
    @property
    def seconds(self) -> float: ...
    @property
    def predicted_error(self) -> tuple[float, float, float] | None: ...

@final
class Fem:
    def __new__(
        cls,
        body: SoftBody,
        friction: float = 0.0,
        tolerance: float = 1e-7,
        element: _Element = "p1-bar",
    ) -> Fem: ...
    @property
    def body(self) -> SoftBody: ...
    def solve(self, presses: Press | Sequence[Press]) -> list[Deformation | PressError]: ...
    def solve_path(self, press: Press) -> list[Deformation | PressError]: ...
    def carry(self, history: History, target: TetMesh) -> tuple[_Array, _Array]: ...
    def stress(self, history: History) -> _Array: ...

@final
class Compliance:
    def __new__(
        cls,
        body: SoftBody,
        friction: float = 0.0,
        corrections: int = 0,
        cache: str | PathLike[str] | None = None,
        contact: str = "points",
    ) -> Compliance: ...
    @property
    def body(self) -> SoftBody: ...
    def solve(self, presses: Press | Sequence[Press]) -> list[Deformation | PressError]: ...
    def solve_path(self, press: Press) -> list[Deformation | PressError]: ...

@final
class LinearPad:
    def __new__(
        cls,
        sensor: str = "gelsight-mini",
        calibration: str | None = None,
        young: float | None = None,
        poisson: float | None = None,
        friction: float | None = None,
        resolution: int = 1000,
        contact: str = "fast",
    ) -> LinearPad: ...
    @property
    def body(self) -> SoftBody: ...
    def solve(self, presses: Press | Sequence[Press]) -> list[Deformation | PressError]: ...
    def solve_path(self, press: Press) -> list[Deformation | PressError]: ...

@final
class Surrogate:
    def __new__(
        cls,
        sensor: str = "gelsight-mini",
        calibration: str | None = None,
        young: float | None = None,
        poisson: float | None = None,
        friction: float | None = None,
    ) -> Surrogate: ...
    @staticmethod
    def load(
        path: str | PathLike[str],
        sensor: str = "gelsight-mini",
        calibration: str | None = None,
        young: float | None = None,
        poisson: float | None = None,
        friction: float | None = None,
    ) -> Surrogate: ...
    def plain(self) -> Surrogate: ...
    @property
    def body(self) -> SoftBody: ...
    @property
    def card(self) -> str: ...
    def solve(self, presses: Press | Sequence[Press]) -> list[Deformation | PressError]: ...
    def solve_path(self, press: Press) -> list[Deformation | PressError]: ...
    def is_in_distribution(self, answer: Deformation) -> bool: ...

@final
class SoftSurrogate:
    def __new__(
        cls,
        shape: Shape,
        young: float = 1e5,
        poisson: float = 0.45,
        friction: float = 0.8,
        weights: str = "soft",
    ) -> SoftSurrogate: ...
    @property
    def body(self) -> SoftBody: ...
    @property
    def card(self) -> str: ...
    def solve(self, presses: Press | Sequence[Press]) -> list[Deformation | PressError]: ...
    def solve_path(self, press: Press) -> list[Deformation | PressError]: ...
    def is_in_distribution(self, answer: Deformation) -> bool: ...

@final
class PaperAnswer:
    @property
    def displacement(self) -> _Array: ...
    @property
    def von_mises(self) -> _Array: ...
    @property
    def rigid(self) -> tuple[_Array, _Array] | None: ...
    @property
    def pose(self) -> tuple[_Array, _Array]: ...
    @property
    def seconds(self) -> float: ...

@final
class PaperNetwork:
    def __new__(
        cls,
        weights: str = "paper-b",
        sensor: str = "gelsight-mini",
        calibration: str | None = None,
        young: float | None = None,
        poisson: float | None = None,
        friction: float | None = None,
    ) -> PaperNetwork: ...
    @staticmethod
    def load(
        path: str | PathLike[str],
        sensor: str = "gelsight-mini",
        calibration: str | None = None,
        young: float | None = None,
        poisson: float | None = None,
        friction: float | None = None,
    ) -> PaperNetwork: ...
    @property
    def body(self) -> SoftBody: ...
    @property
    def card(self) -> str: ...
    def solve(self, presses: Press | Sequence[Press]) -> list[PaperAnswer | PressError]: ...
    def solve_path(self, press: Press) -> list[PaperAnswer | PressError]: ...
    def is_in_distribution(self, answer: PaperAnswer) -> bool: ...

def sensor(
    name: str,
    calibration: str | None = None,
    resolution: int | None = None,
    around: ArrayLike | Press | None = None,
) -> SoftBody: ...

@final
class Grasp:
    def __new__(
        cls,
        object: Shape,
        path: Sequence[tuple[_Pose, _Pose]],
        start: _Pose | None = None,
        load: ArrayLike | None = None,
    ) -> Grasp: ...
    def solve(self, pads: tuple[Fem, Fem]) -> list[Grasped | PressError]: ...

@final
class Grasped:
    @property
    def pads(self) -> tuple[Deformation, Deformation]: ...
    @property
    def object(self) -> tuple[_Array, _Array]: ...
    @property
    def residual(self) -> float: ...
    @property
    def seconds(self) -> float: ...

@final
class Object:
    @property
    def name(self) -> str: ...
    @property
    def family(self) -> str: ...
    @property
    def split(self) -> Literal["train", "novel", "soft"]: ...
    @property
    def seed(self) -> int: ...
    @property
    def shape(self) -> Shape: ...
    def surface(self, segments: int = 64) -> tuple[_Array, NDArray[np.uint32]]: ...
    def tets(self, spacing: float) -> TetMesh: ...
    def grasps(self, count: int, seed: int, friction: float = 0.5) -> list[Antipodal]: ...

@final
class Antipodal:
    @property
    def tool(self) -> tuple[_Array, _Array]: ...
    @property
    def width(self) -> float: ...
    @property
    def angle(self) -> float: ...
    @property
    def quality(self) -> float: ...
    def pads(self, apart: float) -> tuple[tuple[_Array, _Array], tuple[_Array, _Array]]: ...

def objects(seed: int = 0) -> list[Object]: ...
def sensor_names() -> list[str]: ...
def sensor_template() -> str: ...
def read_sensor(name: str) -> str: ...
def fit_foundation(name: str, calibration: str, nodes: int) -> str: ...
def estimate_dataset(
    folder: _Path, config: _Path | None, overrides: str
) -> tuple[int, int, int, float]: ...
def dataset_shards(config: _Path | None, overrides: str) -> list[str]: ...
def generate_dataset(
    folder: _Path,
    config: _Path | None,
    overrides: str,
    commit: str,
    threads: int,
    only: Sequence[str] | None,
    watch: Callable[[int, int, int, int, float, int], bool],
) -> bool: ...
def solve_press(
    config: _Path | None, overrides: str, shape: Shape, path: Sequence[_Pose]
) -> list[tuple[_Array, _Array, _Array] | PressError]: ...
def train_surrogate(
    data: _Path,
    coarser: _Path | None,
    out: _Path,
    variant: str,
    settings: str,
    commit: str,
    clock: Callable[[], float],
    watch: Callable[[str, str], bool],
) -> str | None: ...
def evaluate_surrogate(
    weights: _Path, data: _Path, split: str, coarser: bool
) -> list[tuple[str, str, str | None]]: ...
