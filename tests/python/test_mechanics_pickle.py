"""Copies and pickles of what presses are made of, and of answers."""

from __future__ import annotations

import copy
import multiprocessing
import pickle

import numpy as np
import pytest
from bodies import BALL, SHAPES, ball_at, block, gel

import ruffini
from ruffini import Fem, Grasp, Press, Shape, SoftBody, Surrogate

COPIES = [
    copy.copy,
    copy.deepcopy,
    *(lambda one, n=n: pickle.loads(pickle.dumps(one, n)) for n in range(2, 6)),
]
NAMED = {name: Shape.named(name) for name in ruffini.OBJECTS}
TURNED = ((1e-3, 0.0, 3.7e-3), np.array([1.0, 2.0, 3.0, 40.0]) / np.sqrt(1614))


def same(one, other) -> bool:
    """Return whether two answers have the same bits."""
    names = (name for name in vars(type(one)) if name[0] != "_" and name != "history")
    pairs = [(getattr(one, name), getattr(other, name)) for name in names]
    return bytes(one.history) == bytes(other.history) and all(
        pickle.dumps(found) == pickle.dumps(expected) for found, expected in pairs
    )


@pytest.mark.parametrize("name", [*SHAPES, *NAMED])
def test_copies_of_shapes_have_the_same_distances(name):
    shape = (SHAPES | NAMED)[name]
    points = np.random.default_rng(0).normal(0.0, 1e-2, (100, 3))
    expected = shape.distance(points)
    for copied in (make(shape) for make in COPIES):
        for found, value in zip(copied.distance(points), expected, strict=True):
            assert np.array_equal(found, value)
        assert repr(copied) == repr(shape)


def test_copies_of_objects_of_the_catalogue_have_the_same_distances():
    points = np.random.default_rng(0).normal(0.0, 3e-2, (20, 3))
    for thing in ruffini.objects():
        found = pickle.loads(pickle.dumps(thing.shape)).distance(points)
        assert np.array_equal(found[0], thing.shape.distance(points)[0]), thing.name


def test_bytes_that_are_no_shape_are_refused():
    with pytest.raises(ValueError, match="shape: found 3 bytes without its mark"):
        Shape._restore(b"abc")


def test_copies_of_bodies_have_the_same_nodes_and_moduli():
    tets = len(block().tets)
    for body in (
        gel(),
        gel(law="linear", young=np.linspace(1e5, 2e5, tets) ** 1.01),
        SoftBody(block(), 1e5, 0.3),
        ruffini.sensor("gelsight-mini", resolution=300),
        ruffini.sensor("digit", resolution=700, around=[[1e-3, 0, 0]]),
    ):
        for copied in (make(body) for make in COPIES):
            assert np.array_equal(copied.mesh.vertices, body.mesh.vertices)
            assert np.array_equal(copied.mesh.tets, body.mesh.tets)
            assert np.array_equal(copied.fixed, body.fixed)
            assert np.array_equal(copied.young, body.young)
            assert (copied.poisson, copied.law) == (body.poisson, body.law)


def test_copies_of_presses_and_bodies_have_the_same_answers():
    fem = Fem(gel(), friction=0.5)
    first = fem.solve(Press(BALL, [ball_at(0, 2e-4)]))[0]
    for press in (
        Press(BALL, [TURNED, ball_at(1e-4, 3e-4)], history=first.history),
        Press(SHAPES["rounded cuboid"], pose=((0, 0, 3.1e-3), TURNED[1]), force=0.3,
              direction=(0.1, 0.2, -3)),
        Press([BALL, SHAPES["mesh"]], [[ball_at(-2e-3, 2e-4), ((2e-3, 0, -1e-4), TURNED[1])]]),
    ):  # fmt: skip
        expected = fem.solve(press)[0]
        for copied in (make(press) for make in COPIES):
            assert repr(copied) == repr(press)
            found = Fem(copy.deepcopy(fem.body), friction=0.5).solve(copied)[0]
            assert not isinstance(found, ruffini.PressError), found
            assert np.array_equal(found.displacement, expected.displacement)
            assert np.array_equal(found.wrench, expected.wrench)
            assert pickle.dumps(found.pose) == pickle.dumps(expected.pose)


def test_copies_of_answers_are_the_same():
    network = Surrogate()
    for depth in (5e-4, 3e-3):
        [answer] = network.solve(Press(BALL, [ball_at(0, depth)]))
        for copied in (make(answer) for make in COPIES):
            assert same(copied, answer)
            assert network.is_in_distribution(copied) == network.is_in_distribution(answer)
    away = network.solve(Press(BALL, [ball_at(0, -1e-4)]))[0]
    assert network.is_in_distribution(pickle.loads(pickle.dumps(away)))


def test_answers_of_a_press_share_its_shape_in_a_pickle():
    vertices, faces = BALL.surface(64)
    path = [ball_at(0, depth) for depth in (1e-4, 2e-4, 3e-4)]
    answers = Fem(gel(1)).solve_path(Press(Shape.mesh(vertices, faces), path))
    one, all_of_them = (len(pickle.dumps(those)) for those in (answers[0], answers))
    assert all_of_them < 1.2 * one, f"{one} and {all_of_them} bytes"


def test_copies_of_grasps_are_the_same():
    half = 2**-0.5
    left, right = ((-3.8e-3, 0, 0), (0, half, 0, half)), ((3.8e-3, 0, 0), (0, -half, 0, half))
    grasp = Grasp(BALL, [(left, right)], load=(0, 0, -0.01, 0, 0, 0))
    pad = Fem(ruffini.sensor("gelsight-mini", resolution=300), friction=0.8)
    [expected] = grasp.solve([pad, pad])
    for make in COPIES:
        [found] = make(grasp).solve((pad, pad))
        for frame in (found, make(expected)):
            assert pickle.dumps(frame.object) == pickle.dumps(expected.object)
            for mine, theirs in zip(frame.pads, expected.pads, strict=True):
                assert np.array_equal(mine.displacement, theirs.displacement)


def solved(arguments):
    body, press = arguments
    return Fem(body).solve(press)[0]


def test_worker_processes_take_presses_and_return_answers():
    press = Press(BALL, [ball_at(0, 2e-4)])
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        [found] = pool.map(solved, [(gel(), press)])
    assert np.array_equal(found.displacement, solved((gel(), press)).displacement)
