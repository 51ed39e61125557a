"""A full disk, and a folder that cannot be written.

Kills, Ctrl-C, forked children, and damaged shards and weights have tests where the rest of their
matter is tested.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from ruffini import Shape, SimulationError, video
from ruffini.commands import main
from ruffini.policies import RandomPolicy

FULL = Path("/dev/full")
NO_SPACE = "No space left on device"
TASK, RIGID = "ruffini/GraspLift-v0", {"tactile": "none", "max_episode_steps": 3}
EVALUATE = ["agent", "evaluate", "random", "--task", "GraspLift", "--episodes", "1", "--settings"]
EVALUATE += ['{"tactile": "none", "max_episode_steps": 3}', "--json"]


@pytest.fixture
def full(tmp_path):
    """Function that gives a file, of a name, to which no byte can be written."""
    if not FULL.exists():
        pytest.skip("no /dev/full")

    def named(name: str) -> Path:
        (tmp_path / name).symlink_to(FULL)
        return tmp_path / name

    return named


@pytest.fixture
def closed(tmp_path):
    """A folder that cannot be written."""
    tmp_path.chmod(0o500)
    if not os.access(tmp_path, os.W_OK):
        yield tmp_path
    elif os.access("/sys/kernel", os.X_OK):
        yield Path("/sys/kernel")  # Not even by root.
    else:
        pytest.skip("every folder can be written")
    tmp_path.chmod(0o700)


@pytest.fixture
def box(tmp_path):
    """The mesh of a box."""
    vertices, faces = Shape.named("cuboid").surface()
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    file = tmp_path / "box.obj"
    file.write_text("\n".join(lines + [f"f {a} {b} {c}" for a, b, c in faces + 1]))
    return file


def refused(words, capsys) -> str:
    """The one line with which a command refuses."""
    assert main([str(word) for word in words]) == 2
    said = capsys.readouterr().err.splitlines()
    return next(line for line in said if line.startswith("ruffini: "))


def test_an_evaluation_on_a_full_disk_names_its_file(full, capsys):
    file = full("a.json")
    assert refused([*EVALUATE, file], capsys) == f"ruffini: {file}: {NO_SPACE}"


def test_a_repaired_mesh_on_a_full_disk_names_its_file(full, box, capsys):
    pytest.importorskip("trimesh")
    file = full("mended.stl")
    assert refused(["mesh", box, "--repair", file], capsys) == f"ruffini: {file}: {NO_SPACE}"
    again = box.with_name("again.obj")
    assert main(["mesh", str(box), "--repair", str(again)]) == 0
    assert again.stat().st_size > 100


def test_a_scene_on_a_full_disk_names_its_file(full):
    pytest.importorskip("viser")
    from ruffini import viewing

    vertices, faces = Shape.named("cuboid").surface()
    body = viewing.Rigid(np.array([0.0, 0, 0, 0, 0, 0, 1]), vertices, faces)
    file = full("a.html")
    with pytest.raises(ValueError, match=f"^{file}: {NO_SPACE}$"):
        viewing.view([[viewing.Frame("a box", {"box": body}, {})]], file)


@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_a_video_on_a_full_disk_is_one_line(suffix, full, capfd):
    if suffix == ".mp4":
        pytest.importorskip("imageio_ffmpeg")
    file = full(f"a{suffix}")
    video.check(file)
    with pytest.raises(SimulationError, match=f"^video: {file}: {NO_SPACE}$"):
        video.film(RandomPolicy(), TASK, file, range(1), **RIGID)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "words",
    [
        ["view", "GraspLift", "--policy", "random", "--out", "a.html"],
        ["play", "GraspLift", "--policy", "random", "--video", "a.gif"],
        [*EVALUATE, "a.json"],
        ["mesh", "BOX", "--repair", "a.stl"],
        ["sensor", "template", "--out", "a.toml"],
        ["dataset", "generate", "a", "--objects", "1", "--grasps", "1", "--frames", "1"],
    ],
    ids=lambda words: words[0],
)
def test_what_cannot_be_written_is_named_in_one_line(words, box, closed, capsys):
    pytest.importorskip({"view": "viser", "mesh": "trimesh"}.get(words[0], "numpy"))
    places = {"BOX": box} | {word: closed / word for word in words if word.split(".")[0] == "a"}
    line = refused([places.get(word, word) for word in words], capsys)
    assert f"{closed}/a" in line
    assert "ermission denied" in line or "not permitted" in line, line
