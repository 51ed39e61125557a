"""``ruffini press``: one shape pressed into the gel of a sensor."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini import (
    Deformation,
    Fem,
    History,
    Press,
    PressError,
    Shape,
    SimulationError,
    SoftBody,
    TetMesh,
    plot,
    sensor,
    viewing,
)
from ruffini._errors import apart
from ruffini._plot import check
from ruffini._spaces import check_writable
from ruffini._words import counted
from ruffini.commands import shapes
from ruffini.commands.view import gel, summary
from ruffini.viewing import Rigid, Skin, Soft, ViewerFrame

_STRIDE = 1e-4
"""Longest step between two frames (m): friction depends on the path."""
_JUDGE = 1000
"""Number of nodes, without those in the middle of edges, of the quadratic elements of --check."""
_UPSIDE_DOWN = (1.0, 0.0, 0.0, 0.0)
"""Orientation of the shape: its z points into the gel."""


def add_to(commands: Any) -> None:
    """Add the subcommand to the parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "press",
        help="press one shape into the gel of a sensor",
        description="Presses a shape straight into the apex of a sensor's gel, its end at "
        "+z first, by finite elements. SI units.",
    )
    parser.add_argument("--sensor", required=True, help="gelsight-mini, digit or a .toml file")
    parser.add_argument(
        "--shape",
        required=True,
        help=f"{shapes.FORMS}, an object of the tasks, or a .obj or .stl file",
    )
    parser.add_argument("--scale", type=float, help=shapes.SCALE)
    drive = parser.add_mutually_exclusive_group(required=True)
    drive.add_argument("--depth", type=float, help="depth below the first touch (m)")
    drive.add_argument("--force", type=float, help="force to be reached (N)")
    parser.add_argument(
        "--shear",
        type=float,
        default=0.0,
        help="displacement along x after that (m); 0 if not given",
    )
    parser.add_argument(
        "--calibration", help="material of the gel; the sensor's first if not given"
    )
    parser.add_argument("--resolution", type=int, help="number of nodes, about; 2000 if not given")
    parser.add_argument("--friction", type=float, default=0.0, help="coefficient; 0 if not given")
    parser.add_argument(
        "--element",
        default="p1-bar",
        help="p1 (linear), p1-bar (linear, locking-free; if not given) or p2",
    )
    parser.add_argument(
        "--graded",
        action="store_true",
        help="make the mesh finer where the shape touches, as features below some 3 mm need",
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help="solve it again with quadratic elements on a mesh that is finer where the shape "
        "touches, which can take minutes, and say by how much they differ",
    )
    parser.add_argument(
        "--view",
        nargs="?",
        const="",
        metavar="FILE",
        help="show all frames in a browser, or write them to a .html file",
    )
    parser.add_argument("--out", type=Path, help=".vtu or .npz file for the mesh and its fields")
    parser.add_argument(
        "--plot", type=Path, help=".png or .svg file for a section, the face and the force curve"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Solve the press, write its fields and print a summary.

    Raises:
        ValueError: If an option is invalid.
        PressError: If the press is not solved.
    """
    page = Path(options.view) if options.view else None
    if options.view is not None:
        viewing.check(page)
    if options.plot is not None:
        check(options.plot)
    if options.out is not None:
        if options.out.suffix not in (".vtu", ".npz"):
            raise ValueError(f"out: found {options.out}, expected a name that ends in .vtu or .npz")
        check_writable("out", options.out)
    if options.check and options.element == "p2":
        raise ValueError("check: found --element p2, expected p1 or p1-bar: it compares with p2")
    body = sensor(options.sensor, options.calibration, options.resolution)
    shapes.check_scale(options.scale, [options.shape])
    shape = shapes.shape(options.shape, options.scale)
    touch = touching_height(shape, body.mesh.vertices)
    if options.graded:
        body = _graded(options, shape, body, touch)
        touch = touching_height(shape, body.mesh.vertices)
    frames, reached = _pressed(
        options, Fem(body, options.friction, element=options.element), shape, touch
    )
    last = frames[-1]
    if options.out is not None:
        fields = ("displacement", "von_mises", "contact_force")
        body.mesh.write(options.out, {name: getattr(last, name) for name in fields})
    if options.plot is not None:
        plot(body, frames, options.plot, start=(0, 0, touch))
    _report(frames, touch - reached)
    if options.check:
        u, stress, force = (
            f"{100 * x:.1f} %" for x in _errors(options, body, shape, touch, frames)
        )
        found = f"displacement {u}, stress {stress}, force {force}"
        print(f"{'error':<12} {found}, against quadratic elements")
    for file in (options.out, options.plot):
        if file is not None:
            print(file)
    if options.view is not None:
        viewing.view([_pictured(body.mesh, options.shape, shape, frames)], page)


def _around(shape: Shape, positions: Iterable[NDArray[np.float64]]) -> Press:
    """Press with the shape at some positions (3,), around which a mesh is to be finer."""
    return Press(shape, [(position, _UPSIDE_DOWN) for position in positions])


def _graded(options: argparse.Namespace, shape: Shape, body: SoftBody, touch: float) -> SoftBody:
    """`body` with a mesh that is finer where the press touches it.

    How deep a force goes is taken from a solution on the mesh that is not.
    """
    if options.force is None:
        _check_depth(options.depth, float(np.ptp(body.mesh.vertices[:, 2])))
        down = np.array([0, 0, touch - options.depth])
        positions = [down, down + np.array([options.shear, 0, 0])]
    else:
        fem = Fem(body, options.friction, element=options.element)
        positions = [frame.pose[0] for frame in _pressed(options, fem, shape, touch)[0]]
    around = _around(shape, positions)
    return sensor(options.sensor, options.calibration, options.resolution, around)


def _errors(
    options: argparse.Namespace,
    body: SoftBody,
    shape: Shape,
    touch: float,
    frames: list[Deformation],
) -> tuple[float, ...]:
    """Relative errors of the last frame in displacement, von Mises stress and net force."""
    last, positions = frames[-1], [frame.pose[0] for frame in frames]
    finer = sensor(options.sensor, options.calibration, _JUDGE, _around(shape, positions))
    judge = Fem(finer, options.friction, element="p2")
    better = _pressed(options, judge, shape, touch)[0][-1]
    exact = (*judge.carry(better.history, body.mesh), better.wrench[:3])
    own = (last.displacement, last.von_mises, last.wrench[:3])
    return tuple(apart(a, b) for a, b in zip(own, exact, strict=True))


def _pressed(
    options: argparse.Namespace, fem: Fem, shape: Shape, touch: float
) -> tuple[list[Deformation], float]:
    """Frames of the press from the height `touch` (m) on, and the height before the shear (m)."""
    thickness = float(np.ptp(fem.body.mesh.vertices[:, 2]))
    if options.force is None:
        _check_depth(options.depth, thickness)
        ways = _ways("depth", options.depth, 0.0)
        frames = _follow(fem, shape, np.array([0, 0, touch]) - np.outer(ways, [0, 0, 1]))
    else:
        start = ((0, 0, touch), _UPSIDE_DOWN)
        push = Press(shape, start, force=options.force, direction=(0, 0, -1))
        try:
            frames = _solved(fem.solve_path(push))
        except PressError as error:
            if error.kind != "unreachable":
                raise
            hint = f"the gel is {1e3 * thickness:.4g} mm thick: give a smaller --force"
            raise SimulationError(f"{error}; {hint}") from None
    reached, _ = frames[-1].pose
    if options.shear != 0.0:
        ways = _ways("shear", options.shear, -1.0)
        frames += _follow(fem, shape, reached + np.outer(ways, [1, 0, 0]), frames[-1].history)
    return frames, float(reached[2])


def _check_depth(depth: float, thickness: float) -> None:
    """Refuse a press as deep as the gel is thick (m)."""
    if depth >= thickness:
        found, whole = (f"{1e3 * length:.4g} mm" for length in (depth, thickness))
        raise ValueError(f"depth: found {found} into a gel of {whole}, expected less")


def touching_height(shape: Shape, vertices: NDArray[np.float64]) -> float:
    """Height of the shape's origin at which it first touches `vertices` (V, 3) from above (m).

    The shape is lowered along z in steps of its smallest distance to a vertex, which cannot pass
    any vertex.

    Raises:
        ValueError: If it passes beside all of them.
    """
    height, lowest = 3.0, vertices[:, 2].min() - 3.0
    while height > lowest:
        gap = shape.distance((vertices - [0, 0, height]) * [1, -1, -1])[0].min()
        if gap < 1e-8:
            return height
        height -= gap
    raise ValueError("shape: found one that passes beside the pad, expected one above its apex")


def _ways(name: str, whole: float, least: float) -> NDArray[np.float64]:
    """Distances (m) that divide `whole` (m) into equal steps of at most `_STRIDE`."""
    if not least < whole <= 1.0:
        raise ValueError(f"{name}: found {whole} m, expected more than {least} m, at most 1 m")
    count = int(np.ceil(abs(whole) / _STRIDE - 1e-9))
    return np.linspace(0.0, whole, count + 1)[1:]


def _follow(
    fem: Fem, shape: Shape, positions: NDArray[np.float64], history: History | None = None
) -> list[Deformation]:
    """Solve frames with the shape at `positions` (F, 3)."""
    path = [(position, _UPSIDE_DOWN) for position in positions]
    return _solved(fem.solve_path(Press(shape, path, history=history)))


def _solved(frames: list[Deformation | PressError]) -> list[Deformation]:
    """Return the frames if all are solved, else raise the error."""
    for frame in frames:
        if isinstance(frame, PressError):
            raise frame
    return [frame for frame in frames if isinstance(frame, Deformation)]


def _pictured(
    mesh: TetMesh, name: str, shape: Shape, frames: Iterable[Deformation]
) -> Iterator[ViewerFrame]:
    """Frames of a press as they are shown."""
    skin, surface = Skin(mesh), shapes.surface(shape)
    for number, frame in enumerate(frames):
        bodies: dict[str, Rigid | Soft] = {
            "pad": gel(skin, frame),
            "shape": Rigid(np.concatenate(frame.pose), *surface, opacity=0.4),
        }
        yield summary(f"{name}, frame {number}", bodies, seconds=0.1)


def _report(frames: list[Deformation], indentation: float) -> None:
    last = frames[-1]
    x, y, z = last.wrench[:3]
    iterations = sum(frame.iterations for frame in frames)
    rows = {
        "force": f"{0.0 - z:.4f} N normal, {np.hypot(x, y):.4f} N tangential",
        "indentation": f"{1e3 * indentation:.4f} mm",
        "iterations": f"{iterations} in {counted(len(frames), 'frame')}",
        "residual": f"{last.residual:.1e} N",
        "seconds": f"{sum(frame.seconds for frame in frames):.2f}",
    }
    for name, value in rows.items():
        print(f"{name:<12} {value}")
