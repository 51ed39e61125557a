"""A gel fitted to measured forces: recovery of known parameters, bad input, the file written."""

from __future__ import annotations

import json
import re
from pathlib import Path

import gymnasium
import numpy as np
import pytest

pytest.importorskip("scipy", reason="the extra calibrate brings it")

import ruffini
from ruffini import Fem, Press, Shape, SoftBody
from ruffini._core import read_sensor
from ruffini.commands import main, shapes
from ruffini.commands.fitting import Curve, GelModel, Problem, Table, read_curve, toml

REFERENCE = Path(__file__).resolve().parents[1] / "reference"
BALL = Shape.sphere(8e-3)
GEL = GelModel("gelsight-mini", "neo-hookean", nodes=250, element="p1-bar")
HELD = {"poisson": 0.47, "friction": 0.5, "thickness": 1.0}
DEPTHS = np.linspace(2e-4, 1.2e-3, 9)
TRUE = {"young": 2.2e5, "poisson": 0.43, "offset": 7e-5}


@pytest.fixture(scope="module")
def table():
    return Table.solve(GEL, BALL, 1.5e-3, ["young", "poisson", "offset"], HELD)


@pytest.fixture
def command(tmp_path):
    """Runs the command on a coarse mesh; returns its status."""

    def run(points, *options):
        file = tmp_path / "curve.csv"
        lines = [f"{depth},{force}" for depth, force in points]
        file.write_text("\n".join(["depth_m,force_n", *lines]) + "\n")
        words = ["calibrate", str(file), "--indenter", "sphere:0.009", "--nodes", "100"]
        return main([*words, *(() if "--sensor" in options else SENSOR), *options])

    return run


SENSOR = ("--sensor", "gelsight-mini")
POINTS = [(3e-4, 0.35), (6e-4, 1.2), (9e-4, 2.6), (1.2e-3, 4.7)]
FALLING = [(depth, force) for (depth, _), (_, force) in zip(POINTS, POINTS[::-1], strict=True)]
FLAT = [(depth, 2 + depth) for depth, _ in POINTS]


def measured(table, noise=0.0, seed=0, stand=0.0):
    """Curve of a gel of the true parameters, with relative noise, on a stand that yields (m/N)."""
    ways, force = DEPTHS + TRUE["offset"], 0.0
    for _ in range(100):
        force = TRUE["young"] * table.force({**HELD, **TRUE}, ways - stand * force)
    force *= 1 + noise * np.random.default_rng(seed).normal(size=len(force))
    return Curve("synthetic", BALL, DEPTHS, force)


def test_force_is_proportional_to_youngs_modulus():
    pad = ruffini.sensor("gelsight-mini", resolution=250)
    path = [((0, 0, 8e-3 - depth), (1, 0, 0, 0)) for depth in (5e-4, 1e-3)]
    soft, stiff = (
        Fem(SoftBody(pad.mesh, young, 0.47, fixed=pad.fixed), friction=0.5)
        .solve_path(Press(BALL, path))[-1]
        .wrench[2]
        for young in (1e4, 1e7)
    )
    assert abs(stiff / soft / 1e3 - 1) < 1e-4, f"{soft} N and {stiff} N"


def test_a_small_indenter_gets_a_mesh_that_meets_hertz():
    small, depths = Shape.sphere(5e-4), np.array([5e-5, 1e-4])
    force = GelModel("gelsight-mini", "neo-hookean", 700).solve(small, depths, HELD)
    hertz = 4 / 3 / (1 - HELD["poisson"] ** 2) * np.sqrt(5e-4 * depths**3)
    # A mesh of as many nodes that is not refined is off by a factor.
    assert np.abs(force / hertz - 1).max() < 0.1, (force, hertz)


def test_the_table_meets_what_is_solved_between_its_points(table):
    at, depths = {**HELD, "poisson": 0.43}, np.array([3.3e-4, 8.7e-4, 1.41e-3])
    solved = GEL.solve(BALL, np.append(depths, table.depths[-1]), at)[:-1]
    errors = table.force(at, depths) / solved - 1
    # A mesh as coarse as this gives forces with corners, where nodes come into contact.
    assert np.abs(errors).max() < 0.02, errors


