"""Datasets of solved grasps and presses: generation, and reading frame by frame.

V vertices and T tetrahedra of the mesh that fields are stored on; SI units. A pose is a position
and a quaternion (x, y, z, w), 7 numbers. Reading needs ``pip install "ruffini[data]"``.
"""

from __future__ import annotations

import hashlib
import json
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate, product
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini import _distributions
from ruffini._core import TetMesh, dataset_shards, estimate_dataset, generate_dataset
from ruffini._errors import apart
from ruffini._frames import HOME, Body, Finger, Frame, Pad, PressFrame, SoftFrame
from ruffini._settings import plain, read_json
from ruffini._words import counted, nearest

__all__ = [
    "Body",
    "Dataset",
    "Estimate",
    "Finger",
    "Frame",
    "Pad",
    "PressFrame",
    "Progress",
    "SoftFrame",
    "TruthError",
    "estimate",
    "generate",
    "open",
    "shards",
    "truth_errors",
]

FORMATS = (1, 2)
"""Readable versions of a dataset's files; version 2 is written."""
_SIDES = ("first", "second")
_OF_A_PAD = ("wrench", "press", "pose")
_OF_A_MANIFEST = {"config": dict, "shards": list, "splits": dict, "unsolved": list}


@dataclass(frozen=True)
class Progress:
    """Progress of a generation."""

    done: int
    """Grasps done, those of earlier calls included."""
    all: int
    """Grasps to do."""
    frames: int
    """Frames solved in this call."""
    unsolved: int
    """Grasps that ended early in this call."""
    seconds: float
    """Wall time of this call (s)."""
    bytes: int
    """Size of the whole dataset if no grasp ends early."""


@dataclass(frozen=True)
class Estimate:
    """Size and cost of a dataset, or of what is missing of one."""

    grasps: int
    """Grasps to solve."""
    frames: int
    """Frames of these grasps if none ends early."""
    bytes: int
    """Their size on disk."""
    seconds: float
    """Processor time (s), right to a factor of about two."""


def estimate(
    folder: str | PathLike[str], config: str | PathLike[str] | None = None, **settings: Any
) -> Estimate:
    """Estimate what `generate` with the same arguments has to do; nothing is written.

    Raises:
        ValueError: If a setting is invalid.
    """
    return Estimate(*estimate_dataset(folder, config, json.dumps(settings, default=plain)))


def generate(
    folder: str | PathLike[str],
    config: str | PathLike[str] | None = None,
    *,
    threads: int | None = None,
    commit: str = "",
    shards: Sequence[str] | None = None,
    watch: Callable[[Progress], bool] | None = None,
    **settings: Any,
) -> Dataset | None:
    """Generate a dataset, or the missing part of one; return ``None`` if it is not finished.

    If the process is killed, only the grasps being solved are lost; the next call continues.

    Args:
        folder: Folder of the dataset; one that holds another dataset is an error.
        config: A TOML file; values that it does not set have their defaults.
        threads: Threads to solve on; ``None`` takes one per core.
        commit: Commit of this library, recorded in the manifest.
        shards: Names of the shards to generate, from function `shards`, as the part of one of
            several processes; no manifest is written. A first call with an empty list creates the
            folder, a last call without this argument writes the manifest.
        watch: Called from another thread before the first grasp and after each; stops the
            generation if it returns false, after the grasps being solved. Ctrl-C ends these at
            once; the next call solves them anew.
        settings: Settings that replace those of the file: ``objects=2, grasps=1``. ``object`` lists
            meshes of one's own, each one more object beside the drawn ones:
            ``object=[{"mesh": "mug.obj", "scale": 0.001}]``, if need be with ``"centred": True``
            and with ``"grasps"`` of its own. In a TOML file, where they are ``[[object]]``, paths
            are relative to that file. The dataset has copies of the meshes in ``meshes``.

    Raises:
        ValueError: If a setting or a mesh is invalid, a shard is not part of the dataset, or the
            folder holds another dataset or cannot be written.
    """
    if threads is not None and threads < 1:
        raise ValueError(f"threads: found {threads}, expected 1 or more")

    def ask(*progress: Any) -> bool:
        return watch is None or watch(Progress(*progress))

    overrides = json.dumps(settings, default=plain)
    finished = generate_dataset(folder, config, overrides, commit, threads or 0, shards, ask)
    return Dataset(folder) if finished else None


