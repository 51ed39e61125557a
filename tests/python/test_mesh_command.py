"""`ruffini mesh`: whether a mesh can be an object, and its repair."""

from __future__ import annotations

import re
import sys

import gymnasium
import numpy as np
import pytest

from ruffini import Shape
from ruffini.commands import main

trimesh = pytest.importorskip("trimesh")


@pytest.fixture
def box():
    return trimesh.creation.box((0.03, 0.03, 0.04))


def test_a_closed_mesh_is_summed_up_and_millimetres_are_noticed(box, tmp_path, capsys):
    good, large = tmp_path / "good.stl", tmp_path / "large.stl"
    box.export(good)
    assert main(["mesh", str(good)]) == 0
    assert "30 x 30 x 40 mm" in capsys.readouterr().out
    box.apply_scale(1000).export(large)
    assert main(["mesh", str(large), "--scale", "0.001"]) == 0
    assert "30 x 30 x 40 mm" in capsys.readouterr().out
    with pytest.raises(ValueError, match=r"mesh size: found .*millimetres needs the scale 0.001"):
        Shape.read(large)


@pytest.mark.parametrize(
    ("size", "scale", "hint"),
    [
        (0.04, 1.0, None),
        (0.29, 1.0, None),
        (0.0004, 1.0, None),
        (0.5, 1.0, "likely inches: with --scale 0.0254 its longest edge is 12.7 mm"),
        (2.0, 1.0, "likely inches: with --scale 0.0254 its longest edge is 50.8 mm"),
        (6.0, 1.0, "likely centimetres: with --scale 0.01 its longest edge is 60 mm"),
        (40.0, 1.0, "likely millimetres: with --scale 0.001 its longest edge is 40 mm"),
        (40.0, 0.01, "likely millimetres: with --scale 0.001 its longest edge is 40 mm"),
        (0.05, 0.001, "likely metres: with --scale 1 its longest edge is 50 mm"),
        (2000.0, 1.0, "a file in millimetres needs the scale 0.001, one in centimetres 0.01"),
    ],
)
def test_the_likely_unit_of_a_file_is_named(size, scale, hint, tmp_path, capsys):
    file = tmp_path / "part.stl"
    trimesh.creation.box((0.75 * size, 0.75 * size, size)).export(file)
    status = main(["mesh", str(file), "--scale", str(scale)])
    said = capsys.readouterr()
    refused = status == 2 and "environments refuse it as it is" in said.err
    if status == 0 or refused:
        assert refused == (0.75 * size * scale > 0.08 or size * scale < 0.002)
        units = [line for line in said.out.splitlines() if line.startswith("unit")]
        assert units == ([] if hint is None else [f"{'unit':<12} {hint}"])
    else:
        assert size * scale > 0.99 or size * scale < 1e-4
        assert said.err.startswith("ruffini: mesh size: found ")
        assert said.err.endswith(f"; {hint}\n")


def test_a_hole_is_closed(box, tmp_path, capsys):
    broken, mended = tmp_path / "broken.stl", tmp_path / "mended.stl"
    faces = box.faces[1:].copy()
    faces[3] = faces[3][::-1]
    trimesh.Trimesh(box.vertices, faces, process=False).export(broken)
    assert main(["mesh", str(broken)]) == 2
    assert "not watertight" in capsys.readouterr().err
    assert main(["mesh", str(broken), "--repair", str(mended)]) == 0
    assert "holes closed: 1 triangles more" in capsys.readouterr().out
    assert abs(trimesh.load(mended, force="mesh").volume / 3.6e-5 - 1) < 1e-5


def test_what_cannot_be_mended_is_refused(box, tmp_path, capsys):
    broken, mended = tmp_path / "broken.stl", tmp_path / "mended.stl"
    ball = trimesh.creation.icosphere(3, 0.02)
    ball.update_faces(ball.triangles_center[:, 2] > 0)
    ball.export(broken)
    assert main(["mesh", str(broken), "--repair", str(mended)]) == 2
    assert "not watertight after repair" in capsys.readouterr().err
    assert not mended.exists()
    assert main(["mesh", str(broken), "--repair", "mended.ply"]) == 2