def test_known_parameters_are_found_again(table):
    problem = Problem([measured(table)], [table], list(TRUE), HELD)
    fit = problem.fit()
    for name, value in TRUE.items():
        assert abs(fit.values[name] / value - 1) < 1e-2, (name, fit.values[name])
    assert np.abs(np.concatenate(fit.errors)).max() < 1e-4
    assert np.abs(np.concatenate(problem.left_out(fit))).max() < 1e-3


def test_a_thicker_gel_is_found_again():
    fitted, held = ["young", "thickness"], {**HELD, "poisson": 0.43}
    solved = Table.solve(GEL, BALL, 1.5e-3, fitted, held)
    depths = np.linspace(2e-4, 1.4e-3, 7)
    thin, thick = (
        TRUE["young"] * GEL.solve(BALL, depths, {**held, "thickness": share})
        for share in (1.0, 1.25)
    )
    assert thick[-1] < 0.97 * thin[-1]
    for share, force in ((1.0, thin), (1.25, thick)):
        fit = Problem([Curve("solved", BALL, depths, force)], [solved], fitted, held).fit(levels=())
        assert fit.values["thickness"] == pytest.approx(share, abs=0.03)
        assert fit.values["young"] == pytest.approx(TRUE["young"], rel=0.03)


def test_a_point_that_is_off_is_off_by_more_where_it_is_left_out(table):
    curve = measured(table)
    curve.forces[3] *= 1.1
    problem = Problem([curve], [table], ["young", "offset"], {**HELD, "poisson": 0.43})
    fit = problem.fit(levels=())
    [here], [left] = fit.errors, problem.left_out(fit)
    # A fit without the point meets all others to rounding.
    assert left[3] == pytest.approx(1 / 1.1 - 1, abs=1e-3)
    assert abs(here[3]) < abs(left[3]) - 5e-3


def test_the_stiffness_of_a_stand_is_found_again(table):
    true, held = {**TRUE, "stiffness": 2e4}, {**HELD, "poisson": 0.43}
    names = ["young", "offset", "stiffness"]
    problem = Problem([measured(table, stand=1 / 2e4)], [table], names, held)
    for name, value in problem.fit().values.items():
        assert abs(value / true[name] - 1) < 1e-3, (name, value)
    noisy = Problem([measured(table, 0.01, stand=1 / 2e4)], [table], names, held).fit()
    for name, two in noisy.intervals.items():
        assert two[0.95][0] < true[name] < two[0.95][1], (name, two)
    alone = Problem([measured(table, stand=1 / 2e4)], [table], ["young", "offset"], held).fit()
    assert np.abs(alone.errors[0]).max() > 0.01, "a rigid stand should not fit"


def test_a_stand_without_end_of_stiffness_is_none(table):
    curve = measured(table, 0.01)
    rigid = Problem([curve], [table], ["young", "offset"], {**HELD, "poisson": 0.43})
    stiff = Problem([curve], [table], ["young", "offset"], {**rigid.held, "stiffness": 1e8})
    for name, value in rigid.fit().values.items():
        assert stiff.fit().values[name] == pytest.approx(value, rel=1e-3), name
    fitted = Problem([curve], [table], ["young", "offset", "stiffness"], rigid.held)
    assert fitted.fit().intervals["stiffness"][0.95][1] == np.inf
    values = {"young": 2e5, "offset": 0.0, "stiffness": np.inf}
    assert fitted.forces(values)[0] == pytest.approx(rigid.forces(values)[0], rel=1e-12)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("stiffness", [1e3, 1e5, 1e8])
@pytest.mark.parametrize("young", [1e4, 1e7])
def test_stand_and_gel_share_the_way_that_was_measured(young, stiffness, table):
    at = {**HELD, "poisson": 0.43, "young": young, "stiffness": stiffness}
    problem = Problem([measured(table)], [table], ["young"], at)
    ways = np.linspace(0.0, 1.5e-3, 200)
    depths = problem.indentation({}, 0, ways)
    again = depths + young / stiffness * table.force(at, depths)
    assert np.abs(again - ways).max() < 1e-12


