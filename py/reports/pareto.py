"""Error against run time of every model, 80 minutes of one core; --quick measures a few.

Judged by quadratic finite elements on a mesh graded towards the contact. The full form also writes
what `ruffini recommend` reads, py/python/ruffini/answerers.json. Batches come last, by the clock:
all else on the machine must rest.
"""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pareto_cases
from engine import KEPT, OUT, ROOT, Rows, filled, made, plt, quantiles, run, table, text
from engine.figures import BLUE, BROWN, GREEN, LIGHT, RED
from engine.rows import header
from pareto_cases import ANSWERERS, ELEMENTS, FEW
from ruffini.evaluation import usable_cores

ONE_THREAD = True
PARTS = ("geometry", "deformation", "contact", "fem", "compliance")
TRUTH_OF = [f"env-core/src/{part}" for part in PARTS]
TRUTH_OF += ["py/reports/pareto_cases.py", "tests/reference/presses.py"]
"""Sources of the truth, which is solved anew when they change."""
MADE_OF = [*TRUTH_OF, "env-core/src/surrogate", "env-core/assets"]
FINEST = {"full": 2000, "quick": 400}
"""Nodes of the mesh of the truth, without those in the middle of edges."""
CHOICE = ROOT / "py/python/ruffini/answerers.json"
ERRORS = {"displacement": "u", "stress": "σ", "force": "force", "peak": "peak"}
PANELS = ("unseen", "deep", "tiny", "soft", "stiff")
TIME, ERROR = 0.05, 0.01
"""Relative differences of times and of errors up to which models count as equal."""


def options(parser: ArgumentParser) -> None:
    """Adds options: number of presses, processes, models."""
    parser.add_argument("--presses", type=int, default=14, help="most of a panel; 14 if not given")
    parser.add_argument("--jobs", type=int, default=2, help="processes; 2 if not given")
    parser.add_argument(
        "--again", nargs="+", metavar="NAME", choices=list(ANSWERERS), help="only these anew"
    )
    parser.add_argument(
        "--skip", nargs="+", default=[], metavar="PANEL/NAME", help="presses left out, by name"
    )


def make(options: Namespace) -> dict:
    """Presses, then batches; a report with only some answerers anew where those are named."""
    name = "pareto-again" if options.again else "pareto"
    nodes, quick, most = FINEST[options.form], options.quick, options.presses
    rows = Rows.of(name, options, MADE_OF, {"nodes of the truth": nodes})
    kept = KEPT / options.form / f"truth-{header(TRUTH_OF, {})['commit']}"
    names = asked(options)
    presses = {}
    known = pareto_cases.cases(quick, most)
    if unknown := set(options.skip) - set(known):
        raise SystemExit(f"--skip: found {min(unknown)}, expected some of {', '.join(known)}")
    for press in [press for press in known if press not in options.skip]:
        if lacking := [name for name in names if pareto_cases.key(press, name) not in rows]:
            presses[press] = (pareto_cases.rows, quick, most, press, lacking, nodes, kept)
    run(rows, presses, jobs=options.jobs)
    cores = usable_cores()
    batches = {
        f"batch/{name}/{threads}": (pareto_cases.batch, name, cores * (1 if quick else 4), threads)
        for name in names
        for threads in sorted({1, cores})
        if ANSWERERS[name].kind != "closed form"
    }
    run(rows, batches, jobs=1)
    skipped = f"Left out: {', '.join(options.skip)}." if options.skip else ""
    options.note = " ".join(filter(None, [skipped, options.note]))
    head, found = rows.header | {"note": options.note}, summary(list(rows))
    if options.again:
        before = json.loads((OUT / "pareto.json").read_text())
        own = f"Measured anew at commit {head['commit']}: {', '.join(options.again)}."
        note = " ".join(filter(None, [own, options.note]))
        return before | {"note": note} | renewed(before, found, options.again)
    return head | found


def asked(options: Namespace) -> list[str]:
    """Models to measure."""
    if options.again:
        return [ELEMENTS, *(name for name in options.again if name != ELEMENTS)]
    return FEW if options.quick else list(ANSWERERS)


def also(report: dict, out: Path, options: Namespace) -> None:
    """Writes the file that `ruffini recommend` reads."""
    if out == OUT:
        CHOICE.write_text(json.dumps(chosen(report), indent=1) + "\n")


def chosen(report: dict) -> dict:
    """Errors and time by panel and shipped answerer."""
    return {
        "commit": report["commit"],
        "machine": report["machine"],
        "panels": {
            panel: {
                name: {"use": row["use"], "ms": row["ms"], "errors": row["errors"]}
                for name, row in found.items()
                if "ms" in row and row["whole"] and row["shipped"]
            }
            for panel, found in report["panels"].items()
        },
    }


