"""Cost of a scene, from bare rigid to everything on, a quarter of an hour; --quick three scenes.

Every row runs in a process of its own. Time is processor time of one thread, over steps in which
both fingers of every environment touch, that of a stage its share of the clock's; scaling over
threads, training and peers are wall time. Peers are those of policies/peers.py; they and
Stable-Baselines3 are named as missing where they are not installed, and asked for anew by the next
run.
"""

from __future__ import annotations

import resource
import tempfile
from argparse import Namespace
from collections import defaultdict
from importlib.metadata import version
from importlib.util import find_spec
from itertools import islice, product
from pathlib import Path
from typing import Any

import numpy as np

from engine import Rows, made, plt, run, table, text
from peers import PEERS, peer
from rollout_speed import CONTROL_STEP, random_rollout
from ruffini import Shape
from ruffini.envs import GraspLiftVectorEnv
from ruffini.evaluation import usable_cores
from timing import resident_bytes, scripted_steps, touching

MADE_OF = ["env-core", "py/src", "py/python/ruffini/sb3.py"]
MADE_OF += [f"py/python/ruffini/agents/{name}.py" for name in ("params", "training")]
MADE_OF += ["py/python/ruffini/policies/grasp_lift.py", "py/reports/scene_cost.py"]
MADE_OF += ["py/reports/scene_cost_training.py"]
MADE_OF += [f"policies/{name}.py" for name in ("peers", "rollout_speed", "timing")]
COUNT = 4
"""Environments of a scene."""
BASE = ["proprio", "object"]
MARKERS = [*BASE, "markers"]
TOUCH = [*MARKERS, "stress", "tet_stress", "traction", "slip", "displacement", "depth", "image"]
OMITTED = ("displacement", "stress", "tet_stress", "depth", "image")
"""Channels that a scene leaves out; with `stress`, `tet_stress` too, which needs the same stress of
the gel."""
NETWORK, LINEAR = {"tactile": "surrogate"}, {"tactile": "compliance"}
FULL = "network, all channels"
PICTURES = {f"network, image of {x} × {y}": (x, y) for x, y in ((60, 80), (240, 320))}
"""Scenes with the tactile image alone, and its pixels across and along."""
PICTURED = ("sphere", "cuboid", "prism", "ellipsoid", "cup", "potato", "mesh")
"""Objects of these scenes; the mesh is the potato's triangles."""
SCENES: dict[str, dict[str, Any]] = {
    "rigid": {"tactile": "none"},
    "rigid, finer step": {"tactile": "none", "physics": {"time_step": 1e-3, "iterations": 4}},
    "linear, markers": LINEAR | {"observation": MARKERS},
    "linear, all channels": LINEAR | {"observation": TOUCH},
    "network, no channel": NETWORK | {"observation": BASE},
    "network, markers": NETWORK | {"observation": MARKERS},
    "linear, 500 nodes": LINEAR | {"observation": MARKERS, "resolution": {"nodes": 500}},
    **{
        f"network, all but {channel}": NETWORK
        | {"observation": [name for name in TOUCH if not name.endswith(channel)]}
        for channel in OMITTED
    },
    FULL: NETWORK | {"observation": [*TOUCH, "predicted_error"]},
    **{
        name: NETWORK | {"observation": [*BASE, "image"], "resolution": {"image": pixels}}
        for name, pixels in PICTURES.items()
    },
    "fem, markers": {"tactile": "fem", "observation": MARKERS},
}
LEFT_OUT = {name: f"network, all but {name}" for name in OMITTED}
LEFT_OUT |= {"all channels but markers": "network, markers", "touch": "rigid"}
"""Scenes that lack one part of the full scene, by that part."""
BOTH = ("rigid", "linear, markers", "network, markers", FULL)
"""Scenes with a cuboid, whose flat side touches widely, besides the sphere."""
QUICK = ("rigid", "linear, markers", FULL)
STEPS, MOST = {"rigid": 1500, "fem": 50}, 80
"""Steps of the scenes that are named, and of the others."""
WARM = 8
"""Steps before those that are measured."""
SCALING = {"rigid": (1, 16, 256), "network, markers": (1, 16, 64, 1024)}
"""Environments of the scaling, by scene."""
LIFT, HOLD = "ruffini/GraspLift-v0", "ruffini/HoldStill-v0"
RUNS: dict[str, tuple[str, dict[str, Any]]] = {
    "GraspLift, rigid": (LIFT, {"tactile": "none"}),
    "GraspLift, network, markers": (LIFT, {}),
    "HoldStill, network, wrench and slip": (HOLD, {}),
}
"""Environments that PPO runs in: an id, and what is not default."""
QUICK_RUNS, QUICK_ROLLOUT = ("GraspLift, network, markers",), 32
"""Those of the quick form, and steps of their rollouts; else the task's own."""
OURS = {"rigid": {"tactile": "none"}, "network, markers": NETWORK}
"""Environments beside the peers."""


