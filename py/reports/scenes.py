"""Pictures: a lemon between two gel pads, a soft strawberry between two plates, environments.

    python py/reports/scenes.py bodies --out tests/reports   # grasp.png, soft.png, touch.png
    python py/reports/scenes.py tasks --out py/docs          # a picture and a film of each task,
                                                             # cameras.png, view.png: films.py

touch.png is what `render` gives of HoldStill, a loaded ball in the hand. The pads are those of a
GelSight Mini, which close on a lemon of the catalogue, which is free and finds its own pose. The
strawberry (E = 50 kPa, nu = 0.45, friction 0.5) is meshed and nothing of it is fixed. Both are
coloured by von Mises stress.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import combinations, pairwise
from pathlib import Path

import gymnasium
import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_rgba
from matplotlib.patches import Rectangle
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image

import films
import ruffini
from meshes import at_nodes, surface
from ruffini import Fem, Grasp, Press, PressError, Shape, SoftBody
from ruffini._frames import turned

matplotlib.use("Agg")
from matplotlib import pyplot as plt

MM, KPA = 1e3, 1e-3
STRESS = matplotlib.colormaps["magma_r"]
OBJECT, PLATE = to_rgba("#8fa3b3"), to_rgba("#c9ccd1", 0.45)
OBJECTS = {thing.name: thing for thing in ruffini.objects()}


@dataclass
class Part:
    """Triangles to draw."""

    triangles: np.ndarray
    """Corners (F, 3, 3) in mm."""
    colors: np.ndarray
    """Red, green, blue and opacity (F, 4)."""


def section(mesh: ruffini.TetMesh, places: np.ndarray, values: np.ndarray):
    """Section of the mesh at y = 0 at rest, as triangles with corners of their own.

    Args:
        mesh: The mesh at rest.
        places: Where its vertices are (V, 3).
        values: Values at the vertices (V,).

    Returns:
        Corners (x, z) of F triangles, one after the other (3 F, 2), and the values there (3 F,).
    """
    height, known = mesh.vertices[:, 1], np.column_stack([places[:, [0, 2]], values])
    above = height > 0
    corners = []
    for tet in mesh.tets[np.ptp(above[mesh.tets].astype(int), axis=1) == 1]:
        cuts = []
        for i, j in combinations(tet, 2):
            if above[i] != above[j]:
                share = height[i] / (height[i] - height[j])
                cuts.append((1 - share) * known[i] + share * known[j])
        x, z = (np.array(cuts)[:, :2] - np.mean(cuts, axis=0)[:2]).T
        first, *rest = (cuts[k] for k in np.argsort(np.arctan2(z, x)))
        for second, third in pairwise(rest):
            corners += [first, second, third]
    found = np.array(corners)
    return found[:, :2], found[:, 2]


def cuboid(half: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Triangles (F, 3, 3) of a box, finely divided for a painter's order by their middles."""
    t = np.linspace(-1, 1, 13)
    triangles = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1, 1):
            corners = np.zeros((12, 12, 4, 3))
            corners[..., axis] = side
            for k, (i, j) in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)]):
                corners[:, :, k, u] = t[i : i + 12, None]
                corners[:, :, k, v] = t[None, j : j + 12]
            flat = corners.reshape(-1, 4, 3)[:, ::side]
            triangles += [flat[:, [0, 1, 2]], flat[:, [0, 2, 3]]]
    return np.concatenate(triangles) * half + centre


def draw(ax, parts: list[Part], azimuth: float, elevation: float, size: np.ndarray) -> None:
    """Draws all parts as one, seen from afar, so that near triangles cover far ones.

    Shown is a box of `size` (mm) round the origin.
    """
    triangles = np.concatenate([part.triangles for part in parts])
    colors = np.concatenate([part.colors for part in parts])
    across = np.cross(*np.moveaxis(np.diff(triangles, axis=1), 1, 0))
    normal = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    eye = direction(azimuth, elevation)
    lit = 0.72 + 0.28 * np.clip(normal @ direction(azimuth + 25, elevation + 35), 0, 1)
    colors = np.column_stack([colors[:, :3] * lit[:, None], colors[:, 3]])
    seen = normal @ eye > 0
    shown = Poly3DCollection(triangles[seen], facecolors=colors[seen], zsort="average")
    shown.set_edgecolor(np.where(colors[seen, 3:] < 1, 0, colors[seen]))
    shown.set_linewidth(0.4)
    ax.add_collection3d(shown)
    x, y, z = ((-half, half) for half in size / 2)
    ax.set(xlim=x, ylim=y, zlim=z)
    ax.set_box_aspect(tuple(size), zoom=1.35)
    ax.set_proj_type("ortho")
    ax.view_init(elevation, azimuth)
    ax.set_axis_off()


