"""``ruffini calibrate``: a sensor's gel from measured forces by depth."""

from __future__ import annotations

import argparse
import importlib.util
import json
import re
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini import OBJECTS
from ruffini._core import read_sensor
from ruffini._plot import check
from ruffini._spaces import check_writable, replace_file, writing
from ruffini._words import counted
from ruffini.commands import shapes
from ruffini.commands.fitting import (
    FLOOR,
    RANGES,
    Curve,
    Fit,
    GelModel,
    Problem,
    Table,
    parameters,
    read_curve,
    toml,
)

_UNITS = {
    "young": (1e-6, " MPa"),
    "offset": (1e3, " mm"),
    "thickness": (1.0, " of the file's"),
    "stiffness": (1e-3, " N/mm"),
}
"""In which parameters are printed."""
_FORCES = {"mN": 1e-3, "gram-force": 9.81e-3, "kgf": 9.81, "kN": 1e3}
"""Units (N) in which forces may be by mistake."""
_SHALLOW = 1e-5
"""Depth (m) up to which the last of a curve is more likely in another unit."""
_OTHER = 5.0
"""Ratio of Young's modulus to the sensor's, or its inverse, from which a file needs --force."""
_WRONG = 0.25
"""Largest error of the force, or of 2 % of the largest one where that is more, likewise."""
_OFF = 0.05
"""Change of Young's modulus by the table's interpolation from which a file needs --force. Those of
a ball and a block on 1,000 nodes change it by less than 1 %."""
_TIED = 0.95
"""Correlation from which two parameters are reported as not separately determined."""


def add_to(commands: Any) -> None:
    """Add the subcommand to the parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "calibrate",
        help="fit a sensor's gel to measured forces by depth",
        description="Fits the material of a gel to forces of indenters that are pressed straight "
        "into its apex, their end at +z first, says how well they tell it, and writes a sensor's "
        "file. Each .csv file has the columns depth_m (way from the first touch, m) and force_n "
        "(N).",
    )
    parser.add_argument("curves", nargs="+", type=Path, metavar="CSV", help="measured points")
    parser.add_argument("--sensor", required=True, help="gelsight-mini, digit or a .toml file")
    parser.add_argument(
        "--indenter",
        required=True,
        action="append",
        help=f"one, or one for each CSV: {shapes.FORMS}, or a .obj or .stl file",
    )
    parser.add_argument("--scale", type=float, help=shapes.SCALE)
    ranges = "; ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in RANGES.items())
    parser.add_argument(
        "--fit",
        nargs="+",
        choices=RANGES,
        default=["young", "offset"],
        metavar="PARAMETER",
        help=f"young and offset if not given; {ranges} (Pa; thickness over the file's; offset in "
        "m, added to all depths of a CSV, since the first touch is never known exactly; stiffness "
        "in N/m, of all that holds gel and indenter, which yields by force over stiffness)",
    )
    parser.add_argument("--calibration", help="where to begin; the sensor's first if not given")
    parser.add_argument("--poisson", type=float, help="if not fitted; else the calibration's")
    parser.add_argument("--friction", type=float, help="if not fitted; else the sensor's at rest")
    parser.add_argument("--stiffness", type=float, help="N/m, if not fitted; else without end")
    parser.add_argument("--law", help="material law; the calibration's if not given")
    parser.add_argument("--nodes", type=int, default=1000, help="of the mesh; 1000 if not given")
    parser.add_argument("--name", default="fitted", help="of the new calibration")
    parser.add_argument("--out", type=Path, help=".toml file for the sensor with it")
    parser.add_argument("--plot", type=Path, help=".png or .svg file for the curves")
    parser.add_argument(
        "--force",
        action="store_true",
        help=f"write the material even if an error is above {100 * _WRONG:.0f} %%, interpolation "
        f"changes its modulus by more than {100 * _OFF:.0f} %%, or that is not within "
        f"{1 / _OTHER:g} to {_OTHER:g} times that of the sensor's",
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Fit, print what was found and write the files.

    Raises:
        ValueError: If an option or a file is invalid.
        PressError: If a press is not solved.
    """
    if importlib.util.find_spec("scipy") is None:
        raise ValueError('this command needs scipy: pip install "ruffini[calibrate]"')
    sensor = json.loads(read_sensor(options.sensor))
    materials = {one["name"]: one for one in sensor["calibration"]}
    _check(options, list(materials))
    before = materials[options.calibration or next(iter(materials))]
    fitted = ["young", *(name for name in RANGES if name in options.fit and name != "young")]
    curves = _curves(options, sensor["outline"]["thickness"])
    parameters(curves, fitted)
    held = {"poisson": options.poisson, "friction": options.friction, "thickness": 1.0}
    held |= {"stiffness": options.stiffness}
    defaults = {"poisson": before["poisson"], "friction": sensor["friction"]["static"]}
    defaults |= {"stiffness": np.inf}
    held |= {name: value for name, value in defaults.items() if held[name] is None}
    gel = GelModel(options.sensor, options.law or before["law"], options.nodes)
    for curve in curves:
        _check_unit(curve, replace(gel, element="p1-bar"), held, before["young"])
    tables = [_table(gel, curve, fitted, held) for curve in curves]
    problem = Problem(curves, tables, fitted, held)
    fit = problem.fit()
    left_out = problem.left_out(fit)
    _report(problem, fit, left_out)
    change = _report_numbers(problem, fit, gel)
    if options.plot is not None:
        _plot(problem, fit, left_out, options.plot)
    if not options.force:
        _check_interpolation(change)
        _check_fit(problem, fit, before)
    friction = {**held, **fit.values}["friction"]
    if friction != (written := sensor["friction"]["static"]):
        text = f"fitted with {friction:.3g}, but that of the sensor's file stays {written:g}: with"
        print(f"{'friction':<12} {text} it\n{'':<12} this material gives other forces")
    material = _material(options, problem, fit, gel.law)
    print("\n[[calibration]]\n" + material, end="")
    if options.out is not None:
        _write(options, sensor, fit, material)


