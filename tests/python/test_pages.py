"""The Python of README and of the pages runs as it is written, block after block of a page."""

from __future__ import annotations

import re
from pathlib import Path

import gymnasium as gym
import pytest

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PAGES = [
    page
    for page in [ROOT / "README.md", *sorted((ROOT / "py/docs").glob("*.md"))]
    if BLOCK.search(page.read_text())
]


def test_there_are_pages_with_python():
    assert {"README.md", "custom.md", "mechanics.md"} <= {page.name for page in PAGES}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_python_of_a_page_runs(page, tmp_path, monkeypatch):
    sb3 = pytest.importorskip("stable_baselines3")
    learn = sb3.PPO.learn
    # Training is stopped at once: what it leads to is tested elsewhere.
    stopped = {"callback": lambda *_: False}
    monkeypatch.setattr(sb3.PPO, "learn", lambda model, steps: learn(model, steps, **stopped))
    monkeypatch.chdir(tmp_path)
    registered, names = dict(gym.registry), {"__name__": page.stem}
    try:
        for block in BLOCK.findall(page.read_text()):
            exec(compile(block, page.name, "exec"), names)
    finally:
        gym.registry.clear()
        gym.registry.update(registered)
