"""Page of `sim_to_sim`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from engine import made, table, text
from paired import RESAMPLED
from sim_to_sim_cases import MODELS, MORE_NODES, UNSOLVED

PAGE = """# Do agents do as well with finite elements?

The agents that come with the package learnt with the network of the gel, `tactile="surrogate"`,
whose displacement and stress are [some per cent off](networks.md). Do these errors mislead
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

## Which of the two is right

HoldStill is decided by `slip`, the share of the contact that slides, and by force. Both are
compared with finely resolved contact, on the motion of such episodes, on [a page of their
own](sliding.md). The even mesh of an environment is too stiff there, and says that more slides than
does. A policy that feels more sliding grips harder, so part of the loss in HoldStill may be that of
the mesh. It may also be that of the network, as nothing here excludes: the agent played some seeds,
those quickest to solve, on a finer mesh, too ({more:,} nodes asked for), whose force is nearer, and
whose sliding is for a sphere, and gripped as hard:

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
        more=MORE_NODES,
        finer_table=finer(report),
        made=made(report),
    )


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
        "and in force [larger ones](sliding.md)."
    )


def clear(rows: list[dict[str, Any]], of: str, times: float = 1.0, unit: str = "") -> str:
    """Policies with a difference whose interval leaves out zero."""
    some = [row for row in rows if row[of]["interval"][0] > 0 or row[of]["interval"][1] < 0]
    digits = 1 if times > 1 else 2
    named = [f"{row['name']} ({row[of]['difference'] * times:+.{digits}f}{unit})" for row in some]
    return ", ".join(named) or "no policy"


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