def test_intervals_hold_the_truth_and_grow_with_noise(table):
    widths = []
    for noise in (0.003, 0.03):
        curve = measured(table, noise)
        fit = Problem([curve], [table], ["young", "offset"], {**HELD, "poisson": 0.43}).fit()
        (low, high), (less, more) = fit.intervals["offset"][0.95], fit.intervals["offset"][0.68]
        assert low < TRUE["offset"] < high and low < less < more < high
        widths.append(high - low)
        assert abs(fit.correlation[0, 1]) < 1 and fit.correlation[0, 0] == pytest.approx(1)
    assert 5 < widths[1] / widths[0] < 20


def test_what_points_do_not_tell_has_no_end(table):
    fit = Problem([measured(table, 0.05)], [table], list(TRUE), HELD).fit()
    assert not np.isfinite(fit.intervals["poisson"][0.95]).all()


def test_several_curves_have_one_gel_and_an_offset_each(table):
    held = {**HELD, "poisson": 0.43}
    one, other = measured(table), measured(table)
    shifted = Curve("shifted", BALL, other.depths + 1e-4, other.forces)
    problem = Problem([one, shifted], [table, table], ["young", "offset"], held)
    fit = problem.fit()
    assert problem.names == ["young", "offset 1", "offset 2"]
    assert fit.values["offset 1"] - fit.values["offset 2"] == pytest.approx(1e-4, rel=1e-2)
    assert fit.values["young"] == pytest.approx(TRUE["young"], rel=1e-2)


def test_the_file_that_is_written_is_a_sensor(command, tmp_path, capsys):
    out, plot = tmp_path / "mine.toml", tmp_path / "fit.png"
    assert command(POINTS, "--out", str(out), "--plot", str(plot), "--name", "mine") == 0
    printed = capsys.readouterr().out
    assert plot.read_bytes().startswith(b"\x89PNG")
    first, *others = json.loads(read_sensor(str(out)))["calibration"]
    shipped = json.loads(read_sensor("gelsight-mini"))
    assert first["name"] == "mine" and others == shipped["calibration"]
    assert f"young = {first['young']:.0f}\n" in printed
    assert "4 points of curve.csv, sphere:0.009" in first["source"]
    assert main(["sensor", "check", str(out)]) == 0
    env = gymnasium.make(
        "ruffini/HoldStill-v0", sensor=str(out), tactile="compliance", objects="sphere"
    )
    env.reset(seed=0)
    env.step(env.action_space.sample())
    # The file's comments and other entries stay; a second calibration goes before the first.
    file = tmp_path / "commented.toml"
    file.write_text("# of my own\n" + out.read_text())
    again = tmp_path / "again.toml"
    options = ("--sensor", str(file), "--fit", "young", "thickness", "--out", str(again))
    assert command(POINTS, *options) == 0
    assert again.read_text().startswith("# of my own\n")
    found = json.loads(read_sensor(str(again)))
    assert [one["name"] for one in found["calibration"]][:2] == ["fitted", "mine"]
    assert 0.0032 <= found["outline"]["thickness"] <= 0.005
    assert found["outline"]["thickness"] != 0.004


def test_what_is_written_is_what_was_fitted_or_held(command, tmp_path):
    for k, (options, sound) in enumerate(
        (
            (("--poisson", "0.41"), lambda p: p == 0.41),
            (("--fit", "young", "poisson"), lambda p: 0.3 <= p <= 0.495 and p != 0.47),
        )
    ):
        out = tmp_path / f"{k}.toml"
        assert command(POINTS, *options, "--force", "--out", str(out)) == 0
        assert sound(json.loads(read_sensor(str(out)))["calibration"][0]["poisson"]), options


def test_a_sensor_is_written_as_it_was_read(tmp_path):
    for name in ("gelsight-mini", "digit"):
        found = json.loads(read_sensor(name))
        file = tmp_path / "copy.toml"
        file.write_text(toml(found))
        assert json.loads(read_sensor(str(file))) == found


