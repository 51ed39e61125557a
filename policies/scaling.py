"""Speed by environments, threads and processes, and what 10⁸ steps cost by a model of it.

Measured is GraspLift's scripted policy, which grasps, lifts and holds, as in training that goes
well; its own time is left out. With r steps a second on one core and an efficiency e of all cores
of this machine, each with a process of one thread, C cores take 10⁸ / (C r e) seconds. The model is
checked where it can be: the speed of all cores is predicted with the efficiency of half of them (1
on two cores).
"""

from __future__ import annotations

import multiprocessing
import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from functools import reduce
from itertools import islice
from typing import Any

from ruffini.evaluation import usable_cores
from timing import ENV_ID, make, memory_per_environment, resident_bytes, scripted_steps

STEPS = 1e8
"""Steps whose cost is asked for."""
CORES = (2, 64, 1000)
"""Cores for which it is told."""
MODELS = ("none", "surrogate")
"""Models of touch."""
EPISODE = 100
"""Steps of an episode."""
N = 64
"""Environments of a process; as many as cores if there are more."""
LONGEST = 600.0
"""Time that a process waits for the others (s)."""

FIGURES = {
    "one core (steps/s)": ("processes / 1", ",.0f", 1),
    "efficiency of all cores, a process each": ("efficiency / processes", ".0f", 100),
    "efficiency of all cores, a thread each": ("efficiency / threads", ".0f", 100),
    "10⁸ steps (core hours)": ("core_hours", ".1f", 1),
    "10⁸ steps, 2 cores (h)": ("hours / 2", ".1f", 1),
    "10⁸ steps, 64 cores (h)": ("hours / 64", ".2f", 1),
    "10⁸ steps, 1,000 cores (h)": ("hours / 1000", ".3f", 1),
    "half of the cores predict all of them, error": ("check / error_processes", ".1f", 100),
    "making the first environment (CPU s)": ("seconds_to_make", ".2f", 1),
    "memory of a process (MB)": ("megabytes_of_a_process", ".0f", 1),
    "memory of an environment (kB)": ("kilobytes_per_environment", ".0f", 1),
}
"""Rows of the table: keys to a figure of a model of touch, its form and a factor."""

Rates = dict[str, dict[str, float]]
"""Steps per second by environments and threads."""


