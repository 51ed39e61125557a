"""The figures and the text of the report on error against run time."""

from __future__ import annotations

import numpy as np
import pareto_batch
from kept import made, table
from pareto_answerers import ANSWERERS, ELEMENTS

ERRORS = ("displacement", "stress", "force", "peak")
JUDGES = ("finest", ELEMENTS)
PANELS = ("held-out", "deep", "tiny", "soft", "stiff")
TIME, ERROR = 0.05, 0.01
"""Relative differences of times and of errors that tell nothing."""


def summary(rows: list[dict]) -> dict:
    """Errors, time and front by panel, and what the network's training has cost."""
    asked = {row["answerer"] for row in rows}
    names = [name for name in ANSWERERS if name in asked]
    report: dict = {"panels": {}}
    for panel in PANELS:
        if part := [row for row in rows if row["panel"] == panel]:
            report["panels"][panel] = {name: figures(part, name) for name in names}
    still = [row for row in rows if row["panel"] == "no contact" and "finest" in row]
    report["no contact"] = {row["answerer"]: max(row["finest"]["still"]) for row in still}
    report["fronts"] = fronts(report["panels"])
    report["known"] = known([row for row in rows if row["panel"] in PANELS])
    report["break-even"] = break_even(report)
    report["batches"] = batches([row for row in rows if row["panel"] == pareto_batch.PANEL])
    return report


def renewed(before: dict, found: dict, names: list[str]) -> dict:
    """A summary with the figures of `names` from another; answerers that are gone are left out."""

    def both(part: str, old: dict, new: dict) -> dict:
        kept = {name: row for name, row in old.get(part, {}).items() if name not in names}
        merged = kept | {name: row for name, row in new.get(part, {}).items() if name in names}
        return {name: merged[name] for name in ANSWERERS if name in merged}

    panels = {
        name: both(name, before["panels"], found["panels"])
        for name in PANELS
        if name in before["panels"]
    }
    parts = {part: both(part, before, found) for part in ("no contact", "known", "batches")}
    return {
        "panels": panels,
        "fronts": fronts(panels),
        "break-even": break_even({"panels": panels}),
        **parts,
    }


def fronts(panels: dict) -> dict:
    """The front of each panel by each error."""
    return {panel: {what: front(found, what) for what in ERRORS} for panel, found in panels.items()}


def press(row: dict) -> str:
    """The press that a row is about."""
    return row["key"].rsplit("/", 1)[0]


def figures(rows: list[dict], name: str) -> dict:
    """Median and 95th percentile of an answerer's errors by judge, its time and its failures.

    Over the presses that `ELEMENTS` solves: of one that it does not, only some tell.
    """
    fair = {press(row) for row in rows if row["answerer"] == ELEMENTS and "failed" not in row}
    mine = [row for row in rows if row["answerer"] == name]
    solved = [row for row in mine if "failed" not in row and press(row) in fair]
    answerer = ANSWERERS[name]
    found: dict = {"kind": answerer.kind, "use": answerer.use, "shipped": answerer.shipped}
    found["presses"] = len(mine)
    found["failed"] = [row["failed"] for row in mine if "failed" in row]
    found["whole"] = len(solved) == len(fair)
    if solved:
        found["ms"] = 1e3 * float(np.median([row["seconds"] for row in solved]))
        found["ms 95 %"] = 1e3 * float(np.quantile([row["seconds"] for row in solved], 0.95))
    for judge in JUDGES:
        errors: dict[str, list[float]] = {}
        for row in solved:
            for what in ERRORS:
                if what in row.get(judge, {}):
                    errors.setdefault(what, []).extend(row[judge][what])
        found[judge] = spread(errors)
    return found


def front(found: dict, what: str) -> list[str]:
    """Those that none beats in time and median error, fastest first.

    Among the answerers of all presses that `ELEMENTS` solves; an oracle only checks another.
    """
    known = [
        (row["ms"], row["finest"][what]["median"], name)
        for name, row in found.items()
        if what in row["finest"] and row["whole"] and row["kind"] != "oracle"
    ]
    return [one[-1] for one in sorted(known) if not any(beats(other, one) for other in known)]


