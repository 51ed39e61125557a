"""Presses that begin in the gel, with every model: 10,000 take an hour of a core, --quick makes 24.

Slender and small shapes at any tilt, whose first pose is in a pad already: the only one, or
followed by ones beside it. Fifty presses in a row have the same pad, whose model takes seconds to
build. Press number n is drawn from n alone: `--show n` solves it again and prints it. A stopped run
goes on where it was, with the build that began it.
"""

from __future__ import annotations

import json
import time
from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Iterable

import numpy as np
import tomllib

import extreme
from engine import OUT, Rows, made, quantiles, table, text
from stability import DEFECT, FINE, LIMIT, WRONG, also, ask, by, counts, of_each, within
from verdict import judged

__all__ = ["also"]

ONE_THREAD = True
MADE_OF = ["env-core", "py/src"]
MADE_OF += [f"py/reports/{name}.py" for name in ("extreme", "verdict")]
ANSWERERS = {"fem": 0.1, "compliance": 0.2, "linear": 0.35, "surrogate": 0.35}
"""Models, and the share of presses that each solves: "linear" is `LinearPad`."""
SEED = 9
SAME_PAD = 50
"""Presses in a row on the same pad, with the same model."""
QUICK = 6
"""Presses of each model in the quick form."""
NAMES = ("shape", "kind", "mesh")
DEFECTS = OUT / "buried_defects.toml"


def options(parser: ArgumentParser) -> None:
    """Adds options: presses, time."""
    parser.add_argument("--presses", type=int, help="how many; 10 000 if not given")
    parser.add_argument("--hours", type=float, help="when to stop; 0.1 in the quick form")
    parser.add_argument("--jobs", type=int, default=2, help="processes; 2 if not given")
    parser.add_argument("--show", type=int, help="one press, printed")


def make(options: Namespace) -> dict:
    """Solves the presses that are missing."""
    if options.show is not None:
        shown = case(options.show)
        print(json.dumps(shown | {"found": judged(shown)}, indent=1))
        raise SystemExit
    rows = Rows.of("buried", options, MADE_OF, {"seed": SEED, "limit": LIMIT})
    numbers: Iterable[int] = range(options.presses or 10_000)
    if options.quick and options.presses is None:
        numbers = of_each(model_of, ANSWERERS, SAME_PAD, QUICK)
    missing = ({"number": n} | case(n) for n in numbers if n not in rows)
    until = time.monotonic() + 3600 * (options.hours or (0.1 if options.quick else 1e3))
    ask(rows, missing, options.jobs, until, rows.header["commit"])
    return rows.header | {"note": options.note} | summary(list(rows))


def case(number: int) -> dict:
    """Press of that number."""
    pad = extreme.draw_gel(pad_random(number), model_of(number))
    return pad | extreme.draw_buried(np.random.default_rng([SEED, 1, number]))


