"""Scenes in a browser, live or as one HTML file: bodies, stress, contact forces and curves.

Drawn by viser, which is imported only here: ``pip install "ruffini[viz]"``. Lengths in m; a pose is
a position and a quaternion (x, y, z, w), 7 numbers.
"""

from __future__ import annotations

import contextlib
import io
import math
import time
import webbrowser
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini._core import STRESS_COLORS, TetMesh
from ruffini._frames import turned
from ruffini._schema import control_period
from ruffini._spaces import check_writable, replace_file
from ruffini._words import counted

__all__ = ["Rigid", "Scene", "Skin", "Soft", "ViewerFrame", "check", "nodal", "traction", "view"]

Floats = NDArray[np.floating[Any]]
_AXES = [(215, 60, 50), (60, 150, 60), (50, 90, 210), (120, 120, 120)]
"""Colours of the components of a curve, in order."""
_FORCE, _TRACTION = 0.003, 1e-7
"""Lengths of an arrow for 1 N and for 1 Pa (m)."""
_CHART, _PITCH = (0.095, 0.015), (0.135, 0.03)
"""Width and height of a chart, and distances between charts (m)."""
_COLUMNS = 2
_TEXT = 0.0055
"""Height of letters (m)."""
_LEGEND = (
    "drag to turn, scroll to zoom",
    "arrows on a pad: green net force, 3 mm for 1 N; blue contact",
    "curves: red, green, blue, grey are components 1 to 4; the black line is now",
)


class Skin:
    """Surface of a mesh of tetrahedra, with V nodes and F triangles."""

    def __init__(self, mesh: TetMesh) -> None:
        tets = mesh.tets.astype(np.int64)
        corners = np.concatenate([tets[:, face] for face in _FACES])
        _, first, counts = np.unique(
            np.sort(corners, axis=1), axis=0, return_index=True, return_counts=True
        )
        self.nodes, faces = np.unique(corners[first[counts == 1]], return_inverse=True)
        self.faces = faces.reshape(-1, 3)
        """Corners (F, 3), places in `nodes`."""
        self.rest = mesh.vertices[self.nodes]
        """Nodes at rest (V, 3)."""
        self._mesh = mesh

    def stress(self, von_mises: NDArray[Any]) -> NDArray[np.float64]:
        """Means (V,) at the nodes of a stress in the tetrahedra (T,)."""
        means: NDArray[np.float64] = nodal_stress(self._mesh, von_mises)[self.nodes]
        return means


def nodal_stress(mesh: TetMesh, von_mises: NDArray[Any]) -> NDArray[np.float64]:
    """Means (V,) at all nodes of a mesh of a stress in its tetrahedra (T,)."""
    tets = mesh.tets.ravel()
    means: NDArray[np.float64] = np.bincount(tets, np.repeat(von_mises, 4)) / np.bincount(tets)
    return means


_FACES = ([0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3])
"""Corners of the faces of a tetrahedron, counter-clockwise seen from outside."""


@dataclass
class Rigid:
    """Rigid body."""

    pose: Floats
    """Pose (7,)."""
    vertices: Floats
    """Vertices (V, 3)."""
    faces: NDArray[Any]
    """Corners of the triangles (F, 3)."""
    color: tuple[int, int, int] = (72, 145, 202)
    opacity: float | None = None


@dataclass
class Soft:
    """Soft body: a pad, or a soft object."""

    pose: Floats
    """Pose (7,); all else is in the body's frame."""
    vertices: Floats
    """Vertices (V, 3) of the deformed surface."""
    faces: NDArray[Any]
    """Corners of its triangles (F, 3)."""
    von_mises: Floats
    """Von Mises stress (V,) at the vertices (Pa)."""
    markers: Floats | None = None
    """Points (M, 3) painted on the body."""
    forces: tuple[Floats, Floats] | None = None
    """Points (N, 3) at which forces act, and arrows (N, 3) that show them, already as lengths."""
    wrench: Floats | None = None
    """Net force (N) and torque (N m) on the body (6,), about the origin of its frame."""
    scale: float = 1.0
    """Factor by which the body is enlarged, with its markers and arrows of forces. The position of
    an enlarged one is relative to the middle of the picture."""


@dataclass
class ViewerFrame:
    """Bodies and curves at one time."""

    title: str
    bodies: dict[str, Rigid | Soft]
    values: dict[str, list[float]] = field(default_factory=dict)
    """Components, at most four, of each curve; its name has the unit."""
    seconds: float = control_period()
    """Time for which it is shown (s)."""


