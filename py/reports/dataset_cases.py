"""Cases of the dataset's report: cost, interrupted generation, the truth's own error, contents."""

from __future__ import annotations

import hashlib
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import ruffini
from engine import ROOT
from meshes import difference, nodal, volumes
from ruffini import Fem, Grasp, PressError, SoftBody, _distributions, dataset
from ruffini._frames import Frame

sys.path.append(str(ROOT / "tests/python"))
from test_dataset_kills import MAKE, killed_and_resumed

OPEN = 2e-5
"""Opening at which a repeated grasp begins (m): pads of another mesh touch elsewhere."""


def cost(truth: int, model: int, threads: int, counts: dict) -> dict:
    """Wall and CPU seconds and bytes of a dataset's frames, by nodes of the truth and the model."""
    settings = {"truth_nodes": truth, "model_nodes": model, "truth_element": "p1-bar", **counts}
    with tempfile.TemporaryDirectory() as folder:
        wall, cpu = time.perf_counter(), time.process_time()
        data = dataset.generate(folder, threads=threads, **settings)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        size = sum(path.stat().st_size for path in Path(folder).glob("shards/*"))
    found = {"truth": truth, "model": model, "threads": threads, "frames": len(data)}
    found |= {"unsolved": len(data.manifest["unsolved"])}
    return found | {"wall": wall, "cpu": cpu, "bytes": size}


def judged(folder: Path, grasp: str, sizes: dict) -> list[dict]:
    """Rows of a grasp of a dataset: how far it is on some meshes from the same on the finest."""
    again = Again(dataset.open(folder), grasp, sizes["every"])
    try:
        truth, price = again.solved(*sizes["finest"])
        failed = {}
    except PressError as error:
        failed = {"failed": f"on the finest mesh: {error}"}
    rows = []
    for element, nodes in sizes["rungs"]:
        row = {"key": key(grasp, element, nodes), "grasp": grasp, "element": element}
        row |= {"nodes": nodes, "depths": again.depths}
        try:
            if not failed:
                row["finest"] = price
                fields, own = again.solved(element, nodes)
                row |= own | {"errors": errors(fields, truth, again.common)}
        except PressError as error:
            row["failed"] = str(error)
        rows.append(row | failed)
    return rows


def key(grasp: str, element: str, nodes: int) -> str:
    """Key of a row of the truth."""
    return f"truth {grasp} {element} {nodes}"


def disturbed(kills: int) -> dict:
    """Compares the bytes of a small dataset with those of a second one, and of one often killed."""
    with tempfile.TemporaryDirectory() as root:
        once, twice, killed = (Path(root, name) for name in ("once", "twice", "killed"))
        times = []
        for folder in (once, twice):
            begun = time.monotonic()
            subprocess.run([*MAKE, str(folder)], check=True)
            times.append(time.monotonic() - begun)
        killed_and_resumed(killed, kills, min(times), random.Random(kills))
        whole, again, resumed = map(hashes, (once, twice, killed))
    return {"kills": kills, "files": len(whole), "twice": again == whole, "same": resumed == whole}