def beats(other: tuple, one: tuple) -> bool:
    """Whether another is measurably better, in time or error, and measurably worse in neither."""
    (ms, error, _), (own_ms, own_error, _) = other, one
    faster, slower = ms < (1 - TIME) * own_ms, ms > (1 + TIME) * own_ms
    nearer, farther = error < (1 - ERROR) * own_error, error > (1 + ERROR) * own_error
    return (faster and not farther) or (nearer and not slower)


def break_even(report: dict) -> dict:
    """Presses after which a network's data and training are paid for by time saved against
    `ELEMENTS`.
    """
    found = {}
    for name, answerer in ANSWERERS.items():
        panel = next((rows for rows in report["panels"].values() if name in rows), None)
        if panel is None or not answerer.made_from:
            continue
        spent = sum(answerer.made_from.values())
        saved = 1e-3 * (panel[ELEMENTS]["ms"] - panel[name]["ms"])
        presses = spent / saved if saved > 0 else None
        found[name] = answerer.made_from | {"presses": presses, "saved": saved}
    return found


def known(rows: list[dict]) -> dict:
    """Errors of networks on the finest mesh where they say that they know, and where not."""
    found: dict = {}
    for row in rows:
        errors = row.get("finest", {})
        for what in ("displacement", "force"):
            if "known" not in errors or what not in errors:
                continue
            parts = found.setdefault(row["answerer"], {"known": {}, "not known": {}})
            for knows, error in zip(errors["known"], errors[what], strict=True):
                part = parts["known" if knows else "not known"]
                part.setdefault(what, []).append(error)
    return {
        name: {
            part: {"frames": len(errors.get("displacement", []))} | spread(errors)
            for part, errors in parts.items()
        }
        for name, parts in found.items()
    }


def spread(errors: dict[str, list[float]]) -> dict:
    """Median and 95th percentile of each."""
    return {
        what: {"median": float(np.median(values)), "95 %": float(np.quantile(values, 0.95))}
        for what, values in errors.items()
    }


def batches(rows: list[dict]) -> dict:
    """Clock time a press of a batch (ms), by answerer and number of threads."""
    found: dict = {}
    for name in ANSWERERS:
        if mine := [row for row in rows if row["answerer"] == name]:
            times = {str(row["threads"]): 1e3 * row["seconds"] for row in mine}
            found[name] = {
                "ms": times,
                "presses": mine[0]["presses"],
                "failed": mine[0]["failed"],
            }
    return found


def chosen(report: dict) -> dict:
    """What `ruffini recommend` reads: errors and time by panel and shipped answerer."""
    return {
        "commit": report["commit"],
        "machine": report["machine"],
        "panels": {
            panel: {
                name: {"use": row["use"], "ms": row["ms"], "errors": row["finest"]}
                for name, row in found.items()
                if "ms" in row and row["whole"] and row["shipped"]
            }
            for panel, found in report["panels"].items()
        },
    }


def markdown(report: dict) -> str:
    """Conclusion, a table for each panel, costs."""
    parts = [
        "# Error against run time: which answerer for which error",
        conclusion(report),
        "![error against run time](pareto.svg)",
        f"Errors against p1-bar on the finest mesh ({report['sizes']['nodes of the truth']} nodes, "
        "itself about 4 % off in displacement and 8 % in stress, see [fem.md](fem.md)), carried to "
        "the model mesh of 900 nodes; relative L² a frame, median / 95th percentile, in %. "
        "In brackets against p1-bar on 2,000 nodes. Over the presses that these solve; unsolved "
        "are counted of all. *network* is `Surrogate()`, *linear, on cells* the answer that it "
        "corrects; *compliance* feels contact at points of a mesh. Time is CPU time a frame on "
        "one thread, median over presses.",
        *(panel(name, found, report) for name, found in report["panels"].items()),
        "## Whether a network knows",
        knowing(report["known"]),
        "## In batches",
        in_batches(report["batches"]),
        "## Nothing touches",
        still(report["no contact"]),
        "## What a network costs before its first answer",
        training(report["break-even"]),
        made(report) + " Rapier's own soft bodies stand [elsewhere](mechanics.md).",
    ]
    return "\n\n".join(parts) + "\n"


