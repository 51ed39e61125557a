"""Indenters of any size on one pad: data, and a network that learns from them."""

from __future__ import annotations

import json
import multiprocessing
import re
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from fresh import fresh

from ruffini import LinearPad, Press, PressError, Shape, Surrogate, dataset, surrogate
from ruffini._core import solve_press
from ruffini._distributions import by_family, family
from ruffini.commands import main

load_file = pytest.importorskip("safetensors.numpy").load_file

GEL = {"sensor": "gelsight-mini", "young": 3e5, "poisson": 0.47, "friction": 1.0, "share": 1.0}
PRESSES = {
    "scenario": "presses",
    "objects": 10,
    "grasps": 1,
    "frames": 7,
    "model_nodes": 700,
    "truth_nodes": 700,
    "truth_element": "p1-bar",
    "depth": 0.1,
    "gels": [GEL],
}


FIELDS = ("displacement", "von_mises", "wrench")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    data = dataset.generate(tmp_path_factory.mktemp("data") / "presses", threads=2, **PRESSES)
    assert data is not None
    return data


def test_every_frame_can_be_read_and_its_forces_add_up(data):
    assert data.presses and len(data.grasps) >= 8, data.manifest["unsolved"]
    sizes = set()
    for frame in data:
        mesh = data.mesh(frame.grasp)
        assert frame.pad.displacement.shape == frame.pad.contact_force.shape == mesh.vertices.shape
        assert frame.pad.von_mises.shape == (len(mesh.tets),)
        pressed = np.abs(frame.pad.contact_force).sum()
        assert pressed > 0 and frame.imbalance()["contact"] < 1e-6 * pressed + 2e-7
        assert frame.pad.wrench[2] < 0, "contact pulls"
        sizes.add(frame.grasp.split("-")[0])
    assert len(sizes) >= 8, "families"


def test_a_press_moves_as_it_was_drawn(data):
    for grasp in data.grasps:
        plan = data.plan(grasp)["indentation"]
        heights = [data[i].pad.press[2] for i in data.frames(grasp)]
        assert len(heights) <= (7 if plan["onward"] else 4)
        assert (np.diff(heights[:4]) < 0).all(), "it goes down"
        assert 0 <= plan["friction"] <= 2 and 0 < plan["depth"] <= 0.1 * 4e-3


def test_load_steps_keep_the_frames_and_change_the_way_there(data, tmp_path):
    stepped = dataset.generate(tmp_path / "stepped", threads=2, truth_steps=4, **PRESSES)
    assert stepped is not None and stepped.manifest["config"]["truth_steps"] == 4
    apart = []
    for grasp in set(data.grasps) & set(stepped.grasps):
        for i, j in zip(data.frames(grasp), stepped.frames(grasp), strict=False):
            one, four = data[i].pad, stepped[j].pad
            assert np.allclose(one.press, four.press, atol=1e-12)
            apart.append(np.abs(one.displacement - four.displacement).max())
    assert max(apart) > 1e-6, "friction holds gel elsewhere"
    with pytest.raises(ValueError, match="truth_steps"):
        dataset.generate(tmp_path / "none", truth_steps=0, **PRESSES)


def ball(radius, folder):
    """A mesh object for a configuration: a ball."""
    vertices, faces = Shape.sphere(radius).surface(48)
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    (folder / "ball.obj").write_text("\n".join(lines))
    return Shape.mesh(vertices, faces), {"mesh": str(folder / "ball.obj"), "grasps": 2}


