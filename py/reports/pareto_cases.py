"""Presses of the report on error against run time, the models, and the measures of error.

Every answer is carried to the model mesh of 1,000 nodes (V, T) and compared there. Another answerer
needs an entry of `ANSWERERS`, and a place in a series of the picture. A batch is balls of 3 to 8 mm
pressed 0.6 mm into a Mini from rest in five frames, a few for every core, solved by one call.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import ruffini
from engine import ROOT
from fem_cases import bonded_layer
from meshes import carried, difference
from ruffini import (
    Compliance,
    Deformation,
    Fem,
    LinearPad,
    PaperAnswer,
    PaperNetwork,
    Press,
    PressError,
    Shape,
    SoftBody,
    Surrogate,
)

sys.path.insert(0, str(ROOT / "tests/reference"))
import presses

Points = np.ndarray
"""Points of a pad's face (P, 3) in m."""


@dataclass(frozen=True)
class Gel:
    """Sensor, material and friction of a pad."""

    sensor: str
    young: float
    """Young's modulus (Pa)."""
    poisson: float
    friction: float

    def body(self, nodes: int, around: Points | None = None) -> SoftBody:
        """The pad, meshed with about so many nodes, which are denser around some points."""
        pad = ruffini.sensor(self.sensor, resolution=nodes, around=around)
        return SoftBody(pad.mesh, self.young, self.poisson, "neo-hookean", pad.fixed)


@dataclass(frozen=True)
class Answerer:
    """A model that solves presses."""

    make: Callable[[Gel, Points | None], Any]
    """The model of a gel that is to be pressed at some points."""
    kind: str
    """Family."""
    use: str
    """Expression that makes it in Python."""
    made_from: dict[str, float] = field(default_factory=dict)
    """Core seconds that were spent before the first answer, by purpose."""
    shipped: bool = True
    """``False`` for an oracle."""


def compliance(nodes: int, corrections: int = 0, rough: bool = True, **contact: str) -> Answerer:
    """Linear elasticity condensed to the surface."""
    arguments = (f", corrections={corrections}" if corrections else "") + (
        "" if rough else ", friction=0"
    )
    arguments += "".join(f', {name}="{what}"' for name, what in contact.items())
    return Answerer(
        lambda gel, _: Compliance(
            gel.body(nodes), gel.friction if rough else 0.0, corrections=corrections, **contact
        ),
        "compliance",
        f"Compliance(sensor(…, resolution={nodes}){arguments})",
    )


def fem(element: str, nodes: int, tolerance: float = 1e-7, graded: bool = False) -> Answerer:
    """Finite elements, up to a force out of balance (N), the mesh graded towards the contact."""
    loose = f", tolerance={tolerance:g}" if tolerance > 1e-7 else ""
    finer = ", around=…" if graded else ""
    return Answerer(
        lambda gel, around: Fem(
            gel.body(nodes, around if graded else None), gel.friction, tolerance, element
        ),
        "fem",
        f'Fem(sensor(…, resolution={nodes}{finer}), element="{element}"{loose})',
    )


