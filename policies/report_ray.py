"""Reports made by the machines of a Ray cluster, one to a task.

All of them need the package and a clone of the repository under the same path. What a report has
finished is kept there, in target/reports. Use::

    pip install "ruffini[data,ray]"
    python policies/report_ray.py reports paths load sensors
    python policies/report_ray.py reports paths load sensors --address auto  # a cluster that runs
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def make(root: str, name: str, options: list[str]) -> tuple[str, dict[str, bytes]]:
    """Makes a report in the clone at `root`; returns its name and its files.

    Raises:
        RuntimeError: If the report fails.
    """
    with tempfile.TemporaryDirectory() as out:
        line = [sys.executable, "py/reports", name, *options, "--out", out]
        done = subprocess.run(line, cwd=root, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"report {name}: {done.stderr.strip()}")
        return name, {file.name: file.read_bytes() for file in Path(out).iterdir()}


def main() -> None:
    """Reads the command line, makes the reports and writes their files."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, help="where the files are written")
    parser.add_argument("names", nargs="+", help="as of python py/reports --help")
    parser.add_argument("--quick", action="store_true", help="a small form of each")
    parser.add_argument("--pages", action="store_true", help="only the pages, from the JSON")
    parser.add_argument("--address", help="of a running cluster; one of this machine if not given")
    parser.add_argument("--cpus", type=int, help="cores of each report; 1 if not given", default=1)
    options = parser.parse_args()
    import ray

    options.folder.mkdir(parents=True, exist_ok=True)
    ray.init(address=options.address, include_dashboard=False)
    remote = ray.remote(num_cpus=options.cpus)(make)
    flags = [f"--{flag}" for flag in ("quick", "pages") if getattr(options, flag)]
    left = [remote.remote(str(ROOT), name, flags) for name in options.names]
    while left:
        done, left = ray.wait(left)
        name, files = ray.get(done)[0]
        for file, content in files.items():
            (options.folder / file).write_bytes(content)
        print(f"{name}: {', '.join(sorted(files))}", flush=True)


if __name__ == "__main__":
    main()
