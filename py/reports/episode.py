"""One episode with every model of touch, forty minutes on one thread.

The scripted policy grasps, lifts and holds, or keeps hold of what is shaken, with
``tactile="fem"`` on a mesh of 4,700 nodes; the same actions are then played with the other models,
so that the model alone differs, with its effect on the motion. A quiet hold of 60 s
shows whether any of them creeps. --quick plays one episode on a coarse mesh.
"""

from __future__ import annotations

import json
from argparse import Namespace
from functools import cache
from typing import Any

import gymnasium
import numpy as np

import ruffini
from engine import COLOURS, OUT, Rows, made, plt, quantiles, run, table, text
from ruffini._errors import apart
from ruffini.policies import scripted
from timing import timed

ONE_THREAD = True
MADE_OF = ["env-core", "py/src", "py/reports/episode.py", "py/python/ruffini/policies"]
MODELS = ("surrogate", "compliance")
LIFT, HOLD = "ruffini/GraspLift-v0", "ruffini/HoldStill-v0"
EPISODES = {
    "sphere": (LIFT, "sphere"),
    "cuboid": (LIFT, "cuboid"),
    "cylinder": (LIFT, "cylinder"),
    "potato": (LIFT, "potato"),
    "cup": (LIFT, "cup"),
    "shaken sphere": (HOLD, "sphere"),
    "shaken cuboid": (HOLD, "cuboid"),
}
"""Task and object of each episode."""
CHANNELS = ("markers", "tet_stress", "traction", "wrench")
OBSERVED = ["proprio", "object", "slip", *CHANNELS]
"""Channels that the scripted policies read, and those that are judged."""
PREDICTED = {"markers": "displacement", "tet_stress": "stress", "wrench": "force"}
"""Channels whose errors are compared with those that the network predicts, in their order."""
NETWORK = "surrogate"
STEPS, HELD, SETTLED = 90, 1500, 25
"""Control steps of an episode, of a hold (60 s), and after which it counts as settled (1 s)."""
GRIP = 4.0
"""Grip force of a hold (N)."""
LIGHT = 0.5
"""Net force on the pads together under which a step is not judged (N)."""
FINE, COARSE = 4700, 1000
"""Nodes of the truth, and of the meshes that other models answer on."""


def make(options: Namespace) -> dict[str, Any]:
    """Episodes, then holds."""
    nodes = COARSE if options.quick else FINE
    sizes = {"nodes of the truth": nodes, "least force": LIGHT}
    rows = Rows.of("episode", options, MADE_OF, sizes)
    names = ["shaken sphere"] if options.quick else list(EPISODES)
    things = ("sphere",) if options.quick else ("sphere", "cuboid")
    models = MODELS[:1] if options.quick else ("fem", *MODELS)
    run(
        rows,
        {f"episode/{name}": (episode, name, nodes) for name in names}
        | {f"hold/{thing}/{model}": (hold, thing, model) for thing in things for model in models},
    )
    medians: dict[str, Any] = {}
    for row in rows:
        for model, played in row.get("models", {}).items():
            errors = {what: float(np.median(values)) for what, values in played["errors"].items()}
            medians.setdefault(row["key"].split("/")[1], {})[model] = errors
    return rows.header | {"note": options.note, "medians": medians, "rows": list(rows)}


def environment(task: str, model: str, thing: str, nodes: int, **settings: Any) -> gymnasium.Env:
    """A task with an object and a model of touch."""
    return gymnasium.make(
        f"ruffini:{task}",
        tactile=model,
        objects=[thing],
        resolution={"nodes": nodes},
        disable_env_checker=True,
        **settings,
    )


