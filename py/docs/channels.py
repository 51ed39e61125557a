"""Pictures of the pad's axes and of what each channel of touch is, all from one episode.

    python py/docs/channels.py --out py/docs/channels    # writes axes.png, <channel>.png there

HoldStill: a ball of 150 g, pulled down by 1 N more, hangs between the fingers, which loosen their
grip until it slips. Maps show the pads after 0.6 s, curves the whole episode.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import gymnasium
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray
from PIL import Image

import ruffini
from ruffini._schema import control_period

Floats = NDArray[np.floating[Any]]
CHANNELS = ["proprio", "wrench", *ruffini.TACTILE_CHANNELS]
PHOTOGRAPHS = ("image", "marker_pixels")
"""Channels whose figures have too many colours to be drawn with fewer."""
SHOWN = 15
"""Step whose pads are drawn."""
LOOSEN = np.array([0, 0, 0, 0, -0.2], np.float32)
"""Action by which the grip falls."""
MM, KPA = 1e3, 1e-3
PADS = ("pad on -x", "pad on +x")


def episode() -> tuple[Any, dict[str, Floats]]:
    """The environment, and each channel in every step, (steps, 2 pads, size)."""
    env = gymnasium.make(
        "ruffini/HoldStill-v0",
        observation=CHANNELS,
        resolution={"image": (240, 320)},
        objects="sphere",
        friction=0.5,
        mass=0.15,
        load=1.0,
        start_grip=8.0,
    )
    observation, _ = env.reset(seed=1)
    rows = [observation]
    over, action = False, np.zeros(5, np.float32)
    while not over:
        observation, _, terminated, truncated, _ = env.step(action)
        rows.append(observation)
        over = terminated or truncated
        action = LOOSEN if len(rows) > SHOWN else action
    films = {name: np.stack([row[name] for row in rows]) for name in CHANNELS}
    return env.unwrapped, {name: film.reshape(len(rows), 2, -1) for name, film in films.items()}


def save(figure: Figure, file: Path) -> None:
    """Writes the figure; with 256 colours, which halves its size, unless it is of an image."""
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())[..., :3]  # type: ignore[attr-defined]
    picture = Image.fromarray(pixels)
    if file.stem not in PHOTOGRAPHS:
        picture = picture.quantize(256, dither=Image.Dither.NONE)
    picture.save(file, optimize=True)
    plt.close(figure)


def two_pads(width: float, height: float) -> tuple[Figure, list[Axes]]:
    """Axes for the faces of both pads, of half that width and height (mm)."""
    figure, axes = plt.subplots(1, 2, figsize=(6.4, 3.9), dpi=110, layout="constrained")
    for ax, title in zip(axes, PADS, strict=True):
        ax.set(aspect="equal", xlim=(-width, width), ylim=(-height, height))
        ax.set(title=title, xlabel="across, x (mm)")
    axes[0].set_ylabel("along the finger, y (mm)")
    return figure, list(axes)


def arrows(rest: Floats, pads: Floats, longer: float, size: float) -> Figure:
    """Draws motion (m) of places at rest (m): arrows for x and y, colour for z."""
    figure, axes = two_pads(11, 13.5)
    places, pads = rest[:, :2].T * MM, pads.reshape(2, len(rest), 3) * MM
    for ax, motion in zip(axes, pads, strict=True):
        dots = ax.scatter(
            places[0], places[1], c=motion[:, 2], s=size, cmap="viridis", vmin=pads[..., 2].min()
        )
        shear = motion[:, :2].T * longer
        ax.quiver(*places, *shear, angles="xy", scale_units="xy", scale=1, width=0.006)
    figure.suptitle(f"motion in x and y, drawn {longer:g} times as long", fontsize=10)
    figure.colorbar(dots, ax=axes, shrink=0.8, label="motion in z (mm)")
    return figure


def cells(rest: Floats, pads: Floats, label: str, palette: str, half: float) -> Figure:
    """Draws one number for each cell of a grid on both pads."""
    figure, axes = two_pads(11, half)
    x, y = (np.unique(rest[:, axis].round(7)) * MM for axis in (0, 1))
    for ax, values in zip(axes, pads, strict=True):
        grid = values.reshape(len(y), len(x))
        drawn = ax.pcolormesh(x, y, grid, cmap=palette, vmin=pads.min(), vmax=pads.max())
    figure.colorbar(drawn, ax=axes, shrink=0.8, label=label)
    return figure


def traction(rest: Floats, pads: Floats) -> Figure:
    """Draws pressure as colours and shear as arrows."""
    figure, axes = two_pads(11, 13.5)
    x, y = (np.unique(rest[:, axis].round(7)) * MM for axis in (0, 1))
    pads = pads.reshape(2, len(y), len(x), 3) * KPA
    for ax, values in zip(axes, pads, strict=True):
        pressure = -values[..., 2]
        drawn = ax.pcolormesh(x, y, pressure, cmap="Blues", vmin=0, vmax=-pads[..., 2].min())
        ax.quiver(x, y, values[..., 0], values[..., 1], scale=10, scale_units="x", width=0.01)
    longest = np.linalg.norm(pads[..., :2], axis=-1).max()
    figure.suptitle(f"arrows: shear, the longest {longest:.0f} kPa", fontsize=10)
    figure.colorbar(drawn, ax=axes, shrink=0.8, label="pressure, -z (kPa)")
    return figure


def image(rest: Floats, pads: Floats) -> Figure:
    """Draws the pictures of both cameras."""
    rows, columns = (len(np.unique(rest[:, axis].round(9))) for axis in (1, 0))
    low, high = rest.min(axis=0) * MM, rest.max(axis=0) * MM
    figure, axes = two_pads(high[0] + 1, high[1] + 1)
    for ax, picture in zip(axes, pads.reshape(2, rows, columns, 3), strict=True):
        ax.imshow(picture, origin="lower", extent=(low[0], high[0], low[1], high[1]))
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return figure


def marker_pixels(rest: Floats, places: Floats, pads: Floats, pictures: Floats) -> Figure:
    """Draws the motion (pixels) of markers over the pictures, whose pixels are at `places` (m)."""
    rows, columns = (len(np.unique(places[:, axis].round(9))) for axis in (1, 0))
    low, high = places.min(axis=0), places.max(axis=0)
    at = ((rest[:, :2] - low) / (high - low) * (columns - 1, rows - 1)).T
    figure, axes = plt.subplots(1, 2, figsize=(6.4, 3.9), dpi=110, layout="constrained")
    shown = zip(pads.reshape(2, -1, 2), pictures.reshape(2, rows, columns, 3), strict=True)
    for ax, title, (motion, picture) in zip(axes, PADS, shown, strict=True):
        ax.imshow(picture, origin="lower")
        ax.plot(*at, "k.", markersize=4)
        ax.quiver(*at, *(motion.T * 10), angles="xy", scale_units="xy", scale=1, width=0.006)
        ax.set(xlim=(-6, columns + 5), ylim=(-6, rows + 5))
        ax.set(title=title, xlabel="column of the image")
    axes[0].set_ylabel("row of the image")
    longest = np.linalg.norm(pads.reshape(-1, 2), axis=1).max()
    figure.suptitle(f"drawn 10 times as long, the longest {longest:.2g} pixels", fontsize=10)
    return figure


def tet_stress(pads: Floats) -> Figure:
    """Draws the tetrahedra that the plane y = 0 cuts."""
    mesh = ruffini.Surrogate().body.mesh
    corners = mesh.vertices[mesh.tets] * MM
    figure, axes = plt.subplots(2, 1, figsize=(6.4, 3.6), dpi=110, layout="constrained")
    for ax, title, values in zip(axes, PADS, pads * KPA, strict=True):
        cut = [(polygon(tet), value) for tet, value in zip(corners, values, strict=True)]
        shown, level = zip(*[one for one in cut if one[0] is not None], strict=True)
        drawn = PolyCollection(shown, array=level, cmap="magma_r", edgecolor="0.6", lw=0.2)
        drawn.set_clim(0, pads.max() * KPA)
        ax.add_collection(drawn)
        ax.set(aspect="equal", xlim=(-11, 11), ylim=(-4.3, 0.3), title=title, ylabel="z (mm)")
    axes[1].set_xlabel("across, x (mm)")
    figure.colorbar(drawn, ax=axes, shrink=0.8, label="von Mises stress (kPa)")
    return figure


def polygon(tet: Floats) -> Floats | None:
    """Section (K, 2) of a tetrahedron (4, 3) by the plane y = 0, if it is cut."""
    height = tet[:, 1]
    ends = [(i, j) for i in range(4) for j in range(4) if height[i] < 0 <= height[j]]
    if not ends:
        return None
    low, high = (tet[list(side)] for side in zip(*ends, strict=True))
    share = (low[:, 1] / (low[:, 1] - high[:, 1]))[:, None]
    points = (low + share * (high - low))[:, [0, 2]]
    around = points - points.mean(axis=0)
    return points[np.argsort(np.arctan2(around[:, 1], around[:, 0]))]


def curves(lines: dict[str, Floats], grip: Floats, label: str) -> Figure:
    """Draws numbers over the episode, and the force of the grip under them."""
    figure, axes = plt.subplots(
        2, 1, sharex=True, figsize=(6.4, 3.6), dpi=110, layout="constrained", height_ratios=[3, 1]
    )
    seconds = np.arange(len(grip)) * control_period()
    for text, values in lines.items():
        axes[0].plot(seconds, values, label=text)
    axes[0].legend(fontsize=8)
    axes[0].set_ylabel(label)
    axes[1].plot(seconds, grip, color="0.4")
    axes[1].set(xlabel="time (s)", ylabel="grip (N)", ylim=(0, None))
    return figure


def pad_axes() -> Figure:
    """Draws the undeformed pad with the axes of its frame, y upwards and z to the front."""
    mesh = ruffini.sensor("gelsight-mini", resolution=2000).mesh
    sides = np.sort(mesh.tets[:, [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]].reshape(-1, 3))
    faces, times = np.unique(sides, axis=0, return_counts=True)
    corners = mesh.vertices[faces[times == 1]] * (MM, MM, -MM)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals *= np.sign(np.sum(normals * (corners.mean(axis=1) - (0, 0, 2)), axis=1))[:, None]
    grey = 0.6 + 0.3 * normals @ (-0.4, 0.6, -0.7)
    figure = plt.figure(figsize=(4.6, 3.2), dpi=110)
    ax = figure.add_axes((0, 0, 1, 1), projection="3d", proj_type="ortho", computed_zorder=False)
    colours = np.repeat(grey.clip(0, 1)[:, None], 3, axis=1)
    drawn = corners[:, :, [0, 2, 1]]
    ax.add_collection3d(Poly3DCollection(drawn, facecolors=colours, edgecolors=colours, zorder=1))
    for text, end, colour, side in (
        ("x, across\nthe finger", (17, 0, 0), "tab:red", "left"),
        ("y, along the finger,\ntowards the hand", (0, 0, 19), "tab:green", "left"),
        ("z, out of\nthe gel", (0, -17, 0), "tab:blue", "right"),
    ):
        ax.quiver(0, 0, 0, *end, color=colour, lw=2, arrow_length_ratio=0.12, zorder=2)
        ax.text(*np.multiply(end, 1.08), text, color=colour, ha=side, zorder=3)
    ax.set(xlim=(-16, 16), ylim=(-16, 16), zlim=(-12, 20))
    ax.set_box_aspect((1, 1, 1), zoom=1.3)
    ax.view_init(elev=22, azim=-55)
    ax.set_axis_off()
    return figure


def figures() -> dict[str, Figure]:
    """A figure of the pad's axes and of every channel."""
    env, films = episode()
    skin, now = env.skin(), {name: film[SHOWN] for name, film in films.items()}
    stress, depth = now["stress"] * KPA, now["depth"] * MM
    grip = np.abs(films["wrench"][:-1, :, 2]).mean(axis=1)
    force = zip(
        ("across, x", "along the finger, y", "out of the gel, z"),
        films["wrench"][:-1, 0, :3].T,
        strict=True,
    )
    slip = zip(PADS, films["slip"][:-1, :, 0].T, strict=True)
    predicted = zip(
        ("displacement", "stress", "force"),
        100 * films["predicted_error"][:-1, 0].T,
        strict=True,
    )
    return {
        "axes": pad_axes(),
        "markers": arrows(skin["markers"], now["markers"], 10, 40),
        "marker_pixels": marker_pixels(
            skin["markers"], skin["image"], now["marker_pixels"], now["image"]
        ),
        "displacement": arrows(skin["surface"], now["displacement"], 10, 12),
        "stress": cells(skin["grid"], stress, "von Mises stress (kPa)", "magma_r", 13.5),
        "depth": cells(skin["depth"], depth, "height of the face (mm)", "gray", 13.5),
        "image": image(skin["image"], now["image"]),
        "traction": traction(skin["grid"], now["traction"]),
        "tet_stress": tet_stress(now["tet_stress"]),
        "wrench": curves(dict(force), grip, "force on the pad on -x (N)"),
        "slip": curves(dict(slip), grip, "share of the force that slides"),
        "predicted_error": curves(dict(predicted), grip, "predicted error (%)"),
    }


def main() -> None:
    """Draws the axes and every channel."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the pictures")
    out: Path = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    for name, figure in figures().items():
        save(figure, out / f"{name}.png")


if __name__ == "__main__":
    main()
