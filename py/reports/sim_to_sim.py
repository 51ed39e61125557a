"""Policies whose touch is that of the network, played with finite elements instead, two hours.

Agents learn with ``tactile="surrogate"``. If they had learnt to use its errors, or the errors
misled them, they would do worse with finite elements. Every policy with soft tactile pads plays the
same evaluation seeds with both models: an episode has the same object, friction and start, and only
the model of the presses differs. As HoldStill depends on sliding, sliding is then compared with
finer elements and with a closed form. --quick plays two seeds of one task.
"""

from __future__ import annotations

import math
import time
from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from engine import COLOURS, Rows, filled, made, plt, run, table, text
from ruffini.evaluation import FIRST_SEED, wilson
from sim_to_sim_cases import (
    BALL,
    DRAGGED,
    DRAWN,
    FRICTION,
    MORE_NODES,
    PRESSED,
    UNSOLVED,
    dragged,
    episode,
)

ONE_THREAD = True
MADE_OF = ["env-core", "py/src", "py/reports/sim_to_sim.py", "py/reports/sim_to_sim_cases.py"]
MADE_OF += ["py/python/ruffini/agents", "py/python/ruffini/policies"]
MODELS = ("surrogate", "fem")
PLAYED = (
    ("HoldStill", "agent"),
    ("GraspLift", "agent"),
    ("GraspFragile", "agent"),
    ("GraspFragile", "scripted"),
    ("InsertPeg", "scripted"),
    ("HoldStill", "scripted"),
)
"""Tasks with the policies that play them, the most wanted first."""
QUICK = ("GraspFragile", "agent")
SEEDS, BLOCK = 50, 10
"""Seeds of a policy, and how many of it are played before the next policy's turn."""
RESAMPLED = 10_000
"""Resamples of a bootstrap."""
FINER = (10_001, 10_003, 10_014)
"""Seeds of HoldStill that the agent plays on the finer mesh, too."""
TRUTH = "quadratic elements, refined towards the contact"
USED = (0.2, 0.4, 0.6)
"""Fractions of the greatest friction at which sliding is reported."""
TOLD = ("key", "object", "success", "return", "ending", "press_error", "restarts", "steps")
TOLD += ("seconds", "grip")
"""Columns that are kept of each episode."""


def options(parser: ArgumentParser) -> None:
    """Adds options: number of seeds, time."""
    parser.add_argument("--seeds", type=int, default=SEEDS, help="seeds of each policy")
    parser.add_argument("--minutes", type=float, default=math.inf, help="then no more episodes")


def make(options: Namespace) -> dict[str, Any]:
    """Episodes by blocks of seeds, so that a run that is stopped has some of every policy."""
    played, count = ((QUICK,), 2) if options.quick else (PLAYED, options.seeds)
    rows = Rows.of(
        "sim_to_sim", options, MADE_OF, {"first seed": FIRST_SEED, "resamples": RESAMPLED}
    )
    end = time.monotonic() + 60 * options.minutes
    for first in range(0, count, BLOCK):
        for task, policy in played:
            for seed in range(FIRST_SEED + first, FIRST_SEED + min(first + BLOCK, count)):
                if time.monotonic() < end:
                    asked = {
                        f"{task}/{policy}/{seed}/{model}": (episode, task, policy, seed, model)
                        for model in MODELS
                    }
                    run(rows, asked)
    models = list(DRAGGED)[:2] if options.quick else list(DRAGGED)
    asked: dict[str, tuple[Any, ...]] = {
        f"dragged/{shape}/{model}": (dragged, shape, model) for shape in PRESSED for model in models
    }
    for seed in () if options.quick else FINER:
        asked[f"finer/{seed}"] = (episode, "HoldStill", "agent", seed, "fem", MORE_NODES)
    run(rows, {key: case for key, case in asked.items() if time.monotonic() < end})
    found = {f"{task} {policy}": pairs(rows, task, policy) for task, policy in played}
    return rows.header | {
        "note": options.note,
        "wanted": count,
        "policies": {name: compared(some) for name, some in found.items() if some},
        "finer": {row["key"].split("/")[1]: told(row) for row in rows if "finer/" in row["key"]},
        "sliding": sliding(rows),
        "rows": [told(row) for row in rows if row["key"].split("/")[-1] in MODELS],
    }


