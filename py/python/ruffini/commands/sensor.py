"""``ruffini sensor``: sensors that are built in, and files of one's own."""

from __future__ import annotations

import argparse
import json
import math
import re
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import ruffini
from ruffini._core import fit_foundation, read_sensor, sensor_names, sensor_template
from ruffini._plot import check
from ruffini._schema import TASKS
from ruffini._spaces import check_writable, replace_file, writing
from ruffini._trained_gels import SHIPPED, unlike
from ruffini.commands.press import touching_height

_BALL = 4e-3
"""Radius of the ball whose force measures the stiffness (m)."""
_DEPTH = 5e-4
"""Depth of the ball (m); less in a gel of less than eight times as much."""
_NODES = 2000
"""Nodes of the finite elements to which the elastic foundation is fitted."""
_BOUNDS = {each["name"]: each.get("bounds") for each in next(iter(TASKS.values()))["others"]}
_ENVIRONMENTS = {
    "outline.length": (*_BOUNDS["gripper.pad_length"], "m"),
    "outline.width": (*_BOUNDS["gripper.pad_width"], "m"),
    "outline.thickness": (*_BOUNDS["gripper.pad_thickness"], "m"),
    "calibration.young": (1e3, 1e8, "Pa"),
}
"""Ranges that environments take, by key, where finite elements take more; with the unit."""
_STICKIEST = 4.0
"""Largest friction of `Surrogate` and `LinearPad`; environments draw their own."""
_SLIP = 10.0
"""View of the camera over the pad from which its unit is most likely wrong."""


def add_to(commands: Any) -> None:
    """Add the subcommand to the parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "sensor", help="list the sensors, write the file of one's own, check it"
    )
    parts = parser.add_subparsers(metavar="list|template|check", required=True)
    lister = parts.add_parser("list", help="the sensors that are built in")
    lister.set_defaults(run=_list)
    writer = parts.add_parser(
        "template", help="write a sensor's file with every key, its unit and its range explained"
    )
    writer.add_argument("--out", type=Path, help=".toml file; printed if not given")
    writer.set_defaults(run=_template)
    checker = parts.add_parser(
        "check",
        help="say what is wrong with a sensor's file, or what the sensor is",
        description="Names every missing, unknown or wrong entry of a sensor's file, or sums up "
        "the sensor and says which models of touch take it.",
    )
    checker.add_argument("file", help="the .toml file, or the name of a built-in sensor")
    checker.add_argument("--plot", type=Path, help=".png or .svg file for a picture of the pad")
    checker.add_argument(
        "--fit",
        action="store_true",
        help="fit the elastic foundation to finite elements, some minutes for each calibration, "
        "and write it into the file where it is missing",
    )
    checker.add_argument("--nodes", type=int, help=f"nodes for --fit; {_NODES} if not given")
    checker.set_defaults(run=_check)


def _list(options: argparse.Namespace) -> None:
    for name in sensor_names():
        found = json.loads(read_sensor(name))
        materials = ", ".join(material["name"] for material in found["calibration"])
        print(f"{name:<14} {found['description']}; materials: {materials}")


def _template(options: argparse.Namespace) -> None:
    text = _template_text()
    if options.out is None:
        print(text, end="")
        return
    if options.out.suffix != ".toml":
        raise ValueError(f"out: found {options.out}, expected a name that ends in .toml")
    if options.out.exists():
        raise ValueError(f"{options.out}: exists, expected a new file")
    replace_file(options.out, text)
    print(options.out)


def _template_text() -> str:
    """The template, with the narrower ranges beside those of finite elements."""
    section, lines = "", []
    for line in sensor_template().splitlines():
        if head := re.match(r"\[+(\w+)\]", line):
            section = head[1]
        key = f"{section}.{line.split(' ')[0]}"
        if key in _ENVIRONMENTS:
            low, high, unit = _ENVIRONMENTS[key]
            line += f"; environments take {low:g} to {high:g} {unit}"
        elif key == "friction.static":
            line += f"; Surrogate and LinearPad take 0 to {_STICKIEST:g}"
        lines.append(line + "\n")
    return "".join(lines)


def _check(options: argparse.Namespace) -> None:
    if options.nodes is not None and not options.fit:
        raise ValueError(f"nodes: found {options.nodes} without --fit, expected both or none")
    if options.plot is not None:
        check(options.plot)
    try:
        found = json.loads(read_sensor(options.file))
    except ValueError as error:
        path, _, rest = str(error).partition(": ")
        defects = rest.split("; ")
        if path != options.file or len(defects) < 2:
            raise
        raise ValueError(
            "\n  ".join([f"{path}: {len(defects)} entries are wrong", *defects])
        ) from None
    if outside := _outside(found):
        raise ValueError(f"{options.file}: environments do not take it; {'; '.join(outside)}")
    for name, text in _summary(options.file, found).items():
        print(f"{name:<12} {text}")
    if options.fit:
        _fit(options.file, found["calibration"], _NODES if options.nodes is None else options.nodes)
    if options.plot is not None:
        _plot(options.file, found, options.plot)


def _outside(found: dict[str, Any]) -> list[str]:
    """Numbers of a sensor that environments do not take."""
    said = []
    for key, (low, high, unit) in _ENVIRONMENTS.items():
        table, name = key.split(".")
        for one in found[table] if table == "calibration" else [found[table]]:
            if not low <= one[name] <= high:
                of = f" of {one['name']}" if table == "calibration" else ""
                said.append(
                    f"{key}{of}: found {one[name]:g} {unit}, expected {low:g} to {high:g} {unit}"
                )
    return said


def _warnings(found: dict[str, Any]) -> list[str]:
    """What is most likely wrong with the camera's view or the markers in it."""
    outline, camera, markers = (found[name] for name in ("outline", "camera", "markers"))
    said = []
    axes = zip(("x", "y"), ("width", "length"), ("across", "along"), camera["pixels"], strict=True)
    for axis, extent, row, count in axes:
        view, pad = 1e3 * camera["pixel"] * count, 1e3 * outline[extent]
        if view > pad:
            slip = ": is camera.pixel in m?" if view > _SLIP * pad else ""
            said.append(
                f"the camera's view along {axis}, {view:.4g} mm, is larger than the pad, "
                f"{pad:.4g} mm{slip}"
            )
        reach = 1e3 * (markers[row] - 1) * markers["pitch"] if markers else 0.0
        if reach > view:
            said.append(
                f"markers lie outside of the camera's view along {axis}: over {reach:.4g} mm, in a "
                f"view of {view:.4g} mm"
            )
    return said


