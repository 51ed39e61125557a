"""``ruffini mesh``: check of a mesh file that is to be an object, and repair of small defects."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym

from ruffini._core import check_mesh
from ruffini._schema import TASKS
from ruffini._spaces import replace_file

_SIZES = 0.001, 0.3
"""Lengths of the longest edge of an object that a hand may grasp (m)."""
_USUAL = 0.05
"""A usual one (m)."""
_UNITS = {"metres": 1.0, "centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254}
"""Lengths of the units that a file may be in (m)."""
_UPRIGHT = 0.1
"""Tilt (degrees) below which an object stands as in its file."""
_LEVEL = 0.999
"""Cosine of the angle, here 2.6°, up to which a direction is named as that of an axis."""
_OFF_CENTRE = 0.25
"""Distance of the origin from the middle, relative to the size, above which it is refused."""
_SHORTEST = 0.002
"""Longest edge below which environments refuse an object (m)."""
_TASK = "GraspLift"
"""Task whose default sizes, and whose environment, tell what is refused."""


def add_to(commands: Any) -> None:
    """Add the subcommand to the parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "mesh",
        help="say whether a mesh file can be an object, and repair it",
        description="Builds the object of a mesh file as the environments do, and says how large "
        "it is and which side is down at rest, if not that of the file, or why it is refused. "
        'With --repair, small defects are mended by trimesh: pip install "ruffini[mesh]".',
    )
    parser.add_argument("file", type=Path, help="the .obj or .stl file")
    parser.add_argument(
        "--scale", type=float, default=1.0, help="length of its unit (m); 1 if not given"
    )
    parser.add_argument(
        "--repair", type=Path, metavar="OUT", help=".obj or .stl file for the mended mesh"
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> None:
    file = options.file
    if options.repair is not None:
        print(*_repair(file, options.repair), sep="\n")
        file = options.repair
    try:
        fitting, down, height = check_mesh(file, options.scale)
    except ValueError as error:
        said, _, _ = str(error).partition(";")
        unit = _unit(_load(file), options.scale) if said.startswith("mesh size") else ""
        if not unit:
            raise
        raise ValueError(f"{said}; {unit}") from None
    mesh = _load(file)
    extents = options.scale * mesh.extents
    print(f"{'size':<12} {' x '.join(f'{1e3 * extent:.4g}' for extent in extents)} mm")
    print(f"{'volume':<12} {1e6 * options.scale**3 * abs(mesh.volume):.4g} cm³")
    turned = "; all face inwards, and are turned as it is read" if mesh.volume < 0 else ""
    merged = mesh.copy()
    merged.merge_vertices(merge_tex=True, merge_norm=True)
    parts = f", {merged.body_count} separate parts" if merged.body_count > 1 else ""
    print(f"{'triangles':<12} {len(mesh.faces)}, closed{parts}{turned}")
    if unit := _unit(mesh, options.scale):
        print(f"{'unit':<12} {unit}")
    if said := _rest(down, height, extents[2]):
        print(f"{'at rest':<12} {said}")
    middle = options.scale * mesh.bounds.mean(axis=0)
    refused = _refused(file, options.scale, extents, middle, fitting)
    if refused:
        raise ValueError(f"{file}: environments refuse it as it is; {'; '.join(refused)}")


def _refused(file: Path, scale: float, extents: Any, middle: Any, fitting: float) -> list[str]:
    """Reasons for which environments refuse an object of `extents` (3,) around `middle` (3,) (m).

    It fits between the open pads at sizes below `fitting`.
    """
    task = TASKS[_TASK]
    [(least, most)] = [each["default"] for each in task["settings"] if each["name"] == "size"]
    given: dict[str, Any] = {"mesh": str(file)} | ({} if scale == 1 else {"scale": scale})
    refused = []
    if least * extents.max() < _SHORTEST:
        longest = f"{1e3 * least * extents.max():.4g} mm along its longest side at size {least:g}"
        expected = f"{1e3 * _SHORTEST:g} mm or more: is --scale that of the file's unit?"
        refused.append(f"{longest}, expected {expected}")
    if fitting <= most:
        narrow = f"{1e3 * extents.min():.4g} mm across its narrowest side"
        refused.append(
            f"{narrow}, at size {most:g} more than the gripper opens: give size below {fitting:.2f}"
        )
    if (abs(middle) > _OFF_CENTRE * extents).any():
        given["centred"] = True
        remedy = f"objects={json.dumps(given).replace('true', 'True')}"
        refused.append(f"its origin is beside its middle: {remedy} moves it there")
    if not refused:
        try:
            gym.make(f"ruffini/{_TASK}-v0", objects=given, tactile="none").close()
        except ValueError as error:
            refused.append(str(error))
    return refused


def _rest(down: Sequence[float], height: float, upright: float) -> str:
    """Pose of an object on the table, if not as in its file, of which it is `upright` (m) tall."""
    tilt = math.degrees(math.atan2(math.hypot(*down[:2]), -down[2]))
    if tilt < _UPRIGHT:
        return ""
    axis = max(range(3), key=lambda i: abs(down[i]))
    if abs(down[axis]) > _LEVEL:
        below = f"{'-+'[down[axis] > 0]}{'xyz'[axis]}"
    else:
        below = f"({', '.join(f'{round(part, 2) + 0.0:.2f}' for part in down)})"
    posture = "leans" if tilt < 30 else "lies on its side" if tilt < 120 else "is turned over"
    return (
        f"{posture}, unlike in the file: {below} points down, z {tilt:.0f}° from upright; "
        f"{1e3 * height:.4g} mm high, {1e3 * upright:.4g} mm in the file"
    )


def _unit(mesh: Any, scale: float) -> str:
    """The unit that makes a mesh about as large as what is grasped, if it is far from it."""
    longest, (least, most) = float(mesh.extents.max()), _SIZES
    fitting = {name: unit for name, unit in _UNITS.items() if least <= longest * unit <= most}
    if least <= longest * scale <= most or not fitting:
        return ""
    name = min(fitting, key=lambda name: abs(math.log(longest * fitting[name] / _USUAL)))
    edge = f"{1e3 * longest * fitting[name]:.4g} mm"
    return f"likely {name}: with --scale {fitting[name]:g} its longest edge is {edge}"


def _load(file: Path) -> Any:
    """Mesh in a file, coincident vertices merged.

    Raises:
        ValueError: If it cannot be read, or trimesh is not installed.
    """
    try:
        import trimesh
    except ImportError as error:
        raise ValueError('this command needs trimesh: pip install "ruffini[mesh]"') from error
    try:
        mesh = trimesh.load(file, force="mesh", process=False)
    except Exception as error:  # Each of trimesh's readers raises errors of its own.
        raise ValueError(f"{file}: {error}") from error
    return mesh


def _repair(file: Path, out: Path) -> list[str]:
    """Write the mended mesh; return what was changed.

    Raises:
        ValueError: If the file cannot be read, holes are left, or `out` cannot be written.
    """
    if out.suffix.lower() not in (".obj", ".stl"):
        raise ValueError(f"repair: found {out}, expected a name that ends in .obj or .stl")
    mesh = _load(file)
    said = []

    def change(name: str, work: Any) -> None:
        before = len(mesh.vertices), len(mesh.faces)
        work()
        after = len(mesh.vertices), len(mesh.faces)
        if before != after:
            changes = [
                f"{abs(new - old)} {what} {'more' if new > old else 'fewer'}"
                for old, new, what in zip(before, after, ("vertices", "triangles"), strict=True)
                if old != new
            ]
            said.append(f"{name}: {', '.join(changes)}")

    change(
        "coincident vertices merged", lambda: mesh.merge_vertices(merge_tex=True, merge_norm=True)
    )
    if file.suffix.lower() == ".stl":
        # Such a file has the corners of every triangle by themselves.
        said.clear()
    change("flat triangles removed", lambda: mesh.update_faces(mesh.nondegenerate_faces()))
    change("double triangles removed", lambda: mesh.update_faces(mesh.unique_faces()))
    change("holes closed", mesh.fill_holes)
    change("unused vertices removed", mesh.remove_unreferenced_vertices)
    faces = mesh.faces.copy()
    mesh.fix_normals()
    if turned := int((faces != mesh.faces).any(axis=1).sum()):
        said.append(f"{turned} triangles turned")
    if not mesh.is_watertight:
        raise ValueError(
            f"{file}: not watertight after repair, which closes holes of three and four edges; "
            f"expected a closed surface: mend larger ones in MeshLab or Blender"
        )
    content = mesh.export(file_type=out.suffix.lower()[1:])
    replace_file(out, content)
    return [f"{'repaired':<12} {change}" for change in said or ["nothing to mend"]]
