"""`ruffini view`: what is in a recording, and what is wrong with the bad ones."""

from __future__ import annotations

import sys
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from tiny_dataset import TINY

from ruffini import OBJECTS, Shape, TetMesh, commands, dataset
from ruffini.commands import shapes, view
from ruffini.commands.policy import choose

pytest.importorskip("viser")
from ruffini import viewing

SETTINGS = {"max_episode_steps": 4, "resolution": {"nodes": 300}, "tactile": "compliance"}


@pytest.fixture(scope="module")
def frames():
    chosen = choose("HoldStill", "scripted", SETTINGS)
    return list(view.episode(chosen, 10_000))


def test_an_episode_shows_bodies_stress_and_curves(frames):
    assert len(frames) == 5
    for frame in frames:
        pads = [frame.bodies[name] for name in view._SIDES]
        assert isinstance(frame.bodies["object"], viewing.Rigid)
        for pad in pads:
            assert pad.von_mises.max() > 100
            assert len(pad.forces[0]) > 3 and pad.wrench[2] < -1
            assert pad.markers.shape == (35, 3)
        # The faces look at each other, and what is pressed in touches the object.
        assert pads[0].pose[0] < frame.bodies["object"].pose[0] < pads[1].pose[0]
        assert {"reward: still", "highest stress of each pad (kPa)"} <= set(frame.values)
    assert frames[-1].title.endswith((": success", ": failure"))


def test_steps_of_another_length_are_shown_as_long_as_they_take():
    physics = {"control_period": 0.1}
    settings = {"max_episode_steps": 2, "tactile": "none", "physics": physics}
    frames = list(view.episode(choose("GraspLift", "scripted", settings), 10_000))
    assert [frame.title.split(", ")[-1].split(" s")[0] for frame in frames] == [
        "0.00",
        "0.10",
        "0.20",
    ]
    assert {frame.seconds for frame in frames} == {0.1}


def test_the_deformed_face_lies_on_the_object(frames):
    body, pad = frames[-1].bodies["object"], frames[-1].bodies[view._SIDES[0]]
    points = pad.forces[0]
    world = view.turned(pad.pose, points) + pad.pose[:3]
    inverse = np.array([0, 0, 0, *(-body.pose[3:6]), body.pose[6]])
    shape = Shape.named(frames[-1].title.split(": ")[1].split()[0])
    scale = np.abs(body.vertices).max() / 0.02
    gaps = scale * shape.distance(view.turned(inverse, world - body.pose[:3]) / scale)[0]
    assert np.abs(gaps).max() < 3e-4, f"{np.abs(gaps).max()} m from the object"


def test_the_policy_plays_as_it_does_unwatched(frames):
    chosen = choose("HoldStill", "scripted", SETTINGS)
    env = gymnasium.make(chosen.env_id, **SETTINGS)
    observation, _ = env.reset(seed=10_000)
    state = None
    for frame in frames[1:]:
        batch = {name: values[None] for name, values in observation.items()}
        action, state = chosen.policy.predict(batch, state)
        observation, _, _, _, info = env.step(action[0])
        for name, value in info["reward_terms"].items():
            assert frame.values[f"reward: {name}"] == [value]


def test_a_recording_is_one_page_that_needs_no_network(frames, tmp_path):
    out, said = tmp_path / "a.html", []
    scene = viewing.Scene(True, out)
    assert scene.record([frames], out) == 5
    names = set(scene._scene._handle_from_node_name)
    scene.close()
    for part in ("contact", "force", "markers", "wrench"):
        assert {f"/{side}/{part}" for side in view._SIDES} <= names, part
    assert any(name.startswith(f"/{view._SIDES[0]}/gel-") for name in names)
    assert {"/title", "/scale", "/scale-1", "/charts/0", "/charts/0/name"} <= names
    assert {"/legend-0", *(f"/{side}: face/name" for side in view._SIDES)} <= names
    assert any(name.startswith("/object-") for name in names)
    text = out.read_text()
    assert text.lstrip().startswith("<!doctype html>") and "__VISER_EMBED_DATA__" in text
    assert 'src="http' not in text and 'href="http' not in text
    viewing.view([frames[:1]], out, say=said.append)
    assert said[0].startswith(f"{out}: 1 frame,")


