"""What README and the pages beside it quote of reports, and that made pages are of their figures.

A quoted figure is followed by a comment that says where it comes from, the report's name and the
way to it in the JSON: ``12.3 ms<!-- pareto: panels / deep / network / ms -->``, through a list by
the number of a row or by a name that stands in it. It must be that number, rounded to as many
digits as are written; before a ``%``, a hundred times that.
"""

from __future__ import annotations

import importlib
import json
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
REPORTS = ROOT / "tests/reports"
RESULTS = ROOT / "policies/results"
FOLDERS = (REPORTS, ROOT / "tests/reference", RESULTS)
DOCS = ROOT / "py/docs"
WRITTEN = (REPORTS / "mechanics.md", REPORTS / "surrogate.md", *sorted(DOCS.glob("*.md")))
"""Pages that are written by hand, with marks."""
README = [
    ("17 %", "displacement", "unseen", "table / all / network / displacement / 0"),
    ("20 %", "stress", "unseen", "table / all / network / stress / 0"),
    ("9 %", "force", "unseen", "table / all / network / force / 0"),
    ("100,000", "extreme presses", "stability", "presses"),
    ("163", "to", "touch_speed", "touching / surrogate / cuboid / steps_per_second"),
    ("240", "steps a second", "touch_speed", "touching / surrogate / sphere / steps_per_second"),
]
"""Figures of README: as they are written, a word near by, the report and the way to them in it."""
MARK = re.compile(
    r"(?P<number>-?[\d,]*\.?\d+)(?P<unit> ?[%\w]+)?\**<!-- (?P<report>[\w-]+): (?P<way>.+?) -->"
)
PAGES = {
    f"{name}_pages": name
    for name in ("dataset", "episode", "fem", "paper", "pareto", "scene_cost", "stability")
}
PAGES |= {"networks": "networks"}
"""Reports by the module that writes their page."""
sys.path += [str(REPORTS), str(ROOT / "policies")]


def value(report: str, way: str) -> float:
    """The number at the end of a way into a report."""
    files = [folder / f"{report}.json" for folder in FOLDERS]
    found = json.loads(next(file for file in files if file.exists()).read_text())
    for step in way.split(" / "):
        found = row(found, step) if isinstance(found, list) else found[step]
    assert isinstance(found, (int, float)), f"{report}: {way} is {found}"
    return found


def row(rows: list[dict], step: str) -> dict:
    """The row of that number, or the only one that has that name in it."""
    [found] = [rows[int(step)]] if step.isdigit() else [r for r in rows if step in r.values()]
    return found


def quoted(mark: re.Match[str]) -> tuple[str, str]:
    """A marked figure as it is written, and as the report has it."""
    written = mark["number"]
    _, _, digits = written.partition(".")
    true = value(mark["report"], mark["way"]) * (100 if "%" in (mark["unit"] or "") else 1)
    return written.replace(",", ""), f"{true:.{len(digits)}f}"


@pytest.mark.parametrize("page", WRITTEN, ids=lambda page: page.name)
def test_every_marked_figure_is_that_of_its_report(page):
    text = page.read_text()
    marks, wrong = list(MARK.finditer(text)), []
    assert len(marks) == text.count("<!--"), "a mark that is not read"
    for mark in marks:
        written, true = quoted(mark)
        if written != true:
            wrong.append(f"{mark[0]} is {true}")
    assert not wrong, wrong


@pytest.mark.parametrize(("written", "word", "report", "way"), README)
def test_every_figure_of_the_readme_is_that_of_its_report(written, word, report, way):
    text = " ".join((ROOT / "README.md").read_text().split())
    place = re.search(rf"(?<![\d.,]){re.escape(written)}", text)
    assert place is not None, "a figure that README has no more"
    assert word in text[place.start() :][:60]
    number, _, unit = written.partition(" ")
    true = value(report, way) * (100 if report in ("pareto", "unseen") and unit != "ms" else 1)
    digits = len(number.partition(".")[2])
    assert number.replace(",", "") == f"{true:.{digits}f}"


def test_the_readme_is_short_and_hides_nothing():
    text = (ROOT / "README.md").read_text()
    assert len(text.encode()) <= 8000
    assert "<!--" not in text


LINK = re.compile(r"\]\((?!https?://|#)([^)#]+)")


