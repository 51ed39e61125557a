"""Cost, truth and contents of datasets: makes dataset.json, dataset.md and dataset.svg.

    python tests/reports/dataset.py            about an hour on two cores; goes on after a stop
    python tests/reports/dataset.py --quick    minutes, into target/reports/quick
    python tests/reports/dataset.py --data F   what the finished datasets F hold, besides

Time and disk by mesh and number of threads; how far the truth of real grasps is from a finer mesh;
share and reasons of unsolved grasps, worst imbalance and distributions of every dataset given.
"""

from __future__ import annotations

import json
from pathlib import Path

from dataset_cases import Again, contents, cost, errors
from dataset_pages import markdown
from dataset_plots import figure
from kept import KEPT, Rows, arguments, folder, header

from ruffini import PressError, dataset

PARTS = ("contact", "dataset", "deformation", "fem", "geometry", "objects")
MADE_OF = [f"env-core/src/{part}" for part in PARTS]
MADE_OF += ["env-core/assets", "tests/reports/dataset_cases.py"]
"""What the figures come from, under the root."""
SIZES = {
    "full": {
        "cost": {"objects": 6, "grasps": 1, "frames": 5},
        "meshes": [[900, 400], [2000, 1000], [5000, 1000]],
        "threads": [1, 2, 4],
        "again": {"objects": 6, "grasps": 1, "frames": 3},
        "rungs": [["p1-bar", 900], ["p1-bar", 2000], ["p1-bar", 5000], ["p2", 900], ["p2", 2000]],
        "finest": ["p2", 3000],
    },
    "quick": {
        "cost": {"objects": 2, "grasps": 1, "frames": 2},
        "meshes": [[500, 300]],
        "threads": [1, 2],
        "again": {"objects": 2, "grasps": 1, "frames": 2},
        "rungs": [["p1-bar", 500]],
        "finest": ["p1-bar", 900],
    },
}


def costs(rows: Rows, sizes: dict) -> None:
    """Adds what datasets of each mesh cost on each number of threads."""
    for truth, model in sizes["meshes"]:
        for threads in sizes["threads"]:
            key = f"cost {truth}/{model} on {threads}"
            if key not in rows:
                found = cost(truth, model, "p1-bar", threads, sizes["cost"])
                about = {"key": key, "truth": truth, "model": model, "threads": threads}
                rows.add(about | found)
                print(key, flush=True)


def truths(rows: Rows, sizes: dict, kept: Path) -> None:
    """Adds how far each grasp on each mesh is from the same on the finest."""
    data = dataset.generate(kept, threads=2, **sizes["again"])
    assert data is not None, "nobody stops it"
    for name in data.grasps:
        again = Again(data, name)
        missing = [rung for rung in sizes["rungs"] if rung_key(name, *rung) not in rows]
        try:
            finest, price = again.solved(*sizes["finest"]) if missing else ([], {})
        except PressError as error:
            print(f"{name} is not solved on the finest mesh: {error}", flush=True)
            continue
        for element, nodes in missing:
            about = {"key": rung_key(name, element, nodes), "grasp": name, "element": element}
            about |= {"nodes": nodes, "depths": again.depths, "finest": price}
            try:
                fields, own = again.solved(element, nodes)
                about |= own | {"errors": errors(fields, finest, again.common)}
            except PressError as error:
                about |= {"failed": str(error)}
            rows.add(about)
            print(about["key"], flush=True)


def rung_key(grasp: str, element: str, nodes: int) -> str:
    """What a row of the truth is known by."""
    return f"truth {grasp} {element} {nodes}"


def main() -> None:
    """Runs what is missing and writes the files."""
    parser = arguments(__doc__)
    parser.add_argument("--data", type=Path, nargs="*", default=[], help="finished datasets")
    options = parser.parse_args()
    out, form = folder(parser, options), "quick" if options.quick else "full"
    about = header(MADE_OF, SIZES[form])
    rows = Rows(KEPT / f"dataset-{form}.jsonl", about)
    costs(rows, SIZES[form])
    truths(rows, SIZES[form], KEPT / f"dataset-{form}-{about['commit']}")
    held = {path.resolve().name: contents(dataset.open(path)) for path in options.data}
    report = about | {"note": options.note, "rows": list(rows), "datasets": held}
    (out / "dataset.json").write_text(json.dumps(report, indent=1) + "\n")
    (out / "dataset.md").write_text(markdown(report))
    figure(report, out / "dataset.svg")
    for path in options.data:
        dataset.open(path).plot(out / f"dataset-{path.resolve().name}.png")


if __name__ == "__main__":
    main()
