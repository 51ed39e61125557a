"""Bad input to soft-body mechanics, and the documentation of its API."""

from __future__ import annotations

import errno
import inspect
import math
from pathlib import Path

import numpy as np
import pytest
from bodies import BALL, PLATE, UPRIGHT, ball_at, block, gel

import ruffini
from ruffini import (
    Compliance,
    Fem,
    Grasp,
    History,
    LinearPad,
    Press,
    Shape,
    SoftBody,
    Surrogate,
    TetMesh,
)

MESH = block(1)
POSE = ball_at(0, 0)
NAN = float("nan")
DOUBLE = (POSE[0], (0, 0, 0, 2))
PAIRS = [(POSE, POSE)]
CUP = next(thing for thing in ruffini.objects() if thing.family == "cup")
REFUSED = {
    "vertices: found array (2,)": lambda: TetMesh([1.0, 2.0], []),
    "numbers (…, 3)": lambda: TetMesh(np.zeros((4, 2)), [[0, 1, 2, 3]]),
    "vertices: found NaN": lambda: TetMesh(np.full((4, 3), NAN), [[0, 1, 2, 3]]),
    "of <U1, expected numbers": lambda: TetMesh([["a", "b", "c"]], [[0, 1, 2, 3]]),
    "of object, expected numbers": lambda: TetMesh([[None] * 3], [[0, 1, 2, 3]]),
    "of complex128": lambda: TetMesh([[1j, 0, 0]], [[0, 1, 2, 3]]),
    "inhomogeneous": lambda: TetMesh([[1.0], [1.0, 2.0]], [[0, 1, 2, 3]]),
    "of float64, expected integers": lambda: TetMesh(np.eye(3), [[0.0, 1.0, 2.0, 3.0]]),
    "tets: found -1": lambda: TetMesh(np.eye(3), [[0, 1, 2, -1]]),
    "tetrahedron 0 uses vertex 3": lambda: TetMesh(np.eye(3), [[0, 1, 2, 3]]),
    "expected a name in .tet or .msh": lambda: TetMesh.read("mesh.vtu"),
    "a half-space": lambda: TetMesh.of_shape(PLATE, 1e-3),
    "for vertices or": lambda: MESH.write("mesh.vtu", {"a": np.zeros(3)}),
    "field a: found one number": lambda: MESH.write("mesh.vtu", {"a": 1.0}),
    "field a: found inf": lambda: MESH.write("mesh.vtu", {"a": np.full(len(MESH.tets), math.inf)}),
    "field: found NaN": lambda: MESH.at([[0, 0, 0]], np.full(len(MESH.tets), NAN)),
    "field name: found a<b": lambda: MESH.write("mesh.vtu", {"a<b": np.zeros(len(MESH.tets))}),
    ".vtu or .npz": lambda: MESH.write("mesh.txt"),
    "young: found 2 of them": lambda: SoftBody(MESH, [1e5, 1e5], 0.3),
    "young: found -1": lambda: SoftBody(MESH, -1.0, 0.3),
    "poisson: found 0.5": lambda: SoftBody(MESH, 1e5, 0.5),
    "law: found hookean": lambda: SoftBody(MESH, 1e5, 0.3, law="hookean"),
    "fixed: found 99": lambda: SoftBody(MESH, 1e5, 0.3, fixed=[99]),
    "fixed: found array (2, 1)": lambda: SoftBody(MESH, 1e5, 0.3, fixed=[[0], [1]]),
    "fixed: found array (1,) of bool, expected integers (…,), or booleans (18,)": lambda: SoftBody(
        MESH, 1e5, 0.3, fixed=[True]
    ),
    "fixed: found array (18, 1) of bool": lambda: SoftBody(
        MESH, 1e5, 0.3, fixed=np.ones((18, 1), bool)
    ),
    "fixed: found array (18,) of float64": lambda: SoftBody(MESH, 1e5, 0.3, fixed=np.ones(18)),
    "gelsight-mini, digit": lambda: ruffini.sensor("gelsight"),
    "tacflex, feats": lambda: ruffini.sensor("gelsight-mini", calibration="soft"),
    "resolution: found -1, expected 100 to 200000": lambda: ruffini.sensor("digit", resolution=-1),
    "resolution: found 10, expected 100 to": lambda: ruffini.sensor("digit", resolution=10),
    "resolution: found 11, expected 100 to": lambda: LinearPad("digit", resolution=11),
    "resolution: found -2, expected 100 to": lambda: LinearPad("digit", resolution=-2),
    "young: found NaN": lambda: LinearPad(young=NAN),
    "poisson: found NaN": lambda: Surrogate(poisson=NAN),
    "friction: found NaN": lambda: LinearPad(friction=NAN),
    "corrections: found -1, expected 0 to 12": lambda: Compliance(gel(), corrections=-1),
    "corrections: found 13, expected 0 to 12": lambda: Compliance(gel(), corrections=13),
    "around: found array (3,)": lambda: ruffini.sensor("digit", around=[0, 0, 0]),
    "around: found 0": lambda: ruffini.sensor("digit", around=np.zeros((0, 3))),
    "around: found a press with a force": lambda: ruffini.sensor(
        "digit", around=Press(BALL, pose=ball_at(0, 0), force=1.0, direction=(0, 0, -1))
    ),
    "around: found a press that does not reach": lambda: ruffini.sensor(
        "digit", around=Press(BALL, [ball_at(0, -1e-2)])
    ),
    "for a pad of this size": lambda: ruffini.sensor("digit", resolution=200, around=[[0, 0, 0]]),
    "radius: found -1": lambda: Shape.sphere(-1.0),
    "half_extents: found one number": lambda: Shape.cuboid(1e-3),
    "sides: found -3, expected 3 to 256": lambda: Shape.prism(-3, 1e-3, 1e-3),
    "not watertight": lambda: Shape.mesh(np.eye(3) * 1e-3, [[0, 1, 2]]),
    "points: found array (3,)": lambda: BALL.distance([0, 0, 0]),
    "shapes: found none": lambda: Press([], [[]]),
    "shapes: found <class 'str'>": lambda: Press("sphere", [POSE]),
    "path: found no frames": lambda: Press(BALL, []),
    "path: found <class 'int'>": lambda: Press(BALL, 3),
    "path[0]: position: found array (2,)": lambda: Press(BALL, [((0, 0), UPRIGHT)]),
    "path[1]: quaternion: found length 2": lambda: Press(BALL, [POSE, DOUBLE]),
    "path[0]: quaternion: found length 0": lambda: Press(BALL, [((0, 0, 0), (0, 0, 0, 0))]),
    "found length 1.0002, expected length 1 ± 0.0001": lambda: Press(
        BALL, [((0, 0, 0), (0, 0, 0, 1.0002))]
    ),
    "path[0]: position: found NaN": lambda: Press(BALL, [((0, 0, NAN), UPRIGHT)]),
    "one for each of 2 shapes": lambda: Press([BALL, BALL], [POSE]),
    "press: found []": lambda: Press(BALL),
    "press: found [path, force]": lambda: Press(BALL, POSE, force=1.0),
    "press: found [pose]": lambda: Press(BALL, pose=POSE),
    "force: found -1": lambda: Press(BALL, POSE, force=-1.0, direction=(0, 0, -1)),
    "direction: found [0.0, 0.0, 0.0], expected a vector with a length": lambda: Press(
        BALL, POSE, force=1.0, direction=(0, 0, 0)
    ),
    "history: found 3 bytes": lambda: History(b"abc"),
    "friction: found -1": lambda: Fem(gel(), friction=-1.0),
    "tolerance: found 0": lambda: Fem(gel(), tolerance=0.0),
    "element: found p3": lambda: Fem(gel(), element="p3"),
    "presses: found <class 'int'>": lambda: Fem(gel()).solve(3),
    "presses: found <class 'ruffini.Shape'>": lambda: Fem(gel()).solve([BALL]),
    "path: found no frames, expected at least one": lambda: Grasp(BALL, []),
    "expected a list of poses of two pads": lambda: Grasp(BALL, 3),
    "path[0]: found <class 'int'>, expected poses of two pads": lambda: Grasp(BALL, [3]),
    "path[0][1]: position: found array (2,)": lambda: Grasp(BALL, [(POSE, ((0, 0), UPRIGHT))]),
    "path[0][0]: quaternion: found length 2": lambda: Grasp(BALL, [(DOUBLE, POSE)]),
    "start: position: found NaN": lambda: Grasp(BALL, PAIRS, start=((0, 0, NAN), UPRIGHT)),
    "load: found array (3,)": lambda: Grasp(BALL, PAIRS, load=(0, 0, 1)),
    "load: found inf": lambda: Grasp(BALL, PAIRS, load=(0, 0, 0, 0, 0, math.inf)),
    "seed: found -1": lambda: ruffini.objects(-1),
    "segments: found 4, expected 8 to 200": lambda: CUP.surface(4),
    "spacing: found": lambda: CUP.tets(-1.0),
    "count: found -1": lambda: CUP.grasps(-1, 0),
    "seed: found 0.5": lambda: CUP.grasps(1, 0.5),
    "friction: found 0": lambda: CUP.grasps(1, 0, friction=0.0),
    "apart: found NaN": lambda: CUP.grasps(1, 0)[0].pads(NAN),
}