def episode(name: str, nodes: int) -> dict[str, Any]:
    """Channels of one object's episode by every model, and the errors against finite elements."""
    actions: list[Any] = []
    reference = play(name, "fem", actions, nodes)
    judged = [i for i, step in enumerate(reference["steps"]) if load(step) > LIGHT]
    models = {}
    for model in MODELS:
        played = play(name, model, actions, COARSE)
        steps = [i for i in judged if i < len(played["steps"])]
        pairs = [(played["steps"][i], reference["steps"][i]) for i in steps]
        errors = {
            channel: [miss(step[channel], true[channel], channel) for step, true in pairs]
            for channel in (*CHANNELS, "indentation")
        }
        # The elastic foundation presses first and is then corrected: what is left to correct.
        errors["world"] = [miss(step["wrench"], step["pads"], "wrench") for step, _ in pairs]
        if model == NETWORK:
            errors_of_pads = [judged_pads(step, true) for step, true in pairs]
            predicted = [step["predicted_error"].reshape(2, 3).tolist() for step, _ in pairs]
            told = {"errors_of_pads": errors_of_pads, "predicted": predicted}
        else:
            told = {}
        models[model] = (
            {"seconds": played["seconds"], "steps": steps, "errors": errors}
            | told
            | {
                "object_apart": [
                    size(step["object"][:3] - true["object"][:3]) for step, true in pairs
                ],
                "ended": played["ended"],
            }
        )
    return {"fem": {"seconds": reference["seconds"], "ended": reference["ended"]}, "models": models}


def play(name: str, model: str, actions: list[Any], nodes: int) -> dict[str, Any]:
    """An episode, with the median seconds of a touching step.

    The policy fills `actions` if these are empty.
    """
    task, thing = EPISODES[name]
    observed = [*OBSERVED, *(["predicted_error"] if model == NETWORK else [])]
    env = environment(task, model, thing, nodes, observation=observed)
    observation, _ = env.reset(seed=3)
    policy, follow = scripted(task), list(actions)
    steps, seconds, ended = [], [], "the last step"
    for i in range(len(follow) or STEPS):
        batch = {key: value[None] for key, value in observation.items()}
        action = follow[i] if follow else policy.predict(batch)[0][0]
        if not follow:
            actions.append(action)
        (observation, _, terminated, truncated, info), spent, _ = timed(env.step, action)
        steps.append({key: np.array(value, np.float64) for key, value in observation.items()})
        steps[-1]["tet_stress"] = on_coarse(steps[-1]["tet_stress"], nodes)
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


@cache
def coarser(nodes: int) -> ruffini.Transfer:
    """Transfer of fields to the mesh on which the other models answer."""
    fine, coarse = (ruffini.sensor("gelsight-mini", resolution=n).mesh for n in (nodes, COARSE))
    return ruffini.Transfer(fine, coarse)


def on_coarse(stress: np.ndarray, nodes: int) -> np.ndarray:
    """Stress of the tetrahedra of both pads, averaged over those of the coarse mesh."""
    if nodes == COARSE:
        return stress
    return np.concatenate([coarser(nodes).average(pad) for pad in stress.reshape(2, -1)])


def size(vector: np.ndarray) -> float:
    """L2 norm."""
    return float(np.linalg.norm(vector))


def forces(wrench: np.ndarray) -> np.ndarray:
    """Forces (2, 3) on both pads, of wrenches in a row: force and torque of each (12,)."""
    return wrench.reshape(2, 2, 3)[:, 0]


def load(step: dict[str, Any]) -> float:
    """Sum of the sizes of the forces on both pads (N)."""
    return sum(map(size, forces(step["wrench"])))


def miss(found: np.ndarray, exact: np.ndarray, channel: str) -> float:
    """Relative L2 error of a channel of both pads; of a wrench, of its forces."""
    if channel == "wrench":
        found, exact = map(forces, (found, exact))
    return apart(found, exact)


def judged_pads(step: dict[str, Any], true: dict[str, Any]) -> list[list[float]]:
    """Relative errors (2 pads, 3) of the channels whose errors are predicted."""

    def of_pads(channel: str) -> list[float]:
        found, exact = (one[channel].reshape(2, -1) for one in (step, true))
        if channel == "wrench":
            found, exact = found[:, :3], exact[:, :3]
        return [apart(*pair) for pair in zip(found, exact, strict=True)]

    return np.transpose([of_pads(channel) for channel in PREDICTED]).tolist()


