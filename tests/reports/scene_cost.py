"""What a scene costs, from bare rigid to everything on: makes scene_cost.json, .md and .svg.

    python tests/reports/scene_cost.py            a quarter of an hour; goes on after a stop
    python tests/reports/scene_cost.py --quick    three scenes, into target/reports/quick

Every row runs in a process of its own. Time is processor time of one thread, over steps in which
both fingers of every environment touch, that of a stage its share of the clock's; scaling over
threads, training and peers are wall time. Peers are those of policies/rollout_speed.py; they and
Stable-Baselines3 are named as missing where they are not installed, and asked for anew by the next
run.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import resource
import sys
import time
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from kept import KEPT, ROOT, Rows, arguments, folder, header
from scene_cost_beside import beside
from scene_cost_pages import markdown, summary
from scene_cost_plots import figure

from ruffini.envs import GraspLiftVectorEnv

sys.path.append(str(ROOT / "policies"))
from ruffini.policies import scripted
from touch_speed import FELT

MADE_OF = [
    "env-core",
    "py/src",
    "py/python/ruffini/sb3.py",
    "policies/params.py",
    "policies/rollout_speed.py",
    "py/python/ruffini/policies/grasp_lift.py",
    "policies/touch_speed.py",
    "policies/train.py",
    "tests/reports/scene_cost.py",
    "tests/reports/scene_cost_beside.py",
    "tests/reports/scene_cost_training.py",
]
COUNT = 4
"""Environments of a scene."""
BASE: list[str] = ["proprio", "object"]
MARKERS: list[str] = [*BASE, "markers"]
TOUCH: list[str] = [*MARKERS, "stress", "traction", "slip", "displacement", "depth", "trust"]
SCENES: dict[str, dict[str, Any]] = {
    "rigid": {"tactile": "none"},
    "rigid, finer step": {
        "tactile": "none",
        "physics": {"time_step": 1e-3, "iterations": 4},
    },
    "linear, markers": {"tactile": "compliance", "observation": MARKERS},
    "linear, all channels": {"tactile": "compliance", "observation": TOUCH},
    "network, no channel": {"tactile": "surrogate", "observation": BASE},
    "network, markers": {"tactile": "surrogate", "observation": MARKERS},
    "linear, 500 nodes": {
        "tactile": "compliance",
        "observation": MARKERS,
        "resolution": {"nodes": 500},
    },
    "network, all but displacement": {
        "tactile": "surrogate",
        "observation": [name for name in TOUCH if name != "displacement"],
    },
    "network, all but stress": {
        "tactile": "surrogate",
        "observation": [name for name in TOUCH if name != "stress"],
    },
    "network, all but depth": {
        "tactile": "surrogate",
        "observation": [name for name in TOUCH if name != "depth"],
    },
    "network, all channels": {"tactile": "surrogate", "observation": TOUCH},
    "fem, markers": {"tactile": "fem", "observation": MARKERS},
}
BOTH = ("rigid", "linear, markers", "network, markers", "network, all channels")
"""Scenes with a cuboid, whose flat side touches widely, besides the sphere."""
QUICK = ("rigid", "linear, markers", "network, all channels")
STEPS = {"rigid": 1500, "fem": 50}
MOST = 80
"""Steps of the scenes that are not named there."""
SCALING = {"rigid": (1, 16, 256), "network, markers": (1, 16, 64, 1024)}
"""Environments of the scaling, by scene."""


def cost(name: str, thing: str, steps: int) -> dict:
    """Steps a second, stages and memory of a scene while a scripted policy holds an object."""
    before = resident()
    settings = SCENES[name] | {"objects": [thing]}
    envs = GraspLiftVectorEnv(COUNT, num_threads=1, **settings)
    policy = scripted("ruffini/GraspLift-v0")
    observation, _ = envs.reset(seed=0)
    for _ in range(8):
        observation, *_ = envs.step(policy.predict(observation)[0])
    held, spent, wall, stages = 0, 0.0, 0.0, []
    for _ in range(steps):
        action, _ = policy.predict(observation)
        envs.plan(forget=True)
        begun, clock = time.process_time(), time.perf_counter()
        observation, *_ = envs.step(action)
        took, waited = time.process_time() - begun, time.perf_counter() - clock
        if (observation["proprio"][:, 12:14] > FELT).all():
            held, spent, wall = held + COUNT, spent + took, wall + waited
            stages.append({stage: us for stage, _, us in envs.plan()})
    names = stages[0] if stages else {}
    share = spent / wall if wall else 0.0
    return {
        "scene": name,
        "object": thing,
        "steps": held,
        "us": 1e6 * spent / held if held else None,
        "stages": {
            stage: share * float(np.mean([row[stage] for row in stages])) for stage in names
        },
        "MiB": resident() - before,
        "peak MiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def resident() -> float:
    """Memory of this process that is in use (MiB)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def scaling(name: str, count: int, threads: int, steps: int) -> dict:
    """Steps a second of wall time under the scripted policy: reach, grasp, lift."""
    envs = GraspLiftVectorEnv(count, num_threads=threads, objects=["sphere"], **SCENES[name])
    policy = scripted("ruffini/GraspLift-v0")
    observation, _ = envs.reset(seed=0)
    done, spent = 0, 0.0
    for _ in range(steps):
        action, _ = policy.predict(observation)
        begun = time.perf_counter()
        observation, *_ = envs.step(action)
        spent, done = spent + time.perf_counter() - begun, done + count
    return {"scene": name, "envs": count, "threads": threads, "rate": done / spent}


def work(quick: bool) -> dict[str, tuple]:
    """What is measured: a function and its arguments by key."""
    found: dict[str, tuple] = {}
    for name in QUICK if quick else SCENES:
        steps = STEPS.get(name.split(",")[0], MOST)
        for thing in ("sphere", "cuboid") if name in BOTH and not quick else ("sphere",):
            found[f"cost {name}, {thing}"] = (cost, name, thing, steps)
    threads = [2**i for i in range(int(np.log2(os.cpu_count() or 1)) + 1)]
    for name, counts in SCALING.items():
        for count, some in product(counts[:1] if quick else counts, threads):
            if some <= max(count, 1):
                found[f"scaling {name}, {count:04}, {some}"] = (scaling, name, count, some, MOST)
    return found | beside(quick)


def called(item: tuple) -> dict:
    """A row of the report, with the machine's load when it began."""
    key, function, *rest = item
    load = os.getloadavg()[0]
    return {"key": key, "load": load} | function(*rest)


def main() -> None:
    """Measures what is missing and writes the files."""
    parser = arguments(__doc__)
    options = parser.parse_args()
    form = "quick" if options.quick else "full"
    known = header(MADE_OF, {"environments": COUNT})
    rows = Rows(KEPT / form / "scene_cost.jsonl", known)
    found = {row["key"] for row in rows if "missing" not in row}
    missing = [(key, *item) for key, item in work(options.quick).items() if key not in found]
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
        for row in pool.imap(called, missing):
            rows.add(row)
            print(row["key"], flush=True)
    out, report = folder(parser, options), known | {"note": options.note} | summary(list(rows))
    (out / "scene_cost.json").write_text(json.dumps(report, indent=1) + "\n")
    (out / "scene_cost.md").write_text(markdown(report))
    figure(report, out / "scene_cost.svg")


if __name__ == "__main__":
    main()
