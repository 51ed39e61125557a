"""The paper's Baseline, A and B beside the corrector, ten minutes of processor time each.

With --data SET --runs FOLDER those are trained first that FOLDER lacks, each by a process of its
own on one thread, `cargo run --release --example paper`. SET is what `ruffini dataset generate SET
--grasps 10 --frames 10` makes. Without these only the page is made.
"""

from __future__ import annotations

import json
import os
import subprocess
from argparse import ArgumentParser, Namespace
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from engine import OUT, ROOT, filled, machine, plt, readable, spread, table, text

BUDGET = 600.0
"""Of a run (s of processor time)."""


@dataclass(frozen=True)
class Run:
    """Training run: network, seed, split of the data, time."""

    what: dict[str, Any]
    seed: int = 0
    split: str = "novel-14"
    seconds: float = BUDGET


def network(variant: str, told: str = "translation") -> dict[str, Any]:
    """One of the paper's networks at the size that is compared."""
    sizes = {"variant": variant, "input": told, "width": 16, "rounds": 4}
    return {"paper": {"network": sizes, "density": "coarse"}}


NAMES = {"baseline": "Baseline", "a": "A", "b": "B"}
RUNS = (
    {f"{name}-{seed}": Run(network(name), seed) for seed in range(3) for name in NAMES}
    | {"b-force-0": Run(network("b", "force")), "corrector-0": Run({"corrector": {}})}
    | {"b-one": Run(network("b"), 0, "known-1", BUDGET / 2)}
    | {"corrector-one": Run({"corrector": {}}, 0, "known-1", BUDGET / 2)}
)


def options(parser: ArgumentParser) -> None:
    """Adds the options of training: data, folder."""
    parser.add_argument("--data", type=Path, help="a dataset to train on")
    parser.add_argument("--runs", type=Path, help="folder of the runs")
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time; 1 if not given")


def make(options: Namespace) -> dict[str, Any] | None:
    """Results in the folder of the runs; ``None`` without one."""
    data, runs = options.data, options.runs
    if not runs:
        if data:
            raise SystemExit("--data needs --runs, the folder to train into")
        return None
    reports = {name: runs / name / "report.json" for name in RUNS}
    if data:
        missing = [name for name, report in reports.items() if not report.exists()]
        with ThreadPoolExecutor(options.jobs) as pool:
            # A list, so that what fails is raised.
            list(pool.map(lambda name: train(data, runs / name, RUNS[name]), missing))
    return {
        "commit": trained_by(runs),
        "machine": machine(),
        "seconds a press": json.loads((OUT / "paper.json").read_text())["seconds a press"],
        "runs": {name: json.loads(f.read_text()) for name, f in reports.items() if f.exists()},
    }


def train(data: Path, out: Path, run: Run) -> None:
    """Trains and judges one network into the folder `out`."""
    training = {"seconds": run.seconds, "seed": run.seed, "split": run.split}
    training["batch"] = 16 if "corrector" in run.what else 1
    example = ["cargo", "run", "--quiet", "--release", "--example", "paper", "--"]
    folders = [str(data.resolve()), str(out.resolve())]
    arguments = [*folders, json.dumps(run.what), json.dumps(training)]
    # Without these every large array is mapped and unmapped: a quarter of the time.
    calm = {"MALLOC_MMAP_THRESHOLD_": str(1 << 25), "MALLOC_TRIM_THRESHOLD_": str(1 << 33)}
    environment = os.environ | calm | {"RAYON_NUM_THREADS": "1"}
    subprocess.run([*example, *arguments], cwd=ROOT, env=environment, check=True)
    print(f"{out.name} is trained", flush=True)


def trained_by(runs: Path) -> str:
    """Commits of the training code, from the weights' cards."""
    cards = [path.read_bytes() for path in runs.glob("*/weights.safetensors")]
    headers = [json.loads(b[8 : 8 + int.from_bytes(b[:8], "little")]) for b in cards]
    commits = {json.loads(h["__metadata__"]["card"])["data"]["trained_by"] for h in headers}
    return ", ".join(sorted(commits))