PADS = {"data": 6.0 * 3600, "training": 1200.0}
"""Core seconds of the network: 906 indenters, and 80 epochs (mechanics.md)."""
B = {"data": 4.5 * 3600, "training": 600.0}
"""Of the paper's B: 630 grasps of 10 frames (dataset.md), and the budget of `paper`."""
LAYER = "bonded layer"
ANSWERERS: dict[str, Answerer] = {
    LAYER: Answerer(lambda gel, _: gel, "closed form", "– (force of a ball)"),
    "network": Answerer(lambda gel, _: Surrogate(**vars(gel)), "network", "Surrogate()", PADS),
    "network, by Candle": Answerer(
        lambda gel, _: Surrogate(**vars(gel)).plain(),
        "oracle",
        "Surrogate().plain()",
        shipped=False,
    ),
    "linear, on cells": Answerer(lambda gel, _: LinearPad(**vars(gel)), "linear", "LinearPad()"),
    "compliance at nodes": compliance(2000, contact="nodes"),
    "compliance 1000": compliance(1000),
    "compliance": compliance(2000),
    "compliance, no friction": compliance(2000, rough=False),
    "compliance, 1 correction": compliance(2000, 1),
    "compliance, 6 corrections": compliance(2000, 6),
    "paper's B": Answerer(
        lambda gel, _: PaperNetwork("paper-b", **vars(gel)), "paper", 'PaperNetwork("paper-b")', B
    ),
    "fem p1 2000": fem("p1", 2000),
    "fem p1-bar 500": fem("p1-bar", 500),
    "fem p1-bar 1000": fem("p1-bar", 1000),
    "fem p1-bar 2000, 1 mN": fem("p1-bar", 2000, 1e-3),
    "fem p1-bar 2000": fem("p1-bar", 2000),
    "fem p1-bar 3000": fem("p1-bar", 3000),
    "fem p1-bar 2000, graded": fem("p1-bar", 2000, graded=True),
    "fem p2 500, graded": fem("p2", 500, graded=True),
    "fem p2 1000, graded": fem("p2", 1000, graded=True),
}
"""By name."""
ELEMENTS = "fem p1-bar 2000"
"""Finite elements whose answer and time others are put beside."""
FEW = [LAYER, "compliance 1000", "compliance at nodes", "linear, on cells", "network"]
FEW += ["network, by Candle", "paper's B", "fem p1-bar 500", ELEMENTS, "fem p2 500, graded"]
"""Models of the quick form: some of every kind that needs no training."""

MINI = Gel("gelsight-mini", 3e5, 0.47, 0.8)
SHAPES = [("ball", 4), ("ball", 2), ("ball", 8), ("block", 5)]
"""Shapes that are pressed straight down, and their size (mm)."""
FIRST = 31_000
"""Number of the first drawn press. Nothing was chosen by these."""
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
MODEL_NODES = 1000
STILL = 1e-9
"""Displacement under which a press counts as none (m)."""
REPEATS = 3
"""Times that a press is answered where that is quick; the fastest counts."""


@dataclass(frozen=True)
class Case:
    """A shape moved along a path into a gel."""

    panel: str
    name: str
    gel: Gel
    shape: Shape
    path: list
    judged: range
    """The frames that count."""
    ball: tuple[float, np.ndarray] | None = None
    """Radius and depths (m), where a ball presses straight down."""

    def press(self) -> Press:
        """Press of the shape along the path."""
        return Press(self.shape, self.path)

    @cached_property
    def under(self) -> Points:
        """Points of the face that the shape would cover if the gel deformed nowhere else."""
        places, found = presses.face(1e-4), []
        for frame in self.judged:
            place, turn = self.path[frame]
            inside = Rotation.from_quat(turn).inv().apply(places - place)
            distance = self.shape.distance(inside)[0]
            nearest = distance.min()
            found.append(places[distance < max(0.0, nearest + 0.2 * abs(nearest))])
        points, apart = np.vstack(found), 1e-4
        # Meshes are refined towards 10,000 points at most.
        while len(points := presses.thinned(points, apart)) > 10_000:
            apart *= 2
        return points


def cases(quick: bool, most: int) -> dict[str, Callable[[], Case]]:
    """Functions that make the presses, by ``panel/name``; at most so many presses a panel.

    In the quick form one of each of three panels.
    """
    few = slice(0, 1 if quick else most)
    made = [
        *straight("deep", MINI, SHAPES[few], [1.6e-3, 2.0e-3, 2.4e-3]),
        *straight("tiny", MINI, SHAPES[few], [5e-6, 2e-5, 5e-5]),
    ]
    for name, young, poisson in [] if quick else [("soft", 2e4, 0.45), ("stiff", 5e6, 0.49)]:
        gel = Gel("gelsight-mini", young, poisson, 0.8)
        made += straight(name, gel, SHAPES[few], [3e-4, 6e-4, 1e-3])
    made += straight("no contact", MINI, [("ball", 6)], [-1e-3, -1e-4])
    drawn = {f"unseen/{n}": partial(unseen, n) for n in range(FIRST, FIRST + most)[few]}
    return drawn | {f"{case.panel}/{case.name}": (lambda case=case: case) for case in made}


