"""Shapes on the command line: ``sphere:0.004``, ``cuboid:0.01,0.01,0.02:0.001``, ``part.stl``."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ruffini import OBJECTS, Shape

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

_EDGED = ("cuboid", "cylinder", "cone", "prism", "annulus", "cup")


def _form(name: str) -> str:
    edge = "[:edge-radius]" if name in _EDGED else ""
    return f"{name}:{_FORMS[name][1]}{edge}".rstrip(":")


FORMS = ", ".join(_form(name) for name in _FORMS)
"""Forms in which a shape can be written, lengths in m."""


def shape(text: str) -> Shape:
    """Parse a shape from `text`: a name with lengths, an object of the tasks, or a mesh file in m.

    Raises:
        ValueError: If it is neither.
    """
    if text.lower().endswith((".obj", ".stl")):
        return Shape.read(text)
    if text in OBJECTS:
        return Shape.named(text)
    name, _, given = text.partition(":")
    given, _, edge = given.partition(":")
    if name not in _FORMS:
        names = ", ".join(OBJECTS)
        raise ValueError(f"shape: found {text}, expected {FORMS}, {names}, or a .obj or .stl file")
    make, lengths = _FORMS[name]
    kinds = [int if length == "sides" else float for length in lengths.split(",") if length]
    words = given.split(",") if given else []
    try:
        numbers = [kind(word) for kind, word in zip(kinds, words, strict=True)]
    except ValueError:
        raise ValueError(f"shape: found {text}, expected {_form(name)}") from None
    found = make(*numbers)
    return found.rounded(radius(edge)) if edge else found


def radius(text: str) -> float:
    """Parse the radius of edges (m).

    Raises:
        ValueError: If `text` is no number.
    """
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"edge radius: found {text}, expected a number in m") from None


def surface(found: Shape) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
    """Triangulate a shape, for pictures; a half-space becomes a thin plate.

    Returns:
        Vertices (V, 3) in m and corners of the triangles (F, 3).
    """
    try:
        return found.surface()
    except ValueError:
        vertices, faces = Shape.cuboid((0.015, 0.015, 0.001)).surface()
        return vertices - [0, 0, 0.001], faces