@pytest.mark.parametrize("text", REFUSED)
def test_bad_input_is_refused_with_what_was_found(text):
    with pytest.raises(ValueError) as refusal:
        REFUSED[text]()
    assert text in str(refusal.value)


MISSING = {
    "none.obj": Shape.read,
    "none.stl": Shape.read,
    "none.tet": TetMesh.read,
    "none.msh": TetMesh.read,
    "none.toml": ruffini.sensor,
    "none.safetensors": ruffini.Surrogate.load,
    "none/manifest.json": lambda file: ruffini.dataset.open(Path(file).parent),
    "no/weights.safetensors": ruffini.PaperNetwork.load,
}


@pytest.mark.parametrize("file", MISSING)
def test_a_file_that_is_not_there_is_named_as_by_open(file):
    with pytest.raises(FileNotFoundError, match="No such file or directory") as raised:
        MISSING[file](file)
    assert (raised.value.filename, raised.value.errno) == (file, errno.ENOENT)
    assert file in str(raised.value)


def test_quaternions_in_single_precision_are_taken_and_normalised():
    x, y, z = np.float32([0.005, 0.01, 0.015])
    w = np.float32(math.sqrt(1 - x * x - y * y - z * z))
    turn = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
    chained = np.float32([0, 0, 0, 1])
    for _ in range(300):
        chained = turn @ chained
    length = np.linalg.norm(chained.astype(float))
    assert chained.dtype == np.float32 and 1e-6 < abs(length - 1) < 1e-4, length
    [(_, found)] = Press(BALL, [((0, 0, 0), chained)]).path
    assert np.allclose(found, chained / length, atol=1e-12)