def hold(thing: str, model: str) -> dict[str, float]:
    """Change between the first second and the last of a hold without load or shaking.

    Relative L2 for channels; for the object the way it went (m).
    """
    channels = ("markers", "wrench")
    still = {"max_episode_steps": HELD + 1, "start_grip": GRIP, "load": 0.0, "shaking": 0.0}
    seen = ["proprio", "object", *channels]
    env = environment(HOLD, model, thing, COARSE, observation=seen, **still)
    env.reset(seed=3)
    kept: list[dict[str, Any]] = []
    for step in range(1, HELD + 1):
        observation, _, terminated, _, info = env.step(np.zeros(5, np.float32))
        if step in (SETTLED, HELD):
            kept.append({key: np.array(value, float) for key, value in observation.items()})
        if terminated:
            raise RuntimeError(f"{thing} with {model} ended after {step} steps: {info}")
    env.close()
    first, last = kept
    change = {key: size(last[key] - first[key]) / size(first[key]) for key in channels}
    return change | {"object": size((last["object"] - first["object"])[:3])}


PAGE = """# One episode as every model of touch tells it

*surrogate* is the network that environments feel with, *compliance* the linear elasticity that it
corrects.

Relative L² error of each channel, both pads, against finite elements on {sizes[nodes of the truth]}
nodes in the same steps of the same actions, median / 95th percentile; of a wrench, its force; of
stress, that of all tetrahedra, averaged over those of the mesh on which the other models answer.
*Indentation* is how deep the object stands in the undeformed faces at that force (error in %). A
step is judged where the pads bear more than {sizes[least force]} N together. *Model against world*
is how far the forces of a model are from those that move the object in the same step, before they
are corrected. Time is the median processor time of a touching step of one environment with all four
channels and `slip`, and so with stress; *FEM* is that of finite elements. *Object apart* is the
largest distance of the object from where it is with finite elements.

{episodes}

{judge}

![errors along the episode](episode.svg)

## Does the network know its errors here?

The channel `predicted_error` of each pad is what the network expects of itself, so that 19 of 20
errors are below it. It was fitted to errors of whole fields in single presses, against a finer
truth; here it is held against the errors of channels along these episodes: `markers` for the
displacement, `tet_stress`, and the force of `wrench`. Each cell has the median of the predicted
errors, the median of the true ones (both in %), and the share of true errors below the predicted
ones. The force is corrected to what moves the object after the network gives it, so its errors are
far below those predicted.

{known}

{known_told}

## A hold of 60 s

Without load or shaking: what changed between the first second and the last, of channels relative to
their size.

{holds}

{made}"""


def judge(nodes: int) -> str:
    """Sentence on the errors of the finite elements that judge, under a ball."""
    cases = json.loads((OUT / "fem.json").read_text())["cases"]["accuracy 0.48"]["rows"]
    known = [
        row["depths"]
        for row in cases
        if row["element"] == "p1-bar" and abs(row["vertices"] - nodes) < 0.01 * nodes
    ]
    if not known:
        return f"The errors of finite elements with {nodes} nodes are not known, as in a small run."
    depths = known[0]
    off = [
        " and ".join(f"{100 * found[key]:.1f}" for found in depths.values())
        for key in ("displacement_error", "von_mises_error")
    ]
    return (
        f"These finite elements have errors, too: {off[0]} % in displacement and {off[1]} % in "
        f"stress under a ball of 4 mm, {' and '.join(depths)} mm deep ([report](fem.md); stress "
        "there is not averaged). Differences between models that are smaller than that do not tell "
        "which is nearer to the truth."
    )


