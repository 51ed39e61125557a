"""Figures that README and the pages beside it quote of reports are the reports', on made pages too.

A quoted figure is found by its key. It is the report's, with as many digits as are written, but for
times in README: those of another machine are others, and only have to be there. ``.ci/report
--pages`` writes pages and their quoted figures anew; what README quotes is listed here.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
REPORTS = ROOT / "tests/reports"
sys.path.append(str(ROOT / "py/reports"))
pytest.importorskip("matplotlib", reason="reports draw with it")

from engine import pages

TIMES = re.compile(
    r"ms|rate|share|ratio|peak_mib|untouched|random_actions|steps_per_second|(.*_)?seconds.*"
)
"""A key of figures that are others on another machine."""
QUANTITIES = ("displacement", "stress", "force")
README = [
    ("and hold it | {} % | [", "GraspLift-v0-scripted", "success"),
    ("that it breaks | {} % | [", "GraspFragile-v0-scripted", "success"),
    ("deforming it little | {} % | [", "GraspSoft-v0-scripted", "success"),
    ("with little force | {} % | [", "HoldStill-v0-scripted", "success"),
    ("a few millimetres | {} % | [", "InsertPeg-v0-scripted", "success"),
    ("by {} to 9 % in displacement", "unseen", "table / all / network / displacement / 0"),
    (
        "{} % in displacement",
        "pareto",
        "panels / unseen / network / errors / displacement / median",
    ),
    ("{} to 10 % in stress", "unseen", "table / all / network / stress / 0"),
    ("{} % in stress", "pareto", "panels / unseen / network / errors / stress / median"),
    ("{} to 5 % in force", "unseen", "table / all / network / force / 0"),
    ("{} % in force", "pareto", "panels / unseen / network / errors / force / median"),
    ("it corrects is off by {} %,", "unseen", "table / all / linear, on cells / displacement / 0"),
    ("by 12 %, {} % and 4", "unseen", "table / all / linear, on cells / stress / 0"),
    ("% and {} to 6 %. [Where", "unseen", "table / all / linear, on cells / force / 0"),
    (
        "% and 4 to {} %. [Where",
        "pareto",
        "panels / unseen / linear, on cells / errors / force / median",
    ),
    ("[{} presses made to break it]", "stability", "presses"),
    ("[{} that begin in the gel]", "buried", "presses"),
    ("buried.md) {} were wrong", "buried", "wrong presses"),
    ("one thread takes [{} to", "touch_speed", "touching / surrogate / cuboid / steps_per_second"),
    ("{} steps a second]", "touch_speed", "touching / surrogate / sphere / steps_per_second"),
]
"""Figures of README: where they stand, between which words, the report, and the keys to them."""
SPEEDS = {
    "times as many with rigid pads": (
        ROOT / "policies/results/touch_speed.json",
        lambda report: [
            (report["touching"]["none"][name], row)
            for name, row in report["touching"]["surrogate"].items()
        ],
    ),
}
"""Quotients of speeds in README, "8 to 12" with these words, and the pairs that they are of."""


def is_time(keys: str) -> bool:
    """Returns whether a figure depends on the machine."""
    return any(TIMES.fullmatch(step) for step in keys.split(" / "))


@pytest.mark.parametrize("page", pages.WRITTEN, ids=lambda page: page.name)
def test_every_marked_figure_is_that_of_its_report(page):
    text = page.read_text()
    marks, wrong = list(pages.MARK.finditer(text)), []
    assert len(marks) == text.count("<!--"), "a mark that is not read"
    for mark in marks:
        true = pages.quoted(mark)
        if mark["number"].replace(",", "") != true.replace(",", ""):
            wrong.append(f"{mark[0]} is {true}")
    assert not wrong, wrong


@pytest.mark.parametrize(("phrase", "report", "keys"), README)
def test_every_figure_of_the_readme_is_that_of_its_report(phrase, report, keys):
    text = " ".join((ROOT / "README.md").read_text().split())
    before, after = map(re.escape, phrase.split("{}"))
    [number] = re.findall(rf"{before}(?<![\d.,])(\d[\d,.]*){after}", text)
    true = pages.value(report, keys) * (100 if " %" in phrase else 1)
    digits = len(number.partition(".")[2])
    assert number.replace(",", "") == f"{true:.{digits}f}" or is_time(keys)


def test_every_percentage_of_the_readme_is_checked():
    text = (ROOT / "README.md").read_text()
    of_agents = len(re.findall(r"the worst of \d+ seeds", text))
    # Two of the quickstart, and two in each row of the table: tests/python/test_study.py. One of a
    # real sensor: below.
    checked = sum("{} %" in phrase for phrase, _, _ in README) + 3 + 2 * of_agents
    assert text.count(" %") == checked


@pytest.mark.parametrize("words", SPEEDS)
def test_quotients_of_speeds_in_the_readme_are_those_of_their_report(words):
    file, pairs = SPEEDS[words]
    text = " ".join((ROOT / "README.md").read_text().split())
    [written] = re.findall(rf"(\d+) to (\d+) {words}", text)
    times = [
        fast["steps_per_second"] / slow["steps_per_second"]
        for fast, slow in pairs(json.loads(file.read_text()))
    ]
    # On another machine, or another day, they are others: only their size has to be right.
    assert [int(number) for number in written] == pytest.approx([min(times), max(times)], rel=0.5)


def test_the_readme_says_how_soft_the_default_gel_is():
    text = " ".join((ROOT / "README.md").read_text().split())
    [written] = re.findall(r"\[(\d+) to (\d+) % softer\]", text)
    reality = json.loads((REPORTS / "reality.json").read_text())
    measured = reality["reality_unfitted"]["forces"]
    cases = json.loads((REPORTS / "fem.json").read_text())["cases"]
    below = [
        1 - force / right
        for name, case in cases.items()
        if name.startswith("mini tacflex")
        for force, right in zip(case["force"].values(), measured, strict=True)
    ]
    assert [int(number) for number in written] == [round(100 * f(below)) for f in (min, max)]


@pytest.mark.parametrize("agent", ["GraspLift", "HoldStill", "GraspFragile", "InsertPeg"])
def test_episodes_that_the_readme_counts_are_those_of_the_report(agent):
    text = " ".join((ROOT / "README.md").read_text().split())
    [found] = re.findall(rf"{agent}'s (?:wins )?(\d+) of (\d+) \((\d+)", text)
    count, *shares = (
        pages.value("sim_to_sim", f"policies / {agent} agent / {key}")
        for key in ("seeds", "fem / success", "surrogate / success")
    )
    won = [round(count * share) for share in shares]
    assert [int(number) for number in found] == [won[0], count, won[1]]


def test_the_readme_says_what_finite_elements_cost_that_are_nearer_than_the_network():
    text = " ".join((ROOT / "README.md").read_text().split())
    [written] = re.findall(r"\[(\d+) times as long\]\(tests/reports/pareto.md\)", text)
    found = json.loads((REPORTS / "pareto.json").read_text())["panels"]["unseen"]
    network = found["network"]

    def nearer(row):
        return all(
            row["errors"][of]["median"] < network["errors"][of]["median"] for of in QUANTITIES
        )

    elements = [row for row in found.values() if row["kind"] == "fem" and row["whole"]]
    times = min(row["ms"] for row in elements if nearer(row)) / network["ms"]
    assert int(written) == pytest.approx(times, rel=0.03)


def test_the_readme_is_short_and_hides_nothing():
    text = (ROOT / "README.md").read_text()
    assert len(text.encode()) <= 8000
    assert "<!--" not in text


LINK = re.compile(r"\]\((?!https?://|#)([^)#]+)(?:#([^)]+))?")
"""A link to a file, and to a heading in it."""


def headings(page: Path) -> set[str]:
    """Returns what links may name on a page: its headings as GitHub writes them in addresses."""
    found = re.findall(r"^#+ (.+)$", page.read_text(), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in found}


@pytest.mark.parametrize("page", [ROOT / "README.md", *pages.WRITTEN], ids=lambda page: page.name)
def test_every_link_leads_somewhere(page):
    links = LINK.findall(page.read_text())
    lost = [name for name, _ in links if not (page.parent / name).exists()]
    assert not lost, lost
    named = [(name, title) for name, title in links if title and name.endswith(".md")]
    lost = [link for link in named if link[1] not in headings(page.parent / link[0])]
    assert not lost, lost


def test_a_mark_is_read_with_its_digits_and_its_percent():
    count = pages.value("stability", "presses")
    right = f"**{count:,}**<!-- stability: presses -->"
    assert pages.quoted(pages.MARK.search(right)) == f"{count:,}"
    share = pages.MARK.search("1.5 %<!-- stability: sizes / limit -->")
    assert pages.quoted(share) == f"{100 * pages.value('stability', 'sizes / limit'):.1f}"


def test_quoted_figures_are_written_anew_from_the_reports():
    limit = pages.value("stability", "sizes / limit")
    stale = "at most 7.5 s<!-- stability: sizes / limit --> each"
    assert pages.requoted(stale) == f"at most {limit:.1f} s<!-- stability: sizes / limit --> each"
    with pytest.raises(KeyError):
        pages.requoted("1 s<!-- stability: sizes / no such key -->")
