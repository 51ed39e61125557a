"""Touch as measured on real sensors beside touch as simulated: parts, each a module of its own.

A part has ``make(options)``, its figures; ``section(part)``, their Markdown; where it compares with
what others found, ``rows(part)``, its lines of the first table; and, where it has a picture,
``draw(part, figure)``, which draws it on a part of the page's, with ``HEIGHT`` in inches.
``--part NAME …`` makes only these anew.
"""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from importlib import import_module
from typing import Any

from engine import OUT, plt, table

PARTS = ("reality_unfitted", "reality_curves", "reality_table", "reality_image", "reality_face")
PARTS += ("reality_mesh",)
ONE_THREAD = True
COLUMNS = {
    "what": "{what}",
    "found by": "{by}",
    "ours": "{ours}",
    "difference": "{difference}",
    "put down to": "{because}",
}


def options(parser: ArgumentParser) -> None:
    """Adds the option to make only some parts."""
    parser.add_argument(
        "--part",
        nargs="+",
        choices=PARTS,
        default=PARTS,
        help="make only these anew; the others stay as they are committed",
    )


def make(options: Namespace) -> dict[str, Any]:
    """Figures of the parts by their modules."""
    some = set(options.part) < set(PARTS)
    kept = json.loads((OUT / "reality.json").read_text()) if some else {}
    found = kept | {name: import_module(name).make(options) for name in options.part}
    return {name: found[name] for name in PARTS if name in found}


def page(report: dict[str, Any]) -> str:
    """A table of what is compared, and sections of the parts."""
    parts = [(import_module(name), part) for name, part in report.items()]
    rows = [row for module, part in parts if hasattr(module, "rows") for row in module.rows(part)]
    head = ["# Against measurements of real sensors", table(COLUMNS, rows)]
    head += ["![the figures below](reality.svg)"]
    return "\n\n".join([*head, *(module.section(part) for module, part in parts)])


def figure(report: dict[str, Any]) -> Any:
    """Pictures of the parts, one below the other."""
    modules = {name: import_module(name) for name in report}
    drawn = {name: module for name, module in modules.items() if hasattr(module, "draw")}
    heights = [module.HEIGHT for module in drawn.values()]
    picture = plt.figure(figsize=(12, sum(heights)), layout="constrained")
    places = picture.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    for (name, module), place in zip(drawn.items(), places, strict=True):
        module.draw(report[name], place)
    return picture
