"""Touch as measured on real sensors beside touch as simulated: parts, each a module of its own.

A part has ``make(options)``, its figures; ``section(part)``, their Markdown; and ``draw(part,
figure)``, their picture on a part of the page's, with ``HEIGHT`` in inches.
"""

from __future__ import annotations

from argparse import Namespace
from importlib import import_module
from typing import Any

from engine import plt

PARTS = ("reality_curves", "reality_image", "reality_face")
ONE_THREAD = True


def make(options: Namespace) -> dict[str, Any]:
    """Figures of every part by its module."""
    return {name: import_module(name).make(options) for name in PARTS}


def page(report: dict[str, Any]) -> str:
    """Sections of the parts."""
    sections = [import_module(name).section(part) for name, part in report.items()]
    head = ["# Against measurements of real sensors", "![the figures below](reality.svg)"]
    return "\n\n".join([*head, *sections])


def figure(report: dict[str, Any]) -> Any:
    """Pictures of the parts, one below the other."""
    heights = [import_module(name).HEIGHT for name in report]
    picture = plt.figure(figsize=(12, sum(heights)), layout="constrained")
    places = picture.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    for (name, part), place in zip(report.items(), places, strict=True):
        import_module(name).draw(part, place)
    return picture
