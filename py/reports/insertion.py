"""Insertion: what pads feel of a block, a spiral search, and the smallest hole, half an hour.

A peg of InsertPeg is moved, shaken and let slide in the air, and pressed on the block, dragged over
it and inserted: the sum of what both pads feel has to be its mass times acceleration less gravity
and the block's force. A search on a spiral that knows of touch only yes or no is compared with the
scripted policy, which in turn is tried with narrower holes. --quick plays an episode of two cases
and few of one peg.
"""

from __future__ import annotations

from argparse import Namespace
from functools import partial
from typing import Any

import numpy as np

import insertion_cases as cases
import insertion_search as search
from engine import COLOURS, Rows, filled, made, plt, readable, run, spread, table, text
from load_cases import ARM, PERIOD, errors
from ruffini.evaluation import wilson

ONE_THREAD = True
MADE_OF = ["env-core", "py/src", "py/reports/insertion.py", "py/reports/insertion_cases.py"]
MADE_OF += ["py/reports/insertion_search.py", "py/reports/load_cases.py"]
MADE_OF += ["py/python/ruffini/policies/insert_peg.py", "py/python/ruffini/evaluation.py"]
MODELS = ("surrogate", "compliance")
SEEDS, EPISODES = 12, 60
QUICK = ("held", "dragged")
STATES = ("sticking", "transition", "sliding")
GOAL = 0.05
"""Largest 95th percentile of the error of force."""
CHANGES = {"below 2 %": 0.02, "2 to 10 %": 0.1, "10 to 30 %": 0.3, "above 30 %": np.inf}
"""Upper bounds of the change of the block's force in a control step over the scale of forces."""
RANGE, COMMON, NARROW = "0.5 to 2", (0.5, 1.0, 2.0), (0.1, 0.2, 0.3)
"""Clearances (mm): the task's range, others of both policies, those of the scripted one alone."""
ALL = "all"
POLICIES = ("scripted", "spiral")
BLUE, BROWN = COLOURS["linear"], COLOURS["paper"]
DRAWN = {"shaken": (0, "x"), "dragged": (0, "x"), "inserted": (2, "z")}
"""Cases that are drawn, and the component of the force."""


def make(options: Namespace) -> dict[str, Any]:
    """Episodes of each case with each model, then the searches."""
    quick = options.quick
    models, episodes = (MODELS[:1], 3) if quick else (MODELS, EPISODES)
    plays = cases.AIR | cases.BLOCK
    seeds = 1 if quick else SEEDS
    sizes = {"control step (ms)": 1e3 * PERIOD, "seeds of a case": seeds}
    sizes |= {"episodes of a search": episodes, "first seed of a search": search.FIRST_SEED}
    sizes |= {"arm of torques (mm)": 1e3 * ARM}
    rows = Rows.of("insertion", options, MADE_OF, sizes)
    asked: dict[str, tuple[Any, ...]] = {
        f"felt/{model}/{case}/{seed:02}": (felt, case, model, seed)
        for model in models
        for case in (QUICK if quick else plays)
        for seed in range(seeds)
    }
    for peg in cases.PEGS[:1] if quick else cases.PEGS:
        for clearance in (RANGE,) if quick else (RANGE, *COMMON, *NARROW):
            for policy in POLICIES[:1] if clearance in NARROW else POLICIES:
                key = f"search/{policy}/{peg}/{clearance}"
                asked[key] = (search.searched, policy, peg, width(clearance), episodes)
    run(rows, asked)
    moved = [row for row in rows if "case" in row]
    searches = pooled([row["search"] for row in rows if "search" in row])
    return rows.header | {
        "note": options.note,
        "felt": summary(moved),
        "pegs": by_peg(moved),
        "trembling": trembling(moved),
        "changes": changes(moved),
        "late": late(moved),
        "search": searches,
        "drawn": {row["case"]: row["drawn"] for row in moved if "drawn" in row},
    }


def width(clearance: float | str) -> float | None:
    """Clearance in m, ``None`` for the task's range."""
    return None if isinstance(clearance, str) else round(1e-3 * clearance, 7)


