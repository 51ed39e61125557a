"""Soft objects between rigid fingers: answers of the shipped network."""

from __future__ import annotations

import json

import numpy as np
import pytest

import ruffini
from ruffini import Press, Shape, SoftSurrogate

RADIUS, THICKNESS = 0.018, 0.004
UPRIGHT, FLIPPED = (0, 0, 0, 1), (1, 0, 0, 0)


def squeeze(*depths: float, history: ruffini.History | None = None) -> Press:
    """Two fingers on a ball, each at a given depth: they press with the side at +z."""
    finger = Shape.cuboid([0.0104, 0.0126, THICKNESS / 2])
    away = [RADIUS - depth + THICKNESS / 2 for depth in depths]
    path = [[((0, 0, -z), UPRIGHT), ((0, 0, z), FLIPPED)] for z in away]
    return Press([finger, finger], path, history=history)


@pytest.fixture(scope="module")
def network():
    return SoftSurrogate(Shape.sphere(RADIUS))


def test_a_squeezed_ball_gets_flatter_and_wider(network):
    light, deep = network.solve_path(squeeze(4e-4, 1.5e-3))
    mesh = network.body.mesh
    assert deep.displacement.shape == mesh.vertices.shape
    assert deep.von_mises.shape == (len(mesh.tets),)
    rest, moved = mesh.vertices, mesh.vertices + deep.displacement
    assert np.ptp(rest[:, 2]) - np.ptp(moved[:, 2]) > 2e-3
    assert np.ptp(moved[:, 0]) > np.ptp(rest[:, 0])
    # By Hertz the force goes as the depth to the power of 1.5, and a squeeze stiffens.
    low, high = (answer.contact_force[rest[:, 2] < 0, 2].sum() for answer in (light, deep))
    assert 1.3 < np.log(high / low) / np.log(15 / 4) < 1.9, f"{low} N and {high} N"
    np.testing.assert_allclose(deep.contact_force.sum(axis=0), 0, atol=1e-4 * high)
    assert network.is_in_distribution(deep)


def test_it_goes_on_from_its_own_history(network):
    last = network.solve_path(squeeze(4e-4, 1e-3))[-1]
    first = network.solve(squeeze(4e-4))[0]
    (found,) = network.solve(squeeze(1e-3, history=first.history))
    size = np.linalg.norm(last.displacement)
    # The history keeps the fine mesh's displacement, but not the forces that a step begins with.
    assert np.linalg.norm(found.displacement - last.displacement) < 1e-3 * size


def test_a_small_step_from_its_history_takes_few_newton_steps(network):
    answer, steps = network.solve(squeeze(1e-3))[0], []
    for i in range(1, 11):
        (answer,) = network.solve(squeeze(1e-3 + 1e-6 * i, history=answer.history))
        steps.append(answer.iterations)
    # Three each; from the contact's own forces, whose imbalance moves a free body, it took a dozen.
    assert sum(steps) <= 50, steps


def test_without_contact_there_is_nothing(network):
    (answer,) = network.solve(squeeze(-1e-4))
    for field in (answer.displacement, answer.von_mises, answer.contact_force):
        assert not field.any()


def test_the_card_says_what_it_learnt_from_and_how_well(network):
    card = json.loads(network.card)
    assert card["variant"] == "soft"
    assert card["data"]["train"][1] > 0 and len(card["data"]["fingerprint"]) == 64
    for part in ("known", "novel"):
        errors = card[part]
        assert errors["network"]["presses"] > 0
        assert errors["network"]["stress"]["median"] < errors["linear"]["stress"]["median"]


def test_what_is_no_squeeze_or_no_network_is_refused(network, tmp_path):
    (error,) = network.solve(Press(Shape.sphere(0.01), [([0, 0, -0.03], UPRIGHT)]))
    assert isinstance(error, ruffini.PressError)
    assert "expected two equal cuboids" in str(error)
    ball = Shape.sphere(RADIUS)
    for settings, message in (
        ({"weights": "hard"}, "expected one of soft"),
        ({"young": 0.0}, "young"),
        ({"poisson": 0.5}, "poisson"),
        ({"friction": -1.0}, "friction"),
    ):
        with pytest.raises(ValueError, match=message):
            SoftSurrogate(ball, **settings)
    with pytest.raises(FileNotFoundError, match=r"none\.safetensors"):
        SoftSurrogate(ball, weights=str(tmp_path / "none.safetensors"))
    damaged = tmp_path / "damaged.safetensors"
    damaged.write_bytes(b"no weights")
    with pytest.raises(ValueError, match="damaged"):
        SoftSurrogate(ball, weights=str(damaged))
