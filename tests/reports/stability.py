"""What extreme presses do to every answerer: makes stability.json, .md and .svg.

    python tests/reports/stability.py            1e5 presses, hours; goes on after a stop
    python tests/reports/stability.py --quick    200 presses, into target/reports/quick

Press number n of seed s is drawn from (s, n) alone: `--show n` asks it again and prints it.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator

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
    "surrogate": 0.07,
    "swift": 0.05,
    "environment": 0.14,
}
"""Who is asked, and how often: "nodes" is compliance with contact there, "swift" its network."""
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


def run(rows: Rows, seed: int, count: int, jobs: int, until: float) -> None:
    """Asks every press that is not among the rows, until a time is reached."""
    missing = ((seed, n) for n in range(count) if n not in rows)
    begun = time.monotonic()
    found_ones = answers(task, in_time(missing, until), jobs, LIMIT)
    for done, ((_, number), found) in enumerate(found_ones, 1):
        rows.add({"key": number, "case": case(seed, number)} | found)
        if done % 500 == 0 or found["verdict"] not in ("solved", "refused"):
            rate = done / (time.monotonic() - begun)
            print(f"{len(rows)}, {rate:.1f}/s: {number} {found['verdict']}", file=sys.stderr)


def in_time(tasks: Iterator, until: float) -> Iterator:
    """The tasks that can begin in time."""
    for one in tasks:
        if time.monotonic() > until:
            return
        yield one


def main() -> None:
    """Asks what is missing and writes the files."""
    parser = arguments(__doc__)
    parser.add_argument("--presses", type=int, help="how many; 100 000, or 200 in the quick form")
    parser.add_argument("--seed", type=int, default=SEED, help=f"{SEED} if not given")
    parser.add_argument("--hours", type=float, help="when to stop; 0.1 in the quick form")
    parser.add_argument("--jobs", type=int, default=JOBS, help=f"processes; {JOBS} if not given")
    parser.add_argument("--show", type=int, help="one press, printed")
    options = parser.parse_args()
    if options.show is not None:
        asked = case(options.seed, options.show)
        print(json.dumps(asked | {"found": task((options.seed, options.show))}, indent=1))
        return
    count = options.presses or (200 if options.quick else 100_000)
    hours = options.hours or (0.1 if options.quick else 1e3)
    about = header(MADE_OF, {"seed": options.seed, "limit": LIMIT})
    form = "quick" if options.quick else "full"
    rows = Rows(KEPT / form / "stability.jsonl", about)
    run(rows, options.seed, count, options.jobs, time.monotonic() + 3600 * hours)
    out, report = folder(parser, options), about | {"note": options.note} | summary(list(rows))
    (out / "stability.json").write_text(json.dumps(report, indent=1) + "\n")
    (out / "stability.md").write_text(markdown(report))
    figure(report, out / "stability.svg")
    known = {number for defect in report["defects"] for number in defect.get("known", [])}
    new = [row["key"] for row in report["wrong"] if row["key"] not in known]
    print(f"{report['presses']} presses, wrong or silent and not known {new}: {out}")
    sys.exit(1 if new and options.quick else 0)


if __name__ == "__main__":
    main()