def traction(points: Floats, pressures: Floats) -> tuple[Floats, Floats]:
    """Arrows of a gel's `forces` for tractions (N, 3) in Pa, without those of nothing."""
    felt = np.linalg.norm(pressures, axis=1) > 0.02 * max(1.0, float(np.abs(pressures).max()))
    return points[felt], _TRACTION * pressures[felt]


def nodal(points: Floats, forces: Floats) -> tuple[Floats, Floats]:
    """Arrows of a gel's `forces` for contact forces on nodes (N, 3) in N, without zeros."""
    strength = np.linalg.norm(forces, axis=1)
    felt = strength > 0.02 * max(1e-9, float(strength.max()))
    return points[felt], 10 * _FORCE * forces[felt]


def check(out: Path | None) -> Any:
    """Import viser; check in advance that a scene can be written to `out`, if given.

    Raises:
        ValueError: If viser is missing, or the file is no .html or cannot be written.
    """
    if out is not None:
        if out.suffix.lower() != ".html":
            raise ValueError(f"out: found {out}, expected a .html file")
        check_writable("out", out)
    try:
        import viser
    except ImportError:
        raise ValueError("view: found no viser: pip install 'ruffini[viz]'") from None
    return viser


def _say(line: str) -> None:
    """Print a line at once, also into a pipe."""
    print(line, flush=True)


def view(
    sequences: Iterable[Iterable[ViewerFrame]],
    out: Path | None,
    table: bool = False,
    say: Callable[[str], None] = _say,
) -> None:
    """Write sequences of frames to an HTML file, or show them in a browser until Ctrl-C.

    Args:
        sequences: Sequences of frames, such as episodes; curves are drawn for each anew.
        out: The .html file; ``None`` shows each frame as soon as it is there.
        table: Whether to draw the table, z = 0.
        say: Called with a line about where the scene is to be seen.

    Raises:
        ValueError: As `check` does, or if the file cannot be written.
    """
    scene = Scene(table, out)
    try:
        if out is None:
            say(f"{scene.url} in a browser on this machine; Ctrl-C ends, --out FILE.html writes")
            webbrowser.open(scene.url)
            with contextlib.suppress(KeyboardInterrupt):
                scene.live(sequences)
        else:
            count = scene.record([list(frames) for frames in sequences], out)
            size = f"{counted(count, 'frame')}, {out.stat().st_size / 1e6:.1f} MB"
            say(f"{out}: {size}; any browser opens it")
    finally:
        scene.close()


