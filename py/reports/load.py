"""Force that is the load: wrenches of both pads against an object's motion, ten minutes.

An object between the pads is held still, shaken, lifted, moved, let swing about its contacts and
let slide out of a loosened grip. The sum of what both pads feel has to be the load: mass times
acceleration less gravity, and the rate of its angular momentum, both from recorded poses. Two more
tables ask when a loosened grip slips, beside Coulomb's law, and which markers slip when a load
grows, beside Cattaneo's and Mindlin's. --quick plays an episode of three cases, and of each table,
with the network alone.
"""

from __future__ import annotations

from argparse import Namespace
from typing import Any

import numpy as np

import load_cases as cases
import load_markers as markers
from engine import COLOURS, Rows, filled, made, plt, quantiles, run, spread, table, text

ONE_THREAD = True
MADE_OF = ["env-core", "py/src", "py/reports/load.py", "py/reports/load_cases.py"]
MADE_OF += ["py/reports/load_markers.py", "py/python/ruffini/policies/grasp_lift.py"]
MODELS = ("surrogate", "compliance", "fem")
SEEDS = {"surrogate": 10, "compliance": 10, "fem": 1}
QUICK = ("hanging", "moved", "sliding")
MARKED = {"fem": ("sphere", "cylinder", "prism", "ellipsoid")}
"""Objects whose markers are watched, where not all; under a cuboid it takes many minutes."""
STATES = ("sticking", "transition", "sliding")
GOALS = {"sticking": 0.02, "transition": 0.05, "sliding": 0.05}
"""Largest 95th percentile of the error of force."""
AFTER = (1, 2, 4, 8, 16, 32)
"""Steps after the start of a hold."""
FINER = ((4e-3, 4), (4e-3, 8), (2e-3, 4), (1e-3, 4))
"""Steps of the rigid bodies (s), and substeps of each."""
PERIODS = (0.04, 0.02, 0.008, 0.004)
"""Control steps in which an object swings (s)."""
GRIPS = (5.0, 8.0, 15.0)
"""Grips of an object that is held still for long (N)."""
DRAWN = {"hanging": 2, "shaken": 2, "lifted": 2, "moved": 0, "pivoting": 3, "sliding": 2}
"""Component of the wrench that is drawn, by case."""


def make(options: Namespace) -> dict[str, Any]:
    """Episodes of each case with every answerer, then the hand that accelerates in finer steps."""
    quick = options.quick
    models = MODELS[:1] if quick else MODELS
    sizes = {"control step (ms)": 1e3 * cases.PERIOD, "arm of torques (mm)": 1e3 * cases.ARM}
    sizes |= {"most acceleration of the hand (m/s²)": cases.LIMIT}
    sizes |= {f"seeds with {model}": 1 if quick else SEEDS[model] for model in models}
    rows = Rows.of("load", options, MADE_OF, sizes)
    asked = {
        f"{case}/{model}/{seed}": (episode, case, model, seed)
        for model in models
        for case in (QUICK if quick else cases.CASES)
        for seed in range(sizes[f"seeds with {model}"])
    }
    asked_too = {f"step/{k}": (stepped, *finer) for k, finer in enumerate(FINER)}
    for thing in ("prism",) if quick else cases.COMPACT:
        for model in models[:2]:
            asked_too |= {
                f"tremble/{thing}/{model}/{grip:02.0f}": (tremble, thing, model, grip)
                for grip in GRIPS
            }
    for model in models:
        for thing in cases.COMPACT[:1] if quick else MARKED.get(model, cases.COMPACT):
            asked_too[f"markers/{model}/{thing}"] = (marked, thing, model)
    for period in PERIODS[:1] if quick else PERIODS:
        asked_too[f"swing/{1e3 * period:02.0f}"] = (swinging, period, 1 if quick else 2)
    run(rows, asked | asked_too)
    found = [row for row in rows if row["key"] in asked]
    return rows.header | {
        "note": options.note,
        "table": summary(found),
        "objects": by_object(found),
        "settling": settling(found),
        "trembling": [row["tremble"] for row in rows if "tremble" in row],
        "steps": [row["steps"] for row in rows if "steps" in row],
        "swinging": sorted(
            (row["swinging"] for row in rows if "swinging" in row), key=lambda row: -row["period"]
        ),
        "onset": slips(found),
        "markers": sorted(
            (row["markers"] for row in rows if "markers" in row),
            key=lambda row: (MODELS.index(row["model"]), cases.COMPACT.index(row["object"])),
        ),
        "coulomb": coulomb(found),
        "episodes": {row["case"]: row["drawn"] for row in found if "drawn" in row},
    }