@pytest.mark.parametrize("page", [ROOT / "README.md", *WRITTEN], ids=lambda page: page.name)
def test_every_link_leads_somewhere(page):
    lost = [way for way in LINK.findall(page.read_text()) if not (page.parent / way).exists()]
    assert not lost, lost


def test_a_mark_is_read_with_its_digits_and_its_percent():
    count = value("stability", "presses")
    right = f"**{count:,}**<!-- stability: presses -->"
    written, true = quoted(MARK.search(right))
    assert written == true
    share = MARK.search("1.5 %<!-- stability: sizes / limit -->")
    assert quoted(share) == ("1.5", f"{100 * value('stability', 'sizes / limit'):.1f}")


@pytest.mark.parametrize("module", PAGES)
def test_a_page_is_that_of_its_figures(module):
    pytest.importorskip(
        "tomllib", reason="what was found is kept in TOML, read from Python 3.11 on"
    )
    pages, name = importlib.import_module(module), PAGES[module]
    report = json.loads((REPORTS / f"{name}.json").read_text())
    assert pages.markdown(report) == (REPORTS / f"{name}.md").read_text()


def test_what_is_recommended_from_is_the_report():
    pages = importlib.import_module("pareto_pages")
    report = json.loads((REPORTS / "pareto.json").read_text())
    shipped = json.loads((ROOT / "py/python/ruffini/answerers.json").read_text())
    assert pages.chosen(report) == shipped


def test_a_front_leaves_out_what_is_measurably_beaten():
    pages = importlib.import_module("pareto_pages")

    def answers(ms, error, kind="fem", whole=True):
        return {"ms": ms, "finest": {"force": {"median": error}}, "kind": kind, "whole": whole}

    found = {
        "slow and near": answers(100, 0.01),
        "fast and far": answers(1, 0.1),
        "as fast, to measure": answers(1.04, 0.1004),
        "as near, but slower": answers(120, 0.01),
        "as fast, but farther": answers(1, 0.11),
        "not of all presses": answers(1, 0.001, whole=False),
        "an oracle": answers(1, 0.001, kind="oracle"),
        "silent": {"finest": {}},
    }
    expected = ["fast and far", "as fast, to measure", "slow and near"]
    assert pages.front(found, "force") == expected


def test_every_answerer_is_in_the_picture():
    answerers, plots = map(importlib.import_module, ("pareto_answerers", "pareto_plots"))
    drawn = {name for series in plots.SERIES.values() for name in series.members}
    assert drawn == set(answerers.ANSWERERS)


def test_what_a_change_may_touch_is_asked_again(tmp_path, monkeypatch, capsys):
    pytest.importorskip("tomllib", reason="defects are kept in TOML, read from Python 3.11 on")
    stability = importlib.import_module("stability")

    def asked(*options, build):
        """The JSON of a run in which that build answers every press with itself."""
        answer = {"verdict": "solved", "why": "", "seconds": 0.0}
        about = {"commit": build, "sizes": {}}
        monkeypatch.setattr(stability, "header", lambda *_: dict(about))
        monkeypatch.setattr(
            stability, "answers", lambda _, tasks, *__: ((one, answer) for one in tasks)
        )
        out = ["--presses", "60", "--out", str(tmp_path), *options]
        monkeypatch.setattr(sys, "argv", ["stability.py", *out])
        stability.main()
        return json.loads((tmp_path / "stability.json").read_text())["asked by"]

    monkeypatch.setattr(stability, "KEPT", tmp_path)
    monkeypatch.setattr(stability, "markdown", lambda _: "")
    monkeypatch.setattr(stability, "figure", lambda *_: None)
    assert all(builds.keys() == {"one"} for builds in asked(build="one").values())
    by = asked("--keep", "one", "--again", "surrogate", "fem:tiny", build="two")
    assert by["surrogate"].keys() == {"two"}
    assert by["compliance"].keys() == by["nodes"].keys() == {"one"}
    assert by["fem"].keys() == {"one", "two"}
    for wrong in (["--keep", "two"], ["--keep", "one", "--again", "surrogat"]):
        with pytest.raises(SystemExit):
            asked(*wrong, build="three")
    assert "no rows of that build" in capsys.readouterr().err
    assert asked("--keep", "one", build="three") == by
    assert asked(build="three")["surrogate"].keys() == {"three"}
