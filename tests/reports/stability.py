"""What extreme presses do to every answerer: makes stability.json, .md and .svg.

    python tests/reports/stability.py            1e5 presses, hours; goes on after a stop
    python tests/reports/stability.py --quick    100 presses, into target/reports/quick

Press number n of seed s is drawn from (s, n) alone: `--show n` asks it again and prints it. Rows of
another build are dropped, unless `--keep COMMIT` names the one that began them; then what a change
may touch is asked anew, as by `--again surrogate fem:through 1384`, and the page tells who asked
what.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import extreme
import extreme_scenes
import numpy as np
from kept import KEPT, Rows, arguments, folder, header
from stability_pages import markdown, summary
from stability_plots import figure
from verdict import judged
from watched import answers

MADE_OF = ["env-core", "py/src", "tests/reports/extreme.py", "tests/reports/extreme_scenes.py"]
MADE_OF += ["tests/reports/verdict.py"]
"""What the figures come from, under the root."""
ANSWERERS = {
    "fem": 0.36,
    "compliance": 0.22,
    "nodes": 0.16,
    "surrogate": 0.12,
    "environment": 0.14,
}
"""Who is asked, and how often: "nodes" is compliance with contact there."""
SEED = 7
LIMIT = 120.0
"""Processor time for a press (s)."""
JOBS = 2


def case(seed: int, number: int) -> dict:
    """Press `number` of a seed."""
    random = np.random.default_rng([seed, number])
    who = str(random.choice(list(ANSWERERS), p=list(ANSWERERS.values())))
    if who == "environment":
        return extreme_scenes.draw(random)
    return extreme.draw(random, who)


def task(place: tuple[int, int]) -> dict:
    """What became of press `number` of a seed."""
    os.environ["RAYON_NUM_THREADS"] = "1"
    return judged(case(*place))


def run(rows: Rows, seed: int, numbers: Iterable[int], jobs: int, until: float, by: str) -> None:
    """Asks presses, until a time is reached; `by` is the commit that answers."""
    begun = time.monotonic()
    missing = ((seed, number) for number in numbers)
    found_ones = answers(task, in_time(missing, until), jobs, LIMIT)
    for done, ((_, number), found) in enumerate(found_ones, 1):
        rows.add({"key": number, "case": case(seed, number), "by": by} | found)
        if done % 500 == 0 or found["verdict"] not in ("solved", "refused"):
            rate = done / (time.monotonic() - begun)
            print(f"{len(rows)}, {rate:.1f}/s: {number} {found['verdict']}", file=sys.stderr)


def named(row: dict, again: list[str]) -> bool:
    """Whether a row is among those that ``--again`` names."""
    who = row["case"]["answerer"]
    return not {who, f"{who}:{row['case'].get('kind')}", str(row["key"])}.isdisjoint(again)


def begun_as(file: Path) -> dict:
    """The header of a file of rows."""
    with file.open() as lines:
        header: dict = json.loads(next(lines))
    return header


def in_time(tasks: Iterator, until: float) -> Iterator:
    """The tasks that can begin in time."""
    for one in tasks:
        if time.monotonic() > until:
            return
        yield one


def main() -> None:
    """Asks what is missing and writes the files."""
    parser = arguments(__doc__)
    parser.add_argument("--presses", type=int, help="how many; 100 000, or 32 in the quick form")
    parser.add_argument("--seed", type=int, default=SEED, help=f"{SEED} if not given")
    parser.add_argument("--hours", type=float, help="when to stop; 0.1 in the quick form")
    parser.add_argument("--jobs", type=int, default=JOBS, help=f"processes; {JOBS} if not given")
    parser.add_argument("--show", type=int, help="one press, printed")
    parser.add_argument("--keep", metavar="COMMIT", help="go on with the rows of that build")
    parser.add_argument("--again", nargs="+", default=[], help="answerers, answerer:kind, numbers")
    options = parser.parse_args()
    if options.show is not None:
        shown = case(options.seed, options.show)
        print(json.dumps(shown | {"found": task((options.seed, options.show))}, indent=1))
        return
    count = options.presses or (32 if options.quick else 100_000)
    hours = options.hours or (0.1 if options.quick else 1e3)
    about = header(MADE_OF, {"seed": options.seed, "limit": LIMIT})
    now = about["commit"]
    about |= {"commit": options.keep or now}
    form = "quick" if options.quick else "full"
    file = KEPT / form / "stability.jsonl"
    if options.keep and not (file.exists() and begun_as(file) == about):
        parser.error(f"--keep {options.keep}: {file} has no rows of that build and this machine")
    rows = Rows(file, about)
    if unknown := [one for one in options.again if not any(named(row, [one]) for row in rows)]:
        parser.error(f"--again: no row is {' or '.join(unknown)}")
    old = {row["key"] for row in rows if row["by"] != now and named(row, options.again)}
    numbers = [n for n in range(count) if n in old or n not in rows]
    run(rows, options.seed, numbers, options.jobs, time.monotonic() + 3600 * hours, now)
    out, report = folder(parser, options), about | {"note": options.note} | summary(list(rows))
    (out / "stability.json").write_text(json.dumps(report, indent=1) + "\n")
    (out / "stability.md").write_text(markdown(report))
    figure(report, out / "stability.svg")
    known = {number for defect in report["defects"] for number in defect.get("known", [])}
    new = [row["key"] for row in report["wrong"] if row["key"] not in known]
    print(f"{report['presses']} presses, wrong or silent and not known {new}: {out}")
    if new and options.quick:
        sys.exit(1)


if __name__ == "__main__":
    main()
