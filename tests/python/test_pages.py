"""The code of README, the pages and docstrings runs as it is written, block after block of a page.

Python and commands of a page share a folder that looks like the repository's root, and Python its
names. What would take long is made short (`SHORTER`, and training stops at once), only parsed
(`PARSED`) or left out because something else runs it (`LEFT`); a command of none of these runs as
it stands, and one that is unknown fails.
"""

from __future__ import annotations

import ast
import importlib.util
import math
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import textwrap
from ast import literal_eval
from pathlib import Path
from typing import get_args, get_type_hints

import gymnasium as gym
import numpy as np
import pytest

import ruffini.commands
from ruffini import TACTILE_CHANNELS, TASKS
from ruffini._settings import Settings
from ruffini.commands import dataset, network

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "py/docs"
BLOCK = re.compile(r"^```(python|bash)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
OPTIONAL = re.compile(r"^(?:from|import) (ray|torchrl|minari)\b", re.MULTILINE)
"""Packages that are not in the extra `dev`: blocks that need them run where they are installed."""
SHORTER = {
    "ruffini play": "--episodes 1 --video-episodes 1",
    "ruffini calibrate": "--nodes 100",
    "ruffini dataset generate out": "--config tiny.toml --objects 1 --grasps 1 --frames 2",
    "ruffini agent train": "--steps 256 --n-envs 8",
    "ruffini agent evaluate": "--episodes 2",
    "ruffini agent export": "--episodes 2",
    "python policies/train_cleanrl.py": "--steps 512 --n-envs 8 --episodes 2",
}
"""Options that are added to a command."""
PARSED = {
    "ruffini dataset generate": (dataset, "_generate"),
    "ruffini dataset error": (dataset, "_error"),
    "ruffini network train": (network, "_train"),
    "ruffini network evaluate": (network, "_evaluate"),
}
"""Commands that take hours unless they are made shorter, and the functions that do the work; other
tests run them in small."""
LEFT = (
    *("python3 -m venv", ". .venv/bin/activate", "pip install", "cargo test", "pytest", ".ci/"),
    "python policies/quickstart.py",  # `.ci/run` runs it, and the next, in small.
    "python policies/rollout_speed.py",
    "python policies/train_rllib.py",  # `test_cluster.py` runs it on a cluster, and the next.
    "python policies/report_ray.py",
)
JOB = {"SLURM_ARRAY_TASK_ID": "3", "SLURM_CPUS_PER_TASK": "1"}
"""Variables that Slurm sets in a job of an array."""
TINY = "truth_nodes = 400\nmodel_nodes = 200\nforce = [1.0, 5.0]\n"
"""Configuration of a dataset that takes seconds."""
PAGES = [
    page
    for page in [
        *(ROOT / name for name in ("README.md", "py/README.md", ".github/CONTRIBUTING.md")),
        *sorted(DOCS.glob("*.md")),
    ]
    if BLOCK.search(page.read_text())
]

PACKAGE = ROOT / "py/python/ruffini"
EXAMPLE = re.compile(r"::\n\n((?:    .*\n?|\n)+)")
"""Code in a docstring, after two colons."""
EXAMPLES = [file for file in sorted(PACKAGE.rglob("*.py")) if "::\n\n" in file.read_text()]


def commands(block: str) -> list[str]:
    """Commands of a block, without comments and the folder of the virtual environment."""
    lines = [re.sub(r"(^|\s)#.*", "", line) for line in block.replace("\\\n", " ").splitlines()]
    parts = [part.strip() for line in lines for part in line.split("&&")]
    return [re.sub(r"^\.venv/bin/(?!activate)", "", part) for part in parts if part]


OF_README = {
    command
    for language, block in BLOCK.findall((ROOT / "README.md").read_text())
    if language == "bash"
    for command in commands(block)
}


def known(command: str, among) -> str | None:
    """The entry with which a command begins."""
    return next((prefix for prefix in among if command.startswith(prefix)), None)


def run(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs one command in this process, where models of the gel are made once."""
    if known(command, LEFT):
        return
    program, *arguments = shlex.split(os.path.expandvars(command))
    shorter, parsed = known(command, SHORTER), known(command, PARSED)
    arguments += shlex.split(SHORTER.get(shorter, ""))
    with monkeypatch.context() as patch:
        if parsed and not shorter:
            patch.setattr(*PARSED[parsed], lambda options: None)
        if program == "ruffini":
            assert ruffini.commands.main(arguments) == 0, command
        elif program == "python" and arguments[0].startswith("policies/"):
            patch.setattr(sys, "argv", arguments)
            runpy.run_path(arguments[0], run_name="__main__")
        else:
            raise AssertionError(f"nothing says how to test {command!r}")


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A folder with what a reader has in the repository's root; PPO that stops at once."""
    sb3 = pytest.importorskip("stable_baselines3")
    for name in ("env-core", "tests"):
        (tmp_path / name).symlink_to(ROOT / name)
    ignored = shutil.ignore_patterns("runs", "__pycache__")
    shutil.copytree(ROOT / "policies", tmp_path / "policies", ignore=ignored)
    learn = sb3.PPO.learn

    def stopped(model, steps, callback=None, **options):
        # What training leads to is tested elsewhere; scripts bring callbacks and few steps.
        return learn(model, steps, callback=callback or (lambda *_: False), **options)

    monkeypatch.setattr(sb3.PPO, "learn", stopped)
    (tmp_path / "tiny.toml").write_text(TINY)
    for name, value in JOB.items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(tmp_path)
    registered = dict(gym.registry)
    yield tmp_path
    gym.registry.clear()
    gym.registry.update(registered)


def play(text: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs the blocks of a page, but for the commands that README has, too."""
    names = {"__name__": name}
    for language, block in BLOCK.findall(text):
        if language == "bash":
            for command in commands(block):
                if name == "README" or command not in OF_README:
                    run(command, monkeypatch)
        elif all(importlib.util.find_spec(module) for module in OPTIONAL.findall(block)):
            exec(compile(block, name, "exec"), names)


def test_every_rule_about_commands_is_of_one_that_a_page_has():
    blocks = [block for page in PAGES for _, block in BLOCK.findall(page.read_text())]
    there = [command for block in blocks for command in commands(block)]
    for prefix in (*SHORTER, *PARSED, *LEFT):
        assert any(command.startswith(prefix) for command in there), prefix


def test_every_channel_of_touch_has_its_size_and_its_picture_on_its_page():
    text = (DOCS / "touch.md").read_text()
    rows = re.findall(r"^\| \[`(\w+)`\]\(#\1\) \| (\([\d, ]+\)) \|", text, re.MULTILINE)
    assert {name for name, _ in rows} == {*TACTILE_CHANNELS, "wrench"}
    env = gym.make("ruffini/HoldStill-v0", observation=[name for name, _ in rows])
    for name, shape in rows:
        assert env.observation_space[name].shape == (math.prod(literal_eval(shape)),), name
        assert f"\n### {name}\n\n![" in text
        assert f"(channels/{name}.png)" in text


def test_every_model_of_touch_is_on_its_page():
    text = (DOCS / "touch.md").read_text()
    rows = re.findall(r'^\| `"(\w+)"`.* \| .* \| .* \|$', text, re.MULTILINE)
    assert rows == list(get_args(get_type_hints(Settings)["tactile"]))


def test_every_task_is_in_the_menu_and_has_a_moving_picture():
    menu = (DOCS.parent / "mkdocs.yml").read_text()
    for task in TASKS:
        assert f"- {task}: environments/{task}.md" in menu
        assert (DOCS / f"{task}.gif").exists()


def test_there_are_pages_with_code():
    assert {"README.md", "index.md", "custom.md", "mechanics.md"} <= {page.name for page in PAGES}
    assert len(PAGES) > 10


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_an_example_of_a_page_has_at_most_twenty_lines(page):
    for _, code in BLOCK.findall(page.read_text()):
        assert sum(bool(line.strip()) for line in code.splitlines()) <= 20, code


@pytest.mark.filterwarnings("ignore::UserWarning:torch")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_code_of_a_page_runs(page, root, monkeypatch):
    play(page.read_text(), page.stem, monkeypatch)


@pytest.fixture(scope="module")
def assemble():
    return runpy.run_path(str(DOCS / "assemble.py"))


@pytest.mark.parametrize("task", TASKS)
def test_the_code_of_an_environments_page_runs(task, assemble, root, monkeypatch):
    text = assemble["environment"](task)
    if task == "GraspSoft":
        # One of its objects, for condensing all of them takes minutes.
        text, changed = re.subn(r'(?<=make\("ruffini/GraspSoft-v0")\)', ', objects="sphere")', text)
        assert changed == 1
    play(text, task, monkeypatch)


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: str(file.relative_to(PACKAGE)))
def test_the_code_of_a_docstring_runs(file, root, monkeypatch):
    parsed = ast.walk(ast.parse(file.read_text()))
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    found = [ast.get_docstring(node) for node in parsed if isinstance(node, documented)]
    blocks = [block for text in found if text for block in EXAMPLE.findall(text)]
    assert blocks
    names = {"ruffini": ruffini, "gymnasium": gym, "np": np}
    names["env"] = gym.make_vec("ruffini/GraspLift-v0", num_envs=2)
    names["observation"], _ = names["env"].reset(seed=0)
    names["episode_start"] = np.ones(2, bool)
    for block in map(textwrap.dedent, blocks):
        if block.startswith("ruffini "):
            run(block, monkeypatch)
        else:
            exec(compile(block, str(file), "exec"), names)
    if envs := names.get("envs"):
        envs.reset(seed=0)
        envs.step(envs.action_space.sample())


def test_without_its_extra_the_site_says_what_to_install():
    # An interpreter that fails at every import.
    env = os.environ | {"PYTHON": "false"}
    done = subprocess.run([ROOT / ".ci/site"], env=env, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1 and 'false -m pip install ".[docs]"' in done.stderr


def test_lines_of_a_page_break_at_spaces_alone():
    page = runpy.run_path(str(DOCS / "hooks.py"))["on_page_content"]
    whole = '<code><span class="whole">--out</span> a</code>'
    assert page("<p>6 % <code>--out a</code></p>") == f"<p>6\N{NO-BREAK SPACE}% {whole}</p>"
    for kept in ('<a href="#a-b">b</a>', "<pre><code>--out 6 %</code></pre>", "<code>a b</code>"):
        assert page(kept) == kept


def test_signatures_of_the_reference_have_no_private_names(assemble):
    source = "_Path = str | bytes\ndef write(path: _Path = _HERE) -> _Path: ...\n_HERE = 'a'\n"
    shown = assemble["plain"](source)
    assert "def write(path: str | bytes='a') -> str | bytes:" in shown, shown


def test_the_site_has_all_that_it_links_to(assemble, tmp_path, monkeypatch):
    for name in ("SITE", "PAGES", "PYTHON"):
        monkeypatch.setitem(assemble["assemble"].__globals__, name, tmp_path / name.lower())
    assemble["assemble"]()
    pages = tmp_path / "pages"
    assert {f"environments/{task}.md" for task in TASKS} <= {
        page.relative_to(pages).as_posix() for page in pages.rglob("*.md")
    }
    for page in pages.rglob("*.md"):
        text = page.read_text()
        assert "<!--" not in text, page
        ways = [link[1] for link in assemble["LINK"].findall(text)]
        lost = [way for way in ways if not (page.parent / way).exists()]
        assert not lost, (page, lost)
    stub = (tmp_path / "python/ruffini/_core.py").read_text()
    assert "Quasi-static finite element model" in stub


def test_the_page_of_tasks_lists_the_terms_of_every_reward():
    page = (DOCS / "tasks.md").read_text()
    rows = re.findall(r"^\| (\w*) \| `(\w+)` \| ([\d.]+) \| (.+) \|$", page, re.MULTILINE)
    listed: dict[str, list[tuple[str, str, str]]] = {}
    for name, term, weight, meaning in rows:
        task = name or list(listed)[-1]
        listed.setdefault(task, []).append((term, weight, meaning))
    assert listed == {
        name: [
            (term["name"], f"{term['weight']:g}", term["doc"].replace("``", "`"))
            for term in task["terms"]
        ]
        for name, task in TASKS.items()
    }
