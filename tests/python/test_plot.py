"""Pictures of solved presses."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from bodies import BALL, RADIUS, UPRIGHT, ball_at, block, gel

import ruffini
from ruffini import Fem, Press
from ruffini._plot import _cut

pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def body():
    return gel()


@pytest.fixture(scope="module")
def answers(body):
    return Fem(body).solve_path(Press(BALL, [ball_at(0, 2e-4), ball_at(0, 4e-4)]))


@pytest.mark.parametrize("y", [-1e-3, 0.0, 3e-4, 2e-3])
def test_a_section_is_whole_and_in_its_plane(y):
    # The planes of a block's cells are at whole multiples of 2 mm.
    mesh = block()
    edges, shares, triangles = _cut(mesh.tets.astype(np.int64), mesh.vertices[:, 1] - y)
    points = np.einsum("ne,nec->nc", shares, mesh.vertices[edges])
    assert np.allclose(points[:, 1], y, atol=1e-15) and np.allclose(shares.sum(axis=1), 1)
    a, b, c = points[triangles].swapaxes(0, 1)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    assert abs(area / (8e-3 * 4e-3) - 1) < 1e-12, f"{area} m² against 32 mm²"


def test_a_picture_has_its_panels_and_the_forces_of_all_answers(body, answers, tmp_path):
    start = ball_at(0, 0)[0]
    figure = ruffini.plot(body, answers, tmp_path / "press.png", start=start)
    assert (tmp_path / "press.png").read_bytes().startswith(b"\x89PNG")
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert {"von Mises stress (kPa)", "displacement along z (mm)", "force (N)"} <= {*labels}
    way, normal = figure.axes[labels.index("force (N)")].lines[0].get_data()
    assert np.allclose(way, [0, 0.2, 0.4]) and normal[0] == 0
    assert np.array_equal(normal[1:], [-answer.wrench[2] for answer in answers])
    whole = figure.axes[labels.index("z (mm)")].dataLim
    assert np.allclose([whole.y0, whole.y1], [-4, 0], atol=0.2), whole


@pytest.mark.parametrize("of_a_list", [False, True])
def test_one_answer_has_no_curve(body, answers, of_a_list, tmp_path):
    figure = ruffini.plot(body, answers[-1:] if of_a_list else answers[-1], tmp_path / "a.svg")
    assert "force (N)" not in [axes.get_ylabel() for axes in figure.axes]
    assert "<svg" in (tmp_path / "a.svg").read_text()


def test_bodies_that_are_not_touched_or_at_a_side_are_drawn(body):
    side = (0.0, -4e-3 - RADIUS + 2e-4, -2e-3), UPRIGHT
    for pose in (ball_at(0, -1e-3), side):
        [answer] = Fem(body).solve(Press(BALL, [pose]))
        figure = ruffini.plot(body, answer)
        figure.canvas.draw()
        assert len(figure.axes) == 6


@pytest.mark.parametrize(("axis", "other"), [("x", 1), ("y", 0)])
def test_a_section_is_drawn_where_it_is_asked_for(body, answers, axis, other):
    sides = body.mesh.vertices[:, other]
    stress = []
    for place in (0.0, 3e-3):
        figure = ruffini.plot(body, answers, section=(axis, place))
        [drawn] = [axes for axes in figure.axes if axes.get_ylabel() == "z (mm)"]
        title = drawn.get_figure(root=False).get_suptitle()
        assert title == f"section at {axis} = {1e3 * place} mm; grey: at rest"
        rest = np.concatenate([line.get_xdata() for line in drawn.lines if line.get_c() == "0.6"])
        np.testing.assert_allclose([rest.min(), rest.max()], [1e3 * sides.min(), 1e3 * sides.max()])
        stress.append(max(drawn.collections[0].get_array()))
    assert stress[0] > 1.5 * stress[1]


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ("x", r'found \'x\', expected \("x", number\)'),
        (("z", 0.0), r"found \('z', 0.0\), expected"),
        (("x", 2.0), r"found 2.0, expected x within -[\d.]+ and [\d.]+ m, where the body is"),
        (("y", "middle"), "found 'middle', expected y within"),
    ],
)
def test_a_section_that_there_is_none_of_is_refused(body, answers, section, message):
    with pytest.raises(ValueError, match=f"section: {message}"):
        ruffini.plot(body, answers, section=section)


def test_what_cannot_be_drawn_is_said(body, answers, tmp_path, monkeypatch):
    [deep] = Fem(body).solve(Press(BALL, [ball_at(0, 6e-3)]))
    assert isinstance(deep, ruffini.PressError)
    with pytest.raises(ruffini.PressError):
        ruffini.plot(body, [*answers, deep])
    nodes = len(body.mesh.vertices)
    with pytest.raises(ValueError, match=rf"found one on {nodes} nodes, expected \d+, the body's"):
        ruffini.plot(gel(3), answers)
    with pytest.raises(ValueError, match="answers: found none"):
        ruffini.plot(body, [])
    with pytest.raises(ValueError, match=r"a.pdf, expected a name that ends in .png or .svg"):
        ruffini.plot(body, answers, "a.pdf")
    with pytest.raises(ValueError, match=r"plot: .*No such file"):
        ruffini.plot(body, answers, tmp_path / "none" / "a.png")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ValueError, match=r'matplotlib: pip install "ruffini\[data\]"'):
        ruffini.plot(body, answers)