def told(row: dict[str, Any]) -> dict[str, Any]:
    """Columns of an episode that are kept."""
    return {name: row[name] for name in TOLD}


def sliding(rows: Rows) -> dict[str, Any]:
    """Share that slides by shape, model and friction that is used, and how far from the truth."""
    found: dict[str, Any] = {}
    for row in rows:
        if "sliding" in row:
            shares = np.interp(USED, row["used"], row["sliding"]).tolist()
            found.setdefault(row["shape"], {})[row["model"]] = {"shares": shares}
    for models in found.values():
        for model in models.keys() - {TRUTH} if TRUTH in models else ():
            off = np.subtract(models[model]["shares"], models[TRUTH]["shares"])
            models[model]["off"] = float(off[np.abs(off).argmax()])
    return found


def half_space(used: float) -> float:
    """Share that slides under a ball on a half-space (Cattaneo, Mindlin)."""
    return float((1 - (1 - used) ** (2 / 3)) ** 1.5)


def pairs(rows: Rows, task: str, policy: str) -> list[dict[str, dict[str, Any]]]:
    """Rows by model of each seed that was played with both.

    Raises:
        RuntimeError: If the same seed drew two different episodes.
    """
    by_seed: dict[str, dict[str, Any]] = {}
    for row in rows:
        *of, seed, model = row["key"].split("/")
        if of == [task, policy]:
            by_seed.setdefault(seed, {})[model] = row
    whole = [pair for pair in by_seed.values() if len(pair) == len(MODELS)]
    for pair in whole:
        if any(pair["surrogate"][name] != pair["fem"][name] for name in DRAWN):
            raise RuntimeError(f"{pair['fem']['key']}: another episode than with the network")
    return whole


def compared(some: list[dict[str, dict[str, Any]]]) -> dict[str, Any]:
    """Results of a policy with both models, and their differences, finite elements less network."""
    solved = [pair for pair in some if all(row["ending"] != UNSOLVED for row in pair.values())]
    return {
        "seeds": len(some),
        **{model: alone([pair[model] for pair in some]) for model in MODELS},
        "success": won(some),
        "return": mean_with_interval([p["fem"]["return"] - p["surrogate"]["return"] for p in some]),
        "solved": {
            "seeds": len(solved),
            "success": won(solved),
            "return": mean_with_interval(
                [p["fem"]["return"] - p["surrogate"]["return"] for p in solved]
            ),
        }
        if 0 < len(solved) < len(some)
        else None,
    }