def make(options: Namespace) -> dict:
    """Scenes, scaling, training and peers, one after the other."""
    quick = options.quick
    rows, cases = Rows.of("scene_cost", options, MADE_OF, {"environments": COUNT}), {}
    for name in QUICK if quick else SCENES:
        steps = STEPS.get(name.split(",")[0], MOST)
        things = ("sphere", "cuboid") if name in BOTH else ("sphere",)
        for thing in ("sphere",) if quick else PICTURED if name in PICTURES else things:
            cases[f"cost {name}, {thing}"] = (cost, name, thing, steps)
    threads = [2**i for i in range(int(np.log2(usable_cores())) + 1)]
    for name, counts in SCALING.items():
        for count, some in product(counts[:1] if quick else counts, threads):
            if some <= count:
                cases[f"scaling {name}, {count:04}, {some}"] = (scaling, name, count, some)
    for name, free in product(QUICK_RUNS if quick else RUNS, (False, True)):
        key = f"sb3 {name}, free" if free else f"sb3 {name}"
        cases[key] = (training, name, free, QUICK_ROLLOUT if quick else None)
    seconds = 0.3 if quick else 3.0
    cases |= {f"peer {name}": (theirs, name, seconds) for name in PEERS}
    for name, count in product(OURS, (1, 16)):
        cases[f"peer ruffini {name}, {count:02}"] = (ours, name, count, seconds)
    run(rows, cases, jobs=1)
    return rows.header | {"note": options.note} | summary(list(rows))