def test_what_the_nonlinear_law_changes_is_added_to_finely_resolved_contact(tmp_path):
    shape, mesh = ball(4e-3, tmp_path)
    settings = {**PRESSES, "objects": 0, "object": [mesh], "truth_element": "p2", "depth": 0.3}
    pair = {"truth_nodes": 300, "truth_linear_nodes": 1500}
    data = dataset.generate(tmp_path / "corrected", threads=2, **settings | pair)
    finer = {"truth_nodes": 900, "truth_across": 20.0}
    direct = dataset.generate(tmp_path / "direct", threads=2, **settings | finer)
    assert data is not None and direct is not None
    assert data.grasps == direct.grasps and len(data.grasps) == 2, data.manifest["unsolved"]
    for grasp in data.grasps:
        gel = {"young": 3e5, "poisson": 0.47}
        gel["friction"] = data.plan(grasp)["indentation"]["friction"]
        linear = LinearPad("gelsight-mini", **gel, contact="fine", resolution=700)
        path = [(pose[:3], pose[3:]) for pose in data.column(grasp, "first.press")]
        answers = linear.solve_path(Press(shape, path))
        frames = zip(data.frames(grasp), direct.frames(grasp), answers, strict=True)
        for number, other, answer in frames:
            found, exact = data[number], direct[other].pad
            assert found.imbalance()["contact"] < 1e-5 * np.abs(found.pad.wrench).max()
            assert 0 < apart(found.pad.wrench[:3], answer.wrench[:3]) < 0.15
            # By the pad's sides the linear contact is a tenth off.
            for field in FIELDS:
                assert apart(getattr(found.pad, field), getattr(exact, field)) < 0.25, field
        # The same press alone, without the dataset.
        alone = {**settings, **pair, "objects": 1, "object": [], "gels": [GEL | gel]}
        start = data.column(grasp, "first.start")
        poses = [(start[:3], start[3:]), *path]
        solved = solve_press(None, json.dumps(alone), shape, poses)
        for number, frame in zip(data.frames(grasp), solved, strict=True):
            for field, values in zip(FIELDS, frame, strict=True):
                assert apart(values, getattr(data[number].pad, field)) < 1e-4, field
    wrongs = ({"truth_linear_nodes": 5}, {"truth_element": "p1-bar"}, {"scenario": "pads"})
    for wrong in wrongs:
        with pytest.raises(ValueError, match="truth_linear_nodes"):
            dataset.generate(tmp_path / "none", **settings | pair | wrong)


def test_a_press_alone_says_what_is_wrong_with_it():
    ball, settings = Shape.sphere(4e-3), {**PRESSES, "objects": 1}
    path = [([0, 0, 4e-3 - depth], (0, 0, 0, 1)) for depth in (0.0, 1e-4)]
    for wrong, poses, told in (
        ({"scenario": "pads"}, path, "scenario: found pads, expected presses"),
        ({}, path[:1], "path: found first touch alone"),
        ({}, [], "path: found no pose"),
        ({}, [path[0], ([0, 0], (0, 0, 0, 1))], r"path\[1\]: position"),
        ({"truth_linear_nodes": 5}, path, "truth_linear_nodes"),
    ):
        with pytest.raises(ValueError, match=told):
            solve_press(None, json.dumps(settings | wrong), ball, poses)
    # Through the gel: the frames before it, and why it ends.
    deep = [*path, ([0, 0, -3e-3], (0, 0, 0, 1))]
    *frames, error = solve_press(None, json.dumps(settings), ball, deep)
    assert len(frames) == 1 and isinstance(error, PressError)


def apart(one, other):
    """Distance relative to the other."""
    return np.linalg.norm(one - other) / np.linalg.norm(other)


def test_the_error_of_its_elements_is_the_distance_to_a_finer_mesh(data, tmp_path, capsys):
    finer = tmp_path / "finer"
    found = dataset.truth_errors(data.path, finer, sample=2, truth_nodes=1400, truth_across=12)
    assert found and {row.grasp for row in found} <= set(data.grasps)
    for row in found:
        assert 0 < row.displacement < 1 and 0 < row.stress < 1 and 0 < row.force < 1, row
    # What is there is not solved again, and the same mesh again would be no finer.
    assert (
        dataset.truth_errors(data.path, finer, sample=2, truth_nodes=1400, truth_across=12) == found
    )
    with pytest.raises(ValueError, match="truth_nodes or truth_across above"):
        dataset.truth_errors(data.path, finer, sample=2, truth_nodes=700)
    command = ["dataset", "error", str(data.path), str(finer), "--sample", "2"]
    assert main([*command, "--nodes", "1400", "--across", "12"]) == 0
    assert f"{len(found)} frames on both meshes" in capsys.readouterr().out


def test_the_same_configuration_gives_the_same_bytes(data, tmp_path):
    again = dataset.generate(tmp_path / "again", threads=1, **{**PRESSES, "objects": 2})
    assert again is not None
    for shard in again.manifest["shards"]:
        [same] = [s for s in data.manifest["shards"] if s["file"] == shard["file"]]
        assert same["sha256"] == shard["sha256"]


def test_frames_are_compared_as_objects(data):
    frame = data[0]
    assert frame in [data[1], frame] and frame not in [data[1]] and len({frame, data[1]}) == 2


