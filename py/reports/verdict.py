"""Outcome of an extreme press: solved, refused by name, or wrong.

An answer counts as solved if it stands these checks. Every number is finite. The force left out of
balance is within the tolerance that the finite elements state. The wrench is the sum of the contact
forces. Held nodes stay. No tetrahedron is inside out where the law forbids it. No shape is deeper
in the skin than 250 softnesses (0.5 mm), the bound that is documented for contact points, and the
distance from there to the next one. Contact never pulls: a shape that comes down on a bonded body
presses it down, and a ball without friction pushes every node that it touches outwards. What is in
the body at rest as deep as that is felt, and what begins there pushes it down, an upright shape at
least as much as aside. A plate does not rub with more than the cone of friction. Linear answers
and networks are nothing where nothing touches.
"""

from __future__ import annotations

import time
from functools import lru_cache
from typing import Any

import numpy as np

import extreme_scenes
import ruffini
from extreme import (
    GELS,
    NETWORK,
    OF_PADS,
    Pose,
    WrongError,
    face_height,
    lowered,
    press,
    shape,
    soft_body,
)
from meshes import surface, volumes
from ruffini import (
    Compliance,
    Deformation,
    Fem,
    LinearPad,
    PressError,
    Shape,
    SoftBody,
    Surrogate,
    TetMesh,
)
from ruffini._frames import turned

NAMED = (
    "not-converged",
    "step-too-long",
    "penetrated",
    "inverted",
    "on-walls",
    "unreachable",
    "invalid",
    "network",
)
TOLERANCE = 1e-7
"""Force that the finite elements may leave out of balance, up to 1 MPa (N)."""
DEEPEST = 250 * 2e-6 * 1.001
"""Depth of contact points in a shape that is documented as an error (m)."""
BETWEEN = 0.4e-3 / 3**0.5
"""Farthest that a place of the skin at rest is from contact points 0.4 mm apart (m)."""


UNFELT = DEEPEST + BETWEEN
"""Depth in a body at rest from which a shape is felt (m)."""


def judged(case: dict) -> dict:
    """Outcome of a press: ``verdict``, ``why`` and figures."""
    begun = time.perf_counter()
    try:
        scene = case["answerer"] == "environment"
        found = extreme_scenes.answered(case) if scene else answered(case)
    except ValueError as error:
        found = {"verdict": "refused", "why": "bad input", "text": str(error)[:200]}
    except WrongError as error:
        found = {"verdict": "wrong", "why": str(error)}
    except BaseException as error:
        # A panic of Rust's is no Exception; anything that is no named error belongs in the report.
        kind = "panic" if type(error).__name__ == "PanicException" else "unnamed"
        found = {"verdict": kind, "why": f"{type(error).__name__}: {error}"[:300]}
    return found | {"seconds": time.perf_counter() - begun}


def answered(case: dict) -> dict:
    """The answer to a press, checked.

    Raises:
        ValueError: If the press is refused.
        WrongError: If a check fails.
    """
    # Presses of a pad have that of the press before, mostly.
    model = kept(*((key, case[key]) for key in OF_MODEL if key in case))
    body = model.body
    asked = press(case, body.mesh)
    frames = model.solve_path(asked)
    last = frames[-1]
    for frame in frames:
        if isinstance(frame, Deformation):
            check(case, model, frame)
    if isinstance(last, PressError):
        if last.kind not in NAMED:
            raise WrongError(f"{last.kind}: {last}"[:200])
        return {"verdict": "refused", "why": last.kind, "text": str(last)[:120]}
    if case["kind"] == "force":
        force, asked = -last.wrench[2], case["force"]
        if abs(force - asked) > 2e-3 * asked + allowed(case):
            raise WrongError(f"{force:.3e} N, asked for {asked:.3e} N")
    through = case["kind"] == "through" and not case.get("free")
    if through and not np.abs(last.contact_force).any():
        raise WrongError("went through the body unfelt")
    for frame in frames if case["mesh"] in BROAD and not case.get("free") else ():
        if not np.abs(frame.contact_force).any():
            deep = depth_below(case, body, pose(frame))
            if deep > UNFELT:
                raise WrongError(f"is {deep:.1e} m deep and is not felt")
    return {"verdict": "solved"} | beside(case, model, last)


