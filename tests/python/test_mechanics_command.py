"""`ruffini press` in the shell."""

from __future__ import annotations

import base64
import re
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest
from bodies import BALL, ball_at

import ruffini
from ruffini import Fem, Press, PressError
from ruffini.commands import main


def command(*words: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "ruffini", *words]
    return subprocess.run(line, capture_output=True, text=True, check=False)


PRESS = ["press", "--sensor", "gelsight-mini", "--resolution", "400"]


def test_the_command_presses_and_writes_a_file(tmp_path):
    file = tmp_path / "frame.vtu"
    done = command(*PRESS, "--shape", "sphere:0.004", "--depth", "0.0005", "--out", str(file))
    assert done.returncode == 0, done.stderr
    *lines, written = done.stdout.splitlines()
    assert written == str(file)
    table = dict(line.split(maxsplit=1) for line in lines)
    assert list(table) == ["force", "indentation", "iterations", "residual", "seconds"]
    assert table["indentation"] == "0.5000 mm"
    body = ruffini.sensor("gelsight-mini", resolution=400)
    [answer] = Fem(body).solve(Press(BALL, [ball_at(0, 5e-4)]))
    assert abs(float(table["force"].split()[0]) + answer.wrench[2]) < 1e-4
    arrays = {found.get("Name"): found for found in ElementTree.parse(file).iter("DataArray")}
    assert {"displacement", "von_mises", "contact_force"} < set(arrays)
    # A byte count of eight bytes, then the numbers.
    written = np.frombuffer(base64.b64decode(arrays["displacement"].text)[8:]).reshape(-1, 3)
    assert np.abs(written - answer.displacement).max() < 1e-8


def test_the_command_compares_with_quadratic_elements_on_a_finer_mesh():
    done = command(*PRESS, "--shape", "sphere:0.004", "--depth", "0.0001", "--check")
    assert done.returncode == 0, done.stderr
    assert " in 1 frame\n" in done.stdout
    press = Press(BALL, [ball_at(0, 1e-4)])
    body = ruffini.sensor("gelsight-mini", resolution=400)
    finer = Fem(ruffini.sensor("gelsight-mini", resolution=1000, around=press), element="p2")
    [own], [exact] = Fem(body).solve(press), finer.solve(press)
    pairs = zip(
        (own.displacement, own.von_mises, own.wrench[:3]),
        (*finer.carry(exact.history, body.mesh), exact.wrench[:3]),
        strict=True,
    )
    errors = [100 * np.linalg.norm(a - b) / np.linalg.norm(b) for a, b in pairs]
    assert np.abs(np.array(errors_of(done.stdout)) - errors).max() < 0.06


def errors_of(printed: str) -> list[float]:
    """Errors in displacement, stress and force that --check printed (%)."""
    row = printed.splitlines()[-1]
    assert row.startswith("error") and row.endswith("against quadratic elements")
    return [float(number) for number in re.findall(r"([\d.]+) %", row)]


@pytest.mark.parametrize("drive", [("--depth", "0.0002"), ("--force", "0.05")])
def test_a_graded_mesh_is_nearer_to_quadratic_elements_on_a_small_ball(drive):
    press = ["press", "--sensor", "gelsight-mini", "--resolution", "1200", "--shape"]
    press += ["sphere:0.001", *drive, "--check"]
    coarse, graded = (command(*press, *more) for more in ([], ["--graded"]))
    assert coarse.returncode == graded.returncode == 0, coarse.stderr + graded.stderr
    pairs = list(zip(errors_of(graded.stdout), errors_of(coarse.stdout), strict=True))
    assert all(near < 0.6 * far for near, far in pairs[:2]), pairs


def test_the_command_pushes_and_shears():
    done = command(
        *PRESS, "--shape", "cone:0.003,0.002", "--force", "0.5", "--shear", "0.0002",
        "--friction", "0.8", "--calibration", "feats", "--element", "p1",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split("N normal, ")[1].split()[0]) > 0.01


