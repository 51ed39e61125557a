"""Time and disk of 1,000 frames of a dataset, by mesh size and number of threads, as a table.

python tests/reports/dataset.py --meshes 900/400 2000/1000 --threads 1 2 4

Wall time is that of the machine as loaded as it is; CPU time is less disturbed by others.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from ruffini import dataset

WHOLE = 63 * 100 * 50
"""Frames of the paper's dataset."""


def row(mesh: str, threads: int, counts: dict[str, int]) -> list[str]:
    """Wall and CPU seconds and megabytes of 1,000 frames, and what the whole would take."""
    truth, model = map(int, mesh.split("/"))
    with tempfile.TemporaryDirectory() as folder:
        wall, cpu = time.perf_counter(), time.process_time()
        data = dataset.generate(
            folder, threads=threads, truth_nodes=truth, model_nodes=model, **counts
        )
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        size = sum(path.stat().st_size for path in Path(folder).glob("shards/*"))
    share = 1000 / len(data)
    days, disk = WHOLE / len(data) * wall / 86400, WHOLE / len(data) * size / 1e9
    return [
        mesh,
        str(threads),
        str(len(data)),
        f"{share * wall:.0f}",
        f"{share * cpu:.0f}",
        f"{share * size / 1e6:.0f}",
        f"{days:.1f} d, {disk:.0f} GB",
    ]


def main() -> None:
    """Reads the command line and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--meshes", nargs="+", default=["900/400"], help="truth/model nodes")
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--scenario", default="pads", choices=("pads", "soft"))
    for name, count in {"objects": 4, "grasps": 1, "frames": 5}.items():
        parser.add_argument(f"--{name}", type=int, default=count)
    options = vars(parser.parse_args())
    meshes, threads = options.pop("meshes"), options.pop("threads")
    print("| truth/model nodes | threads | frames | wall s / 1,000 | CPU s | MB | 315,000 frames |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for mesh in meshes:
        for count in threads:
            print(f"| {' | '.join(row(mesh, count, options))} |", flush=True)


if __name__ == "__main__":
    main()