def shards(config: str | PathLike[str] | None = None, **settings: Any) -> list[str]:
    """Names of the shards of the dataset that `generate` makes with the same arguments.

    Raises:
        ValueError: If a setting is invalid.
    """
    return dataset_shards(config, json.dumps(settings, default=plain))


STILL = 1e-6
"""Root mean square displacement below which relative errors of a frame mean nothing (m)."""


@dataclass(frozen=True)
class TruthError:
    """Difference of a frame of a dataset from the same frame on a finer mesh, relative L²."""

    grasp: str
    """Name of the grasp or press."""
    number: int
    """Number of the frame."""
    displacement: float
    """Of the displacement of the vertices."""
    stress: float
    """Of the von Mises stress of the tetrahedra."""
    force: float
    """Of the force of the object on the pad."""


def truth_errors(
    folder: str | PathLike[str],
    finer: str | PathLike[str],
    *,
    sample: int = 14,
    threads: int | None = None,
    commit: str = "",
    watch: Callable[[Progress], bool] | None = None,
    **settings: Any,
) -> list[TruthError]:
    """Solve some shards of a dataset of pads again on a finer mesh, and compare.

    Args:
        folder: A finished dataset of soft pads.
        finer: Folder for what is solved again; what is in it already is kept.
        sample: Shards to solve, spread evenly over those of the dataset.
        threads: Threads to solve on; ``None`` takes one per core.
        commit: Commit of this library, recorded in that folder's manifest.
        watch: As that of `generate`.
        settings: What is finer: ``truth_nodes=4000``, for presses also ``truth_across=16``.

    Returns:
        The frames that both hold, without those that hardly move the gel; if ``watch`` stops it,
        those so far.

    Raises:
        ValueError: If the objects of the dataset are soft, no setting is finer, or one is invalid.
    """
    coarse = Dataset(folder)
    if coarse.soft:
        raise ValueError(f"{folder}: found soft objects, expected soft pads: meshes would differ")
    usual: dict[str, Any] = {"truth_across": 8.0} | coarse.manifest["config"]
    if not any(settings.get(name, 0) > usual[name] for name in ("truth_nodes", "truth_across")):
        expected = "truth_nodes or truth_across above those of the dataset"
        raise ValueError(f"settings: found {settings or 'none'}, expected {expected}")
    files = sorted({grasp[0] for grasp in coarse._grasps})
    step = max(len(files) / max(sample, 1), 1.0)
    chosen = [files[int(step * (i + 0.5))] for i in range(min(sample, len(files)))]
    overrides = {k: v for k, v in usual.items() if k not in ("format", "version")} | settings
    if own := usual.get("object"):
        meshes = coarse.path / "meshes"
        overrides["object"] = [mesh | {"mesh": meshes / mesh["mesh"]} for mesh in own]
    generate(finer, threads=threads, commit=commit, shards=chosen, watch=watch, **overrides)
    sides = ["first"] if coarse.presses else list(_SIDES)
    found = []
    for file in chosen:
        if not (Path(finer) / file).exists():
            continue
        old, new = (Dataset._open_in(Path(place), file) for place in (folder, finer))
        for entry in json.loads(new.metadata()["grasps"]):
            name = entry["plan"]["name"]
            frames = min(int(e["frames"]) for e in (entry, _entry(old, name)))
            for number, side in product(range(frames), sides):
                pair = [_fields(tensors, name, side, number) for tensors in (old, new)]
                if np.sqrt((pair[1][0] ** 2).sum(axis=1).mean()) > STILL:
                    errors = [apart(a, b) for a, b in zip(*pair, strict=True)]
                    found.append(TruthError(name, number, *errors))
    return found


def _entry(tensors: Any, grasp: str) -> dict[str, Any]:
    """Entry of a grasp in the metadata of a shard."""
    entries = json.loads(tensors.metadata()["grasps"])
    [entry] = [entry for entry in entries if entry["plan"]["name"] == grasp]
    return dict(entry)


def _fields(tensors: Any, grasp: str, side: str, number: int) -> list[NDArray[np.float64]]:
    """Displacement, stress and force of a frame of a pad."""
    prefix = f"{_number(grasp)}.{side}"
    rows = [
        tensors.get_slice(f"{prefix}.{field}")[number : number + 1][0].astype(float)
        for field in ("displacement", "von_mises", "wrench")
    ]
    return [*rows[:2], rows[2][:3]]


