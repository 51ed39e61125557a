"""Cost, truth and contents of datasets, about an hour on two cores; --quick takes minutes.

Time and disk by mesh and number of threads; how far the truth of real grasps is from a finer mesh;
what kills change; share and reasons of unsolved grasps, worst imbalance and distributions of every
dataset given by --data, whose first is then judged in place of a sample. Others that were described
before stay on the page.
"""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from itertools import groupby
from pathlib import Path

import numpy as np
from matplotlib.ticker import NullFormatter

import dataset_cases
from engine import OUT, ROOT, Rows, made, plt, run, spread, table, text
from ruffini import dataset

ONE_THREAD = True
PARTS = ("contact", "dataset", "deformation", "fem", "geometry", "objects")
MADE_OF = [f"env-core/src/{part}" for part in PARTS]
MADE_OF += ["env-core/assets", "py/reports/dataset_cases.py"]
SAMPLE = ROOT / "tests/reference/grasps"
"""Whose grasps are judged where no dataset is given."""
SIZES = {
    "full": {
        "cost": {"objects": 4, "grasps": 1, "frames": 5, "force": [2.0, 80.0]},
        "runs": [[900, 400, 2], *([2000, 1000, n] for n in (1, 2))],
        "kills": 20,
        "judged": 6,
        "every": 5,
        "rungs": [["p1-bar", 1000], ["p1-bar", 2000], ["p2", 1000]],
        "finest": ["p2", 2500],
    },
    "quick": {
        "cost": {"objects": 2, "grasps": 1, "frames": 2},
        "runs": [[500, 300, 1], [500, 300, 2]],
        "kills": 2,
        "judged": 2,
        "every": 1,
        "rungs": [["p1-bar", 500]],
        "finest": ["p1-bar", 900],
    },
}
WHOLE = 63 * 100 * 50
"""Frames of the paper's dataset."""
ERRORS = {"force": "force", "u": "u", "sigma": "σ", "peak": "peak σ"}


def options(parser: ArgumentParser) -> None:
    """Datasets to look into."""
    parser.add_argument("--data", type=Path, nargs="*", default=[], help="finished datasets")


