"""One episode as every model of touch tells it: error of each channel against finite elements.

The scripted policy grasps, lifts and holds, or keeps hold of what is shaken, with
``tactile="fem"`` on a mesh as fine as the networks' teacher; the same actions are then played with
the other models, so that what differs is the model alone, what it makes of the motion included.
A quiet hold of 60 s shows whether any of them creeps.
Writes ``episode.json``, ``episode.md`` and ``episode.svg`` beside itself. Half an hour on
one thread; ``--quick`` is one object and a coarse mesh. Use::

    RAYON_NUM_THREADS=1 python tests/reports/episode.py
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium
import matplotlib
import numpy as np
from episode_hold import holds, table

HERE = Path(__file__).resolve().parent
sys.path.append(str(HERE.parents[1] / "policies"))
from evaluate import SCRIPTED

matplotlib.use("svg")
import matplotlib.pyplot as plt

MODELS = ("surrogate", "surrogate-fine", "compliance")
LIFT, HOLD = "ruffini/GraspLift-v0", "ruffini/HoldStill-v0"
EPISODES = {
    "sphere": (LIFT, "sphere"),
    "cuboid": (LIFT, "cuboid"),
    "cylinder": (LIFT, "cylinder"),
    "potato": (LIFT, "potato"),
    "shaken sphere": (HOLD, "sphere"),
    "shaken cuboid": (HOLD, "cuboid"),
}
"""Task and object of each episode."""
CHANNELS = ("markers", "stress", "traction", "wrench")
STEPS = 90
LIGHT = 0.5
"""Net force on the pads together under which a step is not judged (N)."""


def main() -> None:
    """Plays every object with every model and writes the three files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one object, 1,000 nodes")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for the report")
    options = parser.parse_args()
    names, nodes = (["sphere"], 1000) if options.quick else (list(EPISODES), 2000)
    episodes = {name: episode(name, nodes) for name in names}
    held = ("surrogate",) if options.quick else ("fem", *MODELS)
    git = ["git", "-C", str(HERE), "rev-parse", "--short", "HEAD"]
    report = {
        "commit": subprocess.check_output(git, text=True).strip(),
        "machine": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "threads": os.environ.get("RAYON_NUM_THREADS", "all"),
        "fem_nodes": nodes,
        "episodes": episodes,
        "holds": holds(held, 1000),
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "episode.json").write_text(json.dumps(report, indent=1) + "\n")
    (options.out / "episode.md").write_text(page(report))
    draw(report, options.out / "episode.svg")
    print(page(report))


def episode(name: str, nodes: int) -> dict[str, Any]:
    """Channels of one object's episode by every model, and the errors against finite elements."""
    actions: list[Any] = []
    truth = play(name, "fem", actions, nodes)
    judged = [i for i, step in enumerate(truth["steps"]) if load(step) > LIGHT]
    models = {}
    for model in MODELS:
        told = play(name, model, actions, 1000)
        steps = [i for i in judged if i < len(told["steps"])]
        errors = {
            channel: [miss(told["steps"][i], truth["steps"][i], channel) for i in steps]
            for channel in CHANNELS
        }
        moved = [apart(told["steps"][i], truth["steps"][i]) for i in steps]
        errors["world"] = [coupling(told["steps"][i]) for i in steps]
        models[model] = {"seconds": told["seconds"], "steps": steps, "errors": errors} | {
            "object_apart": moved,
            "ended": told["ended"],
        }
    return {"fem": {"seconds": truth["seconds"], "ended": truth["ended"]}, "models": models}


def play(name: str, model: str, actions: list[Any], nodes: int) -> dict[str, Any]:
    """An episode, with seconds a touching step; the policy fills `actions` if these are empty."""
    task, thing = EPISODES[name]
    env = gymnasium.make(
        f"ruffini:{task}",
        tactile=model,
        objects=[thing],
        resolution={"nodes": nodes},
        observation=["proprio", "object", *CHANNELS],
        disable_env_checker=True,
    )
    observation, _ = env.reset(seed=3)
    policy, follow = SCRIPTED[task](), list(actions)
    steps, seconds, ended = [], [], "the last step"
    for i in range(len(follow) or STEPS):
        batch = {key: value[None] for key, value in observation.items()}
        action = follow[i] if follow else policy.predict(batch)[0][0]
        if not follow:
            actions.append(action)
        start = time.process_time()
        observation, _, terminated, truncated, info = env.step(action)
        spent = time.process_time() - start
        steps.append({key: np.array(value, np.float64) for key, value in observation.items()})
        steps[-1]["pads"] = np.array(env.unwrapped.look()["pad_wrenches"], np.float64).ravel()
        if load(steps[-1]) > LIGHT:
            seconds.append(spent)
        if terminated or truncated:
            ended = info.get("press_error") or ("success" if info["is_success"] else "failure")
            break
    env.close()
    return {"steps": steps, "seconds": float(np.mean(seconds)), "ended": str(ended)}


