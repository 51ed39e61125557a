"""How far `ruffini.Fem` is from the truth, and what it costs: makes fem.json, fem.md and fem.svg.

    python tests/reports/fem.py            about 10 minutes; goes on where it was interrupted
    python tests/reports/fem.py --quick    a small subset within a minute, into a folder of its own

Every case runs in a process of its own, on one thread, and is kept in fem.json when it is done.
Cases of other code (by its last commit), machines, versions or sizes are dropped.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import platform
import subprocess
import tempfile
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
from fem_cases import MINI, SCENE, accuracy, closed_forms, mini, refinement, speed
from fem_pages import markdown
from fem_plots import figure

import ruffini

HERE = Path(__file__).resolve().parent
MADE_OF = ["env-core", "py", "tests/reports/fem_cases.py", "tests/reports/flat-pad.toml"]
"""What the figures come from, under the root."""
JOBS = 2
"""Cases at once, but for those of speed."""

FULL = {
    "poisson": [0.3, 0.45, 0.48, 0.49, 0.499],
    "common": 700,
    "meshes": {
        "p1": [500, 1000, 3000],
        "p1-bar": [500, 1000, 2000, 3000, 5000, 10000],
        "p2": [500, 1000, 2000],
    },
    "mini": [["p1-bar", 3000], ["p2", 1500]],
    "speed": [1000, 3000, 10000],
    "refinement": [[2, 2, 1], [3, 3, 2], [5, 5, 3]],
}
QUICK = {
    "poisson": [0.48],
    "common": 250,
    "meshes": {"p1": [500], "p1-bar": [500, 1000], "p2": []},
    "mini": [["p1-bar", 1000]],
    "speed": [1000],
    "refinement": [[2, 2, 1]],
}


def cases(sizes: dict) -> dict:
    """What there is to run: a function and its arguments by name."""
    named = {}
    for nodes in sizes["speed"]:
        for friction in (0.0, 0.5):
            named[f"speed {nodes} nodes, friction {friction}"] = (speed, nodes, friction)
    for calibration in [c["name"] for c in MINI["calibration"]]:
        for friction in (MINI["friction"]["dynamic"], MINI["friction"]["static"]):
            for element, nodes in sizes["mini"]:
                name = f"mini {calibration}, friction {friction}, {element} {nodes}"
                named[name] = (mini, calibration, friction, element, nodes)
    for parts in sizes["refinement"]:
        named[f"refinement {parts}"] = (refinement, tuple(parts))
    for poisson in sizes["poisson"]:
        named[f"accuracy {poisson}"] = (accuracy, poisson)
    return named


def header(sizes: dict) -> dict:
    """What the figures depend on."""
    last = ["git", "log", "-1", "--format=%h", "--", *MADE_OF]
    cpu = [s for s in Path("/proc/cpuinfo").read_text().splitlines() if s.startswith("model name")]
    return {
        "commit": subprocess.check_output(last, cwd=HERE.parents[1], text=True).strip(),
        "machine": {
            "cpu": cpu[0].split(": ")[1] if cpu else platform.processor(),
            "cores": os.cpu_count(),
            "system": platform.platform(),
        },
        "versions": {"ruffini": ruffini.__version__, "numpy": np.__version__}
        | {"python": platform.python_version(), "matplotlib": version("matplotlib")},
        "sizes": sizes,
    }


def run(out: Path, sizes: dict) -> dict:
    """The report in `out` with every case in it."""
    file, known = out / "fem.json", header(sizes)
    kept = json.loads(file.read_text()) if file.exists() else {}
    same = all(kept.get(key) == value for key, value in known.items())
    forms = {gel["name"]: closed_forms(gel["young"], gel["poisson"]) for gel in MINI["calibration"]}
    report = known | {"scene": SCENE, "closed_forms": forms, "cases": kept["cases"] if same else {}}
    missing = {name: case for name, case in cases(sizes).items() if name not in report["cases"]}
    alone = [(name, sizes, *case) for name, case in missing.items() if case[0] is speed]
    beside = [(name, sizes, *case) for name, case in missing.items() if case[0] is not speed]
    spawn = multiprocessing.get_context("spawn")
    for workers, work in [(1, alone), (JOBS, beside)]:
        # A process for each case: its peak memory is that of the case.
        with spawn.Pool(workers, maxtasksperchild=1) as pool:
            for name, found in pool.imap_unordered(called, work):
                report["cases"][name] = found
                file.write_text(json.dumps(report, indent=1) + "\n")
                print(f"{name}: {found['took']:.0f} s", flush=True)
    return report


def called(case: tuple) -> tuple[str, dict]:
    """A case's name and figures, with the machine's load when it began."""
    name, sizes, function, *arguments = case
    load, begun = os.getloadavg()[0], time.perf_counter()
    found = function(sizes, *arguments)
    return name, found | {"load": load, "took": time.perf_counter() - begun}


def main() -> None:
    """Runs what is missing and writes the pages."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a subset within a minute")
    parser.add_argument("--out", type=Path, help="folder of the files")
    options = parser.parse_args()
    usual = Path(tempfile.gettempdir()) / "ruffini-fem-quick" if options.quick else HERE
    out = (options.out or usual).resolve()
    if options.quick and out == HERE:
        parser.error(f"--out is {out}: a quick run must not replace the committed files")
    out.mkdir(parents=True, exist_ok=True)
    os.environ["RAYON_NUM_THREADS"] = "1"
    report = run(out, QUICK if options.quick else FULL)
    (out / "fem.md").write_text(markdown(report))
    figure(report, out / "fem.svg")


if __name__ == "__main__":
    main()