def _summary(file: str, found: dict[str, Any]) -> dict[str, str]:
    outline, friction, camera = (found[name] for name in ("outline", "friction", "camera"))
    width, length, thickness = (1e3 * outline[name] for name in ("width", "length", "thickness"))
    view = [1e3 * camera["pixel"] * count for count in camera["pixels"]]
    rows = {
        "name": found["name"],
        "outline": f"{width:.4g} x {length:.4g} mm across and along, {thickness:.4g} mm thick",
        "face": f"{_radius(outline['radius_across'])} across, "
        f"{_radius(outline['radius_along'])} along, rounded over "
        f"{1e3 * outline['rim_width']:.3g} mm at the sides",
    }
    for number, material in enumerate(found["calibration"]):
        rows["material" if number == 0 else f"material {number + 1}"] = (
            f"{material['name']}: Young's modulus {1e-6 * material['young']:.4g} MPa, Poisson's "
            f"ratio {material['poisson']:g}, {material['law']}"
        )
    rows["stiffness"] = _stiffness(file, outline["thickness"])
    missing = [m["name"] for m in found["calibration"] if m["elastic_foundation"] is None]
    rows["foundation"] = (
        f"that of the GelSight Mini for {', '.join(missing)}; --fit finds it"
        if missing
        else "given"
    )
    rows["friction"] = f"{friction['static']:g}"
    if friction["static"] > _STICKIEST:
        rows["friction"] += (
            f"; Surrogate and LinearPad take friction.static from 0 to {_STICKIEST:g}, "
            "environments draw their own"
        )
    if markers := found["markers"]:
        rows["markers"] = (
            f"{markers['across']} x {markers['along']}, {1e3 * markers['pitch']:.3g} mm apart"
        )
    rows["camera"] = (
        f"{camera['pixels'][0]} x {camera['pixels'][1]} pixels, a view of {view[0]:.1f} x "
        f"{view[1]:.1f} mm"
    )
    for number, text in enumerate(_warnings(found)):
        rows["warning" if number == 0 else f"warning {number + 1}"] = text
    for number, material in enumerate(found["calibration"]):
        row = "tactile" if number == 0 else f"tactile {number + 1}"
        rows[row] = _models(file, material["name"])
    return rows


def _radius(radius: float | None) -> str:
    return "straight" if radius is None else f"radius {1e3 * radius:.4g} mm"


def _stiffness(file: str, thickness: float) -> str:
    """Force of a ball on the gel, by finite elements."""
    body = ruffini.sensor(file, resolution=1000)
    depth = min(_DEPTH, thickness / 8)
    ball = ruffini.Shape.sphere(_BALL)
    height = touching_height(ball, body.mesh.vertices)
    path = [((0, 0, height - depth * share), (1, 0, 0, 0)) for share in (0.5, 1.0)]
    found = ruffini.Fem(body).solve_path(ruffini.Press(ball, path))[-1]
    if isinstance(found, ruffini.PressError):
        return f"unknown: {found}"
    return (
        f"{-found.wrench[2]:.3g} N on a ball of {1e3 * _BALL:g} mm radius, {1e3 * depth:g} mm deep"
    )