def felt(case: str, model: str, seed: int) -> dict[str, Any]:
    """Errors of each sample of an episode by its state of contact, and its course."""
    play = (cases.AIR | cases.BLOCK)[case]
    peg = cases.PEGS[seed % len(cases.PEGS)]
    record = play(peg, model, seed)
    found = cases.balance(record)
    on_block = case in cases.BLOCK
    judged = (found["most"] > cases.TOUCHED) == on_block
    slip = found["slip"]
    which = np.where((slip < 0.1).all(axis=1), 0, np.where((slip > 0.9).all(axis=1), 2, 1))
    columns: dict[str, Any] = {"change": found["change"]}
    for of in ("felt", "engine"):
        columns[of], torque = errors(found, of)
        columns[f"{of} aside"] = (
            cases.aside(record, found, of) if case in cases.FLAT else np.full(len(slip), np.nan)
        )
        # The block's torque is not known.
        columns[f"{of} torque"] = torque * (np.nan if on_block else 1.0)
    arrays, step = record.arrays(), found["step"]
    columns["off"] = (arrays["felt"] - arrays["engine"])[step, 2]
    columns["rise"] = (arrays["engine"][step] - arrays["engine"][step - 1])[:, 2]
    row: dict[str, Any] = {"case": case, "model": model, "seed": seed, "peg": peg}
    row |= {"ended": record.ended, "friction": record.look["friction"]}
    row["samples"] = {
        state: {
            name: [None if np.isnan(x) else float(x) for x in values[judged & (which == k)]]
            for name, values in columns.items()
        }
        for k, state in enumerate(STATES)
    }
    if seed == 0 and model == MODELS[0] and case in DRAWN:
        component, axis = DRAWN[case]
        drawn = {of: found[of][:, component] for of in ("needed", "felt")}
        drawn |= {"time": PERIOD * found["step"]}
        row["drawn"] = {of: [float(f"{x:.4g}") for x in values] for of, values in drawn.items()}
        row["drawn"] |= {"peg": peg, "axis": axis}
    return row


def values_of(rows: list[dict[str, Any]], name: str, states: Any = STATES) -> np.ndarray:
    """Values of samples by a name, not a number where one lacks it."""
    lists = [row["samples"][state][name] for row in rows for state in states]
    return np.array([x for values in lists for x in values], float)


def three(values: np.ndarray) -> dict[str, float] | None:
    """Median, 95th percentile and the worst, ``None`` of nothing."""
    known = values[~np.isnan(values)]
    if not len(known):
        return None
    median, high = np.quantile(known, [0.5, 0.95])
    return {"median": float(median), "p95": float(high), "worst": float(known.max())}


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Errors by case, model and state of contact."""
    found = []
    for case in cases.AIR | cases.BLOCK:
        for model in MODELS:
            of = [row for row in rows if row["case"] == case and row["model"] == model]
            for state in STATES:
                count = len(values_of(of, "felt", [state]))
                if not count:
                    continue
                entry: dict[str, Any] = {"name": f"{case}, {model}, {state}", "case": case}
                entry |= {"model": model, "state": state, "samples": count, "episodes": len(of)}
                named = {"force": "felt", "torque": "felt torque", "aside": "felt aside"}
                named |= {"engine": "engine", "engine torque": "engine torque"}
                named |= {"engine aside": "engine aside"}
                entry |= {name: three(values_of(of, key, [state])) for name, key in named.items()}
                entry["goal met"] = entry["force"]["p95"] <= GOAL
                found.append(entry)
    return found


def trembling(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Episodes in the air of which the median error of force is above the goal."""
    found = []
    for row in rows:
        of, force = values_of([row], "engine"), three(values_of([row], "felt"))
        if row["case"] in cases.AIR and force and force["median"] > GOAL:
            named = {k: row[k] for k in ("case", "model", "peg", "seed", "friction")}
            found.append(named | {"force": force, "engine": three(of)})
    return found