def conclusion(report: dict) -> str:
    """The front of the first panel in words."""
    name, found = next(iter(report["panels"].items()))
    lines = []
    for what in ("force", "displacement", "stress"):
        names = report["fronts"][name][what]
        steps = "; ".join(
            f"{n} {100 * found[n]['finest'][what]['median']:.1f} % in {found[n]['ms']:.3g} ms"
            for n in names
        )
        lines.append(f"- **{what}**, {name}: {steps}.")
    return "The front, fastest first, by median error:\n\n" + "\n".join(lines)


def panel(name: str, found: dict, report: dict) -> str:
    """A panel's table; members of the front of displacement are bold."""
    rows = []
    for answerer, row in found.items():
        if "ms" not in row:
            continue
        bold = "**" if answerer in report["fronts"][name]["displacement"] else ""
        failed = f"{len(row['failed'])} of {row['presses']}" if row["failed"] else ""
        cells = [cell(row, what) for what in ERRORS]
        rows.append([f"{bold}{answerer}{bold}", f"{row['ms']:.3g}", *cells, failed])
    head = ["answerer", "ms", "u", "σ", "force", "peak", "unsolved"]
    presses = max(row["presses"] for row in found.values())
    return f"## {name.capitalize()}, {presses} presses\n\n" + table(head, rows)


def cell(row: dict, what: str) -> str:
    """Median and 95th percentile against the finest mesh, the median against `ELEMENTS`."""
    if what not in row["finest"]:
        return "–"
    error, elements = row["finest"][what], row[ELEMENTS].get(what)
    text = f"{100 * error['median']:.1f} / {100 * error['95 %']:.1f}"
    return text + (f" ({100 * elements['median']:.1f})" if elements else "")


def knowing(found: dict) -> str:
    """Errors of networks by what `knows` says."""
    rows = []
    shown = [name for name, one in ANSWERERS.items() if name in found and one.kind != "oracle"]
    for name in shown:
        for part, errors in found[name].items():
            cells = [
                " / ".join(f"{100 * errors[what][key]:.1f}" for key in ("median", "95 %"))
                if what in errors
                else "–"
                for what in ("displacement", "force")
            ]
            rows.append([name, part, str(errors["frames"]), *cells])
    return (
        "All panels: errors against the finest mesh, median / 95th percentile in %, of the frames "
        "that `knows` says are like what the network learnt from, and of the others.\n\n"
        + table(["network", "it says", "frames", "u", "force"], rows)
    )


def in_batches(found: dict) -> str:
    """Time a press on one thread and on all, and how well the threads are used."""
    threads = max(int(count) for one in found.values() for count in one["ms"])
    rows = []
    for name, one in found.items():
        slow, fast = one["ms"]["1"], one["ms"][str(threads)]
        failed = str(one["failed"]) if one["failed"] else ""
        share = f"{100 * slow / fast / threads:.0f} %"
        rows.append([name, f"{slow:.3g}", f"{fast:.3g}", share, failed])
    presses = max(one["presses"] for one in found.values())
    head = ["answerer", "ms a press, one thread", f"{threads} threads", "of ideal", "unsolved"]
    return (
        f"{presses} balls of 3 to 8 mm, pressed 0.6 mm from rest in five frames, by one call; by "
        "the clock, the quickest repetition.\n\n" + table(head, rows)
    )


def still(found: dict) -> str:
    """Largest displacement that is answered where nothing touches."""
    worst = max(found.values(), default=0.0)
    who = [name for name, most in found.items() if most == worst and worst > 0]
    if not worst:
        return f"A ball 0.1 and 1 mm over the gel: exactly zero from all {len(found)} answerers."
    return f"A ball over the gel: up to {worst:.1e} m from {', '.join(who)}."


def training(found: dict) -> str:
    """Core hours of data and training, and the break-even."""
    rows = []
    for name, cost in found.items():
        presses = f"{cost['presses']:,.0f}" if cost["presses"] else "never"
        if "training" not in cost:
            presses = f"> {presses}"
        hours = [f"{cost[p] / 3600:.2f}" if p in cost else "–" for p in ("data", "training")]
        rows.append([name, *hours, f"{1e3 * cost['saved']:.0f}", presses])
    head = ["network", "data (core h)", "training (core h)", "saved a frame (ms)", "break-even"]
    return table(head, rows) + (
        "\n\nThe break-even is the number of frames after which answering by p1-bar on 2,000 nodes "
        "would have cost more."
    )