def episode(case: str, model: str, seed: int) -> dict[str, Any]:
    """Errors of each sample of an episode by its state of contact, and its course."""
    play, things = cases.CASES[case]
    thing = things[seed % len(things)]
    record = play(thing, model, seed)
    found = cases.balance(record)
    errors = {of: np.stack(cases.errors(found, of), axis=1) for of in ("felt", "engine")}
    slip = found["slip"]
    which = np.where((slip < 0.1).all(axis=1), 0, np.where((slip > 0.9).all(axis=1), 2, 1))
    row: dict[str, Any] = {"case": case, "model": model, "seed": seed, "object": thing}
    row |= {"friction": record.look["friction"], "ended": record.ended}
    row["errors"] = {
        state: {of: errors[of][which == k].tolist() for of in errors}
        for k, state in enumerate(STATES)
    }
    if case == "hanging":
        row["settling"] = {
            int(k): e for k, e in zip(found["step"], errors["felt"][:, 0], strict=True)
        }
    if case == "sliding":
        row["onset"] = cases.onset(record)
    if seed == 0 and model == "surrogate":
        drawn = {of: found[of][:, DRAWN[case]] for of in ("needed", "felt", "engine")}
        drawn |= {"time": cases.PERIOD * found["step"], "slip": slip.max(axis=1)}
        row["drawn"] = {of: [float(f"{x:.4g}") for x in values] for of, values in drawn.items()}
        row["drawn"]["object"] = thing
    return row


def stepped(step: float, substeps: int) -> dict[str, Any]:
    """Error of the load under even acceleration of the hand, for a step of the rigid bodies."""
    found = cases.excess(cases.moved("cuboid", "surrogate", 1, step, substeps))
    name = f"{1e3 * step:g} ms in {substeps}"
    return {"steps": {"name": name, "axes": found}}


def tremble(thing: str, model: str, grip: float) -> dict[str, Any]:
    """Residual motion of an object that is held still."""
    name = f"{thing} at {grip:.0f} N, {model}"
    found = cases.trembling(thing, model, grip)
    return {"tremble": {"name": name, "object": thing, "model": model, "grip": grip} | found}


def swinging(period: float, seeds: int) -> dict[str, Any]:
    """Errors of objects that swing about both contacts, for a time of a control step (s)."""
    apart: dict[str, list[np.ndarray]] = {}
    for thing in cases.OFF_CENTRE:
        for seed in range(seeds):
            record = cases.pivoting(thing, "surrogate", seed, period)
            poses = cases.balance(record)
            named = {"felt": (poses, "felt"), "rigid bodies": (poses, "engine")}
            named["rigid bodies by velocities"] = (cases.balance_of_velocities(record), "engine")
            for name, (found, of) in named.items():
                apart.setdefault(name, []).append(np.stack(cases.errors(found, of)))
    row: dict[str, Any] = {"name": f"{1e3 * period:.0f} ms", "period": period}
    for name, some in apart.items():
        force, torque = np.concatenate(some, axis=1)
        row[name] = {"samples": len(force), "force": three(force), "torque": three(torque)}
    return {"swinging": row}


