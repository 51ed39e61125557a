"""Versions agree wherever they stand, and `.ci/wheel` refuses what should not be shipped."""

from __future__ import annotations

import io
import json
import re
import runpy
import shutil
import subprocess
import tarfile
import zipfile
from pathlib import Path

import pytest

import ruffini

ROOT = Path(__file__).resolve().parents[2]
ENTRY = re.compile(r"^## (\d+\.\d+\.\d+)(?: \(unreleased\)| - (\d{4}-\d\d-\d\d))$", re.MULTILINE)
"""Heading of an entry of the changelog: version, and the date of its release."""
PAGES = ["README.md", "py/README.md", ".github/CONTRIBUTING.md", "py/docs/index.md"]
"""Pages that say what is needed to build."""


def entry(of: str, name: str) -> str:
    """Value of a key in a TOML file, which Python 3.10 cannot read."""
    [value] = re.findall(rf'^{name} = "(.*)"$', (ROOT / of).read_text(), re.MULTILINE)
    return value


VERSION = entry("Cargo.toml", "version")


def tags() -> list[str]:
    """Tags of releases on the commit that is checked out."""
    command = ["git", "tag", "--points-at", "HEAD"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return re.findall(r"^v\d.*$", done.stdout, re.MULTILINE)


def test_the_package_has_the_version_of_the_workspace():
    assert ruffini.__version__ == VERSION
    assert 'dynamic = ["version"]' in (ROOT / "pyproject.toml").read_text()
    locked = re.findall(
        r'^name = "(ruffini-\w+)"\nversion = "(.*)"$', (ROOT / "Cargo.lock").read_text(), re.M
    )
    assert locked == [("ruffini-core", VERSION), ("ruffini-py", VERSION)]


def test_the_first_entry_of_the_changelog_is_of_this_version_and_dated_where_it_is_tagged():
    text = (ROOT / "py/CHANGELOG.md").read_text()
    entries = ENTRY.findall(text)
    assert len(entries) == text.count("\n## "), "an entry is '## 1.2.3 (unreleased)' or '- date'"
    assert entries[0][0] == VERSION
    assert all(date for _, date in entries[1:]), "only the first may be unreleased"
    for tag in tags():
        assert tag == f"v{VERSION}"
        assert entries[0][1], f"tagged {tag}, and the changelog says unreleased"


def test_the_rust_that_is_needed_is_the_same_everywhere():
    needed = entry("Cargo.toml", "rust-version")
    for page in PAGES:
        said = re.findall(r"Rust (\d[\d.]*\d)", (ROOT / page).read_text())
        assert said == [needed], page


def test_the_python_that_is_needed_is_the_same_everywhere():
    needed = entry("pyproject.toml", "requires-python").removeprefix(">=")
    assert f'"abi3-py{needed.replace(".", "")}"' in (ROOT / "py/Cargo.toml").read_text()
    for page in PAGES:
        said = re.findall(r"Python (\d[\d.]*\d)", (ROOT / page).read_text())
        assert said == [needed], page


@pytest.mark.skipif(not shutil.which("cargo"), reason="needs cargo")
def test_no_dependency_needs_a_newer_rust():
    command = ["cargo", "metadata", "--locked", "--format-version", "1"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
    packages = json.loads(done.stdout)["packages"]

    def number(version: str) -> list[int]:
        return [int(part) for part in version.split(".")][:2]

    ours = number(entry("Cargo.toml", "rust-version"))
    newer = [p["id"] for p in packages if p["rust_version"] and number(p["rust_version"]) > ours]
    assert not newer


@pytest.fixture(scope="module")
def wheel():
    return runpy.run_path(str(ROOT / ".ci/wheel"))


METADATA = "Metadata-Version: 2.4\nName: ruffini\n\n# ruffini\n"


def an_sdist(folder: Path, names: set[str], about: str = METADATA) -> Path:
    file = folder / f"ruffini-{VERSION}.tar.gz"
    with tarfile.open(file, "w:gz") as archive:
        for name in sorted(names | {"PKG-INFO"}):
            data = about.encode() if name == "PKG-INFO" else b""
            member = tarfile.TarInfo(f"ruffini-{VERSION}/{name}")
            member.size = len(data)
            archive.addfile(member, io.BytesIO(data))
    return file


def a_wheel(folder: Path, names: set[str]) -> Path:
    file = folder / f"ruffini-{VERSION}-cp310-abi3-manylinux_2_17_x86_64.whl"
    info = f"ruffini-{VERSION}.dist-info"
    about = {"METADATA", "WHEEL", "RECORD", "entry_points.txt"}
    about |= {f"licenses/LICENSE-{name}" for name in ("MIT", "APACHE", "THIRD-PARTY")}
    with zipfile.ZipFile(file, "w") as archive:
        for name in sorted(names | {f"{info}/{name}" for name in about}):
            archive.writestr(name, METADATA)
    return file


def test_an_sdist_has_what_is_built_from_and_nothing_else(wheel, tmp_path):
    names = {name for name in wheel["tracked"]() if wheel["IN_SDIST"].fullmatch(name)}
    assert {"Cargo.lock", "LICENSE-MIT", "py/python/ruffini/py.typed"} <= names
    assert not [name for name in names if name.startswith(("tests/", "policies/", "py/docs/"))]
    assert wheel["check_sdist"](an_sdist(tmp_path, names))["files"] == len(names) + 1
    with pytest.raises(wheel["WrongError"], match=r"more than expected: \['tests/a.py'\]"):
        wheel["check_sdist"](an_sdist(tmp_path, names | {"tests/a.py"}))
    with pytest.raises(wheel["WrongError"], match=r"lacks: \['Cargo.lock'\]"):
        wheel["check_sdist"](an_sdist(tmp_path, names - {"Cargo.lock"}))


def test_a_wheel_has_the_package_its_agents_and_licences_and_nothing_else(wheel, tmp_path):
    names = {n.removeprefix("py/python/") for n in wheel["tracked"]() if n.startswith("py/python/")}
    names |= {"ruffini/_core.abi3.so"}
    assert wheel["check_wheel"](a_wheel(tmp_path, names))["bytes"] > 0
    for less in (
        "ruffini/py.typed",
        "ruffini/_core.pyi",
        "ruffini/agents/HoldStill-v0.safetensors",
    ):
        with pytest.raises(wheel["WrongError"], match=re.escape(f"lacks: ['{less}']")):
            wheel["check_wheel"](a_wheel(tmp_path, names - {less}))
    with pytest.raises(wheel["WrongError"], match="more than expected"):
        wheel["check_wheel"](a_wheel(tmp_path, names | {"ruffini/__pycache__/a.pyc"}))


def test_what_is_too_large_or_has_links_that_the_registry_cannot_follow_is_refused(wheel, tmp_path):
    for link in ("[a](py/docs/touch.md)", "![](a.png)", '<img src="a.png">'):
        with pytest.raises(wheel["WrongError"], match="cannot follow"):
            wheel["check_metadata"](METADATA + link)
    wheel["check_metadata"](METADATA + "[a](https://gymnasium.farama.org) [b](#use)")
    (tmp_path / "a.whl").write_bytes(b"0" * 1_000_001)
    with pytest.raises(wheel["WrongError"], match=r"1.0 MB, expected at most 1 MB"):
        wheel["small"](tmp_path / "a.whl", 1e6)


def test_a_wheel_that_is_not_there_is_a_line(tmp_path):
    command = [ROOT / ".ci/wheel", "--check", tmp_path / "no.whl"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith(".ci/wheel: error: --check: found no file")
