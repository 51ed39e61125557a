"""The committed samples: read, in balance, and what the solver still finds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ruffini import dataset

pytest.importorskip("safetensors")

SAMPLES = Path(__file__).parents[1] / "reference"


@pytest.mark.parametrize(("name", "grasps"), [("grasps", 4), ("squeezes", 2)])
def test_a_sample_is_whole_and_in_balance(name, grasps):
    data = dataset.open(SAMPLES / name)
    data.verify()
    assert len(data.grasps) == grasps and len(data) == 3 * grasps
    assert data.manifest["unsolved"] == [] and data.manifest["commit"]
    for frame in data:
        assert frame.imbalance()["force"] < 1.01e-6
        assert 300 < len(data.mesh(frame.grasp).vertices) <= 400
    size = sum(
        path.stat().st_size
        for part in ("grasps", "squeezes")
        for path in (SAMPLES / part).rglob("*")
    )
    assert size < 2e6, f"{size} bytes of samples"


def test_a_frame_has_the_numbers_of_its_own_row_and_side():
    data = dataset.open(SAMPLES / "grasps")
    for grasp in data.grasps:
        frames = [data[index] for index in data.frames(grasp)]
        assert len(frames) > 1
        np.testing.assert_array_equal([f.force for f in frames], data.column(grasp, "force"))
        np.testing.assert_array_equal([f.object for f in frames], data.column(grasp, "object"))
        for side, name in enumerate(("first", "second")):
            pads = [frame.pads[side] for frame in frames]
            for field in ("displacement", "von_mises", "contact_force", "wrench", "press", "pose"):
                column = data.column(grasp, f"{name}.{field}")
                np.testing.assert_array_equal([getattr(p, field) for p in pads], column)
            counts = data.column(grasp, f"{name}.anchors")
            assert [len(pad.anchors) for pad in pads] == counts.tolist() and counts.sum() > 0
            places = np.concatenate([pad.anchors[:, 1] for pad in pads])
            column = data.column(grasp, f"{name}.anchor_place").astype(np.float32)
            np.testing.assert_array_equal(places, column)


def test_the_configuration_beside_a_sample_makes_it(tmp_path):
    """Its squeezes; the grasps take longer. Other processors round otherwise, by far less."""
    data = dataset.open(SAMPLES / "squeezes")
    again = dataset.generate(tmp_path, SAMPLES / "squeezes.toml")
    assert again is not None and again.grasps == data.grasps
    for known, found in zip(data, again, strict=True):
        assert found.force == pytest.approx(known.force, rel=1e-5)
        largest = np.abs(known.body.displacement).max()
        assert np.abs(found.body.displacement - known.body.displacement).max() < 1e-4 * largest