def unseen(number: int) -> Case:
    """A drawn press by an indenter of a family that the network never saw.

    It is judged at half the depth and at all of it, which are reached in four load steps each.
    """
    drawn = presses.DrawnPress.draw(number)
    path = drawn.steps[2 : 4 * presses.STEPS + 1 : 2]
    gel = Gel(presses.SENSOR, **drawn.gel)
    return Case("unseen", str(number), gel, drawn.shape, path, range(3, 8, 4))


def straight(panel: str, gel: Gel, shapes: list, depths: list[float]) -> Iterator[Case]:
    """Balls and blocks of so many mm (radius, half an edge) pressed down beside the middle.

    The way to the first depth is walked in four frames that do not count.
    """
    top = ruffini.sensor(gel.sensor, resolution=2000).mesh.vertices[:, 2].max()
    for kind, size in shapes:
        half = 1e-3 * size
        shape = Shape.sphere(half) if kind == "ball" else Shape.cuboid((half, half, half))
        ways = [*np.linspace(0, depths[0], 5)[1:-1], *depths]
        path = [((1e-3, 0.0, top + half - depth), UPRIGHT) for depth in ways]
        judged = range(len(ways) - len(depths), len(ways))
        ball = (half, np.array(ways)) if kind == "ball" and depths[0] > 0 else None
        yield Case(panel, f"{kind} {size} mm", gel, shape, path, judged, ball)


class Fields:
    """An answer on the model mesh: displacement (F, V, 3), stress (F, T), force (F, 3).

    The force is not a number where it is not said.
    """

    def __init__(self, displacement: np.ndarray, stress: np.ndarray, force: np.ndarray):
        self.displacement, self.stress, self.force = displacement, stress, force
        self.predicted: list[tuple[float, float, float]] | None = None
        """Errors that a network expects (F): displacement, stress, force."""

    @classmethod
    def carried(cls, gel: Gel, model: Any, frames: list[Deformation | PaperAnswer]) -> Fields:
        """Those of the answers of a model on another mesh, or on the model mesh itself.

        Finite elements are carried as they interpolate: between their nodes quadratic ones are
        curved, which is 5 % of the displacement where they are large.
        """
        mesh = ruffini.sensor(gel.sensor, resolution=MODEL_NODES).mesh
        silent = np.full(6, np.nan)
        force = np.array([getattr(frame, "wrench", silent)[:3] for frame in frames])
        if isinstance(model, Fem):
            found = [model.carry(frame.history, mesh) for frame in frames]  # type: ignore[union-attr]
        else:
            found = carried(frames, model.body.mesh, mesh)
        moved, stress = zip(*found, strict=True)
        return cls(np.array(moved), np.array(stress), force)

    def errors(self, truth: Fields, frames: range) -> dict[str, list[float]]:
        """Relative errors of the frames that count; absolute ones where the truth is nothing."""
        found: dict[str, list[float]] = {}
        for frame in frames:
            for what, error in self._of(truth, frame).items():
                found.setdefault(what, []).append(error)
        return found

    def _of(self, truth: Fields, frame: int) -> dict[str, float]:
        names = ("displacement", "stress", "force")
        mine, true = ({n: vars(of)[n][frame] for n in names} for of in (self, truth))
        if np.abs(true["displacement"]).max() < STILL:
            return {"still": float(np.abs(mine["displacement"]).max())}
        off = {
            name: difference(mine[name], true[name])
            for name in names
            if np.isfinite(mine[name]).all()
        }
        off["peak"] = float(abs(mine["stress"].max() / true["stress"].max() - 1))
        if self.predicted is not None:
            expected = zip(names, self.predicted[frame], strict=True)
            off |= {f"predicted {name}": float(error) for name, error in expected}
        return off


