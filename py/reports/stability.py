"""Outcomes of extreme presses with every model: 20,000 take hours, --quick makes 24.

Press number n of seed s is drawn from (s, n) alone: `--show n` solves it again and prints it.
Twenty-five in a row have the same model, and the same pad where that takes seconds to build. Rows
of another build are dropped, unless `--keep COMMIT` names the one that began them; then presses
that a change may affect are solved anew, as by `--again surrogate fem:through 1384`, and the page
lists the builds that solved each model's presses.
"""

from __future__ import annotations

import json
import sys
import time
from argparse import ArgumentParser, Namespace
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from itertools import count
from pathlib import Path

import numpy as np
import tomllib

import extreme
import extreme_scenes
from engine import KEPT, OUT, Rows, grid, made, plt, quantiles, table, text
from engine.rows import conditions, header
from engine.watched import answers
from verdict import judged

ONE_THREAD = True
MADE_OF = ["env-core", "py/src"]
MADE_OF += [f"py/reports/{name}.py" for name in ("extreme", "extreme_scenes", "verdict")]
ANSWERERS = {
    "surrogate": 0.25,
    "linear": 0.25,
    "fem": 0.2,
    "compliance": 0.1,
    "nodes": 0.05,
    "environment": 0.15,
}
"""Models, and the share of presses that each solves.

"linear" is `LinearPad`, "nodes" is `Compliance` with contact there.
"""
SAME_MODEL = 25
"""Presses in a row with the same model."""
QUICK = 4
"""Presses of each model in the quick form."""
SEED = 12
LIMIT = 120.0
"""Processor time for a press (s)."""
FINE = ("solved", "refused")
"""Verdicts that are neither wrong nor silent."""
DEFECTS = OUT / "stability_defects.toml"
AXES: dict[str, list[float]] = {
    "young": [1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9],
    "poisson": [0.0, 0.3, 0.45, 0.49, 0.499, 0.5],
    "friction": [0.0, 1e-9, 0.1, 0.5, 1.0, 5.001],
    "depth": [1e-3, 1e-2, 0.1, 0.3, 0.5, 0.7],
    "size": [5e-4, 1e-3, 2e-3, 4e-3, 8e-3],
}
"""Bounds of the classes of a press's numbers."""
NAMES = ("mesh", "law", "element", "shape", "kind", "corrections")


def options(parser: ArgumentParser) -> None:
    """Adds options: presses, build, time."""
    parser.add_argument("--presses", type=int, help="how many; 20 000 if not given")
    parser.add_argument("--seed", type=int, default=SEED, help=f"{SEED} if not given")
    parser.add_argument("--hours", type=float, help="when to stop; 0.1 in the quick form")
    parser.add_argument("--jobs", type=int, default=2, help="processes; 2 if not given")
    parser.add_argument("--show", type=int, help="one press, printed")
    parser.add_argument("--keep", metavar="COMMIT", help="go on with the rows of that build")
    parser.add_argument("--again", nargs="+", default=[], help="answerers, answerer:kind, numbers")


def make(options: Namespace) -> dict:
    """Solves the presses that are missing."""
    if options.show is not None:
        shown = case(options.seed, options.show)
        print(json.dumps(shown | {"found": judged(shown)}, indent=1))
        raise SystemExit
    about = header(MADE_OF, {"seed": options.seed, "limit": LIMIT})
    now = about["commit"]
    about |= {"commit": options.keep or now}
    file = KEPT / options.form / "stability.jsonl"
    if options.keep and not (file.exists() and conditions(begun_as(file)) == conditions(about)):
        raise SystemExit(f"--keep {options.keep}: {file} has no rows of that build and machine")
    rows = Rows(file, about)
    if unknown := [one for one in options.again if not any(named(row, [one]) for row in rows)]:
        raise SystemExit(f"--again: no row is {' or '.join(unknown)}")
    old = {row["key"] for row in rows if row["by"] != now and named(row, options.again)}
    numbers: Iterable[int] = range(options.presses or 20_000)
    if options.quick and options.presses is None:
        numbers = of_each(lambda n: model_of(options.seed, n), ANSWERERS, SAME_MODEL, QUICK)
    numbers = [n for n in numbers if n in old or n not in rows]
    hours = options.hours or (0.1 if options.quick else 1e3)
    drawn = ({"number": number} | case(options.seed, number) for number in numbers)
    ask(rows, drawn, options.jobs, time.monotonic() + 3600 * hours, now)
    return about | {"note": options.note} | summary(list(rows))