def test_without_trimesh_one_line_says_what_to_install(box, tmp_path, monkeypatch, capsys):
    file, mended = tmp_path / "part.stl", tmp_path / "mended.stl"
    box.export(file)
    monkeypatch.setitem(sys.modules, "trimesh", None)
    assert main(["mesh", str(file), "--repair", str(mended)]) == 2
    said = capsys.readouterr().err
    assert said == 'ruffini: this command needs trimesh: pip install "ruffini[mesh]"\n'


@pytest.mark.parametrize(
    "solid",
    [
        trimesh.creation.icosphere(subdivisions=5, radius=0.025),
        trimesh.creation.cylinder(0.02, 0.05, sections=1024),
    ],
    ids=["ball", "can"],
)
def test_a_finely_meshed_round_solid_is_an_object(solid, tmp_path, capsys):
    file = tmp_path / "round.stl"
    solid.export(file)
    assert main(["mesh", str(file)]) == 0
    assert f"{len(solid.faces)}, closed\n" in capsys.readouterr().out
    env = gymnasium.make("ruffini/GraspLift-v0", objects=str(file), size=1, tactile="none")
    env.reset(seed=0)
    height = env.unwrapped.look()["object_position"][2]
    for _ in range(10):
        env.step(np.zeros(5, dtype=np.float32))
    assert abs(env.unwrapped.look()["object_position"][2] - height) < 2e-4, "it rests"


def test_what_the_environments_refuse_is_refused(tmp_path, capsys):
    file = tmp_path / "torus.stl"
    trimesh.creation.torus(0.02, 0.008, major_sections=160, minor_sections=160).export(file)
    assert main(["mesh", str(file)]) == 2
    refused = capsys.readouterr().err
    assert f"mesh {file}: 51200 triangles, expected at most 20000" in refused
    assert "simplify_quadric_decimation(face_count=20000)" in refused
    with pytest.raises(ValueError, match="51200 triangles") as error:
        gymnasium.make("ruffini/GraspLift-v0", objects=str(file), size=1, tactile="none")
    assert refused == f"ruffini: {error.value}\n"


def test_a_file_of_too_many_triangles_is_told_what_to_do(tmp_path, capsys):
    file = tmp_path / "scan.stl"
    trimesh.creation.torus(0.02, 0.008, major_sections=260, minor_sections=200).export(file)
    assert main(["mesh", str(file)]) == 2
    refused = capsys.readouterr().err
    assert f"mesh {file}: 104000 triangles, expected 4 to 100000; simplify it" in refused


CAN = trimesh.creation.cylinder(0.02, 0.05, sections=64)
BOX = trimesh.creation.box((0.02, 0.03, 0.04))
TIP = trimesh.transformations.rotation_matrix(np.radians(40), (1, 0, 0))


@pytest.mark.parametrize(
    ("solid", "said"),
    [
        (
            CAN,
            r"lies on its side, unlike in the file: .* points down, z 90° .*; \S+ mm high, 50 mm",
        ),
        (BOX, None),
        (BOX.copy().apply_transform(TIP), r"leans|lies on its side"),
        (trimesh.creation.icosphere(subdivisions=3, radius=0.02), r"leans, .* 40 mm in the file"),
    ],
    ids=["can", "box", "tilted box", "ball that stands on a facet"],
)
def test_the_side_that_is_down_at_rest_is_told_if_it_is_another_one(solid, said, tmp_path, capsys):
    file = tmp_path / "part.stl"
    solid.export(file)
    assert main(["mesh", str(file)]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("at rest")]
    assert len(lines) == (said is not None)
    env = gymnasium.make("ruffini/GraspLift-v0", objects=str(file), size=1, tactile="none")
    env.reset(seed=0)
    object_z = env.unwrapped.look()["object_position"][2]
    if said:
        assert re.search(said, lines[0]), lines
        high = float(re.search(r"(\S+) mm high", lines[0])[1])
        assert high == pytest.approx(2e3 * object_z, abs=0.05)
    else:
        assert 2 * object_z == pytest.approx(solid.extents[2], abs=1e-4)