def test_bodies_charts_and_texts_are_in_the_picture(frames, tmp_path):
    scene = viewing.Scene(True, tmp_path / "a.html")
    scene.record([frames], tmp_path / "a.html")
    camera, nodes = scene._server.initial_camera, scene._nodes
    ahead = np.subtract(camera.look_at, camera.position)
    right = np.cross(ahead, [0, 0, 1])
    axes = np.stack(
        [axis / np.linalg.norm(axis) for axis in (right, np.cross(right, ahead), ahead)]
    )
    seen = [viewing._corners(frame.bodies[name]) for frame in frames for name in ("palm", "object")]
    flat = [
        name for name in nodes if name in ("/title", "/legend-2") or str(name).endswith("/high")
    ]
    points = np.concatenate([*seen, [nodes[name].position for name in flat]])
    across, up, depth = axes @ (points - camera.position).T
    scene.close()
    half = np.tan(camera.fov / 2) * depth
    # A window that is 16 : 10, which is narrower than most.
    assert len(flat) > 10 and (np.abs(up) < half).all() and (np.abs(across) < 1.6 * half).all()


def test_one_moment_of_high_stress_does_not_take_the_colour_from_the_others(frames, tmp_path):
    pad = frames[-1].bodies[view._SIDES[0]]
    high = replace(pad, von_mises=100 * pad.von_mises)
    scene = viewing.Scene(True, tmp_path / "a.html")
    scene._set_top(
        [viewing.ViewerFrame("", {"pad": pad})] * 19 + [viewing.ViewerFrame("", {"pad": high})]
    )
    top, label = scene._top, scene._nodes["/scale-1"].text
    scene.close()
    assert pad.von_mises.max() <= top < 2 * pad.von_mises.max(), f"{top} Pa"
    assert label.endswith("kPa or more")


def test_names_of_curves_do_not_end_with_a_count(frames):
    assert {"force, −x pad (N)", "force, +x pad (N)"} <= set(frames[0].values)


def test_live_frames_are_shown_until_ctrl_c(frames, monkeypatch):
    def stop(seconds):
        raise KeyboardInterrupt

    monkeypatch.setattr(viewing.time, "sleep", stop)
    monkeypatch.setattr(viewing.webbrowser, "open", lambda url: False)
    said = []
    viewing.view([frames], None, say=said.append)
    assert said[0].startswith("http://127.0.0.1:") and "--out FILE.html" in said[0]


def test_a_press_is_shown(tmp_path, capsys):
    out = tmp_path / "press.html"
    words = "--sensor gelsight-mini --shape sphere:0.004 --depth 0.0002 --resolution 300 --view"
    assert commands.main(["press", *words.split(), str(out)]) == 0
    assert f"{out}: 2 frames" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("settings", "gels"),
    [
        ({}, {"pad on -x", "pad on +x"}),
        ({"scenario": "soft", "truth_nodes": 300}, {"object"}),
        ({"scenario": "presses", "frames": 7, "depth": 0.0005}, {"pad"}),
    ],
    ids=["pads", "soft", "presses"],
)
def test_frames_of_a_dataset_are_shown(settings, gels, tmp_path, capsys):
    pytest.importorskip("safetensors")
    folder, out = tmp_path / "data", tmp_path / "a.html"
    chosen = {**TINY, "objects": 1} | settings
    if settings.get("scenario") == "soft":
        chosen["gels"] = [{**TINY["gels"][0], "sensor": "digit", "young": 1e5, "poisson": 0.45}]
    data = dataset.generate(folder, threads=2, **chosen)
    frames = list(view._grasp(data, None))
    assert len(frames) == len(data.frames(data.grasps[0]))
    bodies = frames[-1].bodies
    assert {name for name, body in bodies.items() if isinstance(body, viewing.Soft)} == gels
    # Only the indenters of presses are not drawn.
    assert len(bodies) == (1 if data.presses else 3)
    for name in gels:
        assert len(bodies[name].forces[0]) > 0 and bodies[name].von_mises.max() > 0
    assert commands.main(["view", str(folder), "-1", "--out", str(out)]) == 0
    assert f"{out}: 1 frame," in capsys.readouterr().out
    assert commands.main(["view", str(folder), "99", "--out", str(out)]) == 2
    assert "frame: found 99, expected less than" in capsys.readouterr().err


