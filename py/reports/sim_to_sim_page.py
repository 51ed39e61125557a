"""Page of `sim_to_sim`."""

from __future__ import annotations

import json
from collections.abc import Callable
from statistics import fmean
from typing import Any

from engine import OUT, made, table, text
from paired import RESAMPLED
from ruffini import TASKS
from sim_to_sim_cases import MODELS, UNSOLVED

PAGE = """# Do agents do as well with finite elements?

The agents that come with the package learnt with the network of the gel, `tactile="surrogate"`,
whose displacement and stress are [some per cent off](networks.md). Do these errors mislead
them, or have they learnt to use them? Here each policy plays the same evaluation seeds twice: with
the network, and with finite elements in its place, `tactile="fem"`, which it has never felt.
Object, size, mass, friction and start of a seed are the same; another model answers how the pads
deform, and so the hand feels something else, and what it grasps is moved by another force.

{verdict}

{lost}

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
beside other work. Finite elements are {slower} times as slow.

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

HoldStill is decided by `slip`, the share of the normal force that is carried where the pad slides:
an agent that feels more of it grips harder. Against the closed form of a ball on a half-space the
network is within 0.1, as refined elements are, and the finite elements of an environment say by up
to 0.5 more ([report](sliding.md)). Under objects that are held the network says less than refined
elements do, by 0.05 to 0.09 in the mean, and these finite elements more, by 0.05 to 0.22.

So the agent of HoldStill played seeds once more with each model, and was shown the slip that the
network computes along the motion of that very episode. All else that it observed, and all that
moved the object, was of the model in the column's head:

{slip}

{slip_verdict}

## What this cannot tell

- With so few seeds only large effects show: what the intervals hold is not excluded.

- The finite elements are those that an environment has by default, on about 900 nodes of an even
mesh. They are not exact: under held objects their normal force is 9 to 15 % [too
large](sliding.md). Against a fine mesh they are off by {soft[displacement]:.0f} % in displacement
and {soft[stress]:.0f} % in stress [under balls and a block](pareto.md), and by 21 and 22 % under [a
ball](fem.md). A difference here is one between two
models, and not the network's alone.

- In GraspFragile the limit of stress comes from a trial grip that the same model computes. An error
of the network that is the same in every grip is in the limit, too, and cancels.

- In GraspLift the object's pose is observed and nearly any firm grip lifts it, so that agents
with rigid pads do as well: there touch decides little.

{untried}

- Each agent is one training seed. Pads are springs in the rigid-body engine with both models.

{made}"""


def page(report: dict[str, Any]) -> str:
    """Tables of success, return, endings and terms of the reward."""
    rows = [{"name": name} | found for name, found in report["policies"].items()]
    by_model = [{"name": row["name"], "model": m} | row[m] for row in rows for m in MODELS]
    outcomes = ["success", "time_up", *sorted({o for row in by_model for o in row["outcomes"]})]
    resets = [row["fem"]["reset_seconds"] for row in rows]
    rates = [[row[model]["steps_per_second"] for model in MODELS] for row in rows]
    slower = [network / fem for network, fem in rates]
    return text(
        PAGE,
        report | {"soft": even_mesh()},
        verdict=verdict(rows),
        lost=lost(report, rows),
        untried=untried(report),
        stopped=stopped(report),
        success=table(SUCCESS, rows),
        unsolved=unsolved(rows),
        returns=table(RETURN, rows),
        resampled=RESAMPLED,
        reset=f"{min(resets):.2g} to {max(resets):.2g} s",
        slower=f"{min(slower):.0f} to {max(slower):.0f}",
        endings=table(
            {"policy": "{name}", "felt with": lambda row: MODEL_NAMES[row["model"]]}
            | {headed(o): f"{{outcomes[{o}]}}" for o in dict.fromkeys(outcomes)}
            | {"restarted": "{restarts}"},
            by_model,
            absent="–",
        ),
        terms=table({"policy": "{name}", "terms": terms, "grip (N)": grip}, rows),
        slip=slips(report),
        slip_verdict=slip_verdict(report["shown"]),
        made=made(report),
    )


def untried(report: dict[str, Any]) -> str:
    """Line on the agents that did not play."""
    missing = [task for task in TASKS if f"{task} agent" not in report["policies"]]
    return f"- Not tried: the agents of {' and '.join(missing)}." if missing else ""


def even_mesh() -> dict[str, float]:
    """Median errors (%) of the elements of an environment under balls and a block."""
    panels = json.loads((OUT / "pareto.json").read_text())["panels"]
    errors = panels["soft"]["fem p1-bar 1000"]["errors"]
    return {what: 100 * errors[what]["median"] for what in ("displacement", "stress")}