def summary(rows: list[dict]) -> dict:
    """Errors, time and front by panel, and the cost of the network's training."""
    measured = {row["answerer"] for row in rows}
    names = [name for name in ANSWERERS if name in measured]
    panels = {}
    for panel in PANELS:
        if part := [row for row in rows if row["panel"] == panel]:
            panels[panel] = {name: figures(part, name) for name in names}
    still = [row for row in rows if row["panel"] == "no contact" and "errors" in row]
    return {
        "panels": panels,
        "no contact": {row["answerer"]: max(row["errors"]["still"]) for row in still},
        "fronts": fronts(panels),
        "predicted": predicted([row for row in rows if row["panel"] in PANELS]),
        "break-even": break_even(panels),
        "batches": batches([row for row in rows if row["panel"] == "batch"]),
    }


def renewed(before: dict, found: dict, names: list[str]) -> dict:
    """A summary with the figures of `names` from another; answerers that are gone are left out."""

    def both(part: str, old: dict, new: dict) -> dict:
        kept = {name: row for name, row in old.get(part, {}).items() if name not in names}
        merged = kept | {name: row for name, row in new.get(part, {}).items() if name in names}
        return {name: merged[name] for name in ANSWERERS if name in merged}

    panels = {name: both(name, before["panels"], found["panels"]) for name in before["panels"]}
    parts = {part: both(part, before, found) for part in ("no contact", "predicted", "batches")}
    return {"panels": panels, "fronts": fronts(panels), "break-even": break_even(panels), **parts}


def figures(rows: list[dict], name: str) -> dict:
    """Median and 95th percentile of an answerer's errors by judge, its time and its failures.

    Over the presses that `ELEMENTS` solves: of one that it does not, only some tell.
    """

    def press(row: dict) -> str:
        return row["key"].rsplit("/", 1)[0]

    fair = {press(row) for row in rows if row["answerer"] == ELEMENTS and "failed" not in row}
    mine = [row for row in rows if row["answerer"] == name]
    solved = [row for row in mine if "failed" not in row and press(row) in fair]
    answerer = ANSWERERS[name]
    found: dict = {"kind": answerer.kind, "use": answerer.use, "shipped": answerer.shipped}
    found["presses"] = len(mine)
    found["failed"] = [row["failed"] for row in mine if "failed" in row]
    found["whole"] = len(solved) == len(fair)
    if solved:
        times = quantiles(1e3 * row["seconds"] for row in solved)
        found |= {"ms": times["median"], "ms 95 %": times["95 %"]}
    errors = {
        what: [error for row in solved for error in row.get("errors", {}).get(what, [])]
        for what in ERRORS
    }
    found["errors"] = {what: quantiles(some) for what, some in errors.items() if some}
    return found


def fronts(panels: dict) -> dict:
    """The front of each panel by each error."""
    return {panel: {what: front(found, what) for what in ERRORS} for panel, found in panels.items()}


def front(found: dict, what: str) -> list[str]:
    """Those that none beats in time and median error, fastest first.

    Among the answerers of all presses that `ELEMENTS` solves; an oracle only checks another.
    """
    known = [
        (row["ms"], row["errors"][what]["median"], name)
        for name, row in found.items()
        if what in row["errors"] and row["whole"] and row["kind"] != "oracle"
    ]
    return [one[-1] for one in sorted(known) if not any(beats(other, one) for other in known)]


def beats(other: tuple, one: tuple) -> bool:
    """Returns whether `other` is measurably better in time or error, and worse in neither."""
    (ms, error, _), (own_ms, own_error, _) = other, one
    faster, slower = ms < (1 - TIME) * own_ms, ms > (1 + TIME) * own_ms
    nearer, farther = error < (1 - ERROR) * own_error, error > (1 + ERROR) * own_error
    return (faster and not farther) or (nearer and not slower)


def break_even(panels: dict) -> dict:
    """Presses after which time saved against `ELEMENTS` has paid for a network's making."""
    found = {}
    for name, answerer in ANSWERERS.items():
        panel = next((rows for rows in panels.values() if name in rows), None)
        if panel is None or not answerer.made_from:
            continue
        saved = 1e-3 * (panel[ELEMENTS]["ms"] - panel[name]["ms"])
        presses = sum(answerer.made_from.values()) / saved if saved > 0 else None
        found[name] = answerer.made_from | {"presses": presses, "saved": saved}
    return found


