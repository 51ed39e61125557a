"""The command line of all reports."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from engine.figures import save
from engine.pages import WRITTEN, requoted
from engine.rows import KEPT, OUT

REPORTS = ["buried", "dataset", "episode", "fem", "insertion", "load", "networks", "paper"]
REPORTS += [
    "pareto",
    "paths",
    "reality",
    "rim",
    "scene_cost",
    "sensors",
    "shapes",
    "sim_to_sim",
    "sliding",
    "soak",
    "stability",
    "targets",
    "unseen",
]


def main(arguments: list[str]) -> None:
    """Makes one report, or the pages of all."""
    if arguments == ["--pages"]:
        for name in REPORTS:
            if (OUT / f"{name}.json").exists():
                write(name, json.loads((OUT / f"{name}.json").read_text()), OUT)
        for page in WRITTEN:
            page.write_text(requoted(page.read_text()))
        return
    usage = f"usage: python py/reports --pages | NAME [--help]; NAME: {', '.join(REPORTS)}"
    if arguments[:1] in (["-h"], ["--help"]):
        print(usage)
        return
    if not arguments or arguments[0] not in REPORTS:
        sys.exit(usage)
    make(*arguments)


def make(name: str, *arguments: str) -> None:
    """Makes the files of one report."""
    report = importlib.import_module(name)
    parser = parser_of(report, name)
    options = parser.parse_args(arguments)
    options.form = "quick" if options.quick else "full"
    out = (options.out or (KEPT / "quick" if options.quick else OUT)).resolve()
    if options.quick and out == OUT:
        parser.error(f"--out is {out}: a quick run must not replace the committed files")
    out.mkdir(parents=True, exist_ok=True)
    if getattr(report, "ONE_THREAD", False):
        os.environ["RAYON_NUM_THREADS"] = "1"
    file, found = out / f"{name}.json", None if options.pages else report.make(options)
    if found is None:
        found = json.loads((file if file.exists() else OUT / file.name).read_text())
    else:
        file.write_text(json.dumps(found, indent=1) + "\n")
    write(name, found, out)
    if also := getattr(report, "also", None):
        also(found, out, options)
    print(file.with_suffix(".md"))


def parser_of(report: ModuleType, name: str) -> argparse.ArgumentParser:
    """The options of all reports, and those of this one."""
    parser = argparse.ArgumentParser(
        prog=f"python py/reports {name}",
        description=report.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--quick", action="store_true", help="a small form, within minutes")
    parser.add_argument("--pages", action="store_true", help="only the pages, from the JSON")
    parser.add_argument("--note", default="", help="what a reader must know of this run")
    parser.add_argument("--out", type=Path, help="folder of the files")
    if options := getattr(report, "options", None):
        options(parser)
    return parser


def write(name: str, found: dict[str, Any], out: Path) -> None:
    """Page and figure of what a report holds."""
    report = importlib.import_module(name)
    (out / f"{name}.md").write_text(report.page(found) + "\n")
    if figure := getattr(report, "figure", None):
        save(figure, found, out / f"{name}.svg")
