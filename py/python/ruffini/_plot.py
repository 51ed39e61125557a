"""Pictures of solved presses, drawn with matplotlib: ``pip install "ruffini[data]"``."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ruffini._core import Deformation, PressError, SoftBody
from ruffini._spaces import check_writable, writing
from ruffini.viewing import Skin, nodal_stress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_Floats = NDArray[np.float64]
_COLOURS = 20
_STRESS: dict[str, Any] = {"label": "von Mises stress (kPa)", "cmap": "magma_r", "vmin": 0.0}
_DISPLACEMENT = {"label": "displacement along z (mm)", "cmap": "RdBu"}
_SECTIONS = {"x": (0, [1, 2], "along, y (mm)"), "y": (1, [0, 2], "across, x (mm)")}
"""Axes of sections: what stands on the plane, the two that are drawn, the first one's label."""
_CUTS = {
    1: [[(0, 3), (1, 3), (2, 3)]],
    2: [[(0, 2), (0, 3), (1, 3)], [(0, 2), (1, 3), (1, 2)]],
    3: [[(0, 1), (0, 2), (0, 3)]],
}
"""Triangles in which a plane cuts a tetrahedron that has so many corners beyond it. Each corner is
on an edge, between two corners of the tetrahedron; those beyond the plane are counted last."""


def plot(
    body: SoftBody,
    answers: Deformation | PressError | Sequence[Deformation | PressError],
    path: str | PathLike[str] | None = None,
    *,
    start: ArrayLike | None = None,
    section: tuple[str, float] | None = None,
) -> Figure:
    """Draw a solved press: the last of its answers, and the forces of all.

    At the top is a section of the deformed body with von Mises stress (kPa), if no other is asked
    for along x and z through the middle of the contact. Below is the deformed body from above:
    displacement along z (mm) with the nodes that bear force, and stress (kPa). The stress of a node
    is the mean of its tetrahedra. With several answers, a curve shows the normal force (along -z)
    and the tangential force (N) against the distance (mm) that the first shape has moved.

    Args:
        body: Body that is pressed, ``body`` of the model.
        answers: An answer, or the list from ``solve_path``.
        path: A .png or .svg file to write.
        start: Position (3,) of the first shape at its first touch (m), from where the distance
            counts; that of the first answer if not given.
        section: Plane of the section of the body at rest (m): ``("y", 0.002)`` is along x and z,
            ``("x", 0.0)`` along y and z.

    Returns:
        The matplotlib ``Figure``. Pyplot does not know it: ``figure.savefig`` writes it.

    Raises:
        PressError: If one of the answers is an error.
        ValueError: If there is no answer or one of another body, the file cannot be written or has
            another ending, matplotlib is missing, or the section does not meet the body.
    """
    check(path)
    if section is not None:
        _check_section(section, body)
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    frames = _solved(answers, len(body.mesh.vertices))
    names = ["displacement", "stress", *(["force"] if len(frames) > 1 else [])]
    layout = ConstrainedLayoutEngine(w_pad=0.1)
    figure: Any = Figure(figsize=(4.2 * len(names), 6.8), layout=layout)
    above, below = figure.subfigures(2, 1, height_ratios=[2, 3])
    axes = dict(zip(names, below.subplots(1, len(names)), strict=True))
    _draw_section(above.subplots(), body, frames[-1], section)
    _draw_face(axes, body, frames[-1])
    if "force" in axes:
        _draw_forces(axes["force"], frames, start)
    if path is not None:
        with writing(Path(path)):
            figure.savefig(path)
    drawn: Figure = figure
    return drawn


def check(path: str | PathLike[str] | None) -> None:
    """Check in advance that pictures can be drawn, and written to `path`, if given.

    Raises:
        ValueError: If matplotlib is missing, or the file cannot be written or has another ending.
    """
    if path is not None:
        if Path(path).suffix.lower() not in (".png", ".svg"):
            raise ValueError(f"plot: found {path}, expected a name that ends in .png or .svg")
        check_writable("plot", Path(path))
    if importlib.util.find_spec("matplotlib") is None:
        raise ValueError('pictures are drawn with matplotlib: pip install "ruffini[data]"')


def _solved(answers: Any, nodes: int) -> list[Deformation]:
    """List of answers on so many nodes, or the error among them."""
    frames: list[Deformation] = []
    for answer in [answers] if isinstance(answers, Deformation | PressError) else answers:
        if isinstance(answer, PressError):
            raise answer
        if (found := len(answer.displacement)) != nodes:
            raise ValueError(f"answers: found one on {found} nodes, expected {nodes}, the body's")
        frames.append(answer)
    if not frames:
        raise ValueError("answers: found none, expected one or more")
    return frames


def _check_section(section: Any, body: SoftBody) -> None:
    """Raise a ``ValueError`` unless the section is an axis and a place (m) within the body."""
    expected = '("x", number) or ("y", number)'
    if not (isinstance(section, tuple) and len(section) == 2 and section[0] in _SECTIONS):
        raise ValueError(f"section: found {section!r}, expected {expected}")
    name, place = section
    sides = body.mesh.vertices[:, _SECTIONS[name][0]]
    low, high = float(sides.min()), float(sides.max())
    if not (isinstance(place, (int, float)) and low < place < high):
        within = f"{name} within {low:g} and {high:g} m, where the body is"
        raise ValueError(f"section: found {place!r}, expected {within}")