def predicted(rows: list[dict]) -> dict:
    """Share of the frames in which a network's errors are within what it expects, by panel."""
    found: dict = {}
    for row in rows:
        errors = row.get("errors", {})
        if "predicted force" not in errors or ANSWERERS[row["answerer"]].kind == "oracle":
            continue
        panels = found.setdefault(row["answerer"], {})
        parts = panels.setdefault(row["panel"], {"frames": 0})
        parts["frames"] += len(errors["force"])
        for what in ("displacement", "stress", "force"):
            pairs = zip(errors[what], errors[f"predicted {what}"], strict=True)
            parts[what] = parts.get(what, 0) + sum(error <= bound for error, bound in pairs)
    return found


def batches(rows: list[dict]) -> dict:
    """Clock time a press of a batch (ms), by answerer and number of threads."""
    found: dict = {}
    for name in ANSWERERS:
        if mine := [row for row in rows if row["answerer"] == name]:
            times = {str(row["threads"]): 1e3 * row["seconds"] for row in mine}
            found[name] = {"ms": times} | {key: mine[0][key] for key in ("presses", "failed")}
    return found


PAGE = """# Error against run time: which model for which error

For each quantity the models that none of the others beats in both error and time (their *front*),
fastest first, with median error and CPU time a frame. These are among the models that solve every
press that *{elements}* solves; times within 5 % and errors within 1 % of each other count as equal:

{fronts_in_words}

![error against run time](pareto.svg)

Errors against quadratic elements (p2) on a mesh of {sizes[nodes of the truth]} vertices, graded
towards where the undeformed face lies inside the shape, carried to the model mesh of 900 nodes;
relative L² a frame over vertices or tetrahedra, each counted once, median / 95th percentile (of 12
frames in a panel of four presses, nearly the worst), in %. How far the truth itself is off can be
told from the rows of coarser meshes of its kind (*fem p2, graded*). Over the presses that
*{elements}* and the truth solve; unsolved are counted of all. Time is CPU time a frame on one
thread, median over presses, without meshing and factorising the elastic pad. Bold: on the front of
displacement.

*Network* and *linear, on cells* are what environments feel with (`tactile="surrogate"` and
`"compliance"`): a network, and the linear elasticity that it corrects, with contact on fine cells.
*By Candle* is the network by Candle's own layers, which checks ours. *Compliance* is linear
elasticity with contact at points of the mesh, or *at nodes*, of 2,000 nodes if not said; a
*correction* is one towards finite elements. *Fem* is finite elements: linear (p1), linear and free
of locking (p1-bar) or quadratic (p2), with about how many nodes, and the force that may be out of
balance (0.1 µN if not said). *Paper's B* is a network of DefGraspNets, trained on grasps alone
([page](paper.md)), the *bonded layer* a closed form of the force under a ball.

Presses: *unseen* are drawn at random as in [unseen.md](unseen.md), with other numbers: indenters of
families that the network never saw, with features of 0.5 to 10 mm, pressed 5 µm to 2 mm deep into
gels of 10 kPa to 3 MPa, frames at half the depth and at all of it, each reached in four load steps.
In the other panels balls of 2, 4 and 8 mm and a block of 5 mm (radius, half an edge) are
pressed straight down: *deep* 1.6 to 2.4 mm, *tiny* 5 to 50 µm, *soft* into a gel of 20 kPa and
*stiff* into one of 5 MPa, both 0.3 to 1 mm. *u* is displacement, *σ* von Mises stress, *force* the
net force, *peak* the stress where it is highest.

{tables}

## What the network expects of itself

Share of the frames in which an error is within `predicted_error`, which is to be 95 %.

{expected}

## In batches

{balls} balls of 3 to 8 mm, pressed 0.6 mm from rest in five frames, by one call; by the clock, the
quickest repetition. Less exact than the times of frames above: a share of the ideal over 100 % is
noise of the machine.

{in_batches}

## Nothing touches

{still}

## What a network costs before its first answer

{training}

The break-even is the number of frames after which answering by *{elements}* would have cost more.

{made} Rapier's own soft bodies stand [elsewhere](mechanics.md)."""
HOURS = ("data", "training")
TRAINING = {
    "network": "{name}",
    "data (core h)": "{hours[data]}",
    "training (core h)": "{hours[training]}",
    "saved a frame (ms)": "{saved:1e3*.0f}",
    "break-even": lambda row: (
        ("" if "training" in row else "> ")
        + (f"{row['presses']:,.0f}" if row["presses"] else "never")
    ),
}


