"""Presses on several threads and in several processes."""

from __future__ import annotations

import json
import multiprocessing
import resource
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from bodies import BALL, ball_at, gel
from fresh import fresh, interrupted

from ruffini import Compliance, Fem, LinearPad, Press, Surrogate

MODELS = {
    "fem": lambda: Fem(gel(), friction=0.5),
    "compliance": lambda: Compliance(gel(), friction=0.5, corrections=1),
    "nodes": lambda: Compliance(gel(), friction=0.5, contact="nodes"),
    "cells": LinearPad,
    "network": Surrogate,
}


def many(name: str = "fem") -> bytes:
    presses = [Press(BALL, [ball_at(0, 1e-4), ball_at(x, 3e-4)]) for x in np.linspace(0, 1e-3, 6)]
    answers = MODELS[name]().solve(presses)
    return b"".join(a.displacement.tobytes() + a.von_mises.tobytes() for a in answers)


def test_ctrl_c_ends_a_solve():
    """Within seconds, where the press takes a minute."""
    code = (
        "import ruffini\n"
        "gel = ruffini.sensor('gelsight-mini', resolution=4000)\n"
        "fem = ruffini.Fem(gel, element='p2', friction=0.5)\n"
        "path = [((1e-5 * i, 0, 4e-3 - 2e-5 * i), (0, 0, 0, 1)) for i in range(60)]\n"
        "press = ruffini.Press(ruffini.Shape.sphere(4e-3), path)\n"
        "print('begun')\n"
        "fem.SOLVE\n"
    )
    step = (
        "import gymnasium, ruffini\n"
        "settings = {'tactile': 'fem', 'resolution': {'nodes': 12000}, 'start_grip': 20}\n"
        "env = gymnasium.make('ruffini/HoldStill-v0', **settings)\n"
        "print('begun')\n"
        "env.reset(seed=0)\n"
    )
    solves = [code.replace("SOLVE", s) for s in ("solve([press, press])", "solve_path(press)")]
    for solve in (*solves, step):
        seconds, _, said = interrupted(solve)
        assert b"KeyboardInterrupt" in said and seconds < 10, solve


MAKING = {
    "cells": "ruffini.LinearPad(poisson=0.47 + 1e-4 * i)",
    "network": "ruffini.Surrogate(poisson=0.47 + 1e-4 * i)",
    "environment": "gymnasium.make('ruffini/GraspLift-v0', tactile='compliance', "
    "resolution={'nodes': 1000 - 100 * i})",
}


@pytest.mark.parametrize("made", MAKING)
def test_ctrl_c_ends_the_making_of_models(made):
    """Each of another gel or mesh; interrupted at the beginning of the second or later."""
    code = (
        "import sys, time\n"
        "import gymnasium, ruffini\n"
        "for i in range(9):\n"
        "    begun = time.process_time()\n"
        f"    {MAKING[made]}\n"
        "    if i == 0:\n"
        "        took = time.process_time() - begun\n"
        "        print(took, file=sys.stderr)\n"
        "        print('the first is made')\n"
    )
    _, seconds, said = interrupted(code, 0.3)
    took = float(said.splitlines()[0])
    # Of processor time. Python ends in half a second.
    assert b"KeyboardInterrupt" in said and seconds < 0.6 * took + 0.5, f"{took} s"


def shared() -> bytes:
    """Megabytes by which the process grows with its first model of a gel, and with four more."""
    grown = [resident_megabytes()]
    models = [LinearPad()]
    grown.append(resident_megabytes())
    models += [LinearPad(friction=0.3), LinearPad(contact="fine"), Surrogate(), Surrogate()]
    grown.append(resident_megabytes())
    assert len(models) == 5
    grown = [round(after - before) for before, after in pairwise(grown)]
    return repr(grown).encode()


def resident_megabytes() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6


def test_models_of_one_gel_share_what_is_large():
    first, others = json.loads(fresh(shared))
    assert first > 100 and others < 0.6 * first, f"{first} MB, then {others} MB"


def forked_while_making() -> bytes:
    """Output of a child that was forked while a thread of its parent made a model."""
    maker, before = threading.Thread(target=LinearPad), resident_megabytes()
    maker.start()
    while resident_megabytes() < before + 20:
        assert maker.is_alive()
        time.sleep(1e-3)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork")) as pool:
        found = pool.submit(many, "cells").result()
    maker.join()
    return found


def test_a_child_forked_while_its_parent_makes_a_model_makes_its_own():
    assert fresh(forked_while_making) == many("cells")


@pytest.mark.parametrize("name", MODELS)
def test_any_number_of_threads_gives_the_same_bits(name, monkeypatch):
    outputs = []
    for threads in ("1", "3", "8"):
        monkeypatch.setenv("RAYON_NUM_THREADS", threads)
        outputs.append(fresh(many, name))
    assert len(outputs[0]) > 10_000
    assert outputs[0] == outputs[1] == outputs[2] == many(name)


def many_in_a_worker(name: str, method: str) -> bytes:
    """Answers of a worker that starts after this process has solved the same."""
    many(name)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context(method)) as pool:
        return pool.submit(many, name).result()


@pytest.mark.parametrize(
    ("name", "method"), [*((name, "fork") for name in MODELS), ("fem", "spawn")]
)
def test_workers_solve_after_the_parent_has_solved(name, method):
    assert fresh(many_in_a_worker, name, method) == many(name)


def test_python_runs_while_a_press_is_solved():
    fem, turns = Fem(gel(4)), 0
    press = Press(BALL, [ball_at(0, 1e-4 * i) for i in range(1, 9)])
    worker = threading.Thread(target=lambda: fem.solve_path(press))
    worker.start()
    while worker.is_alive():
        time.sleep(1e-4)
        turns += 1
    worker.join()
    assert turns > 100, f"{turns} turns of the interpreter during the press"


def test_threads_share_one_model():
    fem = Fem(gel())
    presses = [Press(BALL, [ball_at(0, 1e-4 * i)]) for i in range(1, 5)]
    expected = [answer.wrench[2] for answer in fem.solve(presses)]
    with ThreadPoolExecutor(4) as pool:
        answers = pool.map(fem.solve, [presses] * 4, timeout=120)
        assert [[a.wrench[2] for a in answer] for answer in answers] == [expected] * 4
