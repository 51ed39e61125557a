"""A gel pad under a ball by scikit-fem, to check ruffini's finite elements against.

Mesh, material, load and contact law are those of `tests/physics/peer.rs`: a ball of 4 mm pressed
1 mm into a pad of 20.75 × 25.25 × 4 mm, E = 0.2 MPa, ν = 0.48, in ten frames ("press", without
friction), then moved aside by 0.5 mm in ten ("shear", μ = 0.5 from the beginning). `pad.py` has the
method.

    pip install -r tests/reference/requirements.txt
    python tests/reference/peer.py --out tests/reference    # peer_p1.json and peer_p2.json
    python tests/reference/peer.py --speed --out tests/reference    # peer_speed.json
"""

import argparse
import json
import os
import platform
import subprocess
import tempfile
import time
from importlib.metadata import version
from pathlib import Path


def command_line():
    """The options."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--speed", action="store_true", help="time both programs")
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument("--order", type=int, help="volume quadrature (p1: 1, p2: 2)")
    parser.add_argument("--face-order", type=int, help="contact quadrature (16; to time, 8)")
    parser.add_argument("--softness", type=float, default=2e-6, help="contact softness (m)")
    parser.add_argument("--steps", type=int, default=1, help="load steps a frame")
    return parser


if __name__ == "__main__":
    # For --help, before packages that are not installed.
    command_line().parse_args()

for variable in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np
from pad import ELEMENTS, MM, RADIUS, Press
from skfem import MeshTet

HERE = Path(__file__).parent
OURS = ["cargo", "run", "--release", "--quiet", "--example", "peer", "--"]
FRICTION = {"press": 0.0, "shear": 0.5}


def gel_pad():
    """The mesh that ruffini writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pad.npz"
        subprocess.run([*OURS, "mesh", str(path)], check=True, cwd=HERE)
        with np.load(path) as mesh:
            points, tets = mesh["vertices"].T, mesh["tets"].T.astype(np.int64)
    return MeshTet(np.ascontiguousarray(points), np.ascontiguousarray(tets))


def path(case, steps):
    """Centres of the ball (m), frame by frame, each in `steps` load steps."""
    count = 10 * steps
    down = [np.array([0, 0, RADIUS - MM * i / count]) for i in range(1, count + 1)]
    aside = [np.array([0.5 * MM * i / count, 0, RADIUS - MM]) for i in range(1, count + 1)]
    return down + aside if case == "shear" else down


def solve(mesh, element, case, settings):
    """The press at its end."""
    press = Press(mesh, element, FRICTION[case], settings)
    for centre in path(case, settings.steps):
        press.lead(centre)
    return press


def timed(mesh, element, case, settings):
    """Least mean seconds a frame of two runs, without setting up, and the force at the end (N)."""
    means, centres = [], path(case, settings.steps)
    for _ in range(2):
        press = Press(mesh, element, FRICTION[case], settings)
        start = time.perf_counter()
        for centre in centres:
            press.lead(centre)
        means.append((time.perf_counter() - start) * settings.steps / len(centres))
    force = press.contact.total(press.u, press.centre)
    return {"seconds": min(means), "force": rounded(np.linalg.norm(force))[0]}


def rounded(numbers):
    """`numbers` with six digits, for JSON."""
    return [float(f"{x:.5e}") for x in np.ravel(numbers)]


def answer(press):
    """Force on the pad (N), displacement (V, 3) of the vertices (m), von Mises stress (T) (Pa)."""
    vertices = press.solid.basis.nodal_dofs[0]
    return {
        "force": rounded(press.contact.total(press.u, press.centre)),
        "displacement": rounded(press.u[:, vertices].T),
        "von_mises": rounded(press.solid.von_mises(press.u)),
    }


def write_answers(mesh, settings):
    """Writes the last frame of both cases, one file for an element."""
    for element in ELEMENTS:
        answers = {case: answer(solve(mesh, element, case, settings)) for case in FRICTION}
        file = settings.out / f"peer_{element}.json"
        file.write_text(json.dumps(answers, separators=(",", ":")) + "\n")
        print(file, {case: found["force"] for case, found in answers.items()})


def write_speed(mesh, settings):
    """Times both programs on this machine, one thread each, one after the other."""
    peer = {e: {c: timed(mesh, e, c, settings) for c in FRICTION} for e in ELEMENTS}
    ours = json.loads(subprocess.check_output([*OURS, "speed"], cwd=HERE))
    packages = ("scikit-fem", "pypardiso", "mkl", "scipy", "numpy")
    report = {
        "unit": "mean seconds a frame, one thread; force in N at the end",
        "machine": f"{cpu()}, {platform.system()}, Python {platform.python_version()}",
        "versions": {name: version(name) for name in packages},
        "vertices": int(mesh.nvertices),
        "tetrahedra": int(mesh.nelements),
        "peer": peer,
        "ours": ours,
        "ratio": {e: {c: ratio(peer[e][c], ours[e][c]) for c in FRICTION} for e in ELEMENTS},
    }
    text = json.dumps(report, indent=2, ensure_ascii=False)
    (settings.out / "peer_speed.json").write_text(text + "\n")
    print(text)


def ratio(peer, ours):
    """Ratio of the peer's time to ours."""
    return round(peer["seconds"] / ours["seconds"], 1)


def cpu():
    """The processor's name."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next(line.split(": ")[1] for line in lines if line.startswith("model name"))


def main():
    """Runs the comparison that the arguments choose."""
    settings = command_line().parse_args()
    settings.face_order = settings.face_order or (8 if settings.speed else 16)
    (write_speed if settings.speed else write_answers)(gel_pad(), settings)


if __name__ == "__main__":
    main()