ALL, ONE = "novel-14", "known-1"
"""Splits: all objects but those of some families, and one object."""
PARTS = {"known": "known objects' unseen grasps", "novel": "novel objects"}
PAGE = """# The paper's networks at equal budgets

Graph networks *Baseline*, *A* and *B* of DefGraspNets (Huang et al. 2023) predict displacement u
and von Mises stress σ of a soft body in a grasp: the Baseline on nodes and edges, A on tetrahedra,
too, B besides with a feature of the whole body. They were trained here on grasps by two gel pads,
for ten CPU minutes each, beside a network that corrects a linear solution (*corrector*, an earlier
network of pads) and that linear solution itself (contact at points of the mesh). The reference is
finite elements on an even mesh.

{conclusion}

![errors by training and by cost](paper.svg)

## The paper

The paper's own figures, on other data (63 objects x 100 grasps x 50 frames, not public) and at 128
channels and 15 rounds on a GPU. Mean absolute percentage error of u / σ: Baseline 3.28 / 1.85 %, A
3.57 / 2.28 %, **B 2.81 / 1.31 %**. Mean absolute error of u and σ told the translation: 63 known
objects 79 µm, 352 Pa; 14 novel ones 197 µm, 1,510 Pa; told the force, 250 to 290 µm on known and
32.5 mm, 78 kPa on novel objects. Neither the data, nor the budget, nor the measure is ours: only
the ranking can be compared. Ours are relative L² a frame, median / 95th percentile, and mean
absolute errors over all components.

## Unseen grasps of known objects

{known_all}

Of these, presses that move the gel by over a quarter of its thickness:

{known_deep}

## Objects that were never seen

{novel_all}

Of these, presses that move the gel by over a quarter of its thickness:

{novel_deep}

## Object meshes of half the spacing

Every third frame of novel objects; edges of 1.5 mm where 3 mm were trained on.

{dense}

## Learnt from one object

Trained on {one[counts][train][0]} grasps ({one[counts][train][1]} frames) of one object for
{minutes_one:.0f} minutes, judged on another of its grasps.

{single}

## Rigid motion of the gel, and of the object

Median / 95th percentile. A bonded gel hardly turns or moves as a whole.

{rigid}

## How it was made

Data: 63 objects x 10 grasps x 10 frames x 2 pads, p1-bar on 1,995 nodes, carried to 900. Trained on
{train}; judged on {known}, the last grasp of each of the 49 objects, and {novel} of 14 objects of
families left out. {minutes:.0f} minutes of processor time each where no other is said, on one
thread of a busy machine ({machine[cpu]}, {machine[cores]} cores), commit {commit}; `python
py/reports paper --data SET --runs FOLDER`. The last weights are judged; nothing is chosen by its
error. Time of a press is without the linear solution. The paper's networks see the object as nodes
of its surface, the corrector as distances. Ten minutes are little, and how many steps it holds
varies with what else the machine does.

{spent}"""


ERRORS: dict[str, Any] = {
    "model": "{name}",
    "presses": "{errors[presses]}",
    "u": spread("errors[displacement]", unit=" %"),
    "σ": spread("errors[stress]", unit=" %"),
    "σ at the peak": spread("errors[peak]", unit=" %"),
    "mean abs. u": "{errors[displacement_mae]:1e6*.2f} µm",
    "mean abs. σ": "{errors[stress_mae]:,.0f} Pa",
    "net force": lambda row: (
        filled(spread("errors[force]", unit=" %"), row) if "force" in row["errors"] else "not said"
    ),
    "CPU a press": lambda row: (
        "–" if row.get("seconds") is None else f"{1e3 * row['seconds']:.0f} ms"
    ),
}
SPENT = {
    "run": "{name}",
    "channels": "{network[width]:,}",
    "rounds": "{depth:,}",
    "numbers learnt": "{parameters:,}",
    "batch": "{training[batch]:,}",
    "steps": "{steps:,}",
    "CPU s": "{seconds[0]:,.0f}",
    "wall s": "{seconds[1]:,.0f}",
}
RIGID = {
    "model, objects": "{name}, {part}",
    "error (µm)": "{rigid[0][median]:1e6*.1f} / {rigid[0][p95]:1e6*.1f}",
    "true (µm)": "{rigid_truth[0][median]:1e6*.1f} / {rigid_truth[0][p95]:1e6*.1f}",
    "error (°)": "{rigid[1][median]:.3f} / {rigid[1][p95]:.3f}",
    "true (°)": "{rigid_truth[1][median]:.3f} / {rigid_truth[1][p95]:.3f}",
    "object's motion": spread("object", unit=" %"),
}


