"""Datasets: made, stopped, resumed, read, described in the shell."""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fresh import interrupted
from tiny_dataset import TINY

import ruffini
from ruffini import dataset, surrogate
from ruffini._distributions import by_family, family
from ruffini._frames import turned
from ruffini.commands import main

pytest.importorskip("safetensors")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "tiny"
    assert dataset.generate(folder, threads=2, **TINY) is not None
    return folder


@pytest.fixture
def data(folder):
    return dataset.open(folder)


def shards(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*/*.safetensors"))}


def test_every_frame_can_be_read(data):
    assert data.manifest["unsolved"] == []
    assert len(data) == 4
    mesh = data.mesh(0)
    vertices, tets = len(mesh.vertices), len(mesh.tets)
    for index, frame in enumerate(data):
        assert index == data.frames(frame.grasp)[frame.number]
        assert frame.gel == 0 and frame.force > 0 and frame.closing > 0
        assert abs(np.linalg.norm(frame.object[3:]) - 1) < 1e-12
        for pad in frame.pads:
            assert pad.displacement.shape == pad.contact_force.shape == (vertices, 3)
            assert pad.von_mises.shape == (tets,)
            assert (pad.wrench.shape, pad.press.shape, pad.pose.shape) == ((6,), (7,), (7,))
            assert np.abs(pad.displacement).max() > 1e-5
            # The tolerance of a pad's solution is 1e-7 N.
            assert pad.residual <= 1e-7 and pad.iterations > 0
    assert data[-1].number == 1 and data[1].force > data[0].force
    with pytest.raises(IndexError, match="found 4, expected less than 4"):
        data[4]
    with pytest.raises(TypeError, match=r"found slice\(None, 2, None\), expected a whole number"):
        data[:2]
    near = data.grasps[0]
    for ask in (data.frames, data.plan, data.gel, data.mesh):
        with pytest.raises(KeyError, match=f"found '{near}0', did you mean '{near}'"):
            ask(f"{near}0")


def test_every_frame_is_in_balance(data):
    for frame in data:
        off, pressed = frame.imbalance(), frame.pads[0].contact_force
        # Each of the 32-bit numbers is rounded by at most 6e-8 of itself.
        rounding = 6e-8 * np.abs(pressed).sum() * 2 + 1e-12
        assert off["contact"] < rounding, f"{off['contact']} N against {rounding} N"
        # The solver's tolerance is 1e-6 N, torque counted over the object's size, below 0.1 m.
        assert off["force"] <= 1.001e-6, f"{off['force']} N on the object"
        assert off["torque"] <= 1.001e-7, f"{off['torque']} N m on the object"


def test_pads_take_over_the_weight_as_they_grip(tmp_path):
    heavy = {**TINY, "objects": 1, "frames": 4, "force": [20.0, 20.0], "density": 3000.0}
    data = dataset.generate(tmp_path, threads=1, **heavy)
    assert data is not None and data.manifest["unsolved"] == []
    loads = [float(np.linalg.norm(frame.load[:3])) for frame in data]
    [prism] = [found for found in ruffini.objects() if found.name == "prism-1"]
    vertices, triangles = prism.surface(64)
    volume = np.linalg.det(vertices[triangles]).sum() / 6
    assert loads == sorted(loads) and loads[0] < 0.5 * loads[-1]
    assert loads[-1] == pytest.approx(3000 * 9.80665 * volume, rel=1e-9)
    for frame in data:
        borne = sum(turned(pad.pose, pad.wrench[None, :3])[0] for pad in frame.pads)
        # The solver's tolerance is 1e-6 N.
        assert np.abs(borne - frame.load[:3]).max() < 1.001e-6
        off = frame.imbalance()
        assert off["force"] <= 1.001e-6 and off["torque"] <= 1.001e-7
    with pytest.raises(ValueError, match=r"density: found 100, expected 0 to 0"):
        dataset.generate(tmp_path / "soft", **{**TINY, "scenario": "soft", "density": 100.0})


def test_an_unbalanced_frame_shows(data):
    frame = data[0]
    pad = replace(frame.pads[0], wrench=frame.pads[0].wrench + np.eye(6)[2] / 10)
    off = replace(frame, pads=(pad, frame.pads[1])).imbalance()
    assert off["contact"] == pytest.approx(0.1, abs=1e-5)
    assert off["force"] == pytest.approx(0.1, abs=1e-5)


def test_splits_name_grasps_that_are_there(data):
    named = {name for split in data.splits.values() for part in split.values() for name in part}
    assert named and all(len(data.frames(name)) == 2 for name in named)


def test_a_dataset_goes_to_another_process(data):
    data[0]
    again = pickle.loads(pickle.dumps(data))
    assert np.array_equal(again[1].pads[0].displacement, data[1].pads[0].displacement)


def test_a_stopped_generation_resumes_with_the_same_bytes(folder, tmp_path):
    seen = []

    def once(progress):
        seen.append(progress)
        return progress.done < 1

    assert dataset.generate(tmp_path, threads=1, watch=once, **TINY) is None
    assert [progress.done for progress in seen] == [0, 1]
    assert (seen[1].all, seen[1].frames, seen[1].unsolved) == (2, 2, 0)
    hint = r"`ruffini dataset generate` that began .*manifest\.json"
    with pytest.raises(FileNotFoundError, match=hint):
        dataset.open(tmp_path)
    [kept] = tmp_path.glob("shards/*")
    before = kept.stat().st_mtime_ns
    assert dataset.generate(tmp_path, threads=2, **TINY) is not None
    assert kept.stat().st_mtime_ns == before
    assert shards(tmp_path) == shards(folder)


def test_a_stop_loses_no_solved_grasp(tmp_path):
    settings = {**TINY, "objects": 1, "grasps": 3}

    def twice(progress):
        return progress.done < 2

    assert dataset.generate(tmp_path, threads=1, watch=twice, **settings) is None
    assert len(list(tmp_path.glob("parts/*"))) == 2 and not list(tmp_path.glob("shards/*"))
    # A part that a crash of the machine cut short is solved again.
    damaged = min(tmp_path.glob("parts/*"))
    damaged.write_bytes(damaged.read_bytes()[:100])
    seen = []

    def watch(progress):
        seen.append(progress.done)
        return True

    data = dataset.generate(tmp_path, threads=1, watch=watch, **settings)
    assert seen == [1, 2, 3] and len(data) == 6
    assert not (tmp_path / "parts").exists()


def test_shards_made_apart_are_those_made_together(folder, tmp_path):
    first, second = dataset.shards(**TINY)
    assert dataset.generate(tmp_path, shards=[], **TINY) is None
    assert dataset.generate(tmp_path, shards=[second], threads=1, **TINY) is None
    assert [path.name for path in tmp_path.glob("shards/*")] == [second.split("/")[1]]
    assert dataset.generate(tmp_path, shards=[first, second], threads=1, **TINY) is None
    assert dataset.generate(tmp_path, threads=1, **TINY) is not None
    for file in (*shards(folder), "manifest.json"):
        [made] = tmp_path.rglob(file)
        [known] = folder.rglob(file)
        assert made.read_bytes() == known.read_bytes(), file
    with pytest.raises(ValueError, match="shard: found shards/none, expected one of 2 names"):
        dataset.generate(tmp_path, shards=["shards/none"], **TINY)


def test_anchors_tell_where_the_skin_sticks(data):
    mesh = data.mesh(0)
    for frame in data:
        for pad in frame.pads:
            assert len(pad.anchors) > 0
            rest, place = pad.anchors[:, 0], pad.anchors[:, 1]
            assert (rest[:, 2] > mesh.vertices[:, 2].min() + 1e-3).all(), "an anchor at the base"
            # What sticks is pressed in by less than it closed: rest and place are that near.
            x, y, z, w = pad.press[3:]
            turn = np.array(
                [
                    [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
                ]
            )
            apart = np.linalg.norm(place @ turn.T + pad.press[:3] - rest, axis=1)
            assert apart.max() < 2 * frame.closing + 1e-4, f"{apart.max()} m"


def test_a_dataset_of_a_later_format_is_refused(folder, tmp_path):
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    manifest = (tmp_path / "manifest.json").read_text()
    (tmp_path / "manifest.json").write_text(manifest.replace('"format": 2', '"format": 3'))
    with pytest.raises(ValueError, match="found format 3, expected 1 or 2"):
        dataset.open(tmp_path)
    claim = (tmp_path / "config.json").read_text()
    (tmp_path / "config.json").write_text(claim.replace('"format": 2', '"format": 3'))
    with pytest.raises(ValueError, match="another format lies here, expected format 2"):
        dataset.generate(tmp_path, **TINY)


def test_ctrl_c_stops_a_generation(tmp_path, request):
    # A background job starts with the signal ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))

    def interrupt(_):
        os.kill(os.getpid(), signal.SIGINT)
        return True

    with pytest.raises(KeyboardInterrupt):
        dataset.generate(tmp_path, threads=1, watch=interrupt, **TINY)


def test_an_error_of_the_watcher_stops_a_generation(tmp_path):
    def broken(_):
        raise KeyError("watcher")

    with pytest.raises(KeyError, match="watcher"):
        dataset.generate(tmp_path, threads=1, watch=broken, **TINY)
    assert list(tmp_path.glob("shards/*")) == []


def test_a_folder_with_another_dataset_is_refused(folder):
    with pytest.raises(ValueError, match="another dataset lies here"):
        dataset.generate(folder, **{**TINY, "seed": 1})


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"objects": 64}, "objects: found 64, expected 1 to 63"),
        ({"frames": 0}, "frames: found 0"),
        ({"grasps": -1}, "found integer `-1`, expected a whole number from 0"),
        (
            {"scenario": "presses", "frames": 3},
            "frames: found 3, expected 7, as many as a press has",
        ),
        ({"colour": "red"}, "unknown field `colour`"),
        ({"truth_element": "p9"}, "p9"),
        ({"threads": 0}, "threads: found 0"),
    ],
)
def test_a_bad_setting_is_named(tmp_path, settings, text):
    with pytest.raises(ValueError, match=text):
        dataset.generate(tmp_path / "none", **{**TINY, **settings})
    assert not (tmp_path / "none").exists()


def test_damage_is_found(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    dataset.open(copy).verify()
    damaged = next(copy.glob("shards/*"))
    content = bytearray(damaged.read_bytes())
    content[-1] ^= 1
    damaged.write_bytes(content)
    with pytest.raises(ValueError, match=rf"{damaged.name}: damaged, SHA-256"):
        dataset.open(copy).verify()


def test_every_bad_file_is_named_and_trained_on_by_nobody(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    first, second = sorted(copy.glob("shards/*"))
    whole = first.read_bytes()

    def found(*parts):
        done = command("inspect", str(copy))
        assert done.returncode == 2
        for part in parts:
            assert part in done.stderr, done.stderr
        with pytest.raises(ValueError, match=parts[0]):
            surrogate.train(copy, tmp_path / "run", epochs=1, network={"width": 8})

    first.write_bytes(whole[:-8])
    found(f"{first.name}: truncated")
    first.write_bytes(whole[:-1] + b"\x01")
    (copy / "shards/other.safetensors").write_bytes(whole)
    found(f"{first.name}: damaged", "other.safetensors: not of this dataset")
    first.unlink()
    second.write_bytes(b"")
    found(f"{second.name}: truncated", f"{first.name}: missing")


@pytest.mark.parametrize(
    ("file", "content", "expected"),
    [
        ("meshes/0.safetensors", "x", "0.safetensors: damaged"),
        ("config.json", "{", "config.json: damaged"),
        ("config.json", '{"seed": 3}', "config.json: not the configuration of manifest.json"),
        ("manifest.json", "{", "manifest.json: damaged"),
        ("manifest.json", "[]", "manifest.json: damaged, expected a JSON object"),
        ("manifest.json", "{}", "manifest.json: damaged, found no config"),
    ],
)
def test_a_damaged_file_without_a_hash_is_named(folder, tmp_path, file, content, expected):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    (copy / file).write_text(content)
    done = command("inspect", str(copy))
    assert (done.returncode, "Traceback" in done.stderr) == (2, False), done.stderr
    assert expected in done.stderr, done.stderr


def with_tensors(file, **tensors):
    """Write a file of safetensors that lacks what it should hold."""
    import safetensors.numpy

    safetensors.numpy.save_file(tensors, file)


def with_a_wrong_corner(file):
    """Write a mesh with a tetrahedron at a vertex that is not there."""
    import safetensors.numpy

    arrays = safetensors.numpy.load_file(file)
    arrays["tets"][-1, -1] = len(arrays["vertices"])
    safetensors.numpy.save_file(arrays, file)


@pytest.mark.parametrize("words", [["inspect"], ["export", "0", "a.npz"], ["plot", "-o", "a.png"]])
@pytest.mark.parametrize(
    ("damage", "expected"),
    [
        (lambda file: file.write_text("x"), "damaged, Error while deserializing"),
        (lambda file: with_tensors(file, other=np.zeros(3)), "damaged, File does not contain"),
        (with_a_wrong_corner, "damaged, mesh from arrays: tetrahedron"),
        (lambda file: file.unlink(), ""),
    ],
)
def test_a_damaged_mesh_is_named(folder, tmp_path, monkeypatch, capsys, words, damage, expected):
    if words[0] == "plot":
        pytest.importorskip("matplotlib")
    shutil.copytree(folder, tmp_path / "copy")
    file = tmp_path / "copy/meshes/0.safetensors"
    damage(file)
    monkeypatch.chdir(tmp_path)
    assert main(["dataset", words[0], str(tmp_path / "copy"), *words[1:]]) == 2
    said = capsys.readouterr().err
    assert str(file) in said and expected in said, said
    assert said.count("\n") == 1 + (words[0] == "inspect"), said


def test_a_shard_without_its_tensors_is_named(folder, tmp_path):
    shutil.copytree(folder, tmp_path / "copy")
    shard = min(tmp_path.glob("copy/shards/*"))
    with_tensors(shard, other=np.zeros(3))
    data = dataset.open(tmp_path / "copy")
    with pytest.raises(ValueError, match=f"{shard}: damaged, File does not contain tensor"):
        list(data)


def test_a_split_that_a_dataset_does_not_have_is_named_before_it_is_read(tmp_path):
    """Of a dataset whose pads do not fit the network, which was all that was said."""
    data = Path(__file__).parents[1] / "reference/grasps"
    with pytest.raises(ValueError, match=r"found novel-13, did you mean 'novel-14'\? expected one"):
        surrogate.train(data, tmp_path / "run", split="novel-13")
    assert not (tmp_path / "run").exists()


def test_numbers_that_are_not_finite_are_named(folder, tmp_path):
    """As an earlier version could have stored them: the hash is that of the file."""
    import safetensors.numpy

    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    shard = sorted(copy.glob("shards/*"))[0]
    with safetensors.safe_open(shard, "numpy") as file:
        arrays = {name: file.get_tensor(name).copy() for name in file.keys()}  # noqa: SIM118
        texts = file.metadata()
    arrays["000.first.von_mises"][0, 3] = np.nan
    safetensors.numpy.save_file(arrays, shard, texts)
    manifest = json.loads((copy / "manifest.json").read_text())
    data = shard.read_bytes()
    sums = {"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}
    [listed] = [one for one in manifest["shards"] if one["file"] == f"shards/{shard.name}"]
    listed |= sums
    (copy / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(ValueError, match=rf"{shard.name}: 000.first.von_mises holds NaN"):
        dataset.open(copy).verify()
    settings = {"epochs": 1, "split": "known-63", "network": {"width": 8, "rounds": 1}}
    with pytest.raises(ValueError, match=rf"{shard.name}: 000.first.von_mises holds NaN"):
        surrogate.train(copy, tmp_path / "run", variant="baseline", **settings)


def write_peg(path, scale=1000.0):
    """Write a capsule of 8 by 16 mm, in mm if not scaled otherwise."""
    vertices, faces = ruffini.Shape.capsule(0.004, 0.004).surface(48)
    lines = [f"v {x} {y} {z}\n" for x, y, z in scale * vertices]
    path.write_text("".join(lines + [f"f {a} {b} {c}\n" for a, b, c in faces + 1]))


PRESSES = {
    **{name: TINY[name] for name in ("gels", "grasps")},
    **{"scenario": "presses", "truth_nodes": 700, "model_nodes": 700, "depth": 0.1},
}


def test_meshes_of_ones_own_are_pressed_kept_and_learnt_from(tmp_path):
    file, folder = tmp_path / "peg.obj", tmp_path / "data"
    write_peg(file)
    config = tmp_path / "own.toml"
    config.write_text('objects = 0\n[[object]]\nmesh = "peg.obj"\nscale = 0.001\ngrasps = 4\n')
    data = dataset.generate(folder, config, threads=2, **PRESSES)
    assert data is not None and len(data.grasps) >= 3, data.manifest["unsolved"]
    assert {*data.grasps} <= {f"peg-1/{number:03}" for number in range(4)}
    assert family(data.grasps[0]) == "peg"
    [listed] = data.manifest["config"]["object"]
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    assert (listed["mesh"], listed["sha256"]) == ("peg.obj", digest)
    for part, numbers in (("train", "01"), ("validation", "2"), ("test", "3")):
        held = [grasp for grasp in data.grasps if grasp[-1] in numbers]
        assert data.splits["presses"][part] == held
        assert data.splits["meshes"][part] == (data.grasps if part == "test" else [])
    # The same from elsewhere, to the byte.
    own = [{"mesh": file, "scale": 0.001, "grasps": 4}]
    again = tmp_path / "again"
    assert dataset.generate(again, threads=1, objects=0, object=own, **PRESSES) is not None
    assert shards(again) == shards(folder)
    assert (again / "config.json").read_text() == (folder / "config.json").read_text()
    # Another mesh of this name is another dataset.
    write_peg(file, 900.0)
    with pytest.raises(ValueError, match=r"a dataset with another .*peg\.obj lies here"):
        dataset.generate(folder, config, **PRESSES)
    # What was pressed is in the dataset.
    file.unlink()
    data.verify()
    errors = dataset.truth_errors(folder, tmp_path / "finer", sample=1, truth_nodes=1000)
    assert errors and {row.grasp for row in errors} <= {*data.grasps}
    options = {"split": "presses", "epochs": 1, "linear_nodes": 700, "network": {"width": 8}}
    assert surrogate.train(folder, tmp_path / "run", **options) is not None
    write_peg(folder / "meshes/peg.obj", 900.0)
    with pytest.raises(ValueError, match=r"peg\.obj: damaged"):
        data.verify()
    with pytest.raises(ValueError, match=r"peg\.obj: its SHA-256 is"):
        surrogate.train(folder, tmp_path / "run", **options)


def test_meshes_of_ones_own_are_grasped(tmp_path):
    write_peg(tmp_path / "peg.obj", 2.0)
    own = [{"mesh": tmp_path / "peg.obj"}]
    data = dataset.generate(tmp_path / "data", threads=2, **{**TINY, "objects": 0, "object": own})
    assert data is not None and data.grasps == ["peg-1/000"] and len(data) == 2
    off = data[0].imbalance()
    assert off["force"] <= 1.001e-6 and off["torque"] <= 1.001e-7


def test_a_mesh_that_is_no_object_is_named_before_anything_is_made(tmp_path):
    write_peg(tmp_path / "peg.obj")
    for mesh, text in (
        ({"mesh": "none.obj"}, "No such file or directory: 'none.obj'"),
        ({"mesh": tmp_path / "peg.obj"}, r"peg\.obj: mesh size: found 16.* the scale 0\.001"),
        ({"mesh": tmp_path / "peg.obj", "scal": 0.001}, "`scal`, did you mean 'scale'"),
        ({"mesh": tmp_path / "peg.obj", "scale": 0.03}, "peg-1, for which no grasp was found"),
    ):
        for ask in (dataset.estimate, dataset.generate):
            with pytest.raises((ValueError, FileNotFoundError), match=text):
                ask(tmp_path / "data", **{**TINY, "object": [mesh]})
    assert not (tmp_path / "data").exists()


def test_a_long_generation_asks_first(tmp_path, monkeypatch):
    config = tmp_path / "empty.toml"
    config.write_text("")
    out = tmp_path / "out"
    done = command("generate", str(out), "--config", str(config))
    assert done.returncode == 2 and not out.exists()
    assert "6300 grasps with 315000 frames take about" in done.stderr and "--yes" in done.stderr
    monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=lambda: True))
    monkeypatch.setattr("builtins.input", lambda question: "n")
    assert main(["dataset", "generate", str(out), "--config", str(config)]) == 2
    assert not out.exists()
    begun = []
    monkeypatch.setattr("builtins.input", lambda question: "y")
    monkeypatch.setattr(dataset, "generate", lambda *arguments, **settings: begun.append(settings))
    # What follows finds no dataset.
    assert main(["dataset", "generate", str(out), "--config", str(config)]) == 2
    assert main(["dataset", "generate", str(out), "--config", str(config), "--yes"]) == 2
    assert len(begun) == 2


def test_the_estimate_counts_what_is_missing(folder, tmp_path):
    some = dataset.estimate(tmp_path / "new", **TINY)
    assert (some.grasps, some.frames) == (2, 4) and some.bytes > 0 and some.seconds > 0
    assert not (tmp_path / "new").exists()
    assert dataset.estimate(folder, **TINY).grasps == 0


def test_ctrl_c_ends_a_grasp_that_is_being_solved(tmp_path):
    """Within seconds, where a grasp of this dataset takes minutes; none is stored in part."""
    code = (
        "from ruffini import dataset\n"
        f"dataset.generate({str(tmp_path / 'out')!r}, threads=1, objects=1, "
        f"grasps=1, frames=40, truth_nodes=2500, truth_element='p2', model_nodes=200, "
        "watch=lambda now: print(now) is None)"
    )
    seconds, _, said = interrupted(code)
    assert seconds < 15 and b"KeyboardInterrupt" in said
    assert list((tmp_path / "out/parts").glob("*")) == []


def command(*words):
    line = [sys.executable, "-m", "ruffini", "dataset", *words]
    return subprocess.run(line, capture_output=True, text=True, check=False)


def test_the_command_generates_and_inspects(folder, tmp_path):
    config = tmp_path / "tiny.toml"
    gel = "\n".join(f"{name} = {value!r}" for name, value in TINY["gels"][0].items())
    sizes = f"truth_nodes = 400\nmodel_nodes = 200\nforce = {TINY['force']}\n"
    config.write_text(f"{sizes}[[gels]]\n{gel}\n")
    made = tmp_path / "made"
    counts = ["--objects", "2", "--grasps", "1", "--frames", "2", "--threads", "2"]
    done = command("generate", str(made), "--config", str(config), *counts)
    assert done.returncode == 0, done.stderr
    announced, held_out, *lines = done.stderr.splitlines()
    assert announced.startswith("2 grasps, 0 of them done; about") and "free" in announced
    assert held_out.endswith("no validation part, no test on known objects")
    assert len(lines) == 2 and lines[-1].startswith("2/2 grasps, 4 frames, 0 unsolved")
    assert shards(made) == shards(folder)
    assert command("inspect", str(made)).stdout == done.stdout
    table = dict(line.split(maxsplit=1) for line in done.stdout.splitlines())
    assert table["force"].startswith("at most") and "N out of balance" in table["force"]
    assert [table[name] for name in ("objects", "grasps", "frames", "unsolved")] == list("2240")


def test_the_command_names_a_folder_without_a_dataset(tmp_path):
    done = command("inspect", str(tmp_path))
    assert (done.returncode, done.stdout) == (2, "")
    assert "manifest.json" in done.stderr and "Traceback" not in done.stderr


def test_a_frame_is_written_for_paraview(data, folder, tmp_path):
    done = command("export", str(folder), "-1", str(tmp_path / "frame.npz"))
    files = [str(tmp_path / f"frame-{side}.npz") for side in ("first", "second")]
    assert done.stdout.splitlines() == files
    pads, mesh = [np.load(file) for file in files], data.mesh(0)
    for pad, stored in zip(pads, data[-1].pads, strict=True):
        assert np.array_equal(pad["tets"], mesh.tets)
        assert np.array_equal(pad["von_mises"], stored.von_mises)
    # The object is pressed from both sides: seen from outside, the forces on the pads cancel.
    force = np.concatenate([pad["contact_force"] for pad in pads])
    net, pressed = force.sum(axis=0), np.abs(force).sum()
    assert np.abs(net).max() < 1e-5 * pressed, f"{net} N left of {pressed} N"
    # Pads stand on either side of the object, bases outwards and faces towards it.
    ends = [mesh.vertices[:, 2].argmin(), mesh.vertices[:, 2].argmax()]
    apart = [np.linalg.norm(pads[0]["vertices"][i] - pads[1]["vertices"][i]) for i in ends]
    assert apart[0] > apart[1] > 0.01
    assert command("export", str(folder), "0", str(tmp_path / "frame.vtu")).returncode == 0
    assert (tmp_path / "frame-second.vtu").read_bytes().startswith(b"<?xml")
    missing = command("export", str(folder), "4", "frame.vtu")
    assert missing.returncode == 2 and "found 4, expected less than 4" in missing.stderr


def test_distributions_are_drawn_by_family(data, folder, tmp_path):
    pytest.importorskip("matplotlib")
    assert (
        command("plot", str(folder), "-o", str(tmp_path / "a.svg")).stdout == f"{tmp_path}/a.svg\n"
    )
    text = (tmp_path / "a.svg").read_text()
    assert text.rstrip().endswith("</svg>")
    columns = by_family(data)
    assert sum(len(of["force"]) for of in columns.values()) == len(data)
    for name, of in columns.items():
        frames = [frame for frame in data if family(frame.grasp) == name]
        assert np.array_equal(of["force"], [frame.force for frame in frames])
        peaks = [1e-3 * max(pad.von_mises.max() for pad in frame.pads) for frame in frames]
        np.testing.assert_allclose(of["stress"], peaks, rtol=1e-6)
        assert (of["depth"] > 0).all() and (of["depth"] <= 0.5).all()
        # Pads cannot pull sideways with more than friction allows.
        assert (of["shear"] < 0.61).all(), of["shear"]
    assert command("plot", str(folder), "-o", "a.gif").returncode == 2
    full = tmp_path / "full.png"
    full.symlink_to("/dev/full")
    refused = command("plot", str(folder), "-o", str(full))
    assert refused.returncode == 2
    assert refused.stderr == f"ruffini: {full}: No space left on device\n"


def test_a_field_that_is_not_there_is_named(data):
    with pytest.raises(ValueError, match=r"'forse', did you mean 'force'\? expected one of clos"):
        data.column(data.grasps[0], "forse")