def cost(quick: bool) -> dict[str, Any]:
    """Rates, memory and cost of both models of touch."""
    least, repeats = (8, 1) if quick else (N, 3)
    n = max(least, usable_cores())
    sizes = sorted({1, n // 4, n, 4 * n})
    models = {model: measured(model, n, sizes, repeats) for model in MODELS}
    return {"steps": STEPS, "environments": n, "episode": EPISODE, "repeats": repeats} | models


def table(found: dict[str, Any], report: str = "rollout_cost") -> str:
    """Table for `py/docs/scale.md`; by the marks of its figures ``.ci/report --pages`` renews them.

    Args:
        found: What `cost` returns.
        report: Name of the JSON in ``policies/results`` that holds it.
    """
    lines = ["| | rigid pads | touch by the network |", "| --- | ---: | ---: |"]
    for name, (keys, form, factor) in FIGURES.items():
        cells = []
        for model in MODELS:
            value = reduce(lambda part, key: part[key], keys.split(" / "), found[model])
            percent = " %" if factor == 100 else ""
            cells.append(f"{factor * value:{form}}{percent}<!-- {report}: {model} / {keys} -->")
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def measured(model: str, n: int, sizes: list[int], repeats: int) -> dict[str, Any]:
    """Rates of a model of touch, n environments to a process, and what follows from them."""
    processes = {count: together(count, n, model, repeats) for count in doubled()}
    rates = threads(model, n, sizes, repeats)
    of_processes = {count: found["rate"] for count, found in processes.items()}
    found = {
        "threads": rates,
        "processes": {str(count): round(rate, 1) for count, rate in of_processes.items()},
        "seconds_to_make": round(processes[1]["make"], 3),
        "kilobytes_per_environment": round(processes[1]["per_environment"] / 1e3, 1),
        "megabytes_of_a_process": round(processes[1]["whole"] / 1e6, 1),
    }
    found |= predicted(of_processes, {int(t): rate for t, rate in rates[str(n)].items()})
    print(f"tactile={model!r}")
    for name, value in found.items():
        print(f"  {name}: {value}", flush=True)
    return found


def predicted(processes: dict[int, float], threads: dict[int, float]) -> dict[str, Any]:
    """Efficiencies, cost by cores, and the model against what was measured on all cores.

    Args:
        processes: Steps per second by processes of one thread, each on a core.
        threads: Steps per second of one process by its threads.
    """
    one, cores = processes[1], max(processes)
    half = max((count for count in processes if 2 * count <= cores), default=1)
    efficiency = {count: rate / (count * one) for count, rate in processes.items()}
    expected = cores * one * efficiency[half]
    return {
        "efficiency": {
            "processes": round(efficiency[cores], 3),
            "threads": round(threads[cores] / (cores * threads[1]), 3),
        },
        "core_hours": round(STEPS / (one * efficiency[cores]) / 3600, 1),
        "hours": {
            str(count): round(STEPS / (count * one * efficiency[cores]) / 3600, 3)
            for count in CORES
        },
        "check": {
            "predicted": round(expected, 1),
            "error_processes": round(expected / processes[cores] - 1, 3),
            "error_threads": round(expected / threads[cores] - 1, 3),
        },
    }


def doubled() -> list[int]:
    """1, 2, 4 and so on up to the cores of this machine, and these."""
    cores = usable_cores()
    return sorted({2**power for power in range(cores.bit_length())} | {cores})


def threads(model: str, n: int, sizes: list[int], repeats: int) -> Rates:
    """Steps per second of one process, medians of repeats that are taken in turn."""
    cases = [(size, count) for size in sizes for count in doubled() if count <= size]
    taken: dict[tuple[int, int], list[float]] = {case: [] for case in cases}
    for size, count in cases * repeats:
        envs = make(size, count, tactile=model)
        prepare(envs, size)
        taken[size, count].append(rate(envs, size, n))
    rates: Rates = {str(size): {} for size in sizes}
    for (size, count), found in taken.items():
        rates[str(size)][str(count)] = round(statistics.median(found), 1)
    return rates


def prepare(envs: Any, size: int) -> None:
    """Draws each shape once: it is prepared then, for half a second."""
    for _ in range(max(1, N // size)):
        envs.reset()


def rate(envs: Any, size: int, n: int) -> float:
    """Steps per second over an episode of n environments, or several of fewer."""
    count = EPISODE * max(1, n // size)
    spent = sum(step.wall for step in islice(scripted_steps(envs, ENV_ID), count))
    return count * size / spent


_barrier: Any = None


def together(count: int, n: int, model: str, repeats: int) -> dict[str, float]:
    """Steps per second of processes that step at once, of all; what one takes otherwise."""
    context = multiprocessing.get_context("spawn")
    barrier = context.Barrier(count)
    with ProcessPoolExecutor(count, context, _meet, (barrier,)) as pool:
        # A process waits for all others, so each gets one of the tasks.
        tasks = [pool.submit(alone, n, model, repeats) for _ in range(count)]
        found = [task.result() for task in tasks]
    whole = [sum(rates) for rates in zip(*(each["rates"] for each in found), strict=True)]
    return found[0] | {"rate": statistics.median(whole)}


def _meet(barrier: Any) -> None:
    global _barrier
    _barrier = barrier


def alone(n: int, model: str, repeats: int) -> dict[str, Any]:
    """Rates of this process beside the others, what its first environment takes, its memory.

    Raises:
        BrokenBarrierError: If the others failed, or took longer than `LONGEST`.
    """
    try:
        begun = time.process_time()
        first = make(1, 1, tactile=model)  # With what all environments share.
        making = time.process_time() - begun
        prepare(first, 1)
        each = memory_per_environment(n, tactile=model)
        envs = make(n, 1, tactile=model)
        prepare(envs, n)
        rates = []
        for _ in range(repeats):
            _barrier.wait(LONGEST)
            rates.append(rate(envs, n, n))
    except BaseException:
        _barrier.abort()
        raise
    return {"rates": rates, "make": making, "per_environment": each, "whole": resident_bytes()}
