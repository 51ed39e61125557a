"""The page and the picture of a study: a table of agents by kind, a curve of every seed.

Aggregates follow Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical
Precipice" (NeurIPS 2021): the mean of the middle half of the seeds (interquartile mean), with a
95 % interval by bootstrap over seeds.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from ruffini import TASKS
from ruffini.evaluation import bootstrap

mpl.use("Agg")
from matplotlib import pyplot as plt

RESAMPLES = 20_000
CHOSEN_BY_THEM = {
    "ruffini/InsertPeg-v0": (
        "But what these agents observe was chosen by these very seeds: `markers` were observed, "
        "too, until the first two rows below were known, so the higher was picked out of two."
    )
}
"""What was decided by the seeds that are reported, by environment."""
FAILURES = "press_failed", "out_of_range", "non_finite", "engine_error"
"""Endings that no rule of the task has: a computation failed."""
NAMES = {
    "touch": "default observation",
    "errors": "default observation, with errors of the sensors",
    "force": "proprio and wrench: forces, no field of touch",
    "markers": "proprio, wrench and markers",
    "blind": "proprio alone",
    "rigid": "rigid pads, no touch",
}


def interquartile_mean(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means along the last axis of what is left when the lowest and highest quarters are cut."""
    cut = scores.shape[-1] // 4
    middle = np.sort(scores, axis=-1)[..., cut : scores.shape[-1] - cut]
    return np.asarray(middle.mean(axis=-1))


def write_pages(rows: list[dict[str, Any]], path: Path) -> None:
    """Writes ``<path>.md`` and ``<path>.png`` for the rows of one environment."""
    rows = sorted(rows, key=lambda row: (list(NAMES).index(row["kind"]), row["seed"]))
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    by_kind = {kind: [row for row in rows if row["kind"] == kind] for kind in kinds}
    path.with_suffix(".md").write_text(page(by_kind, path.name))
    draw(by_kind, path.with_suffix(".png"))


