"""Environments; the docstring of each class is the specification of its task."""

from __future__ import annotations

from ruffini._single import NativeEnv
from ruffini._spaces import Frame, Observation
from ruffini._vector import NativeVectorEnv

__all__ = [
    "Frame",
    "GraspFragileEnv",
    "GraspFragileVectorEnv",
    "GraspLiftEnv",
    "GraspLiftVectorEnv",
    "GraspSoftEnv",
    "GraspSoftVectorEnv",
    "HoldStillEnv",
    "HoldStillVectorEnv",
    "NativeEnv",
    "NativeVectorEnv",
    "Observation",
]


class GraspLiftEnv(NativeEnv):
    """Grasp an object of unknown shape, mass and friction with two fingers, and lift it.

    A parallel-jaw gripper hangs over a table on which one object rests. The agent moves the wrist
    and commands the grip force, 25 times per second.

    ## Action
    ``Box(-1, 1, (5,), float32)``: velocity of the tool centre along the wrist's x (the direction of
    grip), y, z (times 0.25 m/s), yaw rate (times 2 rad/s), grip force of each finger (times 40 N;
    positive closes, negative opens). The grip force follows its command at 100 N/s
    (``gripper={"max_force_rate": ...}``). Components outside [-1, 1] count as the nearer bound; one
    that is not finite is a ``ValueError``.

    ## Observation
    One-level ``Dict`` of the chosen channels, or with ``obs="flat"`` their concatenation in the
    chosen order. ``env.unwrapped.channels()`` lists their components, bounds and units.

    | channel | size | content |
    | --- | --- | --- |
    | ``proprio`` | 14 | tool centre, yaw, their rates, opening and rate, grip command, pad forces |
    | ``object`` | 16 | pose and velocity of the object in the wrist's frame, rise |
    | ``wrench`` | 12 | force and torque on each pad in the pad's frame |
    | ``properties`` | 5 | mass, friction, half of the bounding box |
    | ``time`` | 1 | time since the start of the episode (s) |

    By default ``proprio``, ``object`` and ``markers``. Unless ``tactile="none"`` makes the pads
    rigid, there are also the following channels, first of the pad on −x, then of the one on +x, in
    the pad's frame (x across, y along the finger, z out of the gel), flat; `resolution` sets their
    sizes. Without contact each is exactly 0, except ``depth``. With soft pads, ``wrench`` comes
    from the tactile model.

    | channel | size of each pad | content |
    | --- | --- | --- |
    | ``markers`` | 7 x 5 x 3 | displacement of the sensor's markers (m) |
    | ``displacement`` | S x 3 | displacement of all free nodes of the pad's surface (m) |
    | ``stress`` | 12 x 10 | von Mises stress under the face (Pa) |
    | ``tet_stress`` | T | von Mises stress in each tetrahedron (Pa) |
    | ``traction`` | 12 x 10 x 3 | contact force per area (Pa): shear in x and y, normal in z |
    | ``slip`` | 1 | share of the normal force carried by skin that slides |
    | ``depth`` | 32 x 24 | height of the face over the camera's view (m) |
    | ``trust`` | 3 | unbalanced force (N), its share, 1 if deeper than gels are calibrated |

    ## Reward
    Weighted mean of five terms in [0, 1], each in ``info["reward_terms"]``:

    | term | weight | 1 where |
    | --- | --- | --- |
    | ``reach`` | 0.1 | the tool centre is at the object's middle; 1/4 at 10 cm |
    | ``grasp`` | 0.1 | both pads press with 1 N or more |
    | ``lift`` | 0.5 | the grasped object has risen by ``lift_height`` |
    | ``hold`` | 0.2 | it has been up for ``hold_time`` |
    | ``effort`` | 0.1 | it is lifted without grip force; 0 at the largest, linear between |

    ## Start
    Object, size, mass, friction, position, yaw and the tool centre are drawn from their ranges by
    the environment's seed; the tool centre is 12 to 16 cm over the table (``start_height``).

    ## End
    Truncated after ``max_episode_steps`` steps, 100 by default (with ``gymnasium.make`` its wrapper
    counts the steps, and :meth:`set_state` does not restore the count); a lift does not end the
    episode.
    Terminated, with the reason in ``info["ending"]``, when the object leaves the table
    (``object_lost``), a body's state becomes infinite (``non_finite``) or leaves the declared
    bounds (``out_of_range``), the engine fails (``engine_error``), or the tactile model cannot
    solve a press (``press_failed``, with the kind of the error in ``info["press_error"]``; mostly
    when the hand comes down on the object); the last observation is then the last valid one. If a
    press fails along its path but can be solved at the end of the path from rest, the episode
    continues without the history of friction, and ``info["press_error"]`` has the kind of the
    error. ``info["is_success"]`` is true while the object is lifted and has been for ``hold_time``.

    ## Picture
    With a `tactile` model, pads have their deformed shape and are coloured by von Mises stress.
    While a pad touches, the upper right corner shows its face, seen from the object, beside the
    colour scale: from 0 to 0.3 of Young's modulus, or to the limit of :class:`GraspFragileEnv`.
    Stress for the picture is computed only when a picture is rendered.

    Args:
        render_mode: ``None`` or ``"rgb_array"``.
        obs: ``"dict"`` or ``"flat"``.
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        **settings: Any of: ``objects`` (names, mesh files, ``{"mesh": path, "scale": metres}``, or
            ``{"shape": "sphere", "radius": 0.02}`` and the like), ``mass`` (kg), ``friction``,
            ``size`` (factor), ``position`` and ``start`` (m, for x and y), ``yaw`` (rad),
            ``start_height`` (m), each a range or a number; ``lift_height`` (m), ``hold_time`` (s),
            ``max_episode_steps``, ``observation`` (channels), ``reward_weights``, and mappings for
            ``gripper``, ``workspace`` and ``physics``. Of touch: ``tactile`` (``"surrogate"``,
            the default: a network; ``"surrogate-fine"``: a slower one; ``"compliance"``: linear
            elasticity; ``"fem"``: finite elements; or ``"none"``), ``sensor``
            (``"gelsight-mini"``, ``"digit"`` or a .toml file), ``material`` (name of a calibration
            of the sensor, or ``{"young": Pa, "poisson": ratio}``), ``resolution``
            (``{"nodes": 1000, "markers": (5, 7), "grid": (10, 12), "depth": (24, 32)}``, the pairs
            across and along).

    Raises:
        TypeError: If a setting is unknown.
        ValueError: If one is of the wrong type or out of range.
    """

    TASK = "grasp-lift"