NOT_RIGHT = {
    "nan": ([*POINTS, (1.3e-3, "nan")], "point 5: found force_n = nan, expected a number"),
    "no number": ([(1e-4, "")], "point 1: found force_n = nothing, expected a number from 0"),
    "a negative force": ([(1e-4, -0.1)], "found force_n = -0.1, expected a number from 0"),
    "depths that fall": ([POINTS[1], POINTS[0]], "found depth 0.0003 m after 0.0006 m"),
    "millimetres": ([(1e3 * d, f) for d, f in POINTS], "found a depth of 1.2 m.*seems to be in mm"),
    "micrometres": ([(1e6 * d, f) for d, f in POINTS], "a depth of 1200 m.*seems to be in µm"),
    "centimetres": ([(1e2 * d, f) for d, f in POINTS], "a depth of 0.12 m.*seems to be in cm"),
    "centi- or millimetres": ([(150 * d, f) for d, f in POINTS], "seems to be in cm or mm"),
    "too deep": ([*POINTS, (2.2e-3, 20)], "found a depth of 0.0022 m, expected at most 0.002 m"),
    "deeper than the gel": ([(5.1e-3, 20)], "of 0.0051 m, deeper than the gel, .*thickness$"),
    "forces that fall": (FALLING, "curve.csv: found 0.35 N at 0.0012 m after 4.7 N, expected"),
    "one force": ([(d, 2) for d, _ in POINTS], "found 2 N at 0.0012 m after 2 N, expected forces"),
    "millinewtons": ([(d, 1e3 * f) for d, f in POINTS], "found 4700 N.*seems to be in mN"),
    "gram-force": ([(d, f / 9.81e-3) for d, f in POINTS], "479.1.* N.*seems to be in gram-force"),
    "no points": ([], "found no points"),
    "few points": (POINTS[:2], "curve.csv: found 2 points for young, offset, expected at least 3"),
    "one point": (POINTS[:1], "found 1 point for young, offset, expected at least 3"),
}


@pytest.mark.parametrize("case", NOT_RIGHT)
def test_points_that_cannot_be_right_are_named(case, command, capsys):
    points, message = NOT_RIGHT[case]
    assert command(points) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith("ruffini: ")
    assert re.search(message, line), line


OPTIONS = {
    "found gel, expected tacflex, feats": ("--calibration", "gel"),
    "found feats, which the sensor has": ("--name", "feats"),
    "expected a new file that ends in .toml": ("--out", "sensor.txt"),
    "ends in .png or .svg": ("--plot", "fit.pdf"),
    "found 2 for 1 CSV files": ("--indenter", "half-space"),
    "found 5 N/m, expected 1000 to 1e[+]08": ("--stiffness", "5"),
}


@pytest.mark.parametrize("message", OPTIONS)
def test_options_that_cannot_be_right_are_named(message, command, capsys):
    assert command(POINTS, *OPTIONS[message]) == 2
    assert re.search(message, capsys.readouterr().err)


def test_too_few_nodes_for_a_shallow_contact_and_depths_in_km_are_named(command, capsys):
    points = [(1e-3 * depth, force) for depth, force in POINTS]
    assert command(points) == 2
    assert "nodes: found 100, expected 2" in capsys.readouterr().err
    assert command(points, "--nodes", "400") == 2
    assert re.search("E would be .* Pa, expected .*are depths in m[?]", capsys.readouterr().err)


def test_an_indenter_in_millimetres_is_named():
    with pytest.raises(ValueError, match=r"found 7.5 m, .* lengths are in m: 7.5 mm are 0.0075"):
        shapes.shape("sphere:7.5")


def test_a_file_without_the_columns_is_refused(tmp_path):
    file = tmp_path / "other.csv"
    file.write_text("depth,force_n\n1,2\n")
    with pytest.raises(ValueError, match="found columns depth, force_n, expected depth_m and"):
        read_curve(file, BALL, 4e-3)
    file.write_text("depth_m;force_n\n0,1;2\n")
    with pytest.raises(ValueError, match=r"depth_m;force_n, expected .* with a comma between them"):
        read_curve(file, BALL, 4e-3)
    file.write_bytes(b"\x80\xff\x00")
    with pytest.raises(ValueError, match=r"found no text, expected a \.csv file"):
        read_curve(file, BALL, 4e-3)
    with pytest.raises(ValueError, match=r"point 2: found depth 0 m after 0 m"):
        read_curve(REFERENCE / "taxim_force_depth.csv", BALL, 4e-3)


