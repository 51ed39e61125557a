"""The text of the comparison with the paper: paper.md from what paper.json holds."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

from kept import table

NAMES = {"baseline": "Baseline", "a": "A", "b": "B"}
ALL, ONE = "novel-14", "known-1"
"""Splits: all objects but those of some families, and one object."""
PARTS = {"known": "Unseen grasps of known objects", "novel": "Objects that were never seen"}
PAPER = """The paper's own figures, on other data (63 objects x 100 grasps x 50 frames, not public)
and at 128 channels and 15 rounds on a GPU. MAPE of u / σ: Baseline 3.28 / 1.85 %, A 3.57 / 2.28 %,
**B 2.81 / 1.31 %**. Mean absolute error of u and σ told the translation: 63 known objects 79 µm,
352 Pa; 14 novel ones 197 µm, 1,510 Pa; told the force, 250 to 290 µm on known and 32.5 mm, 78 kPa
on novel objects. Neither the data, nor the budget, nor the measure is ours: only the ranking can be
compared. Ours are relative L² a frame, median / 95th percentile, and mean absolute errors over all
components."""


def markdown(report: dict[str, Any]) -> str:
    """Conclusion, tables and how they were made."""
    parts = ["# The paper's networks at equal budgets", conclusion(report)]
    parts += ["![errors by training and by cost](paper.svg)", "## The paper", PAPER]
    for part, title in PARTS.items():
        parts += [f"## {title}", table(HEAD, rows(report, part, "all"))]
        deep = rows(report, part, "deep")
        parts += ["Of these, presses that move the gel by over a quarter of its thickness:"]
        parts += [table(HEAD, deep)]
    parts += ["## Object meshes of half the spacing", dense(report)]
    parts += ["## Learnt from one object", single(report)]
    parts += ["## Rigid motion of the gel, and of the object", rigid(report)]
    return "\n\n".join([*parts, "## How it was made", made(report)]) + "\n"


HEAD = ["answerer", "presses", "u", "σ", "σ at the peak", "mean abs. u", "mean abs. σ", "net force"]
HEAD += ["CPU a press"]


def rows(report: dict[str, Any], part: str, which: str) -> list[list[str]]:
    """Errors by run on one part, all presses or the deep ones."""
    return [row(name, judged, which) for name, judged in answerers(report, part)]


def runs_on(report: dict[str, Any], split: str = ALL) -> list[dict[str, Any]]:
    """The runs on a split of the data."""
    return [run for run in report["runs"].values() if run["study"]["split"] == split]


def answerers(
    report: dict[str, Any], part: str, split: str = ALL
) -> list[tuple[str, dict[str, Any]]]:
    """Names and errors of all that answered as they were trained, the linear answer last."""
    runs = runs_on(report, split)
    found = [
        (title(run), run["errors"][part][key])
        for run in runs
        for key in ("coarse", "corrector")
        if key in run["errors"][part]
    ]
    linear = [run["errors"][part]["linear"] for run in runs if "corrector" in run["run"]]
    return sorted(found, key=lambda row: order(row[0])) + [("linear answer", x) for x in linear[:1]]


def title(run: dict[str, Any]) -> str:
    """A run's name in tables."""
    seed = f"seed {run['study']['seed']}"
    if "corrector" in run["run"]:
        return f"corrector, {seed}"
    network = run["run"]["paper"]["network"]
    told = " told the force" if network["input"] == "force" else ""
    return f"{NAMES[network['variant']]}{told}, {seed}"


def order(name: str) -> tuple[int, str]:
    """Baseline, A, B, B by force, corrector."""
    firsts = ["Baseline", "A,", "B,", "B told", "corrector"]
    return next(i for i, first in enumerate(firsts) if name.startswith(first)), name


def row(name: str, judged: dict[str, Any], which: str) -> list[str]:
    """One answerer's errors."""
    errors, seconds = judged[which], judged.get("seconds")
    return [
        name,
        str(errors["presses"]),
        *(spread(errors[key]) for key in ("displacement", "stress", "peak")),
        f"{1e6 * errors['displacement_mae']:.2f} µm",
        f"{errors['stress_mae']:,.0f} Pa",
        spread(errors["force"]) if "force" in errors else "not said",
        "–" if seconds is None else f"{1e3 * seconds:.0f} ms",
    ]


def spread(of: dict[str, float]) -> str:
    """Median and 95th percentile in percent."""
    return f"{100 * of['median']:.1f} / {100 * of['p95']:.1f} %"


def medians(report: dict[str, Any], part: str) -> dict[str, list[tuple[float, float]]]:
    """Median errors of u and σ of each answerer's seeds."""
    found = defaultdict(list)
    for name, judged in answerers(report, part):
        errors = judged["all"]
        pair = (errors["displacement"]["median"], errors["stress"]["median"])
        found[name.split(", seed")[0]].append(pair)
    return dict(found)


def conclusion(report: dict[str, Any]) -> str:
    """Who wins, whether the paper's ranking holds, and what the linear answer says to it."""
    lines = []
    for part, where in {"known": "known objects' unseen grasps", "novel": "novel objects"}.items():
        found = medians(report, part)
        mean = {
            name: [sum(p[i] for p in pairs) / len(pairs) for i in (0, 1)]
            for name, pairs in found.items()
        }
        for i, field in enumerate(("u", "σ")):
            ranking = sorted((mean[name][i], name) for name in NAMES.values() if name in mean)
            text = " < ".join(f"{name} {100 * error:.1f} %" for error, name in ranking)
            lines.append(f"- {field}, {where}: {text}; {certainty(found, ranking, i)}.")
        lines.append(f"- {beaten(mean, where)}")
    paper = "The paper's ranking is B < Baseline < A. Medians of the relative error, ours:"
    return "\n".join([paper, "", *lines])


