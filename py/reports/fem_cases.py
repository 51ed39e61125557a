"""Cases of the report: accuracy by mesh, the GelSight Mini's force, cost along a path.

Units are SI. V vertices and T tetrahedra of the mesh that fields are compared on.
"""

from __future__ import annotations

import itertools
import resource
import sys
import time

import numpy as np
import tomllib

import ruffini
from engine import OUT, ROOT
from meshes import carried, difference, nodal, volumes
from ruffini import Fem, Press, Shape, SoftBody

sys.path.append(str(ROOT / "tests/python"))
from bodies import box

FLAT = str(OUT / "flat-pad.toml")
MINI = tomllib.loads((ROOT / "env-core/assets/sensors/gelsight-mini.toml").read_text())
UPRIGHT = (0.0, 0.0, 0.0, 1.0)

YOUNG, LAW, RADIUS = 2e5, "stable-neo-hookean", 4e-3
CONVERGED = {"0.5": 0.3806, "1.0": 1.3133}
"""Force (N) by depth (mm) at a Poisson's ratio of 0.48: NGSolve, GetFEM and CalculiX refined."""
MEASURED = {"0.5": 1.650, "1.0": 5.964, "1.5": 13.526, "2.0": 23.253}
"""Force (N) by depth (mm) of a GelSight Mini under a ball of 7.5 mm (FEATS, arXiv 2411.03315)."""
MINI_RADIUS = 7.5e-3
SCENE = {
    "young": YOUNG,
    "law": LAW,
    "radius": RADIUS,
    "converged": CONVERGED,
    "mini_radius": MINI_RADIUS,
    "measured": MEASURED,
}


def ball_path(radius: float, depths: np.ndarray, sideways: float = 0.0) -> list:
    """Poses of a ball pressed to depths (m), then moved along x in steps of 0.1 mm."""
    down = [((0.0, 0.0, radius - depth), UPRIGHT) for depth in depths]
    steps = np.arange(1, round(sideways / 1e-4) + 1) * 1e-4
    return down + [((x, 0.0, radius - depths[-1]), UPRIGHT) for x in steps]


def depths(last: float, step: float) -> np.ndarray:
    """Depths (m) in equal steps from `step` to `last`."""
    return np.arange(1, round(last / step) + 1) * step


def flat_pad(nodes: int, poisson: float, around: list[list[float]] | None = None) -> SoftBody:
    """The flat pad with at most that many nodes, most of them near the points `around` (m)."""
    pad = ruffini.sensor(FLAT, resolution=nodes, around=around)
    return SoftBody(pad.mesh, YOUNG, poisson, LAW, pad.fixed)


FINEST = (4, 4, 2)
"""Parts along x, y, z into which the truth's mesh cuts a cell of the common one."""


def refined(mesh: ruffini.TetMesh, parts: tuple[int, int, int] = FINEST) -> ruffini.TetMesh:
    """The mesh of a flat pad with the cells within 3.7 mm of the contact cut into `parts`.

    The vertices of the mesh are among the new ones: fields are carried to them without error.
    """
    axes = []
    for places, count in zip(mesh.vertices.T, parts, strict=True):
        ends = np.unique(places)
        cells = itertools.pairwise(ends)
        counts = [(a, b, count if max(abs(a), abs(b)) < 3.7e-3 else 1) for a, b in cells]
        inner = [np.linspace(a, b, count, endpoint=False) for a, b, count in counts]
        axes.append(np.concatenate([*inner, ends[-1:]]))
    return box(*axes)


def solved(body: SoftBody, element: str, friction: float, radius: float, path: list):
    """The frames of a path, and their cost."""
    begun = time.process_time()
    fem = Fem(body, friction=friction, element=element)
    built = time.process_time()
    frames = fem.solve_path(Press(Shape.sphere(radius), path))
    cpu = (time.process_time() - built) / len(path)
    if isinstance(frames[-1], ruffini.PressError):
        raise frames[-1]
    return frames, {
        "vertices": len(body.mesh.vertices),
        "tetrahedra": len(body.mesh.tets),
        "setup_cpu_seconds": built - begun,
        "seconds": float(np.mean([frame.seconds for frame in frames])),
        "cpu_seconds": cpu,
        "iterations": float(np.mean([frame.iterations for frame in frames])),
        "residual": max(frame.residual for frame in frames),
    }


def accuracy(common_nodes: int, counts: dict, poisson: float) -> dict:
    """Every mesh at a Poisson's ratio against the finest quadratic one, all on a common mesh."""
    common, rows = ruffini.sensor(FLAT, resolution=common_nodes).mesh, []
    body, kept, reference = quadratic(common, poisson, FINEST)
    truth = dict(zip(kept, carried(kept.values(), body.mesh, common), strict=True))
    path, tets = ball_path(RADIUS, depths(1e-3, 2.5e-4)), volumes(common)
    meshes = [(element, n) for element, some in counts.items() for n in some]
    for element, nodes in meshes:
        body, row = flat_pad(nodes, poisson), {"element": element, "nodes": nodes}
        try:
            frames, cost = solved(body, element, 0.0, RADIUS, path)
        except ruffini.PressError as error:
            rows.append(row | {"vertices": len(body.mesh.vertices), "failed": str(error)})
            continue
        errors = {}
        fields = carried(frames[1::2], body.mesh, common)
        for frame, (moved, stress), depth in zip(frames[1::2], fields, truth, strict=True):
            force, (true_moved, true_stress) = -frame.wrench[2], truth[depth]
            errors[depth] = {
                "force": force,
                "force_error": force / reference["force"][depth] - 1,
                "displacement_error": difference(moved, true_moved, nodal(common, tets)),
                "von_mises_error": difference(stress, true_stress, tets),
            }
        rows.append(row | cost | {"depths": errors})
    common_size = {"vertices": len(common.vertices), "tetrahedra": len(common.tets)}
    return {"poisson": poisson, "common": common_size, "reference": reference, "rows": rows}


