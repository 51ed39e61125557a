"""`ruffini play` in the shell, and the moving pictures that it writes."""

from __future__ import annotations

import importlib.util
import io
import os
import subprocess
import sys

import numpy as np
import pytest
from drawn_agent import COARSE, card, drawn, tensors

from ruffini import agents, commands, video
from ruffini._core import encode_gif
from ruffini.agents import Agent
from ruffini.evaluation import evaluate

GRIP = {"start_grip": 8.0, "load": 0.2, "shaking": 0.1}
"""So that the pads touch, whatever the agent does."""


def play(*words, env=None):
    line = [sys.executable, "-m", "ruffini", "play", *map(str, words)]
    surroundings = os.environ | (env or {})
    return subprocess.run(line, capture_output=True, text=True, check=False, env=surroundings)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """The file of an agent of random numbers."""
    path = tmp_path_factory.mktemp("play") / "drawn.safetensors"
    path.write_bytes(drawn(settings=COARSE | GRIP).to_bytes())
    return path


def test_it_says_what_an_evaluation_says(file):
    done = play("HoldStill", "--policy", file, "--episodes", 3, "--seed", 5, "--threads", 1)
    assert done.returncode == 0, done.stderr
    head, found, told, verdict = done.stdout.splitlines()
    assert head == "ruffini/HoldStill-v0: PPO, 1,000 steps, seed 0; 3 episodes from seed 5"
    result = evaluate(agents.load(file), "ruffini/HoldStill-v0", 3, first_seed=5, **COARSE, **GRIP)
    assert found.split()[:2] == ["agent", f"{result['success']:.1%}"]
    assert told.startswith("its card, 200 seeds        90.0%  (85.1% to 93.4%)")
    assert verdict == commands.play._verdict(result["interval"], (0.851, 0.934))
    # Elsewhere than on a terminal progress is a line a quarter.
    lines = done.stderr.splitlines()
    steps = [f"step {step} of at most 12" for step in (1, 3, 6, 9, 12)]
    assert [text.split(",")[0] for text in lines] == steps
    assert lines[0].endswith(", 0 of 3 episodes ended")
    assert lines[-1].endswith(", 3 of 3 episodes ended")


@pytest.mark.parametrize(
    ("found", "word"),
    [((0.1, 0.3), "less than"), ((0.1, 0.5), "as"), ((0.5, 0.9), "as"), ((0.7, 0.9), "more than")],
)
def test_a_success_rate_is_told_from_the_cards_by_their_intervals(found, word):
    assert commands.play._verdict(found, (0.4, 0.6)) == f"{word} its card says"


@pytest.mark.parametrize(("policy", "least", "most"), [("scripted", 0.8, 1.0), ("random", 0, 0.2)])
def test_it_plays_policies_that_are_not_learnt(policy, least, most, tmp_path):
    path = tmp_path / "out.gif"
    done = play("GraspLift", "--policy", policy, "--episodes", 6, "--threads", 1, "--video", path)
    assert done.returncode == 0, done.stderr
    head, found, film = done.stdout.splitlines()
    assert head == f"ruffini/GraspLift-v0: {policy} policy; 6 episodes from seed 10000"
    name, success, *_ = found.split()
    assert name == policy and least <= float(success.rstrip("%")) / 100 <= most
    assert film.startswith(f"{path}: 3 episodes (") and path.stat().st_size > 10_000


def test_demo_is_another_name_of_it():
    line = [sys.executable, "-m", "ruffini", "demo", "--help"]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "--policy" in done.stdout


def test_it_writes_a_gif_that_shows_the_touch(file, tmp_path):
    image = pytest.importorskip("PIL.Image")
    path = tmp_path / "out.gif"
    words = ("--policy", file, "--episodes", 2, "--video", path, "--video-episodes", 1)
    done = play(*words)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1].startswith(f"{path}: 1 episode (")
    with image.open(path) as picture:
        frames = [np.array(shown(picture, i)) for i in range(picture.n_frames)]
        assert picture.info["loop"] == 0 and picture.info["duration"] == 80
    # 12 steps, the start and the pause, every second of them.
    assert frames[0].shape == (240, 320, 3) and len(frames) <= 25
    corner = frames[3][:80, 240:].reshape(-1, 3)
    assert len(np.unique(corner, axis=0)) > 20, "nothing of touch in the corner"


