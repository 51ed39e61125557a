"""Extreme presses, drawn from a seed: as plain values, and the bodies and shapes made of these.

A case is a dictionary of numbers and names, so that the report can keep and repeat it. SI units.
"""

from __future__ import annotations

import sys

import numpy as np

import ruffini
from engine import ROOT
from meshes import surface
from ruffini import Press, Shape, SoftBody, TetMesh
from ruffini._frames import turned

sys.path.append(str(ROOT / "tests/python"))
from bodies import box

LAWS = ("neo-hookean", "stable-neo-hookean", "corotated", "linear")
ELEMENTS = ("p1", "p1-bar", "p2")
MESHES = ("block", "wall", "film", "needles", "slivers", "inverted", "layers", "mini")
SHAPES = ("ball", "large ball", "tip", "plate", "edge", "cone", "rim", "prism", "annulus", "cup")
KINDS = ("steps", "at once", "tiny", "slide", "hold", "force", "force", "afar", "through")
BURIED = ("buried", "buried, slid")
"""Motions whose first pose is in the body already: the only one, or followed by ones beside it."""
SLENDER = ("ball", "pin", "capsule", "cone", "needle", "blade", "lens", "tube")
"""Shapes that begin buried."""
NETWORK = "surrogate"
"""The answerer that is a network."""
OF_PADS = ("linear", NETWORK)
"""Answerers that are made for a pad, and take seconds to build."""
GELS = {"mini": "gelsight-mini", "digit": "digit"}
HALF_TURN = np.array([1.0, 0.0, 0.0, 0.0])


class WrongError(Exception):
    """An answer that cannot be one."""


def spread(random: np.random.Generator, low: float, high: float) -> float:
    """A number drawn evenly by its logarithm."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def draw(random: np.random.Generator, answerer: str, pad: dict) -> dict:
    """Draws a press for `answerer`, on that `pad` if it is one of `OF_PADS`."""
    if answerer in OF_PADS:
        case = {"answerer": answerer} | pad | drive(random)
        if answerer == NETWORK:
            case["long way"] = str(random.choice(["none", "truth"], p=[0.9, 0.1]))
        return case
    case = {"answerer": answerer} | body(random) | drive(random)
    case["friction"] = 0.0 if random.random() < 0.3 else spread(random, 0.01, 5.0)
    if answerer == "compliance":
        case["corrections"] = int(random.choice([0, 0, 1, 3, 12]))
    if answerer == "fem":
        case["element"] = str(random.choice(ELEMENTS, p=[0.2, 0.6, 0.2]))
        case["long way"] = str(random.choice(["none", "finer", "stiffer"], p=[0.6, 0.2, 0.2]))
    return case


def draw_pad(random: np.random.Generator) -> dict:
    """Draws a pad for `OF_PADS`, half of them with a ratio and friction as gels have them."""
    pad = {
        "mesh": str(random.choice(list(GELS), p=[0.7, 0.3])),
        "young": spread(random, 1e3, 1e9),
        "poisson": poisson(random),
        "friction": 0.0 if random.random() < 0.3 else spread(random, 0.01, 4.0),
    }
    if random.random() < 0.5:
        pad["poisson"], pad["friction"] = random.uniform([0.45, 0.4], [0.49, 1.0]).tolist()
    return pad


def poisson(random: np.random.Generator) -> float:
    """Draws Poisson's ratio, half of them near 0.5."""
    near = 0.5 - 10 ** random.uniform(-4, -0.31)
    return float(random.choice([max(near, 0.0), random.uniform(0, 0.4999)]))


def draw_gel(random: np.random.Generator, answerer: str) -> dict:
    """Draws a pad for `answerer`, with its friction."""
    case = {
        "answerer": answerer,
        "mesh": str(random.choice(list(GELS), p=[0.7, 0.3])),
        "nodes": int(random.choice([300, 900])),
        "young": spread(random, 1e4, 1e7),
        "poisson": float(random.choice([0.3, 0.45, 0.48, 0.495])),
        "friction": 0.0 if random.random() < 0.4 else spread(random, 0.05, 2.0),
        "law": "neo-hookean",
    }
    if answerer == "fem":
        case["element"] = str(random.choice(["p1", "p1-bar"]))
    return case | {"corrections": 0, "free": False}