def changes(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Error of force on the block by how much the block's force changes in a control step."""
    found = []
    for model in MODELS:
        of = [row for row in rows if row["case"] in cases.BLOCK and row["model"] == model]
        change, force, low = values_of(of, "change"), values_of(of, "felt"), 0.0
        for name, high in CHANGES.items():
            which, low = (change >= low) & (change < high), high
            if which.any():
                entry = {"name": f"{model}, {name}", "model": model, "change": name}
                found.append(entry | {"samples": int(which.sum()), "force": three(force[which])})
    return found


def by_peg(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Error of the network's force by case and peg, whatever the state of contact."""
    found = []
    for case in cases.AIR | cases.BLOCK:
        for peg in cases.PEGS:
            named = {"case": case, "model": MODELS[0], "peg": peg}
            of = [row for row in rows if named.items() <= row.items()]
            if force := three(values_of(of, "felt")):
                found.append({"name": f"{case}, {peg}"} | named | {"force": force})
    return found


def late(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Share of a change of the upward force in a control step that is not felt.

    A straight line through 0 of what is felt less the rigid bodies' force over the change of the
    latter, by least squares: its slope, and the share of the squares that it explains.
    """
    found = []
    for model in MODELS:
        for case in cases.BLOCK:
            of = [row for row in rows if row["case"] == case and row["model"] == model]
            off, rise = values_of(of, "off"), values_of(of, "rise")
            if len(off):
                slope = float(off @ rise / (rise @ rise))
                rest = float(((off - slope * rise) ** 2).sum() / (off**2).sum())
                entry = {"name": f"{case}, {model}", "case": case, "model": model}
                found.append(entry | {"share": -slope, "explained": 1.0 - rest})
    return found


def pooled(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Searches by policy, clearance and peg, and of all pegs together."""
    found = []
    for policy in POLICIES:
        for clearance in (RANGE, *COMMON, *NARROW):
            of = [
                row
                for row in rows
                if row["policy"] == policy and row["clearance"] == width(clearance)
            ]
            of.sort(key=lambda row: cases.PEGS.index(row["peg"]))
            episodes, successes = (sum(row[k] for row in of) for k in ("episodes", "successes"))
            if len(of) > 1:
                endings: dict[str, int] = {}
                for row in of:
                    for name, count in row["endings"].items():
                        endings[name] = endings.get(name, 0) + count
                entry: dict[str, Any] = {"policy": policy, "peg": ALL}
                entry |= {"clearance": width(clearance)}
                entry |= {"episodes": episodes, "successes": successes, "endings": endings}
                entry |= {"success": successes / episodes}
                of.append(entry | {"interval": [*wilson(successes, episodes)]})
            for row in of:
                name = f"{policy}, {row['peg']}, {clearance} mm"
                found.append({"name": name, "width": f"{clearance}"} | row)
    return found


PAGE = """# Insertion: what pads feel of a block, a spiral search, the smallest hole

In [InsertPeg](../../py/docs/tasks.md#insertpeg) a hand holds a peg, 12 mm wide, between two soft
pads and inserts it into a hole of a block, which it has to find by touch. Three questions are
answered here: whether the forces on the pads are those that the peg's motion and the block call
for; what touch is worth, by a search that uses it as a yes or no only; and how narrow the hole may
be for the scripted policy.

{verdict}

![forces in three episodes, and successes by clearance](insertion.svg)

## Felt forces against motion and block

The sum of both pads' forces on the peg (channel `wrench`) has to be m (a − g) less the force of
the block, and in the air the sum of their torques about its centre of mass the rate of its angular
momentum. Acceleration and angular momentum are those of recorded poses, one each
{sizes[control step (ms)]:.0f} ms, as in [Force that is the load](load.md#how-it-is-compared); the
block's force is that of the channel `insertion`. Relative errors of force are |felt − needed| over
the sum of weight, |m a| and the block's force; those of torque over that force times
{sizes[arm of torques (mm)]:.0f} mm. *Rigid bodies* are the wrenches that the rigid-body engine
reports of the pads, in the same comparison: where they miss, too, it is not the gel. Models of the
gel are the network (*surrogate*) and linear elasticity (*compliance*).

The torque of the block is not among what an environment tells, so torques on the block are not
compared as such. Where the peg stands on the flat top (*pressed*, *dragged*, *pushed*), the felt
torque and the block's force tell where that force acts, and *aside* is how far that is from the
part of the tip that touches, which is what of it is within {low:1e6*.0f} µm of its lowest point.
In the hole (*inserted*) only forces are compared.

In the air: *held* still; *moved* and turned at random, as an agent may; *shaken* along the three
axes at an even 1 m/s², ten times as fast; *loosened* until it slides out of the hand. On the block:
*pressed* with up to {most:.0f} N; *dragged* over it under {press:.0f} N; *pushed* in a weak grip,
so that it slides up between the pads; *inserted*: an episode of the task with the scripted policy,
while it touches the block. A sample is *sticking* where `slip` of both pads is below 0.1, *sliding*
where both are above 0.9, and else in *transition*. The goal for force is {goal:100*.0f} % at the
95th percentile. Each row is of {sizes[seeds of a case]} seeds, with the three pegs in turn, other
masses, friction and tilt.

Median / 95th percentile / worst, in % of the above, of every sample.

{air}

On the block; *aside* is in mm.

{block}

{along_grip}

Force by peg, with the network: median / 95th percentile, in %.

{by_peg}

A round peg in the air is felt as the goal wants. A hexagonal peg settles in the hand over the first
few control steps of an episode, in which most of the worst of its errors lie when it is *held*.
With the network of 30 November 2026, those of *loosened* hexagonal pegs are nearly all of one
episode of four: for some steps at a time, shear on both pads jumps by 0.6 to 0.9 N, little beside a
grip of 10 N and much beside the 0.24 N that the peg weighs. The linear solution jumps by as much
where it follows the same motion, so it is not the network's correction; a motion by 0.02 mm is
enough (looked at by hand, once). The peg has sharp edges, which no grid of cells resolves. That
*aside* is 0.1 mm for the rigid bodies where a peg only leans says how near that comparison comes.

{trembles}

### What the errors on the block come from

Errors of force by the change of the block's force in a control step, over the same sum of forces.
In %, all cases on the block.

{changed}

The gel is asked once in a control step, at its end. In between, springs of the rigid-body engine
bear the peg, corrected by what they were off at the end of the step before. Where they are stiffer
than the gel, a change of the force within the step is felt for a part only. That part is missing
from the upward force, by a straight line through what is felt less what the rigid bodies have, over
the change of the latter in the step; *explained* is the share of the squares of that difference:

{lag}

## A search on a spiral

The *spiral* presses the peg on the block and moves it on an Archimedean spiral, {pitch:1e3*.1f} mm
from turn to turn, at {pace:1e3*.0f} mm/s, around the place where the hole is said to be. Of touch
it knows whether the pads feel more than {light:.0f} N upwards, and more than {firm:.0f} N, and no
direction. When the hand has sunk by {dropped:1e3*.1f} mm it takes the peg to be in, and pushes,
moving in the small circles and turns of the scripted policy, without giving way to the walls. Its
pitch was chosen between 0.9 and 2.4 mm by 30 episodes of other seeds each. The *scripted* policy
that comes with the package reads force and torque: it steers across the fingers by the torque,
sweeps along them, and gives way in the hole. Both have the task's 150 steps, 6 s. Success is that
the peg is in by 10 mm and held at the end of the episode. Seeds count from
{sizes[first seed of a search]}; in brackets are 95 % intervals (Wilson).

{spirals}

{both}

## The smallest clearance

Successes of the scripted policy by clearance, which is the width of the hole less that of the peg:
half of it is left on either side. Each is of {sizes[episodes of a search]} episodes. All else is
the task's: the hole up to 3 mm off in x and in y and turned by up to 5°, the peg tilted by up to
2°.

{narrow}

A round peg has no yaw to find. A square one, {square:.0f} mm wide, fits a hole that is 0.2 mm wider
only when it is turned to within {turn:.1f}° of it, which the scripted policy seeks by swinging to
and fro. Episodes that fail mostly run out of steps. Some end early, and are counted over all
clearances of a row: *dropped* is a peg that is out of the grip, *jammed* one that the hole pressed
with more than 25 N.

{thrown}

{made}"""
VERDICT = """Of {air count} groups of samples in the air, by case, model and state of contact,
{air met} meet the goal of {goal:100*.0f} % at the 95th percentile of the error of force; of
{block count} on the block {block met} do. {medians} Two things stand
behind the misses: [a change of the force within a control step is felt for a
part](#what-the-errors-on-the-block-come-from), and pegs with flat faces are felt worse at the start
of an episode and when they slide out.

With holes as the task draws them, the spiral inserts {spiral[success]:100*.1f} %
({spiral[interval][0]:100*.1f} to {spiral[interval][1]:100*.1f}, {spiral[episodes]} episodes), the
scripted policy {scripted[success]:100*.1f} % ({scripted[interval][0]:100*.1f} to
{scripted[interval][1]:100*.1f}). {narrowest}"""
MEDIANS = """With the network, force on a peg that is held still is off by {held:100*.2f} % in the
median (where it sticks), on one that is inserted by {inserted:100*.1f} %."""
NARROWEST = """In a hole that is 0.2 mm wider it inserts {round[success]:100*.0f} % of round pegs,
{square[success]:100*.0f} % of square and {hexagonal[success]:100*.0f} % of hexagonal ones."""
ROW: dict[str, Any] = {"case": "{case}", "model": "{model}", "contact": "{state}"}
ROW |= {"samples": "{samples}"}
ROW |= {"force": "{force[median]:100*.1f} / {force[p95]:100*.1f} / {force[worst]:100*.0f}"}
ROW |= {"goal": lambda row: "met" if row["goal met"] else "missed"}
TORQUE = {
    "torque": "{torque[median]:100*.1f} / {torque[p95]:100*.1f} / {torque[worst]:100*.0f}",
    "rigid bodies: force": spread("engine"),
    "rigid bodies: torque": spread("engine torque"),
}
ASIDE = {
    "aside (mm)": "{aside[median]:1e3*.2f} / {aside[p95]:1e3*.2f} / {aside[worst]:1e3*.1f}",
    "rigid bodies: force": spread("engine"),
    "rigid bodies: aside (mm)": "{engine aside[median]:1e3*.2f} / {engine aside[p95]:1e3*.2f}",
}
TREMBLES = """### Episodes that are off throughout

Episodes in the air in which more than half of the samples miss the goal (force: median / 95th
percentile, in %), of {episodes}:

{trembling}

A peg that is *held* and among them would tremble, to and fro within each control step, as some
square ones did before commit 260f342: a bristle of the elastic foundation under the edge of a peg
came and went with a force, because it felt a plane through the edge in place of the face beside
it."""
TREMBLE: dict[str, Any] = {"case": "{case}", "model": "{model}", "peg": "{peg}", "seed": "{seed}"}
TREMBLE |= {"friction": "{friction:.2f}", "force": spread("force")}
TREMBLE |= {"rigid bodies": spread("engine")}
THROWN = """*object_lost* is a defect of the environment: the peg leaves the scene. It is so in
{lost} of {episodes} episodes of both policies, of which {hexagonal} are of the hexagonal peg."""
LATE = {"case": "{case}", "model": "{model}", "missing (%)": "{share:100*.0f}"}
LATE |= {"explained (%)": "{explained:100*.0f}"}
ALONG_GRIP = """Rigid bodies miss by much where the hand accelerates along the line between the pads
(*shaken*): the engine's own account of the pads is wrong there, as
[the other report](load.md#a-hand-that-accelerates) found, and what is felt is not."""


def page(report: dict[str, Any]) -> str:
    """The three answers."""
    rows, found = report["felt"], report["search"]
    sizes = {"low": cases.LOW, "most": cases.MOST, "press": cases.PRESS, "goal": GOAL}
    sizes |= {"pitch": search.PITCH, "pace": search.PACE, "dropped": search.DROPPED}
    sizes |= {"light": search.LIGHT, "firm": search.FIRM}
    wide, gap = 12.0, 0.2
    sizes |= {"square": wide, "turn": np.degrees(gap / wide)}
    shaken = [row["engine"]["p95"] for row in rows if row["case"] == "shaken"]
    changed = {"model": "{model}", "change in a step": "{change}", "samples": "{samples}"}
    changed |= {"force": ROW["force"]}
    return text(
        PAGE,
        report | sizes,
        verdict=verdict(report),
        air=table(ROW | TORQUE, [row for row in rows if row["case"] in cases.AIR], absent="–"),
        block=table(ROW | ASIDE, [row for row in rows if row["case"] in cases.BLOCK], absent="–"),
        along_grip=text(ALONG_GRIP, report) if max(shaken, default=0.0) > GOAL else "",
        by_peg=pegs(report["pegs"]),
        trembles=trembles(report),
        changed=table(changed, report["changes"]),
        lag=table(LATE, report["late"]),
        spirals=by_clearance(found, POLICIES, (RANGE, *COMMON)),
        both=difference(report),
        narrow=by_clearance(found, POLICIES[:1], (*NARROW, *COMMON)),
        thrown=thrown(found),
        made=made(report),
    )


def pegs(rows: list[dict[str, Any]]) -> str:
    """A table with a row for each peg and a column for each case."""
    found: dict[str, dict[str, Any]] = {}
    for row in rows:
        found.setdefault(row["peg"], {"peg": row["peg"]})[row["case"]] = row["force"]
    columns = {"peg": "{peg}"} | {case: spread(case) for case in cases.AIR | cases.BLOCK}
    return table(columns, found.values(), absent="–")


def trembles(report: dict[str, Any]) -> str:
    """Episodes that are off throughout, if there are any."""
    if not report["trembling"]:
        return ""
    of = {(row["case"], row["model"]): row["episodes"] for row in report["felt"]}
    episodes = sum(count for (case, _), count in of.items() if case in cases.AIR)
    rows = table(TREMBLE, report["trembling"])
    return text(TREMBLES, {"episodes": episodes}, trembling=rows)


def thrown(found: list[dict[str, Any]]) -> str:
    """Number of episodes in which the peg is lost, if there are any."""
    rows = [row for row in found if row["peg"] != ALL]
    lost = {row["name"]: row["endings"].get("object_lost", 0) for row in rows}
    values = {"lost": sum(lost.values()), "episodes": sum(row["episodes"] for row in rows)}
    values["hexagonal"] = sum(count for name, count in lost.items() if "hexagonal" in name)
    return text(THROWN, values) if values["lost"] else ""


def one(found: list[dict[str, Any]], policy: str, clearance: float | str) -> dict[str, Any]:
    """A search of all pegs, or of the only one."""
    rows = [row for row in found if row["policy"] == policy and row["width"] == f"{clearance}"]
    return rows[-1] if rows else {}


def verdict(report: dict[str, Any]) -> str:
    """Goals that are met, and successes of both policies."""
    values: dict[str, Any] = {"goal": GOAL}
    for where, of in (("air", cases.AIR), ("block", cases.BLOCK)):
        rows = [row for row in report["felt"] if row["case"] in of]
        values |= {f"{where} count": len(rows)}
        values |= {f"{where} met": sum(row["goal met"] for row in rows)}
    medians = {
        row["case"]: row["force"]["median"]
        for row in report["felt"]
        if (row["model"], row["state"]) == (MODELS[0], STATES[0])
    }
    felt_by = text(MEDIANS, medians) if {"held", "inserted"} <= medians.keys() else ""
    values |= {policy: one(report["search"], policy, RANGE) for policy in POLICIES}
    named = {f"scripted, {peg}, 0.2 mm": peg.partition("-")[0] for peg in cases.PEGS}
    narrow = {named[row["name"]]: row for row in report["search"] if row["name"] in named}
    said = text(NARROWEST, narrow) if len(narrow) == len(cases.PEGS) else ""
    return text(VERDICT, values, medians=felt_by, narrowest=said)


def by_clearance(
    found: list[dict[str, Any]], policies: tuple[str, ...], clearances: tuple[Any, ...]
) -> str:
    """A table of successes with a row for each policy and peg, a column for each clearance."""
    rows = []
    for peg in (*cases.PEGS, ALL):
        for policy in policies:
            of = {
                row["width"]: row for row in found if (row["policy"], row["peg"]) == (policy, peg)
            }
            if any(f"{c}" in of for c in clearances):
                endings = {
                    name: sum(
                        of[f"{c}"]["endings"].get(name, 0) for c in clearances if f"{c}" in of
                    )
                    for name in sorted({name for row in of.values() for name in row["endings"]})
                }
                ended = ", ".join(f"{name} {count}" for name, count in endings.items() if count)
                rows.append({"policy": policy, "peg": peg, "ended": ended or "none", **of})
    columns: dict[str, Any] = {"peg": "{peg}", "policy": "{policy}"}
    columns |= {f"{c} mm": partial(cell, f"{c}") for c in clearances}
    return table(columns | {"ended early": "{ended}"}, rows, absent="–")


def cell(clearance: str, row: dict[str, Any]) -> str:
    """Success with its interval."""
    template = "{success:100*.0f} % ({interval[0]:100*.0f} to {interval[1]:100*.0f})"
    return filled(template, row[clearance])


DIFFERENCE = """Of all pegs, spiral against scripted: {pairs}. Each cell is of
{sizes[episodes of a search]} episodes of one peg, those of *all* of as many of each."""


def difference(report: dict[str, Any]) -> str:
    """Successes of both policies with all pegs."""
    found = report["search"]
    template = "{spiral[success]:100*.0f} % against {scripted[success]:100*.0f} %"
    pairs = []
    for clearance in (RANGE, *COMMON):
        both = {policy: one(found, policy, clearance) for policy in POLICIES}
        if all(both.values()):
            pairs.append(f"{filled(template, both)} at {clearance} mm")
    return text(DIFFERENCE, report, pairs=", ".join(pairs))


def figure(report: dict[str, Any]):
    """Forces in three episodes, and successes by clearance for each peg."""
    drawn, found = report["drawn"], report["search"]
    shown = [peg for peg in cases.PEGS if any(row["peg"] == peg for row in found)]
    picture, axes = plt.subplots(2, 3, figsize=(11, 6), layout="constrained")
    for axis, (case, course) in zip(axes[0], drawn.items(), strict=False):
        axis.plot(course["time"], course["needed"], color="black", lw=2.4, label="needed")
        axis.plot(course["time"], course["felt"], color=COLOURS["network"], lw=1.2, label="felt")
        axis.set(title=f"{case}: {course['peg']}", xlabel="time (s)")
        axis.set_ylabel(f"force on the peg along {course['axis']} (N)")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    for axis, peg in zip(axes[1], shown, strict=False):
        for policy, colour, shift in (("scripted", BLUE, 1.0), ("spiral", BROWN, 1.03)):
            rows = [
                row
                for row in found
                if (row["policy"], row["peg"]) == (policy, peg) and row["clearance"] is not None
            ]
            rows.sort(key=lambda row: row["clearance"])
            if not rows:
                continue
            widths = [1e3 * shift * row["clearance"] for row in rows]
            shares = np.array([[row["success"], *row["interval"]] for row in rows]).T
            bars = np.abs(shares[1:] - shares[0])
            axis.errorbar(widths, shares[0], bars, color=colour, marker="o", ms=3, label=policy)
        axis.set(title=peg, xlabel="clearance (mm)", ylabel="success", xscale="log", ylim=(0, 1.02))
        readable(axis)
        if axis.get_legend_handles_labels()[0]:
            axis.legend(fontsize=7, loc="lower right")
    for axis in [*axes[0][len(drawn) :], *axes[1][len(shown) :]]:
        axis.axis("off")
    return picture
