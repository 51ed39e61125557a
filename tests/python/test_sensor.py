"""Sensors' files: the list, the template, what is wrong with one, the fit of its foundation."""

from __future__ import annotations

import json
import pickle
import re
import warnings
from pathlib import Path

import pytest

import ruffini
from ruffini import OutsideTrainingWarning
from ruffini._core import (
    fit_foundation,
    read_sensor,
    sensor_names,
    sensor_template,
    write_tensors,
)
from ruffini._trained_gels import _MEASURED, SHIPPED, unlike, warn_of
from ruffini.commands import main
from ruffini.commands.sensor import _ENVIRONMENTS, _outside, _warnings
from ruffini.envs import GraspLiftEnv

ROOT = Path(__file__).parents[2]


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "my.toml"
    assert main(["sensor", "template", "--out", str(path)]) == 0
    return path


def test_the_list_names_the_sensors_that_are_built_in(capsys):
    assert main(["sensor", "list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == sensor_names()
    assert "tacflex, feats" in lines[0]


def test_the_template_is_a_sensor_as_it_is(file, capsys):
    env = GraspLiftEnv(sensor=str(file), tactile="compliance", objects="sphere")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    assert main(["sensor", "template", "--out", str(file)]) == 2
    assert "exists" in capsys.readouterr().err
    assert main(["sensor", "template", "--out", str(file.with_suffix(".txt"))]) == 2
    assert "expected a name that ends in .toml" in capsys.readouterr().err
    main(["sensor", "template"])
    printed = capsys.readouterr().out
    assert printed == file.read_text()
    other = file.with_name("other.toml")
    other.write_text(sensor_template())
    assert read_sensor(str(other)) == read_sensor(str(file))


def test_the_check_sums_a_sensor_up_and_draws_it(file, capsys):
    picture = file.with_name("pad.png")
    assert main(["sensor", "check", str(file), "--plot", str(picture)]) == 0
    rows = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines()[:-1])
    assert rows["outline"] == "20.75 x 25.25 mm across and along, 4 mm thick"
    assert "0.3 MPa" in rows["material"] and rows["foundation"].startswith("that of the GelSight")
    ball = ruffini.Shape.sphere(4e-3)
    body = ruffini.sensor(str(file), resolution=1000)
    path = [((0, 0, 4e-3 - depth), (0, 0, 0, 1)) for depth in (2.5e-4, 5e-4)]
    force = -ruffini.Fem(body).solve_path(ruffini.Press(ball, path))[-1].wrench[2]
    # Three digits are printed, and the apex of the mesh is at z = 0.
    assert abs(float(rows["stiffness"].split()[0]) / force - 1) < 0.01
    assert rows["tactile"] == "surrogate, compliance, fem"
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_check_says_which_models_take_each_material_and_where_markers_do_not_fit(file, capsys):
    text = file.read_text()
    linear = 'name = "other"\nyoung = 3e5\npoisson = 0.47\nlaw = "linear"\nsource = "none"\n'
    file.write_text(f"{text}\n[[calibration]]\n{linear}")
    assert main(["sensor", "check", str(file)]) == 0
    rows = capsys.readouterr().out.splitlines()
    [first, second] = [row for row in rows if row.startswith("tactile")]
    assert first.startswith("tactile      surrogate, compliance, fem")
    assert "compliance, fem; not surrogate: found linear, expected a neo-hookean" in second
    file.write_text(text.replace("pitch = 2.06e-3", "pitch = 5e-3"))
    assert main(["sensor", "check", str(file)]) == 2
    assert "expected places on the face" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("key", "given", "beyond"),
    [
        ("outline.thickness", "0.004 ", 0.021),
        ("calibration.young", "0.30e6", 900.0),
        ("calibration.young", "0.30e6", 1.1e8),
    ],
)
def test_numbers_that_environments_do_not_take_are_told_by_their_keys(
    key, given, beyond, file, capsys
):
    text, name = file.read_text(), key.split(".")[1]
    [line] = [line for line in text.splitlines() if line.startswith(f"{name} =")]
    assert f"environments take {_ENVIRONMENTS[key][0]:g} to {_ENVIRONMENTS[key][1]:g}" in line
    file.write_text(text.replace(f"{name} = {given}", f"{name} = {beyond} "))
    assert main(["sensor", "check", str(file)]) == 2
    assert re.search(f"{key}.*: found {re.escape(f'{beyond:g}')} ", capsys.readouterr().err)
    with pytest.raises(ValueError, match="found"):
        GraspLiftEnv(sensor=str(file), tactile="fem", objects="sphere")
    nearest = min(_ENVIRONMENTS[key][:2], key=lambda bound: abs(bound / beyond - 1))
    file.write_text(text.replace(f"{name} = {given}", f"{name} = {nearest} "))
    GraspLiftEnv(sensor=str(file), tactile="fem", objects="sphere").close()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("static = 1.0", "static = 5.0"), r"friction +5; .* take friction.static from 0 to 4"),
        (("6.34e-5", "9e-5"), r"warning +.* along x, 21.6 mm, is larger than the pad, 20.75 mm$"),
        (("6.34e-5", "0.065"), r"warning +.* along x, 1.56e\+04 mm, .* is camera.pixel in m\?$"),
        (("6.34e-5", "5e-5"), r"warning +markers lie outside .* along x: over 12.36 mm, .* 12 mm$"),
        (("0.47 ", "0.46 "), None),
    ],
)
def test_what_is_most_likely_wrong_is_told(change, said, file, capsys):
    text = file.read_text()
    assert change[0] in text
    file.write_text(text.replace(*change))
    assert main(["sensor", "check", str(file)]) == 0
    printed = capsys.readouterr().out
    if said is None:
        assert "warning" not in printed and "LinearPad" not in printed
    else:
        assert re.search(said, printed, re.MULTILINE), printed
    if "static" in change[0]:
        with pytest.raises(ValueError, match="friction: found 5"):
            ruffini.LinearPad(str(file))