def load(step: dict[str, Any]) -> float:
    """Sum of the sizes of the forces on both pads (N)."""
    return float(np.linalg.norm(step["wrench"][:3]) + np.linalg.norm(step["wrench"][6:9]))


def miss(told: dict[str, Any], truth: dict[str, Any], channel: str) -> float:
    """Relative L2 error of a channel of both pads; of a wrench, of its forces."""
    found, exact = told[channel], truth[channel]
    if channel == "wrench":
        found, exact = (np.r_[wrench[:3], wrench[6:9]] for wrench in (found, exact))
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


def coupling(step: dict[str, Any]) -> float:
    """Difference of the forces that the model and the rigid world give the pads, relative to them.

    The bed of the world presses first and is then corrected: this is what is left to correct.
    """
    told, world = (np.r_[wrench[:3], wrench[6:9]] for wrench in (step["wrench"], step["pads"]))
    return float(np.linalg.norm(told - world) / np.linalg.norm(world))


def apart(told: dict[str, Any], truth: dict[str, Any]) -> float:
    """How far the object is from where it is in the truth (m)."""
    return float(np.linalg.norm(told["object"][:3] - truth["object"][:3]))


def page(report: dict[str, Any]) -> str:
    """The report in words and tables."""
    rows = []
    for name, found in report["episodes"].items():
        for model, told in found["models"].items():
            cells = [spread(told["errors"][channel]) for channel in (*CHANNELS, "world")]
            apart = 1e6 * max(told["object_apart"], default=float("nan"))
            ended, seconds = told["ended"], 1e3 * told["seconds"]
            fem = 1e3 * found["fem"]["seconds"]
            row = [name, model, *cells, f"{apart:.0f}", f"{seconds:.2f}", f"{fem:.0f}", ended]
            rows.append("| " + " | ".join(row) + " |")
    head = ["object", "model", *CHANNELS, "model against world", "object apart (µm)"]
    head += ["ms a step", "FEM", "ended by"]
    return "\n".join(
        [
            "# One episode as every model of touch tells it",
            "",
            "Relative L² error of each channel, both pads, against finite elements on "
            f"{report['fem_nodes']} nodes in the same steps of the same actions, median / 95th "
            "percentile; of a wrench, its force. A step is judged where the pads bear more than "
            f"{LIGHT} N together. *Model against world* is how far the forces of a model are from "
            "those that move the object in the same step, before they are corrected. Time is "
            "processor time of a touching step of one environment "
            "with all four channels, and so with stress.",
            "",
            "| " + " | ".join(head) + " |",
            "| --- " * len(head) + "|",
            *rows,
            "",
            "![errors along the episode](episode.svg)",
            "",
            *table(report["holds"]),
            "",
            f"Made at commit {report['commit']} on {report['cores']} cores ({report['machine']}), "
            f"{report['threads']} thread(s); `python tests/reports/episode.py`.",
            "",
        ]
    )


def spread(errors: list[float]) -> str:
    """Median and 95th percentile in per cent."""
    if not errors:
        return "–"
    return " / ".join(f"{100 * x:.1f}" for x in np.percentile(errors, [50, 95]))


def draw(report: dict[str, Any], path: Path) -> None:
    """Errors along the episodes, a row an object and a column a channel."""
    episodes = report["episodes"]
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": "episode", "font.size": 8}):
        size = (3 * len(CHANNELS), 2.2 * len(episodes))
        picture, axes = plt.subplots(
            len(episodes), len(CHANNELS), figsize=size, layout="constrained", squeeze=False
        )
        for row, (name, found) in zip(axes, episodes.items(), strict=True):
            for axis, channel in zip(row, CHANNELS, strict=True):
                for model, told in found["models"].items():
                    errors = [100 * error for error in told["errors"][channel]]
                    axis.semilogy(told["steps"], errors, label=model)
                axis.set(title=f"{name}: {channel}", xlabel="control step", ylabel="error (%)")
                axis.grid(alpha=0.3)
        axes[0][0].legend(fontsize=7)
        picture.savefig(path, metadata={"Date": None})
        plt.close(picture)


if __name__ == "__main__":
    main()