def cost(name: str, thing: str, steps: int) -> dict:
    """Steps a second, stages and memory of a scene while a scripted policy holds an object."""
    with tempfile.TemporaryDirectory() as folder:
        found = mesh(Path(folder)) if thing == "mesh" else thing
        before = resident_bytes()
        envs = GraspLiftVectorEnv(COUNT, num_threads=1, objects=[found], **SCENES[name])
    held, spent, wall, stages = 0, 0.0, 0.0, []
    for taken, step in enumerate(islice(scripted_steps(envs, LIFT), WARM + steps)):
        plan = envs.plan(forget=True)
        if taken >= WARM and touching(step.observation).all():
            held, spent, wall = held + COUNT, spent + step.processor, wall + step.wall
            stages.append({stage: us for stage, _, us in plan})
    share = spent / wall if wall else 0.0
    return {
        "scene": name,
        "object": thing,
        "steps": held,
        "us": 1e6 * spent / held if held else None,
        "stages": {
            stage: share * float(np.mean([row[stage] for row in stages]))
            for stage in (stages[0] if stages else {})
        },
        "MiB": (resident_bytes() - before) / 2**20,
        "peak MiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def mesh(folder: Path) -> str:
    """File of triangles of the potato."""
    vertices, triangles = Shape.named("potato").surface(80)
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += [f"f {a} {b} {c}" for a, b, c in triangles + 1]
    file = folder / "potato.obj"
    file.write_text("\n".join(lines) + "\n")
    return str(file)


def scaling(name: str, count: int, threads: int) -> dict:
    """Steps a second of wall time under the scripted policy: reach, grasp, lift."""
    envs = GraspLiftVectorEnv(count, num_threads=threads, objects=["sphere"], **SCENES[name])
    spent = sum(step.wall for step in islice(scripted_steps(envs, LIFT), MOST))
    return {"scene": name, "envs": count, "threads": threads, "rate": MOST * count / spent}


def training(name: str, free: bool, steps: int | None) -> dict:
    """Steps a second of PPO end to end, or what it lacks."""
    row = {"run": name, "free": free}
    for package in ("torch", "stable_baselines3", "tqdm"):
        if find_spec(package) is None:
            return row | {"missing": f"{package} is not installed"}
    from scene_cost_training import end_to_end

    return row | end_to_end(*RUNS[name], free, steps) | versions("torch", "stable_baselines3")


def theirs(name: str, seconds: float) -> dict:
    """Steps a second of a peer, or why there are none."""
    found, row = peer(name, seconds), {"envs": name, "control step": PEERS[name].control_step}
    if isinstance(found, str):
        return row | {"missing": found}
    return row | {"rate": found} | versions(*PEERS[name].packages)


def ours(name: str, count: int, seconds: float) -> dict:
    """Steps a second by the same kind of rollout as the peers'."""
    envs = f"ruffini GraspLift, {name}, {count} environment{'s' if count > 1 else ''}"
    rate = random_rollout(count, 1, seconds, **OURS[name])
    return {"envs": envs, "control step": CONTROL_STEP, "rate": rate}


def versions(*packages: str) -> dict:
    """Versions of packages that a row depends on."""
    return {"versions": {package: version(package) for package in packages}}


def summary(rows: list[dict]) -> dict:
    """Cost by scene and object, savings, scaling, training, peers."""

    def some(kind: str) -> list[dict]:
        chosen = [row for row in rows if row["key"].startswith(kind)]
        return [{k: v for k, v in row.items() if k not in ("key", "took")} for row in chosen]

    scenes: dict = defaultdict(dict)
    for row in some("cost"):
        if row["us"]:
            scenes[row.pop("scene")][row.pop("object")] = row | {"rate": 1e6 / row["us"]}
    order = sorted(scenes, key=lambda name: -scenes[name]["sphere"]["rate"])
    runs: dict = {}
    for row in some("sb3"):
        name, kind = row.pop("run"), "free" if row.pop("free") else "ruffini"
        if "us" in row:
            row["share"] = row["us"]["environment"] / sum(row["us"].values())
        runs.setdefault(name, {})[kind] = row
    return {
        "scenes": {name: scenes[name] for name in order},
        "savings": savings(scenes),
        "scaling": some("scaling"),
        "sb3": runs,
        "peers": some("peer"),
    }


def savings(scenes: dict) -> dict:
    """Time saved by leaving a part out (µs), and that of its stage in the full scene."""
    found: dict = {}
    for thing, whole in scenes.get(FULL, {}).items():
        for part, other in LEFT_OUT.items():
            if thing in scenes.get(other, {}):
                saved = whole["us"] - scenes[other][thing]["us"]
                row = {"saved": saved, "share": saved / whole["us"]}
                found.setdefault(part, {})[thing] = row | {
                    "stage": whole["stages"].get(f"channel {part}")
                }
    return found


PAGE = """# What a scene costs

Of the network of the gel, *network*, and of the linear elasticity that it corrects, *linear*;
*rigid* is without touch, *finer step* with steps of 1 ms in place of 4 ms.

Steps a second of one thread while both pads touch, and the stage that takes most of them:

{rates}

{ppo}

![cost of scenes](scene_cost.svg)

## By scene

{sizes[environments]} environments on one thread, scripted grasp, only steps in which all pads
touch; processor time. Memory is what the scene adds to the process.

{by_scene}

## By stage

µs in a step of one environment, as `env.unwrapped.plan()` lists it.

{by_stage}

{pictures}

## What leaving something out saves

Against 'network, all channels'; 'stage' is what `plan()` says that what is left out takes.

{saved}

## Environments and threads

Wall time, the scripted policy from reach to lift; *load* is the load average of the machine when
the case began.

{scaled}

{trained}

{beside_peers}

{made}"""
IMAGES = """## Pictures

What the channel `image` takes for one finger, in ms. Where the object touches, each pixel shows the
object's own surface. *Mesh* is the potato as a file of triangles.

{table}"""
TRAINED = """## Training by Stable-Baselines3 (SB3), end to end

Stable-Baselines3's PPO with the hyper-parameters of `ruffini.agents.params`, one thread of torch
and one of the environment: wall time, by step of one environment. The policy's own networks count
as PPO's. A free environment plays one recorded episode over and over; it leaves PPO's caches warm,
which physics does not. 'Touch' is the share of steps in which a pad touches: the policy is
untrained, and in GraspLift a trained one touches far more often.

{table}"""
BESIDE = """## Beside other simulators

Random actions on one thread, which seldom touch; resets included; wall time. A step of one is not a
step of another: 'real time' is the simulated time over the wall's.

{table}"""
SCENE = {
    "scene": "{name}",
    "steps/s": "{rate:,.0f}",
    "µs a step": "{us:,.0f}",
    "MiB": "{MiB:.0f}",
    "peak MiB of the process": "{peak MiB:.0f}",
}
SAVED = {
    "left out": "{name}",
    "saved (µs)": "{saved:,.0f}",
    "of the step": "{share:100*.0f} %",
    "stage (µs)": "{stage:,.0f}",
}
SCALED = {
    "scene": "{scene}",
    "environments": "{envs}",
    "threads": "{threads}",
    "steps/s": "{rate:,.0f}",
    "load": "{load:.1f}",
}
RUN = {
    "run": "{name}",
    "environments": lambda row: row.get("missing") or str(row["envs"]),
    "steps/s": "{rate:,.0f}",
    "environment (µs)": "{us[environment]:,.0f}",
    "rest of collecting (µs)": "{us[collecting]:,.0f}",
    "updating (µs)": "{us[updating]:,.0f}",
    "environment's share": "{share:100*.0f} %",
    "touch": lambda row: "" if row["kind"] == "free" else f"{100 * row['touch']:.1f} %",
    "load": lambda row: "" if "missing" in row else f"{row['load']:.1f}",
}
PEER = {
    "environments": "{envs}",
    "steps/s": lambda row: row.get("missing") or f"{row['rate']:,.0f}",
    "step (ms)": "{control step:1e3*.0f}",
    "times real time": lambda row: f"{row['rate'] * row['control step']:,.0f}",
    "version": lambda row: ", ".join(f"{n} {v}" for n, v in row.get("versions", {}).items()),
    "load": lambda row: "" if "missing" in row else f"{row['load']:.1f}",
}


def named(found: dict) -> list[dict]:
    """Rows of values by a name and a kind or an object."""
    return [
        {"name": name if kind == "ruffini" else f"{name}, {kind}", "kind": kind} | row
        for name, of in found.items()
        for kind, row in of.items()
    ]


def page(report: dict) -> str:
    """Stages that dominate each scene, the environment's share of training, tables."""
    scenes = named(report["scenes"])
    kinds = dict.fromkeys(stage for row in scenes for stage in row["stages"])
    stages = [("scene", "{name}"), *((kind, f"{{stages[{kind}]:,.0f}}") for kind in kinds)]
    parts = {"trained": "", "beside_peers": "", "ppo": "", "pictures": ""}
    if found := pictures(report["scenes"]):
        parts["pictures"] = text(IMAGES, {}, table=found)
    if runs := report.get("sb3"):
        parts["ppo"] = "Training by Stable-Baselines3's PPO end to end on one thread:\n\n"
        parts["ppo"] += "\n".join(share(name, run) for name, run in runs.items())
        parts["trained"] = text(TRAINED, {}, table=table(RUN, named(runs), absent=""))
    if peers := report.get("peers"):
        parts["beside_peers"] = text(BESIDE, {}, table=table(PEER, peers, absent=""))
    return text(
        PAGE,
        report,
        rates="\n".join(map(dominant, scenes)),
        by_scene=table(SCENE, scenes),
        by_stage=table(stages, scenes, absent=""),
        saved=table(SAVED, named(report["savings"]), absent="–"),
        scaled=table(SCALED, report["scaling"]),
        made=made(report),
        **parts,
    )


def pictures(scenes: dict) -> str:
    """Cost of a finger's picture by object and size, or nothing."""
    some = {name: of for name, of in scenes.items() if name in PICTURES}
    columns: dict = {"object": "{name}"}
    for name in some:
        x, y = PICTURES[name]
        columns[f"{x} × {y}"] = f"{{{name}[stages][channel image]:0.5e-3*.2f}}"
    rows = [
        {"name": thing} | {name: of[thing] for name, of in some.items()}
        for thing in PICTURED
        if all(thing in of for of in some.values())
    ]
    return table(columns, rows) if some else ""


def dominant(row: dict) -> str:
    """A scene's rate and its costliest stage."""
    stage, us = max(row["stages"].items(), key=lambda x: x[1], default=("–", 0.0))
    of_it = f"{100 * us / row['us']:.0f} % of it in {stage}"
    return f"- {row['name']}: {row['rate']:,.0f} steps/s, {of_it}."


def share(name: str, run: dict) -> str:
    """The environment's share of a run, in a sentence."""
    whole, free = run["ruffini"], run["free"]
    if "missing" in whole or "missing" in free:
        return f"- {name}: {whole.get('missing') or free['missing']}."
    return (
        f"- {name}: {whole['rate']:,.0f} steps/s, {100 * whole['share']:.0f} % of it in ruffini, "
        f"the rest in SB3; {free['rate']:,.0f} steps/s in a free environment."
    )


def figure(report: dict):
    """Time by stage of every scene, rates by threads, and time of training."""
    runs = [
        ("free" if row["kind"] == "free" else row["name"].replace(", ", "\n", 1), row["us"])
        for row in named(report.get("sb3", {}))
        if "us" in row
    ]
    picture, axes = plt.subplot_mosaic(
        [["stages", "threads"], ["stages", "training" if runs else "threads"]],
        figsize=(12, 7.5),
        layout="constrained",
        width_ratios=[2, 1],
        height_ratios=[3, 2],
    )
    stage_plot(axes["stages"], named(report["scenes"]))
    thread_plot(axes["threads"], report["scaling"])
    if runs:
        training_plot(axes["training"], runs)
    return picture


def stage_plot(axis, rows: list[dict]) -> None:
    """A row a scene: the time of each kind of stage, and the rate of the whole."""
    for colour, kind in enumerate(("scene", "press", "model", "correction", "channel", "reward")):
        times = [
            sum(us for stage, us in row["stages"].items() if stage.startswith(kind)) for row in rows
        ]
        shown = [(us, place) for place, us in enumerate(times) if us > 0]
        label = "channels" if kind == "channel" else kind
        if shown:
            axis.plot(*zip(*shown, strict=True), "o", color=f"C{colour}", ms=6, label=label)
    for place, row in enumerate(rows):
        axis.plot(row["us"], place, "|", color="black", markersize=14)
        beside = {"xytext": (6, -2), "textcoords": "offset points", "fontsize": 7}
        axis.annotate(f"{row['rate']:,.0f} steps/s", (row["us"], place), **beside)
    axis.set_yticks(range(len(rows)), [row["name"] for row in rows])
    axis.invert_yaxis()
    axis.set(xscale="log", xlabel="CPU µs in a step of one environment; | is the whole step")
    axis.set_title("Where a step's time goes")
    axis.set_xlim(right=6 * max(row["us"] for row in rows))
    axis.grid(alpha=0.3, axis="x", which="both")
    axis.legend(fontsize=7, ncols=6, loc="upper center", bbox_to_anchor=(0.5, -0.09))


def thread_plot(axis, rows: list[dict]) -> None:
    """Rates by threads, a line for each number of environments."""
    lines: dict = {}
    for row in rows:
        lines.setdefault(f"{row['scene']}, {row['envs']} envs", []).append(row)
    for name, line in lines.items():
        axis.loglog([r["threads"] for r in line], [r["rate"] for r in line], ".-", label=name)
    threads = sorted({row["threads"] for row in rows})
    axis.set_xticks(threads, [str(count) for count in threads])
    axis.set_xticks([], minor=True)
    axis.set(title="Environments and threads", xlabel="threads", ylabel="steps/s")
    axis.grid(alpha=0.3, which="both")
    axis.legend(fontsize=7, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.14))


def training_plot(axis, runs: list) -> None:
    """A bar a run of PPO: the environment's time, what else collecting takes, and updating."""
    places, before = range(len(runs)), np.zeros(len(runs))
    for part in ("environment", "collecting", "updating"):
        times = np.array([us[part] for _, us in runs])
        axis.barh(places, times, left=before, label=part)
        before += times
    axis.set_yticks(places, [name for name, _ in runs])
    axis.invert_yaxis()
    axis.set(title="SB3's PPO end to end", xlabel="wall µs in a step of one environment")
    axis.grid(alpha=0.3, axis="x")
    axis.legend(fontsize=7)