def test_splits_are_by_indenter(data):
    split = data.splits["presses"]
    parts = [{name.split("/")[0] for name in split[part]} for part in split]
    assert len(set.union(*parts)) == sum(map(len, parts))
    numbers = {part: {int(n.split("/")[0][-5:]) % 10 for n in split[part]} for part in split}
    drawn = {int(name.split("/")[0][-5:]) % 10 for name in data.grasps}
    held_back = {"test": drawn & {9}, "validation": drawn & {8}}
    assert numbers == held_back | {"train": drawn - {8, 9}}


def test_a_network_learns_from_it_feels_small_balls_and_predicts_its_errors(data, tmp_path, capsys):
    out = str(tmp_path / "run")
    options = ["--epochs", "2", "--width", "8"]
    assert main(["network", "train", str(data.path), out, *options, "--linear-nodes", "700"]) == 0
    assert "frames to train on" in capsys.readouterr().err
    network = Surrogate.load(f"{out}/weights.safetensors", friction=0.5)
    card = json.loads(network.card)
    assert card["data"]["friction"] == [0.0, 2.0] and card["training"]["split"] == "presses"
    weights = f"{out}/weights.safetensors"
    frames = surrogate.evaluate(weights, data.path)
    assert frames == surrogate.evaluate(weights, data.path, "presses")
    ball = Press(Shape.sphere(5e-4), [([7e-4, 5e-4, 5e-4 - d], (0, 0, 0, 1)) for d in (2e-5, 5e-5)])
    found = network.solve(ball)[0]
    assert not isinstance(found, PressError)
    # Between the nodes, which are 1.5 mm apart.
    assert found.wrench[2] < 0
    assert len(found.predicted_error) == 3 and all(e > 0 for e in found.predicted_error)
    plain = network.plain().solve(ball)[0]
    assert (
        np.abs(plain.displacement - found.displacement).max()
        < 1e-4 * np.abs(plain.displacement).max()
    )
    far = network.solve(Press(Shape.sphere(5e-4), [([0, 0, 2e-3], (0, 0, 0, 1))]))[0]
    assert far.predicted_error is None and not far.displacement.any()


def test_a_network_learns_from_solutions_of_two_fidelities(data, tmp_path, capsys):
    options = {"epochs": 1, "linear_nodes": 700, "network": {"width": 8}}
    card = surrogate.train(data.path, tmp_path / "one", **options)
    both = surrogate.train(data.path, tmp_path / "both", coarser=data.path, **options)
    assert card is not None and both is not None and "low_fidelity" not in card["data"]
    assert both["data"]["low_fidelity"] == card["data"]["train"]
    assert both["data"]["train"] == [2 * count for count in card["data"]["train"]]
    assert both["data"]["fingerprint"] != card["data"]["fingerprint"]
    weights = tmp_path / "both/weights.safetensors"
    fine, coarse = (surrogate.evaluate(weights, data.path, coarser=c) for c in (False, True))
    assert [f"{row['grasp']}, coarser" for row in fine] == [row["grasp"] for row in coarse]
    for one, same in zip(fine, coarse, strict=True):
        assert one["surrogate"] != same["surrogate"] and one["linear"] == same["linear"]
    other = dataset.generate(
        tmp_path / "other", **{**PRESSES, "objects": 1, "gels": [{**GEL, "poisson": 0.4}]}
    )
    assert other is not None
    with pytest.raises(ValueError, match="other: gels: found others"):
        surrogate.train(data.path, tmp_path / "wrong", coarser=other.path, **options)
    command = ["network", "train", str(data.path), str(tmp_path / "soft"), "--variant", "soft"]
    assert main([*command, "--coarser", str(data.path)]) == 2
    assert "coarser: found a dataset" in capsys.readouterr().err


def training(path: str, out: str) -> bytes:
    """Weights of a run that is watched by a model of its own."""

    def watch(*_: object) -> bool:
        press = Press(Shape.sphere(4e-3), [((0, 0, 3.9e-3), (0, 0, 0, 1))])
        [solved] = pad.solve([press])
        return bool(solved.wrench[2] < 0)

    pad = LinearPad()
    options = {"epochs": 1, "linear_nodes": 700, "network": {"width": 8}}
    assert surrogate.train(path, out, watch=watch, **options) is not None
    weights = load_file(Path(out, "weights.safetensors"))
    return b"".join(weights[name].tobytes() for name in sorted(weights))


