"""Cost, truth and contents of datasets: makes dataset.json, dataset.md and dataset.svg.

    python tests/reports/dataset.py            about an hour on two cores; goes on after a stop
    python tests/reports/dataset.py --quick    minutes, into target/reports/quick
    python tests/reports/dataset.py --data F   what the finished datasets F hold, besides, and the
                                               truth of grasps of the first, not of the sample

Time and disk by mesh and number of threads; how far the truth of real grasps is from a finer mesh;
what kills change; share and reasons of unsolved grasps, worst imbalance and distributions of every
dataset given.
"""

from __future__ import annotations

import json
import multiprocessing
import os
from pathlib import Path

os.environ["RAYON_NUM_THREADS"] = "1"

from dataset_cases import Again, contents, cost, disturbed, errors
from dataset_pages import accuracy, markdown
from dataset_plots import figure
from kept import HERE, KEPT, Rows, arguments, folder, header

from ruffini import PressError, dataset

PARTS = ("contact", "dataset", "deformation", "fem", "geometry", "objects")
MADE_OF = [f"env-core/src/{part}" for part in PARTS]
MADE_OF += ["env-core/assets", "tests/reports/dataset_cases.py"]
"""What the figures come from, under the root."""
SAMPLE = HERE.parent / "reference/grasps"
"""Whose grasps are judged where no dataset is given."""
JOBS = 2
SIZES = {
    "full": {
        "cost": {"objects": 4, "grasps": 1, "frames": 5, "force": [2.0, 80.0]},
        "runs": [[900, 400, 2], *([2000, 1000, n] for n in (1, 2))],
        "kills": 20,
        "judged": 6,
        "every": 5,
        "rungs": [["p1-bar", 1000], ["p1-bar", 2000], ["p2", 1000]],
        "finest": ["p2", 2500],
    },
    "quick": {
        "cost": {"objects": 2, "grasps": 1, "frames": 2},
        "runs": [[500, 300, 1], [500, 300, 2]],
        "kills": 2,
        "judged": 2,
        "every": 1,
        "rungs": [["p1-bar", 500]],
        "finest": ["p1-bar", 900],
    },
}


def costs(rows: Rows, sizes: dict) -> None:
    """Adds what a dataset costs by nodes of the truth, of the model, and threads."""
    for truth, model, threads in sizes["runs"]:
        key = f"cost {truth}/{model} on {threads}"
        if key not in rows:
            found = cost(truth, model, "p1-bar", threads, sizes["cost"])
            rows.add({"key": key, "truth": truth, "model": model, "threads": threads} | found)
            print(key, flush=True)


def kills(rows: Rows, sizes: dict) -> None:
    """Adds what kills and a second run change."""
    if "kills" not in rows:
        rows.add({"key": "kills"} | disturbed(sizes["kills"]))
        print("kills", flush=True)


def truths(rows: Rows, sizes: dict, kept: Path) -> None:
    """Adds how far some grasps of a dataset on each mesh are from the same on the finest."""
    data = dataset.open(kept)
    work = []
    apart = max(len(data.grasps) // sizes["judged"], 1)
    for name in data.grasps[::apart][: sizes["judged"]]:
        if missing := [rung for rung in sizes["rungs"] if rung_key(name, *rung) not in rows]:
            work.append((kept, name, sizes["every"], missing, sizes["finest"]))
    with multiprocessing.get_context("spawn").Pool(JOBS) as pool:
        for found in pool.imap_unordered(judged, work):
            for row in found:
                rows.add(row)
                print(row["key"], flush=True)


def judged(work: tuple[Path, str, int, list[tuple[str, int]], tuple[str, int]]) -> list[dict]:
    """Rows of a grasp on some meshes."""
    folder, name, every, rungs, finest = work
    again = Again(dataset.open(folder), name, every)
    try:
        truth, price = again.solved(*finest)
    except PressError as error:
        failed = {"failed": f"on the finest mesh: {error}"}
        return [failed | about(again, *rung) for rung in rungs]
    rows = []
    for rung in rungs:
        row = about(again, *rung) | {"finest": price}
        try:
            fields, own = again.solved(*rung)
            row |= own | {"errors": errors(fields, truth, again.common)}
        except PressError as error:
            row |= {"failed": str(error)}
        rows.append(row)
    return rows


def about(again: Again, element: str, nodes: int) -> dict:
    """What a row of the truth is of."""
    found = {"key": rung_key(again.name, element, nodes), "grasp": again.name, "element": element}
    return found | {"nodes": nodes, "depths": again.depths}


def rung_key(grasp: str, element: str, nodes: int) -> str:
    """What a row of the truth is known by."""
    return f"truth {grasp} {element} {nodes}"


def main() -> None:
    """Runs what is missing and writes the files."""
    parser = arguments(__doc__)
    parser.add_argument("--data", type=Path, nargs="*", default=[], help="finished datasets")
    options = parser.parse_args()
    out, form = folder(parser, options), "quick" if options.quick else "full"
    head = header(MADE_OF, SIZES[form])
    rows = Rows(KEPT / f"dataset-{form}.jsonl", head)
    truths(rows, SIZES[form], options.data[0] if options.data else SAMPLE)
    kills(rows, SIZES[form])
    costs(rows, SIZES[form])
    held = {path.resolve().name: contents(dataset.open(path)) for path in options.data}
    found = {"rows": list(rows), "truth": accuracy(list(rows)), "datasets": held}
    report = head | {"note": options.note} | found
    (out / "dataset.json").write_text(json.dumps(report, indent=1) + "\n")
    (out / "dataset.md").write_text(markdown(report))
    figure(report, out / "dataset.svg")
    for path in options.data:
        dataset.open(path).plot(out / f"dataset-{path.resolve().name}.png")


if __name__ == "__main__":
    main()
