"""A full disk, a folder that cannot be written, and more environments than a user has meant.

The others are tested where the rest of their matter is: kills in `test_dataset_kills`, Ctrl-C in
`test_dataset` and `test_mechanics_threads`, forked children in `test_processes`, damaged shards in
`test_dataset`, damaged weights in `test_agents` and `test_paper`, damaged caches in
`tests/physics/compliance.rs`.
"""

from __future__ import annotations

import os
import resource
import sys
import time
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from tiny_dataset import TINY

from ruffini import Shape, SimulationError, dataset, video
from ruffini._spaces import replace_file
from ruffini.commands import main
from ruffini.policies import RandomPolicy

FULL = Path("/dev/full")
NO_SPACE = "No space left on device"
TASK, RIGID = "ruffini/GraspLift-v0", {"tactile": "none", "max_episode_steps": 3}
EVALUATE = ["agent", "evaluate", "random", "--task", "GraspLift", "--episodes", "1", "--settings"]
EVALUATE += ['{"tactile": "none", "max_episode_steps": 3}', "--json"]
CALIBRATE = ["calibrate", "curve.csv", "--sensor", "digit", "--indenter", "sphere"]


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


def test_a_file_that_cannot_be_written_whole_stays_as_it_was(tmp_path, monkeypatch):
    file = tmp_path / "sensor.toml"
    replace_file(file, "whole")
    file.chmod(0o640)
    replace_file(file, "whole again")
    assert file.read_text() == "whole again" and file.stat().st_mode & 0o777 == 0o640

    def half(path, data):
        with path.open("wb") as opened:
            opened.write(data[:2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", half)
    with pytest.raises(ValueError, match=r"sensor\.toml: No space left"):
        replace_file(file, "other")
    assert file.read_text() == "whole again"
    assert list(tmp_path.iterdir()) == [file]


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
        viewing.view([[viewing.ViewerFrame("a box", {"box": body}, {})]], file)


@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_a_video_on_a_full_disk_is_one_line(suffix, full, capfd):
    if suffix == ".mp4":
        pytest.importorskip("imageio_ffmpeg")
    file = full(f"a{suffix}")
    video.check(file)
    with pytest.raises(SimulationError, match=f"^video: {file}: {NO_SPACE}$"):
        video.film(RandomPolicy(), TASK, file, range(1), **RIGID)
    assert capfd.readouterr() == ("", "")


def test_a_generation_on_a_full_disk_names_its_file_and_leaves_no_half_of_it(tmp_path):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    # A file that is larger fails as one on a full disk does.
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    try:
        with pytest.raises(ValueError, match=r"meshes/0\.safetensors: File too large"):
            dataset.generate(tmp_path, threads=1, **TINY)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.rglob("*.safetensors"))


@pytest.mark.parametrize(
    "words",
    [
        ["view", "GraspLift", "--policy", "random", "--out", "a.html"],
        ["play", "GraspLift", "--policy", "random", "--video", "a.gif"],
        [*EVALUATE, "a.json"],
        ["mesh", "BOX", "--repair", "a.stl"],
        ["sensor", "template", "--out", "a.toml"],
        [*CALIBRATE, "--out", "a.toml"],
        [*CALIBRATE, "--plot", "a.png"],
        ["dataset", "generate", "a", "--objects", "1", "--grasps", "1", "--frames", "1"],
    ],
    ids=lambda words: words[0],
)
def test_what_cannot_be_written_is_named_in_one_line(words, box, closed, capsys):
    needed = {"view": "viser", "mesh": "trimesh", "calibrate": "scipy"}
    pytest.importorskip(needed.get(words[0], "numpy"))
    places = {"BOX": box} | {word: closed / word for word in words if word.split(".")[0] == "a"}
    line = refused([places.get(word, word) for word in words], capsys)
    assert f"{closed}/a" in line
    assert "ermission denied" in line or "not permitted" in line, line


@pytest.mark.parametrize(
    ("package", "extra", "words"),
    [
        ("safetensors", "data", ["dataset", "inspect", "GRASPS"]),
        ("safetensors", "data", ["dataset", "export", "GRASPS", "0", "a.npz"]),
        ("matplotlib", "data", ["dataset", "plot", "GRASPS", "-o", "a.png"]),
        ("matplotlib", "data", ["sensor", "check", "digit", "--plot", "a.png"]),
        ("viser", "viz", ["view", "GRASPS", "--out", "a.html"]),
        ("imageio_ffmpeg", "video", ["play", "--policy", "random", "--video", "a.mp4"]),
    ],
)
def test_a_package_that_is_missing_is_named_with_its_extra(
    package, extra, words, tmp_path, monkeypatch, capsys
):
    grasps = str(Path(__file__).parents[1] / "reference/grasps")
    monkeypatch.chdir(tmp_path)
    for name in {package, *(name for name in sys.modules if name.startswith(f"{package}."))}:
        monkeypatch.setitem(sys.modules, name, None)
    line = refused([grasps if word == "GRASPS" else word for word in words], capsys)
    assert f"ruffini[{extra}]" in line, line


def test_ten_thousand_environments_are_made_and_step():
    start, count = time.process_time(), 10_000
    envs = gym.make_vec(TASK, num_envs=count, obs="flat", tactile="none")
    envs.reset(seed=0)
    observation, reward, *_ = envs.step(np.zeros((count, 5), np.float32))
    seconds = time.process_time() - start
    assert observation.shape == (count, *envs.single_observation_space.shape)
    assert np.isfinite(observation).all() and np.isfinite(reward).all()
    last = gym.make(TASK, obs="flat", tactile="none")
    last.reset(seed=count - 1)
    np.testing.assert_array_equal(last.step(np.zeros(5, np.float32))[0], observation[-1])
    # Two seconds; ten times as many on a slow machine, or of a build without optimisation.
    assert seconds < 20, f"{seconds} s of processor time"