def true(case: Case, nodes: int, kept: Path) -> Fields | None:
    """Solution by quadratic elements on the finest mesh, kept in a file, if it is found."""
    file = kept / f"{case.panel}-{case.name}.npz"
    if not file.exists():
        judge = fem("p2", nodes, graded=True).make(case.gel, case.under)
        frames = judge.solve_path(case.press())
        if isinstance(frames[-1], PressError):
            return None
        fields = Fields.carried(case.gel, judge, frames)
        kept.mkdir(parents=True, exist_ok=True)
        np.savez(file, **{name: vars(fields)[name] for name in ("displacement", "stress", "force")})
    with np.load(file) as found:
        return Fields(**found)


def answered(case: Case, name: str) -> tuple[Fields | None, dict]:
    """A press answered by name: its fields, and CPU time a frame (s) or why there is none."""
    if name == LAYER:
        return None, closed_form(case)
    made = ANSWERERS[name].make(case.gel, case.under)
    seconds: list[float] = []
    while len(seconds) < REPEATS and sum(seconds) * len(case.path) < 1.0:
        begun = time.process_time()
        frames = made.solve_path(case.press())
        seconds.append((time.process_time() - begun) / len(case.path))
    if isinstance(frames[-1], PressError):
        return None, {"failed": frames[-1].kind}
    fields = Fields.carried(case.gel, made, frames)
    if getattr(frames[-1], "predicted_error", None) is not None:
        fields.predicted = [frame.predicted_error for frame in frames]
    return fields, {"seconds": min(seconds)}


def closed_form(case: Case) -> dict:
    """The closed form's force on a ball, its cost a Python call's."""
    if case.ball is None:
        return {"failed": "no ball"}
    gel, pad = case.gel, ruffini.sensor(case.gel.sensor, resolution=300).mesh
    thickness = float(np.ptp(pad.vertices[:, 2]))
    begun = time.process_time()
    for _ in range(100):
        force = bonded_layer(*case.ball, gel.young, gel.poisson, thickness)
    return {"seconds": (time.process_time() - begun) / 100 / len(force), "normal": force.tolist()}


def key(press: str, answerer: str) -> str:
    """Key of a row."""
    return f"{press}/{answerer}"


def rows(quick: bool, most: int, press: str, names: list[str], nodes: int, kept: Path) -> list:
    """Rows of a press for some of the answerers, with their errors."""
    case = cases(quick, most)[press]()
    truth = true(case, nodes, kept)
    if truth is None:
        failed = {"failed": "not solved by the truth", "panel": case.panel}
        return [failed | {"key": key(press, name), "answerer": name} for name in names]
    return [row(case, name, truth) for name in names]


def row(case: Case, name: str, truth: Fields) -> dict:
    """Errors of an answerer at a press."""
    fields, found = answered(case, name)
    found |= {"key": key(f"{case.panel}/{case.name}", name), "panel": case.panel, "answerer": name}
    if fields is not None:
        found["errors"] = fields.errors(truth, case.judged)
    elif "normal" in found:
        pairs = [(found["normal"][frame], -truth.force[frame, 2]) for frame in case.judged]
        felt = [abs(normal / force - 1) for normal, force in pairs if force > 0]
        found["errors"] = {"force": felt} if felt else {}
    return found


def batch(name: str, count: int, threads: int) -> dict:
    """Clock time a press of a batch (s), the quickest of its repetitions within a second."""
    # In a process that has answered nothing yet: the threads are chosen once in one.
    os.environ["RAYON_NUM_THREADS"] = str(threads)
    balls = [("ball", size) for size in np.linspace(3, 8, count)]
    presses = [case.press() for case in straight("batch", MINI, balls, [3e-4, 6e-4])]
    made = ANSWERERS[name].make(MINI, None)
    made.solve(presses[:threads])
    seconds: list[float] = []
    while sum(seconds) < 1.0:
        begun = time.perf_counter()
        answers = made.solve(presses)
        seconds.append(time.perf_counter() - begun)
    failed = sum(isinstance(answer, PressError) for answer in answers)
    found = {"panel": "batch", "answerer": name, "threads": threads, "presses": count}
    return found | {"failed": failed, "seconds": min(seconds) / count}