def test_the_command_draws(tmp_path):
    picture = tmp_path / "press.png"
    words = ["--shape", "sphere:0.004", "--depth", "0.0003", "--plot", str(picture)]
    done = command(*PRESS, *words)
    assert done.stdout.splitlines()[-1] == str(picture), done.stderr
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--shape", "sphere:0.004", "--depth", "0.005"], "found 5 mm into a gel of 4 mm"),
        (["--shape", "sphere:0.004", "--depth", "0.001", "--plot", "a.pdf"], ".png or .svg"),
        (["--shape", "cone", "--depth", "0.001"], "expected cone:radius"),
        (["--shape", "blob:1", "--depth", "0.001"], "expected sphere:radius, cuboid"),
        (["--shape", "prism:6.5,0.1,0.1", "--depth", "0.001"], "expected prism:sides"),
        (["--shape", "sphere:4", "--depth", "0.001"], "a length of"),
        (["--shape", "none.stl", "--depth", "0.001"], "none.stl"),
        (["--shape", "sphere:0.004", "--depth", "-0.001"], "depth: found -0.001"),
        (["--shape", "sphere:0.004", "--depth", "nan"], "depth: found nan"),
        (["--shape", "sphere:0.004", "--depth", "0.001", "--force", "1"], "not allowed with"),
        (["--shape", "sphere:0.004"], "one of the arguments"),
        (["--shape", "sphere:0.004", "--depth", "1e-4", "--check", "--element", "p2"], "check: "),
        (["--shape", "sphere:0.004", "--force", "1", "--friction", "-1"], "friction"),
        (["--shape", "sphere:0.004", "--depth", "1e-4", "--out", "a.txt"], ".vtu or .npz"),
    ],
)
def test_the_command_names_bad_input(words, text):
    done = command(*PRESS, *words)
    assert (done.returncode, done.stdout) == (2, "")
    assert text in done.stderr and "Traceback" not in done.stderr


def test_errors_are_of_answers_on_one_mesh():
    zero, there = (
        Fem(ruffini.sensor("gelsight-mini", resolution=400)).solve(Press(BALL, [ball_at(0, d)]))[0]
        for d in (-1e-4, 1e-4)
    )
    assert ruffini.relative_error(there, there) == ruffini.relative_error(zero, zero) == (0, 0, 0)
    assert ruffini.relative_error(zero, there) == (1, 1, 1)
    assert ruffini.relative_error(there, zero) == (np.inf,) * 3
    [other] = Fem(ruffini.sensor("gelsight-mini", resolution=200)).solve(
        Press(BALL, [ball_at(0, 1e-4)])
    )
    with pytest.raises(
        ValueError, match=r"answer: found one on .* nodes, expected .* the reference"
    ):
        ruffini.relative_error(other, there)


def test_what_cannot_be_written_is_refused_before_the_press_is_solved(monkeypatch, capsys):
    monkeypatch.setattr("ruffini.commands.press._pressed", None)
    words = [*PRESS, "--shape", "sphere:0.004", "--depth", "1e-4", "--out"]
    for out, text in (("a.txt", ".vtu or .npz"), ("none/a.vtu", "make the folder none first")):
        assert main([*words, out]) == 2
        assert text in capsys.readouterr().err


def test_a_force_that_is_not_reached_is_told_with_the_thickness(monkeypatch, capsys):
    class LostError(PressError):
        kind = "unreachable"

    monkeypatch.setattr(
        Fem, "solve_path", lambda *_: [LostError("force 9 N not reached")], raising=True
    )
    assert main([*PRESS, "--shape", "sphere:0.004", "--force", "9"]) == 1
    told = "force 9 N not reached; the gel is 4 mm thick: give a smaller --force"
    assert capsys.readouterr().err == f"ruffini: {told}\n"


def test_the_command_says_when_a_press_is_not_solved():
    done = command(*PRESS, "--shape", "cuboid:0.003,0.003,0.003", "--depth", "0.0039")
    assert (done.returncode, done.stdout) == (1, "")
    assert "no equilibrium" in done.stderr