def test_triangles_that_face_inwards_are_told(box, tmp_path, capsys):
    file = tmp_path / "inverted.stl"
    box.invert()
    box.export(file)
    assert main(["mesh", str(file)]) == 0
    said = capsys.readouterr().out
    assert "36 cm³" in said
    assert "-36" not in said
    assert "12, closed; all face inwards, and are turned as it is read" in said


def test_the_size_that_fits_the_gripper_is_named(tmp_path, capsys):
    file = tmp_path / "wide.stl"
    trimesh.creation.box((0.1, 0.12, 0.1)).export(file)
    assert main(["mesh", str(file)]) == 2
    said = capsys.readouterr().err
    assert "refuse it as it is; 100 mm across its narrowest side" in said
    assert "give size below 0.80" in said


@pytest.mark.parametrize(
    ("extents", "said"),
    [
        (
            (0.0004, 0.0004, 0.0004),
            "0.36 mm along its longest side at size 0.9, expected 2 mm",
        ),
        ((0.075, 0.09, 0.075), "75 mm across its narrowest side.*: give size below 1.07"),
        ((0.0005, 0.0005, 0.0023), None),
    ],
)
def test_it_passes_what_the_environments_take(extents, said, tmp_path, capsys):
    file = tmp_path / "part.stl"
    trimesh.creation.box(extents).export(file)
    assert main(["mesh", str(file)]) == (0 if said is None else 2)
    if said is None:
        gymnasium.make("ruffini/GraspLift-v0", objects=str(file), tactile="none").close()
        return
    assert re.search(said, capsys.readouterr().err)
    with pytest.raises(ValueError, match=r"along its longest side|across its narrowest side"):
        gymnasium.make("ruffini/GraspLift-v0", objects=str(file), tactile="none")


def test_every_reason_is_told_with_the_scale(tmp_path, capsys):
    file = tmp_path / "far.stl"
    trimesh.creation.box((100, 120, 100)).apply_translation([90, 0, 0]).export(file)
    assert main(["mesh", str(file), "--scale", "0.001"]) == 2
    said = capsys.readouterr().err
    assert "give size below 0.80; its origin is beside its middle: objects={" in said
    assert '"scale": 0.001, "centred": True}' in said


def test_parts_and_an_origin_beside_the_middle_are_told(tmp_path, capsys):
    file = tmp_path / "two.stl"
    boxes = [
        trimesh.creation.box((0.01, 0.01, 0.01)).apply_translation([x, 0, 0]) for x in (0, 0.02)
    ]
    trimesh.util.concatenate(boxes).export(file)
    assert main(["mesh", str(file)]) == 2
    said = capsys.readouterr()
    assert "24, closed, 2 separate parts" in said.out
    assert "its origin is beside its middle: objects={" in said.err


def test_a_file_that_is_not_there_is_said_to_be_missing(capsys):
    for words in (["mesh"], ["press", "--sensor", "digit", "--depth", "1e-4", "--shape"]):
        assert main([*words, "none.obj"]) == 2
        assert capsys.readouterr().err.startswith("ruffini: none.obj: No such file or dir")


def test_random_bytes_are_no_stl_file(tmp_path, capsys):
    file = tmp_path / "junk.stl"
    file.write_bytes(np.random.default_rng(0).bytes(5000))
    assert main(["mesh", str(file)]) == 2
    assert "junk.stl: no .stl file, or one cut short" in capsys.readouterr().err