def page(report: dict) -> str:
    """Conclusion, a table for each panel, costs."""
    batches = report["batches"]
    training = [
        {"name": name, "hours": {p: f"{cost[p] / 3600:.2f}" for p in HOURS if p in cost}} | cost
        for name, cost in report["break-even"].items()
    ]
    return text(
        PAGE,
        report | {"balls": max(one["presses"] for one in batches.values())},
        fronts_in_words=conclusion(report),
        tables="\n\n".join(panel(name, of, report) for name, of in report["panels"].items()),
        elements=ELEMENTS,
        expected=expected(report["predicted"]),
        in_batches=in_batches(batches),
        still=still(report["no contact"]),
        training=table(TRAINING, training, absent="–"),
        made=made(report),
    )


def conclusion(report: dict) -> str:
    """The front of the first panel in words."""
    name, found = next(iter(report["panels"].items()))
    lines = []
    for what in ("force", "displacement", "stress"):
        steps = "; ".join(
            f"{n} {100 * found[n]['errors'][what]['median']:.1f} % in {short(found[n]['ms'])} ms"
            for n in report["fronts"][name][what]
        )
        lines.append(f"- **{what}**, {name}: {steps}.")
    return "\n".join(lines)


def short(ms: float) -> str:
    """A time in three digits."""
    return f"{ms:.3g}" if ms < 1e3 else f"{ms:,.0f}"


def panel(name: str, found: dict, report: dict) -> str:
    """A panel's table; members of the front of displacement are bold."""
    front = report["fronts"][name]["displacement"]
    rows = [
        {"name": f"**{answerer}**" if answerer in front else answerer} | row
        for answerer, row in found.items()
        if "ms" in row
    ]
    columns = {"model": "{name}", "ms": lambda row: short(row["ms"])}
    columns |= {title: error_cell(what) for what, title in ERRORS.items()}
    columns["unsolved"] = lambda row: (
        f"{len(row['failed'])} of {row['presses']}" if row["failed"] else ""
    )
    presses = max(row["presses"] for row in found.values())
    return f"## {name.capitalize()}, {presses} presses\n\n" + table(columns, rows, absent="–")


def error_cell(what: str):
    """A column: median and 95th percentile."""
    return lambda row: filled("{median:100*.1f} / {95 %:100*.1f}", row["errors"][what])


def expected(found: dict) -> str:
    """Shares of frames whose errors are within what a network expects, by panel."""
    rows = [
        {"name": name, "panel": panel} | parts
        for name, panels in found.items()
        for panel, parts in panels.items()
    ]
    columns: dict = {"network": "{name}", "panel": "{panel}", "frames": "{frames}"}
    for what, title in list(ERRORS.items())[:3]:
        columns[title] = lambda row, what=what: f"{100 * row[what] / row['frames']:.0f} %"
    return table(columns, rows, absent="–")


def in_batches(found: dict) -> str:
    """Time a press on one thread and on all, and how well the threads are used."""
    threads = max(int(count) for one in found.values() for count in one["ms"])
    rows = [
        {"name": name, "slow": one["ms"]["1"], "fast": one["ms"][str(threads)]} | one
        for name, one in found.items()
    ]
    columns = {
        "model": "{name}",
        "ms a press, one thread": "{slow:.3g}",
        f"{threads} threads": "{fast:.3g}",
        "of ideal": lambda row: f"{100 * row['slow'] / row['fast'] / threads:.0f} %",
        "unsolved": lambda row: str(row["failed"] or ""),
    }
    return table(columns, rows)


def still(found: dict) -> str:
    """Largest displacement that is answered where nothing touches."""
    worst = max(found.values(), default=0.0)
    who = [name for name, most in found.items() if most == worst]
    if not worst:
        return f"A ball 0.1 and 1 mm over the gel: exactly zero from all {len(found)} models."
    return f"A ball over the gel: up to {worst:.1e} m from {', '.join(who)}."


@dataclass(frozen=True)
class Series:
    """Answerers that differ in one thing, joined by a line."""

    marker: str
    colour: str
    members: dict[str, str]
    """Label of each point, by the answerer's name."""


