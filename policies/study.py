"""Trains every agent from many seeds and keeps a row of each as it is finished.

Use::

    python policies/study.py --out policies/results         # all that is missing, hours
    python policies/study.py --out mine --env ruffini/HoldStill-v0 --kind touch --seeds 100 101
    python policies/study.py --out policies/results --pages # pages of the rows there are

Hyper-parameters were tuned on seeds 0 to 4; the seeds here, 100 and up, were not looked at before
they were reported. One choice was made by them: InsertPeg's agents no longer observe markers by
default, because those of seeds 105 to 109 did better without. Rows are lines of JSON in
``<environment>.jsonl`` of the folder: settings, learning curve, time, and success over evaluation
seeds that no tuning has seen. A stopped study goes on with the first run that has no row there.
Beside the rows are a page and a picture of them.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

from ruffini.agents import CHECKPOINT, first_seed, load
from ruffini.agents.params import params
from ruffini.agents.training import train
from ruffini.evaluation import about_this_run, evaluate
from study_pages import write_pages

RESULTS = Path(__file__).parent / "results"
"""Folder of the rows that are committed."""
FIRST_TRAINING_SEED = 100
"""Training seeds are this and the following."""
SEEDS = 5
"""Number of training seeds of a kind, if none are named."""
EPISODES = 200
FIRST_EVALUATION_SEED = 20_000
"""Evaluation seeds are this and the following: others than tuning was judged by."""

SENSOR_ERRORS: dict[str, Any] = {
    "wrench": {
        "noise": {"force": (0.0, 0.05), "torque": (0.0, 2e-4)},
        "gain": (0.8, 1.25),
        "drift": {"force": (0.0, 0.05), "torque": (0.0, 2e-4)},
        "hysteresis": {"force": (0.0, 0.1)},
        "delay": 1,
    },
    "slip": {"noise": (0.0, 0.05), "delay": 1},
}
"""Errors of sensors (N, N m, 1) that an agent of HoldStill is trained with."""
KINDS: dict[str, dict[str, dict[str, Any]]] = {
    "ruffini/GraspLift-v0": {"touch": {}, "rigid": {"tactile": "none"}},
    "ruffini/GraspFragile-v0": {
        "touch": {},
        "force": {"observation": ["proprio", "wrench"]},
        "blind": {"observation": ["proprio"]},
    },
    "ruffini/GraspSoft-v0": {"touch": {}},
    "ruffini/HoldStill-v0": {
        "touch": {},
        "errors": {"sensor_errors": SENSOR_ERRORS},
        "force": {"observation": ["proprio", "wrench"]},
        "blind": {"observation": ["proprio"]},
    },
    "ruffini/InsertPeg-v0": {
        "touch": {},
        "markers": {"observation": ["proprio", "wrench", "markers"]},
        "blind": {"observation": ["proprio"]},
    },
}
"""Settings of each environment's agents: with the default observation, with forces alone, with the
motion of markers, too, with neither, with rigid pads, and with errors of the sensors."""
OTHERWISE = {"touch": "errors", "errors": "touch"}
"""Kinds whose agents are evaluated with the settings of another one, too, where both exist."""


def rows_of(env_id: str, folder: Path = RESULTS) -> list[dict[str, Any]]:
    """The finished runs of an environment."""
    file = folder / f"{env_id.split('/')[-1]}.jsonl"
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def run(
    env_id: str, kind: str, seed: int, threads: int, keep: Path | None = None
) -> dict[str, Any]:
    """Trains and evaluates one agent; `keep` is a folder for its training run."""
    settings = KINDS[env_id][kind]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "run"
        wall, cpu = time.monotonic(), time.process_time()
        model = train(env_id, seed, folder, settings=settings, threads=threads)
        wall, cpu = time.monotonic() - wall, time.process_time() - cpu
        curve = json.loads((folder / CHECKPOINT / "curve.json").read_text())
        times = json.loads((folder / "times.json").read_text())
        agent = load(folder)
        kinds = KINDS[env_id]
        common = {name: agent.settings[name] for name in agent.settings.keys() - settings.keys()}
        tried = [kind, *([OTHERWISE[kind]] if OTHERWISE.get(kind) in kinds else [])]
        judged, *otherwise = (
            evaluate(
                agent, env_id, EPISODES, first_seed=FIRST_EVALUATION_SEED, **common, **kinds[name]
            )
            for name in tried
        )
        if keep is not None:
            shutil.copytree(folder, keep, dirs_exist_ok=True)
    steps = model.num_timesteps
    return {
        "env": env_id,
        "kind": kind,
        "seed": seed,
        "first_seed": first_seed(seed),
        "steps": steps,
        "threads": threads,
        "wall": round(wall, 1),
        "cpu": round(cpu, 1),
        "steps_per_second": round(steps / wall),
        "shares": {name: round(spent / wall, 3) for name, spent in times.items()},
        "success": judged["success"],
        "interval": judged["interval"],
        "return": judged["return"],
        "by_object": judged["by_object"],
        "endings": judged["endings"],
        "otherwise": {
            name: {key: result[key] for key in ("success", "interval")}
            for name, result in zip(tried[1:], otherwise, strict=True)
        },
        "first_evaluation_seed": FIRST_EVALUATION_SEED,
        "episodes": EPISODES,
        "settings": agent.settings,
        "curve": [[point["steps"], point["success"], point["return"]] for point in curve],
        "about": about_this_run(),
    }


def main() -> None:
    """Parses the command line, trains what is missing, writes the pages."""
    parser = argparse.ArgumentParser(description="Train every agent from many seeds.")
    parser.add_argument("--out", type=Path, required=True, help="folder of rows and pages")
    parser.add_argument("--env", choices=sorted(KINDS), help="this environment alone")
    parser.add_argument("--kind", help="this kind of agent alone, such as touch")
    parser.add_argument("--seeds", type=int, nargs="+", help="these training seeds alone")
    parser.add_argument("--threads", type=int, default=2, help="that the environments step on")
    parser.add_argument("--keep", type=Path, help="folder to keep the training runs in")
    parser.add_argument("--pages", action="store_true", help="train nothing")
    arguments = parser.parse_args()
    out: Path = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    chosen = [arguments.env] if arguments.env else list(KINDS)
    for env_id in [] if arguments.pages else chosen:
        params(env_id)
        kinds = [arguments.kind] if arguments.kind else list(KINDS[env_id])
        for kind in kinds:
            if kind not in KINDS[env_id]:
                known = ", ".join(KINDS[env_id])
                parser.error(f"--kind: found {kind!r}, expected one of {known} for {env_id}")
            first = FIRST_TRAINING_SEED
            for seed in arguments.seeds or range(first, first + SEEDS):
                if any((row["kind"], row["seed"]) == (kind, seed) for row in rows_of(env_id, out)):
                    continue
                name = f"{env_id.split('/')[-1]}-{kind}-{seed}"
                print(f"{name}", flush=True)
                keep = arguments.keep / name if arguments.keep else None
                row = run(env_id, kind, seed, arguments.threads, keep)
                with (out / f"{env_id.split('/')[-1]}.jsonl").open("a") as file:
                    file.write(json.dumps(row) + "\n")
                print(f"{name}: {row['success']:.1%} in {row['wall'] / 60:.1f} min", flush=True)
    for env_id in chosen:
        if rows := rows_of(env_id, out):
            write_pages(rows, out / env_id.split("/")[-1])


if __name__ == "__main__":
    main()