def certainty(
    found: dict[str, list[tuple[float, float]]], ranking: list[tuple[float, str]], field: int
) -> str:
    """How a ranking's first step compares with what another seed changes."""
    several = [pairs for pairs in found.values() if len(pairs) > 1]
    if not several:
        return "one seed each, so what another would change is not known"
    seeds = max(abs(a[field] - b[field]) for pairs in several for a in pairs for b in pairs)
    clear = "more" if ranking[1][0] - ranking[0][0] > seeds else "less"
    return f"the first step is {clear} than what another seed changes, {100 * seeds:.1f} %"


def beaten(mean: dict[str, list[float]], where: str) -> str:
    """The networks beside the answers that know elasticity."""
    best = [min(mean[name][i] for name in NAMES.values() if name in mean) for i in (0, 1)]
    rivals = {name: mean[name] for name in ("linear answer", "corrector") if name in mean}
    worse = all(rival[i] < best[i] for rival in rivals.values() for i in (0, 1))
    verdict = "All three lose" if worse else "Not all three lose"
    text = " and ".join(
        f"the {n} ({100 * u:.1f} / {100 * s:.1f} %)" for n, (u, s) in rivals.items()
    )
    return f"**{verdict}** to {text}, u / σ on {where}; the best of the three {pair(best)}."


def pair(errors: list[float]) -> str:
    """Two errors in percent."""
    return " / ".join(f"{100 * error:.1f} %" for error in errors)


def dense(report: dict[str, Any]) -> str:
    """Errors on object surfaces of the density that was not trained on."""
    body = []
    for run in runs_on(report):
        if found := run["errors"]["novel"].get("dense"):
            body.append(row(title(run), found, "all"))
    note = "Every third frame of novel objects; edges of 1.5 mm where 3 mm were trained on."
    return f"{note}\n\n{table(HEAD, sorted(body, key=lambda line: order(line[0])))}"


def single(report: dict[str, Any]) -> str:
    """Errors on an unseen grasp of the one object that was learnt from."""
    runs = runs_on(report, ONE)
    body = [row(name, judged, "all") for name, judged in answerers(report, "novel", ONE)]
    grasps, frames = runs[0]["counts"]["train"]
    minutes = runs[0]["study"]["seconds"] / 60
    note = f"Trained on {grasps} grasps ({frames} frames) of one object for {minutes:.0f} minutes, "
    return f"{note}judged on another of its grasps.\n\n{table(HEAD, body)}"


def rigid(report: dict[str, Any]) -> str:
    """Errors of the gel's rigid motion, beside its size, and of the object's motion since touch."""
    body = []
    for run in runs_on(report):
        for part in PARTS:
            found = run["errors"][part].get("coarse", {})
            if not found.get("rigid"):
                continue
            ways = [found[key][0] for key in ("rigid", "rigid_truth")]
            turns = [found[key][1] for key in ("rigid", "rigid_truth")]
            cells = [" / ".join(f"{1e6 * way[k]:.1f}" for k in ("median", "p95")) for way in ways]
            cells += [" / ".join(f"{turn[k]:.3f}" for k in ("median", "p95")) for turn in turns]
            moved = spread(found["object"]) if "object" in found else "told"
            body.append([f"{title(run)}, {part}", *cells, moved])
    head = [
        "answerer, objects",
        "error (µm)",
        "true (µm)",
        "error (°)",
        "true (°)",
        "object's motion",
    ]
    note = "Median / 95th percentile. A bonded gel hardly turns or moves as a whole."
    return f"{note}\n\n{table(head, sorted(body, key=lambda line: order(line[0])))}"


def made(report: dict[str, Any]) -> str:
    """Data, machine, commit, and what each run took."""
    first = runs_on(report)[0]
    counts = {name: f"{n} grasps ({f} frames)" for name, (n, f) in first["counts"].items()}
    budget, machine = first["study"]["seconds"] / 60, report["machine"]
    text = f"""Data: 63 objects x 10 grasps x 10 frames x 2 pads, p1-bar on 1,995 nodes, carried to
900. Trained on {counts["train"]}; judged on {counts["known"]}, the last grasp of each of the
49 objects, and {counts["novel"]} of 14 objects of families left out. {budget:.0f} minutes of
processor time each where no other is said, on one thread of a busy machine
({machine["cpu"]}, {machine["cores"]} cores), commit {report["commit"]};
`python tests/reports/paper.py --data SET --runs FOLDER`. The last weights are
judged; nothing is chosen by its error. Time of a press is without the linear answer. The paper's
networks see the object as nodes of its surface, the corrector as distances. Ten minutes are little,
and how many steps it holds varies with what else the machine does."""
    head = ["run", "channels", "rounds", "numbers learnt", "batch", "steps", "CPU s", "wall s"]
    return f"{text}\n\n{table(head, [spent(run) for run in runs_on(report)])}"


def spent(run: dict[str, Any]) -> list[str]:
    """Sizes and budget of a run."""
    network = run["run"]["paper"]["network"] if "paper" in run["run"] else run["run"]["corrector"]
    rounds = network.get("rounds") or sum(network["down"]) + sum(network["up"])
    numbers = [network["width"], rounds, run["parameters"], run["study"]["batch"], run["steps"]]
    return [title(run), *(f"{n:,}" for n in numbers), *(f"{s:,.0f}" for s in run["seconds"])]
