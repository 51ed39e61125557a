"""Training, datasets and reports on Ray, on this machine and a cluster of two nodes that are it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from tiny_dataset import TINY

from ruffini import dataset

pytest.importorskip("ray")

POLICIES = Path(__file__).parents[2] / "policies"


@pytest.fixture(scope="module")
def address():
    """Address of a cluster of two nodes of one core each."""
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch:
        # Ray's workers yield to all else, and on a busy machine they wait for minutes.
        patch.setenv("RAY_worker_niceness", "0")
        cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
        try:
            cluster.add_node(num_cpus=1)
            cluster.wait_for_nodes()
            yield cluster.address
        finally:
            cluster.shutdown()


def printed(script: str, *options: str | Path) -> str:
    """Output of a script."""
    line = [sys.executable, POLICIES / script, *options]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_rllib_trains_with_a_runner_on_each_node(address, tmp_path):
    pytest.importorskip("ray.rllib")
    sizes = ["--runners", "2", "--n-envs", "8", "--steps", "1536", "--episodes", "4"]
    found = printed("train_rllib.py", "--address", address, *sizes, "--out", tmp_path / "run")
    assert "2 runners on 2 machines" in found
    # 32 steps of 8 environments of both runners in each.
    assert found.count(" steps ") == 3, found
    assert "success without noise" in found
    assert any((tmp_path / "run").iterdir())


def same_bytes(folder: Path, *options: str) -> None:
    """Makes a dataset with Ray, and with threads; all of their files are equal."""
    pytest.importorskip("safetensors")
    config, alone, made = (folder / name for name in ("tiny.toml", "alone", "made"))
    gel = "\n".join(f"{name} = {value!r}" for name, value in TINY["gels"][0].items())
    numbers = "\n".join(f"{name} = {value}" for name, value in TINY.items() if name != "gels")
    config.write_text(f"{numbers}\n[[gels]]\n{gel}\n")
    found = printed("generate_ray.py", made, "--config", config, *options)
    assert "2/2 shards" in found and "4 frames" in found
    dataset.generate(alone, config, threads=2)
    names = sorted(str(path.relative_to(alone)) for path in alone.rglob("*.*"))
    assert names == sorted(str(path.relative_to(made)) for path in made.rglob("*.*"))
    for name in names:
        assert (made / name).read_bytes() == (alone / name).read_bytes(), name


def test_reports_are_tasks(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setenv("RAY_worker_niceness", "0")
    assert "load: load.md, load.svg\n" in printed("report_ray.py", tmp_path, "load", "--pages")
    kept = POLICIES.parent / "tests/reports/load.md"
    assert (tmp_path / "load.md").read_bytes() == kept.read_bytes()


def test_a_cluster_makes_the_bytes_of_one_process(tmp_path):
    same_bytes(tmp_path, "--cpus", "2")


@pytest.mark.slow
def test_two_nodes_make_the_bytes_of_one_process(address, tmp_path):
    same_bytes(tmp_path, "--address", address)