def test_points_before_the_first_force_are_left_out(tmp_path):
    file = tmp_path / "curve.csv"
    file.write_text("depth_m,force_n\n0,0\n1e-4,0\n5e-4,0.3\n8e-4,0.7\n")
    curve = read_curve(file, BALL, 4e-3)
    assert (curve.depths.tolist(), curve.forces.tolist()) == ([5e-4, 8e-4], [0.3, 0.7])
    file.write_text("depth_m,force_n\n0,0\n1e-4,0\n")
    with pytest.raises(ValueError, match="found no force above 0"):
        read_curve(file, BALL, 4e-3)


def test_a_load_cell_without_load_reads_about_zero(tmp_path):
    def read(*forces):
        lines = [f"{1e-4 * n},{force}" for n, force in enumerate(forces)]
        file = tmp_path / "curve.csv"
        file.write_text("\n".join(["depth_m,force_n", *lines]))
        return read_curve(file, BALL, 4e-3)

    # What is no more than the largest negative reading may be noise, too.
    curve = read(0.001, -0.002, 0.0015, 0.003, 0.5, 1.1)
    assert curve.forces.tolist() == [0.003, 0.5, 1.1] and curve.unloaded == 3
    assert curve.depths.tolist() == pytest.approx([3e-4, 4e-4, 5e-4])
    with pytest.raises(ValueError, match=r"point 1: found force_n = -0.1, .* number from -0.022$"):
        read(-0.1, 0.5, 1.1)
    with pytest.raises(ValueError, match=r"point 2: found force_n = -0.001, .* a number from 0$"):
        read(0.5, -0.001, 1.1)


def test_points_without_load_are_told(command, capsys):
    assert command([(1e-4, -0.001), *POINTS]) == 0
    printed = capsys.readouterr().out
    assert "4 for 2 parameters" in printed and "1 without load" in printed


def test_an_indenter_without_lengths_is_refused(tmp_path, capsys):
    file = tmp_path / "curve.csv"
    file.write_text("depth_m,force_n\n5e-4,0.3\n8e-4,0.7\n")
    words = ["calibrate", str(file), "--sensor", "gelsight-mini", "--indenter", "sphere"]
    assert main(words) == 2
    assert "indenter: found sphere, an object of the tasks" in capsys.readouterr().err


def test_the_measured_curve_of_a_gelsight_mini_is_read():
    curve = read_curve(REFERENCE / "feats_force_depth.csv", BALL, 4e-3)
    assert curve.depths.tolist() == [5e-4, 1e-3, 1.5e-3, 2e-3]
    assert curve.forces.tolist() == [1.6503, 5.9641, 13.5257, 23.2532]


@pytest.mark.parametrize("friction", [0.0, 0.2, 1.0])
def test_a_stand_explains_the_measured_curve_better_than_a_late_touch(friction):
    found = json.loads((REFERENCE.parent / "reports/reality.json").read_text())["reality_curves"]
    force = found["paths"][f"neo-hookean, 0.475, {friction}, 1.0, 2000 nodes"]
    table = Table(np.linspace(0.0, 2.3e-3, 24), {}, np.array(force) ** (2 / 3))
    curve, errors = read_curve(REFERENCE / "feats_force_depth.csv", BALL, 4e-3), {}
    for name in ("offset", "stiffness"):
        problem = Problem([curve], [table], ["young", name], {**HELD, "friction": friction})
        [left] = problem.left_out(problem.fit(levels=()))
        errors[name] = np.abs(left).max()
    # The goal for each depth that a fit has not seen.
    assert errors["stiffness"] < min(0.05, errors["offset"]), errors


def test_without_scipy_one_line_says_what_to_install(command, monkeypatch, capsys):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert command(POINTS) == 2
    assert 'pip install "ruffini[calibrate]"' in capsys.readouterr().err


WRONG = {
    "young: found 0.0.* are forces in N. They seem to be in kgf": [
        (d, f / 9.81) for d, f in POINTS
    ],
    "found a fit that is off by .* expected at most 25 %": FLAT,
}


def ball_file(path, middle, scale=1.0):
    """Mesh of a ball of 9 mm radius around `middle` (m)."""
    vertices, faces = Shape.sphere(9e-3).surface(24)
    with path.open("w") as file:
        file.writelines(f"v {x} {y} {z}\n" for x, y, z in (vertices + middle) / scale)
        file.writelines(f"f {a} {b} {c}\n" for a, b, c in faces + 1)
    return str(path)