@pytest.mark.parametrize("rate", [21, 25, 30, 12, 200])
def test_a_gif_has_any_rate(tmp_path, rate):
    image = pytest.importorskip("PIL.Image")
    path = tmp_path / "a.gif"
    video.write(path, [np.full((40, 60, 3), 10 * i, np.uint8) for i in range(9)], rate)
    with image.open(path) as picture:
        # Hundredths of a second.
        assert picture.info["duration"] == pytest.approx(1000 * video._GIF_STRIDE / rate, abs=5.01)


def test_what_stands_still_in_a_gif_keeps_its_colour(tmp_path):
    image = pytest.importorskip("PIL.Image")
    still = np.random.default_rng(0).integers(0, 256, (40, 60, 3)).astype(np.uint8)
    frames = [still.copy() for _ in range(8)]
    for k, frame in enumerate(frames):
        frame[:, :10] = 30 * k  # More colours change than a palette has.
        frame[::7, 10:30] ^= k
    video.write(tmp_path / "a.gif", frames)
    with image.open(tmp_path / "a.gif") as picture:
        seen = np.array([shown(picture, i) for i in range(picture.n_frames)])
    assert (seen[:, :, 30:] == seen[0, :, 30:]).all()
    off = seen.astype(float) - np.array(frames[::2])
    # Colours spread evenly over the cube: 255 of them are cells of about 40 levels a side.
    assert np.sqrt((off**2).mean()) < 20
    few = [np.full((40, 60, 3), k, np.uint8) for k in (0, 90, 180, 255)]
    video.write(tmp_path / "b.GIF", few)
    with image.open(tmp_path / "b.GIF") as picture:
        assert (np.array(shown(picture, 1)) == 180).all(), "few colours are kept"


def test_camera_and_size_can_be_chosen(file, tmp_path):
    path = tmp_path / "out.gif"
    words = ("--policy", file, "--episodes", 1, "--video", path)
    done = play(*words, "--camera", "palm", "--size", "160x120")
    assert done.returncode == 0, done.stderr
    size = path.read_bytes()[6:10]
    assert (int.from_bytes(size[:2], "little"), int.from_bytes(size[2:], "little")) == (160, 120)


def shown(picture, index):
    picture.seek(index)
    return picture.convert("RGB")


def test_it_writes_an_mp4(file, tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "out.mp4"
    done = play("--policy", file, "--episodes", 2, "--video-episodes", 1, "--video", path)
    assert done.returncode == 0, done.stderr
    assert path.read_bytes()[4:8] == b"ftyp"


def test_agents_that_come_with_the_package_play():
    for name in agents.names():
        assert commands.main(["play", name, "--episodes", "2"]) == 0


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["GraspLft"], "task: found 'GraspLft', did you mean 'GraspLift'? expected one of GraspF"),
        (["--policy", "none.safetensors"], "none.safetensors: No such file"),
        (["--policy", "scritped"], "found 'scritped', did you mean 'scripted'? expected trained"),
        (["--policy", "none"], "policy: found 'none', expected trained (the agent of the package)"),
        (["--policy", "runs/none"], "run: found none in runs/none, expected the folder of a tr"),
        (
            ["Juggle", "--policy", "random"],
            "task: found 'Juggle', expected one of Grasp",
        ),
        (["me/Snug-v0"], "task: found 'me/Snug-v0', expected a built-in one: GraspF"),
        (["Juggle", "--policy", "scripted"], "task: found 'Juggle', expected one of Grasp"),
        (
            ["GraspLift", "--policy", "FILE"],
            "found one of ruffini/HoldStill-v0, expected one",
        ),
        (
            ["--policy", "FILE", "--episodes", "0"],
            "episodes: found 0, expected a whole",
        ),
        (["--policy", "FILE", "--episodes", "two"], "invalid int value: 'two'"),
        (["--policy", "FILE", "--video-episodes", "0"], "video-episodes: found 0"),
        (["--policy", "FILE", "--threads", "0"], "threads: found 0"),
        (
            ["--policy", "FILE", "--camera", "wirst"],
            "found 'wirst', did you mean 'wrist'? expected",
        ),
        (["--policy", "FILE", "--size", "640"], "size: found '640', expected WxH in pixels"),
        (["--policy", "FILE", "--size", "8x480"], "width: found 8, expected 16 to 4096 pixels"),
        (["--policy", "FILE", "--seed", "-1"], "seed: found -1"),
        (["--policy", "FILE", "--video", "out.avi"], "found out.avi, expected a .gif or .mp4 file"),
        (["--policy", "FILE", "--video", "none/out.gif"], "directory; make the folder none first"),
        (["--policy", "FILE", "--video", "FOLDER.gif"], "Is a directory"),
    ],
)
def test_it_names_bad_input(file, tmp_path, words, text):
    folder = tmp_path / "folder.gif"
    folder.mkdir()
    places = {"FILE": str(file), "FOLDER.gif": str(folder)}
    done = play(*(places.get(word, word) for word in words))
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert text in done.stderr and "Traceback" not in done.stderr
    assert done.stderr.count("ruffini: ") == 1 or "usage: " in done.stderr