class GraspLiftVectorEnv(NativeVectorEnv):
    """Many :class:`GraspLiftEnv` stepped together by one native call.

    Row i of a batch seeded with s equals the single environment seeded with s + i, bit for bit.
    """

    TASK = "grasp-lift"


class GraspFragileEnv(NativeEnv):
    """Find out by touch how hard to grip an object: enough to lift it, too little to break it.

    World, channels and settings are those of :class:`GraspLiftEnv`, with these differences. The
    fingers start around the object, the hand moves up and down only, and mass and friction vary
    such that the least force that holds an object varies by more than a factor of twenty. The limit
    of the stress in the pads is a little above that of a safe grip of the object at hand, whatever
    its mass, friction and curvature: only touch tells which force is enough and not too much.

    ## Action
    The hand moves at 0.1 m/s at most; its workspace is a line, and it does not turn. The fifth
    number changes the grip force at a relative rate of ``grip_rate`` times the number per second (a
    factor of 1.22 per step at most), between ``least_grip`` and 20 N.

    ## Observation
    By default ``proprio``, ``wrench`` and ``share``; the position of the object is not included.
    Two channels exist in this task only:

    | channel | size | content |
    | --- | --- | --- |
    | ``share`` | 1 | highest von Mises stress in any tetrahedron of both pads, over the limit |
    | ``limit`` | 1 | limit of that stress in this episode (Pa) |

    An agent with touch uses ``share``, or ``stress`` with ``limit``; one without touch uses
    neither.

    ## Reward
    Weighted mean of three terms in [0, 1], each in ``info["reward_terms"]``:

    | term | weight | 1 where |
    | --- | --- | --- |
    | ``grasp`` | 0.1 | both pads press with the trial grip (see Start) or more |
    | ``lift`` | 0.4 | the grasped object has risen by ``lift_height``, 3 cm |
    | ``hold`` | 0.5 | it has been up for ``hold_time`` |

    ## Start
    The object lies in the middle, its narrower side across, half a millimetre from each pad; the
    grip force is ``start_grip``, 0.2 N, which is also the least. Objects weigh 50 to 400 g,
    friction is 0.3 to 1.0, size 0.8 to 1.2. The limit comes from a trial with the same object
    before the start: it hangs in a hand that grips with ``spare`` times the least force that holds
    it, m g / 2 μ; the limit is the highest stress in that trial times a number drawn from
    ``margin``. Every limit can therefore be kept, and none allows an arbitrary grip.

    ## End
    Truncated after ``max_episode_steps`` steps, 60 by default. Also terminated, with
    ``info["ending"]`` ``stress_exceeded`` after the first step that ends with more stress than the
    limit, ``dropped`` when no pad touches the object any more, and ``press_failed`` in the first
    step if the trial could not be solved (``no-trial``).

    Args:
        render_mode: ``None`` or ``"rgb_array"``.
        obs: ``"dict"`` or ``"flat"``.
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        **settings: As for :class:`GraspLiftEnv`, and ``start_grip`` and ``least_grip`` (N),
            ``grip_rate`` (1/s), ``spare``, and ``margin``, a range or a number.
            ``tactile="none"`` is an error; ``yaw``, ``start`` and ``start_height`` have no effect.

    Raises:
        TypeError: If a setting is unknown.
        ValueError: If one is of the wrong type or out of range.
    """

    TASK = "grasp-fragile"