def page(by_kind: dict[str, list[dict[str, Any]]], name: str) -> str:
    """Tables of the kinds and of the seeds, in Markdown."""
    first = next(iter(by_kind.values()))[0]
    lines = [
        f"# {name}: agents by PPO",
        "",
        f"Success over {first['episodes']} evaluation seeds without exploration noise, for "
        f"training seeds that no hyper-parameter was tuned on. {chosen(first['env'])}IQM is the "
        "mean of the middle half of the seeds, with its 95 % bootstrap interval over seeds, which "
        "holds the true value in about 90 % of cases if there are five of them (94 % if ten) and "
        "they scatter normally. Made by `python policies/study.py`. *Minutes* are wall time, "
        "partly on a busy machine; "
        "*CPU minutes* are the run's own. *Return* is the sum of an episode's rewards, a mean over "
        f"episodes. The default observation is {usual(first['env'])}.",
        "",
        "| agent sees | seeds | IQM | 95 % interval | median | worst seed | steps | minutes | "
        "CPU minutes | steps/s |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for kind, rows in by_kind.items():
        scores = np.array([row["success"] for row in rows])
        low, high = bootstrap(scores, interquartile_mean, RESAMPLES)
        wall, cpu = (np.median([row[key] for row in rows]) / 60 for key in ("wall", "cpu"))
        rate = np.median([row["steps_per_second"] for row in rows])
        lines.append(
            f"| {NAMES[kind]} | {len(rows)} | {percent(interquartile_mean(scores))} | "
            f"{percent(low)} to {percent(high)} | {percent(np.median(scores))} | "
            f"{percent(scores.min())} | "
            f"{rows[0]['steps']:,} | {wall:.1f} | {cpu:.1f} | {rate:,.0f} |"
        )
    lines += ["", f"![learning curves]({name}.png)", "", "Every seed:", ""]
    lines += ["| agent sees | seed | success | 95 % interval | return | minutes | CPU minutes |"]
    lines += ["| --- | ---: | ---: | ---: | ---: | ---: | ---: |"]
    for kind, rows in by_kind.items():
        for row in rows:
            low, high = row["interval"]
            lines.append(
                f"| {NAMES[kind]} | {row['seed']} | {percent(row['success'])} | {percent(low)} to "
                f"{percent(high)} | {row['return']:.1f} | {row['wall'] / 60:.1f} | "
                f"{row['cpu'] / 60:.1f} |"
            )
    lines += ended(by_kind)
    lines += otherwise(by_kind)
    parts = "steps of the environments, what else PPO does to collect them, and its updates"
    lines += ["", f"Where the time of training goes, medians over seeds: {parts}.", ""]
    lines += ["| agent sees | environment | rest of collecting | updating |"]
    lines += ["| --- | ---: | ---: | ---: |"]
    for kind, rows in by_kind.items():
        shares = [np.median([row["shares"][part] for row in rows]) for part in PARTS]
        lines.append(
            f"| {NAMES[kind]} | " + " | ".join(percent(share, 0) for share in shares) + " |"
        )
    machines = sorted({machine(row) for rows in by_kind.values() for row in rows})
    lines += ["", *(f"Trained on {one}." for one in machines), "", commits(by_kind), ""]
    older = [
        NAMES[kind] for kind, rows in by_kind.items() if any("first_seed" not in r for r in rows)
    ]
    if older:
        lines += [
            f"Runs that are not independent: {', '.join(older)}. Up to commit a80cf39 environment "
            "i of a run of seed s had the objects of environment i - 1 of seed s + 1, so that "
            "neighbouring seeds shared most of their episodes, though not what the agents did in "
            "them. The intervals over seeds leave this out.",
            "",
        ]
    return "\n".join(lines)


def chosen(env_id: str) -> str:
    """What these seeds decided, as a sentence with a space after it."""
    found = CHOSEN_BY_THEM.get(env_id, "")
    return found and f"{found} "


def ended(by_kind: dict[str, list[dict[str, Any]]]) -> list[str]:
    """Paragraphs on episodes that a failed computation ended, and on such as were judged twice."""
    failed, twice = [], []
    for kind, rows in by_kind.items():
        some = {name: sum(row["endings"].get(name, 0) for row in rows) for name in FAILURES}
        if sum(some.values()):
            lost = sum(row["episodes"] - won(row) for row in rows)
            count = sum(row["episodes"] for row in rows)
            each = ", ".join(f"{number} `{name}`" for name, number in some.items() if number)
            failed.append(
                f"*{NAMES[kind]}*, {sum(some.values())} of {count:,}: {each} "
                f"({lost:,} count as lost)"
            )
        more = {
            row["seed"]: won(row) + sum(row["endings"].values()) - row["episodes"] for row in rows
        }
        seeds = ", ".join(f"{seed} ({count})" for seed, count in more.items() if count > 0)
        if seeds:
            twice.append(f"*{NAMES[kind]}*, seeds {seeds}")
    lines = []
    if failed:
        lines += [
            "",
            f"Episodes that ended because a computation failed: {'; '.join(failed)}.",
        ]
    if twice:
        lines += [
            "",
            "Up to commit 75af591 an episode that ended early could count as won. Runs in which "
            "successes and early endings are more than the episodes, in brackets by how many: "
            f"{'; '.join(twice)}. At least so many of their successes are none.",
        ]
    return lines


def won(row: dict[str, Any]) -> int:
    """Number of episodes of a run that count as won."""
    return round(float(row["success"]) * int(row["episodes"]))


def usual(env_id: str) -> str:
    """Channels that an environment shows by default."""
    task = env_id.split("/")[-1].split("-v")[0]
    *most, last = (f"`{channel}`" for channel in TASKS[task]["usual_channels"])
    return f"{', '.join(most)} and {last}"


def commits(by_kind: dict[str, list[dict[str, Any]]]) -> str:
    """Commits by which the rows were made, with their seeds where a kind has several."""
    found: dict[str, dict[str, list[int]]] = {kind: {} for kind in by_kind}
    for kind, rows in by_kind.items():
        for row in rows:
            found[kind].setdefault(row["about"]["commit"], []).append(row["seed"])
    different = {commit for seeds in found.values() for commit in seeds}
    if len(different) == 1:
        return f"Commit {different.pop()}."
    texts = []
    for kind, seeds in found.items():
        each = [
            f"{commit} (seeds {min(of)} to {max(of)})" if len(seeds) > 1 else commit
            for commit, of in seeds.items()
        ]
        texts.append(f"{NAMES[kind]}, at {' and '.join(each)}")
    return (
        f"Commits: {'; '.join(texts)}. Agents of different commits may have been trained with "
        "different networks of the gel."
    )


def otherwise(by_kind: dict[str, list[dict[str, Any]]]) -> list[str]:
    """Table of agents evaluated with the settings of another kind, over the same seeds."""
    lines = []
    for kind, rows in by_kind.items():
        for other in rows[0].get("otherwise", {}):
            pairs = [(row["success"], row["otherwise"][other]["success"]) for row in rows]
            own, changed = np.array(pairs).T
            lines.append(
                f"| {NAMES[kind]} | {len(rows)} | {percent(interquartile_mean(own))}, "
                f"{percent(own.min())} | {NAMES[other]} | "
                f"{percent(interquartile_mean(changed))}, {percent(changed.min())} |"
            )
    if not lines:
        return []
    return [
        "",
        "The same agents with other observations than they were trained with: IQM and worst seed.",
        "",
        "| trained with | seeds | evaluated so | evaluated with | then |",
        "| --- | ---: | ---: | --- | ---: |",
        *lines,
    ]


PARTS = ("environment", "collecting", "updating")


def percent(share: Any, digits: int = 1) -> str:
    """A share in per cent."""
    return f"{100 * share:.{digits}f} %"


def machine(row: dict[str, Any]) -> str:
    """Processor, threads and versions of a run."""
    about = row["about"]
    return (
        f"{about['cores']} cores of {about['processor']}, {row['threads']} thread"
        f"{'s' * (row['threads'] != 1)}, Python {about['python']}, gymnasium {about['gymnasium']}"
    )


def draw(by_kind: dict[str, list[dict[str, Any]]], path: Path) -> None:
    """Success in training against steps, a thin line a seed and the median of each kind."""
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    for colour, (kind, rows) in enumerate(by_kind.items()):
        curves = [np.array(row["curve"]) for row in rows]
        for curve in curves:
            axes.plot(curve[:, 0], 100 * curve[:, 1], color=f"C{colour}", lw=0.7, alpha=0.6)
        steps = curves[0][:, 0]
        middle = np.median([np.interp(steps, c[:, 0], c[:, 1]) for c in curves], axis=0)
        label = f"{NAMES[kind]}, {len(rows)} seeds"
        axes.plot(steps, 100 * middle, color=f"C{colour}", lw=2.2, label=label)
    axes.set(xlabel="environment steps", ylabel="success in training (%)", ylim=(-2, 102))
    axes.grid(alpha=0.3)
    figure.legend(fontsize=8, ncols=2, loc="outside lower center")
    figure.savefig(path, dpi=130)
    plt.close(figure)
