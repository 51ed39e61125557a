"""The shipped surrogates beyond what they learnt: small balls, deep presses, a sharp block.

Writes ``surrogate.json`` beside itself and prints the rows of README's table. Judged by finite
elements on the mesh of the network's teacher; one thread (set RAYON_NUM_THREADS=1); a minute.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

import ruffini
from ruffini import Deformation, Press, PressError, Shape

FRICTION = 0.8
UPRIGHT = (0, 0, 0, 1)
SHAPES = {
    **{f"ball {r} mm": (Shape.sphere(1e-3 * r), 1e-3 * r) for r in (3, 4, 6, 8, 12)},
    "block 10 mm": (Shape.cuboid((5e-3, 5e-3, 5e-3)), 5e-3),
}
DEPTHS = (4e-4, 1e-3, 2e-3)
NETWORKS = {"surrogate": "default", "swift": "swift", "cells": "cells"}


def main() -> None:
    """Presses every shape to every depth by network, linear answer and finite elements."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".json"))
    out = parser.parse_args().out
    networks = {who: ruffini.Surrogate(name, friction=FRICTION) for who, name in NETWORKS.items()}
    card = json.loads(networks["surrogate"].card)
    fine = ruffini.sensor("gelsight-mini", resolution=card["linear_nodes"])
    models = [ruffini.Fem(fine, friction=FRICTION), ruffini.Compliance(fine, friction=FRICTION)]
    carry = ruffini.Transfer(fine.mesh, networks["surrogate"].body.mesh)
    rows = []
    for name, (shape, half) in SHAPES.items():
        for depth in DEPTHS:
            path = [([1e-3, 0, half - d], UPRIGHT) for d in np.linspace(1e-4, depth, 8)]
            press = Press(shape, path)
            truth, linear = (model.solve_path(press)[-1] for model in models)
            rows.append(row(name, depth, networks, press, truth, linear, carry))
            print(line(rows[-1]), flush=True)
    commit = subprocess.check_output(["git", "rev-parse", "--short", "HEAD"], text=True).strip()
    machine = {"cores": os.cpu_count(), "machine": platform.processor() or platform.machine()}
    report = {"commit": commit, **machine, "friction": FRICTION, "rows": rows}
    out.write_text(json.dumps(report, indent=1) + "\n")


def row(
    name: str,
    depth: float,
    networks: dict[str, ruffini.Surrogate],
    press: Press,
    truth: Deformation | PressError,
    linear: Deformation | PressError,
    carry: ruffini.Transfer,
) -> dict[str, Any]:
    """Errors of networks and linear answer, or what kept them from answering."""
    answers = {"truth": truth, "linear": linear}
    answers |= {who: network.solve_path(press)[-1] for who, network in networks.items()}
    failed = {who: str(a) for who, a in answers.items() if isinstance(a, PressError)}
    if failed:
        return {"press": name, "depth": depth, "failed": failed}
    fields = {
        who: (a.displacement, a.von_mises)
        if who in networks
        else (carry.interpolate(a.displacement), carry.average(a.von_mises))
        for who, a in answers.items()
    }
    errors = {
        who: {
            "force": relative(answers[who].wrench[:3], truth.wrench[:3]),
            "displacement": relative(fields[who][0], fields["truth"][0]),
            "stress": relative(fields[who][1], fields["truth"][1]),
        }
        for who in (*networks, "linear")
    }
    return {
        "press": name,
        "depth": depth,
        "force": float(np.linalg.norm(truth.wrench[:3])),
        **errors,
        "knows": {who: network.knows(answers[who]) for who, network in networks.items()},
        "seconds": {who: a.seconds for who, a in answers.items()},
    }


def relative(found: Any, truth: Any) -> float:
    """Norm of the difference over the norm of the truth."""
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def line(row: dict[str, Any]) -> str:
    """A row of README's table."""
    head = f"| {row['press']}, {1e3 * row['depth']:.1f} mm |"
    if "failed" in row:
        return f"{head} not solved by {', '.join(row['failed'])} |"
    cells = [
        " / ".join(f"{100 * row[who][what]:.1f}" for what in ("displacement", "stress", "force"))
        for who in (*NETWORKS, "linear")
    ]
    times = [f"{1e3 * row['seconds'][who]:.0f}" for who in (*NETWORKS, "linear", "truth")]
    return f"{head} {row['force']:.1f} N | {' | '.join(cells)} | {' / '.join(times)} ms |"


if __name__ == "__main__":
    main()