def depth_below(case: dict, body: SoftBody, pose: Pose) -> float:
    """Depth of a shape below the upper face of a body at rest, if it is above `UNFELT`, else 0.

    In m, in that pose. The lowest point of a long shape may be off the pad, where no face is
    above it.
    """
    form, _ = shape(case)
    place, turn = pose
    if case["shape"] == "plate":
        return float(body.mesh.vertices[:, 2].max() - place[2])
    corners, sides = form.surface()
    weights = np.array([[i, j, 8 - i - j] for i in range(9) for j in range(9 - i)]) / 8
    points = np.einsum("wc,fcx->fwx", weights, (turned(turn, corners) + place)[sides])
    points = np.unique(points.reshape(-1, 3).round(7), axis=0)
    low, high = body.mesh.vertices.min(axis=0), body.mesh.vertices.max(axis=0)
    # Most shapes that are not felt are not below the highest point by that much: no need to look.
    over = points[((low < points) & (points < high - [0, 0, UNFELT])).all(axis=1)]
    return max((face_height(body.mesh, point[:2]) - point[2] for point in over), default=0.0)


OF_BODY = ("mesh", "nodes", "cells", "ratio", "flatness", "young", "poisson", "law", "free")
OF_MODEL = (*OF_BODY, "answerer", "friction", "corrections", "element")
"""Parts of a case from which its model is made."""


@lru_cache(maxsize=1)
def kept(*parts: tuple[str, Any]) -> Fem | Compliance | LinearPad | Surrogate:
    """The model of a case, given as pairs; the last one is kept."""
    return answerer(dict(parts))


def answerer(case: dict) -> Fem | Compliance | LinearPad | Surrogate:
    """The model of a case."""
    if case["answerer"] in OF_PADS:
        chosen = {key: case[key] for key in ("young", "poisson", "friction")}
        model = Surrogate if case["answerer"] == NETWORK else LinearPad
        return model(GELS[case["mesh"]], **chosen)
    if case["answerer"] == "nodes":
        return Compliance(soft_body(case), friction=case["friction"], contact="nodes")
    if case["answerer"] == "compliance":
        return Compliance(
            soft_body(case), friction=case["friction"], corrections=case["corrections"]
        )
    return Fem(soft_body(case), friction=case["friction"], element=case["element"])


def size(vectors: np.ndarray) -> float:
    """Norm of a vector, or of all of them together."""
    return float(np.linalg.norm(vectors))


def check(case: dict, model: Any, frame: Deformation) -> None:
    """Raises `WrongError` where a frame cannot be the answer."""
    body, forces = model.body, frame.contact_force
    fields = (frame.displacement, frame.von_mises, forces, frame.wrench, frame.residual)
    if not all(np.isfinite(field).all() for field in fields):
        raise WrongError("not finite")
    if frame.von_mises.min() < 0.0:
        raise WrongError(f"von Mises stress of {frame.von_mises.min():.2e} Pa")
    total = np.abs(forces).sum()
    # Single precision in the network's forces, double everywhere else.
    least = 1e-6 * total + 1e-12
    if size(forces.sum(axis=0) - frame.wrench[:3]) > least:
        raise WrongError(f"wrench {frame.wrench[:3]}, contact forces {forces.sum(axis=0)}")
    if len(body.fixed) and np.abs(frame.displacement[body.fixed]).max() > 1e-15:
        raise WrongError("held nodes move")
    if case["answerer"] == "fem":
        check_fem(case, body, frame)
    check_pull(case, body, frame, total)
    if case["shape"] == "plate":
        check_plate(case, frame, total)
    if case["kind"] == "buried":
        check_upright(case, frame, total)
    # The finite elements may leave a little force, which bends a thin wall by micrometres.
    exact = case["answerer"] != "fem"
    if total == 0.0 and exact and size(frame.displacement) > 1e-12 * len(forces):
        raise WrongError("moves without contact")
    if total == 0.0 and exact and frame.von_mises.any() and not size(frame.displacement):
        raise WrongError(f"{frame.von_mises.max():.1e} Pa at rest")


def check_fem(case: dict, body: SoftBody, frame: Deformation) -> None:
    """Balance and uninverted elements of the finite elements."""
    if frame.residual > allowed(case) * (1 + 1e-9):
        raise WrongError(f"residual {frame.residual:.2e} N above {allowed(case):.2e} N")
    left = size(frame.wrench[:3]) if case["free"] else 0.0
    if left > allowed(case) * nodes(case, body) ** 0.5:
        raise WrongError(f"{left:.2e} N on a free body")
    if case["law"] == "neo-hookean" and case["element"] == "p1":
        least = volumes(body.mesh, frame.displacement).min()
        if least <= 0.0:
            raise WrongError(f"a tetrahedron of {least:.2e} m³")


def nodes(case: dict, body: SoftBody) -> int:
    """Number of nodes: the vertices, and with quadratic elements the middles of the edges."""
    pairs = [body.mesh.tets[:, [i, j]] for i in range(4) for j in range(i)]
    edges = np.unique(np.sort(np.concatenate(pairs), axis=1), axis=0)
    return len(body.mesh.vertices) + (len(edges) if case["element"] == "p2" else 0)