class Dataset:
    """A finished dataset: a sequence of frames, grasp by grasp.

    Attributes:
        path: Its folder.
        manifest: Configuration, shards, unsolved grasps and objects with few grasps.
        splits: Names of the grasps for "train", "validation" and "test", by split.
        soft: Whether the objects are soft and the fingers rigid, so that frames are `SoftFrame`.
        presses: Whether one pad is pressed by indenters, so that frames are `PressFrame`.
        grasps: Names of the grasps with at least one frame, in the order of their frames.
    """

    path: Path
    manifest: dict[str, Any]
    splits: dict[str, dict[str, list[str]]]
    soft: bool
    presses: bool
    grasps: list[str]

    def __init__(self, path: str | PathLike[str]):
        self.path = Path(path)
        self.manifest = _manifest(self.path)
        scenario = self.manifest["config"].get("scenario")
        self.soft, self.presses = scenario == "soft", scenario == "presses"
        self.splits = self.manifest["splits"]
        shards = self.manifest["shards"]
        self._grasps = [(shard["file"], grasp) for shard in shards for grasp in shard["grasps"]]
        counts = (int(grasp["frames"]) for _, grasp in self._grasps)
        self._starts = list(accumulate(counts, initial=0))
        self.grasps = [grasp["name"] for _, grasp in self._grasps]
        self._numbers = {name: i for i, name in enumerate(self.grasps)}
        self._tensors = lru_cache(maxsize=32)(self._open)

    def __len__(self) -> int:
        return self._starts[-1]

    def __getitem__(self, index: int) -> Frame | SoftFrame | PressFrame:
        if not hasattr(index, "__index__"):
            raise TypeError(f"frame: found {index!r}, expected a whole number")
        place = index + len(self) if index < 0 else index
        if not 0 <= place < len(self):
            raise IndexError(f"frame: found {index}, expected less than {len(self)}")
        number = bisect_right(self._starts, place) - 1
        file, grasp = self._grasps[number]
        self._tensors(file)
        with _reading(self.path / file):
            return self._frame(file, grasp, place - self._starts[number])

    def __iter__(self) -> Iterator[Frame | SoftFrame | PressFrame]:
        return (self[index] for index in range(len(self)))

    def __reduce__(self) -> tuple[type[Dataset], tuple[Path]]:
        return Dataset, (self.path,)

    def _number_of(self, grasp: str) -> int:
        """Place of a grasp in `grasps`; a ``KeyError`` that names the nearest if there is none."""
        if grasp not in self._numbers:
            near, of = nearest(grasp, self.grasps), counted(len(self.grasps), "grasp")
            raise KeyError(f"grasp: found {grasp!r}{near} expected a name of `grasps`, of {of}")
        return self._numbers[grasp]

    def frames(self, grasp: str) -> range:
        """Indices of a grasp's frames.

        Raises:
            KeyError: If there is no such grasp.
        """
        number = self._number_of(grasp)
        return range(self._starts[number], self._starts[number + 1])

    def gel(self, grasp: str) -> int:
        """Number of the gel of a grasp.

        Raises:
            KeyError: If there is no such grasp.
        """
        _, found = self._grasps[self._number_of(grasp)]
        return int(found["gel"])

    def column(self, grasp: str, field: str) -> NDArray[Any]:
        """A field of all frames of a grasp (F, ...), such as ``force`` or ``first.von_mises``.

        Raises:
            KeyError: If there is no such grasp.
            ValueError: If there is no such field.
        """
        column: NDArray[Any] = self._slice(grasp, field)[:]
        return column

    def _slice(self, grasp: str, field: str) -> Any:
        """A field of all frames of a grasp, of which nothing is read yet."""
        from safetensors import SafetensorError

        file, _ = self._grasps[self._number_of(grasp)]
        tensors, prefix = self._tensors(file), f"{_number(grasp)}."
        try:
            return tensors.get_slice(prefix + field)
        except SafetensorError:
            own = filter(lambda name: name.startswith(prefix), tensors.keys())
            known = sorted(name.removeprefix(prefix) for name in own)
            if field in known:
                raise
            expected = f"one of {', '.join(known)}"
            hint = f"field: found {field!r}{nearest(field, known)} expected {expected}"
            raise ValueError(hint) from None

    def export(self, index: int, path: str | PathLike[str]) -> list[Path]:
        """Write a frame's fields on their meshes; see `Frame.write`.

        Raises:
            IndexError: If there is no such frame.
            ValueError: If the file is no .vtu or .npz or cannot be written.
        """
        frame = self[index]
        return frame.write(path, self.mesh(frame.grasp))

    def plot(self, path: str | PathLike[str]) -> None:
        """Plot the distributions of depth, force, shear and stress to a .png or .svg file.

        Raises:
            ValueError: If no grasp is solved, or the file has another ending or cannot be written.
        """
        _distributions.draw(self, path)

    def mesh(self, grasp: str | int) -> TetMesh:
        """Mesh on which a grasp's fields are stored; for pads, a gel's number selects it, too.

        Raises:
            KeyError: If there is no such grasp.
            IndexError: If there is no such gel.
        """
        return self._mesh(self._mesh_file(grasp))

    def plan(self, grasp: str) -> dict[str, Any]:
        """Drawn parameters of a grasp: ``tool``, ``width``, ``force``, ``shear``, ``twist``, ...

        Raises:
            KeyError: If there is no such grasp.
        """
        file, _ = self._grasps[self._number_of(grasp)]
        return dict(_entry(self._tensors(file), grasp)["plan"])

    def defects(self) -> list[str]:
        """Files that are missing, truncated, damaged, foreign or hold NaN, one line each."""
        listed = {shard["file"]: shard for shard in self.manifest["shards"]}
        own = {f"meshes/{of['mesh']}": of for of in self.manifest["config"].get("object", [])}
        lying = {f"shards/{path.name}" for path in (self.path / "shards").glob("*")}
        found = [f"{self.path / file}: not of this dataset" for file in sorted(lying - {*listed})]
        found += self._without_hash()
        for file, shard in listed.items():
            path = self.path / file
            if file not in lying:
                found.append(f"{path}: missing")
                continue
            data = path.read_bytes()
            if len(data) < shard["bytes"]:
                found.append(f"{path}: truncated, {len(data)} of {shard['bytes']} bytes")
            elif (digest := hashlib.sha256(data).hexdigest()) != shard["sha256"]:
                found.append(f"{path}: damaged, SHA-256 {digest}, expected {shard['sha256']}")
            elif name := _not_finite(self._tensors(file)):
                found.append(f"{path}: {name} holds NaN or infinite numbers")
        for file, mesh in own.items():
            path = self.path / file
            if not path.is_file():
                found.append(f"{path}: missing")
            elif hashlib.sha256(path.read_bytes()).hexdigest() != mesh["sha256"]:
                found.append(f"{path}: damaged, expected SHA-256 {mesh['sha256']}")
        return found

    def _without_hash(self) -> list[str]:
        """Defects of the configuration and of the meshes of gels or soft objects."""
        found, file = [], self.path / "config.json"
        try:
            config = read_json(file)
            if {**config, "format": None} != {**self.manifest["config"], "format": None}:
                found.append(f"{file}: not the configuration of manifest.json")
        except ValueError as error:
            found.append(str(error))
        for mesh in dict.fromkeys(map(self._mesh_file, self.grasps)):
            try:
                if name := _not_finite(self._tensors(mesh)):
                    found.append(f"{self.path / mesh}: {name} holds NaN or infinite numbers")
                self._mesh(mesh)
            except (OSError, ValueError) as error:
                found.append(str(error))
        return found

    def verify(self) -> None:
        """Check shards and meshes against their hashes, and that numbers are finite.

        Raises:
            ValueError: If there are `defects`; it names the files.
        """
        if found := self.defects():
            raise ValueError("\n  ".join([f"{self.path}: {counted(len(found), 'defect')}", *found]))

    def _open(self, file: str) -> Any:
        return self._open_in(self.path, file)

    @staticmethod
    def _open_in(folder: Path, file: str) -> Any:
        try:
            from safetensors import safe_open
        except ImportError as error:
            text = 'datasets are read with safetensors: pip install "ruffini[data]"'
            raise ImportError(text) from error
        with _reading(folder / file):
            return safe_open(folder / file, framework="numpy")

    def _mesh(self, file: str) -> TetMesh:
        tensors = self._tensors(file)
        with _reading(self.path / file, ValueError):
            return TetMesh(tensors.get_tensor("vertices"), tensors.get_tensor("tets"))

    def _mesh_file(self, grasp: str | int) -> str:
        """File of a grasp's, or a gel's, mesh."""
        if self.soft:
            name = self.grasps[self._number_of(str(grasp))].split("/")[0]
            return f"meshes/{name}.safetensors"
        gel = self.gel(grasp) if isinstance(grasp, str) else grasp
        count = len(self.manifest["config"]["gels"])
        if not 0 <= gel < count:
            raise IndexError(f"gel: found {gel}, expected less than {count}")
        folder = "gels" if self.manifest["format"] == 1 else "meshes"
        return f"{folder}/{gel}.safetensors"

    def _frame(
        self, file: str, grasp: dict[str, Any], number: int
    ) -> Frame | SoftFrame | PressFrame:
        tensors, name = self._tensors(file), grasp["name"]

        def row(field: str) -> Any:
            return tensors.get_slice(f"{_number(name)}.{field}")[number : number + 1][0]

        def body(part: str) -> dict[str, Any]:
            fields = ("displacement", "von_mises", "contact_force")
            arrays = {field: row(f"{part}.{field}") for field in fields}
            report = {
                "residual": float(row(f"{part}.residual")),
                "iterations": int(row(f"{part}.iterations")),
            }
            if self.presses:
                anchors = np.empty((0, 2, 3), dtype=np.float32)
            else:
                anchors = self._anchors(name, part, number)
            return {**arrays, **report, "anchors": anchors}

        def rigid(part: str, *fields: str) -> dict[str, Any]:
            return {field: row(f"{part}.{field}") for field in fields}

        common: dict[str, Any] = {"grasp": name, "number": number, "gel": grasp["gel"]}
        if self.presses:
            pad = Pad(**body("first"), **rigid("first", "wrench", "press"), pose=HOME.copy())
            return PressFrame(**common, pad=pad)
        common |= {field: float(row(field)) for field in ("force", "closing")}
        if self.soft:
            first, second = (Finger(**rigid(side, "wrench", "pose")) for side in _SIDES)
            moved = {"motion": row("motion"), "deviation": float(row("deviation"))}
            return SoftFrame(**common, **moved, body=Body(**body("body")), fingers=(first, second))
        left, right = (Pad(**body(side), **rigid(side, *_OF_A_PAD)) for side in _SIDES)
        load = row("load") if self.manifest["config"].get("density") else np.zeros(6)
        common |= {"residual": float(row("residual")), "load": load}
        return Frame(**common, object=row("object"), pads=(left, right))

    def _anchors(self, grasp: str, part: str, number: int) -> NDArray[np.float32]:
        counts = self.column(grasp, f"{part}.anchors").astype(int)
        own = slice(int(counts[:number].sum()), int(counts[: number + 1].sum()))
        place = self._slice(grasp, f"{part}.anchor_place")[own]
        if self.manifest["format"] == 1:
            rest = self._slice(grasp, f"{part}.anchor_rest")[own]
        else:
            points = self._slice(grasp, f"{part}.anchor_point")[own]
            file = self._mesh_file(grasp)
            tensors = self._tensors(file)
            with _reading(self.path / file, IndexError):
                rest = tensors.get_tensor("contact_points")[points]
        return np.stack([rest, place], axis=1).astype(np.float32)


