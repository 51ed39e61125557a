"""What every report shares: where it was made, and rows that are kept as they are finished.

A report has a full form, which makes the committed files beside this one, and a quick one into a
folder of its own. Its rows lie as lines of JSON under `target/reports`; rows of another code, by
its last commit, another machine or other sizes are dropped.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import numpy as np

import ruffini

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
KEPT = ROOT / "target/reports"


def header(made_of: list[str], sizes: dict) -> dict:
    """What the figures depend on: commit of what they are made of, machine, versions, sizes."""
    last = ["git", "log", "-1", "--format=%h", "--", *made_of]
    cpu = [s for s in Path("/proc/cpuinfo").read_text().splitlines() if s.startswith("model name")]
    return {
        "commit": subprocess.check_output(last, cwd=ROOT, text=True).strip(),
        "machine": {
            "cpu": cpu[0].split(": ")[1] if cpu else platform.processor(),
            "cores": os.cpu_count(),
            "system": platform.platform(),
        },
        "versions": {"ruffini": ruffini.__version__, "numpy": np.__version__}
        | {"python": platform.python_version(), "matplotlib": version("matplotlib")},
        "sizes": sizes,
    }


def made(header: dict) -> str:
    """The line of a page that says where its figures come from."""
    machine, versions = header["machine"], header["versions"]
    sizes = ", ".join(f"{name} {value}" for name, value in header["sizes"].items())
    return (
        f"Made at commit {header['commit']} on {machine['cores']} cores ({machine['cpu']}, "
        f"{machine['system']}), Python {versions['python']}, numpy {versions['numpy']}; {sizes}. "
        + header["note"]
    ).rstrip()


class Rows:
    """Rows by their `key`, each in the file from the moment it is added."""

    def __init__(self, file: Path, header: dict):
        lines = file.read_text().splitlines() if file.exists() else []
        whole = [json.loads(line) for line in lines if line.endswith("}")]
        same = whole and whole[0] == header
        self._rows = {row["key"]: row for row in whole[1:]} if same else {}
        file.parent.mkdir(parents=True, exist_ok=True)
        # A line cut short by a kill is left out, here and in the file.
        file.write_text("".join(json.dumps(row) + "\n" for row in [header, *self._rows.values()]))
        self._file = file

    def __contains__(self, key: object) -> bool:
        return key in self._rows

    def __iter__(self) -> Iterator[dict]:
        return iter(sorted(self._rows.values(), key=lambda row: row["key"]))

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, row: dict) -> None:
        """Keeps a row, in the file too."""
        line = json.dumps(row)
        self._rows[row["key"]] = json.loads(line)
        with self._file.open("a") as file:
            file.write(line + "\n")


def folder(parser: argparse.ArgumentParser, options: argparse.Namespace) -> Path:
    """Where the files of the report go: beside this one, or under `target` for a quick form."""
    out = (options.out or (KEPT / "quick" if options.quick else HERE)).resolve()
    if options.quick and out == HERE:
        parser.error(f"--out is {out}: a quick run must not replace the committed files")
    out.mkdir(parents=True, exist_ok=True)
    return out


def arguments(doc: str) -> argparse.ArgumentParser:
    """The options that all reports have."""
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a small form, within minutes")
    parser.add_argument("--note", default="", help="what a reader must know of this run")
    parser.add_argument("--out", type=Path, help="folder of the files")
    return parser


def table(head: list[str], rows: list[list[str]]) -> str:
    """A table of Markdown, the first column to the left and the others to the right."""
    lines = [head, ["---"] + ["---:"] * (len(head) - 1), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
