"""Shapes on the command line: ``sphere:0.004``, ``part.stl``."""

from __future__ import annotations

import importlib
import itertools
import re
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ruffini import Shape

_FORMS: dict[str, tuple[Callable[..., Shape], str]] = {
    "sphere": (Shape.sphere, "radius"),
    "cuboid": (lambda *half: Shape.cuboid(half), "half-x,half-y,half-z"),
    "cylinder": (Shape.cylinder, "radius,half-height"),
    "capsule": (Shape.capsule, "radius,half-height"),
    "cone": (Shape.cone, "radius,half-height"),
    "prism": (Shape.prism, "sides,radius,half-height"),
    "annulus": (Shape.annulus, "outer,inner,half-height"),
    "ellipsoid": (lambda *axes: Shape.ellipsoid(axes), "semi-x,semi-y,semi-z"),
    "cup": (Shape.cup, "bottom,rim,half-height,wall"),
    "half-space": (Shape.half_space, ""),
}

FORMS = ", ".join(f"{name}:{lengths}".rstrip(":") for name, (_, lengths) in _FORMS.items())
"""Forms in which a shape can be written, lengths in m."""


def shape(text: str) -> Shape:
    """Parse a shape from `text`: a name with lengths, or the path of an .obj or .stl file (in m).

    Raises:
        ValueError: If it is neither.
    """
    if text.lower().endswith((".obj", ".stl")):
        return Shape.read(text)
    name, _, given = text.partition(":")
    if name not in _FORMS:
        raise ValueError(f"shape: found {text}, expected {FORMS}, or a .obj or .stl file")
    make, lengths = _FORMS[name]
    kinds = [int if length == "sides" else float for length in lengths.split(",") if length]
    words = given.split(",") if given else []
    try:
        numbers = [kind(word) for kind, word in zip(kinds, words, strict=True)]
    except ValueError:
        raise ValueError(f"shape: found {text}, expected {name}:{lengths}".rstrip(":")) from None
    return make(*numbers)


def form(text: str) -> str:
    """Write a shape that is described in words as `shape` takes it; return other texts as they are.

    ``cone, half height 0.02 m, radius 0.01 m`` is ``cone:0.01,0.02``.
    """
    kind, *words = text.split(", ")
    if kind not in _FORMS or not words:
        return text
    found = (re.fullmatch(r"([a-z ]+) (\d.*?)(?: m)?", word) for word in words)
    lengths = {match[1].replace(" ", "-"): match[2].split()[::2] for match in found if match}
    if len(lengths) > 1:
        lengths = {name: lengths[name] for name in _FORMS[kind][1].split(",")}
    return f"{kind}:{','.join(itertools.chain(*lengths.values()))}"


NAMED = {
    "sphere": "sphere:0.018",
    "cuboid": "cuboid:0.015,0.015,0.02",
    "cylinder": "cylinder:0.015,0.02",
    "prism": "prism:8,0.016,0.018",
    "annulus": "annulus:0.02,0.013,0.012",
    "ellipsoid": "ellipsoid:0.016,0.022,0.018",
    "cup": "cup:0.016,0.02,0.022,0.002",
    "square-peg": "cuboid:0.006,0.006,0.03",
    "round-peg": "cylinder:0.006,0.03",
    "hexagonal-peg": f"prism:6,{0.012 / 3**0.5},0.03",
}
"""The objects of the tasks' catalogue that have a form, as env-core/src/scene/catalogue.rs has."""
_WAVY: dict[str, tuple[list[float], list[tuple[float, list[float], float]]]] = {
    "potato": ([0.022, 0.016, 0.017], [(0.05, [3, 2, 0], 1), (0.04, [2, 0, 5], 0)]),
    "lemon": ([0.017, 0.017, 0.022], [(0.08, [0, 0, 6], 0)]),
    "apple": ([0.02, 0.02, 0.019], [(-0.12, [0, 0, 2.4], -0.6)]),
    "eggplant": ([0.03, 0.016, 0.016], [(0.14, [1.6, 0, 0], 0.8)]),
}
"""The others: semi-axes and waves of `Shape.star_shaped`."""
_SECTIONS = 64
"""Edges that approximate a circle."""


def surface(text: str) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Triangulate a shape, for pictures; needs trimesh, which comes with viser.

    Args:
        text: As for `shape`, or a name of the tasks' catalogue.

    Returns:
        Vertices (V, 3) in m and corners of the triangles (F, 3).

    Raises:
        ValueError: If it is neither.
    """
    trimesh: Any = importlib.import_module("trimesh")
    if text in _WAVY:
        return _projected(Shape.star_shaped(*_WAVY[text]), 0.018)
    text = NAMED.get(text, text)
    make = trimesh.creation
    if text.lower().endswith((".obj", ".stl")):
        mesh = trimesh.load_mesh(text)
        return np.asarray(mesh.vertices), np.asarray(mesh.faces)
    found = shape(text)
    kind, _, given = text.partition(":")
    lengths = [float(word) for word in given.split(",") if word]
    if kind == "half-space":
        mesh = make.box((0.03, 0.03, 0.002))
        mesh.apply_translation((0, 0, -0.001))
    elif kind == "cuboid":
        mesh = make.box(2 * np.array(lengths))
    elif kind in ("sphere", "ellipsoid", "capsule"):
        return _projected(found, min(lengths))
    else:
        sections = int(lengths.pop(0)) if kind == "prism" else _SECTIONS
        mesh = make.revolve(_profile(kind, lengths), sections=sections)
        if kind == "prism":
            mesh.apply_transform(
                trimesh.transformations.rotation_matrix(np.pi / sections, (0, 0, 1))
            )
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def _profile(kind: str, lengths: list[float]) -> list[tuple[float, float]]:
    """Half of the section of a solid of revolution, as (radius, z), from the axis at the bottom."""
    if kind == "cone":
        radius, h = lengths
        return [(0, -h), (radius, -h), (0, h)]
    if kind == "annulus":
        outer, inner, h = lengths
        return [(inner, -h), (outer, -h), (outer, h), (inner, h), (inner, -h)]
    if kind == "cup":
        bottom, rim, h, wall = lengths
        inside = [(rim - wall, h), (bottom - wall, wall - h), (0.0, wall - h)]
        return [(0, -h), (bottom, -h), (rim, h), *inside]
    radius, h = lengths
    return [(0, -h), (radius, -h), (radius, h), (0, h)]


def _projected(body: Shape, radius: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Mesh of a body without edges: a ball of that radius, whose points are moved to the body."""
    import trimesh

    ball = trimesh.creation.icosphere(4, radius)
    points = np.asarray(ball.vertices)
    ways = points / radius
    for _ in range(30):
        points = points - 0.7 * body.distance(points)[0][:, None] * ways
    return points, np.asarray(ball.faces)