@pytest.mark.parametrize("name", sensor_names())
def test_a_sensor_that_is_built_in_has_no_warning(name):
    found = json.loads(read_sensor(name))
    assert not _outside(found) and not _warnings(found)


def test_options_of_the_check_are_refused_before_anything_is_solved(file, capsys):
    for words, text in (
        (["--plot", "a.xyz"], "plot: found a.xyz, expected a name that ends in .png or .svg"),
        (["--nodes", "3"], "nodes: found 3 without --fit"),
    ):
        assert main(["sensor", "check", str(file), *words]) == 2
        out, err = capsys.readouterr()
        assert text in err and out == ""


def test_the_check_names_all_that_is_wrong_at_once(file, capsys):
    text = file.read_text().replace("thickness =", "thicknes =").replace("0.47 ", "0.7 ")
    file.write_text(text.replace("[gel]", "[jelly]"))
    assert main(["sensor", "check", str(file)]) == 2
    message = capsys.readouterr().err
    for part in (
        "my.toml: 5 entries are wrong",
        "outline.thicknes: unknown, did you mean thickness?",
        "outline.thickness: missing, expected 0.0001 to 1 m",
        "calibration.poisson: found 0.7, expected 0 to",
        "gel: missing, expected a table",
        "jelly: unknown, expected",
    ):
        assert part in message, message
    with pytest.raises(ValueError, match="did you mean thickness"):
        ruffini.sensor(str(file))


@pytest.mark.parametrize(
    ("thickness", "said"),
    [
        ("0.0005", r"outline.thickness: found 0.0005 m, expected more than \S+ m: "),
        (
            "0.0013",
            r"outline.rim_width: found 0.00287 m, expected less than \S+ m, "
            r"or a thickness of more than \S+ m: ",
        ),
    ],
)
def test_a_face_that_falls_below_the_gel_is_told_by_the_key_to_change(thickness, said, file):
    file.write_text(file.read_text().replace("thickness = 0.004", f"thickness = {thickness}"))
    falls = r".* by 0.000405 m by radius_across, 0.000380 m by radius_along and 0.000856 m by the"
    with pytest.raises(ValueError, match=said + falls):
        ruffini.sensor(str(file))


def test_a_pad_that_the_network_does_not_fit_is_told_which_would(file, capsys):
    file.write_text(file.read_text().replace("thickness = 0.004", "thickness = 0.006"))
    with pytest.raises(ValueError, match=r"6.0 mm thick.*a thickness of .* mm; \"compliance\""):
        ruffini.Surrogate(str(file))
    assert main(["sensor", "check", str(file)]) == 0
    assert "compliance, fem; not surrogate" in capsys.readouterr().out