def allowed(case: dict) -> float:
    """Force that the finite elements may leave out of balance (N)."""
    return TOLERANCE * max(case["young"] / 1e6, 1.0)


LOWERED = ("steps", "at once", "tiny", "afar", "force", "buried")
"""Ways in which a shape only comes down."""
BROAD = ("block", "film", "layers", "mini", "digit")
"""Meshes whose sides no shape is beside."""
PULLING = 1e-3
"""Share of the contact forces that may pull, since a node is not where its contact points are."""


def check_pull(case: dict, body: SoftBody, frame: Deformation, total: float) -> None:
    """Contact pushes, as a whole and, where the forces of nodes are those of contact, at each node.

    Quadratic faces, and those of ``p1-bar``, which compliance has, too, spread a force over their
    nodes with weights of both signs, and networks add forces of their own. Without friction a node
    is pushed along the normal of a ball, unless its faces reach behind the ball, and down by
    whatever comes down.
    """
    least = PULLING * total + 2 * allowed(case)
    comes_down = case["kind"] in LOWERED and case["mesh"] in BROAD and not case.get("free")
    if comes_down and frame.wrench[2] > least:
        raise WrongError(f"contact pulls with {frame.wrench[2]:.2e} N of {total:.2e} N")
    plain = case["answerer"] in ("nodes", "linear") or case.get("element") == "p1"
    if not plain or case["friction"] > 0.0:
        return
    if case["shape"] in ("ball", "large ball", "tip"):
        form, _ = shape(case)
        place, turn = pose(frame)
        moved = body.mesh.vertices + frame.displacement - place
        normals = turned(turn, form.distance(turned(turn * [-1, -1, -1, 1], moved))[1])
        outward = np.einsum("vi,vi->v", normals, frame.contact_force)
        if case["answerer"] != "nodes":  # Whose contact points are the nodes.
            outward[behind(body.mesh, frame, form, moved)] = 0.0
    elif case["kind"] == "buried":
        outward = -frame.contact_force[:, 2]
    else:
        return
    pulled = -outward[outward < 0.0].sum()
    if pulled > least:
        raise WrongError(f"nodes are pulled with {pulled:.2e} N of {total:.2e} N")


def behind(mesh: TetMesh, frame: Deformation, ball: Shape, seen: np.ndarray) -> np.ndarray:
    """Nodes that may bear contact behind the middle of a ball, and are `seen` from there (V).

    A point of a ball of radius r at most h from a node that is d away from its middle is on the
    node's side of the middle if h² ≤ r² + d². The force there may push away from the node if not.
    """
    faces = surface(mesh)
    reach = np.zeros(len(seen))
    longest = edges((mesh.vertices + frame.displacement)[faces]).max(axis=1)
    np.maximum.at(reach, faces, longest[:, None])
    radius = -ball.distance(np.zeros((1, 3)))[0][0]
    return reach**2 > radius**2 + (seen**2).sum(axis=1)


SLIGHT = 1e-9
"""Force aside over Young's modulus that is nothing: that of a tip that hardly touches (m²)."""


def check_upright(case: dict, frame: Deformation, total: float) -> None:
    """An upright shape that begins in the body pushes it down, at least as much as aside."""
    _, turn = pose(frame)
    if abs(turned(turn, np.array([0.0, 0.0, 1.0]))[2]) < 0.999:
        return
    down, sideways = -frame.wrench[2], size(frame.wrench[:2])
    if sideways > down + PULLING * total + 2 * allowed(case) + SLIGHT * case["young"]:
        raise WrongError(f"an upright shape pushes aside with {sideways:.2e} N, down {down:.2e} N")


def check_plate(case: dict, frame: Deformation, total: float) -> None:
    """A plate presses down within the cone of friction, on every node that it touches."""
    normal, sideways = -frame.wrench[2], size(frame.wrench[:2])
    if normal < -1e-6 * total - 1e-9:
        raise WrongError(f"a plate pulls with {-normal:.2e} N")
    if case["answerer"] != NETWORK and sideways > case["friction"] * normal * 1.001 + 1e-9:
        raise WrongError(f"{sideways:.3e} N of friction under {normal:.3e} N")


