"""`ruffini recommend` against the figures that it reads."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib import resources

import pytest

PANELS = json.loads((resources.files("ruffini") / "answerers.json").read_text())["panels"]


def recommend(*words: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "ruffini", "recommend", *words]
    return subprocess.run(line, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("panel", PANELS)
@pytest.mark.parametrize("error", [0.03, 0.1, 0.5])
def test_nothing_faster_is_as_accurate(panel, error):
    rows = PANELS[panel]
    within = [
        (row["ms"], name)
        for name, row in rows.items()
        if row["errors"].get("force", {"median": 1e9})["median"] <= error
    ]
    done = recommend("--error", f"{100 * error:g}%", "--panel", panel)
    if within:
        assert done.stdout.startswith(f"{min(within)[1]}: "), done.stdout + done.stderr
    else:
        assert done.returncode == 2
        assert "expected at least" in done.stderr


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--error", "often"], "error: found often, expected a share such as 3% or 0.03"),
        (["--error", "-1"], "expected a share above 0"),
        (["--error", "6"], "found 6, expected a share above 0, such as 3% or 0.03"),
        (["--error", "3%", "--of", "colour"], "of: found colour, expected one of displacement"),
        (["--error", "3%", "--panel", "odd"], "panel: found odd, expected one of"),
    ],
)
def test_what_makes_no_sense_is_refused(words, text):
    done = recommend(*words)
    assert (done.returncode, text in done.stderr) == (2, True), done.stderr
