"""Rows of a report, kept as they are finished, and where they were made.

Rows lie as lines of JSON under `target/reports`; a file of another code, by its last commit, of
another machine or other sizes is set aside.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import platform
import subprocess
import time
from argparse import Namespace
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import version
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

import ruffini
from ruffini.evaluation import processor, usable_cores

ROOT = Path(__file__).resolve().parents[3]
OUT = ROOT / "tests/reports"
"""Folder in which JSON, pages and pictures are committed."""
KEPT = ROOT / "target/reports"


def machine() -> dict[str, Any]:
    """Processor, cores and system."""
    return {"cpu": processor(), "cores": usable_cores(), "system": platform.platform()}


def header(made_of: Iterable[str], sizes: dict[str, Any]) -> dict[str, Any]:
    """Conditions of a report's figures: commit of their sources, machine, versions, sizes.

    A commit from which the sources differ has a ``+``.
    """
    made_of = list(made_of)

    def git(*words: str) -> str:
        return subprocess.check_output(["git", *words, "--", *made_of], cwd=ROOT, text=True).strip()

    changed = git("status", "--porcelain", "--untracked-files=no")
    return {
        "commit": git("log", "-1", "--format=%h") + "+" * bool(changed),
        "machine": machine(),
        "versions": {"ruffini": ruffini.__version__, "numpy": np.__version__}
        | {"python": platform.python_version(), "matplotlib": version("matplotlib")},
        "sizes": sizes,
    }


def conditions(header: Mapping[str, Any]) -> dict[str, Any]:
    """Part of a header on which rows depend: all but the version of what draws them."""
    versions = {k: of for k, of in header.get("versions", {}).items() if k != "matplotlib"}
    return {**header, "versions": versions}


def _set_aside(file: Path, commit: str) -> None:
    """Renames a file of rows to one that is named by their commit."""
    names = (f"{file.stem}.{commit}{f'-{n}' * (n > 1)}{file.suffix}" for n in count(1))
    aside = next(path for path in map(file.with_name, names) if not path.exists())
    file.rename(aside)
    print(f"{file}: made under other conditions, kept as {aside.name}", flush=True)


class Rows:
    """Rows by their `key`, each in the file from the moment it is added."""

    def __init__(self, file: Path, header: dict[str, Any]):
        self.header, self._file = header, file
        lines = file.read_text().splitlines() if file.exists() else []
        whole = [json.loads(line) for line in lines if line.endswith("}")]
        same = whole and conditions(whole[0]) == conditions(header)
        self._rows = {row["key"]: row for row in whole[1:]} if same else {}
        if whole[1:] and not same:
            _set_aside(file, whole[0]["commit"])
        file.parent.mkdir(parents=True, exist_ok=True)
        # A line cut short by a kill is left out, here and in the file.
        file.write_text("".join(json.dumps(row) + "\n" for row in [header, *self._rows.values()]))

    @classmethod
    def of(
        cls, name: str, options: Namespace, made_of: Iterable[str], sizes: dict[str, Any]
    ) -> Rows:
        """Those of a report's form, as far as it has come."""
        return cls(KEPT / options.form / f"{name}.jsonl", header(made_of, sizes))

    def __contains__(self, key: object) -> bool:
        """Returns whether a row is there; one that names something missing is not."""
        return key in self._rows and "missing" not in self._rows[key]

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return iter(sorted(self._rows.values(), key=lambda row: row["key"]))

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, row: dict[str, Any]) -> None:
        """Keeps a row, in the file too."""
        line = json.dumps(row)
        self._rows[row["key"]] = json.loads(line)
        with self._file.open("a") as file:
            file.write(line + "\n")


def run(rows: Rows, cases: Mapping[str, tuple[Any, ...]], jobs: int = 0) -> None:
    """Adds the rows of cases that are not there.

    Args:
        rows: What there is.
        cases: A function and its arguments by key; it returns a row, or rows with their keys.
        jobs: Processes at once, a new one for each case; none but this one if 0.
    """
    missing = [(key, *case) for key, case in cases.items() if key not in rows]
    if not jobs:
        _keep(rows, map(_called, missing))
    elif missing:
        with multiprocessing.get_context("spawn").Pool(jobs, maxtasksperchild=1) as pool:
            _keep(rows, pool.imap_unordered(_called, missing))


def _keep(rows: Rows, found: Iterable[tuple[str, list[dict[str, Any]]]]) -> None:
    for key, some in found:
        for row in some:
            rows.add(row)
        print(key, flush=True)


def _called(case: tuple[Any, ...]) -> tuple[str, list[dict[str, Any]]]:
    """A case's rows; a single one has the machine's load when it began, and how long it took."""
    key, function, *arguments = case
    load, begun = os.getloadavg()[0], time.perf_counter()
    found = function(*arguments)
    took = time.perf_counter() - begun
    return key, [{"key": key, "load": load, "took": took} | found] if isinstance(
        found, dict
    ) else found


def quantiles(values: Iterable[float], high: str = "95 %") -> dict[str, float]:
    """Median and 95th percentile."""
    median, most = np.quantile(list(values), [0.5, 0.95])
    return {"median": float(median), high: float(most)}
