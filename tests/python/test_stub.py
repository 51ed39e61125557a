"""The hand-written stub says what the compiled module has."""

from __future__ import annotations

import subprocess
import sys

import pytest


def test_the_stub_matches_the_module():
    pytest.importorskip("mypy")
    command = [sys.executable, "-m", "mypy.stubtest", "ruffini._core"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
