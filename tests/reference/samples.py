"""Makes the samples of datasets beside this file anew, each of its .toml: python samples.py"""

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
    argparse.ArgumentParser(description=__doc__).parse_args()
    last = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.check_output(last, cwd=HERE, text=True).strip()
    for name in SAMPLES:
        shutil.rmtree(HERE / name, ignore_errors=True)
        made = dataset.generate(HERE / name, HERE / f"{name}.toml", threads=2, commit=commit)
        assert made is not None, "nobody stops it"
        print(f"{name}: {len(made)} frames, {len(made.manifest['unsolved'])} grasps unsolved")


if __name__ == "__main__":
    main()