def test_rigid_fingers_and_objects_of_ones_own_are_shown(tmp_path):
    vertices, faces = Shape.cone(0.01, 0.02).surface()
    part = tmp_path / "part.obj"
    part.write_text(
        "".join(f"v {x} {y} {z}\n" for x, y, z in 1000 * vertices)
        + "".join(f"f {a} {b} {c}\n" for a, b, c in faces + 1)
    )
    for thing in (
        {"mesh": str(part), "scale": 1e-3},
        {"shape": "cone", "radius": 0.01, "half_height": 0.02},
    ):
        settings = {"objects": thing, "size": 1, "tactile": "none", "max_episode_steps": 2}
        chosen = choose("GraspLift", "random", settings | {"observation": ["proprio"]})
        frames = list(view.episode(chosen, 1))
        body = frames[-1].bodies["object"]
        assert len(frames) == 3 and abs(np.ptp(body.vertices[:, 2]) - 0.04) < 1e-6
        assert not any(isinstance(body, viewing.Soft) for body in frames[0].bodies.values())


@pytest.mark.parametrize("name", OBJECTS)
def test_the_surface_of_an_object_is_its_shape_and_rests_on_the_table(name):
    env = gymnasium.make(
        "ruffini/GraspLift-v0", objects=name, size=1, tactile="none", observation=["object"]
    )
    assert env.unwrapped.surfaces() == {}
    env.reset(seed=3)
    vertices, faces, stress = env.unwrapped.surfaces()["object"]
    off = np.abs(Shape.named(name).distance(vertices)[0]).max()
    assert off < 1e-6 and stress is None, f"{off} m beside the shape"
    look = env.unwrapped.look()
    pose = np.array([*look["object_position"], *look["object_quaternion"]])
    lowest = (view.turned(pose, vertices) + pose[:3])[:, 2].min()
    assert abs(lowest) < 5e-4, f"the lowest point is {lowest} m over the table"
    assert faces.max() < len(vertices)


def test_a_soft_object_is_shown_deformed():
    chosen = choose("GraspSoft", "scripted", {"max_episode_steps": 60})
    frames = list(view.episode(chosen, 10_000))
    first, squeezed = (max(frames, key=key).bodies["object"] for key in (_rest, _stress))
    assert first.von_mises.max() == 0 and squeezed.von_mises.max() > 10
    moved = np.abs(squeezed.vertices - first.vertices).max()
    assert 1e-5 < moved < 0.02, f"{moved} m"


def _stress(frame):
    return frame.bodies["object"].von_mises.max()


def _rest(frame):
    return -_stress(frame)


def test_the_hole_of_a_peg_is_shown():
    chosen = choose("InsertPeg", "scripted", {"max_episode_steps": 2, "tactile": "none"})
    frame = next(view.episode(chosen, 10_000))
    block = frame.bodies["fixture"].vertices
    assert block[:, 2].min() == pytest.approx(0, abs=1e-9) and block[:, 2].max() > 0.01


@pytest.mark.parametrize("form", ["capsule:0.01,0.02", "cone:0.01,0.02", "half-space", "potato"])
def test_shapes_of_the_command_line_have_pictures(form):
    shape = shapes.shape(form)
    vertices, _ = shapes.surface(shape)
    off = np.abs(shape.distance(vertices)[0])
    # A half-space is shown as a plate.
    assert (off.min() if form == "half-space" else off.max()) < 1e-6


def test_the_skin_of_a_mesh_is_closed_and_looks_outward():
    skin = viewing.Skin(TetMesh.of_shape(Shape.cuboid([0.01, 0.01, 0.01]), 0.004))
    a, b, c = (skin.rest[skin.faces[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert abs(volume - 8e-6) < 2e-7, f"{volume} m³"


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["GraspLfit"], "GraspLift"),
        (["--policy", "scriptd"], "did you mean 'scripted'"),
        (["--out", "a.rrd"], "expected a .html file"),
        (["--out", "nowhere/a.html"], "nowhere/a.html: No such file or directory"),
        (["--policy", "random", "--episodes", "0"], "expected a whole number from 1"),
        (["--policy", "random", "--seed", "-1"], "seed: found -1"),
        (["GraspLift", "3"], "expected the folder of a dataset"),
        (["no/such/folder"], "InsertPeg, or the folder of a dataset"),
        (["run"], "found a training run in run, expected a task or the folder of a dataset; --pol"),
    ],
)
def test_bad_input_is_one_line(words, text, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    (tmp_path / "run/run.json").write_text("{}")
    assert commands.main(["view", *words]) == 2
    said = capsys.readouterr().err
    assert text in said and len(said.splitlines()) == 1


def test_without_viser_it_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "viser", None)
    assert commands.main(["view"]) == 2
    assert capsys.readouterr().err == "ruffini: view: found no viser: pip install 'ruffini[viz]'\n"
