"""Makes the samples of datasets anew, each of its .toml beside this file.

Use::

    python tests/reference/samples.py --out tests/reference
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
from pathlib import Path

from ruffini import dataset

HERE = Path(__file__).resolve().parent
SAMPLES = ("grasps", "squeezes")


def main() -> None:
    """Replaces the folders; the commit in their manifests is the last one."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--out", type=Path, required=True, help="where the folders lie")
    out = parser.parse_args().out
    last = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.check_output(last, cwd=HERE, text=True).strip()
    for name in SAMPLES:
        shutil.rmtree(out / name, ignore_errors=True)
        made = dataset.generate(out / name, HERE / f"{name}.toml", threads=2, commit=commit)
        assert made is not None, "nobody stops it"
        print(f"{name}: {len(made)} frames, {len(made.manifest['unsolved'])} grasps unsolved")


if __name__ == "__main__":
    main()