def marked(thing: str, model: str) -> dict[str, Any]:
    """Slip of markers under a load that grows."""
    return {"markers": {"name": f"{thing}, {model}"} | markers.loaded(thing, model)}


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Errors by case, model and state of contact."""
    found = []
    for case in cases.CASES:
        for model in MODELS:
            of = [row for row in rows if row["case"] == case and row["model"] == model]
            for state in STATES if of else ():
                felt = np.concatenate([rows_of(row, state, "felt") for row in of])
                engine = np.concatenate([rows_of(row, state, "engine") for row in of])
                if not len(felt):
                    continue
                entry: dict[str, Any] = {"case": case, "model": model, "state": state}
                entry |= {"name": f"{case}, {model}, {state}", "samples": len(felt)}
                entry |= {"episodes": len(of), "force": three(felt[:, 0])}
                entry |= {"torque": three(felt[:, 1]), "engine": three(engine[:, 0])}
                entry |= {"engine torque": three(engine[:, 1])}
                entry["goal met"] = entry["force"]["p95"] <= GOALS[state]
                found.append(entry)
    return found


def by_object(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Errors of the network's force by case and object, whatever the state of contact."""
    found: dict[tuple[str, str], list[np.ndarray]] = {}
    for row in rows:
        if row["model"] == "surrogate":
            errors = [rows_of(row, state, "felt")[:, 0] for state in STATES]
            found.setdefault((row["case"], row["object"]), []).extend(errors)
    return [
        {"name": f"{case}, {thing}", "case": case, "object": thing}
        | {"force": three(np.concatenate(errors))}
        for (case, thing), errors in found.items()
    ]


def rows_of(row: dict[str, Any], state: str, of: str) -> np.ndarray:
    """Errors of force and torque (K, 2) of an episode."""
    return np.reshape(row["errors"][state][of], (-1, 2))


def three(values: np.ndarray) -> dict[str, float]:
    """Median, 95th percentile and the worst."""
    return quantiles(values, "p95") | {"worst": float(values.max())}


