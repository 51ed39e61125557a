"""Objects of the mechanics API say what they are, and what they were made of."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bodies import BALL, PLATE, SHAPES, ball_at, block, gel, plate_at

import ruffini
from ruffini import Compliance, Fem, Grasp, LinearPad, Press, PressError, Surrogate, Transfer

PUSH = Press([PLATE], pose=[plate_at(-1e-3)], force=1.5, direction=(0, 0, -3))
HALF = 2**-0.5
PAIR = ((-3e-3, 0, 0), (0, HALF, 0, HALF)), ((3e-3, 0, 0), (0, -HALF, 0, HALF))
GEL = "neo-hookean, young 2e5 Pa, poisson 0.45, 75 nodes (25 fixed), 192 tetrahedra"
WORDS = {
    "<ruffini.Shape sphere, radius 0.004 m>": lambda: BALL,
    "<ruffini.Shape cuboid, half_extents [0.001, 0.002, 0.003] m, edges rounded by 0.0004 m>": (
        lambda: SHAPES["rounded cuboid"]
    ),
    "<ruffini.Shape prism, sides 6, radius 0.003 m, half_height 0.002 m>": lambda: SHAPES["prism"],
    "<ruffini.Shape mesh, 4 triangles, 0.0050 m long>": lambda: SHAPES["mesh"],
    "<ruffini.Shape star-shaped solid, semi_axes [0.003, 0.003, 0.004] m>": (
        lambda: SHAPES["star_shaped"]
    ),
    "<ruffini.Shape half-space>": lambda: PLATE,
    "<ruffini.TetMesh of 75 vertices, 192 tetrahedra>": block,
    f"<ruffini.SoftBody {GEL}>": gel,
    "young 1e5 to 3e5 Pa": lambda: gel(young=np.linspace(1e5, 3e5, 192)),
    "<ruffini.Press of sphere, 2 frames>": lambda: Press(BALL, [ball_at(0, 0), ball_at(0, 1e-4)]),
    "<ruffini.Press of half-space, 1.5 N along (0.000, 0.000, -1.000)>": lambda: PUSH,
    "<ruffini.Press of sphere and half-space, 1 frames>": lambda: Press(
        [BALL, PLATE], [[ball_at(0, 0), plate_at(-1e-2)]]
    ),
    "<ruffini.Transfer from 18 to 75 vertices>": lambda: Transfer(block(1), block()),
    "<ruffini.Grasp of sphere, 1 frames>": lambda: Grasp(BALL, [PAIR]),
    "<ruffini.Object cup-1, train, cup>": lambda: next(
        thing for thing in ruffini.objects() if thing.name == "cup-1"
    ),
    f"<ruffini.Fem p2, friction 0.5, {GEL}>": lambda: Fem(gel(), friction=0.5, element="p2"),
    f"<ruffini.Compliance contact at points, friction 0, 3 corrections, {GEL}>": lambda: Compliance(
        gel(), corrections=3
    ),
    "<ruffini.LinearPad neo-hookean, young 3": lambda: LinearPad(resolution=300),
    "<ruffini.Surrogate neo-hookean, young 3": Surrogate,
}


@pytest.mark.parametrize("words", WORDS)
def test_objects_say_what_they_are(words):
    found = repr(WORDS[words]())
    assert words in found and "\n" not in found, found


def test_a_press_has_what_it_was_made_of():
    history = Fem(gel()).solve(Press(BALL, [ball_at(0, 1e-4)]))[0].history
    along = Press(BALL, [ball_at(0, 1e-4), ball_at(1e-4, 2e-4)], history=history)
    assert along.shapes is BALL and along.history is history
    assert [tuple(place) for place, _ in along.path] == [
        ball_at(0, 1e-4)[0],
        ball_at(1e-4, 2e-4)[0],
    ]
    assert [along.pose, along.force, along.direction] == [None] * 3
    assert PUSH.path is None and PUSH.history is None and PUSH.shapes == [PLATE]
    [(place, quaternion)] = PUSH.pose
    assert (tuple(place), tuple(quaternion)) == plate_at(-1e-3)
    assert PUSH.force == 1.5 and tuple(PUSH.direction) == (0, 0, -3)


def test_bodies_models_and_grasps_have_what_they_were_made_of():
    young = np.linspace(1e5, 3e5, 192)
    assert (gel().young, gel().poisson) == (2e5, 0.45)
    assert np.array_equal(gel(young=young).young, young)
    fem = Fem(gel(), 0.3, 1e-6, "p2")
    assert (fem.friction, fem.tolerance, fem.element) == (0.3, 1e-6, "p2")
    model = Compliance(gel(), 0.3, contact="nodes")
    assert (model.friction, model.corrections, model.contact) == (0.3, 0, "nodes")
    grasp = Grasp(BALL, [PAIR], start=ball_at(0, 0), load=range(6))
    assert repr(grasp.object) == repr(BALL) and tuple(grasp.start[0]) == ball_at(0, 0)[0]
    assert tuple(grasp.load) == tuple(range(6)) and tuple(grasp.path[0][0][0]) == PAIR[0][0]


def test_an_unsolved_press_says_so_when_it_is_taken_for_an_answer():
    [error] = Fem(gel()).solve(Press(PLATE, [plate_at(5e-3)]))
    for name in ("wrench", "displacement", "history", "pose", "pads"):
        said = rf"{name}: found none, for the press was not solved \(penetrated\): a shape stands"
        with pytest.raises(PressError, match=said) as raised:
            getattr(error, name)
        assert raised.value.kind == "penetrated"
    with pytest.raises(AttributeError, match="no attribute 'wrong'"):
        error.wrong  # noqa: B018
    with pytest.raises(PressError, match="not solved"):
        ruffini.relative_error(error, error)


def test_code_of_the_page_passes_mypy(tmp_path):
    pytest.importorskip("mypy")
    page = (Path(__file__).parents[2] / "py/docs/mechanics.md").read_text()
    blocks = [part.split("```")[0] for part in page.split("```python\n")[1:]]
    wrong = "Fem(gel).solve(tip)[0].wrenches\n"
    (tmp_path / "page.py").write_text("\n".join([*blocks, wrong]))
    command = [sys.executable, "-m", "mypy", "--cache-dir", str(tmp_path), "page.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert '"Deformation" of "Deformation | PressError" has no attribute "wrenches"' in done.stdout
    assert "Found 1 error" in done.stdout, done.stdout + done.stderr
