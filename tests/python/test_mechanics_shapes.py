"""Shapes and their distances from Python."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import numpy as np
import pytest
from bodies import BALL, CORNER, RADIUS, SHAPES

import ruffini
from ruffini import Shape, TetMesh
from ruffini._schema import SHAPES as KINDS
from ruffini.commands.press import touching_height
from ruffini.commands.shapes import shape as parsed


@pytest.mark.parametrize("name", SHAPES)
def test_the_normal_is_the_slope_of_the_distance(name):
    shape, step = SHAPES[name], 1e-8
    points = np.random.default_rng(0).normal(0.0, 6e-3, (200, 3))
    values, normals = shape.distance(points)
    assert values.shape == (200,) and normals.shape == (200, 3)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
    ahead = [shape.distance(points + step * axis)[0] for axis in np.eye(3)]
    slopes = (np.stack(ahead, axis=1) - values[:, None]) / step
    # Where the nearest surface point jumps within the step there is no slope; that is rare.
    wrong = np.abs(slopes - normals).max(axis=1) > 1e-3
    assert wrong.mean() < 0.05, f"{wrong.sum()} of 200 slopes differ"


def test_distances_of_a_ball_and_a_box_are_exact():
    points = np.array([[0.0, 0.0, 6e-3], [0.0, 3e-3, 0.0]])
    assert np.allclose(BALL.distance(points)[0], [2e-3, -1e-3], atol=1e-15)
    values, normals = SHAPES["cuboid"].distance([[2e-3, 3e-3, 3e-3], [0.9e-3, 0, 0]])
    assert np.allclose(values, [np.sqrt(2) * 1e-3, -1e-4], atol=1e-15)
    assert np.allclose(normals, [[np.sqrt(0.5), np.sqrt(0.5), 0], [1, 0, 0]], atol=1e-12)


def test_rounded_edges_are_as_round_as_asked_for():
    half, radius = np.array([1e-3, 2e-3, 3e-3]), 4e-4
    rounded = SHAPES["rounded cuboid"]
    corner = half - radius * (1 - np.sqrt(1 / 3))
    values, normals = rounded.distance([half, corner, [0.0, 0.0, 3e-3]])
    assert np.allclose(values, [(np.sqrt(3) - 1) * radius, 0.0, 0.0], atol=1e-15)
    assert np.allclose(normals, [[np.sqrt(1 / 3)] * 3] * 2 + [[0, 0, 1]], atol=1e-9)
    vertices, _ = rounded.surface()
    assert np.allclose(np.abs(rounded.distance(vertices)[0]), 0.0, atol=1e-12)
    assert np.allclose([vertices.min(axis=0), vertices.max(axis=0)], [-half, half], atol=1e-12)


def test_edges_that_cannot_be_rounded_are_refused():
    with pytest.raises(ValueError, match=r"edge_radius: found 0\.001 m, expected less than half"):
        SHAPES["cuboid"].rounded(1e-3)
    with pytest.raises(ValueError, match="found sphere, expected a cuboid, cylinder, cone"):
        BALL.rounded(1e-3)
    with pytest.raises(ValueError, match="found solid with rounded edges"):
        SHAPES["rounded cup"].rounded(1e-4)


def test_rounded_shapes_are_written_with_a_second_colon():
    points = np.random.default_rng(2).normal(0.0, 6e-3, (50, 3))
    written = parsed("cuboid:0.001,0.002,0.003:0.0004").distance(points)
    assert np.array_equal(written[0], SHAPES["rounded cuboid"].distance(points)[0])
    with pytest.raises(ValueError, match="edge radius: found wide"):
        parsed("cuboid:0.001,0.002,0.003:wide")


@pytest.mark.parametrize("name", KINDS)
def test_each_kind_of_shape_has_its_method_and_is_read_from_words(name):
    make, lengths = getattr(Shape, name.replace("-", "_")), dict(KINDS[name]["lengths"])
    assert list(inspect.signature(make).parameters) == list(lengths)
    numbers = [n for given in lengths.values() for n in (given if type(given) is list else [given])]
    written = parsed(f"{name}:{','.join(map(str, numbers))}")
    points = np.random.default_rng(3).normal(0.0, 0.02, (50, 3))
    assert np.array_equal(written.distance(points)[0], make(**lengths).distance(points)[0])
    if KINDS[name]["has_edges"]:
        assert make(**lengths).rounded(1e-3).distance(points)[0].shape == (50,)
    else:
        with pytest.raises(ValueError, match=f"found {name}"):
            make(**lengths).rounded(1e-3)


def test_the_page_of_objects_has_every_kind_of_shape_with_its_lengths():
    page = (Path(__file__).parents[2] / "py/docs/object.md").read_text()
    table = page.split("| shape | lengths |\n| --- | --- |\n")[1].split("\n\n")[0]
    rows = (row.strip("| ").split(" | ") for row in table.splitlines())
    listed = {
        name: re.findall(r"`(\w+)`", lengths)
        for names, lengths in rows
        for name in re.findall(r"`([\w-]+)`", names)
    }
    assert listed == {
        name: [length for length, _ in kind["lengths"]] for name, kind in KINDS.items()
    }


def test_a_surface_file_is_the_shape_of_its_arrays(tmp_path):
    file = tmp_path / "corner.obj"
    file.write_text("v 0 0 0\nv 5 0 0\nv 0 5 0\nv 0 0 5\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    points = np.random.default_rng(1).normal(0.0, 6e-3, (50, 3))
    read = Shape.read(file, scale=1e-3).distance(points)
    assert np.allclose(read[0], SHAPES["mesh"].distance(points)[0], atol=1e-15)


def test_a_shape_is_filled_to_its_volume():
    mesh = TetMesh.of_shape(BALL, 5e-4)
    a, b, c, d = np.moveaxis(mesh.vertices[mesh.tets], 1, 0)
    volume = np.einsum("ij,ij->", np.cross(b - a, c - a), d - a) / 6
    # Facets of one spacing lie inside the ball by about spacing^2 / 8 R, 0.2 % of the radius.
    assert 0.98 < volume / (4 / 3 * np.pi * RADIUS**3) < 1.0


def test_the_first_touch_is_found():
    vertices = ruffini.sensor("gelsight-mini", resolution=400).mesh.vertices
    # Those that meet the apex first touch it with their lowest point; their z points down.
    heights = {"sphere": 4e-3, "half_space": 0.0, "cone": 2e-3, "prism": 2e-3, "capsule": 4e-3}
    for name, height in heights.items():
        found = touching_height(SHAPES[name], vertices)
        assert abs(found - height) < 1e-7, f"{name}: {found} m against {height} m"
    hollow = touching_height(SHAPES["annulus"], vertices)
    assert 1.9e-3 < hollow < 2e-3, f"{hollow} m: the hole is over the apex, which stands out"
    beside = Shape.mesh(np.array([[1, 0, 0], [2, 0, 0], [1, 1, 0], [1, 0, 1]]) * 0.1, CORNER)
    with pytest.raises(ValueError, match="beside the pad"):
        touching_height(beside, vertices)