class GraspFragileVectorEnv(NativeVectorEnv):
    """Many :class:`GraspFragileEnv` stepped together by one native call.

    Row i of a batch seeded with s equals the single environment seeded with s + i, bit for bit.
    """

    TASK = "grasp-fragile"


class GraspSoftEnv(NativeEnv):
    """Lift a soft object of unknown stiffness with two rigid fingers, deforming it little.

    World and settings are those of :class:`GraspLiftEnv`, with these differences. The fingers are
    rigid and flat, and start around the object, which is soft; the hand moves up and down only.
    While both fingers touch the object, a graph network (:class:`ruffini.SoftSurrogate`) computes
    its deformation and stress after every step, and the contact force of the simulation is
    corrected towards that of the network. The network includes neither weight nor table: friction
    is computed by the elastic foundation of bristles between fingers and object.

    ## Action
    As of :class:`GraspFragileEnv`: the hand moves at 0.1 m/s at most, and the fifth number changes
    the grip force by a factor of 1.5 per step at most, between ``least_grip`` and 10 N.

    ## Observation
    By default ``proprio``, ``wrench`` and ``squeeze``; position and stiffness of the object are not
    included: the stiffness shows in the relation of force and opening, and in ``squeeze``. Two
    channels exist in this task only; without contact of both fingers they are exactly 0:

    | channel | size | content |
    | --- | --- | --- |
    | ``squeeze`` | 3 | root mean square deformation (m), highest and mean von Mises stress (Pa) |
    | ``deformation`` | 16 x 3 | displacement of markers on the object in the wrist's frame (m) |

    Both exclude the best-fitting rigid motion of the object. There are no tactile channels of soft
    pads.

    ## Reward
    Weighted mean of four terms in [0, 1], each in ``info["reward_terms"]``:

    | term | weight | 1 where |
    | --- | --- | --- |
    | ``touch`` | 0.1 | both fingers touch the object |
    | ``lift`` | 0.3 | the grasped object has risen by ``lift_height``, 3 cm |
    | ``hold`` | 0.4 | it has been up for ``hold_time`` |
    | ``gentle`` | 0.2 | lifted without stress; 0 where it crushes the object, linear between |

    ## Start
    The object lies in the middle, its narrower side across, half a millimetre from each finger;
    the grip force is ``start_grip``, 0.1 N, the least. Young's modulus is drawn from ``young``;
    objects weigh 20 to 60 g and have one size.

    ## End
    Truncated after ``max_episode_steps`` steps, 60 by default. Also terminated, with
    ``info["ending"]`` ``stress_exceeded`` after the first step that ends with more stress somewhere
    in the object than ``crush`` times Young's modulus: it is crushed; and ``dropped`` when no
    finger touches it any more. A squeeze that the network cannot solve ends the episode as
    ``press_failed``.

    ## Picture
    The object has its deformed shape and is coloured by von Mises stress, from 0 to the stress that
    crushes it.

    Args:
        render_mode: ``None`` or ``"rgb_array"``.
        obs: ``"dict"`` or ``"flat"``.
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        **settings: As for :class:`GraspLiftEnv`, and ``young`` (Pa), a range or a number,
            ``poisson``, ``crush`` (stress over Young's modulus), ``start_grip`` and
            ``least_grip`` (N), and ``grip_rate`` (1/s). ``tactile`` is ``"surrogate"`` and ``size``
            1; anything else is an error. ``yaw``, ``start`` and ``start_height`` have no effect.

    Raises:
        TypeError: If a setting is unknown.
        ValueError: If one is of the wrong type or out of range.
    """

    TASK = "grasp-soft"