def page(report: dict[str, Any]) -> str:
    """Errors along episodes, and holds."""

    def named(row: dict[str, Any]) -> dict[str, Any]:
        return row | dict(zip(("name", "model"), row["key"].split("/")[1:], strict=False))

    played = [
        named(row) | {"model": model} | of
        for row in report["rows"]
        for model, of in row.get("models", {}).items()
    ]
    errors = {what: spread(what) for what in (*CHANNELS, "indentation")}
    columns = {"object": "{name}", "model": "{model}", **errors}
    columns |= {"model against world": spread("world")}
    columns["object apart (µm)"] = lambda row: (
        f"{1e6 * max(row['object_apart'], default=float('nan')):.0f}"
    )
    columns |= {"ms a step": "{seconds:1e3*.2f}", "FEM, ms a step": "{fem[seconds]:1e3*.0f}"}
    holds = {"object": "{name}", "model": "{model}"}
    holds |= {"markers": "{markers:.1e}", "wrench": "{wrench:.1e}"}
    still = [named(row) for row in report["rows"] if "models" not in row]
    felt = [row for row in played if "predicted" in row]
    known = {"object": "{name}"} | {what: known_of(i) for i, what in enumerate(PREDICTED.values())}
    return text(
        PAGE,
        report,
        episodes=table(columns | {"ended by": "{ended}"}, played),
        judge=judge(report["sizes"]["nodes of the truth"]),
        known=table(known, felt),
        known_told=known_told(felt),
        holds=table(holds | {"object (µm)": "{object:1e6*.3f}"}, still),
        made=made(report),
    )


def pairs_of(row: dict[str, Any], part: int) -> tuple[np.ndarray, np.ndarray]:
    """Predicted and true errors of one quantity, of both pads in all judged steps."""
    predicted, true = (np.array(row[key])[..., part] for key in ("predicted", "errors_of_pads"))
    return predicted.ravel(), true.ravel()


def known_of(part: int):
    """A column: medians of predicted and true errors, and the share of those within."""

    def cell(row: dict[str, Any]) -> str:
        predicted, true = pairs_of(row, part)
        medians = f"{100 * np.median(predicted):.0f} / {100 * np.median(true):.1f}"
        return f"{medians} / {100 * np.mean(true <= predicted):.0f} %"

    return cell


def known_told(rows: list[dict[str, Any]]) -> str:
    """Share of errors within what is predicted, over all episodes."""
    told = []
    for part, what in enumerate(PREDICTED.values()):
        pairs = [pairs_of(row, part) for row in rows]
        predicted, true = (np.concatenate(of) for of in zip(*pairs, strict=True))
        within = 100 * np.mean(true <= predicted)
        told.append(f"{within:.0f} % of {len(true):,} errors in {what} are within")
    return "Over all episodes, " + ", ".join(told) + " what is predicted."


def spread(what: str):
    """A column: median and 95th percentile of an error in per cent."""

    def cell(row: dict[str, Any]) -> str:
        errors = row["errors"][what]
        if not errors:
            return "–"
        return " / ".join(f"{100 * x:.1f}" for x in quantiles(errors).values())

    return cell


def figure(report: dict[str, Any]):
    """Errors along the episodes, a row an object and a column a channel."""
    episodes = [row for row in report["rows"] if "models" in row]
    shape = (len(episodes), len(CHANNELS))
    size = (3 * len(CHANNELS), 2.2 * len(episodes))
    picture, axes = plt.subplots(*shape, figsize=size, layout="constrained", squeeze=False)
    for line, row in zip(axes, episodes, strict=True):
        for axis, channel in zip(line, CHANNELS, strict=True):
            for model, played in row["models"].items():
                errors = [100 * error for error in played["errors"][channel]]
                axis.plot(played["steps"], errors, label=model, color=COLOURS[model], lw=1.2)
            if channel == "wrench":
                axis.set_yscale("log")
            else:
                axis.set_ylim(bottom=0)
            name = row["key"].split("/")[1]
            axis.set(title=f"{name}: {channel}", xlabel="control step", ylabel="error (%)")
            axis.grid(alpha=0.3)
    axes[0][0].legend(fontsize=7)
    return picture