def alone(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Results of a policy with one model."""
    low, high = wilson(sum(row["success"] for row in rows), len(rows))
    names = rows[0]["terms"]
    return {
        "success": float(np.mean([row["success"] for row in rows])),
        "interval": [low, high],
        "return": float(np.mean([row["return"] for row in rows])),
        "outcomes": dict(Counter(outcome(row) for row in rows)),
        "press errors": dict(Counter(r["press_error"] for r in rows if r["ending"] == UNSOLVED)),
        "restarts": sum(row["restarts"] for row in rows),
        "steps": sum(row["steps"] for row in rows),
        "steps_per_second": sum(r["steps"] for r in rows) / sum(r["seconds"] for r in rows),
        "reset_seconds": float(np.mean([row["reset_seconds"] for row in rows])),
        "terms": {name: float(np.mean([row["terms"][name] for row in rows])) for name in names},
        "grip": float(np.mean([row["grip"] for row in rows])),
    }


def outcome(row: dict[str, Any]) -> str:
    """Outcome of an episode: success, the name of its ending, or that its time was up."""
    return "success" if row["success"] else row["ending"] or "time_up"


def won(some: list[dict[str, dict[str, Any]]]) -> dict[str, Any]:
    """Seeds won with both models, one and none, and the difference of success with its interval."""
    counts = Counter((pair["fem"]["success"], pair["surrogate"]["success"]) for pair in some)
    both, fem, network, neither = (
        counts[won] for won in ((True, True), (True, False), (False, True), (False, False))
    )
    low, high = paired_interval(both, fem, network, neither)
    return {
        "both": both,
        "only fem": fem,
        "only surrogate": network,
        "neither": neither,
        "difference": (fem - network) / len(some),
        "interval": [low, high],
        "p": mcnemar(fem, network),
    }


def mcnemar(one: int, other: int) -> float:
    """Exact two-sided p of McNemar's test, from the counts of pairs that differ either way."""
    count = one + other
    tail = sum(math.comb(count, k) for k in range(min(one, other) + 1))
    return min(1.0, 2.0 * tail / 2**count)


def paired_interval(both: int, first: int, second: int, neither: int) -> tuple[float, float]:
    """95 % interval of a difference of paired proportions (Newcombe 1998, method 10).

    Args:
        both: Pairs in which both succeed.
        first: Pairs in which the first alone does.
        second: Pairs in which the second alone does.
        neither: Pairs in which none does.
    """
    count = both + first + second + neither
    one, other = both + first, both + second
    p, q = one / count, other / count
    (p_low, p_high), (q_low, q_high) = wilson(one, count), wilson(other, count)
    product = one * (count - one) * other * (count - other)
    covariance = both * neither - first * second
    if covariance > 0:
        covariance = max(covariance - count / 2, 0)
    phi = covariance / math.sqrt(product) if product else 0.0

    def reach(below: float, above: float) -> float:
        return math.sqrt(max(below**2 - 2 * phi * below * above + above**2, 0.0))

    return p - q - reach(p - p_low, q_high - q), p - q + reach(p_high - p, q - q_low)


def mean_with_interval(values: list[float]) -> dict[str, Any]:
    """Mean with its bootstrapped 95 % interval, and the median."""
    random, found = np.random.default_rng(0), np.array(values)
    means = found[random.integers(len(found), size=(RESAMPLED, len(found)))].mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return {
        "difference": float(found.mean()),
        "interval": [float(low), float(high)],
        "median": float(np.median(found)),
    }


PAGE = """# Do agents do as well with finite elements?

The agents that come with the package learnt with the network of the gel, `tactile="surrogate"`,
whose displacement and stress are off by [a tenth and more](networks.md). Do these errors mislead
them, or have they learnt to use them? Here each policy plays the same evaluation seeds twice: with
the network, and with finite elements in its place, `tactile="fem"`, which it has never felt.
Object, size, mass, friction and start of a seed are the same; another model answers how the pads
deform, and so the hand feels something else, and what it grasps is moved by another force.

{verdict}

{stopped}

![returns with both models, and the differences](sim_to_sim.svg)

## Success

{success}

*Difference* is finite elements less network, with its 95 % interval for pairs (Newcombe 1998,
method 10); *p* is McNemar's, exact: how often seeds that only one of two equal models wins would
fall as unevenly, or more so. *Scripted* policies are written by hand and cannot have learnt errors
of the network: where such a policy loses as much as the agent, the models feel different, and the
agent has learnt nothing that is only true of the network.

{unsolved}

## Return

{returns}

Means over the seeds; the interval of the mean difference is bootstrapped from {resampled:,}
resamples of the seeds. *Steps/s* are those of a processor second of one thread, one environment,
without the reset (of finite elements it solves the first grip and takes {reset}); they were taken
beside other work.

## How episodes end

{endings}

An episode counts as a success if its last step is one, as in every evaluation; up to commit 75af591
a step that ended the episode early could be one.
*Time up* is an episode that ran to its last step without success, and `press_failed` one that ended
because the model did not solve a press: that counts as a failure in all tables above.
*Restarted* is the number of steps in which a press was not solved along its path and was solved
from rest instead, without the friction of the steps before.

## What differs

{terms}

Means over all steps, network → finite elements: terms of the reward, each from 0 to 1, and the grip
that the hand is told to apply.

## Which of the two is right about sliding

HoldStill is decided by `slip`, the share of the contact that slides. Here a ball of {ball:.0f} mm
radius, pressed 0.5 mm into the pad, and a flat block, pressed 0.15 mm, are dragged along the
finger, with friction {friction}; columns are the fraction of the greatest friction that is used.

{sliding_table}

{reading}

{finer_table}

## What this cannot tell

- With so few seeds only large effects show: what the intervals hold is not excluded.

- The finite elements are those that an environment has by default, on about 900 nodes of an even
mesh. They are not exact: against a fine mesh such a mesh is off by 8 % in displacement and 16 % in
stress in [grasps](pareto.md), and by 21 and 22 % under [a ball](fem.md). A difference here is one
between two models, and not the network's alone.

- In GraspFragile the limit of stress comes from a trial grip that the same model computes. An error
of the network that is the same in every grip is in the limit, too, and cancels.

- In GraspLift the object's pose is observed and nearly any firm grip lifts it, so that agents
with rigid pads do as well: there touch decides little.

- Sliding was compared under a steady drag. Whether the network is as near to the reference where a
load goes to and fro, as in HoldStill, was not asked.

- Each agent is one training seed. Pads are springs in the rigid-body engine with both models.

{made}"""


def page(report: dict[str, Any]) -> str:
    """Tables of success, return, endings and terms of the reward."""
    rows = [{"name": name} | found for name, found in report["policies"].items()]
    by_model = [{"name": row["name"], "model": m} | row[m] for row in rows for m in MODELS]
    outcomes = ["success", "time_up", *sorted({o for row in by_model for o in row["outcomes"]})]
    resets = [row["fem"]["reset_seconds"] for row in rows]
    return text(
        PAGE,
        report,
        verdict=verdict(rows),
        stopped=stopped(report),
        success=table(SUCCESS, rows),
        unsolved=unsolved(rows),
        returns=table(RETURN, rows),
        resampled=RESAMPLED,
        reset=f"{min(resets):.2g} to {max(resets):.2g} s",
        endings=table(
            {"policy": "{name}", "felt with": lambda row: MODEL_NAMES[row["model"]]}
            | {headed(o): f"{{outcomes[{o}]}}" for o in dict.fromkeys(outcomes)}
            | {"restarted": "{restarts}"},
            by_model,
            absent="–",
        ),
        terms=table({"policy": "{name}", "terms": terms, "grip (N)": grip}, rows),
        ball=1e3 * BALL,
        friction=FRICTION,
        sliding_table=slides(report["sliding"]),
        reading=reading(report),
        finer_table=finer(report),
        made=made(report),
    )


READING = """Quadratic elements on a mesh refined towards the contact are the reference. The even
mesh of an environment is too coarse for the rim of a contact, where sliding begins, and says that
more slides than does; the network solves contact on finer cells and is nearer to the reference. A
policy that feels more sliding grips harder, so part of the loss in HoldStill may be that of the
mesh. It may also be that of the network, as nothing here excludes: the agent played {count} seeds
on a finer mesh, too ({more} nodes asked for, the seeds quickest to solve), which takes away a
third and more of that excess under the ball, and it gripped as hard. What the loss comes from is
open:"""


def reading(report: dict[str, Any]) -> str:
    """Conclusion from sliding for HoldStill, before the table of a finer mesh."""
    if not report["finer"]:
        return ""
    values = {"more": f"{MORE_NODES:,}", "count": len(report["finer"])}
    return " ".join(filled(READING, values).split())


def slides(found: dict[str, Any]) -> str:
    """Sliding by shape, model and friction that is used, and of a half-space."""
    lines = [
        {"shape": shape, "model": model} | models[model]
        for shape, models in found.items()
        for model in DRAGGED
        if model in models
    ]
    lines.append(
        {"shape": "ball", "model": "half-space, closed form (Cattaneo, Mindlin)"}
        | {"shares": [half_space(used) for used in USED]}
    )
    columns = {"shape": "{shape}", "model": "{model}"}
    columns |= {f"{used:.0%}": f"{{shares[{place}]:.2f}}" for place, used in enumerate(USED)}
    return table(columns | {"largest error": "{off:+.2f}"}, lines, absent="")


def finer(report: dict[str, Any]) -> str:
    """Grip and return of the agent of HoldStill with the network, and on both meshes."""
    if not report["finer"]:
        return ""
    by_key = {row["key"]: row for row in report["rows"]}
    lines = [
        {"seed": seed, "fine": row}
        | {model: by_key[f"HoldStill/agent/{seed}/{model}"] for model in MODELS}
        for seed, row in report["finer"].items()
        if f"HoldStill/agent/{seed}/fem" in by_key
    ]
    columns = {"seed": "{seed}", "object": "{fine[object]}"}
    for of, digits in (("grip", 2), ("return", 1)):
        columns |= {
            f"{of}, {name}": f"{{{place}[{of}]:.{digits}f}}"
            for name, place in (
                ("network", "surrogate"),
                ("finite elements", "fem"),
                ("finer", "fine"),
            )
        }
    return table(columns, lines)


def interval(key: str, times: float = 1.0, digits: int = 1) -> Callable[[Any], str]:
    """A column: a difference with its interval."""

    def cell(row: dict[str, Any]) -> str:
        values = [row[key]["difference"], *row[key]["interval"]]
        one, low, high = (f"{times * value:+.{digits}f}" for value in values)
        return f"{one} ({low} to {high})"

    return cell


MODEL_NAMES = {"surrogate": "network", "fem": "finite elements"}
SUCCESS: dict[str, Any] = {
    "policy": "{name}",
    "seeds": "{seeds}",
    "network": "{surrogate[success]:100*.0f} %",
    "finite elements": "{fem[success]:100*.0f} %",
    "difference (points)": interval("success", 100),
    "won with both": "{success[both]}",
    "network alone": "{success[only surrogate]}",
    "finite elements alone": "{success[only fem]}",
    "neither": "{success[neither]}",
    "p": "{success[p]:.2g}",
}
RETURN: dict[str, Any] = {
    "policy": "{name}",
    "network": "{surrogate[return]:.2f}",
    "finite elements": "{fem[return]:.2f}",
    "mean difference": interval("return", digits=2),
    "median difference": "{return[median]:+.2f}",
    "steps/s, network": "{surrogate[steps_per_second]:,.0f}",
    "finite elements, steps/s": "{fem[steps_per_second]:.1f}",
}


UNSOLVED_TEXT = (
    "Some episodes ended because a model did not solve a press. They count as failures above; "
    "without their seeds the differences are:"
)


def headed(ending: str) -> str:
    """Heading of a column of outcomes."""
    return {"success": "success", "time_up": "time up"}.get(ending, f"`{ending}`")


def verdict(rows: list[dict[str, Any]]) -> str:
    """Summary of all pairs of episodes, in words."""
    count = sum(row["seeds"] for row in rows)
    both, network, fem, neither = (
        sum(row["success"][of] for row in rows)
        for of in ("both", "only surrogate", "only fem", "neither")
    )
    return (
        f"Of {count} pairs of episodes **{both} were won with both models, {network} with the "
        f"network alone, {fem} with finite elements alone** and {neither} with neither. Success "
        f"differs by more than chance for {clear(rows, 'success', 100, ' points')}, the mean "
        f"return for {clear(rows, 'return')}. *By more than chance* is said where the 95 % "
        "interval leaves out zero, as by chance alone one in twenty does. A difference is not yet "
        "an error of the network: these finite elements have errors, too, in sliding "
        "[larger ones](#which-of-the-two-is-right-about-sliding)."
    )


def clear(rows: list[dict[str, Any]], of: str, times: float = 1.0, unit: str = "") -> str:
    """Policies with a difference whose interval leaves out zero."""
    some = [row for row in rows if row[of]["interval"][0] > 0 or row[of]["interval"][1] < 0]
    digits = 1 if times > 1 else 2
    told = [f"{row['name']} ({row[of]['difference'] * times:+.{digits}f}{unit})" for row in some]
    return ", ".join(told) or "no policy"


def stopped(report: dict[str, Any]) -> str:
    """Sentence on the seeds that are missing."""
    fewer = {name: found["seeds"] for name, found in report["policies"].items()}
    if all(count >= report["wanted"] for count in fewer.values()):
        return ""
    counts = ", ".join(f"{name} {count}" for name, count in fewer.items())
    return (
        f"{report['wanted']} seeds of each policy were asked for; finite elements are slow, and the"
        f" run was stopped after: {counts}."
    )


def unsolved(rows: list[dict[str, Any]]) -> str:
    """Differences without the seeds in which a model did not solve a press."""
    if not any(UNSOLVED in row[model]["outcomes"] for row in rows for model in MODELS):
        return "Every press was solved, by both models."
    columns = {
        "policy": "{name}",
        "seeds": "{seeds}",
        "difference (points)": interval("success", 100),
        "mean difference of return": interval("return", digits=2),
    }
    some = [{"name": row["name"]} | row["solved"] for row in rows if row["solved"]]
    return f"{UNSOLVED_TEXT}\n\n{table(columns, some)}"


def terms(row: dict[str, Any]) -> str:
    """Mean terms of the reward with both models."""
    pairs = {name: [row[model]["terms"][name] for model in MODELS] for name in row["fem"]["terms"]}
    return ", ".join(f"{name} {a:.3f} → {b:.3f}" for name, (a, b) in pairs.items())


def grip(row: dict[str, Any]) -> str:
    """Mean grip with both models."""
    return " → ".join(f"{row[model]['grip']:.2f}" for model in MODELS)


WON = {
    "won with both": ("o", COLOURS["fem"]),
    "won with the network alone": ("v", COLOURS["surrogate"]),
    "won with finite elements alone": ("^", COLOURS["linear"]),
    "won with neither": ("x", "black"),
    "a press not solved": ("s", COLOURS["paper"]),
}
"""Marker and colour of a seed, by its outcome."""
LEGEND: dict[str, Any] = {"ncols": len(WON), "loc": "outside lower center"}


def figure(report: dict[str, Any]):
    """Differences with their intervals, and the returns of each seed with both models."""
    policies = report["policies"]
    lines = math.ceil(len(policies) / 3)
    heights = [0.8 + 0.2 * len(policies), 2.7 * lines]
    picture = plt.figure(figsize=(10, sum(heights) + 0.4), layout="constrained")
    upper, lower = picture.subfigures(2, 1, height_ratios=heights)
    differ = upper.subplots(1, 2, sharey=True)
    for axis, of, times, unit in zip(
        differ, ("success", "return"), (100, 1), (" (points)", ""), strict=True
    ):
        for height, found in enumerate(policies.values()):
            middle, ends = found[of]["difference"], found[of]["interval"]
            axis.plot([times * end for end in ends], [height] * 2, color=COLOURS["fem"], lw=2)
            axis.plot(times * middle, height, "o", color=COLOURS["fem"], ms=5)
        axis.axvline(0, color="black", lw=0.8)
        axis.set(xlabel=f"{of}: finite elements less network{unit}")
        axis.grid(alpha=0.3, axis="x")
    labels = [f"{name} ({found['seeds']} seeds)" for name, found in policies.items()]
    differ[0].set_yticks(range(len(policies)), labels)
    differ[0].set_ylim(len(policies) - 0.5, -0.5)
    axes = lower.subplots(lines, 3, squeeze=False).ravel()
    by_key = {row["key"]: row for row in report["rows"]}
    drawn: dict[str, Any] = {}
    for axis in axes[len(policies) :]:
        axis.set_axis_off()
    for axis, name in zip(axes, policies, strict=False):
        points = [
            pair
            for key in by_key
            if key.startswith(name.replace(" ", "/")) and (pair := returns(key, by_key))
        ]
        for of, (marker, colour) in WON.items():
            at = np.array([pair[1:] for pair in points if pair[0] == of]).T
            if len(at):
                drawn[of] = axis.plot(*at, marker, color=colour, ms=4, label=of, alpha=0.7)[0]
        ends = [min(min(pair[1:]) for pair in points), max(max(pair[1:]) for pair in points)]
        axis.plot(ends, ends, color="black", lw=0.8)
        axis.set(title=name, xlabel="return with the network", ylabel="with finite elements")
        axis.grid(alpha=0.3)
    drawn = {of: drawn[of] for of in WON if of in drawn}
    lower.legend(drawn.values(), list(drawn), **LEGEND)
    return picture


def returns(key: str, rows: dict[str, Any]) -> tuple[str, float, float] | None:
    """Outcome of the seed of a key of finite elements, and the returns with both models."""
    if not key.endswith("/fem") or key.replace("/fem", "/surrogate") not in rows:
        return None
    fem, network = rows[key], rows[key.replace("/fem", "/surrogate")]
    won = {
        (True, True): "won with both",
        (False, True): "won with the network alone",
        (True, False): "won with finite elements alone",
        (False, False): "won with neither",
    }[fem["success"], network["success"]]
    if UNSOLVED in (fem["ending"], network["ending"]):
        won = "a press not solved"
    return won, network["return"], fem["return"]
