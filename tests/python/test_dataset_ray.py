"""The Ray job makes the bytes that one process makes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from tiny_dataset import TINY

from ruffini import dataset

pytest.importorskip("safetensors")
pytest.importorskip("ray")

JOB = Path(__file__).parents[2] / "policies" / "generate_ray.py"


def test_a_cluster_makes_the_same_bytes(tmp_path):
    config, alone, made = (tmp_path / name for name in ("tiny.toml", "alone", "made"))
    gel = "\n".join(f"{name} = {value!r}" for name, value in TINY["gels"][0].items())
    numbers = "\n".join(f"{name} = {value}" for name, value in TINY.items() if name != "gels")
    config.write_text(f"{numbers}\n[[gels]]\n{gel}\n")
    line = [sys.executable, str(JOB), str(made), "--config", str(config), "--cpus", "2"]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "2/2 shards" in done.stdout and "4 frames" in done.stdout
    dataset.generate(alone, config, threads=2)
    names = sorted(str(path.relative_to(alone)) for path in alone.rglob("*.*"))
    assert names == sorted(str(path.relative_to(made)) for path in made.rglob("*.*"))
    for name in names:
        assert (made / name).read_bytes() == (alone / name).read_bytes(), name