def draw_buried(random: np.random.Generator) -> dict:
    """Draws a shape whose first pose is in a pad: slender or small, at any tilt."""
    tilt, heading = random.uniform(0.0, np.pi, 2) * [1, 2]
    if random.random() < 0.3:
        tilt = float(random.choice([0.0, np.pi]))
    x, y = np.sin(tilt / 2) * np.array([np.cos(heading), np.sin(heading)])
    return {
        "shape": str(random.choice(SLENDER)),
        "size": spread(random, 2e-4, 2e-3),
        "slenderness": spread(random, 1.0, 8.0),
        "turn": [float(x), float(y), 0.0, float(np.cos(tilt / 2))],
        "aside": [float(x) for x in random.uniform(-1.0, 1.0, 2)],
        "kind": str(random.choice(BURIED, p=[0.7, 0.3])),
        "depth": spread(random, 0.02, 0.6),
        "frames": int(random.integers(1, 5)),
        "shear": [float(x) for x in random.uniform(-1e-3, 1e-3, 2)],
        "long way": "lowered",
    }


def body(random: np.random.Generator) -> dict:
    """Draws a soft body."""
    return {
        "young": spread(random, 1e3, 1e9),
        "poisson": poisson(random),
        "law": str(random.choice(LAWS)),
        "mesh": str(random.choice(MESHES, p=[0.3, 0.15, 0.1, 0.1, 0.1, 0.03, 0.15, 0.07])),
        "cells": int(random.integers(1, 4)),
        "ratio": spread(random, 1.0, 1e6),
        "flatness": spread(random, 1e-8, 1e-1),
        "free": bool(random.random() < 0.05),
    }


def drive(random: np.random.Generator) -> dict:
    """Draws a rigid shape and its path."""
    found = {
        "shape": str(random.choice(SHAPES)),
        "size": spread(random, 5e-4, 8e-3),
        "turn": [float(x) for x in random.normal(size=4)] if random.random() < 0.3 else None,
        "aside": [float(x) for x in random.uniform(-1.0, 1.0, 2)],
        "kind": str(random.choice(KINDS)),
    }
    found["depth"] = spread(random, 1e-3, 0.7)
    found["frames"] = int(random.integers(2, 7))
    found["shear"] = [float(x) for x in random.uniform(-1e-3, 1e-3, 2)]
    found["force"] = spread(random, 1e-4, 100.0)
    return found


def soft_body(case: dict) -> SoftBody:
    """The body of a case.

    Raises:
        ValueError: If it cannot be pressed.
    """
    if case["mesh"] in GELS:
        pad = ruffini.sensor(GELS[case["mesh"]], resolution=case.get("nodes", 300))
        base = None if case["free"] else pad.fixed
        return SoftBody(pad.mesh, case["young"], case["poisson"], case["law"], base)
    mesh = solid(case)
    low = mesh.vertices[:, 2].min()
    base = None if case["free"] else np.flatnonzero(mesh.vertices[:, 2] < low + 1e-9)
    return SoftBody(mesh, moduli(case, mesh), case["poisson"], case["law"], base)


def moduli(case: dict, mesh: TetMesh) -> float | np.ndarray:
    """Young's modulus, of every tetrahedron where there are layers (Pa)."""
    if case["mesh"] != "layers":
        return case["young"]
    middle = mesh.vertices[mesh.tets, 2].mean(axis=1)
    return np.where(middle > -2e-3, case["young"], max(case["young"] / case["ratio"], 1e3))