def test_a_pad_that_the_network_was_not_trained_on_is_told_of(file, capsys):
    assert unlike(SHIPPED, str(file)) == []
    for name in sensor_names():
        for material in json.loads(read_sensor(name))["calibration"]:
            assert unlike(SHIPPED, name, material["name"]) == []
    text = file.read_text().replace("thickness = 0.004", "thickness = 0.005")
    file.write_text(text.replace("radius_along = 0.210", "radius_along = inf"))
    thick = ["thickness 5 mm (3.8 to 4 mm)", "radius along inf mm (100 to 210 mm)"]
    assert unlike(SHIPPED, str(file)) == thick
    assert unlike(SHIPPED, "digit", poisson=0.2) == ["Poisson's ratio 0.2 (0.3 to 0.499)"]
    assert main(["sensor", "check", str(file)]) == 0
    assert f"surrogate is trained on other pads: {thick[0]}" in capsys.readouterr().out
    with pytest.warns(OutsideTrainingWarning, match=r"my.toml: found thickness 5 mm") as told:
        network = ruffini.Surrogate(str(file), friction=0.5)
    [warning] = told
    assert warning.filename == __file__ and _MEASURED in str(warning.message)
    path = [((0, 0, 4e-3 - depth), (0, 0, 0, 1)) for depth in (2.5e-4, 5e-4)]
    press = ruffini.Press(ruffini.Shape.sphere(4e-3), path)
    assert network.solve(press)[0].wrench[2] < -0.1
    with pytest.warns(OutsideTrainingWarning, match="thickness 5 mm") as told:
        env = GraspLiftEnv(sensor=str(file))
    assert [warning.filename for warning in told] == [__file__]
    pickle.loads(pickle.dumps(env))
    GraspLiftEnv(sensor=str(file), tactile="compliance")


@pytest.mark.parametrize(
    ("settings", "warns"),
    [
        ({}, False),
        ({"sensor": None, "material": "feats"}, False),
        ({"material": {"young": 1e3, "poisson": 0.45}}, False),
        ({"material": {"young": 3e5, "poisson": 0.2}}, True),
        ({"material": {"young": 3e5, "poisson": 0.2}, "tactile": "fem"}, False),
        ({"material": "feats", "network": "narrow.safetensors"}, True),
        ({"sensor": "digit", "network": "narrow.safetensors"}, True),
        ({"network": "narrow.safetensors"}, False),
    ],
)
def test_settings_outside_of_what_their_network_learnt_are_told_of(
    settings, warns, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    narrow = {"data": {"sensors": ["gelsight-mini"], "poisson": [0.47, 0.47]}}
    Path("narrow.safetensors").write_bytes(write_tensors({}, json.dumps(narrow)))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        warn_of(settings)
    assert len(told) == warns, told


def test_the_errors_that_the_warning_tells_are_those_of_the_report():
    report = json.loads((ROOT / "tests/reports/sensors.json").read_text())
    found = report["pads"]["not trained"]["network"]
    medians = [f"{100 * found[part]['median']:.1f} % in {part}" for part in found]
    assert len(medians) == 3 and all(text in _MEASURED for text in medians), medians


@pytest.mark.parametrize("text", ["name = 3", "[[[", "outline = 1"])
def test_files_of_something_else_are_refused(tmp_path, text, capsys):
    path = tmp_path / "other.toml"
    path.write_text(text)
    assert main(["sensor", "check", str(path)]) == 2
    assert str(path) in capsys.readouterr().err


def test_the_fit_is_written_into_the_file(file, monkeypatch, capsys):
    numbers = {"normal": 1.5, "coupling": 1.0, "shear": 1.2, "spread": 0.7}
    errors = [{"indenter": "ball", "normal": [[1e-4, 0.1], [2e-4, -0.3]], "tangential": [0.2]}]

    def fitted(name, calibration, nodes):
        assert (name, calibration, nodes) == (str(file), "measured", 300)
        return json.dumps({"foundation": numbers, "errors": errors})

    monkeypatch.setattr("ruffini.commands.sensor.fit_foundation", fitted)
    assert main(["sensor", "check", str(file), "--fit", "--nodes", "300"]) == 0
    assert "30 % at most" in capsys.readouterr().out
    [found] = json.loads(read_sensor(str(file)))["calibration"]
    assert found["elastic_foundation"] == numbers


def test_the_fit_of_the_shipped_sensor_is_found_again():
    """On a coarse mesh, so that the numbers agree with those of the fine one to a fifth."""
    found = json.loads(fit_foundation("gelsight-mini", "tacflex", 400))["foundation"]
    shipped = json.loads(read_sensor("gelsight-mini"))["calibration"][0]["elastic_foundation"]
    for name, value in shipped.items():
        assert abs(found[name] / value - 1) < 0.2, f"{name}: {found[name]} against {value}"