def check_depth(case: dict, body: SoftBody, frame: Deformation) -> float:
    """Depth of the shape in the skin without contact force, else 0 (m).

    Raises:
        WrongError: If the shape is too deep.
    """
    form, _ = shape(case)
    faces = surface(body.mesh)
    faces = faces[~np.isin(faces, body.fixed).all(axis=1)]
    vertices = body.mesh.vertices
    rest, corners = vertices[faces], (vertices + frame.displacement)[faces]
    weights = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4]])
    weights = np.vstack([weights / weights.sum(axis=1)[:, None], np.full((1, 3), 1 / 3)])
    points = np.einsum("wc,fcx->fwx", weights, corners)
    place, turn = pose(frame)
    seen = turned(turn * [-1, -1, -1, 1], points.reshape(-1, 3) - place)
    depth = -form.distance(seen)[0].reshape(points.shape[:2])
    felt = np.abs(frame.contact_force).sum() > 0.0
    # The bound is for contact points, which lie farther apart where the skin is stretched; depth
    # changes no faster than the place.
    stretch = edges(corners).max(axis=1) / edges(rest).max(axis=1)
    over = depth - DEEPEST - BETWEEN * np.maximum(stretch, 1.0)[:, None]
    # The sides of p2 are curved, too, and its middle nodes are not known here.
    if over.max() > 0.0 and case["element"] != "p2":
        face = int(over.max(axis=1).argmax())
        deep, edge = depth[face].max(), edges(corners)[face].max()
        raise WrongError(f"a shape {deep:.2e} m inside the skin, faces of {edge:.1e} m")
    return 0.0 if felt else max(float(depth.max()), 0.0)


def edges(corners: np.ndarray) -> np.ndarray:
    """Lengths of the edges (F, 3) of faces with those corners (F, 3, 3)."""
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)


def pose(frame: Deformation) -> Pose:
    """Place and turn of the one shape."""
    [(place, turn)] = frame.pose if isinstance(frame.pose, list) else [frame.pose]
    return np.asarray(place), np.asarray(turn)


def beside(case: dict, model: Any, last: Deformation) -> dict:
    """Difference of the answer from one that was found by another method."""
    if case.get("long way") == "lowered":
        return from_above(case, model, last)
    if case["answerer"] == NETWORK:
        return truth(case, model, last) if model.is_in_distribution(last) else {}
    if case["answerer"] != "fem":
        return {}
    found = {"unfelt": check_depth(case, model.body, last)}
    if case["long way"] == "finer":
        return found | finer(case, model, last)
    return found | (stiffer(case, last) if case["long way"] == "stiffer" else {})


def from_above(case: dict, model: Any, last: Deformation) -> dict:
    """Difference of the force at a first pose in the body from that of coming down to it."""
    if case["kind"] != "buried":
        return {}
    down = model.solve_path(lowered(case, model.body.mesh))[-1]
    if isinstance(down, PressError):
        return {"lowered": down.kind}
    return {"lowered": apart(last, down, 1e-10 * case["young"])}


def truth(case: dict, model: Surrogate, last: Deformation) -> dict:
    """Difference of the network's force from that of finite elements along the same path.

    Their mesh is refined towards the nodes that the network says are pressed.
    """
    if case["long way"] != "truth":
        return {}
    felt = np.abs(last.contact_force).any(axis=1)
    around = model.body.mesh.vertices[felt] if felt.any() else None
    pad = ruffini.sensor(GELS[case["mesh"]], resolution=2000, around=around)
    body = SoftBody(pad.mesh, case["young"], case["poisson"], fixed=pad.fixed)
    asked = press(case, model.body.mesh)
    frames = Fem(body, friction=case["friction"]).solve_path(asked)
    if isinstance(frames[-1], PressError):
        return {"truth": frames[-1].kind}
    return {"truth": apart(last, frames[-1])}


def finer(case: dict, model: Fem, last: Deformation) -> dict:
    """The same press in steps a quarter as long: the same force, unless the body can buckle."""
    if case["friction"] > 0.0:
        return {}
    slow = model.solve_path(press(case, model.body.mesh, finer=4))[-1]
    if isinstance(slow, PressError):
        return {"finer": slow.kind}
    return {"finer": apart(last, slow, allowed(case))}


def stiffer(case: dict, last: Deformation) -> dict:
    """A body and a tolerance 16 times as great: the same displacement, to rounding."""
    # A layer may be as soft as bodies come, and the tolerance does not follow a soft body.
    if case["kind"] == "force" or case["mesh"] == "layers" or not 1e6 <= case["young"] <= 1e9 / 16:
        return {}
    other = answerer(case | {"young": 16 * case["young"]})
    again = other.solve_path(press(case, other.body.mesh))[-1]
    if isinstance(again, PressError):
        return {"stiffer": again.kind}
    off = size(again.displacement - last.displacement) / max(size(last.displacement), 1e-300)
    if off > 1e-6:
        raise WrongError(f"a body 16 times as stiff is {off:.1e} off in displacement")
    return {"stiffer": off}


def apart(one: Deformation, other: Deformation, least: float = 1e-6) -> float:
    """Relative difference of two forces, 0 if neither is above `least` (N)."""
    most = max(size(one.wrench[:3]), size(other.wrench[:3]))
    return size(one.wrench[:3] - other.wrench[:3]) / most if most > least else 0.0