def _models(file: str, material: str) -> str:
    """Values of the setting ``tactile`` that take the pad, and why others do not.

    Raises:
        ValueError: If none does, such as for markers beside the face.
    """

    def made(model: str) -> None:
        task = "ruffini/HoldStill-v0"
        gym.make(task, sensor=file, material=material, tactile=model).close()

    # Its environment is made at once; what it needs, all need.
    made("fem")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ruffini.OutsideTrainingWarning)
            made("surrogate")
    except ValueError as error:
        return f"compliance, fem; not surrogate: {str(error).partition(': ')[2]}"
    other = unlike(SHIPPED, file, material)
    known = f"; surrogate is trained on other pads: {', '.join(other)}" if other else ""
    return f"surrogate, compliance, fem{known}"


def _fit(file: str, calibrations: list[dict[str, Any]], nodes: int) -> None:
    """Fit the missing elastic foundations and write them into the file; all, if none is missing."""
    missing = {one["name"] for one in calibrations if one["elastic_foundation"] is None}
    if missing:
        check_writable("file", Path(file))
    lines: dict[int, str] = {}
    for number, calibration in enumerate(calibrations):
        if missing and calibration["name"] not in missing:
            continue
        fitted = json.loads(fit_foundation(file, calibration["name"], nodes))
        numbers = ", ".join(f"{key} = {value:.3f}" for key, value in fitted["foundation"].items())
        lines[number] = f"elastic_foundation = {{ {numbers} }}"
        errors = [error for one in fitted["errors"] for _, error in one["normal"]]
        aside = [error for one in fitted["errors"] for error in one["tangential"]]
        print(f"{calibration['name']}: {lines[number]}")
        print(
            f"  off in force by {_median(errors)} in the median and {_most(errors)} at most, "
            f"sideways by {_median(aside)} and {_most(aside)}"
        )
    if missing:
        path = Path(file)
        parts = re.split(r"^(\[\[calibration\]\].*\n)", path.read_text(), flags=re.MULTILINE)
        for number, line in lines.items():
            parts[2 * number + 1] += line + "\n"
        replace_file(path, "".join(parts))
        print(f"written into {file}")


def _median(errors: list[float]) -> str:
    return f"{100 * float(np.median(np.abs(errors))):.0f} %"


def _most(errors: list[float]) -> str:
    return f"{100 * float(np.abs(errors).max()):.0f} %"


def _plot(file: str, found: dict[str, Any], path: Path) -> None:
    """Draw the face from above, with markers and the camera's view, and two sections."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    vertices = 1e3 * ruffini.sensor(file, resolution=4000).mesh.vertices
    thickness = 1e3 * found["outline"]["thickness"]
    # Nodes stand in columns, the one of the face on top.
    plan, columns = np.unique(vertices[:, :2].round(6), axis=0, return_inverse=True)
    face = np.full(len(plan), -math.inf)
    np.maximum.at(face, columns.ravel(), vertices[:, 2])
    figure = Figure(figsize=(9, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2)
    above = figure.add_subplot(grid[:, 0])
    heights = above.tricontourf(plan[:, 0], plan[:, 1], face, levels=20)
    figure.colorbar(heights, ax=above, label="height of the face (mm)")
    if markers := found["markers"]:
        places = [
            1e3 * markers["pitch"] * (np.arange(markers[axis]) - (markers[axis] - 1) / 2)
            for axis in ("across", "along")
        ]
        across, along = np.meshgrid(*places)
        above.plot(across.ravel(), along.ravel(), "k.", label="markers")
    view = [1e3 * found["camera"]["pixel"] * count for count in found["camera"]["pixels"]]
    corner = (-view[0] / 2, -view[1] / 2)
    above.add_patch(Rectangle(corner, *view, fill=False, color="r", label="camera"))
    above.legend(loc="upper right", fontsize="small")
    above.set(title=found["name"], xlabel="across (mm)", ylabel="along (mm)", aspect="equal")
    for row, (axis, name) in enumerate((("across", "x"), ("along", "y"))):
        middle = np.abs(plan[:, 1 - row])
        line = middle == middle.min()
        order = plan[line, row].argsort()
        place, height = plan[line, row][order], face[line][order]
        section = figure.add_subplot(grid[row, 1])
        section.fill_between(place, -thickness, height, alpha=0.5)
        section.set(xlabel=f"{axis}, {name} (mm)", ylabel="z (mm)", aspect="equal")
    with writing(path):
        figure.savefig(path)
    print(path)
