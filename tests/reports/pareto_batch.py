"""Presses a second in a batch, on one thread and on all, for the report on error against run time.

A batch is balls of 3 to 8 mm pressed 0.6 mm into a Mini from rest in five frames, a few for every
core, solved by one call. Times are by the clock.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Iterator

import numpy as np
from kept import Rows
from pareto_answerers import ANSWERERS
from pareto_cases import MINI, straight

from ruffini import PressError

PANEL = "batch"
EACH = 4
"""Presses for every core."""
LEAST = 1.0
"""How long a batch is repeated where it is quick (s)."""


def missing(rows: Rows, name: str, quick: bool) -> Iterator[dict]:
    """What a batch takes by name, on one thread and on all, where it is not among the rows."""
    cores = os.cpu_count() or 1
    if ANSWERERS[name].kind == "closed form":
        return
    for threads in sorted({1, cores}):
        key = f"{PANEL}/{name}/{threads}"
        if key not in rows:
            work = (name, cores * (1 if quick else EACH), threads)
            # A process of its own: the threads are chosen once in one.
            context = multiprocessing.get_context("spawn")
            with context.Pool(1, use_threads, (threads,)) as pool:
                yield {"key": key, "panel": PANEL, "answerer": name} | pool.apply(timed, (work,))


def use_threads(threads: int) -> None:
    """Says how many, in a process that has answered nothing yet."""
    os.environ["RAYON_NUM_THREADS"] = str(threads)


def timed(work: tuple[str, int, int]) -> dict:
    """Clock time a press of a batch (s), the quickest of its repetitions."""
    name, count, threads = work
    balls = [("ball", size) for size in np.linspace(3, 8, count)]
    presses = [case.press() for case in straight(PANEL, MINI, balls, [3e-4, 6e-4])]
    model = ANSWERERS[name].make(MINI)
    model.solve(presses[:threads])
    seconds: list[float] = []
    while sum(seconds) < LEAST:
        begun = time.perf_counter()
        answers = model.solve(presses)
        seconds.append(time.perf_counter() - begun)
    failed = sum(isinstance(answer, PressError) for answer in answers)
    found = {"threads": threads, "presses": count, "failed": failed}
    return found | {"seconds": min(seconds) / count}
