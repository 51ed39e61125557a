"""Indenters of families that no network was taught."""

from __future__ import annotations

import numpy as np
import pytest
from indenters import FAMILIES

from ruffini import Shape


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("feature", [0.5e-3, 10e-3])
def test_an_indenter_is_a_solid_around_its_origin(family, feature):
    for seed in range(3):
        vertices, faces = FAMILIES[family](feature, np.random.default_rng(seed))
        # Raises for a surface that is not closed, crosses itself or is inside out.
        shape = Shape.mesh(vertices, faces)
        size = np.ptp(vertices, axis=0)
        assert (size > 0.9 * feature).all() and (size < 40 * feature).all()
        hollow = family == "ring"
        assert (shape.distance([[0, 0, 0]])[0][0] > 0) == hollow
        again, _ = FAMILIES[family](feature, np.random.default_rng(seed))
        np.testing.assert_array_equal(again, vertices)
