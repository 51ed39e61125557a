"""The figures and the text of the stability report."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np
import tomllib
from kept import made, table

FINE = ("solved", "refused")
"""Verdicts that are neither wrong nor silent."""
DEFECTS = Path(__file__).with_name("stability_defects.toml")
AXES: dict[str, list[float]] = {
    "young": [1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9],
    "poisson": [0.0, 0.3, 0.45, 0.49, 0.499, 0.5],
    "friction": [0.0, 1e-9, 0.1, 0.5, 1.0, 5.001],
    "depth": [1e-3, 1e-2, 0.1, 0.3, 0.5, 0.7],
    "size": [5e-4, 1e-3, 2e-3, 4e-3, 8e-3],
}
"""Where the numbers of a press are cut into classes."""
NAMES = ("mesh", "law", "element", "shape", "kind", "sweeps")


def summary(rows: list[dict]) -> dict:
    """What the report holds of all rows."""
    presses = [row for row in rows if row["case"]["answerer"] != "environment"]
    scenes = [row for row in rows if row["case"]["answerer"] == "environment"]
    slow = sorted(rows, key=lambda row: -row["seconds"])[:10]
    return {
        "presses": len(rows),
        "by answerer": by(rows, lambda row: row["case"]["answerer"]),
        "asked by": asked_by(rows),
        "why": dict(Counter(reason(row) for row in rows if row["verdict"] == "refused")),
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


def reason(row: dict) -> str:
    """Why a press or a scene ended without an answer, and who says so."""
    return f"{row['case']['answerer']}: {row['why']}"


def asked_by(rows: list[dict]) -> dict[str, dict[str, int]]:
    """How many presses each build has answered, by answerer."""
    found: dict = defaultdict(Counter)
    for row in rows:
        found[row["case"]["answerer"]][row["by"]] += 1
    return {who: dict(found[who].most_common()) for who in sorted(found)}


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
    """How answers compare with those found another way."""
    found = {}
    for name in ("finer", "stiffer", "truth", "unfelt"):
        values = [row[name] for row in presses if name in row]
        numbers = [value for value in values if not isinstance(value, str)]
        if numbers:
            found[name] = {
                "compared": len(numbers),
                "refused": len(values) - len(numbers),
                "median": float(np.median(numbers)),
                "95 %": float(np.quantile(numbers, 0.95)),
                "most": max(numbers),
                "above 1 %": sum(number > 0.01 for number in numbers),
            }
    return found


def markdown(report: dict) -> str:
    """Conclusion, defects, tables."""
    long = report["long way"]
    parts = [
        "# Stability: what extreme presses do",
        conclusion(report),
        "## Defects found",
        defects(report["defects"]),
        "## Who answers",
        answerers(report["by answerer"], report["asked by"]),
        "Named errors: " + named(report["why"]) + ".",
        *wrong(report["wrong"]),
        "## Found another way",
        ways(long),
        "## By what was asked",
        "Share of presses solved; the rest is refused by name.",
        *(shares(axis, report["axes"][axis]) for axis in [*AXES, *NAMES]),
        "## Scenes",
        *(counts(report["scenes"][name], name) for name in report["scenes"]),
        "Farthest that an object moved with the hand away from it, friction 0.1 to 5, by length "
        "of a solver substep:",
        table(
            ["substep (ms)", "scenes", "most (mm)"],
            [
                [key, str(row["scenes"]), f"{1e3 * row['most']:.3f}"]
                for key, row in report["drift"].items()
            ],
        ),
        "## How long",
        slowest(report["seconds"]),
        made(report) + " Ask one again: `python tests/reports/stability.py --show NUMBER`.",
    ]
    return "\n\n".join(parts) + "\n"


def conclusion(report: dict) -> str:
    """Three sentences: how many, how many wrong, what is refused."""
    total = Counter()
    for counted in report["by answerer"].values():
        total.update(counted)
    bad = len(report["wrong"])
    solved = total["solved"] / report["presses"]
    return (
        f"Of {report['presses']} extreme presses and scenes, {100 * solved:.1f} % are solved, "
        f"{100 * total['refused'] / report['presses']:.1f} % refused by name, and {bad} wrong, "
        f"silent, hung or ended by a panic. A press takes {report['seconds']['median']:.2f} s in "
        f"the median and {report['seconds']['99 %']:.0f} s at the 99th percentile; the limit is "
        f"{report['sizes']['limit']:.0f} s. Solved means that every number is finite, forces "
        "balance within the stated tolerance, the wrench is the sum of the contact forces, and no "
        "shape is in the skin past the documented bound (`tests/reports/verdict.py`)."
    )


def defects(found: list[dict]) -> str:
    """What was found wrong, and the commit that mended it."""
    rows = [[d["what"], d["press"], d.get("mended", "open")] for d in found]
    return table(["defect", "press", "mended"], rows)


def counts(by: dict, head: str) -> str:
    """Verdicts by name."""
    return table(*counted_rows(by, head))


def answerers(by: dict, asked: dict[str, dict[str, int]]) -> str:
    """Verdicts by answerer, and which builds were asked, with how many presses where several."""
    head, rows = counted_rows(by, "answerer")
    for row in rows:
        some = asked[row[0]]
        row.append(", ".join(f"{c} ({n})" if len(some) > 1 else c for c, n in some.items()))
    return table([*head, "asked at commit"], rows)


def counted_rows(by: dict, head: str) -> tuple[list[str], list[list[str]]]:
    """Head and rows of a table of verdicts by name."""
    kinds = sorted({kind for counted in by.values() for kind in counted}, key=order)
    rows = [[name, *(str(counted.get(kind, 0)) for kind in kinds)] for name, counted in by.items()]
    return [head, *kinds], rows


def order(kind: str) -> tuple[int, str]:
    """Verdicts that are fine first."""
    return (FINE.index(kind) if kind in FINE else len(FINE), kind)


def named(why: dict) -> str:
    """Reasons by count."""
    return ", ".join(f"{name} {n}" for name, n in sorted(why.items(), key=lambda x: -x[1]))


def wrong(rows: list[dict]) -> list[str]:
    """The presses that are neither solved nor refused."""
    lines = [
        [str(row["key"]), row["case"]["answerer"], row["verdict"], row["why"]] for row in rows[:40]
    ]
    return [table(["press", "answerer", "verdict", "why"], lines)] if rows else []


def ways(long: dict) -> str:
    """Comparisons with other ways."""
    what = {
        "finer": "frictionless finite elements, steps a quarter as long: force",
        "stiffer": "finite elements, a body 16 times as stiff: displacement",
        "truth": "network that says it knows, against finite elements: force",
        "unfelt": "depth in the skin at which nothing is felt (m)",
    }
    rows = []
    for name, row in long.items():
        cells = [f"{row[key]:.1e}" for key in ("median", "95 %", "most")]
        above = str(row["above 1 %"]) if name != "unfelt" else "–"
        rows.append([what[name], str(row["compared"]), *cells, above])
    head = ["relative difference", "presses", "median", "95 %", "most", "above 1 %"]
    return table(head, rows) + (
        "\n\nWhere steps differ in force, both answers balance: an edge or a point on a coarse "
        "mesh, and a body that buckles, have more than one equilibrium."
    )


def shares(axis: str, counted: dict) -> str:
    """Share solved, class by class."""
    ends = {"young": "Young's modulus from (Pa)", "poisson": "Poisson's ratio from"}
    ends |= {"depth": "depth from (share of the thickness)", "size": "size from (m)"}
    head = ends.get(axis, axis + (" from" if axis == "friction" else ""))
    solved = {n: c.get("solved", 0) / sum(c.values()) for n, c in counted.items()}
    cells = [f"{100 * share:.0f} %" for share in solved.values()]
    return table([head, *(short(name) for name in solved)], [["solved", *cells]])


def short(name: str) -> str:
    """A number in few letters."""
    try:
        return f"{float(name):g}"
    except ValueError:
        return name


def slowest(seconds: dict) -> str:
    """The presses that took longest."""
    rows = [[str(key), who, f"{took:.0f}"] for key, who, took in seconds["slowest"]]
    return table(["press", "answerer", "s"], rows)