def make(options: Namespace) -> dict:
    """Truth of grasps two at a time, then kills and costs by themselves."""
    sizes = SIZES[options.form]
    rows = Rows.of("dataset", options, MADE_OF, sizes)
    kept = options.data[0] if options.data else SAMPLE
    grasps = dataset.open(kept).grasps
    chosen = grasps[:: max(len(grasps) // sizes["judged"], 1)][: sizes["judged"]]
    run(
        rows,
        {
            f"truth {grasp}": (dataset_cases.judged, kept, grasp, sizes)
            for grasp in chosen
            if any(dataset_cases.key(grasp, *rung) not in rows for rung in sizes["rungs"])
        },
        jobs=2,
    )
    costs = {f"cost {truth}/{model} on {n}": (truth, model, n) for truth, model, n in sizes["runs"]}
    run(
        rows,
        {"kills": (dataset_cases.disturbed, sizes["kills"])}
        | {key: (dataset_cases.cost, *of, sizes["cost"]) for key, of in costs.items()},
    )
    held = {} if options.quick else json.loads((OUT / "dataset.json").read_text())["datasets"]
    held |= {path.resolve().name: dataset_cases.contents(path) for path in options.data}
    found = {"rows": list(rows), "truth": accuracy(list(rows)), "datasets": held}
    return rows.header | {"note": options.note} | found


def also(report: dict, out: Path, options: Namespace) -> None:
    """Pictures of the datasets that were given."""
    for path in options.data:
        dataset.open(path).plot(out / f"dataset-{path.resolve().name}.png")


def accuracy(rows: list[dict]) -> dict:
    """Median and worst error of each element and mesh, its cost and what it left unsolved."""
    found = {}
    rungs = sorted((row for row in rows if row["key"].startswith("truth")), key=rung)
    for _, some in groupby(rungs, key=rung):
        own = list(some)
        solved = [row for row in own if "errors" in row]
        if not solved:
            continue
        frames = [frame for row in solved for frame in row["errors"]]
        columns = {name: [frame[name] for frame in frames] for name in ERRORS}
        found[f"{solved[0]['element']} {solved[0]['vertices']}"] = {
            name: {"median": float(np.median(of)), "worst": max(of)} for name, of in columns.items()
        } | {
            "cpu": float(np.mean([row["cpu"] for row in solved])),
            "grasps": len(own),
            "failed": len(own) - len(solved),
        }
    return found


def rung(row: dict) -> tuple[str, int]:
    """Element and nodes of a row of the truth's error."""
    return row["element"], row["nodes"]


PAGE = """# Datasets: cost, truth, contents

## Time and disk

{sizes[cost][objects]} objects × {grasps} × {sizes[cost][frames]} frames by two pads, linear
elements free of locking (p1-bar). *Truth* is the mesh on which grasps are solved, *model* the one
to which the answers are carried; times and disk are of 1,000 frames, and in the last column of the
whole catalogue, 63 objects × 100 grasps × 50 frames. Wall time is that of the machine as loaded as
it was; CPU time is less disturbed by others.

{costs}

![cost and error](dataset.svg)

{kills}

{truth}

{held}

{made}"""
KILLS = """A generation of {files} files, killed at {kills} random moments and taken up again after
each, ends with {resumed}; made a second time, with {again}."""
TRUTH = """## How far the truth is from a finer mesh

Frames of {count} grasps ({grasps}), {least:100*.0f} to {most:100*.0f} % of the pad's thickness
deep, solved again at the same poses of the pads and compared with {finest[0]} on at most
{finest[1]} nodes, which is no limit itself. Median and worst frame; displacement u and von Mises
stress σ in relative L² norm on the model mesh, to which both are carried as their elements know
them (`Fem.carry`).

{table}"""
HELD = """## {name}

{config[objects]} objects × {config[grasps]} grasps × at most {config[frames]} frames,
{config[force][0]:g} to {config[force][1]:g} N, {config[density]:g} kg/m³, commit {by}: {frames}
frames, {bytes:1e-6*.0f} MB. {unsolved} of {grasps} grasps ended early ({share:100*.1f} %){why}.
Over all frames, Σ contact force is within {imbalance[contact]:.1e} N of a pad's wrench, and an
object is out of balance by {imbalance[force]:.1e} N and {imbalance[torque]:.1e} N m at most. Median
/ largest of all frames; depth as a share of the gel's thickness:

{table}

![distributions](dataset-{name}.png)"""


def page(report: dict) -> str:
    """Costs, the truth's own error, what datasets hold."""
    changed = {True: "the same bytes", False: "**other bytes**"}
    costs = {
        "nodes, truth / model": "{truth} / {model}",
        "threads": "{threads}",
        "wall s / 1,000": lambda row: f"{1000 / row['frames'] * row['wall']:.0f}",
        "CPU s / 1,000": lambda row: f"{1000 / row['frames'] * row['cpu']:.0f}",
        "MB / 1,000": lambda row: f"{1000 / row['frames'] * row['bytes'] / 1e6:.0f}",
        "63 × 100 × 50": lambda row: (
            f"{WHOLE / row['frames'] * row['wall'] / 86400:.1f} days, "
            f"{WHOLE / row['frames'] * row['bytes'] / 1e9:.0f} GB"
        ),
    }
    kills = [row for row in report["rows"] if row["key"] == "kills"]
    paragraphs = [
        text(KILLS, row, resumed=changed[row["same"]], again=changed[row["twice"]]) for row in kills
    ]
    return text(
        PAGE,
        report,
        grasps=counted(report["sizes"]["cost"]["grasps"], "grasp"),
        costs=table(costs, of_cost(report)),
        kills="\n\n".join(paragraphs),
        truth=about_truth(report),
        held="\n\n".join(held(name, found) for name, found in report["datasets"].items()),
        made=made(report, {"finest": " ".join(map(str, report["sizes"]["finest"]))}),
    )


def counted(number: int, what: str) -> str:
    """A number of things, in the singular or the plural."""
    return f"{number} {what}" + "s" * (number != 1)


def of_cost(report: dict) -> list[dict]:
    """Rows of cost."""
    rows = [row for row in report["rows"] if row["key"].startswith("cost")]
    return sorted(rows, key=lambda row: (row["truth"], row["threads"]))


def about_truth(report: dict) -> str:
    """Difference of the truth from a finer mesh, where a grasp has been judged."""
    if not report["truth"]:
        return ""
    rows = [row for row in report["rows"] if row["key"].startswith("truth")]
    grasps = sorted({row["grasp"] for row in rows})
    depths = [depth for row in rows for depth in row["depths"]]
    span = {"count": len(grasps), "least": min(depths), "most": max(depths)}
    columns = {
        "element, nodes": "{mesh}",
        **{head: spread(name, "worst", " %") for name, head in ERRORS.items()},
        "CPU s a frame": "{cpu:.1f}",
        "unsolved": "{failed} of {grasps}",
    }
    meshes = [{"mesh": mesh} | of for mesh, of in report["truth"].items()]
    parts = {"grasps": ", ".join(grasps), "table": table(columns, meshes)}
    return text(TRUTH, report["sizes"] | span, **parts)


def held(name: str, found: dict) -> str:
    """Section on the contents of a dataset."""
    columns = {
        "family": "{family}",
        "depth": "{depth[1]:100*.0f} % / {depth[2]:100*.0f} %",
        "force (N)": "{force[1]:.1f} / {force[2]:.1f}",
        "tangential / normal": "{shear[1]:.2f} / {shear[2]:.2f}",
        "peak stress (kPa)": "{stress[1]:.0f} / {stress[2]:.0f}",
    }
    families = [{"family": family} | of for family, of in found["families"].items()]
    share = {"share": found["unsolved"] / found["grasps"], "by": found["commit"] or "unknown"}
    why = "".join(f"; {count}: {reason}" for reason, count in found["reasons"].items())
    return text(HELD, found | share, name=name, why=why, table=table(columns, families))


def figure(report: dict):
    """Time of 1,000 frames by threads, and error against cost by mesh."""
    picture, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    cost_plot(report, left)
    right.set_visible(bool(report["truth"]))
    if report["truth"]:
        truth_plot(report, right)
    for axis in (left, right):
        axis.grid(alpha=0.3)
    return picture


def cost_plot(report: dict, axis) -> None:
    """Wall and CPU minutes of 1,000 frames by number of threads, a colour to a mesh."""
    rows = of_cost(report)
    for colour, mesh in enumerate(sorted({(row["truth"], row["model"]) for row in rows})):
        own = [row for row in rows if (row["truth"], row["model"]) == mesh]
        threads = [row["threads"] for row in own]
        for time, style in {"wall": "-", "cpu": ":"}.items():
            minutes = [row[time] / 60 * 1000 / row["frames"] for row in own]
            label = f"{mesh[0]} / {mesh[1]} nodes" if time == "wall" else None
            axis.plot(threads, minutes, style, marker=".", color=f"C{colour}", label=label)
    axis.set(title="1,000 frames", xlabel="threads", ylabel="minutes", yscale="log")
    axis.set_xticks(sorted({row["threads"] for row in rows}))
    axis.legend(title="CPU dotted")


def truth_plot(report: dict, axis) -> None:
    """Median error of each field against CPU seconds a frame, meshes named."""
    meshes = sorted(report["truth"].items(), key=lambda mesh: mesh[1]["cpu"])
    times = [of["cpu"] for _, of in meshes]
    for key, name in ERRORS.items():
        axis.loglog(times, [100 * of[key]["median"] for _, of in meshes], "o", label=name)
    for mesh, of in meshes:
        highest = 100 * max(of[key]["median"] for key in ERRORS)
        axis.annotate(mesh.replace(" ", "\n"), (of["cpu"], highest), fontsize=7)
    element, nodes = report["sizes"]["finest"]
    title = f"median difference to {element} on {nodes} nodes"
    axis.set(title=title, xlabel="CPU s a frame", ylabel="%")
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.legend()