@pytest.mark.parametrize("words", [["--episodes", "0"], ["--seed", "-1"], ["--threads", "0"]])
@pytest.mark.parametrize("of", [["play"], ["agent", "evaluate", "random"]])
def test_numbers_are_checked_before_anything_is_loaded(monkeypatch, capsys, of, words):
    for command in ("play", "agent"):
        monkeypatch.setattr(f"ruffini.commands.{command}.choose", None)
    assert commands.main([*of, *words]) == 2
    assert f"{words[0][2:]}: found {words[1]}, expected" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "usage", "text"),
    [
        (["play", "--polcy", "scripted"], "play", "arguments: --polcy, did you mean '--policy'?"),
        (["play", "--polcy=random"], "play", "--polcy=random, did you mean '--policy'?"),
        (["agent", "train", "GraspLift", "--stps", "3"], "agent train", "did you mean '--steps'?"),
        (["play", "--polic=random"], "play", "--polic=random, did you mean '--policy'?"),
        (["play", "GraspLift", "HoldStill"], "play", "unrecognized arguments: HoldStill\n"),
        (
            ["ply"],
            "",
            "argument command: found 'ply', did you mean 'play'? expected one of play, vi",
        ),
        (["agent", "trin"], "agent", "did you mean 'train'? expected one of train, evaluate"),
        (["network", "train", "a", "b", "--variant", "sft"], "network train", "mean 'soft'?"),
    ],
)
def test_the_nearest_option_or_command_is_named(words, usage, text, capsys):
    with pytest.raises(SystemExit) as ended:
        commands.main(words)
    said = capsys.readouterr().err
    assert ended.value.code == 2 and text in said, said
    assert said.startswith(f"usage: {' '.join(['ruffini', usage]).strip()} [-h]"), said
    assert "demo" not in said


def test_a_task_without_an_agent_is_said_to_have_none(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(agents, "_FOLDER", tmp_path)
    assert commands.main(["play", "GraspLift"]) == 2
    said = capsys.readouterr()
    assert not said.out and "agent: found none of GraspLift-v0, expected the path" in said.err
    assert "--policy scripted" in said.err


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"settings": COARSE | {"observation": ["proprio", "slip"]}}, "expected the environment's"),
        ({"settings": COARSE | {"gravity": 3}}, "unexpected keyword argument 'gravity'"),
        ({"settings": COARSE | {"tactile": "skin"}}, "tactile: "),
        ({"env": "ruffini/HoldStill-v7"}, "HoldStill"),
        ({"format": 2}, "found format 2"),
    ],
)
def test_an_agent_of_other_settings_is_refused_before_it_plays(tmp_path, change, text):
    path = tmp_path / "other.safetensors"
    agent = Agent(card(), tensors(card()))
    agent.card.update(change)
    path.write_bytes(agent.to_bytes())
    done = play("--policy", path)
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert text in done.stderr and "other.safetensors" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_the_command_alone_lists_what_there_is(capsys):
    with pytest.raises(SystemExit) as ended:
        commands.main([])
    assert ended.value.code == 0
    assert "play" in capsys.readouterr().out