def _draw_section(
    axes: Any, body: SoftBody, answer: Deformation, section: tuple[str, float] | None
) -> None:
    rest, force = body.mesh.vertices, np.linalg.norm(answer.contact_force, axis=1)
    name = "y" if section is None else section[0]
    across, drawn, label = _SECTIONS[name]
    sides = np.array([rest[:, across].min(), rest[:, across].max()])
    if section is None:
        middle = np.average(rest[:, across], weights=force if force.any() else None)
    else:
        middle = np.float64(section[1])
    middle = np.clip(middle, *(0.99 * sides + 0.01 * sides[::-1]))
    edges, shares, triangles = _cut(body.mesh.tets.astype(np.int64), rest[:, across] - middle)

    def at_cut(field: _Floats) -> _Floats:
        found: _Floats = np.einsum("ne,ne...->n...", shares, field[edges])
        return found

    outline, at_rest = _outline(triangles), at_cut(rest)[:, drawn]
    places = at_cut(rest + answer.displacement)[:, drawn]
    for points, colour in ((at_rest, "0.6"), (places, "k")):
        axes.plot(*1e3 * points[outline].transpose(2, 1, 0), color=colour, linewidth=0.8)
    _paint(
        axes, places, triangles, 1e-3 * at_cut(nodal_stress(body.mesh, answer.von_mises)), **_STRESS
    )
    axes.use_sticky_edges = False
    axes.margins(0.01, 0.06)
    axes.set(xlabel=label, ylabel="z (mm)")
    axes.figure.suptitle(f"section at {name} = {round(1e3 * middle, 1) + 0.0} mm; grey: at rest")


def _draw_face(axes: dict[str, Any], body: SoftBody, answer: Deformation) -> None:
    skin = Skin(body.mesh)
    places = (body.mesh.vertices + answer.displacement)[skin.nodes]
    a, b, c = places[skin.faces].swapaxes(0, 1)
    seen = skin.faces[np.cross(b - a, c - a)[:, 2] > 0]
    sunk = 1e3 * answer.displacement[skin.nodes, 2]
    most = max(1e-6, np.abs(sunk).max())
    fields: dict[str, tuple[_Floats, dict[str, Any]]] = {
        "displacement": (sunk, _DISPLACEMENT | {"vmin": -most, "vmax": most}),
        "stress": (1e-3 * skin.stress(answer.von_mises), _STRESS),
    }
    for name, (values, look) in fields.items():
        _paint(axes[name], places[:, :2], seen, values, **look)
    bearing = answer.contact_force[skin.nodes].any(axis=1)
    axes["displacement"].plot(*1e3 * places[bearing, :2].T, "k.", markersize=3)
    axes["displacement"].set(title="from above; dots bear force", ylabel="along, y (mm)")
    axes["stress"].set(title="from above")


def _draw_forces(axes: Any, frames: list[Deformation], start: ArrayLike | None) -> None:
    poses = [frame.pose[0] if isinstance(frame.pose, list) else frame.pose for frame in frames]
    places = np.array([position for position, _ in poses])
    forces = np.array([frame.wrench[:3] for frame in frames])
    if start is not None:
        places, forces = np.vstack([start, places]), np.vstack([np.zeros(3), forces])
    moved = 1e3 * np.linalg.norm(np.diff(places, axis=0, prepend=places[:1]), axis=1).cumsum()
    axes.plot(moved, -forces[:, 2], ".-", label="normal")
    axes.plot(moved, np.hypot(forces[:, 0], forces[:, 1]), ".-", label="tangential")
    axes.set(title="force on the shape", xlabel="distance moved (mm)", ylabel="force (N)")
    axes.grid(alpha=0.3)
    axes.legend()


def _paint(
    axes: Any,
    places: _Floats,
    triangles: NDArray[np.int64],
    values: _Floats,
    label: str,
    **look: Any,
) -> None:
    """Colour triangles between places (N, 2) in m by values (N,)."""
    x, y = 1e3 * places.T
    picture = axes.tricontourf(x, y, triangles, values, levels=_COLOURS, **look)
    axes.figure.colorbar(picture, ax=axes, label=label)
    axes.set(xlabel="across, x (mm)", aspect="equal")


def _cut(
    tets: NDArray[np.int64], side: _Floats
) -> tuple[NDArray[np.int64], _Floats, NDArray[np.int64]]:
    """Cut tetrahedra (T, 4) by the plane where the nodes' distance `side` (V,) is zero.

    Returns:
        Edges (N, 2) that the plane cuts, the shares (N, 2) of their ends in the points of the cut,
        and triangles (F, 3) of these points.
    """
    beyond = side[tets] >= 0
    tets = np.take_along_axis(tets, beyond.argsort(axis=1, kind="stable"), axis=1)
    count = beyond.sum(axis=1)
    corners = [tets[count == n][:, edges] for n, cuts in _CUTS.items() for edges in cuts]
    edges, places = np.unique(np.concatenate(corners).reshape(-1, 2), axis=0, return_inverse=True)
    near, far = side[edges].T
    shares = np.stack([far, -near], axis=1) / (far - near)[:, None]
    return edges, shares, places.reshape(-1, 3)


def _outline(triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Edges (E, 2) of one triangle alone."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    alone: NDArray[np.int64] = edges[count == 1]
    return alone