def model_of(number: int) -> str:
    """Model that solves the press of that number."""
    choice = np.random.default_rng([SEED, 2, number // SAME_PAD])
    return str(choice.choice(list(ANSWERERS), p=list(ANSWERERS.values())))


def pad_random(number: int) -> np.random.Generator:
    """Generator that draws the pad of the press of that number."""
    return np.random.default_rng([SEED, 0, number // SAME_PAD])


def summary(rows: list[dict]) -> dict:
    """Contents of the report, from all rows."""
    refused = [row for row in rows if row["verdict"] == "refused"]
    both = [row for row in rows if isinstance(row.get("lowered"), float)]
    return {
        "presses": len(rows),
        "wrong presses": sum(row["verdict"] not in FINE for row in rows),
        "by answerer": by(rows, lambda row: row["case"]["answerer"]),
        "why": dict(Counter(f"{row['case']['answerer']}: {row['why']}" for row in refused)),
        "axes": {axis: by(rows, within(axis)) for axis in ("depth", "size", "friction")}
        | {name: by(rows, lambda row, n=name: row["case"][n]) for name in NAMES},
        "lowered": {
            who: of | {"presses": len(some), "above 10 %": sum(one > 0.1 for one in some)}
            for who in ANSWERERS
            if (some := [row["lowered"] for row in both if row["case"]["answerer"] == who])
            and (of := quantiles(some))
        },
        "farthest": sorted(both, key=lambda row: -row["lowered"])[:10],
        "wrong": [row for row in rows if row["verdict"] not in FINE],
        "defects": tomllib.loads(DEFECTS.read_text())["defect"],
    }


PAGE = """# Presses that begin in the gel

Of {presses:,} presses with slender and small shapes whose first pose is in a pad already,
{solved:100*.1f} % are solved, {refused:100*.1f} % refused with an error that says why, and {bad}
wrong, silent, hung or ended by a panic. Where such a shape is taken to have come from is told with
[soft-body mechanics](../../py/docs/mechanics.md). Solved means what it means for [other extreme
presses](stability.md), above all that contact never pulls: the gel is pushed down as a whole where
a shape only goes down, and without friction no node is pulled (`py/reports/verdict.py`); and that
something is felt.

Shapes: {shapes}, of 0.2 to 2 mm radius, up to eight times as long, at any tilt, their lowest point
at 2 to 60 % of the depth of the gel. In three of ten presses they then move aside by up to 1.4 mm.
*linear* is `LinearPad`, *compliance* `Compliance` and *fem* `Fem` on 300 or 900 nodes, *surrogate*
the network. `python py/reports buried --show NUMBER` asks a press again.

## Defects found

{most} of the {bad} were with `Compliance` or `Fem`: slender shapes and sharp tips went in between
the points at which these feel contact. Since then the depth of a shape under the deformed skin is
measured after every frame, and each of the {most}, asked again, is refused as `penetrated`; the
rows below are of before. Press what is narrower than a millimetre where it meets the skin with
`LinearPad`, whose contact is finer, or give the pad more nodes. *Wrong* is how many of the {bad}
show an open defect.

{mended}

## By model

{answerers}

Named errors: {reasons}.

{wrong_ones}

## Beside the same shape that comes from above

Relative difference of the force at the first pose from that of the same shape led down to it. A
model that takes the shape to have come from another side answers another press, so a difference is
no error by itself; with friction the path matters, too.

{lowered_ones}

The farthest:

{farthest_ones}

## By what was asked

{shares}

{made}"""
FOUND = DEFECT | {"wrong": lambda defect: str(len(defect.get("known", [])) or "")}
LOWERED = {
    "model": "{who}",
    "presses": "{presses}",
    "median": "{median:.1e}",
    "95 %": "{95 %:.1e}",
    "above 10 %": "{above 10 %}",
}
FARTHEST = {
    "press": "{key}",
    "model": "{case[answerer]}",
    "shape": "{case[shape]}",
    "friction": "{case[friction]:.2f}",
    "depth (share of the gel's)": "{case[depth]:.2f}",
    "difference": "{lowered:.2f}",
}


def page(report: dict) -> str:
    """Conclusion, tables."""
    total: Counter = Counter()
    for counted in report["by answerer"].values():
        total.update(counted)
    why = sorted(report["why"].items(), key=lambda reason: -reason[1])
    return text(
        PAGE,
        report
        | {kind: total[kind] / report["presses"] for kind in FINE}
        | {"bad": len(report["wrong"])},
        most=sum(row["case"]["answerer"] in ("compliance", "fem") for row in report["wrong"]),
        mended=table(FOUND, report["defects"]),
        shapes=", ".join(extreme.SLENDER),
        answerers=counts(report["by answerer"], "model"),
        reasons=", ".join(f"{name} {n}" for name, n in why),
        wrong_ones=table(WRONG, report["wrong"][:100]) if report["wrong"] else "",
        lowered_ones=table(LOWERED, [{"who": who} | of for who, of in report["lowered"].items()]),
        farthest_ones=table(FARTHEST, report["farthest"]),
        shares="\n\n".join(counts(of, name) for name, of in report["axes"].items()),
        made=made(report),
    )
