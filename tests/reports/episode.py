"""One episode as every model of touch tells it: makes episode.json, .md and .svg.

    python tests/reports/episode.py            half an hour on one thread; goes on after a stop
    python tests/reports/episode.py --quick    one episode, a coarse mesh, into target/reports/quick

The scripted policy grasps, lifts and holds, or keeps hold of what is shaken, with
``tactile="fem"`` on a mesh of 2,000 nodes; the same actions are then played with
the other models, so that what differs is the model alone, what it makes of the motion included.
A quiet hold of 60 s shows whether any of them creeps.
"""

from __future__ import annotations

import json
import os
import sys
import time
from typing import Any

import gymnasium
import numpy as np
from episode_hold import THINGS, hold
from episode_pages import CHANNELS, figure, markdown, summary
from kept import KEPT, ROOT, Rows, arguments, folder, header

sys.path.append(str(ROOT / "policies"))
from ruffini.policies import scripted

MADE_OF = ["env-core", "py/src", "tests/reports/episode.py", "tests/reports/episode_hold.py"]
MADE_OF += ["py/python/ruffini/policies"]
"""What the figures come from, under the root."""
MODELS = ("surrogate", "compliance")
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
OBSERVED = ["proprio", "object", "slip", *CHANNELS]
"""What the scripted policies read, and what is judged."""
STEPS = 90
LIGHT = 0.5
"""Net force on the pads together under which a step is not judged (N)."""
FINE, COARSE = 2000, 1000
"""Nodes of the truth, and of the meshes that other models answer on."""


def work(quick: bool) -> dict[str, tuple]:
    """What is made: a function and its arguments by key."""
    names = ["shaken sphere"] if quick else list(EPISODES)
    found: dict[str, tuple] = {
        f"episode/{name}": (episode, name, COARSE if quick else FINE) for name in names
    }
    for thing in THINGS[:1] if quick else THINGS:
        for model in MODELS[:1] if quick else ("fem", *MODELS):
            found[f"hold/{thing}/{model}"] = (hold, thing, model, COARSE)
    return found


def main() -> None:
    """Plays what is missing and writes the files."""
    os.environ["RAYON_NUM_THREADS"] = "1"
    parser = arguments(__doc__)
    options = parser.parse_args()
    sizes = {"nodes of the truth": COARSE if options.quick else FINE, "least force": LIGHT}
    known = header(MADE_OF, sizes)
    rows = Rows(KEPT / ("quick" if options.quick else "full") / "episode.jsonl", known)
    for key, (function, *rest) in work(options.quick).items():
        if key not in rows:
            rows.add({"key": key} | function(*rest))
            print(key, flush=True)
    out, report = folder(parser, options), known | {"note": options.note} | summary(list(rows))
    (out / "episode.json").write_text(json.dumps(report, indent=1) + "\n")
    (out / "episode.md").write_text(markdown(report))
    figure(report, out / "episode.svg")


def episode(name: str, nodes: int) -> dict[str, Any]:
    """Channels of one object's episode by every model, and the errors against finite elements."""
    actions: list[Any] = []
    truth = play(name, "fem", actions, nodes)
    judged = [i for i, step in enumerate(truth["steps"]) if load(step) > LIGHT]
    models = {}
    for model in MODELS:
        told = play(name, model, actions, COARSE)
        steps = [i for i in judged if i < len(told["steps"])]
        errors = {
            channel: [miss(told["steps"][i], truth["steps"][i], channel) for i in steps]
            for channel in (*CHANNELS, "indentation")
        }
        moved = [apart(told["steps"][i], truth["steps"][i]) for i in steps]
        errors["world"] = [coupling(told["steps"][i]) for i in steps]
        models[model] = {"seconds": told["seconds"], "steps": steps, "errors": errors} | {
            "object_apart": moved,
            "ended": told["ended"],
        }
    return {"fem": {"seconds": truth["seconds"], "ended": truth["ended"]}, "models": models}


def play(name: str, model: str, actions: list[Any], nodes: int) -> dict[str, Any]:
    """An episode, with the median seconds of a touching step; the policy fills `actions` if these
    are empty.
    """
    task, thing = EPISODES[name]
    env = gymnasium.make(
        f"ruffini:{task}",
        tactile=model,
        objects=[thing],
        resolution={"nodes": nodes},
        observation=OBSERVED,
        disable_env_checker=True,
    )
    observation, _ = env.reset(seed=3)
    policy, follow = scripted(task), list(actions)
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
        seen = env.unwrapped.look()
        steps[-1]["pads"] = np.array(seen["pad_wrenches"], np.float64).ravel()
        steps[-1]["indentation"] = np.array(seen["indentations"], np.float64)
        if load(steps[-1]) > LIGHT:
            seconds.append(spent)
        if terminated or truncated:
            ended = info.get("press_error") or ("success" if info["is_success"] else "failure")
            break
    env.close()
    return {"steps": steps, "seconds": float(np.median(seconds)), "ended": str(ended)}


def load(step: dict[str, Any]) -> float:
    """Sum of the sizes of the forces on both pads (N)."""
    return float(np.linalg.norm(step["wrench"][:3]) + np.linalg.norm(step["wrench"][6:9]))


def miss(told: dict[str, Any], truth: dict[str, Any], channel: str) -> float:
    """Relative L2 error of what is told of both pads; of a wrench, of its forces."""
    found, exact = told[channel], truth[channel]
    if channel == "wrench":
        found, exact = (np.r_[wrench[:3], wrench[6:9]] for wrench in (found, exact))
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


def coupling(step: dict[str, Any]) -> float:
    """Difference of the forces that the model and the rigid world give the pads, relative to them.

    The elastic foundation presses first and is then corrected: this is what is left to correct.
    """
    told, world = (np.r_[wrench[:3], wrench[6:9]] for wrench in (step["wrench"], step["pads"]))
    return float(np.linalg.norm(told - world) / np.linalg.norm(world))


def apart(told: dict[str, Any], truth: dict[str, Any]) -> float:
    """How far the object is from where it is in the truth (m)."""
    return float(np.linalg.norm(told["object"][:3] - truth["object"][:3]))


if __name__ == "__main__":
    main()
