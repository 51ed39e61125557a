"""Shapes on the command line: ``sphere:0.004``, ``part.stl``."""

from __future__ import annotations

from collections.abc import Callable

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