def solid(case: dict) -> TetMesh:
    """A box whose upper face is at z = 0."""
    cells = case["cells"]
    side = np.linspace(-4e-3, 4e-3, 2 * cells + 1)
    height = np.linspace(-4e-3, 0, cells + 1)
    if case["mesh"] == "wall":
        return box(np.linspace(-3e-4, 3e-4, 3), side, height)
    if case["mesh"] == "film":
        return box(side, side, np.linspace(-2e-4, 0, cells + 1))
    if case["mesh"] == "needles":
        width = max(case["flatness"] * 1e-2, 1e-6)
        narrow = np.concatenate([side[:cells], np.linspace(-width, width, 3), side[cells + 1 :]])
        return box(narrow, narrow, height)
    mesh = box(side, side, height)
    if case["mesh"] == "slivers":
        return with_slivers(mesh, case["flatness"])
    if case["mesh"] == "inverted":
        tets = mesh.tets.copy()
        tets[len(tets) // 2, :2] = tets[len(tets) // 2, 1::-1]
        return TetMesh(mesh.vertices, tets)
    return mesh


def with_slivers(mesh: TetMesh, height: float) -> TetMesh:
    """The mesh with a vertex in every tetrahedron, at a share `height` of its own over a face."""
    corners = mesh.vertices[mesh.tets]
    new = corners[:, :3].mean(axis=1) * (1 - height) + corners[:, 3] * height
    number = len(mesh.vertices) + np.arange(len(mesh.tets))
    a, b, c, d = mesh.tets.T
    n = number.astype(mesh.tets.dtype)
    parts = [[a, b, c, n], [a, b, n, d], [a, n, c, d], [n, b, c, d]]
    tets = np.concatenate([np.stack(part, axis=1) for part in parts])
    return TetMesh(np.concatenate([mesh.vertices, new]), tets)


def shape(case: dict) -> tuple[Shape, np.ndarray]:
    """Rigid shape of a press, and the orientation (a quaternion) with its sharp end below."""
    r, name = case["size"], case["shape"]
    long = r * case.get("slenderness", 1.0)
    straight, eighth = np.array([0.0, 0, 0, 1]), np.pi / 8
    on_edge = np.array([np.sin(eighth), 0, 0, np.cos(eighth)])
    kinds = {
        "ball": lambda: (Shape.sphere(r), straight),
        "large ball": lambda: (Shape.sphere(10 * r), straight),
        "tip": lambda: (Shape.sphere(5e-4), straight),
        "plate": lambda: (Shape.half_space(), HALF_TURN),
        "edge": lambda: (Shape.cuboid((2 * r, r, r)), on_edge),
        "cone": lambda: (Shape.cone(r, long), HALF_TURN),
        "rim": lambda: (Shape.cylinder(r, r), on_edge),
        "prism": lambda: (Shape.prism(5, r, 2 * r), on_edge),
        "annulus": lambda: (Shape.annulus(r, 0.6 * r, 0.5 * r), straight),
        "cup": lambda: (Shape.cup(0.7 * r, r, r, 0.1 * r), HALF_TURN),
        "pin": lambda: (Shape.cylinder(r, long), straight),
        "capsule": lambda: (Shape.capsule(r, long), straight),
        "needle": lambda: (Shape.prism(5, r, long), straight),
        "blade": lambda: (Shape.cuboid((0.3 * r, r, long)), straight),
        "lens": lambda: (Shape.ellipsoid((r, 0.6 * r, long)), straight),
        "tube": lambda: (Shape.annulus(r, 0.5 * r, long), straight),
    }
    found, turn = kinds[name]()
    if case["turn"] is not None and name != "plate":
        turn = np.array(case["turn"]) / np.linalg.norm(case["turn"])
    return found, turn


def reach(form: Shape) -> float:
    """A length past which the shape cannot reach from its origin, half-spaces aside (m)."""
    far = 0.3 * np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1]])
    return 0.3 - float(form.distance(far)[0].min())