def lost(report: dict[str, Any], rows: list[dict[str, Any]]) -> str:
    """How much of the clear differences of return is of seeds that only one model won."""
    by_key = {row["key"]: row for row in report["rows"]}
    found = []
    for row in certain(rows, "return"):
        prefix = f"{row['name'].replace(' ', '/')}/"
        keys = [key.rpartition("/")[0] for key in by_key if key.startswith(prefix)]
        pairs = [
            [by_key[f"{key}/{model}"] for model in MODELS]
            for key in dict.fromkeys(keys)
            if all(f"{key}/{model}" in by_key for model in MODELS)
        ]
        one = [b["return"] - a["return"] for a, b in pairs if a["success"] != b["success"]]
        both = [b["return"] - a["return"] for a, b in pairs if a["success"] == b["success"]]
        if one and both:
            found.append(
                f"{100 * sum(one) / sum(one + both):.0f} % for {row['name']} ({len(one)} seeds; "
                f"the other {len(both)} differ by {fmean(both):+.2f} in the mean)"
            )
    if not found:
        return ""
    return (
        "How much of such a difference of return is that of seeds which only one model won: "
        f"{', '.join(found)}. Where it is nearly all, the return tells no more than the success."
    )


def certain(rows: list[dict[str, Any]], of: str) -> list[dict[str, Any]]:
    """Policies with a difference whose interval leaves out zero."""
    return [row for row in rows if row[of]["interval"][0] > 0 or row[of]["interval"][1] < 0]


def shown(report: dict[str, Any]) -> list[dict[str, Any]]:
    """Seeds of HoldStill by model, and with the network's slip, ``… shown``."""
    by_key = {row["key"]: row for row in report["rows"]} | report["slip"]
    found = []
    for seed in sorted({key.split("/")[1] for key in report["slip"]}):
        keys = {model: f"HoldStill/agent/{seed}/{model}" for model in MODELS}
        keys |= {f"{model} shown": f"slip/{seed}/{model}" for model in MODELS}
        if all(key in by_key for key in keys.values()):
            found.append({"seed": seed} | {name: by_key[key] for name, key in keys.items()})
    return found


def slips(report: dict[str, Any]) -> str:
    """Success, return and grip in these seeds."""
    columns = {"seed": "{seed}", "object": "{surrogate[object]}"}
    columns |= {
        head: lambda line, name=name: (
            f"{line[name]['return']:.1f} {'' if line[name]['success'] else '(lost)'} "
            f"{line[name]['grip']:.1f} N"
        )
        for head, name in {
            "network": "surrogate",
            "network, slip computed again": "surrogate shown",
            "finite elements": "fem",
            "finite elements, network's slip": "fem shown",
        }.items()
    }
    return table(columns, shown(report))


def summary(report: dict[str, Any]) -> dict[str, Any]:
    """Seeds won and mean return in these seeds, and how exact the method is."""
    lines = shown(report)
    if not lines:
        return {}
    rows = {name: [line[name] for line in lines] for name in lines[0] if name != "seed"}
    again = zip(rows["surrogate"], rows["surrogate shown"], strict=True)
    return {
        "seeds": len(lines),
        "won": {name: sum(row["success"] for row in some) for name, some in rows.items()},
        "return": {name: fmean(row["return"] for row in some) for name, some in rows.items()},
        "exact to": max(abs(a["return"] - b["return"]) for a, b in again),
        "missed": sum(row.get("missed", 0) for some in rows.values() for row in some),
    }


def slip_verdict(found: dict[str, Any]) -> str:
    """Result of these seeds, in words."""
    if not found:
        return ""
    order = ("surrogate", "fem", "fem shown")
    won, means = [found["won"][of] for of in order], [found["return"][of] for of in order]
    return (
        "Return, whether the episode was lost, and mean grip. With the network the agent won "
        f"{won[0]} of {found['seeds']} seeds, with finite elements {won[1]}, and with finite "
        f"elements but the network's slip {won[2]}; its mean return was {means[0]:.1f}, "
        f"{means[1]:.1f} and {means[2]:.1f}. The check of the method is the second column: slip "
        "that is computed again from the motion changes the return with the network by at most "
        f"{found['exact to']:.2f}. {found['missed']} presses of these episodes were not solved a "
        "second time."
    )


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
    """Those policies, in words."""
    digits = 1 if times > 1 else 2
    named = [
        f"{row['name']} ({row[of]['difference'] * times:+.{digits}f}{unit})"
        for row in certain(rows, of)
    ]
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