def settling(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Error of force of a hanging object by the number of steps since the start."""
    found = []
    for model in MODELS:
        of = [row["settling"] for row in rows if "settling" in row and row["model"] == model]
        for after in AFTER if of else ():
            # Keys of a row that is kept are text.
            errors = np.array([steps[str(after)] for steps in of if str(after) in steps])
            if len(errors):
                entry = {"name": f"{model} after {after}", "model": model, "after": after}
                found.append(entry | {"force": three(errors)})
    return found


def slips(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Onset of slip by episode."""
    named = ("model", "seed", "object", "friction")
    found = [{k: row[k] for k in named} | row["onset"] for row in rows if "onset" in row]
    return sorted(found, key=lambda row: (MODELS.index(row["model"]), row["friction"]))


def coulomb(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Grip at gross slip over that of Coulomb's law, by answerer."""
    found = {}
    for model in MODELS:
        onsets = [row["onset"] for row in rows if "onset" in row and row["model"] == model]
        ratios = [of["grip at gross slip"] / of["limit"] for of in onsets if of["gross slip"]]
        if ratios:
            found[model] = {"episodes": len(ratios), "median": float(np.median(ratios))}
            found[model] |= {"least": min(ratios), "most": max(ratios)}
    return found


PAGE = """# Force that is the load

An object that only the pads touch needs a known wrench: the sum of both pads' forces is m (a − g)
less the load and shaking of the task, and of their torques about its centre of mass the rate of its
angular momentum. Here the felt wrenches (channel `wrench`) are compared with that, by motion.
Models of the gel are the network (*surrogate*), linear elasticity (*compliance*) and finite
elements (*fem*).

{verdict}

![one episode of each case](load.svg)

## How it is compared

Motion is that of recorded poses, one each {sizes[control step (ms)]:.0f} ms; mass and shape are
known. The second difference of three poses is a mean of the acceleration over two control steps,
weighted by a triangle, and the felt wrench is given the same mean, (f₋ + 10 f + f₊)/12. Relative
errors of force are |felt − needed| over the sum of weight, |m a| and external force; those of
torque over that force times {sizes[arm of torques (mm)]:.0f} mm, about half the width of a contact.
The felt wrench is the gel model's own answer at the end of a control step, before it corrects the
springs that stand for the gel in the rigid-body engine; nothing corrects the answer itself. *Rigid
bodies* are the wrenches that the engine applies, springs and corrections, in the same
comparison. Where they miss the load too, part of the error is of the comparison (motion that is
quicker than its samples) or of the engine's account, not of the model of the gel.

The hand takes on the velocity of a command at the start of a step, at up to
{sizes[most acceleration of the hand (m/s²)]:.0f} m/s² (*moved*: 1 m/s²), so that the push is mostly
over at its end, where the wrench is felt, while the poses have all of it. That part is known from
the hand's own places and velocities, and is added to what is felt: m times the second difference of
its places, less the mean of what its limit leaves to the ends of steps. What the pads bear within a
step is not judged by this.

A sample is *sticking* where `slip` of both pads is below 0.1, *sliding* where both are above 0.9,
and else in *transition*. Goals are 2 % at the 95th percentile where it sticks, and 5 % elsewhere.
Each seed has another object, mass and friction. *Hanging*, *shaken*, *pivoting* and *sliding* are
HoldStill, *lifted* and *moved* GraspLift: lifted by the scripted policy, and then moved to and fro
along all three axes at an even 1 m/s². *Pivoting* objects are gripped 14 to 22 mm beside their
centre, and the grip falls until they swing. Resting on a pad cannot be asked: the hand turns about
the vertical alone, so that no pad ever faces up.

## By case

Median / 95th percentile / worst, in %, of all samples, the first of an episode among them.

{by_case}

Force by object, with the network: median / 95th percentile, in %.

{by_object}

## What the errors come from

### A start without the model of the gel

An episode of HoldStill begins with a grip that the springs of the rigid-body engine made alone. At
the end of the reset the model of the gel corrects them by all of the difference; that moves the
object, and each step corrects what is left, or 0.6 of it where the last went too far. (Up to commit
7ee6de2 each correction was 0.4 of it: 7.9 % were left after the first step in the median, 20 % at
worst.) Errors of the force on a hanging object by control steps since the start, in %:

{settled}

The same lag follows where contact changes faster than it is corrected, as in a grip that falls,
slides or lets swing.

### An object that trembles in the hand

The force up that pads feel of what is held under a steady load, and how far it moves up and down,
over the last 60 of 120 control steps of 40 ms; friction 0.9.

{trembling}

Up to commit 91c533d the prism at 15 N jumped by 0.6 mm and was led back by the corrections, over
and over, and shaken and sliding prisms did so, too (81 and 158 % at the 95th percentile). The
springs of a pad stand in rows 2.5 mm apart, and each pressed along the normal of the face that was
nearest to it: where the crease between two faces passed a row, the force of the whole row turned by
45° at once. Now it presses along the mean of the normals over its cell.

### A hand that accelerates

What is felt beyond the load, over the inertial force m a of the object, while a hand that carries a
cuboid accelerates evenly; 0 is right. By step of the rigid bodies, and the substeps in which the
engine moves them; 4 ms in 4 is the default.

{stepwise}

The first of these reports, at commit 2816960, found 8.5 along the grip and 1.1 across it and up in
the first row: pads felt a multiple of the inertial force. The balance of forces with the pads took
the object through a step at the velocity that it solved for, but the engine sped it up from substep
to substep, so that it ended (n − 1)/2n a Δt² short of that, after n substeps in Δt, where the model
of the gel was asked. Now a touched object gets the forces of a step as one impulse. Along the grip
the forces that the engine reports are still not those that move the object; nothing is felt by
them.

### A load that swings

*Pivoting* objects turn within few control steps, and the pads' forces with them. The same episodes
with the network, by the time of a control step, at whose end the gel is asked and the forces on the
object are corrected; median / 95th percentile, in %:

{swings}

Rigid bodies are compared with poses as above and, in the last columns, with the change of momentum
and angular momentum R I Rᵀ ω by recorded velocities, over two steps and by Simpson's rule. Both
comparisons say the same. At 40 ms rigid bodies miss the load by {still[force][median]:100*.1f} %
(force) and {still[torque][median]:100*.1f} % (torque) in the median, about a tenth and a quarter of
what is felt, so that the comparison is not what limits it. Felt errors fall with the control step,
those of forces nearly in proportion: they come of the motion between two answers of the gel,
through which the object goes under forces that belong to the first. Where the wrench of a swinging
object has to be right, set `physics={{"control_period": 0.008}}`, at the price of five times as
many steps.

{onset}

{by_marker}

{made}"""
ONSET = """## When a loosened grip slips

HoldStill under a steady load, the grip falling along a line from {start:.0f} N to nothing in
{steps} steps. Coulomb's law for two pads says that all slides where load = 2 μ grip. Gross slip is
the first step from which on the object moves by more than 0.1 mm past the pads in each; steps count
from where the grip begins to fall, by {fall:.2f} N each, and the first slip (`slip` above 0.1 on a
pad) is at step 1 where squeezing alone has made the rim of the contact slide.

{slips}

{gross}"""
BY_MARKER = """## Which markers slip when a load grows

HoldStill with a grip of {grip:.0f} N and friction {friction}, the load growing along a line for
half a second to {most} times what Coulomb's law holds, in control steps of {period:1e3*.0f} ms;
{across} × {along} markers, 1 mm apart. A marker in contact has slipped once the object moved past
it by {slipped:1e6*.0f} µm since the load began to grow, which a camera sees; gross slip is where
all have. Loads are T/μN, N being the felt normal force; by Coulomb's law gross slip is at 1, and
steps are predicted from the first slip to there. `slip` is that of the grip before the load grows.

{slips}

Share of the markers in contact that have slipped, by load. Cattaneo and Mindlin: where bodies of
like elasticity touch on a circle or ellipse, 1 − (1 − T/μN)^(2/3) of it slides (the last picture
above, with the network).

{shares}

Under the flat faces of cuboids and prisms markers slip as Cattaneo and Mindlin predict, with linear
elasticity from loads of 0.4 to 0.9, with the network to 0.6; below, few are past the 20 µm. Under
what is curved more of them slip, and earlier. A part of these contacts slides already when they are
pressed into the gel, which the theory leaves out, and the gel is a layer, no half-space; how much
each of these does is not known. Spheres and ellipsoids let go only above 1 with linear elasticity:
the tilted rim of a dent bears load, too. With the network markers in the middle creep by some 20 µm
before they slide, so that by this count the last of them slips too early.

{elements}
"""
CASE = {
    "case": "{case}",
    "model": "{model}",
    "contact": "{state}",
    "samples": "{samples}",
    "force": "{force[median]:100*.1f} / {force[p95]:100*.1f} / {force[worst]:100*.0f}",
    "goal": lambda row: "met" if row["goal met"] else "missed",
    "torque": "{torque[median]:100*.1f} / {torque[p95]:100*.1f} / {torque[worst]:100*.0f}",
    "rigid bodies: force": spread("engine"),
    "rigid bodies: torque": spread("engine torque"),
}
TREMBLE = {
    "object": "{object}",
    "model": "{model}",
    "grip (N)": "{grip:.0f}",
    "load (N)": "{load:.3f}",
    "felt (N)": "{least:.3f} to {most:.3f}",
    "moves by (µm)": "{moves:1e6*.1f}",
}
SWING = {"control step": "{name}", "samples": "{felt[samples]}"}
SWING |= {
    f"{of}: {what}": f"{{{of}[{what}][median]:100*.1f}} / {{{of}[{what}][p95]:100*.1f}}"
    for of in ("felt", "rigid bodies", "rigid bodies by velocities")
    for what in ("force", "torque")
}
MARKED_SLIP = {
    "model": "{model}",
    "object": "{object}",
    "`slip`": "{slip unloaded:.2f}",
    "first slip": "{first slip}",
    "gross slip": "{gross slip}",
    "steps between": "{steps between}",
    "steps predicted": "{predicted between}",
    "load at first slip": "{load at first slip:.2f}",
    "load at gross slip": "{load at gross slip:.2f}",
}
SLIP = {
    "model": "{model}",
    "object": "{object}",
    "friction": "{friction:.2f}",
    "load (N)": "{load:.2f}",
    "first slip": "{first slip}",
    "predicted": "{predicted}",
    "gross slip": "{gross slip}",
    "grip predicted (N)": "{limit:.2f}",
    "grip at gross slip (N)": "{grip at gross slip:.2f}",
    "`slip` at the predicted step": "{slip at predicted:.2f}",
}


def page(report: dict[str, Any]) -> str:
    """Errors by case, and onset of slip."""
    settled = {"model": "{model}", "step": "{after}"}
    settled |= {"median": "{force[median]:100*.2f}", "worst": "{force[worst]:100*.2f}"}
    stepwise: dict[str, Any] = {"step": "{name}"}
    for axis in report["steps"][0]["axes"]:
        stepwise[f"{axis}: felt"] = f"{{axes[{axis}][felt]:.2f}}"
        stepwise[f"{axis}: rigid bodies"] = f"{{axes[{axis}][engine]:z.2f}}"
    return text(
        PAGE,
        report | {"still": report["swinging"][0]["rigid bodies"]},
        verdict=verdict(report),
        by_case=table(CASE, report["table"]),
        trembling=table(TREMBLE, report["trembling"]),
        by_object=objects(report["objects"]),
        settled=table(settled, report["settling"]),
        stepwise=table(stepwise, report["steps"]),
        swings=table(SWING, report["swinging"]),
        onset=onset(report),
        by_marker=by_marker(report),
        made=made(report),
    )


def objects(rows: list[dict[str, Any]]) -> str:
    """A table with a row for each object and a column for each case."""
    found: dict[str, dict[str, Any]] = {}
    for row in rows:
        found.setdefault(row["object"], {"object": row["object"]})[row["case"]] = row["force"]
    columns = {"object": "{object}"}
    columns |= {case: spread(case) for case in dict.fromkeys(row["case"] for row in rows)}
    return table(columns, found.values(), absent="–")


VERDICT = """Of {count} groups of samples, by case, model and state of contact, {met} meet the
goals set below{names}. The force on what hangs still is felt right to {still:100*.2f} % sixteen
steps after the start (network, worst of its episodes), so signs and frames are right; the errors
are of starts and of contact that changes.
[What they come from](#what-the-errors-come-from)."""


def verdict(report: dict[str, Any]) -> str:
    """Number and names of the goals that are met."""
    met = [entry["name"] for entry in report["table"] if entry["goal met"]]
    [still] = [row for row in report["settling"] if row["name"] == "surrogate after 16"]
    values = {"count": len(report["table"]), "met": len(met), "still": still["force"]["worst"]}
    return text(VERDICT, values, names=f" ({'; '.join(met)})" * bool(met))


def onset(report: dict[str, Any]) -> str:
    """Grip at which a loosened grasp slips, against Coulomb's law."""
    start, steps = cases.START, cases.LOOSENING
    template = (
        "{median:.2f} times the grip of Coulomb's law ({least:.2f} to {most:.2f}, {episodes})"
    )
    gross = "; ".join(
        f"{model} at {filled(template, of)}" for model, of in report["coulomb"].items()
    )
    return text(
        ONSET,
        {"start": start, "steps": steps, "fall": start / steps},
        slips=table(SLIP, report["onset"], absent="–"),
        gross=f"Gross slip, median, range and number of episodes: {gross}.",
    )


def by_marker(report: dict[str, Any]) -> str:
    """Onset of slip by marker under a load that grows, against Cattaneo and Mindlin."""
    law = {str(ratio): float(markers.predicted(ratio)) for ratio in markers.RATIOS}
    rows = [{"model": "Cattaneo and Mindlin", "object": "–", "shares": law}, *report["markers"]]
    columns = {"model": "{model}", "object": "{object}"}
    columns |= {ratio: f"{{shares[{ratio}]:.2f}}" for ratio in law}
    across, along = markers.MARKERS
    sizes = {"grip": markers.GRIP, "friction": markers.FRICTION, "most": markers.MOST}
    sizes |= {"period": markers.PERIOD, "across": across, "along": along}
    return text(
        BY_MARKER,
        sizes | {"slipped": markers.SLIPPED},
        slips=table(MARKED_SLIP, report["markers"], absent="–"),
        shares=table(columns, rows, absent="–"),
        elements=elements(report["markers"]),
    )


def elements(rows: list[dict[str, Any]]) -> str:
    """Share of markers that slip early with finite elements and with linear elasticity."""
    at = str(markers.RATIOS[1])
    of = {(row["model"], row["object"]): row["shares"][at] for row in rows}
    things = [thing for model, thing in of if model == "fem" and ("compliance", thing) in of]
    if not things:
        return ""
    found = [f"{of['fem', one]:.2f} ({of['compliance', one]:.2f}) of a {one}'s" for one in things]
    return (
        f"With finite elements, at a load of {at}, these shares have slipped, in brackets with "
        f"linear elasticity: {', '.join(found)}; the law says {markers.predicted(float(at)):.2f}."
    )


def figure(report: dict[str, Any]):
    """Needed, felt and the rigid bodies' wrench in an episode of each case, and onset of slip."""
    episodes = report["episodes"]
    shape = (-(-(len(episodes) + 1) // 4), min(len(episodes) + 1, 4))
    picture, axes = plt.subplots(
        *shape, figsize=(4 * shape[1], 2.6 * shape[0]), layout="constrained", squeeze=False
    )
    names = ("x (along the grip)", "y", "z", "x (along the grip)", "y", "z")
    for axis, (case, drawn) in zip(axes.flat, episodes.items(), strict=False):
        component = DRAWN[case]
        unit = 1e3 if component > 2 else 1.0
        for of, label, colour, width in (
            ("needed", "the load", "black", 2.4),
            ("engine", "rigid bodies", "tab:gray", 1.2),
            ("felt", "felt, network", COLOURS["network"], 1.2),
        ):
            axis.plot(
                drawn["time"], [unit * x for x in drawn[of]], color=colour, label=label, lw=width
            )
        what = "torque about" if component > 2 else "force along"
        axis.set(title=f"{case}: {drawn['object']}", xlabel="time (s)")
        axis.set(ylabel=f"{what} {names[component]} ({'mN m' if component > 2 else 'N'})")
        axis.grid(alpha=0.3)
    axes[0][0].legend(fontsize=7)
    shares, *unused = axes.flat[len(episodes) :]
    for row in report["markers"]:
        if row["model"] == "surrogate":
            shares.plot(*np.transpose(row["course"]), label=row["object"], lw=1.2)
    load = np.linspace(0, 1, 101)
    shares.plot(load, markers.predicted(load), "k--", label="Cattaneo and Mindlin")
    shares.set(title="markers that slipped, network", xlabel="load T/μN", ylabel="share")
    shares.set(xlim=(0, 1.2))
    shares.grid(alpha=0.3)
    shares.legend(fontsize=7)
    for axis in unused:
        axis.axis("off")
    return picture