def direction(azimuth: float, elevation: float) -> np.ndarray:
    """Unit vector of two angles (degrees)."""
    a, e = np.radians([azimuth, elevation])
    return np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])


def moved(pose, places):
    """Places (..., 3) of a frame with that pose."""
    return turned(pose[1], places) + pose[0]


def seen_from(pose, places):
    """Places (..., 3) in the frame of that pose."""
    x, y, z, w = pose[1]
    return turned((-x, -y, -z, w), places - pose[0])


def solved(frames):
    """The frames, if all were solved."""
    for frame in frames:
        if isinstance(frame, PressError):
            raise frame
    return frames


def stress_bar(figure, axes, scale):
    """The colour bar of both pictures."""
    bar = figure.colorbar(ScalarMappable(scale, STRESS), ax=axes, shrink=0.7, pad=0.02)
    bar.set_label("von Mises stress (kPa)")


def save(figure, file: Path):
    """Writes the figure without its opacity, packed as tightly as can be."""
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())[..., :3]
    Image.fromarray(pixels).save(file, optimize=True)


def coloured(triangles, color):
    """A part of one colour."""
    return Part(triangles, np.tile(color, (len(triangles), 1)))


# A lemon between two pads.

FRICTION = 0.8
CLOSING = np.array([0.1, 0.25, 0.4, 0.55, 0.7]) * 1e-3
"""Depth of each pad in the object if neither deformed (m)."""
SHOWN = np.array([56.0, 30.0, 50.0])
"""Size of the picture across the pads, along the view and upwards (mm)."""


def upright(thing, count=40):
    """Of some grasps of `thing` the one that comes most from above, well inside the cone."""
    grasps = [grasp for grasp in thing.grasps(count, seed=1) if grasp.quality > 0.6]
    return max(grasps, key=lambda grasp: turned(grasp.tool[1], np.array([0, 0, 1.0]))[2])


def hold(thing, pad):
    """A grasp of `thing`, the poses of the pads at its end, and what they are then."""
    grasp = upright(thing)
    path = [grasp.pads(grasp.width - 2 * depth) for depth in CLOSING]
    frames = solved(Grasp(thing.shape, path).solve((pad, pad)))
    return grasp, path[-1], frames[-1]


def picture_of_a_grasp(out: Path):
    """Writes grasp.png."""
    pad, thing = Fem(ruffini.sensor("gelsight-mini", resolution=1000), FRICTION), OBJECTS["lemon-1"]
    mesh, faces = pad.body.mesh, surface(pad.body.mesh)
    grasp, poses, held = hold(thing, pad)
    stresses = [at_nodes(mesh, answer.von_mises) * KPA for answer in held.pads]
    scale = Normalize(0, np.quantile(stresses, 0.999))
    vertices, corners = thing.surface(96)
    whole = seen_from(grasp.tool, moved(held.object, vertices))[corners] * MM
    parts = [coloured(whole, OBJECT)]
    for pose, answer, stress in zip(poses, held.pads, stresses, strict=True):
        places = seen_from(grasp.tool, moved(pose, mesh.vertices + answer.displacement))
        parts.append(Part(places[faces] * MM, STRESS(scale(stress[faces].mean(axis=1)))))
    figure = plt.figure(figsize=(10, 4.2), dpi=100, layout="constrained")
    grid = figure.add_gridspec(1, 3, width_ratios=[2.2, 1, 1])
    draw(figure.add_subplot(grid[0], projection="3d"), parts, -62, 24, SHOWN)
    axes = [figure.add_subplot(grid[i]) for i in (1, 2)]
    for ax, name, answer, stress in zip(axes, ("left", "right"), held.pads, stresses, strict=True):
        face_map(ax, mesh, faces, answer, stress, scale)
        ax.set_title(f"{name} pad, {np.linalg.norm(answer.wrench[:3]):.1f} N", fontsize=10)
    axes[0].set_ylabel("along the finger (mm)")
    stress_bar(figure, axes, scale)
    save(figure, out / "grasp.png")


def face_map(ax, mesh, faces, answer, stress, scale):
    """The face of a pad, seen from the object."""
    normals = np.cross(*np.moveaxis(np.diff(mesh.vertices[faces], axis=1), 1, 0))
    out = faces[normals[:, 2] > 0.5 * np.linalg.norm(normals, axis=1)]
    x, y, _ = (mesh.vertices + answer.displacement).T * MM
    ax.tripcolor(x, y, out, stress, cmap=STRESS, norm=scale, shading="gouraud", rasterized=True)
    ax.set(aspect="equal", xlabel="across (mm)")