def case(seed: int, number: int) -> dict:
    """Press `number` of a seed."""
    who, random = model_of(seed, number), np.random.default_rng([seed, 0, number])
    if who == "environment":
        return extreme_scenes.draw(random)
    pad = extreme.draw_pad(np.random.default_rng([seed, 1, number // SAME_MODEL]))
    return extreme.draw(random, who, pad)


def model_of(seed: int, number: int) -> str:
    """Model that solves press `number` of a seed."""
    random = np.random.default_rng([seed, 2, number // SAME_MODEL])
    return str(random.choice(list(ANSWERERS), p=list(ANSWERERS.values())))


def of_each(
    model: Callable[[int], str], models: Iterable[str], same: int, presses: int
) -> list[int]:
    """Numbers of the first few presses of each model, of which `same` in a row have the same."""
    firsts = (next(n for n in count(0, same) if model(n) == who) for who in models)
    return [first + i for first in firsts for i in range(presses)]


def ask(rows: Rows, cases: Iterable[dict], jobs: int, until: float, by: str) -> None:
    """Solves presses, with their numbers, until a time is reached; `by` is the build's commit."""
    begun = time.monotonic()

    def in_time() -> Iterator[dict]:
        for one in cases:
            if time.monotonic() > until:
                return
            yield one

    for done, (asked, found) in enumerate(answers(judged, in_time(), jobs, LIMIT), 1):
        number = asked.pop("number")
        rows.add({"key": number, "case": asked, "by": by} | found)
        if done % 500 == 0 or found["verdict"] not in FINE:
            rate = done / (time.monotonic() - begun)
            print(f"{len(rows)}, {rate:.1f}/s: {number} {found['verdict']}", file=sys.stderr)


def named(row: dict, again: list[str]) -> bool:
    """Returns whether a row is among those that ``--again`` names."""
    who = row["case"]["answerer"]
    return not {who, f"{who}:{row['case'].get('kind')}", str(row["key"])}.isdisjoint(again)


def begun_as(file: Path) -> dict:
    """The header of a file of rows."""
    with file.open() as lines:
        return json.loads(next(lines))


def also(report: dict, out: Path, options: Namespace) -> None:
    """Ends a quick run in failure where an answer is wrong that is not known to be."""
    known = {number for defect in report["defects"] for number in defect.get("known", [])}
    new = [row["key"] for row in report["wrong"] if row["key"] not in known]
    print(f"{report['presses']} presses, wrong or silent and not known {new}")
    if new and options.quick:
        sys.exit(1)


def summary(rows: list[dict]) -> dict:
    """Contents of the report, from all rows."""
    presses = [row for row in rows if row["case"]["answerer"] != "environment"]
    scenes = [row for row in rows if row["case"]["answerer"] == "environment"]
    slow = sorted(rows, key=lambda row: -row["seconds"])[:10]
    refused = [row for row in rows if row["verdict"] == "refused"]
    asked: dict = defaultdict(Counter)
    for row in rows:
        asked[row["case"]["answerer"]][row["by"]] += 1
    return {
        "presses": len(rows),
        "by answerer": by(rows, lambda row: row["case"]["answerer"]),
        "asked by": {who: dict(asked[who].most_common()) for who in sorted(asked)},
        "why": dict(Counter(f"{row['case']['answerer']}: {row['why']}" for row in refused)),
        "axes": {axis: by(presses, within(axis)) for axis in AXES}
        | {name: by(presses, lambda row, n=name: row["case"].get(n)) for name in NAMES},
        "scenes": {
            name: by(scenes, lambda row, n=name: row["case"][n])
            for name in ("actions", "time step", "iterations", "tactile")
        },
        "drift": drift(scenes),
        "long way": long_way(presses),
        "seconds": {
            "median": float(np.median([row["seconds"] for row in rows])),
            "99 %": float(np.quantile([row["seconds"] for row in rows], 0.99)),
            "slowest": [[row["key"], row["case"]["answerer"], row["seconds"]] for row in slow],
        },
        "wrong": [row for row in rows if row["verdict"] not in FINE],
        "defects": tomllib.loads(DEFECTS.read_text())["defect"],
    }


def by(rows: list[dict], name: Callable) -> dict:
    """Counts of verdicts by a name, in order."""
    found: dict = defaultdict(Counter)
    for row in rows:
        if (key := name(row)) is not None:
            found[key][row["verdict"]] += 1
    return {str(key): dict(found[key]) for key in sorted(found)}


def within(axis: str) -> Callable:
    """The class of a press on an axis."""
    ends = AXES[axis]

    def place(row: dict) -> float | None:
        value = row["case"].get(axis)
        return None if value is None else ends[max(np.searchsorted(ends, value, "right") - 1, 0)]

    return place


def drift(scenes: list[dict]) -> dict:
    """Farthest that an untouched object with friction moved, by the length of a substep (ms)."""
    found: dict = defaultdict(list)
    for row in scenes:
        case = row["case"]
        if case["actions"] == "still" and case["friction"] >= 0.1 and "shift" in row:
            found[round(1e3 * case["time step"] / case["iterations"], 2)].append(row["shift"])
    return {str(key): {"scenes": len(found[key]), "most": max(found[key])} for key in sorted(found)}


def long_way(presses: list[dict]) -> dict:
    """Differences of answers from those found by another method."""
    found = {}
    for name in WAYS:
        values = [row[name] for row in presses if name in row]
        numbers = [value for value in values if not isinstance(value, str)]
        if numbers:
            found[name] = {
                "compared": len(numbers),
                "refused": len(values) - len(numbers),
                **quantiles(numbers),
                "most": max(numbers),
                "above 1 %": sum(number > 0.01 for number in numbers),
            }
    return found


WAYS = {
    "finer": "frictionless finite elements, steps a quarter as long: force",
    "stiffer": "finite elements, a body 16 times as stiff: displacement",
    "truth": "network, presses in distribution, against finite elements: force",
    "unfelt": "depth in the skin at which nothing is felt (m)",
}
HEADS = {
    "young": "Young's modulus from (Pa)",
    "poisson": "Poisson's ratio from",
    "friction": "friction from",
    "depth": "depth from (share of the thickness)",
    "size": "size from (m)",
    "kind": "kind of motion",
    "time step": "time step (s)",
    "iterations": "substeps a time step",
}
PAGE = """# Stability: what extreme presses do

Of {presses:,} extreme presses and scenes, {solved:100*.1f} % are solved, {refused:100*.1f} %
refused with an error that says why (*refused by name*), and {bad} wrong, silent, hung or ended by a
panic. A press takes {seconds[median]:.2f} s in the median and {seconds[99 %]:.0f} s at the 99th
percentile; the limit is {sizes[limit]:.0f} s. Solved means that every number is finite, forces
balance within the stated tolerance, the wrench is the sum of the contact forces, and no shape is in
the skin past the documented bound (`py/reports/verdict.py`). How near an answer is to the truth
does not count; some were held against [another method](#the-same-answer-found-another-way).

*surrogate* is the network, *linear* the linear solution that it corrects (`LinearPad`), *fem*
finite elements, *compliance* linear elasticity with contact at points and *nodes* the same with
contact at nodes, *environment* a scene in which a hand acts. A number under *press* is that of a
press, which `python py/reports stability --show NUMBER` asks again; *kind* is how a shape is moved,
*through* right through the body.

## Defects found

Most were found by an earlier run, of 100,000 presses with the models of 22 November 2026, which had
neither today's network nor its linear solution; then *surrogate* and *swift* were two older
networks. The numbers are those of the run that found the defect.

{mended}

## By model

{answerers}

Named errors: {reasons}.

{wrong_ones}

## The same answer, found another way

{ways}

Where steps differ in force, both answers balance: an edge or a point on a coarse mesh, and a body
that buckles, have more than one equilibrium.

## By what was asked

Share of presses solved; the rest is refused by name.

{shares}

## Scenes

{of_scenes}

Farthest that an object moved with the hand away from it, friction 0.1 to 5, by length of a solver
substep:

{drifts}

## The slowest presses

{slowest}

{made}"""
COMPARED = {
    "relative difference": "{what}",
    "presses": "{compared}",
    "median": "{median:.1e}",
    "95 %": "{95 %:.1e}",
    "most": "{most:.1e}",
    "above 1 %": "{above}",
}
DEFECT = {
    "defect": "{what}",
    "press": "{press}",
    "mended": lambda defect: defect.get("mended", "open"),
}
WRONG = {"press": "{key}", "model": "{case[answerer]}", "verdict": "{verdict}", "why": "{why}"}
SLOW = {"press": "{of[0]}", "model": "{of[1]}", "s": "{of[2]:.0f}"}


def page(report: dict) -> str:
    """Conclusion, defects, tables."""
    total: Counter = Counter()
    for counted in report["by answerer"].values():
        total.update(counted)
    shares = {kind: total[kind] / report["presses"] for kind in FINE}
    ways = [
        row | {"what": WAYS[name], "above": "–" if name == "unfelt" else row["above 1 %"]}
        for name, row in report["long way"].items()
    ]
    drifts = [{"step": step} | row for step, row in report["drift"].items()]
    drift = {"substep (ms)": "{step}", "scenes": "{scenes}", "most (mm)": "{most:1e3*.3f}"}
    why = sorted(report["why"].items(), key=lambda reason: -reason[1])
    return text(
        PAGE,
        report | shares | {"bad": len(report["wrong"])},
        mended=table(DEFECT, report["defects"]),
        answerers=counts(report["by answerer"], "model", report["asked by"]),
        reasons=", ".join(f"{name} {n}" for name, n in why),
        wrong_ones=table(WRONG, report["wrong"][:40]) if report["wrong"] else "",
        ways=table(COMPARED, ways),
        shares="\n\n".join(solved(axis, report["axes"][axis]) for axis in [*AXES, *NAMES]),
        of_scenes="\n\n".join(counts(of, name) for name, of in report["scenes"].items()),
        drifts=table(drift, drifts),
        slowest=table(SLOW, [{"of": row} for row in report["seconds"]["slowest"]]),
        made=made(report),
    )


def counts(by: dict, head: str, asked: dict[str, dict[str, int]] | None = None) -> str:
    """Verdicts by name, fine ones first, and the builds, with their numbers of presses."""
    kinds = {kind for counted in by.values() for kind in counted}
    first = [kind for kind in FINE if kind in kinds]
    kinds = [*first, *sorted(kinds.difference(FINE))]
    rows = [[name, *(str(counted.get(kind, 0)) for kind in kinds)] for name, counted in by.items()]
    if asked is None:
        rows = [[short(name), *cells] for name, *cells in rows]
        return grid([HEADS.get(head, head), *kinds], rows)
    for row in rows:
        some = asked[row[0]]
        row.append(", ".join(f"{c} ({n})" if len(some) > 1 else c for c, n in some.items()))
    return grid([head, *kinds, "asked at commit"], rows)


def solved(axis: str, counted: dict) -> str:
    """Share solved, class by class."""
    cells = [f"{100 * c.get('solved', 0) / sum(c.values()):.0f} %" for c in counted.values()]
    return grid([HEADS.get(axis, axis), *map(short, counted)], [["solved", *cells]])


def short(name: str) -> str:
    """A number in few letters."""
    try:
        return f"{float(name):g}"
    except ValueError:
        return name


COLOURS = {"solved": "#4c9f70", "wrong or silent": "#b3232c", "refused by name": "#e3b23c"}


def figure(report: dict):
    """Verdicts by model and by parameters of the press."""
    picture, axes = plt.subplots(2, 4, figsize=(13, 6), layout="constrained")
    axes_of = report["axes"]
    parts = {"model": report["by answerer"]}
    parts |= {HEADS[name]: axes_of[name] for name in ("young", "poisson", "friction", "depth")}
    parts |= {"mesh": axes_of["mesh"], "kind of motion": axes_of["kind"]}
    parts |= {"scene: time step (s)": report["scenes"].get("time step", {})}
    for (title, counted), axis in zip(parts.items(), axes.flat, strict=True):
        bars(axis, title, counted)
    picture.legend(*axes[0, 0].get_legend_handles_labels(), ncols=3, loc="outside lower center")
    return picture


def bars(axis, title: str, counted: dict) -> None:
    """Share of each verdict, class by class, with the number of presses."""
    for place, some in enumerate(counted.values()):
        total, left = sum(some.values()), 0.0
        fine = [some.get(kind, 0) for kind in FINE]
        parts = [fine[0], total - sum(fine), fine[1]]
        for (label, colour), number in zip(COLOURS.items(), parts, strict=True):
            share = 100 * number / total
            axis.barh(place, share, left=left, color=colour, label=label if place == 0 else None)
            left += share
        axis.text(99, place, f"n = {total}", ha="right", va="center", fontsize=6)
    axis.set_yticks(range(len(counted)), [short(name) for name in counted])
    axis.invert_yaxis()
    axis.set(title=title, xlim=(0, 100), xlabel="% of presses")