class Scene:
    """Scene in a browser."""

    def __init__(self, table: bool = False, out: Path | None = None) -> None:
        viser = check(out)
        with contextlib.redirect_stdout(io.StringIO()):
            self._server = viser.ViserServer(host="127.0.0.1", verbose=False, label="ruffini")
        self.url = f"http://127.0.0.1:{self._server.get_port()}"
        self._scene = self._server.scene
        self._scene.set_up_direction("+z")
        self._scene.configure_default_lights(True, cast_shadow=False)
        self._nodes: dict[Any, Any] = {}
        self._visible: dict[str, Any] = {}
        self._peaks: list[float] = []
        self._top, self._size, self._middle = 0.0, 1.0, np.array([0.0, 0.0, 0.165])
        self._table = table
        self._server.gui.configure_theme(show_logo=False, show_share_button=False)
        # In the corner where nothing is drawn.
        self._server.gui.main_panel.float(x=15, y=-15, width=260)
        if table:
            self._scene.add_grid(
                "/table", 0.4, 0.4, cell_size=0.025, section_size=0.1, cell_thickness=0.5
            )

    def close(self) -> None:
        """Stop the server."""
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    def record(self, sequences: Sequence[Sequence[ViewerFrame]], out: Path) -> int:
        """Write the frames to an HTML file, and return how many they are.

        Raises:
            ValueError: If it cannot be written.
        """
        frames = [frame for sequence in sequences for frame in sequence]
        self._aim(frames)
        self._set_top(frames)
        for frame in frames:
            self._prepare(frame)
        recording = self._server.get_scene_serializer()
        for sequence in sequences:
            for number, frame in enumerate(sequence):
                self.show(frame, sequence, number)
                recording.insert_sleep(frame.seconds)
        page = recording.as_html()
        replace_file(out, page)
        return len(frames)

    def live(self, sequences: Iterable[Iterable[ViewerFrame]]) -> None:
        """Show the frames as they come, then those chosen with a slider; never ends."""
        seen: list[tuple[ViewerFrame, list[ViewerFrame], int]] = []
        note = self._server.gui.add_markdown("Being played. At its end a slider goes back.")
        for sequence in sequences:
            past: list[ViewerFrame] = []
            for frame in sequence:
                past.append(frame)
                if not seen:
                    self._aim([frame])
                seen.append((frame, past, len(past) - 1))
                self._set_top([frame])
                self.show(*seen[-1])
        note.remove()
        slider = self._server.gui.add_slider("frame", 0, max(1, len(seen) - 1), 1, len(seen) - 1)
        play = self._server.gui.add_checkbox("play", False)
        shown = len(seen) - 1
        while True:
            if play.value:
                slider.value = (int(slider.value) + 1) % len(seen)
            if slider.value != shown and slider.value < len(seen):
                shown = int(slider.value)
                self.show(*seen[shown])
            time.sleep(seen[shown][0].seconds)

    def show(self, frame: ViewerFrame, sequence: Sequence[ViewerFrame], number: int) -> None:
        """Draw a frame, the one of that `number` in its `sequence`."""
        self._charts(sequence, number)
        for name, body in frame.bodies.items():
            node = self._prepare_body(name, body)
            old = self._visible.get(name)
            if old is not node:
                node.visible = True
                if old is not None:
                    old.visible = False
                self._visible[name] = node
            holder = self._frame(name) if isinstance(body, Soft) else node
            holder.position, holder.wxyz = body.pose[:3], body.pose[[6, 3, 4, 5]]
            if isinstance(body, Soft):
                if body.scale > 1:
                    holder.position = self._middle + body.pose[:3]
                self._touch(name, body)
        self._text("/title", frame.title, self._at(-0.18, 0.185), 0.0075)

    def _aim(self, frames: Sequence[ViewerFrame]) -> None:
        """Aim the camera at the bodies of all frames, and write the legend."""
        bodies = [body for frame in frames for body in frame.bodies.values()]
        corners = [_corners(body) for body in bodies if isinstance(body, Rigid) or body.scale == 1]
        low, high = np.min(corners, axis=(0, 1)), np.max(corners, axis=(0, 1))
        camera, rise = self._server.initial_camera, 0.05
        if self._table:
            self._middle[0] = (low[0] + high[0]) / 2
        else:
            self._middle, rise = (low + high) / 2, 0.12
            self._size = float(np.clip((high - low).max() / 0.2, 0.1, 1.0))
        camera.near, camera.fov = 0.001, 0.75
        camera.look_at = self._at(0.18, 0.0)
        camera.position = self._at(0.18, rise) - self._size * np.array([0.0, 0.6, 0.0])
        for k, line in enumerate(_LEGEND):
            self._text(f"/legend-{k}", line, self._at(0.212, -0.172 - 0.011 * k), _TEXT)

    def _at(self, x: float, z: float) -> Floats:
        """Place on the board of charts and legends, x to the right and z up from its middle."""
        place: Floats = self._middle + self._size * np.array([x, 0.03, z])
        return place

    def _prepare(self, frame: ViewerFrame) -> None:
        for name, body in frame.bodies.items():
            self._prepare_body(name, body)

    def _prepare_body(self, name: str, body: Rigid | Soft) -> Any:
        """Node of the body, created hidden on first use; equal bodies share one."""
        if isinstance(body, Rigid):
            key: tuple[Any, ...] = (name, body.vertices.tobytes(), body.color)
            if key not in self._nodes:
                mesh = (f"/{name}-{len(self._nodes)}", body.vertices, body.faces)
                look = {"color": body.color, "opacity": body.opacity, "side": "double"}
                self._nodes[key] = self._scene.add_mesh_simple(*mesh, **look, visible=False)
            return self._nodes[key]
        moved = (body.scale * body.vertices).astype(np.float32)
        colors = color(body.von_mises / max(self._top, 1e-9))
        key = (name, moved.tobytes(), colors.tobytes())
        if key not in self._nodes:
            self._frame(name)
            path = f"/{name}/gel-{len(self._nodes)}"
            mesh = _trimesh().Trimesh(moved, body.faces, vertex_colors=colors, process=False)
            self._nodes[key] = self._scene.add_mesh_trimesh(
                path, mesh, visible=False, cast_shadow=False
            )
        return self._nodes[key]

    def _frame(self, name: str) -> Any:
        if name not in self._nodes:
            self._nodes[name] = self._scene.add_frame(f"/{name}", show_axes=False)
        return self._nodes[name]

    def _touch(self, name: str, body: Soft) -> None:
        """Draw markers, forces and wrench of a soft body, and the name of an enlarged one."""
        scale = body.scale
        if scale > 1:
            low, high = scale * body.vertices.min(axis=0), scale * body.vertices.max(axis=0)
            place = np.array([low[0], high[1] + 0.006, 0.0])
            self._text(f"/{name}/name", name.split(":")[0], place, _TEXT)
        if body.markers is not None:
            points = (scale * body.markers).astype(np.float32)
            if (key := f"{name}/markers") not in self._nodes:
                look = {
                    "point_size": 0.0005 * scale,
                    "point_shape": "circle",
                    "precision": "float32",
                }
                self._nodes[key] = self._scene.add_point_cloud(
                    f"/{key}", points, (20, 20, 20), **look
                )
            self._nodes[key].points = points
        if body.forces is not None:
            points, arrows = (scale * part for part in body.forces)
            self._arrows(f"{name}/contact", points, arrows, 0.0001 * scale, (40, 70, 200))
        if body.wrench is not None:
            force, torque = body.wrench[:3], body.wrench[3:]
            self._arrows(
                f"{name}/force", np.zeros((1, 3)), _FORCE * force[None], 4e-4, (0, 130, 70)
            )
            size, turn = np.linalg.norm(force), 1e3 * np.linalg.norm(torque)
            text = f"{size:.2f} N, {turn:.1f} mN m" if size > 0 else ""
            self._text(f"/{name}/wrench", text, np.array([0, -0.022, -0.022]), _TEXT)

    def _arrows(
        self, name: str, points: Floats, arrows: Floats, radius: float, color: tuple[int, int, int]
    ) -> None:
        """Draw arrows that end at `points`, as a force on a surface does."""
        kept = np.linalg.norm(arrows, axis=1) > 1e-6
        ends = np.stack([points - arrows, points], axis=1)[kept].astype(np.float32)
        if name not in self._nodes:
            sizes = {"head_radius": 2.5 * radius, "head_length": 6 * radius}
            first = np.zeros((1, 2, 3), np.float32)
            self._nodes[name] = self._scene.add_arrows(
                f"/{name}", first, color, shaft_radius=radius, **sizes
            )
        self._nodes[name].visible = len(ends) > 0
        if len(ends):
            self._nodes[name].points = ends

    def _text(
        self, path: str, text: str, position: Floats, height: float, anchor: str = "center-left"
    ) -> None:
        """Write a text in letters of a height that grows with the bodies."""
        height *= self._size
        if path not in self._nodes:
            look = {"font_size_mode": "scene", "font_scene_height": height, "anchor": anchor}
            self._nodes[path] = self._scene.add_label(path, text, position=position, **look)
        node = self._nodes[path]
        if node.text != text:
            node.text = text

    def _set_top(self, frames: Iterable[ViewerFrame]) -> None:
        """Make the colour scale reach to the highest stress of nine in ten frames so far.

        A moment of high stress would take the colour from the others.
        """
        for frame in frames:
            gels = [body for body in frame.bodies.values() if isinstance(body, Soft)]
            self._peaks.append(max((float(gel.von_mises.max()) for gel in gels), default=0.0))
        touched = [peak for peak in self._peaks if peak > 0]
        highest = float(np.quantile(touched, 0.9)) if touched else 0.0
        if highest <= self._top:
            return
        digit = 10.0 ** math.floor(math.log10(highest))
        self._top = next(
            digit * step for step in (1, 1.5, 2, 3, 5, 7.5, 10) if digit * step >= highest
        )
        low, size = self._at(0.212, -0.14), self._size * np.array([0.006, 0, 0.08])
        heights = np.linspace(0, 1, 24)
        sides = [[[0, 0, height], [1, 0, height]] for height in heights]
        points = low + size * np.array(sides).reshape(-1, 3)
        rows = 2 * np.arange(23)[:, None]
        faces = np.concatenate([np.add(rows, corners) for corners in ([0, 1, 3], [0, 3, 2])])
        mesh = _trimesh().Trimesh(
            points, faces, vertex_colors=color(np.repeat(heights, 2)), process=False
        )
        self._scene.add_mesh_trimesh("/scale", mesh, cast_shadow=False, receive_shadow=False)
        for share in (0, 1):
            at = low + size * [1.5, 0, share]
            more = " or more" if share * max(self._peaks) > self._top else ""
            self._text(f"/scale-{share}", f"{share * self._top / 1e3:g} kPa{more}", at, _TEXT)
        self._text("/scale-name", "von Mises stress", self._at(0.212, -0.048), _TEXT)

    def _charts(self, sequence: Sequence[ViewerFrame], number: int) -> None:
        """Draw the curves of a sequence, if they are not there, and mark a frame in them."""
        names = list(sequence[0].values)
        if not names:
            return
        width, height = self._size * np.array(_CHART)
        rows, (across, down) = [divmod(k, _COLUMNS) for k in range(len(names))], _PITCH
        places = [self._at(0.3 + column * across, 0.15 - row * down) for row, column in rows]
        state = (id(sequence), len(sequence))
        if self._nodes.get("charts") != state:
            self._nodes["charts"] = state
            for k, (name, place) in enumerate(zip(names, places, strict=True)):
                values = np.array([frame.values[name] for frame in sequence])
                self._chart(f"/charts/{k}", name, values, place)
        share = number / max(1, len(sequence) - 1)
        now = np.stack(
            [np.add(places, [share * width, -0.0005 * self._size, z]) for z in (0, height)], axis=1
        ).astype(np.float32)
        if "now" not in self._nodes:
            line = {"thickness": 1, "thickness_units": "screen"}
            self._nodes["now"] = self._scene.add_line_segments(
                "/charts/now", now, (90, 90, 90), **line
            )
        self._nodes["now"].points = now

    def _chart(self, path: str, name: str, values: Floats, place: Floats) -> None:
        """Draw the curves (T, K) of one chart with its lower left corner at `place`."""
        width, height = self._size * np.array(_CHART)
        # What is smaller than this in any unit is rounding.
        values = np.where(np.abs(values) < 1e-9, 0.0, values)
        low, high = float(values.min()), float(values.max())
        x = np.linspace(0, width, max(2, len(values)))
        frame = [[0, 0], [1, 0]], [[0, 0], [0, 1]]
        segments = [np.array(line) * [width, height] for line in frame]
        colors = [(170, 170, 170)] * 2
        for k, curve in enumerate(values.T):
            z = height * (curve - low) / (high - low if high > low else 1.0)
            points = np.stack([x, np.resize(z, len(x))], axis=1)
            segments += list(np.stack([points[:-1], points[1:]], axis=1))
            colors += [_AXES[k]] * (len(points) - 1)
        flat = np.array(segments)
        lines = place + np.stack([flat[..., 0], 0 * flat[..., 0], flat[..., 1]], axis=-1)
        each = np.repeat(np.array(colors, np.uint8)[:, None], 2, axis=1)
        line = {"thickness": 1.5, "thickness_units": "screen"}
        self._scene.add_line_segments(path, lines.astype(np.float32), each, **line)
        self._text(f"{path}/name", name, np.add(place, [0, 0, 1.4 * height]), _TEXT)
        for end, value, z in (("low", low, 0.0), ("high", high, height)):
            at = np.add(place, [0, 0, z])
            label = f"{value:.3g} " if abs(value) < 1e3 else f"{value:,.0f} "
            self._text(f"{path}/{end}", label, at, 0.0045, "center-right")


def _corners(body: Rigid | Soft) -> Floats:
    """Lowest and highest corner (2, 3) of a body in the world."""
    points = turned(np.asarray(body.pose, float), body.vertices) + body.pose[:3]
    return np.stack([points.min(axis=0), points.max(axis=0)])


def color(shares: Floats) -> NDArray[np.uint8]:
    """Colours (N, 3) of stresses that are `shares` (N,) of the highest."""
    places = np.clip(shares, 0, 1) * (len(STRESS_COLORS) - 1)
    columns = [
        np.interp(places, range(len(STRESS_COLORS)), column)
        for column in zip(*STRESS_COLORS, strict=True)
    ]
    stacked: NDArray[np.uint8] = np.stack(columns, axis=1).astype(np.uint8)
    return stacked


def _trimesh() -> Any:
    """Import trimesh, which comes with viser."""
    import trimesh

    return trimesh