# A strawberry between two plates.

YOUNG, POISSON, GRIP = 5e4, 0.45, 0.5
SPACING = 2.6e-3
HALF = np.array([1.5e-3, 15e-3, 17e-3])
"""Half the edges of a plate (m)."""
SQUEEZE = np.arange(1, 6) * 0.8e-3
"""Depth of each plate (m)."""


def plates_at(mesh, depth):
    """Poses of two plates that stand `depth` in the body from both sides along x."""
    low, high = mesh.vertices[:, 0].min(), mesh.vertices[:, 0].max()
    ends = (low - HALF[0] + depth, high + HALF[0] - depth)
    return [((x, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)) for x in ends]


def squeeze(mesh):
    """The body at the end of the squeeze, and the force of a plate (N)."""
    fem = Fem(SoftBody(mesh, YOUNG, POISSON), GRIP)
    path = [plates_at(mesh, depth) for depth in SQUEEZE]
    answers = solved(fem.solve_path(Press([Shape.cuboid(HALF)] * 2, path)))
    left = mesh.vertices[:, 0] < 0
    force = answers[-1].contact_force[left].sum(axis=0)[0]
    return answers[-1], force


def picture_of_a_squeeze(out: Path):
    """Writes soft.png."""
    mesh = OBJECTS["strawberry-1"].tets(SPACING)
    answer, force = squeeze(mesh)
    stress, faces = at_nodes(mesh, answer.von_mises) * KPA, surface(mesh)
    scale = Normalize(0, np.quantile(stress, 0.998))
    figure = plt.figure(figsize=(10, 4), dpi=100, layout="constrained")
    axes = [figure.add_subplot(1, 3, i, projection="3d") for i in (1, 2)]
    after = mesh.vertices + answer.displacement
    size = 2 * MM * np.array([abs(mesh.vertices[:, 0]).max() + 2 * HALF[0], *(1.2 * HALF[1:])])
    for ax, places, level, depth, title in [
        (axes[0], mesh.vertices, 0 * stress, 0.0, "at rest"),
        (axes[1], after, stress, SQUEEZE[-1], f"squeezed with {force:.2f} N"),
    ]:
        fruit = Part(places[faces] * MM, STRESS(scale(level[faces].mean(axis=1))))
        plates = [
            coloured(cuboid(HALF * MM, np.array(position) * MM), PLATE)
            for position, _ in plates_at(mesh, depth)
        ]
        draw(ax, [fruit, *plates], -68, 18, size)
        ax.set_title(title, fontsize=10)
    cut = figure.add_subplot(1, 3, 3)
    corners, values = section(mesh, after * MM, stress)
    order = np.arange(len(corners)).reshape(-1, 3)
    cut.tripcolor(*corners.T, order, values, cmap=STRESS, norm=scale, shading="gouraud")
    for (x, _, z), _ in plates_at(mesh, SQUEEZE[-1]):
        corner = ((x - HALF[0]) * MM, (z - HALF[2]) * MM)
        cut.add_patch(Rectangle(corner, *(2 * MM * HALF[[0, 2]]), color=PLATE))
    cut.set(aspect="equal", xlabel="x (mm)", ylabel="z (mm)")
    cut.set_title("section through the middle", fontsize=10)
    stress_bar(figure, cut, scale)
    save(figure, out / "soft.png")


# An environment with touch.


def picture_of_touch(out: Path):
    """Writes touch.png."""
    env = gymnasium.make(
        "ruffini/HoldStill-v0",
        objects="sphere",
        mass=0.15,
        load=1.0,
        start_grip=8.0,
        tactile="surrogate",
        render_mode="rgb_array",
    )
    env.reset(seed=1)
    for _ in range(15):
        env.step(np.zeros(5, np.float32))
    look = env.unwrapped.look()
    pose = films.camera(np.array(look["object_position"]), 0.0, look["tool_yaw"])
    Image.fromarray(env.unwrapped.render(pose)).save(out / "touch.png", optimize=True)
    print(f"touch: {look}")


def main() -> None:
    """Draws the pictures that are chosen."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("which", choices=["bodies", "tasks"], help="pressed bodies, or all tasks")
    parser.add_argument("--out", type=Path, required=True, help="folder of the pictures")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    if options.which == "tasks":
        films.pictures(options.out)
        films.page(options.out)
        return
    picture_of_touch(options.out)
    picture_of_a_grasp(options.out)
    picture_of_a_squeeze(options.out)


if __name__ == "__main__":
    main()