@pytest.mark.parametrize("words", [["calibrate", "{csv}", "--indenter"], ["press", "--shape"]])
def test_a_mesh_beside_its_axis_is_refused(words, tmp_path, capsys):
    file = ball_file(tmp_path / "off.obj", (0.01, 0.0, 0.03))
    csv = tmp_path / "curve.csv"
    csv.write_text("depth_m,force_n\n5e-4,0.3\n8e-4,0.7\n1e-3,1\n")
    more = ["--depth", "1e-4"] if words[0] == "press" else []
    words = [word.format(csv=csv) for word in words]
    assert main([*words, file, *SENSOR, *more]) == 2
    said = capsys.readouterr().err
    assert "off.obj: found its middle at x = 10 mm, y = 0 mm" in said
    assert "move it by (-10, 0, 0) mm" in said


def test_a_mesh_in_millimetres_has_the_force_of_one_in_metres(tmp_path, capsys):
    # Where its middle lies along the axis is no matter.
    files = (
        (ball_file(tmp_path / "m.obj", (0, 0, 0)), ()),
        (ball_file(tmp_path / "mm.obj", (0, 0, 0.03), 1e-3), ("--scale", "0.001")),
    )
    said = []
    for file, options in files:
        words = ["press", *SENSOR, "--shape", file, "--depth", "2e-4", "--resolution", "250"]
        assert main([*words, *options]) == 0
        said.append(capsys.readouterr().out.splitlines()[0])
    assert said[0] == said[1]
    words = ["press", *SENSOR, "--shape", "sphere:0.009", "--depth", "2e-4", "--scale", "0.001"]
    assert main(words) == 2
    assert "scale: found 0.001 without a .obj or .stl file" in capsys.readouterr().err


def test_calibrate_scales_the_mesh_of_an_indenter(command, tmp_path, capsys):
    assert command(POINTS, "--scale", "0.001") == 2
    assert "without a .obj or .stl file" in capsys.readouterr().err
    words = ["calibrate", str(tmp_path / "curve.csv"), *SENSOR, "--nodes", "100", "--indenter"]
    said = []
    for name, unit in ("m.obj", 1.0), ("mm.obj", 1e-3):
        file = ball_file(tmp_path / name, (0, 0, 0), unit)
        assert main([*words, file, "--scale", str(unit)]) == 0
        said.append(re.search(r"young = \d+", capsys.readouterr().out)[0])
    assert said[0] == said[1]


def test_a_fit_to_a_table_that_is_far_off_is_written_only_by_force(
    command, tmp_path, capsys, monkeypatch
):
    out = tmp_path / "mine.toml"
    true = Table.force
    monkeypatch.setattr(Table, "force", lambda *given: 1.1 * true(*given))
    assert command(POINTS, "--out", str(out)) == 2
    printed = capsys.readouterr()
    assert "by interpolation of up to 10" in printed.err and "at most 5 %" in printed.err
    assert "[[calibration]]" not in printed.out and not out.exists()
    assert command(POINTS, "--out", str(out), "--force") == 0
    assert out.exists()


@pytest.mark.parametrize("message", WRONG)
def test_a_fit_that_is_most_likely_wrong_is_written_only_by_force(
    message, command, tmp_path, capsys
):
    out = tmp_path / "mine.toml"
    assert command(WRONG[message], "--out", str(out)) == 2
    printed = capsys.readouterr()
    assert re.search(message, printed.err) and "--force" in printed.err
    assert "[[calibration]]" not in printed.out and not out.exists()
    assert command(WRONG[message], "--out", str(out), "--force") == 0
    assert out.exists()


def test_a_stand_and_a_friction_that_are_not_written_are_told(command, tmp_path, capsys):
    out = tmp_path / "mine.toml"
    options = ("--fit", "young", "stiffness", "--friction", "0", "--out", str(out))
    assert command(POINTS, *options) == 0
    printed = capsys.readouterr().out
    assert "fitted with 0, but that of the sensor's file stays 1" in printed
    assert re.search(r"stiffness +[\d.e+]+ N/mm", printed)
    assert "# Of the stand, not of the gel: stiffness" in out.read_text()
    assert json.loads(read_sensor(str(out)))["friction"]["static"] == 1.0
    assert command(POINTS) == 0
    assert "sensor's file stays" not in capsys.readouterr().out