class GraspSoftVectorEnv(NativeVectorEnv):
    """Many :class:`GraspSoftEnv` stepped together by one native call.

    Row i of a batch seeded with s equals the single environment seeded with s + i, bit for bit.
    """

    TASK = "grasp-soft"


class HoldStillEnv(NativeEnv):
    """Keep a held object from slipping under load and shaking, with the least force.

    World, channels and settings are those of :class:`GraspLiftEnv`, with these differences.
    The object starts between the pads. A downward load and a force that oscillates along one
    direction grow to full size within half a second and act on its centre of mass until the end.
    Friction varies by a factor of eight and is not observed: the least force that holds shows in
    the share of the contact that slides.

    ## Action
    As of :class:`GraspFragileEnv`: the hand moves up and down at 0.1 m/s at most, and the fifth
    number changes the grip by a factor of 1.5 per step at most, between ``least_grip`` and 20 N.

    ## Observation
    By default ``proprio``, ``wrench`` and ``slip``, the last not with rigid pads; position, mass
    and friction of the object, load and shaking are not included.

    ## Reward
    Weighted mean of two terms in [0, 1], each in ``info["reward_terms"]``. Slip is the distance
    that the object has moved in the hand since the start, plus 1 cm per radian of its rotation:

    | term | weight | 1 where |
    | --- | --- | --- |
    | ``still`` | 0.6 | nothing has slipped; 0 at ``slip_limit``, linear between |
    | ``thrift`` | 0.4 | there is no grip force; 0 at twice the grip that success allows |

    ## Start
    The hand, 8 to 12 cm over the table (``start_height``), has gripped the object's middle across
    its narrower side with ``start_grip``, 5 N. Load, and amplitude, direction and frequency of the
    shaking are also drawn. ``friction``, 0.2 to 1.6, is drawn log-uniformly, so that no grip in
    proportion to the load suits more of the range than another.

    ## End
    Truncated after ``max_episode_steps`` steps, 100 by default. Also terminated, with
    ``info["ending"]`` ``dropped``, when no pad touches the object or it has slipped by 2 cm.
    ``info["is_success"]`` is true if both pads press on the object, the slip is within
    ``slip_limit``, and the mean grip since the first second is at most ``thrift`` times F / 2 μ,
    the least grip that holds, by Coulomb's law, against a tangential force F; F is the largest
    resultant of weight, load and shaking. It is never true in the first second.

    Args:
        render_mode: ``None`` or ``"rgb_array"``.
        obs: ``"dict"`` or ``"flat"``.
        width: Width of a picture in pixels.
        height: Height of a picture in pixels.
        **settings: As for :class:`GraspLiftEnv`, and ``start_grip`` and ``least_grip`` (N),
            ``grip_rate`` (1/s), ``slip_limit`` (m), ``thrift``, and ``load`` (N), ``shaking``
            (amplitude, N), ``shaking_frequency`` (Hz), each a range or a number. ``yaw`` and
            ``start`` have no effect.

    Raises:
        TypeError: If a setting is unknown.
        ValueError: If one is of the wrong type or out of range.
    """

    TASK = "hold-still"


class HoldStillVectorEnv(NativeVectorEnv):
    """Many :class:`HoldStillEnv` stepped together by one native call.

    Row i of a batch seeded with s equals the single environment seeded with s + i, bit for bit.
    """

    TASK = "hold-still"
