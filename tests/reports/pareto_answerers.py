"""Who answers presses: the table of the report on error against run time.

Another answerer needs an entry of `ANSWERERS`, and a place in a series of the picture.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import ruffini
from ruffini import Compliance, Fem, LinearPad, PaperNetwork, SoftBody, Surrogate

RUNS = Path.home() / ".cache/ruffini/networks"
"""What `networks.py --runs` has trained."""


@dataclass(frozen=True)
class Gel:
    """What the pad is made of, and how rough."""

    sensor: str
    young: float
    """Young's modulus (Pa)."""
    poisson: float
    friction: float

    @property
    def material(self) -> dict[str, Any]:
        """What a network is told of it."""
        elastic = {"young": self.young, "poisson": self.poisson}
        return {"sensor": self.sensor, "friction": self.friction} | elastic

    def body(self, nodes: int) -> SoftBody:
        """The pad, meshed with about so many nodes."""
        pad = ruffini.sensor(self.sensor, resolution=nodes)
        return SoftBody(pad.mesh, self.young, self.poisson, "neo-hookean", pad.fixed)


@dataclass(frozen=True)
class Answerer:
    """A way to answer presses."""

    make: Callable[[Gel], Any]
    """The model of a gel."""
    kind: str
    """Family, one colour in the figure."""
    use: str
    """How it is asked for in Python."""
    made_from: dict[str, float] = field(default_factory=dict)
    """Core seconds that were spent before the first answer, by what for."""
    shipped: bool = True
    """Whether a user would ask it: neither an oracle nor a network of one's own."""
    file: Path | None = None
    """Weights that have to be trained first."""


def compliance(nodes: int, sweeps: int = 0, rough: bool = True) -> Answerer:
    """Linear elasticity condensed to the surface."""
    arguments = (f", sweeps={sweeps}" if sweeps else "") + ("" if rough else ", friction=0")
    return Answerer(
        lambda gel: Compliance(gel.body(nodes), gel.friction if rough else 0.0, sweeps),
        "compliance",
        f"Compliance(sensor(…, resolution={nodes}){arguments})",
    )


def at_nodes(nodes: int) -> Answerer:
    """Linear elasticity with contact at the nodes, made for speed."""
    return Answerer(
        lambda gel: Compliance(gel.body(nodes), gel.friction, contact="nodes"),
        "compliance",
        f'Compliance(sensor(…, resolution={nodes}), contact="nodes")',
    )


def fem(element: str, nodes: int, tolerance: float = 1e-7) -> Answerer:
    """Finite elements, up to a force out of balance (N)."""
    loose = f", tolerance={tolerance:g}" if tolerance > 1e-7 else ""
    return Answerer(
        lambda gel: Fem(gel.body(nodes), gel.friction, tolerance, element),
        "fem",
        f'Fem(sensor(…, resolution={nodes}), element="{element}"{loose})',
    )


def trained(run: str, of: type[Surrogate | PaperNetwork] = Surrogate) -> Answerer:
    """A network that is not shipped."""

    file = RUNS / run / "weights.safetensors"
    return Answerer(
        lambda gel: of.load(file, **gel.material),
        "other network" if of is Surrogate else "paper",
        f'{of.__name__}.load("{run}/{file.name}")',
        shipped=False,
        file=file,
    )


def paper(weights: str, made_from: dict[str, float]) -> Answerer:
    """One of the paper's networks that is shipped; it says no forces."""
    return Answerer(
        lambda gel: PaperNetwork(weights, **gel.material),
        "paper",
        f'PaperNetwork("{weights}")',
        made_from,
    )


