"""Grasps between two pads, and the catalogue of objects, from Python."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import BALL, RADIUS, UPRIGHT, gel

import ruffini
from ruffini import Deformation, Fem, Grasp, Grasped, PressError, SoftBody

OBJECTS = {thing.name: thing for thing in ruffini.objects()}


def facing(gap: float):
    """Poses of two pads that face each other along x, `gap` between their faces."""
    half = np.sqrt(0.5)
    return ((-gap / 2, 0, 0), (0, half, 0, half)), ((gap / 2, 0, 0), (0, -half, 0, half))


def turned(pose, vectors):
    """`vectors` (…, 3) turned by the quaternion of `pose`."""
    axis, w = np.asarray(pose[1])[:3], pose[1][3]
    cross = np.cross(axis, vectors)
    return vectors + 2 * (w * cross + np.cross(axis, cross))


@pytest.fixture(scope="module")
def pad() -> Fem:
    return Fem(gel(), friction=0.6)


CLOSING = [facing(2 * (RADIUS - depth)) for depth in (1e-4, 2e-4, 3e-4)]


def test_a_ball_comes_to_the_middle_of_the_pads(pad):
    path = [facing(2 * RADIUS + 1e-4), *CLOSING]
    frames = Grasp(BALL, path, start=((3e-5, 0, 0), UPRIGHT)).solve((pad, pad))
    assert [type(frame) for frame in frames] == [Grasped] * 4
    assert frames[0].object[0][0] == 3e-5, "nothing has touched it yet"
    position, quaternion = frames[-1].object
    assert position.shape == (3,) and quaternion.shape == (4,)
    # Balance to 1e-6 N on pads of about 1 N/mm; friction depends a little on the trajectory.
    assert abs(position[0]) < 1e-6, f"{position[0]} m off the middle"
    left, right = frames[-1].pads
    assert type(left) is type(right) is Deformation
    assert left.pose[0][2] == pytest.approx(RADIUS - 3e-4, abs=1e-6)


def test_a_grasp_closed_at_once_ends_where_one_closed_in_steps_does(pad):
    start, forces = ((3e-5, 0, 0), UPRIGHT), []
    for steps in (1, 10):
        path = [facing(2 * (RADIUS - depth)) for depth in np.linspace(-1e-4, 3e-4, steps + 1)]
        frames = Grasp(BALL, path, start).solve((pad, pad))
        assert len(frames) == steps + 1
        forces.append(-frames[-1].pads[0].wrench[2])
    # What sticks, sticks where it first touched, and one step does not see where that was.
    assert forces[0] == pytest.approx(forces[1], rel=2e-3), f"{forces} N"


@pytest.mark.parametrize("load", [None, (0, 0, -0.02, 0, 0, 0), (0, 0, 0, 0, 2e-5, 0)])
def test_what_the_pads_do_to_the_object_cancels_with_the_load(pad, load):
    [*_, last] = Grasp(BALL, CLOSING, load=load).solve((pad, pad))
    force, torque = (np.zeros(6) if load is None else np.asarray(load)).reshape(2, 3)
    grip = 0.0
    for pose, answer in zip(CLOSING[-1], last.pads, strict=True):
        push, turn = turned(pose, answer.wrench[:3]), turned(pose, answer.wrench[3:])
        force = force - push
        torque = torque - turn - np.cross(pose[0] - last.object[0], push)
        grip += np.linalg.norm(push)
    # Ten times the tolerance of a pad, the torque over the size of the ball.
    assert np.linalg.norm(force) < 1e-6 and np.linalg.norm(torque) < 1e-6 * 2 * RADIUS
    assert last.residual < 1e-6 and last.seconds > 0
    assert grip > 0.1, f"{grip} N: nothing is held"


def test_the_softer_of_two_pads_gives_way(pad):
    soft = Fem(gel(young=1e5), friction=0.6)
    [frame] = Grasp(BALL, CLOSING[-1:]).solve((soft, pad))
    assert frame.object[0][0] < -2e-5, f"ball at {frame.object[0]} m"
    [frame] = Grasp(BALL, CLOSING[-1:]).solve((pad, soft))
    assert frame.object[0][0] > 2e-5, f"ball at {frame.object[0]} m"


def test_a_load_that_nothing_holds_is_an_error_in_its_slot(pad):
    path = [facing(3 * RADIUS), CLOSING[0]]
    frames = Grasp(BALL, path, load=(0, 0, -0.02, 0, 0, 0)).solve((pad, pad))
    assert [type(frame) for frame in frames] == [PressError]
    assert frames[0].kind == "not-converged"


def test_the_catalogue_has_its_objects():
    assert len(OBJECTS) == 64
    splits = [thing.split for thing in OBJECTS.values()]
    assert [splits.count(split) for split in ("train", "novel", "soft")] == [49, 14, 1]
    cup = OBJECTS["cup-2"]
    assert (cup.name, cup.family, cup.split) == ("cup-2", "cup", "train")
    other = {thing.name: thing for thing in ruffini.objects(seed=1)}["cup-2"]
    assert cup.seed == ruffini.objects()[list(OBJECTS).index("cup-2")].seed != other.seed


def volume(vertices, faces):
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return np.einsum("ij,ij", a, np.cross(b, c)) / 6


def test_shape_surface_and_tetrahedra_are_one_solid():
    lemon = OBJECTS["lemon-1"]
    vertices, faces = lemon.surface(96)
    distances, _ = lemon.shape.distance(vertices)
    assert np.abs(distances).max() < 1e-9, "vertices lie on the exact surface"
    mesh = lemon.tets(3e-3)
    a, b, c, d = np.moveaxis(mesh.vertices[mesh.tets], 1, 0)
    filled = np.einsum("ij,ij", np.cross(b - a, c - a), d - a) / 6
    # Chords of 3 mm on a radius of 20 mm cut off 1 % of the volume.
    assert filled == pytest.approx(volume(vertices, faces), rel=0.02)


def test_grasps_touch_the_object_from_two_sides():
    potato = OBJECTS["potato-1"]
    grasps = potato.grasps(5, seed=3)
    assert len(grasps) == 5
    for grasp in grasps:
        apexes = np.array([pose[0] for pose in grasp.pads(grasp.width)])
        distances, normals = potato.shape.distance(apexes)
        # The ray ends within the tolerance of sphere tracing.
        assert np.abs(distances).max() < 1e-6, distances
        axis = (apexes[1] - apexes[0]) / grasp.width
        assert np.allclose(apexes.mean(axis=0), grasp.tool[0])
        assert np.allclose(axis, turned(grasp.tool, np.array([1.0, 0, 0])))
        assert normals[1] @ axis == pytest.approx(np.cos(grasp.angle))
        assert grasp.quality == pytest.approx(1 - np.tan(grasp.angle) / 0.5)
        for pose, normal in zip(grasp.pads(grasp.width), [-axis, axis], strict=True):
            assert np.allclose(turned(pose, np.array([0, 0, 1.0])), -normal)
    again = potato.grasps(5, seed=3)
    assert [g.width for g in again] == [g.width for g in grasps]
    narrow = potato.grasps(5, seed=3, friction=0.1)
    assert all(np.tan(grasp.angle) < 0.1 for grasp in narrow)


def test_a_free_body_is_squeezed_between_two_plates():
    mesh = OBJECTS["strawberry-1"].tets(5e-3)
    low, high = mesh.vertices[:, 0].min(), mesh.vertices[:, 0].max()
    plates = [ruffini.Shape.cuboid((2e-3, 0.03, 0.03))] * 2
    pose = [((low - 1.5e-3, 0, 0), UPRIGHT), ((high + 1.5e-3, 0, 0), UPRIGHT)]
    fem = Fem(SoftBody(mesh, 5e4, 0.45), friction=0.5)
    [answer] = fem.solve(ruffini.Press(plates, [pose]))
    force = answer.contact_force[mesh.vertices[:, 0] < 0].sum(axis=0)
    assert force[0] > 0.02, f"{force} N"
    assert np.linalg.norm(answer.wrench[:3]) < 1e-6, f"{answer.wrench} N, N m"
