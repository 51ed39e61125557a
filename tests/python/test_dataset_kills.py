"""Killed at any moment, a generation goes on, and ends with the bytes of an undisturbed one."""

from __future__ import annotations

import random
import shutil
import subprocess
import sys
import time

import pytest
import tiny_dataset

pytest.importorskip("safetensors")

MAKE = [sys.executable, tiny_dataset.__file__]


def killed_and_resumed(folder, kills, whole, random):
    """Makes a tiny dataset over runs of which `kills` are killed at work, and lets the last end.

    `whole` is what it takes undisturbed (s).
    """

    def parts():
        return set(folder.rglob("*.safetensors"))

    met = 0
    for _ in range(20 * kills):
        if met == kills:
            break
        before = parts()
        line = [*MAKE, str(folder)]
        with subprocess.Popen(line, stderr=subprocess.DEVNULL) as run:
            try:
                run.wait(timeout=random.uniform(0, 0.7 * whole))
                shutil.rmtree(folder)  # It was done before the kill came: begin anew.
            except subprocess.TimeoutExpired:
                run.kill()
                met += parts() != before
    assert met == kills
    subprocess.run([*MAKE, str(folder)], check=True, timeout=600)


@pytest.mark.parametrize("kills", [2, pytest.param(20, marks=pytest.mark.slow)])
def test_kills_change_no_byte(tmp_path, kills):
    undisturbed, killed = tmp_path / "undisturbed", tmp_path / "killed"
    start = time.monotonic()
    subprocess.run([*MAKE, str(undisturbed)], check=True)
    whole = time.monotonic() - start
    killed_and_resumed(killed, kills, whole, random.Random(kills))
    names = sorted(str(path.relative_to(killed)) for path in killed.rglob("*.*"))
    assert names == sorted(str(path.relative_to(undisturbed)) for path in undisturbed.rglob("*.*"))
    for name in names:
        assert (killed / name).read_bytes() == (undisturbed / name).read_bytes(), name