def open(path: str | PathLike[str]) -> Dataset:
    """Open the finished dataset in a folder.

    Raises:
        FileNotFoundError: If there is none.
        ValueError: If its manifest is damaged, or of a later version.
    """
    return Dataset(path)


@contextmanager
def _reading(path: Path, *errors: type[Exception]) -> Iterator[None]:
    """Raise a ``ValueError`` that names the file for what safetensors raises, and `errors`."""
    from safetensors import SafetensorError

    kinds: tuple[type[Exception], ...] = (SafetensorError, *errors)
    try:
        yield
    except kinds as error:
        raise ValueError(f"{path}: damaged, {error}") from None


def _not_finite(tensors: Any) -> str | None:
    """Name of a tensor with numbers that are not finite, if there is one."""
    for name in tensors.keys():  # noqa: SIM118, what is open is no dictionary
        values = tensors.get_tensor(name)
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            return str(name)
    return None


def _number(grasp: str) -> str:
    """Prefix of the names of a grasp's tensors."""
    return grasp.rsplit("/", 1)[1]


def _manifest(folder: Path) -> dict[str, Any]:
    path = folder / "manifest.json"
    try:
        manifest = read_json(path)
    except FileNotFoundError as error:
        expected = "a finished dataset"
        if (folder / "config.json").exists():
            expected += "; the `ruffini dataset generate` that began it, given again, finishes it"
        text = f"{error.strerror}, expected {expected}"
        raise FileNotFoundError(error.errno, text, str(path)) from None
    for name, kind in _OF_A_MANIFEST.items():
        if not isinstance(manifest.get(name), kind):
            raise ValueError(f"{path}: damaged, found no {name}")
    if manifest.setdefault("format", 1) not in FORMATS:
        expected = " or ".join(map(str, FORMATS))
        raise ValueError(f"{path}: found format {manifest['format']}, expected {expected}")
    return manifest
