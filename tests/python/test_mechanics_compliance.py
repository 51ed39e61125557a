"""The condensed linear model from Python, beside the finite elements."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import BALL, ball_at, block, gel

from ruffini import Compliance, Deformation, Fem, Press, PressError, SoftBody


def _path(depth: float) -> Press:
    return Press(BALL, path=[ball_at(0.0, 0.25 * depth * (i + 1)) for i in range(4)])


def test_a_shallow_press_is_that_of_the_finite_elements():
    body, press = gel(), _path(5e-5)
    linear, true = (m.solve(press)[0].wrench[2] for m in (Compliance(body), Fem(body)))
    # Strains of one per cent.
    assert linear == pytest.approx(true, rel=0.03)


def test_corrections_lower_the_residual_and_the_error():
    body, press = gel(), _path(5e-4)
    truth = Fem(body, friction=0.5).solve(press)[0]

    def error(corrections: int) -> tuple[float, float]:
        found = Compliance(body, friction=0.5, corrections=corrections).solve(press)[0]
        off = np.linalg.norm(found.displacement - truth.displacement)
        return found.residual, off / np.linalg.norm(truth.displacement)

    (rest, off), (corrected_rest, corrected_off) = error(0), error(12)
    assert corrected_rest < rest and corrected_off < off


def test_every_frame_is_kept_and_the_last_is_the_answer():
    model, press = Compliance(gel(), friction=0.5), _path(2e-4)
    frames = model.solve_path(press)
    assert len(frames) == 4 and all(isinstance(frame, Deformation) for frame in frames)
    last = model.solve([press])[0].displacement
    # Rounding of displacements of a tenth of a millimetre.
    np.testing.assert_allclose(frames[-1].displacement, last, rtol=0, atol=1e-12)


def test_what_was_condensed_is_read_again(tmp_path):
    first, again = (Compliance(gel(), cache=tmp_path).solve(_path(2e-4))[0] for _ in range(2))
    assert list(tmp_path.iterdir())
    np.testing.assert_array_equal(first.displacement, again.displacement)


def test_bad_options_are_named():
    with pytest.raises(ValueError, match="corrections: found 13"):
        Compliance(gel(), corrections=13)
    with pytest.raises(ValueError, match="fixed"):
        Compliance(SoftBody(block(), young=1e5, poisson=0.45))


def test_an_error_stays_in_its_slot():
    model = Compliance(gel())
    good, bad = _path(1e-4), Press(BALL, ball_at(0.0, -1e-3), force=1.0, direction=(0.0, 0.0, 1.0))
    found = model.solve([good, bad, good])
    assert [type(item) for item in found] == [Deformation, PressError, Deformation]