def test_no_file_is_left_where_the_demo_did_not_play(file, tmp_path):
    path = tmp_path / "out.gif"
    assert play("--policy", file, "--video", path, "--threads", "0").returncode == 2
    assert not path.exists()


def test_an_mp4_without_its_extra_is_refused_before_the_agent_plays(file, tmp_path):
    (tmp_path / "imageio_ffmpeg.py").write_text("raise ImportError")
    path = os.pathsep.join([str(tmp_path), *sys.path])
    done = play("--policy", file, "--video", tmp_path / "out.mp4", env={"PYTHONPATH": path})
    assert (done.returncode, done.stdout) == (2, "")
    assert "pip install 'ruffini[video]', or write a .gif" in done.stderr


def test_an_mp4_without_ffmpeg_is_refused_before_the_agent_plays(file, tmp_path):
    if importlib.util.find_spec("imageio_ffmpeg") is None:
        pytest.skip("needs imageio-ffmpeg")
    nowhere = {"IMAGEIO_FFMPEG_EXE": str(tmp_path / "none")}
    done = play("--policy", file, "--video", tmp_path / "out.mp4", env=nowhere)
    assert (done.returncode, done.stdout) == (2, "")
    assert "found no ffmpeg" in done.stderr


def played(frames, delay=40):
    image = pytest.importorskip("PIL.Image")
    with image.open(io.BytesIO(encode_gif(frames, delay))) as picture:
        assert picture.n_frames == len(frames)
        return [np.array(shown(picture, i)) for i in range(picture.n_frames)]


def test_a_gif_of_few_colours_is_exact():
    drawn_pixels = np.random.default_rng(0)
    colours = drawn_pixels.integers(0, 256, (100, 3), dtype=np.uint8)
    first = colours[drawn_pixels.integers(0, 100, (20, 30))]
    second = first.copy()
    second[4:7, 11:29] = colours[drawn_pixels.integers(0, 100, (3, 18))]
    frames = [first, second, second, first, 255 - first]
    # A frame like the one before it is still a frame: it takes its time.
    for found, expected in zip(played(frames), frames, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_a_gif_of_many_colours_is_near():
    y, x = np.mgrid[0:120, 0:160]
    frames = []
    for step in range(4):
        ball = np.hypot(x - 40 - 20 * step, y - 60) < 25
        ground = np.stack([x, 2 * y, 255 - x], axis=-1)
        frames.append(np.where(ball[..., None], 200 - ground // 2, ground).astype(np.uint8))
    for found, expected in zip(played(frames), frames, strict=True):
        off = np.abs(found.astype(int) - expected).max(axis=-1)
        # Evenly spread over all colours there are, 256 would be one in each cube of 40 a side.
        assert off.max() <= 40, off.max()


@pytest.mark.parametrize(
    ("frames", "delay", "text"),
    [
        ([], 40, "frames: found none, expected at least one"),
        ([np.zeros((4, 4, 3), np.uint8)], 45, "delay: found 45 ms, expected 10 to 655350 ms"),
        ([np.zeros((4, 4, 3), np.uint8)], 0, "delay: found 0 ms"),
        ([np.zeros((4, 4, 4), np.uint8)], 40, r"frames: found array \(4, 4, 4\), expected array"),
        ([np.zeros((0, 4, 3), np.uint8)], 40, r"frames: found array \(0, 4, 3\)"),
        ([np.zeros((4, n, 3), np.uint8) for n in (4, 5)], 40, r"\(4, 5, 3\), expected array"),
    ],
)
def test_frames_that_make_no_gif_are_refused(frames, delay, text):
    with pytest.raises(ValueError, match=text):
        encode_gif(frames, delay)