class BondedLayer:
    """Force of a ball on a flat layer bonded underneath, without friction, for any Poisson's ratio.

    Hertz times a series in √(Rδ)/h (Dimitriadis et al. 2002, doi 10.1016/S0006-3495(02)75620-8).
    """

    def __init__(self, gel: Gel):
        self.gel = gel
        self.thickness = float(
            np.ptp(ruffini.sensor(gel.sensor, resolution=300).mesh.vertices[:, 2])
        )

    def force(self, radius: float, depth: np.ndarray) -> np.ndarray:
        """Normal force (N) at depths (m)."""
        nu = self.gel.poisson
        alpha = -(1.2876 - 1.4678 * nu + 1.3442 * nu**2) / (1 - nu)
        beta = (0.6387 - 1.0277 * nu + 1.5164 * nu**2) / (1 - nu)
        hertz = 4 / 3 * self.gel.young / (1 - nu**2) * np.sqrt(radius * depth**3)
        y = 2 / np.pi * np.sqrt(radius * depth) / self.thickness
        cubic = alpha**3 + 4 * np.pi**2 / 15 * beta
        quartic = alpha * (alpha**3 + 3 * np.pi**2 / 5 * beta)
        return hertz * (1 - alpha * y + (alpha * y) ** 2 - cubic * y**3 + quartic * y**4)


PADS = {"data": 45 * 60.0, "training": 2 * 8 * 60.0}
"""Of the network: 200 indenters, and 80 epochs in 8 minutes on 2 threads."""
B = {"data": 4.5 * 3600, "training": 600.0}
"""Of the paper's B: 630 grasps of 10 frames (dataset.md), and the budget of paper.py."""

SIZES = {
    "network, 48 channels": trained("pads48-0"),
    "network, 16 channels": trained("pads16-0"),
}
"""The network at other sizes."""
PAPERS = {
    "paper's Baseline": trained("paper-baseline", PaperNetwork),
    "paper's A": trained("paper-a", PaperNetwork),
    "paper's B, 32 channels": trained("paper-b-wide", PaperNetwork),
    "paper's B, 8 rounds": trained("paper-b-long", PaperNetwork),
}
"""The paper's other networks: 16 channels and 4 rounds where no other is said."""

ANSWERERS: dict[str, Answerer] = {
    "bonded layer": Answerer(BondedLayer, "closed form", "– (force of a ball)"),
    "compliance, no friction": compliance(2000, rough=False),
    "compliance 1000": compliance(1000),
    "compliance": compliance(2000),
    "compliance at nodes": at_nodes(2000),
    "compliance, 1 sweep": compliance(2000, 1),
    "compliance, 3 sweeps": compliance(2000, 3),
    "compliance, 6 sweeps": compliance(2000, 6),
    "compliance, 12 sweeps": compliance(2000, 12),
    "linear, on cells": Answerer(
        lambda gel: LinearPad(**gel.material), "compliance", "LinearPad()"
    ),
    "network": Answerer(lambda gel: Surrogate(**gel.material), "network", "Surrogate()", PADS),
    "network, by Candle": Answerer(
        lambda gel: Surrogate(**gel.material).plain(),
        "oracle",
        "Surrogate().plain()",
        shipped=False,
    ),
    **SIZES,
    "paper's B": paper("paper-b", B),
    **PAPERS,
    "fem p1 2000": fem("p1", 2000),
    "fem p1-bar 500": fem("p1-bar", 500),
    "fem p1-bar 1000": fem("p1-bar", 1000),
    "fem p1-bar 2000, 1 mN": fem("p1-bar", 2000, 1e-3),
    "fem p1-bar 2000, 10 µN": fem("p1-bar", 2000, 1e-5),
    "fem p1-bar 2000": fem("p1-bar", 2000),
    "fem p1-bar 3000": fem("p1-bar", 3000),
    "fem p2 500": fem("p2", 500),
    "fem p2 1000": fem("p2", 1000),
}
ELEMENTS = "fem p1-bar 2000"
"""Finite elements whose answer and time others are put beside."""
FEW = ["bonded layer", "compliance 1000", "compliance at nodes", "linear, on cells", "network"]
FEW += ["network, by Candle", "paper's B", "fem p1-bar 500", ELEMENTS]
"""Who is asked in the quick form: some of every kind that needs no training."""
