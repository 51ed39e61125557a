"""Soft objects squeezed by rigid fingers."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from tiny_dataset import TINY

from ruffini import dataset, objects
from ruffini._distributions import by_family

pytest.importorskip("safetensors")

GEL = {"sensor": "digit", "young": 1e5, "poisson": 0.45, "friction": 0.8, "share": 1.0}
SOFT = {**TINY, "scenario": "soft", "truth_nodes": 300, "gels": [GEL]}


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    data = dataset.generate(tmp_path_factory.mktemp("data") / "soft", threads=2, **SOFT)
    assert data is not None and data.manifest["unsolved"] == []
    return data


def test_the_strawberry_comes_first_and_every_frame_can_be_read(data):
    assert data.grasps == ["strawberry-1/000", "lemon-1/000"]
    assert len(data) == 4 and data.soft
    for frame in data:
        mesh = data.mesh(frame.grasp)
        assert len(mesh.vertices) <= SOFT["model_nodes"] < 1.5 * len(mesh.vertices)
        assert frame.body.displacement.shape == frame.body.contact_force.shape
        assert frame.body.displacement.shape == mesh.vertices.shape
        assert frame.body.von_mises.shape == (len(mesh.tets),)
        assert len(frame.body.anchors) > 0
    apart = [np.linalg.norm(np.subtract(*(finger.pose[:3] for finger in f.fingers))) for f in data]
    for before, after in ((0, 1), (2, 3)):
        closed = data[after].closing - data[before].closing
        # What the second finger shears aside counts in the second order only.
        assert apart[before] - apart[after] == pytest.approx(2 * closed, rel=0.02)
    assert data[1].force > data[0].force > 0


def test_every_frame_is_in_balance(data):
    for frame in data:
        off, pressed = frame.imbalance(), np.abs(frame.body.contact_force).sum()
        rounding = 6e-8 * pressed + 2e-7
        assert off["contact"] < rounding, f"{off['contact']} N against {rounding} N"
        # The solver's tolerance is 1e-7 N on the norm over all nodes, of which there are 300.
        assert off["force"] < 300**0.5 * 1e-7, f"{off['force']} N on the object"
        assert off["torque"] < 300**0.5 * 1e-7 * 0.05, f"{off['torque']} N m on the object"


def test_the_rigid_motion_is_that_of_the_nodes(data):
    for frame in data:
        rest, moved = data.mesh(frame.grasp).vertices, frame.body.displacement
        turned = (rest - rest.mean(axis=0)).T @ (moved + rest - (moved + rest).mean(axis=0))
        u, _, v = np.linalg.svd(turned)
        turn = v.T @ np.diag([1, 1, np.linalg.det(v.T @ u.T)]) @ u.T
        angle = np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))
        stored = 2 * np.arcsin(np.linalg.norm(frame.motion[3:6]))
        # The stored one is fitted to the truth's nodes, which are others.
        assert abs(angle - stored) < 0.15 * max(angle, stored) + 1e-3, f"{angle}, {stored} rad"
        assert 0 < frame.deviation < np.abs(moved).max()


def test_it_can_be_drawn_and_written(data, tmp_path):
    pytest.importorskip("matplotlib")
    for words in (["plot", "-o", "a.png"], ["export", "1", "a.npz"]):
        line = [sys.executable, "-m", "ruffini", "dataset", words[0], str(data.path), *words[1:]]
        subprocess.run(line, check=True, cwd=tmp_path)
    assert (tmp_path / "a.png").stat().st_size > 10_000
    written = np.load(tmp_path / "a.npz")
    assert np.array_equal(written["displacement"], data[1].body.displacement)
    assert list(by_family(data)) == ["strawberry", "lemon"]


def test_threads_change_no_byte(data, tmp_path):
    dataset.generate(tmp_path, threads=1, **SOFT)
    for path in data.path.rglob("*.*"):
        assert path.read_bytes() == (tmp_path / path.relative_to(data.path)).read_bytes(), path


def test_more_soft_objects_than_there_are_are_refused(tmp_path):
    with pytest.raises(ValueError, match="objects: found 65, expected 1 to 64"):
        dataset.generate(tmp_path / "none", **{**SOFT, "objects": 65})
    with pytest.raises(ValueError, match="hard"):
        dataset.generate(tmp_path / "none", **{**SOFT, "scenario": "hard"})


def test_an_unknown_first_object_is_told_the_nearest_and_all_names(tmp_path):
    with pytest.raises(ValueError, match=r"first: found cuip-2, did you mean 'cup-2'\?") as error:
        dataset.shards(**{**SOFT, "first": ["cuip-2"]})
    for thing in objects():
        assert thing.name in str(error.value)
