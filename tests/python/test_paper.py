"""The shipped network of the paper's: its answers, and the presses that it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ruffini import PaperNetwork, Press, PressError, Shape, Surrogate

UPRIGHT = (0, 0, 0, 1)
WEIGHTS = Path(__file__).parents[2] / "env-core/assets/weights"
AGENT = Path(__file__).parents[2] / "py/python/ruffini/agents/GraspLift-v0.safetensors"
RADIUS = 12e-3


def ball(*depths: float, **options) -> Press:
    path = [([1e-3, 0, RADIUS - d], UPRIGHT) for d in depths]
    return Press(Shape.sphere(RADIUS), path, **options)


@pytest.fixture(scope="module")
def network():
    return PaperNetwork(friction=0.8)


def test_it_says_displacement_stress_and_rigid_motion_but_no_forces(network):
    answer = network.solve(ball(8e-4))[0]
    mesh = network.body.mesh
    assert answer.displacement.shape == mesh.vertices.shape
    assert answer.von_mises.shape == (len(mesh.tets),)
    assert answer.displacement[:, 2].min() < -1e-4
    position, quaternion = answer.rigid
    assert position.shape == (3,)
    np.testing.assert_allclose(np.linalg.norm(quaternion), 1)
    assert not hasattr(answer, "contact_force")
    assert not hasattr(answer, "wrench")
    assert network.is_in_distribution(answer)


def test_its_error_on_a_ball_is_within_what_its_card_says(network):
    """A ball, of a family that it learnt from, is no harder than 19 of 20 unseen grasps."""
    press = ball(2e-4, 4e-4, 6e-4, 8e-4)
    truth = Surrogate(friction=0.8).solve_path(press)[-1]
    found = network.solve_path(press)[-1]
    known = json.loads(network.card)["known"]["all"]
    for part, (a, b) in {
        "displacement": (found.displacement, truth.displacement),
        "stress": (found.von_mises, truth.von_mises),
    }.items():
        error = np.linalg.norm(a - b) / np.linalg.norm(b)
        assert error < min(known[part]["p95"], 1), (part, error, known[part])


def test_stress_is_in_proportion_to_youngs_modulus():
    gels = (PaperNetwork(young=young, poisson=0.47) for young in (1e5, 3e5))
    soft, hard = (gel.solve(ball(5e-4))[0] for gel in gels)
    np.testing.assert_allclose(hard.displacement, soft.displacement)
    np.testing.assert_allclose(hard.von_mises, 3 * soft.von_mises)


def test_nothing_moves_without_contact(network):
    first, second = network.solve_path(ball(-1e-3, 5e-4))
    assert not first.displacement.any()
    assert not first.von_mises.any()
    alone = network.solve(ball(5e-4))[0]
    np.testing.assert_array_equal(second.von_mises, alone.von_mises)


def test_what_it_cannot_answer_is_said(network):
    pushed = Press(
        Shape.sphere(4e-3), pose=([0, 0, 4e-3], UPRIGHT), force=1.0, direction=(0, 0, -1)
    )
    history = Surrogate(friction=0.8).solve(ball(5e-4))[0].history
    for press, message in [(pushed, "expected a path"), (ball(8e-4, history=history), "no memory")]:
        error = network.solve(press)[0]
        assert isinstance(error, PressError)
        assert message in str(error)


def test_weights_of_the_other_kind_are_named(tmp_path):
    with pytest.raises(ValueError, match="expected one of paper-b"):
        PaperNetwork("pads")
    with pytest.raises(ValueError, match="weights of paper-b, expected corrector"):
        Surrogate.load(WEIGHTS / "paper-b.safetensors")
    with pytest.raises(ValueError, match="weights of an agent, expected corrector"):
        Surrogate.load(AGENT)
    with pytest.raises(ValueError, match="weights of corrector, expected paper-baseline"):
        PaperNetwork.load(WEIGHTS / "pads.safetensors")
    torn = tmp_path / "torn.safetensors"
    torn.write_bytes((WEIGHTS / "paper-b.safetensors").read_bytes()[:5000])
    with pytest.raises(ValueError, match=r"torn\.safetensors"):
        PaperNetwork.load(torn)