def trainings(path: str, out: str) -> bytes:
    """Weights of a run of this process, and of one of a worker that is forked after it."""
    mine = training(path, f"{out}/mine")
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork")) as pool:
        return mine + pool.submit(training, path, f"{out}/theirs").result()


def test_a_forked_worker_trains_after_its_parent_and_both_may_solve_meanwhile(
    data, tmp_path, monkeypatch
):
    # With a single thread, whatever waits for another waits for ever.
    monkeypatch.setenv("RAYON_NUM_THREADS", "1")
    both = fresh(trainings, str(data.path), str(tmp_path))
    assert len(both) > 1000 and both[: len(both) // 2] == both[len(both) // 2 :]


def test_distributions_are_drawn_of_the_one_pad(data, tmp_path):
    pytest.importorskip("matplotlib")
    data.plot(tmp_path / "a.png")
    columns = by_family(data)
    assert sum(len(of["force"]) for of in columns.values()) == len(data)
    for name, of in columns.items():
        frames = [frame for frame in data if family(frame.grasp) == name]
        assert of["force"].tolist() == [-frame.pad.wrench[2] for frame in frames]
        assert (of["depth"] > 0).all() and (of["depth"] < 0.2).all(), of["depth"]


def test_a_dataset_without_a_solved_press_is_one_error(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    # A mesh of so few nodes is not refined where the indenter is.
    none = dataset.generate(tmp_path / "d", **{**PRESSES, "objects": 1, "truth_nodes": 100})
    assert none is not None and not none.grasps
    pytest.importorskip("viser")
    for words in (
        ["dataset", "plot", str(none.path), "-o", str(tmp_path / "a.png")],
        ["view", str(none.path), "--out", str(tmp_path / "a.html")],
    ):
        assert main(words) == 2
        assert capsys.readouterr().err == (
            f"ruffini: {none.path}: found no solved grasp, expected one or more\n"
        )


def test_a_mended_configuration_is_taken_after_one_that_was_refused(tmp_path):
    few = {**PRESSES, "objects": 1, "truth_nodes": 100}
    with pytest.raises(ValueError, match="sensor: found gelsight"):
        dataset.generate(tmp_path / "d", **{**few, "gels": [{**GEL, "sensor": "gelsight"}]})
    # That a pad cannot be meshed by so few nodes is only found where it is meshed.
    with pytest.raises(ValueError, match="nodes: found 5"):
        dataset.generate(tmp_path / "d", **{**few, "model_nodes": 5})
    assert not (tmp_path / "d/config.json").exists()
    assert dataset.generate(tmp_path / "d", **few) is not None


def test_the_page_names_every_key_of_a_configuration():
    page = (Path(__file__).parents[2] / "py/docs/data.md").read_text()
    _, table = page.split("\n## The configuration\n")
    keys = set()
    for row in re.findall(r"^\| (`.*?) \|", table.split("\n## ")[0], re.MULTILINE):
        keys |= set(re.findall(r"`(\w+)`", row))
    known = set()
    for wrong in ({"a": 1}, {"gels": [{"a": 1}]}):
        with pytest.raises(ValueError, match="unknown field") as found:
            dataset.shards(**wrong)
        known |= set(re.findall(r"`(\w+)`", str(found.value).partition("expected")[2]))
    # The content of a sensor's file is filled in.
    assert keys == known - {"definition"}


def test_wrong_settings_are_named(tmp_path):
    with pytest.raises(ValueError, match="frames: found 5, expected 7"):
        dataset.generate(tmp_path / "five", **{**PRESSES, "frames": 5})
    with pytest.raises(ValueError, match=r"scale: found 0\.5 to 0\.1"):
        dataset.generate(tmp_path / "scale", **{**PRESSES, "scale": [0.5, 0.1]})
    with pytest.raises(ValueError, match="objects: found 100001"):
        dataset.generate(tmp_path / "many", **{**PRESSES, "objects": 100_001})
    for name, value in (("poisson", 0.6), ("young", -1.0), ("friction", 101.0)):
        with pytest.raises(ValueError, match=rf"gels\[1\]\.{name}: found {value:g}"):
            gels = [GEL, {**GEL, name: value}]
            dataset.generate(tmp_path / name, **{**PRESSES, "gels": gels})
    found = dataset.generate(tmp_path / "few", **{**PRESSES, "objects": 1, "truth_nodes": 100})
    assert found is not None and "nodes: found 100" in found.manifest["unsolved"][0]["error"]
