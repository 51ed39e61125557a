"""Markdown of what the JSON of a report holds: tables by columns, text with figures by key.

A figure stands in text and in a column as in `str.format`, by its keys in the JSON, with a factor
before the format where it is written in another unit: ``{error[median]:100*.1f} %``. On pages that
are written by hand it is followed by a mark, the report's name and the keys that lead to it:
``12.3 ms<!-- pareto: panels / deep / network / ms -->``, in a list the number of a row or a name
that stands in it; before a ``%`` it is a hundred times that.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from string import Formatter
from typing import Any

from engine.rows import OUT, ROOT

Column = str | Callable[[Any], str]
"""Form of a cell: a format string, or a function of the row."""
Columns = Mapping[str, Column] | list[tuple[str, Column]]
"""Columns by heading."""


class _Figures(Formatter):
    def format_field(self, value: Any, format_spec: str) -> str:
        factor, times, spec = format_spec.rpartition("*")
        return format(float(factor) * value if times else value, spec)


def filled(template: str, values: Mapping[str, Any]) -> str:
    """A text with its figures."""
    return _Figures().vformat(template, (), values)


def text(template: str, report: Mapping[str, Any], **parts: str) -> str:
    """A page: paragraphs of the template, each on one line, with figures and `parts` put in.

    A paragraph of which nothing comes is left out.
    """
    values = {**report, **parts}
    lines = [filled(" ".join(part.split()), values) for part in template.split("\n\n")]
    return "\n\n".join(line for line in lines if line)


def table(columns: Columns, rows: Iterable[Any], absent: str | None = None) -> str:
    """A table of rows by the heading of each column; `absent` stands where a row lacks a figure."""

    def cell(column: Column, row: Any) -> str:
        try:
            return filled(column, row) if isinstance(column, str) else column(row)
        except (KeyError, TypeError):
            if absent is None:
                raise
            return absent

    pairs = list(columns.items() if isinstance(columns, Mapping) else columns)
    cells = [[cell(column, row) for _, column in pairs] for row in rows]
    return grid([heading for heading, _ in pairs], cells)


def spread(key: str, high: str = "p95", unit: str = "") -> str:
    """A column: the median of an error and a high one in per cent."""
    return f"{{{key}[median]:100*.1f}} / {{{key}[{high}]:100*.1f}}{unit}"


def grid(head: list[str], rows: list[list[str]]) -> str:
    """A table of cells, columns of numbers to the right but for the first."""
    columns = [[row[place] for row in rows] for place in range(1, len(head))]
    sides = ["---", *("---:" if are_numbers(cells) else "---" for cells in columns)]
    lines = [head, sides, *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


NUMBER = re.compile(r"\**(> )?[-+−]?\d[\d,.]*(e[-+]?\d+)?(?!\w)")
ABSENT = ("", "–", "not said")


def are_numbers(cells: list[str]) -> bool:
    """Returns whether at least half of the cells that are not empty begin with a number."""
    found = [NUMBER.match(cell) is not None for cell in cells if cell not in ABSENT]
    return 2 * sum(found) >= len(found)


def made(report: Mapping[str, Any], sizes: Mapping[str, Any] | None = None) -> str:
    """Line of a page on the origin of its figures."""
    sizes = report["sizes"] if sizes is None else sizes
    line = (
        "Made at commit {commit} on {machine[cores]} cores ({machine[cpu]}, {machine[system]}), "
        "Python {versions[python]}, numpy {versions[numpy]}"
    )
    listed = ", ".join(f"{name} {value}" for name, value in sizes.items())
    return (
        filled(line, report) + f"; {listed}" * bool(listed) + f". {report.get('note', '')}"
    ).rstrip()


MARK = re.compile(
    r"(?P<number>-?[\d,]*\.?\d+)(?P<unit> ?[%\w]+)?\**<!-- (?P<report>[\w-]+): (?P<keys>.+?) -->"
)
FOLDERS = (OUT, ROOT / "tests/reference", ROOT / "policies/results")
"""Folders of the JSON that pages quote."""
WRITTEN = (OUT / "mechanics.md", OUT / "surrogate.md", *sorted((ROOT / "py/docs").glob("*.md")))
"""Pages that are written by hand, with marks."""


@lru_cache
def _json(file: Path) -> Any:
    return json.loads(file.read_text())


def value(report: str, keys: str) -> float:
    """The number in a report under keys.

    Raises:
        KeyError: If there is none.
    """
    files = [folder / f"{report}.json" for folder in FOLDERS]
    found = _json(next(file for file in files if file.exists()))
    for step in keys.split(" / "):
        if isinstance(found, list) and not step.isdigit():
            [found] = [row for row in found if step in row.values()]
        else:
            found = found[int(step) if isinstance(found, list) else step]
    if not isinstance(found, int | float):
        raise KeyError(f"{report}: {keys} is {found}")
    return found


def quoted(mark: re.Match[str]) -> str:
    """A marked figure as the report has it, with as many digits as are written."""
    digits = len(mark["number"].partition(".")[2])
    true = value(mark["report"], mark["keys"]) * (100 if "%" in (mark["unit"] or "") else 1)
    return f"{true:,.{digits}f}" if true >= 1e3 and "," in mark["number"] else f"{true:.{digits}f}"


def requoted(page: str) -> str:
    """A page with its marked figures as the reports have them."""
    return MARK.sub(lambda mark: quoted(mark) + mark[0].removeprefix(mark["number"]), page)