def touching(form: Shape, turn: np.ndarray, place: np.ndarray, vertices: np.ndarray) -> float:
    """Height of the shape's origin over `place` (x, y) at which it first touches vertices (m).

    It comes down by its least distance at a time, which cannot lead past a vertex; over no vertex
    it stops a millimetre above the highest.
    """
    back = turn * [-1, -1, -1, 1]
    height = 0.3
    while height > -0.02:
        seen = turned(back, vertices - [*place, height])
        gap = form.distance(seen)[0].min()
        if gap < 1e-9:
            return height
        height -= gap
    return vertices[:, 2].max() + 1e-3


Pose = tuple[np.ndarray, np.ndarray]
"""Place (m) and orientation, a quaternion."""


def face_height(mesh: TetMesh, place: np.ndarray) -> float:
    """Height of the upper face of a body over a place (x, y) (m)."""
    corners = mesh.vertices[surface(mesh)]
    base, sides = corners[:, 0], corners[:, 1:] - corners[:, :1]
    upward = np.linalg.det(sides[..., :2]) > 1e-12  # Twice the area (m²), seen from above.
    base, sides = base[upward], sides[upward]
    weights = np.linalg.solve(sides[..., :2].transpose(0, 2, 1), (place - base[:, :2])[..., None])
    inside = (weights.min(axis=1)[:, 0] > -1e-9) & (weights.sum(axis=1)[:, 0] < 1.0 + 1e-9)
    return float((base[:, 2] + (sides[..., 2] * weights[..., 0]).sum(axis=1))[inside].max())


def buried(case: dict, mesh: TetMesh) -> list[Pose]:
    """Poses of a shape of which the first is in a body at rest of that mesh."""
    form, turn = shape(case)
    wide, long, thick = np.ptp(mesh.vertices, axis=0)
    place = 0.3 * np.array([wide, long]) * case["aside"]
    lowest = turned(turn, form.surface()[0])[:, 2].min()
    begin = np.array([*place, face_height(mesh, place) - lowest - case["depth"] * thick])
    frames = case["frames"] if case["kind"] == "buried, slid" else 0
    slid = np.linspace(0, 1, frames + 1)[:, None] * [*case["shear"], 0]
    return [(begin + way, turn) for way in slid]


def lowered(case: dict, mesh: TetMesh) -> Press:
    """The press that leads a buried shape down to where it begins."""
    form, _ = shape(case)
    place, turn = buried(case, mesh)[0]
    above = place + np.array([0, 0, 2 * reach(form)])
    return Press(form, [(above, turn), (place, turn)])


def press(case: dict, mesh: TetMesh, finer: int = 1) -> Press:
    """The press of a case on a body at rest of that mesh, each step cut into `finer`."""
    if case["kind"] in BURIED:
        return Press(shape(case)[0], buried(case, mesh))
    vertices = mesh.vertices
    form, turn = shape(case)
    half, thick = np.ptp(vertices[:, :2], axis=0) / 2, np.ptp(vertices[:, 2])
    place = 0.6 * half * case["aside"]
    top = touching(form, turn, place, vertices)
    depth, frames, kind = case["depth"] * thick, case["frames"], case["kind"]
    if kind == "force":
        start = ((*place, top), turn)
        return Press(form, start, force=case["force"], direction=(0, 0, -1))
    ways = np.linspace(0, 1, frames * finer + 1)[1:, None] * [0, 0, -depth]
    if kind == "at once":
        ways = np.linspace(0, 1, finer + 1)[1:, None] * [0, 0, -depth]
    if kind == "afar":
        ways = np.array([[0, 0, 0.05], [0, 0, -depth]])
    if kind == "through":
        ways = np.array([[0, 0, 1e-4], [0, 0, -thick - 2.5 * reach(form)]])
    if kind == "tiny":
        ways = np.arange(1, frames * finer + 1)[:, None] * [0, 0, -1e-6 / finer]
    if kind == "slide":
        aside = np.linspace(0, 1, frames * finer + 1)[1:, None] * [*case["shear"], 0]
        ways = np.concatenate([ways, ways[-1] + aside])
    if kind == "hold":
        ways = np.concatenate([ways, np.tile(ways[-1], (30, 1))])
    return Press(form, [((place[0] + x, place[1] + y, top + z), turn) for x, y, z in ways])