def quadratic(
    common: ruffini.TetMesh, poisson: float, parts: tuple[int, int, int]
) -> tuple[SoftBody, dict, dict]:
    """A body of cells cut into `parts`, its frames by depth, and their forces (N) and cost."""
    mesh = refined(common, parts)
    base = np.flatnonzero(mesh.vertices[:, 2] <= mesh.vertices[:, 2].min())
    body = SoftBody(mesh, YOUNG, poisson, LAW, base)
    frames, cost = solved(body, "p2", 0.0, RADIUS, ball_path(RADIUS, depths(1e-3, 5e-4)))
    kept = dict(zip(CONVERGED, frames, strict=True))
    force = {depth: -frame.wrench[2] for depth, frame in kept.items()}
    return body, kept, cost | {"force": force}


def refinement(nodes: int, parts: tuple[int, int, int]) -> dict:
    """Force of quadratic elements at a Poisson's ratio of 0.48 on a mesh of the truth's family."""
    common = ruffini.sensor(FLAT, resolution=nodes).mesh
    return {"parts": list(parts)} | quadratic(common, 0.48, parts)[2]


def closed_forms(young: float, poisson: float) -> dict:
    """Force (N) on the Mini by depth on a half-space (Hertz) and on a flat bonded layer.

    The layer is that for any Poisson's ratio, and by its authors' own equation for 0.5.
    """
    thickness = MINI["outline"]["thickness"]
    found: dict = {"hertz": {}, "dimitriadis": {}, "dimitriadis 0.5": {}}
    for depth in MEASURED:
        delta = float(depth) * 1e-3
        x = np.sqrt(MINI_RADIUS * delta) / thickness
        flat = 4 / 3 * young * np.sqrt(MINI_RADIUS * delta**3)
        incompressible = 1 + 1.133 * x + 1.283 * x**2 + 0.769 * x**3 + 0.0975 * x**4
        found["hertz"][depth] = flat / (1 - poisson**2)
        found["dimitriadis"][depth] = bonded_layer(MINI_RADIUS, delta, young, poisson, thickness)
        found["dimitriadis 0.5"][depth] = flat / 0.75 * incompressible
    return found


def bonded_layer(radius: float, depth, young: float, poisson: float, thickness: float):
    """Force of a ball on a flat layer bonded underneath (N), without friction, by depth (m).

    Hertz times a series in √(Rδ)/h (Dimitriadis et al. 2002, doi 10.1016/S0006-3495(02)75620-8).
    """
    alpha = -(1.2876 - 1.4678 * poisson + 1.3442 * poisson**2) / (1 - poisson)
    beta = (0.6387 - 1.0277 * poisson + 1.5164 * poisson**2) / (1 - poisson)
    cubic = alpha**3 + 4 * np.pi**2 / 15 * beta
    quartic = alpha * (alpha**3 + 3 * np.pi**2 / 5 * beta)
    hertz = 4 / 3 * young / (1 - poisson**2) * np.sqrt(radius * depth**3)
    y = 2 / np.pi * np.sqrt(radius * depth) / thickness
    return hertz * (1 - alpha * y + (alpha * y) ** 2 - cubic * y**3 + quartic * y**4)


def mini(calibration: str, friction: float, element: str, nodes: int) -> dict:
    """Force of the GelSight Mini on a ball of 7.5 mm, nothing fitted."""
    body = ruffini.sensor("gelsight-mini", calibration, nodes)
    path = ball_path(MINI_RADIUS, depths(2e-3, 2.5e-4))
    frames, cost = solved(body, element, friction, MINI_RADIUS, path)
    force = {depth: -frames[2 * i + 1].wrench[2] for i, depth in enumerate(MEASURED)}
    about = {"calibration": calibration, "friction": friction, "element": element}
    return about | cost | {"force": force}


SHALLOW = (2e-5, 1e-4, 2.5e-4, 5e-4)
"""Depths (m) at which the force is compared with that of a bonded layer."""
UNDER = [[x, 0.0, 0.0] for x in (-1e-3, 0.0, 1e-3)]
"""Points of the face towards which a mesh is graded (m)."""


def shallow(element: str, nodes: int, is_graded: bool) -> dict:
    """Force of a ball that only just presses, against the closed form of a bonded layer."""
    poisson = 0.48
    body = flat_pad(nodes, poisson, UNDER if is_graded else None)
    frames, cost = solved(body, element, 0.0, RADIUS, ball_path(RADIUS, np.array(SHALLOW)))
    thickness = float(np.ptp(body.mesh.vertices[:, 2]))
    errors = {}
    for depth, frame in zip(SHALLOW, frames, strict=True):
        exact = bonded_layer(RADIUS, depth, YOUNG, poisson, thickness)
        errors[f"{1e3 * depth:g}"] = -frame.wrench[2] / exact - 1
    return {"element": element, "graded": is_graded, "errors": errors} | cost


def speed(nodes: int, friction: float) -> dict:
    """Cost of a path in steps of 0.1 mm: 1 mm down, 0.5 mm sideways."""
    before, body = peak_memory(), flat_pad(nodes, 0.48)
    path = ball_path(RADIUS, depths(1e-3, 1e-4), sideways=5e-4)
    frames, cost = solved(body, "p1-bar", friction, RADIUS, path)
    memory = {"idle_mib": before, "peak_mib": peak_memory()}
    slowest = max(frame.seconds for frame in frames)
    return {"friction": friction} | cost | {"slowest_seconds": slowest} | memory


def peak_memory() -> float:
    """Most memory that this process has held (MiB)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
