"""The hand-written stub matches the compiled module."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import ruffini
from ruffini._schema import SCHEMA


def test_the_stub_matches_the_module():
    pytest.importorskip("mypy")
    command = [sys.executable, "-m", "mypy.stubtest", "ruffini._core"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_it_names_the_kinds_of_error_that_rust_has():
    stub = ast.parse((Path(ruffini.__file__).parent / "_core.pyi").read_text())
    [error] = [node for node in stub.body if getattr(node, "name", "") == "PressError"]
    [kind] = [node for node in error.body if isinstance(node, ast.AnnAssign)]
    assert [name.value for name in kind.annotation.slice.elts] == SCHEMA["press_errors"]