def test_fixed_nodes_are_numbers_or_a_mask():
    held = MESH.vertices[:, 2] < -3.9e-3
    by_mask, by_number = (
        SoftBody(MESH, 1e5, 0.3, fixed=f).fixed for f in (held, held.nonzero()[0])
    )
    assert 0 < len(by_mask) < len(held) and (by_mask == by_number).all()
    assert len(SoftBody(MESH, 1e5, 0.3, fixed=[]).fixed) == 0


def test_fields_may_have_no_value_in_places(tmp_path):
    values = np.arange(len(MESH.tets), dtype=float)
    values[3] = NAN
    for file in (tmp_path / "mesh.npz", tmp_path / "mesh.vtu"):
        MESH.write(file, {"a": values})
    with np.load(tmp_path / "mesh.npz") as read:
        assert np.array_equal(read["a"], values, equal_nan=True)


NAMES = [name for name in ruffini.__all__ if inspect.isclass(getattr(ruffini, name))]


@pytest.mark.parametrize("name", NAMES)
def test_the_whole_api_is_documented(name):
    parts = vars(getattr(ruffini, name))
    documented = {part: inspect.getdoc(value) for part, value in parts.items() if part[0] != "_"}
    assert inspect.getdoc(getattr(ruffini, name))
    assert all(documented.values()), [part for part, text in documented.items() if not text]
