"""The paper's Baseline, A and B beside the corrector: makes paper.json, paper.md and paper.svg.

    python tests/reports/paper.py                           the pages, from paper.json
    python tests/reports/paper.py --data SET --runs FOLDER  trains first what FOLDER lacks

A run is a process of its own on one thread, `cargo run --release --example paper`, for ten minutes
of processor time; what is done is kept in FOLDER. SET is what
`ruffini dataset generate SET --grasps 10 --frames 10` makes.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from paper_pages import markdown
from paper_plots import figure

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
BUDGET = 600.0
"""Of a run (s of processor time)."""


@dataclass(frozen=True)
class Run:
    """What is trained, from which seed, on which split of the data, for how long."""

    what: dict[str, Any]
    seed: int = 0
    split: str = "novel-14"
    seconds: float = BUDGET


def network(variant: str, told: str = "translation") -> dict[str, Any]:
    """One of the paper's networks at the size that is compared."""
    sizes = {"variant": variant, "input": told, "width": 16, "rounds": 4}
    return {"paper": {"network": sizes, "density": "coarse"}}


VARIANTS = ("baseline", "a", "b")
SEEDS = range(3)
RUNS = (
    {f"{name}-{seed}": Run(network(name), seed) for seed in SEEDS for name in VARIANTS}
    | {"b-force-0": Run(network("b", "force")), "corrector-0": Run({"corrector": {}})}
    | {"b-one": Run(network("b"), 0, "known-1", BUDGET / 2)}
    | {"corrector-one": Run({"corrector": {}}, 0, "known-1", BUDGET / 2)}
)


def train(data: Path, out: Path, run: Run) -> None:
    """Trains and judges one network into the folder `out`."""
    study = {"seconds": run.seconds, "seed": run.seed, "split": run.split}
    study["batch"] = 16 if "corrector" in run.what else 1
    example = ["cargo", "run", "--quiet", "--release", "--example", "paper", "--"]
    arguments = [str(data.resolve()), str(out.resolve()), json.dumps(run.what), json.dumps(study)]
    # Without these every large array is mapped and unmapped: a quarter of the time.
    calm = {"MALLOC_MMAP_THRESHOLD_": str(1 << 25), "MALLOC_TRIM_THRESHOLD_": str(1 << 33)}
    environment = os.environ | calm | {"RAYON_NUM_THREADS": "1"}
    subprocess.run([*example, *arguments], cwd=ROOT, env=environment, check=True)
    print(f"{out.name} is trained", flush=True)


def train_missing(data: Path, runs: Path, jobs: int) -> None:
    """Trains what the folder `runs` lacks, so many at a time."""
    missing = [name for name in RUNS if not (runs / name / "report.json").exists()]
    with ThreadPoolExecutor(jobs) as pool:
        # A list, so that what fails is raised.
        list(pool.map(lambda name: train(data, runs / name, RUNS[name]), missing))


def gathered(runs: Path) -> dict[str, Any]:
    """The report of what is in the folder `runs`."""
    found = {name: runs / name / "report.json" for name in RUNS}
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    cpu = next((s.split(": ")[1] for s in lines if s.startswith("model name")), "unknown")
    return {
        "commit": trained_by(runs),
        "machine": {"cpu": cpu, "cores": os.cpu_count(), "system": platform.platform()},
        "runs": {name: json.loads(f.read_text()) for name, f in found.items() if f.exists()},
    }


def trained_by(runs: Path) -> str:
    """The commits that trained, as the weights' cards say."""
    cards = [path.read_bytes() for path in runs.glob("*/weights.safetensors")]
    headers = [json.loads(b[8 : 8 + int.from_bytes(b[:8], "little")]) for b in cards]
    commits = {json.loads(h["__metadata__"]["card"])["data"]["trained_by"] for h in headers}
    return ", ".join(sorted(commits))


def main() -> None:
    """Trains what is missing, if asked to, and writes the pages."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="a dataset to train on")
    parser.add_argument("--runs", type=Path, help="folder of the runs")
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time; 1 if not given")
    options = parser.parse_args()
    if options.data and not options.runs:
        parser.error("--data needs --runs, the folder to train into")
    file = HERE / "paper.json"
    if options.data:
        train_missing(options.data, options.runs, options.jobs)
    if options.runs:
        file.write_text(json.dumps(gathered(options.runs), indent=1) + "\n")
    report = json.loads(file.read_text())
    (HERE / "paper.md").write_text(markdown(report))
    figure(report, HERE / "paper.svg")


if __name__ == "__main__":
    main()