def hashes(folder: Path) -> dict[str, str]:
    """SHA-256 of every file by its path within the folder."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    read = {str(path.relative_to(folder)): path.read_bytes() for path in files}
    return {name: hashlib.sha256(data).hexdigest() for name, data in read.items()}


class Again:
    """Frames of a grasp, one in so many, solved again at the same poses of the pads."""

    def __init__(self, data: dataset.Dataset, name: str, every: int):
        self.name = name
        self.gel = data.manifest["config"]["gels"][data.gel(name)]
        self.common = data.mesh(name)
        frames = [data[index] for index in data.frames(name)[every - 1 :: every]]
        self.depths = [frame.closing / np.ptp(self.common.vertices[:, 2]) for frame in frames]
        self._path = [opened(frames[0]), *(poses(frame) for frame in frames)]
        objects = {object.name: object for object in ruffini.objects()}
        self._shape = objects[name.split("/")[0]].shape

    def solved(self, element: str, nodes: int) -> tuple[list[dict], dict]:
        """Both pads' fields by frame, on the common mesh, and what they cost."""
        pad = ruffini.sensor(self.gel["sensor"], resolution=nodes)
        body = SoftBody(pad.mesh, self.gel["young"], self.gel["poisson"], fixed=pad.fixed)
        fem = Fem(body, friction=self.gel["friction"], element=element)
        begun = time.process_time()
        frames = Grasp(self._shape, self._path).solve((fem, fem))
        cpu = time.process_time() - begun
        if isinstance(frames[-1], PressError):
            raise frames[-1]
        fields = [carried(frame.pads, fem, self.common) for frame in frames[1:]]
        return fields, {"vertices": len(pad.mesh.vertices), "cpu": cpu / len(fields)}


def poses(frame: Frame) -> tuple:
    """Poses of the pads."""
    first, second = ((pad.pose[:3], pad.pose[3:]) for pad in frame.pads)
    return first, second


def opened(frame: Frame) -> tuple:
    """Poses of the pads before they touched: back along the line between them."""
    (first, turn), (second, other) = poses(frame)
    along = (second - first) / np.linalg.norm(second - first)
    back = (frame.closing + OPEN) * along
    return (first - back, turn), (second + back, other)


def carried(pads: tuple, fem: Fem, mesh: ruffini.TetMesh) -> dict:
    """Force (2,), displacement (2 V, 3) and stress (2 T,) of both pads on the common mesh."""
    moved, stress = zip(*(fem.carry(pad.history, mesh) for pad in pads), strict=True)
    return {
        "force": np.array([-pad.wrench[2] for pad in pads]),
        "u": np.concatenate(moved),
        "sigma": np.concatenate(stress),
    }


def errors(found: list[dict], truth: list[dict], mesh: ruffini.TetMesh) -> list[dict]:
    """Relative errors frame by frame: force, displacement, stress, peak stress."""
    tets, nodes = (np.tile(of, 2) for of in (volumes(mesh), nodal(mesh, volumes(mesh))))
    return [
        {
            "force": float(np.abs(a["force"] / b["force"] - 1).max()),
            "u": difference(a["u"], b["u"], nodes),
            "sigma": difference(a["sigma"], b["sigma"], tets),
            "peak": float(abs(a["sigma"].max() / b["sigma"].max() - 1)),
        }
        for a, b in zip(found, truth, strict=True)
    ]


def contents(folder: Path) -> dict:
    """Contents of a dataset: counts, unsolved grasps by reason, worst imbalance, quantiles."""
    data = dataset.open(folder)
    worst = {"contact": 0.0, "force": 0.0, "torque": 0.0}
    for frame in data:
        worst = {key: max(worst[key], value) for key, value in frame.imbalance().items()}
    manifest = data.manifest
    solved = {grasp["name"] for shard in manifest["shards"] for grasp in shard["grasps"]}
    lost = [grasp for grasp in manifest["unsolved"] if grasp["name"] not in solved]
    quantiles = {
        family: {key: np.quantile(of, (0, 0.5, 1)).tolist() for key, of in columns.items()}
        for family, columns in _distributions.by_family(data).items()
    }
    made_of = {key: manifest["config"][key] for key in ("objects", "grasps", "frames", "force")}
    return {
        "commit": manifest["commit"],
        "config": made_of | {"density": manifest["config"].get("density", 0.0)},
        "grasps": len(solved) + len(lost),
        "frames": len(data),
        "bytes": sum(shard["bytes"] for shard in manifest["shards"]),
        "approached": manifest.get("approached", False),
        "unsolved": len(manifest["unsolved"]),
        "reasons": dict(_distributions.reasons(data)),
        "imbalance": worst,
        "families": quantiles,
    }