SERIES = {
    "closed form of a bonded layer": Series("s", "#7f7f7f", {"bonded layer": ""}),
    "network": Series("*", RED, {"network": "network"}),
    "network by Candle's layers": Series("x", RED, {"network, by Candle": ""}),
    "linear solution on cells": Series("P", BLUE, {"linear, on cells": "linear"}),
    "linear solution, by nodes": Series(
        "o", "#90cdf4", {"compliance 1000": "1000", "compliance": ""}
    ),
    "linear solution, by corrections": Series(
        "o",
        BLUE,
        {
            "compliance": "0",
            "compliance, 1 correction": "1",
            "compliance, 6 corrections": "6",
        },
    ),
    "linear solution without friction": Series("s", BLUE, {"compliance, no friction": ""}),
    "linear solution at nodes": Series("D", BLUE, {"compliance at nodes": ""}),
    "the paper's network B": Series("X", BROWN, {"paper's B": "B"}),
    "finite elements p1": Series("v", LIGHT, {"fem p1 2000": "2000"}),
    "finite elements p2, graded, by nodes": Series(
        "s", LIGHT, {f"fem p2 {n}, graded": f"{n}" for n in (500, 1000)}
    ),
    "finite elements p1-bar, by nodes": Series(
        "^", GREEN, {f"fem p1-bar {n}": f"{n}" for n in (500, 1000, 2000, 3000)}
    ),
    "the same, graded": Series(">", GREEN, {"fem p1-bar 2000, graded": "graded"}),
    "the same on 2,000, by tolerance": Series(
        "<", GREEN, dict.fromkeys(("fem p1-bar 2000, 1 mN", "fem p1-bar 2000"), "")
    ),
}
TITLES = {"displacement": "u", "stress": "σ", "force": "net force"}


def figure(report: dict):
    """Median error against time: three errors of the first panel, then u of the others."""
    panels = list(report["panels"])
    shown = [(panels[0], what) for what in TITLES] + [(p, "displacement") for p in panels[1:]]
    columns = max(4, -(-(len(shown) + 1) // 2))
    picture, axes = plt.subplots(2, columns, figsize=(4 * columns, 8), layout="constrained")
    for axis in axes.flat[len(shown) :]:
        axis.set_axis_off()
    for (panel, what), axis in zip(shown, axes.flat, strict=False):
        scatter(axis, report["panels"][panel], what, report["fronts"][panel][what])
        axis.set(title=f"{panel}: {TITLES[what]}", xlabel="CPU ms a frame", ylabel="%")
    drawn = {
        name
        for panel, what in shown
        for name, row in report["panels"][panel].items()
        if what in row["errors"]
    }
    legend(axes.flat[-1], drawn)
    return picture


def scatter(axis, found: dict, what: str, front: list[str]) -> None:
    """Every answerer's median, a bar up to its 95th percentile, and the front as a band."""
    for series in SERIES.values():
        known = [name for name in series.members if what in found.get(name, {}).get("errors", {})]
        medians = [100 * found[name]["errors"][what]["median"] for name in known]
        times = [found[name]["ms"] for name in known]
        axis.plot(times, medians, series.marker + "-", color=series.colour, lw=0.8, **size(series))
        for name, ms, median in zip(known, times, medians, strict=True):
            most = 100 * found[name]["errors"][what]["95 %"]
            axis.plot([ms] * 2, [median, most], color=series.colour, alpha=0.2, linewidth=1)
            axis.annotate(series.members[name], (ms, median), color=series.colour, **beside(name))
    line = [(found[name]["ms"], 100 * found[name]["errors"][what]["median"]) for name in front]
    axis.plot(*zip(*line, strict=True), color="black", linewidth=6, alpha=0.15, zorder=0)
    axis.set(xscale="log", yscale="log")
    # Room for what stands beside the last point.
    axis.margins(x=0.14)
    axis.yaxis.set_major_formatter("{x:g}")
    axis.yaxis.set_minor_formatter(lambda x, _: f"{x:g}" if f"{x:e}"[0] in "25" else "")
    axis.tick_params(axis="y", which="minor", labelsize=6)
    axis.grid(alpha=0.3, which="both")


def beside(name: str) -> dict[str, Any]:
    """Where the label of a point stands: up to the right, that of the linear solution to the left.

    The network may be as fast and as near as that.
    """
    if name == "linear, on cells":
        place: dict[str, Any] = {"xytext": (-4, -9), "ha": "right"}
    else:
        place = {"xytext": (4, 3)}
    return place | {"textcoords": "offset points", "fontsize": 6}


def size(series: Series) -> dict[str, float]:
    """Size of its markers."""
    return {"markersize": 9 if series.marker == "*" else 5}


def legend(axis, drawn: set[str]) -> None:
    """Names of the series that are drawn, and of the front, on an axis of their own."""
    for title, series in SERIES.items():
        if drawn.isdisjoint(series.members):
            continue
        axis.plot([], [], series.marker, color=series.colour, label=title, **size(series))
    axis.plot([], [], color="black", linewidth=6, alpha=0.15, label="front")
    axis.plot([], [], color="grey", alpha=0.4, linewidth=1, label="median to 95th percentile")
    axis.legend(fontsize=8, loc="center left", frameon=False)