def _check(options: argparse.Namespace, known: list[str]) -> None:
    """Refuse options that would be found wrong only after minutes."""
    if options.calibration not in (None, *known):
        text = f"found {options.calibration}, expected {', '.join(known)}"
        raise ValueError(f"calibration: {text}")
    if options.name in known:
        raise ValueError(f"name: found {options.name}, which the sensor has, expected a new one")
    shapes.check_scale(options.scale, options.indenter)
    low, high = RANGES["stiffness"]
    if options.stiffness is not None and not low <= options.stiffness <= high:
        text = f"found {options.stiffness:g} N/m, expected {low:g} to {high:g}"
        raise ValueError(f"stiffness: {text}")
    if len(options.indenter) not in (1, len(options.curves)):
        text = f"found {len(options.indenter)} for {len(options.curves)} CSV files"
        raise ValueError(f"indenter: {text}, expected one, or one for each")
    if options.out is not None:
        if options.out.suffix != ".toml" or options.out.exists():
            raise ValueError(f"out: found {options.out}, expected a new file that ends in .toml")
        check_writable("out", options.out)
    if options.plot is not None:
        check(options.plot)


def _curves(options: argparse.Namespace, thickness: float) -> list[Curve]:
    for text in options.indenter:
        if text in OBJECTS:
            expected = f"what was pressed, with its lengths: {shapes.FORMS}, or a .obj or .stl file"
            raise ValueError(f"indenter: found {text}, an object of the tasks, expected {expected}")
    indenters = options.indenter * (len(options.curves) // len(options.indenter))
    pairs = zip(options.curves, indenters, strict=True)
    return [read_curve(path, shapes.shape(text, options.scale), thickness) for path, text in pairs]


def _check_unit(curve: Curve, gel: GelModel, held: Mapping[str, float], usual: float) -> None:
    """Refuse forces that no gel bears, by a quick solve; `usual` is a likely modulus (Pa)."""
    deepest = curve.forces[-1]
    answered = gel.solve(curve.indenter, curve.depths[-1:], held)[0]
    # So shallow a contact may lie between the nodes.
    young = deepest / answered if answered > 0 else np.inf
    low, high = RANGES["young"]
    if not low <= young <= high:
        hint = f"; it seems to be in {unit}" if (unit := _unit(young, usual)) else ""
        if curve.depths[-1] < _SHALLOW:
            hint += "; are depths in m?"
        text = f"found {deepest:g} N at {curve.depths[-1]:g} m, for which E would be {young:.2g} Pa"
        raise ValueError(f"{curve.name}: {text}, expected {low:g} to {high:g} Pa{hint}")


def _unit(young: float, usual: float) -> str | None:
    """Unit of forces that would make a modulus (Pa) most like the usual one, or none."""
    ratios = {unit: abs(np.log(young * newtons / usual)) for unit, newtons in _FORCES.items()}
    unit = min(ratios, key=lambda unit: ratios[unit])
    return unit if ratios[unit] <= np.log(_OTHER) else None


def _check_interpolation(change: float) -> None:
    """Refuse a fit to a table that does not say what the gel does between its depths."""
    if change > _OFF:
        found = f"found a change by interpolation of up to {100 * change:.1f} %"
        text = f"{found}, expected at most {100 * _OFF:.0f} %: try more --nodes."
        raise ValueError(f"young: {text} No material is written without --force")


def _check_fit(problem: Problem, fit: Fit, before: Mapping[str, Any]) -> None:
    """Refuse a fit that is far off, or of a gel that is most likely another."""
    most = np.abs(problem.residuals(fit.values)).max()
    if most > _WRONG:
        text = f"found a fit that is off by {100 * most:.1f} %, expected at most {100 * _WRONG:.0f}"
        raise ValueError(f"{text} %; no material is written without --force")
    if not 1 / _OTHER <= (ratio := fit.values["young"] / before["young"]) <= _OTHER:
        unit = _unit(fit.values["young"], before["young"])
        hint = f" They seem to be in {unit}." if unit else ""
        text = f"young: found {ratio:.2g} times that of {before['name']}"
        text += f", expected {1 / _OTHER:g} to {_OTHER:g} times: are forces in N?{hint}"
        raise ValueError(f"{text} No material is written without --force")


def _table(gel: GelModel, curve: Curve, fitted: list[str], held: Mapping[str, float]) -> Table:
    def watch(done: int, whole: int) -> None:
        end = "\n" if done == whole else ""
        text = f"\r{curve.name}: {done} of {whole} paths solved"
        print(text, end=end, file=sys.stderr, flush=True)

    deepest = curve.depths[-1] + ("offset" in fitted) * RANGES["offset"][1]
    return Table.solve(gel, curve.indenter, deepest, fitted, held, watch)


def _written(name: str, value: float) -> str:
    factor, unit = _UNITS.get(name.split()[0], (1.0, ""))
    return f"{factor * value:.4g}{unit}"


def _report(problem: Problem, fit: Fit, left_out: list[NDArray[np.float64]]) -> None:
    """Print values with their intervals, undetermined parameters, and the error of each point."""
    for name, value in fit.values.items():
        ends = []
        for level, two in fit.intervals[name].items():
            low, high = (_written(name, end) for end in np.clip(two, *RANGES[name.split()[0]]))
            ends.append(f"{100 * level:.0f} %: {low} to {high}")
        print(f"{name:<12} {_written(name, value)} ({', '.join(ends)})")
        if not np.isfinite(fit.intervals[name][0.95]).all():
            print(f"{'':<12} not determined by these points: its 95 % go on to an end of its range")
    for i, j in zip(*np.triu(np.abs(fit.correlation) > _TIED, 1).nonzero(), strict=True):
        names = f"{problem.names[i]} and {problem.names[j]}"
        print(f"{'':<12} {names} cannot be told apart, correlation {fit.correlation[i, j]:+.3f}")
    count, points = len(fit.values), sum(len(curve.depths) for curve in problem.curves)
    few = "; so few that the intervals rest on errors being normal" if points < count + 10 else ""
    print(f"{'points':<12} {points} for {counted(count, 'parameter')}{few}")
    if unloaded := sum(curve.unloaded for curve in problem.curves):
        print(f"{'':<12} {unloaded} without load, before the first touch, left out")
    for curve, *columns in zip(problem.curves, fit.errors, left_out, strict=True):
        print(f"{curve.name}: errors of the fit, and of the fit to all other points")
        for depth, force, here, left in zip(curve.depths, curve.forces, *columns, strict=True):
            if force > 0:
                cells = f"{1e3 * depth:8.4g} mm {force:10.4g} N {100 * here:+8.2f} %"
                print(f"{cells} {100 * left:+8.2f} %")
    every = 100 * np.abs(np.concatenate(fit.errors))
    print(
        f"{'errors':<12} rms {np.sqrt(np.nanmean(every**2)):.2f} %, most {np.nanmax(every):.2f} %"
    )


def _report_numbers(problem: Problem, fit: Fit, gel: GelModel) -> float:
    """Print how far the table's interpolation and its mesh are off at the fit.

    Returns:
        Most by which the first changes Young's modulus, all else held. Of least squares whose
        weighed errors are e at weighed forces f, it is |e·f| / f·f, at most |e| / |f|.
    """
    at = {**problem.held, **fit.values}
    errors, forces, finer = [], [], []
    for number, (curve, table) in enumerate(zip(problem.curves, problem.tables, strict=True)):
        depths = problem.indentation(fit.values, number, curve.depths)
        depths = depths[depths > 0.0]
        # The mesh depends on the last depth.
        whole = np.union1d(depths, table.depths[-1:])
        force = table.force(at, depths)
        solved, better = (
            replace(gel, nodes=nodes).solve(curve.indenter, whole, at)[: len(depths)]
            for nodes in (gel.nodes, 2 * gel.nodes)
        )
        floor = FLOOR * solved.max()
        errors.append((force - solved) / (solved + floor))
        forces.append(solved / (solved + floor))
        finer.append(100 * (force / better - 1))
    every, off = np.concatenate(errors), np.concatenate(finer)
    change = float(np.linalg.norm(every) / np.linalg.norm(np.concatenate(forces)))
    most = np.abs(every).max()
    print(f"{'numbers':<12} interpolation is off by {100 * most:.2f} % at most, which changes")
    print(f"{'':<12} young by at most {100 * change:.2f} %; forces on {gel.nodes} nodes are")
    print(f"{'':<12} {off.min():+.1f} to {off.max():+.1f} % off those on {2 * gel.nodes}")
    return change


def _material(options: argparse.Namespace, problem: Problem, fit: Fit, law: str) -> str:
    """The table of the calibration, as TOML."""
    at = {**problem.held, **fit.values}
    measured = ", ".join(f"{path.name}" for path in options.curves)
    values = ", ".join(f"{name} {_written(name, value)}" for name, value in fit.values.items())
    every = np.concatenate(fit.errors)
    most = 100 * np.nanmax(np.abs(every))
    source = (
        f"ruffini calibrate: {len(every)} points of {measured}, {' and '.join(options.indenter)}; "
        f"fitted {values}; friction {at['friction']:.3g}; errors of at most {most:.1f} %"
    )
    stand = f"# Of the stand, not of the gel: stiffness {_written('stiffness', at['stiffness'])}\n"
    return (
        stand
        * bool(np.isfinite(at["stiffness"]))
        + f"name = {json.dumps(options.name)}\nyoung = {at['young']:.0f}\n"
        f"poisson = {at['poisson']:.4f}\nlaw = {json.dumps(law)}\n"
        f"source = {json.dumps(source, ensure_ascii=False)}\n"
    )


def _write(options: argparse.Namespace, sensor: Mapping[str, Any], fit: Fit, material: str) -> None:
    """Write the sensor's file with the calibration as its first, and the thickness if fitted."""
    given = Path(options.sensor)
    text = given.read_text() if given.suffix == ".toml" else toml(sensor)
    first = re.search(r"^\[\[calibration\]\]", text, re.MULTILINE)
    if first is None:
        raise ValueError(f"{given}: found no line [[calibration]], expected one")
    text = f"{text[: first.start()]}[[calibration]]\n{material}\n{text[first.start() :]}"
    if "thickness" in fit.values:
        thickness = fit.values["thickness"] * sensor["outline"]["thickness"]
        line = re.compile("^thickness *=.*", re.MULTILINE)
        text = line.sub(f"thickness = {thickness:.6f}", text, count=1)
    replace_file(options.out, text)
    read_sensor(str(options.out))
    print(f"{options.out}: its elastic foundation is found by ruffini sensor check --fit")


def _plot(problem: Problem, fit: Fit, left_out: list[NDArray[np.float64]], path: Path) -> None:
    """Draw each curve with its fit, and the errors of the fit."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for number, (curve, table) in enumerate(zip(problem.curves, problem.tables, strict=True)):
        depths = np.linspace(0.0, curve.depths[-1], 200)
        at = {**problem.held, **fit.values}
        indentation = problem.indentation(fit.values, number, depths)
        force = at["young"] * table.force(at, indentation)
        [line] = left.plot(1e3 * depths, force, label=f"fit to {curve.name}")
        color = line.get_color()
        left.plot(1e3 * curve.depths, curve.forces, "o", color=color)
        if np.isfinite(at["stiffness"]):
            whole = problem.indentation({**fit.values, "stiffness": np.inf}, number, depths)
            force = at["young"] * table.force(at, whole)
            left.plot(1e3 * depths, force, ":", color=color, label="on a stand that does not yield")
        right.plot(1e3 * curve.depths, 100 * fit.errors[number], "o-", color=color, label="fit")
        others = 100 * left_out[number]
        right.plot(1e3 * curve.depths, others, "x", color=color, label="fit to all other points")
    left.set(xlabel="depth (mm)", ylabel="normal force (N)")
    right.set(xlabel="depth (mm)", ylabel="error of the force (%)")
    for axes in (left, right):
        axes.legend(fontsize="small")
        axes.grid(alpha=0.3)
    with writing(path):
        figure.savefig(path)
    print(path)
