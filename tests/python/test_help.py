"""`--help` of every script says how it is used, does nothing else, and needs no extra package."""

from __future__ import annotations

import argparse
import http.server
import os
import re
import runpy
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from ruffini import commands

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("policies", "py/docs", "py/reports", "tests/reference")
SCRIPTS = [
    str(file.relative_to(ROOT))
    for folder in FOLDERS
    for file in sorted((ROOT / folder).glob("*.py"))
    if re.search(r"^if __name__ == ", file.read_text(), re.MULTILINE)
]
OPTIONAL = ("pypardiso", "ray", "skfem", "tensordict", "torchrl")
"""Packages that are not in the extra `dev`."""


def changed() -> bytes | None:
    """Tracked files that differ from the last commit and untracked ones; none without git."""
    line = ["git", "--no-optional-locks", "status", "--porcelain"]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, check=False)
    return done.stdout if done.returncode == 0 else None


def test_every_folder_has_scripts():
    assert {str(Path(script).parent) for script in SCRIPTS} == {*FOLDERS}
    assert len(SCRIPTS) > 12


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("script", SCRIPTS)
def test_help_never_does_work(script, tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib")
    pytest.importorskip("stable_baselines3")
    for name in OPTIONAL:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.syspath_prepend(ROOT / Path(script).parent)
    monkeypatch.setattr(sys, "argv", [script, "--help"])
    monkeypatch.chdir(tmp_path)
    before = changed()
    try:
        runpy.run_path(str(ROOT / script), run_name="__main__")
    except SystemExit as stop:
        assert stop.code in (None, 0), stop.code
    assert capsys.readouterr().out.startswith("usage: ")
    assert (changed(), os.listdir(tmp_path)) == (before, [])


def subcommands(parser: argparse.ArgumentParser) -> Iterator[list[str]]:
    """Words that lead to each parser, this one's first."""
    yield []
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, sub in action.choices.items():
                yield from ([name, *words] for words in subcommands(sub))


@pytest.mark.parametrize("words", [*subcommands(commands.parser())], ids=" ".join)
def test_every_subcommand_has_help(words, capsys):
    with pytest.raises(SystemExit) as stop:
        commands.main([*words, "--help"])
    assert stop.value.code == 0
    assert capsys.readouterr().out.startswith(" ".join(["usage: ruffini", *words]))


def test_links_of_no_site_are_a_failure(tmp_path, monkeypatch, capsys):
    script = str(ROOT / "py/docs/links.py")
    for folder, found in ((tmp_path / "none", "no folder"), (tmp_path, "no .html file")):
        monkeypatch.setattr(sys, "argv", [script, str(folder)])
        with pytest.raises(SystemExit) as stop:
            runpy.run_path(script, run_name="__main__")
        assert stop.value.code == 2
        said = capsys.readouterr().err.splitlines()[-1]
        assert said.endswith(f"{folder}: found {found}, expected a built site")


class Site(http.server.BaseHTTPRequestHandler):
    """Answers each path, a status, with it."""

    def do_GET(self):
        self.send_response(int(self.path.strip("/")))
        self.end_headers()

    def log_message(self, *_):
        pass


def test_links_that_another_site_does_not_have_are_named(tmp_path):
    links = runpy.run_path(str(ROOT / "py/docs/links.py"))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Site) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        host = f"http://127.0.0.1:{server.server_port}"
        page = "".join(f'<a href="{host}/{status}">' for status in (200, 403, 404))
        (tmp_path / "index.html").write_text(page + '<a href="other.html">')
        asked = {link for link in links["external"](tmp_path) if link.startswith(host)}
        found = links["dead"](asked)
        server.shutdown()
    assert asked == {f"{host}/{status}" for status in (200, 403, 404)}
    assert found == [f"{host}/404: HTTP Error 404: Not Found"]
    [silent] = links["dead"]([f"{host}/200"])
    assert silent.startswith(f"{host}/200: <urlopen error"), silent


@pytest.mark.parametrize(
    "line",
    [
        "policies/study.py --pages",
        "py/docs/channels.py",
        "py/reports/scenes.py tasks",
        "tests/reference/peer.py --speed",
        "tests/reference/samples.py",
    ],
)
def test_what_writes_committed_files_is_told_where(line, monkeypatch, capsys):
    pytest.importorskip("matplotlib")
    pytest.importorskip("stable_baselines3")
    script, *words = line.split()
    monkeypatch.syspath_prepend(ROOT / Path(script).parent)
    monkeypatch.setattr(sys, "argv", [script, *words])
    with pytest.raises(SystemExit) as stop:
        runpy.run_path(str(ROOT / script), run_name="__main__")
    assert stop.value.code == 2
    assert "the following arguments are required: --out" in capsys.readouterr().err
