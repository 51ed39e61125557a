"""Fields carried between meshes of one body."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import BALL, ball_at, block, gel

import ruffini
from ruffini import Fem, Press, Transfer

FINE, COARSE = block(6), block(2)


def linear(mesh: ruffini.TetMesh) -> np.ndarray:
    x, y, z = mesh.vertices.T
    return np.stack([1 + x - 2 * z, y, 3 * x + z], axis=1)


def volumes(mesh: ruffini.TetMesh) -> np.ndarray:
    a, b, c, d = np.moveaxis(mesh.vertices[mesh.tets], 1, 0)
    return np.einsum("ti,ti->t", np.cross(b - a, c - a), d - a) / 6


@pytest.mark.parametrize(("source", "target"), [(FINE, COARSE), (COARSE, FINE)])
def test_linear_fields_arrive_exactly(source, target):
    arrived = Transfer(source, target).interpolate(linear(source))
    assert np.allclose(arrived, linear(target), rtol=0, atol=1e-12)


def test_spread_forces_keep_their_sum_and_torque():
    forces = np.random.default_rng(4).normal(size=FINE.vertices.shape)
    spread = Transfer(FINE, COARSE).spread(forces)
    assert spread.shape == COARSE.vertices.shape
    assert np.allclose(spread.sum(axis=0), forces.sum(axis=0), rtol=0, atol=1e-11)
    torques = [
        np.cross(mesh.vertices, f).sum(axis=0) for mesh, f in [(FINE, forces), (COARSE, spread)]
    ]
    assert np.allclose(*torques, rtol=0, atol=1e-13)


def test_averages_keep_the_mean():
    values = 1 + linear(FINE)[FINE.tets].mean(axis=1)[:, 2] * 100
    arrived = Transfer(FINE, COARSE).average(values)
    means = [np.average(f, weights=volumes(m)) for m, f in [(FINE, values), (COARSE, arrived)]]
    # The 35 points of each tetrahedron share its volume to about 1 %; the field varies by 70 %.
    assert abs(means[1] / means[0] - 1) < 0.01, means
    assert np.allclose(Transfer(FINE, COARSE).average(np.full(len(FINE.tets), 2.5)), 2.5)


@pytest.mark.parametrize("element", ["p1-bar", "p2"])
def test_an_answer_is_carried_as_its_element_knows_it(element):
    fem = Fem(gel(4), element=element)
    (answer,) = fem.solve(Press(BALL, [ball_at(0.0, 4e-4)]))
    target = block(3)
    moved, stress = fem.carry(answer.history, target)
    straight = Transfer(fem.body.mesh, target)
    bent = np.abs(moved - straight.interpolate(answer.displacement)).max()
    varied = np.abs(stress - straight.average(answer.von_mises)).max()
    if element == "p2":
        # A hundredth of the depth, and of a stress of some ten kPa.
        assert bent > 4e-6 and varied > 100, (bent, varied)
    else:
        assert (bent, varied) == (0, 0)
    own, _ = fem.carry(answer.history, fem.body.mesh)
    assert np.allclose(own, answer.displacement, rtol=0, atol=1e-15)


def test_a_history_of_another_model_is_not_carried():
    (answer,) = Fem(gel(2)).solve(Press(BALL, [ball_at(0.0, 4e-4)]))
    with pytest.raises(ValueError, match=r"history: found one of a model with \d+ nodes"):
        Fem(gel(3)).carry(answer.history, block(2))


def test_what_does_not_fit_is_refused():
    transfer = Transfer(FINE, COARSE)
    v, t = len(FINE.vertices), len(FINE.tets)
    with pytest.raises(ValueError, match=rf"nodal: found array \(2, 3\), expected .*\({v}, 3\)"):
        transfer.interpolate(np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"forces: found array \(3,\)"):
        transfer.spread(np.zeros(3))
    with pytest.raises(ValueError, match=rf"per_tet: found array \(5,\), expected .*\({t},\)"):
        transfer.average(np.zeros(5))
    far = ruffini.TetMesh(COARSE.vertices + 0.1, COARSE.tets)
    with pytest.raises(ValueError, match="two meshes of one body"):
        Transfer(FINE, far)


def test_cauchy_stress_is_in_balance_with_the_force_of_contact():
    fem = Fem(gel(4))
    [answer] = fem.solve(Press(BALL, [ball_at(0, 5e-4)]))
    stress = fem.stress(answer.history)
    deviator = stress - np.eye(3) * stress.trace(axis1=1, axis2=2)[:, None, None] / 3
    von_mises = np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2)))
    assert np.allclose(von_mises, answer.von_mises, rtol=1e-9)
    # A displacement that is the height is zero on the held base: the force works on it as the
    # stress does.
    mesh = fem.body.mesh
    moved = ruffini.TetMesh(mesh.vertices + answer.displacement, mesh.tets)
    height = moved.vertices[:, 2] - mesh.vertices[:, 2].min()
    work = float(answer.contact_force[:, 2] @ height)
    assert np.isclose((stress[:, 2, 2] * volumes(moved)).sum(), work, rtol=1e-6)
    with pytest.raises(ValueError, match="history"):
        Fem(gel(3)).stress(answer.history)