def page(report: dict[str, Any]) -> str:
    """Conclusion, tables and how they were made."""
    first, one = runs_on(report, ALL)[0], runs_on(report, ONE)[0]
    counts = {name: f"{n} grasps ({f} frames)" for name, (n, f) in first["counts"].items()}
    minutes = {"minutes": first["training"]["seconds"] / 60, "one": one}
    errors = {
        f"{part}_{which}": table(ERRORS, judged(report, part, which=which))
        for part in PARTS
        for which in ("all", "deep")
    }
    rigid = [
        {"name": title(run), "part": part} | run["errors"][part]["coarse"]
        for run in runs_on(report, ALL)
        for part in PARTS
        if run["errors"][part].get("coarse", {}).get("rigid")
    ]
    return text(
        PAGE,
        report | counts | minutes | {"minutes_one": one["training"]["seconds"] / 60},
        conclusion=conclusion(report),
        dense=table(ERRORS, judged(report, "novel", ("dense",))[:-1]),
        single=table(ERRORS, judged(report, "novel", split=ONE)),
        rigid=table(RIGID, in_order(rigid), absent="told"),
        spent=table(SPENT, map(spent, runs_on(report, ALL))),
        **errors,
    )


def runs_on(report: dict[str, Any], split: str) -> list[dict[str, Any]]:
    """The runs on a split of the data."""
    return [run for run in report["runs"].values() if run["training"]["split"] == split]


def title(run: dict[str, Any]) -> str:
    """A run's name in tables."""
    seed = f"seed {run['training']['seed']}"
    if "corrector" in run["run"]:
        return f"corrector, {seed}"
    network = run["run"]["paper"]["network"]
    told = " told the force" if network["input"] == "force" else ""
    return f"{NAMES[network['variant']]}{told}, {seed}"


