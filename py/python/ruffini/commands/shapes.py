"""Shapes on the command line: ``sphere:0.004``, ``cuboid:0.01,0.01,0.02:0.001``, ``part.stl``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ruffini import OBJECTS, Shape
from ruffini._schema import SHAPES

_BESIDE = 0.25
"""Distance of a mesh's middle from its z axis, over its width, from which it is refused, as by
environments; less of it moves a ball's force on a built-in pad by some 3 %."""
_LENGTHS = {name: kind["lengths"] for name, kind in SHAPES.items()} | {"half-space": []}
"""Names of the lengths of each kind with examples, in the order in which they are written."""


def _numbers(kind: str) -> list[tuple[str, type]]:
    """Name and type of each number of a kind: three of a vector."""
    return [
        (f"{name.split('_')[0]}-{axis}", float) if axis else (name.replace("_", "-"), type(example))
        for name, example in _LENGTHS[kind]
        for axis in ("xyz" if isinstance(example, list) else [""])
    ]


def _form(kind: str) -> str:
    edge = "[:edge-radius]" if kind in SHAPES and SHAPES[kind]["has_edges"] else ""
    return f"{kind}:{','.join(name for name, _ in _numbers(kind))}{edge}".rstrip(":")


SCALE = "length of a unit of the mesh file (m), 0.001 for one in mm; 1 if not given"
"""Help of the option for it."""
FORMS = ", ".join(map(_form, _LENGTHS))
"""Forms in which a shape can be written, lengths in m."""


def is_mesh(text: str) -> bool:
    """Whether `text` is the name of a mesh file."""
    return text.lower().endswith((".obj", ".stl"))


def check_scale(scale: float | None, texts: Sequence[str]) -> None:
    """Refuse a scale without a mesh file.

    Raises:
        ValueError: If there is one.
    """
    if scale is not None and not any(map(is_mesh, texts)):
        raise ValueError(f"scale: found {scale:g} without a .obj or .stl file, expected both")


def shape(text: str, scale: float | None = None) -> Shape:
    """Parse a shape from `text`: a name with lengths, an object of the tasks, or a mesh file.

    Args:
        text: What is parsed.
        scale: Length of the unit of a mesh file (m); 1 if not given.

    Raises:
        ValueError: If it is none of them, or a mesh lies beside its z axis.
    """
    if is_mesh(text):
        return _mesh(text, scale)
    if text in OBJECTS:
        return Shape.named(text)
    name, _, given = text.partition(":")
    given, _, edge = given.partition(":")
    if name not in _LENGTHS:
        names = ", ".join(OBJECTS)
        raise ValueError(f"shape: found {text}, expected {FORMS}, {names}, or a .obj or .stl file")
    words = given.split(",") if given else []
    try:
        kinds = [kind for _, kind in _numbers(name)]
        numbers = iter([kind(word) for kind, word in zip(kinds, words, strict=True)])
    except ValueError:
        raise ValueError(f"shape: found {text}, expected {_form(name)}") from None
    lengths = [
        [next(numbers) for _ in example] if isinstance(example, list) else next(numbers)
        for _, example in _LENGTHS[name]
    ]
    try:
        found: Shape = getattr(Shape, name.replace("-", "_"))(*lengths)
    except ValueError as error:
        longest = max(map(float, words), default=0.0)
        hint = f"; lengths are in m: {longest:g} mm are {longest / 1e3:g}" if longest > 1 else ""
        raise ValueError(f"{error}{hint}") from None
    return found.rounded(radius(edge)) if edge else found


def _mesh(file: str, scale: float | None) -> Shape:
    """Solid of a mesh file around its z axis, which is the line that is pressed into the apex."""
    found = Shape.read(file, 1.0 if scale is None else scale)
    vertices, _ = found.surface()
    low, high = vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)
    x, y = middle = (low + high) / 2
    if (np.abs(middle) > _BESIDE * (high - low)).any():
        text = f"found its middle at x = {1e3 * x:.4g} mm, y = {1e3 * y:.4g} mm, beside its z axis"
        raise ValueError(
            f"{file}: {text}, which is what is pressed into the apex; expected a mesh around that "
            f"axis: move it by ({-1e3 * x + 0.0:.4g}, {-1e3 * y + 0.0:.4g}, 0) mm"
        )
    return found


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