def in_order(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Baseline, A, B, B by force, corrector."""
    firsts = ["Baseline", "A,", "B,", "B told", "corrector"]

    def place(row: dict[str, Any]) -> tuple:
        name = f"{row['name']}, {row.get('part', '')}"
        return next(i for i, first in enumerate(firsts) if name.startswith(first)), name

    return sorted(rows, key=place)


def judged(
    report: dict[str, Any],
    part: str,
    meshes: tuple[str, ...] = ("coarse", "corrector"),
    which: str = "all",
    split: str = ALL,
) -> list[dict[str, Any]]:
    """Names, errors and times on all presses or the deep ones, the linear solution last."""

    def row(name: str, found: dict[str, Any]) -> dict[str, Any]:
        return {"name": name, "errors": found[which], "seconds": found.get("seconds")}

    of = [(title(run), run["run"], run["errors"][part]) for run in runs_on(report, split)]
    rows = [row(name, errors[key]) for name, _, errors in of for key in meshes if key in errors]
    linear = [
        row("linear solution", errors["linear"]) for _, run, errors in of if "corrector" in run
    ]
    return in_order(rows) + linear[:1]


def conclusion(report: dict[str, Any]) -> str:
    """Compares the ranking of the networks with the paper's, and both with the linear solution."""
    lines = ["The paper's ranking is B < Baseline < A. Medians of the relative error, ours:", ""]
    for part, where in PARTS.items():
        seeds = defaultdict(list)
        for row in judged(report, part):
            medians = [row["errors"][field]["median"] for field in FIELDS]
            seeds[row["name"].split(", seed")[0]].append(medians)
        mean = {name: np.mean(of, axis=0) for name, of in seeds.items()}
        networks = [name for name in NAMES.values() if name in mean]
        for i, field in enumerate(("u", "σ")):
            ranking = sorted((mean[name][i], name) for name in networks)
            order = " < ".join(f"{name} {100 * error:.1f} %" for error, name in ranking)
            change = max(np.ptp([medians[i] for medians in of]) for of in seeds.values())
            clear = "more" if ranking[1][0] - ranking[0][0] > change else "less"
            step = f"the first step is {clear} than what another seed changes, {100 * change:.1f} %"
            lines.append(f"- {field}, {where}: {order}; {step}.")
        best = np.min([mean[name] for name in networks], axis=0)
        rivals = {name: mean[name] for name in ("linear solution", "corrector") if name in mean}
        lose = all((rival < best).all() for rival in rivals.values())
        verdict = "All three lose" if lose else "Not all three lose"
        beside = " and ".join(
            f"the {n} ({100 * u:.1f} / {100 * s:.1f} %)" for n, (u, s) in rivals.items()
        )
        own = f"the best of the three {100 * best[0]:.1f} % / {100 * best[1]:.1f} %"
        lines.append(f"- **{verdict}** to {beside}, u / σ on {where}; {own}.")
    return "\n".join(lines)


def spent(run: dict[str, Any]) -> dict[str, Any]:
    """A run with its name, its network's sizes and number of rounds."""
    network = run["run"]["paper"]["network"] if "paper" in run["run"] else run["run"]["corrector"]
    rounds = network.get("rounds") or sum(network["down"]) + sum(network["up"])
    return run | {"name": title(run), "network": network, "depth": rounds}


COLOURS = {"Baseline": "C0", "A": "C1", "B": "C2", "B told the force": "C4", "corrector": "C3"}
COLOURS["linear solution"] = "k"
FIELDS = {"displacement": "displacement u", "stress": "von Mises stress σ"}


def figure(report: dict[str, Any]):
    """Errors on novel objects against time trained, and against time a press."""
    picture, axes = plt.subplots(2, 2, figsize=(10, 7), sharey=True, layout="constrained")
    for (field, name), (left, right) in zip(FIELDS.items(), axes, strict=True):
        learning(report, field, left)
        cost(report, field, right)
        left.set_ylabel(f"median relative error of {name} (%)")
    for axis in axes.flat:
        readable(axis)
    axes[0][0].set_title("Novel objects: error by training, 40 frames")
    axes[0][1].set_title("Novel objects: error by cost, all frames (bars to 95th percentile)")
    return picture


def learning(report: dict[str, Any], field: str, axis: Any) -> None:
    """Error against CPU seconds of training; further seeds dashed."""
    place = list(FIELDS).index(field)
    for run in runs_on(report, ALL):
        name, seed = title(run).split(", seed ")
        x = [point["seconds"] for point in run["curve"]]
        y = [100 * point["errors"]["novel"][place]["median"] for point in run["curve"]]
        style, label = ("-", name) if seed == "0" else ("--", None)
        axis.loglog(x, y, style, color=COLOURS[name], label=label, marker=".")
    for row in judged(report, "novel"):
        if row["name"] == "linear solution":
            error = 100 * row["errors"][field]["median"]
            axis.axhline(error, color="k", linestyle=":", label="linear solution")
    axis.set_xlabel("CPU s of training, one thread")
    axis.legend(fontsize=7)


def cost(report: dict[str, Any], field: str, axis: Any) -> None:
    """Error against the time of a press, the linear solution's included where it is corrected."""
    typical = report["seconds a press"]
    for row in judged(report, "novel"):
        name = row["name"].split(", seed")[0]
        label = name if row["name"] in (name, f"{name}, seed 0") else None
        corrects = name in ("corrector", "linear solution")
        x = 1e3 * ((row["seconds"] or 0.0) + (typical["linear"] if corrects else 0.0))
        found = row["errors"][field]
        y = 100 * found["median"]
        up = [[0], [100 * found["p95"] - y]]
        axis.errorbar([x], [y], up, color=COLOURS[name], marker="o", capsize=2, label=label)
    truth = 1e3 * typical["truth"]
    axis.axvline(truth, color="grey", linestyle=":", label="finite elements (truth)")
    axis.set(xscale="log", yscale="log", xlabel="ms a press, one thread")
    axis.legend(fontsize=7)
