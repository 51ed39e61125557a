"""``ruffini view``: the pads and their stress, in a browser or as a file."""

from __future__ import annotations

import argparse
import contextlib
import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ruffini import Deformation, dataset, objects, sensor, viewing
from ruffini._frames import HOME, turned
from ruffini._schema import control_period
from ruffini._spaces import check_count, check_seed
from ruffini.agents import RUN
from ruffini.commands.policy import HELP, TASK, Chosen, choose
from ruffini.dataset import Body, Dataset, Pad, PressFrame, SoftFrame
from ruffini.evaluation import FIRST_SEED
from ruffini.viewing import Rigid, Skin, Soft, ViewerFrame

_Floats = NDArray[Any]
_SIDES = ("pad on -x", "pad on +x")
_SEEN = ("wrench", "markers", "displacement", "tet_stress", "traction")
"""Channels that are drawn."""
_Values = dict[str, list[float]]
_TURNS = ((0.5, 0.5, 0.5, 0.5), (0.5, -0.5, -0.5, 0.5))
"""Orientations of the pads in the frame of the tool: y along the finger, z out of the gel."""
_ENLARGED = (
    np.array([0.235, 0.03, 0.1, 0.5**0.5, 0, 0, 0.5**0.5]),
    np.array([0.235, 0.03, 0.025, 0.5**0.5, 0, 0, 0.5**0.5]),
)
"""Poses in the picture at which the pads are shown once more, enlarged, faces to the front."""
_SIX = np.array(
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
)
"""Triangles of a box whose corners count up with z, then y, then x."""
_LIGHT, _DARK = (212, 215, 220), (105, 112, 122)
_BOXES = {
    "palm": (_LIGHT, [[-0.07, -0.024, 0.081], [0.07, 0.024, 0.112]]),
    "rail": (_DARK, [[-0.064, -0.0105, 0.074], [0.064, 0.0105, 0.083]]),
}
"""Boxes of the gripper in the frame of the tool: colour, lowest and highest corner (m)."""
_FINGER = {
    "finger": (_DARK, [[-0.0085, -0.0125, -0.017], [0.0085, 0.064, -0.0072]]),
    "holder": (_DARK, [[-0.0112, -0.0135, -0.009], [0.0112, 0.0135, -0.0042]]),
}
"""Those of a finger, in the frame of its pad."""
_TIP = (_DARK, [[-0.010375, -0.012625, -0.0042], [0.010375, 0.012625, 0.0]])
"""Rigid pad, in its frame."""


def add_to(commands: Any) -> None:
    """Add the subcommand to the parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "view",
        help="see in 3-D what fingers feel: a policy at a task, or a dataset",
        description="Shows pads or soft objects with their stress, markers, contact forces, and "
        "curves of reward and channels: in a browser of this machine as they come, or with --out "
        "as one HTML file, which any browser plays without ruffini and offline.",
    )
    parser.add_argument(
        "what", nargs="?", help=f"a task or the folder of a dataset; {TASK} if not given"
    )
    parser.add_argument(
        "frame", nargs="?", type=int, help="number of a frame; all of the first grasp if not given"
    )
    parser.add_argument("--policy", default="trained", help=HELP)
    parser.add_argument(
        "--seed", type=int, default=FIRST_SEED, help=f"the first seed; {FIRST_SEED} if not given"
    )
    parser.add_argument(
        "--episodes", type=int, default=1, help="episodes, one a seed; 1 if not given"
    )
    parser.add_argument("--out", type=Path, help=".html file to write instead")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Show episodes of a policy, or frames of a dataset.

    Raises:
        ValueError: If an option is invalid or viser is missing.
    """
    viewing.check(options.out)
    if options.what is not None and Path(options.what).is_dir():
        if (Path(options.what) / RUN).is_file():
            raise ValueError(
                f"view: found a training run in {options.what}, expected a task or the folder of a "
                f"dataset; --policy {options.what} shows its agent"
            )
        viewing.view([_grasp(dataset.open(options.what), options.frame)], options.out)
        return
    if options.frame is not None:
        raise ValueError(f"dataset: found {options.what}, expected the folder of a dataset")
    check_count("episodes", options.episodes)
    check_seed(options.seed)
    try:
        chosen = choose(options.what, options.policy, {})
    except ValueError as error:
        hint = ", or the folder of a dataset" if str(error).startswith("task") else ""
        raise ValueError(f"{error}{hint}") from None
    print(f"{chosen.env_id}: {chosen.about}", flush=True)
    seeds = range(options.seed, options.seed + options.episodes)
    viewing.view((episode(chosen, seed) for seed in seeds), options.out, table=True)


def episode(chosen: Chosen, seed: int) -> Iterator[ViewerFrame]:
    """Play an episode and show every step; the policy sees what it always sees."""
    with contextlib.closing(gym.make(chosen.env_id, **chosen.settings)) as made:
        plain: Any = made.unwrapped
        names, skin = [name for name, _ in plain.channels()], plain.skin()
        rewards = plain._batch.reward_terms()
    more = [name for name in (_SEEN if skin else _SEEN[:1]) if name not in names]
    settings = chosen.settings | {"observation": names + more, "obs": "dict"}
    env = gym.make(chosen.env_id, **settings)
    observation, _ = env.reset(seed=seed)
    drawn, flat = _Drawn(env.unwrapped, skin, settings), chosen.settings.get("obs") == "flat"
    terms, task = dict.fromkeys(rewards, 0.0), chosen.env_id.split("/")[-1]
    look, over, state, ending = drawn.look(), False, None, ""
    about = f"{task}, seed {seed}: {look['object']} of {1e3 * look['mass']:.0f} g"
    period = control_period(settings)
    for step in itertools.count():
        title = f"{about}, {period * step:.2f} s{ending}"
        bodies, values = drawn.bodies(observation), drawn.values(observation, terms)
        yield ViewerFrame(title, bodies, values, period)
        if over:
            return
        parts = {name: observation[name][None] for name in names}
        seen = np.concatenate(list(parts.values()), axis=1) if flat else parts
        action, state = chosen.policy.predict(seen, state, deterministic=True)
        observation, _, terminated, truncated, info = env.step(action[0])
        terms, over = info["reward_terms"], terminated or truncated
        if over:
            ending = ": success" if info["is_success"] else f": {info.get('ending', 'failure')}"


class _Drawn:
    """Bodies and curves of an environment's present state."""

    def __init__(self, env: Any, skin: dict[str, Any] | None, settings: dict[str, Any]) -> None:
        self._env, self._rest, self._layout = env, skin, env.channels()
        self.look = env.look
        self._surfaces = env.surfaces()
        self._skin = None
        if skin is not None:
            nodes = settings.get("resolution", {}).get("nodes", 1000)
            mesh = sensor(settings.get("sensor", "gelsight-mini"), resolution=nodes).mesh
            self._skin = Skin(mesh)
            gaps = np.linalg.norm(self._skin.rest[:, None] - skin["surface"][None], axis=2)
            # Nodes of the skin that are free to move, in the order of the channel.
            self._free = gaps.argmin(axis=0)

    def bodies(self, observation: dict[str, _Floats]) -> dict[str, Rigid | Soft]:
        """Gripper, object, both pads, and distractors and the fixture if there are any."""
        look = self.look()
        turn = np.array([0, 0, np.sin(look["tool_yaw"] / 2), np.cos(look["tool_yaw"] / 2)])
        tool = np.array([*look["tool_position"], *turn])
        pose = np.array([*look["object_position"], *look["object_quaternion"]])
        found: dict[str, Rigid | Soft] = {name: _box(tool, *box) for name, box in _BOXES.items()}
        vertices, faces, stress = self._surfaces["object"]
        if stress is None:
            found["object"] = Rigid(pose, vertices, faces, opacity=0.4)
        else:
            vertices, faces, stress = self._env.surfaces()["object"]
            found["object"] = Soft(pose, vertices, faces, stress)
        for number, other in enumerate(look.get("distractors", []), 1):
            name = f"distractor_{number}"
            vertices, faces, _ = self._surfaces[name]
            pose = np.array([*other["position"], *other["quaternion"]])
            found[name] = Rigid(pose, vertices, faces, _LIGHT, opacity=0.5)
        if "fixture" in self._surfaces:
            vertices, faces, _ = self._surfaces["fixture"]
            found["fixture"] = Rigid(HOME, vertices, faces, _LIGHT, opacity=0.5)
        for k, name in enumerate(_SIDES):
            side = np.array([(k - 0.5) * look["opening"], 0, 0, *_TURNS[k]])
            pad = _after(tool, side)
            found |= {f"{name}: {part}": _box(pad, *box) for part, box in _FINGER.items()}
            wrench = observation["wrench"].reshape(2, 6)[k]
            if self._skin is None:
                found[f"{name}: tip"] = _box(pad, *_TIP)
            else:
                pressed = self._pad(pad, k, observation, wrench)
                front = replace(pressed, pose=_ENLARGED[k], scale=2.2, forces=None, wrench=None)
                found |= {name: pressed, f"{name}: face": front}
        return found

    def _pad(self, pose: _Floats, k: int, observation: dict[str, _Floats], wrench: _Floats) -> Soft:
        assert self._skin is not None and self._rest is not None
        moved = self._skin.rest.copy()
        moved[self._free] += observation["displacement"].reshape(2, -1, 3)[k]
        stress = self._skin.stress(observation["tet_stress"].reshape(2, -1)[k])
        markers = self._rest["markers"] + observation["markers"].reshape(2, -1, 3)[k]
        cells = self._rest["grid"]
        near = self._rest["surface"][None, :, :2] - cells[:, None]
        # Of all nodes of the surface near a cell, those of the face are the highest.
        far = np.linalg.norm(near, axis=2) - 0.2 * self._rest["surface"][:, 2]
        points = moved[self._free[far.argmin(axis=1)]]
        forces = viewing.traction(points, observation["traction"].reshape(2, -1, 3)[k])
        return Soft(pose, moved, self._skin.faces, stress, markers, forces, wrench)

    def values(self, observation: dict[str, _Floats], terms: dict[str, float]) -> _Values:
        """Curves of the terms of the reward and of all channels but fields."""
        values: _Values = {f"reward: {name}": [value] for name, value in terms.items()}
        if self._skin is not None:
            stress = observation["tet_stress"].reshape(2, -1).max(axis=1)
            values["highest stress of each pad (kPa)"] = list(stress / 1e3)
        for channel, components in self._layout:
            start = 0
            for name, low, _, unit in components:
                part = observation[channel][start : start + len(low)]
                start += len(low)
                if len(low) <= 4:
                    # Names of several numbers end with how many they are.
                    name = name.split(": ")[0]
                    values[f"{name} ({unit})" if unit else name] = part.tolist()
        return values


def _box(pose: _Floats, color: tuple[int, int, int], corners: list[list[float]]) -> Rigid:
    """Box between its lowest and highest corner, in the frame at `pose`."""
    low, high = np.array(corners)
    vertices = np.array(list(itertools.product(*np.stack([low, high], axis=1))))
    return Rigid(pose, vertices, _SIX, color)


def _after(outer: _Floats, inner: _Floats) -> _Floats:
    """Pose in the world of a pose (7,) in the frame at `outer` (7,)."""
    (a, s), (b, t) = (outer[3:6], outer[6]), (inner[3:6], inner[6])
    place = outer[:3] + turned(outer, inner[None, :3])[0]
    return np.array([*place, *(s * b + t * a + np.cross(a, b)), s * t - a @ b])


def _grasp(found: Dataset, frame: int | None) -> Iterator[ViewerFrame]:
    """Frames of the first grasp of a dataset, or the one of that number."""
    if not found.grasps:
        raise ValueError(f"{found.path}: found no solved grasp, expected one or more")
    if frame is None:
        numbers = found.frames(found.grasps[0])
    else:
        if not -len(found) <= frame < len(found):
            raise ValueError(f"frame: found {frame}, expected less than {len(found)}")
        numbers = range(frame, frame + 1)
    for number in numbers:
        yield _solved(found, found[number])


def _solved(found: Dataset, frame: dataset.Frame | SoftFrame | PressFrame) -> ViewerFrame:
    """Bodies of a frame of a dataset."""
    skin, name = Skin(found.mesh(frame.grasp)), frame.grasp.split("/")[0]
    bodies: dict[str, Rigid | Soft] = {}
    if isinstance(frame, SoftFrame):
        bodies["object"] = gel(skin, frame.body)
        for side, finger in zip(_SIDES, frame.fingers, strict=True):
            bodies[side] = _box(finger.pose, *_TIP)
    elif isinstance(frame, PressFrame):
        bodies["pad"] = gel(skin, frame.pad)
    else:
        for side, pad in zip(_SIDES, frame.pads, strict=True):
            bodies[side] = gel(skin, pad, pad.pose)
        known = {thing.name: thing for thing in objects(found.manifest["config"]["seed"])}
        if name in known:
            bodies["object"] = Rigid(frame.object, *known[name].surface(), opacity=0.4)
    return summary(f"{frame.grasp}, frame {frame.number}", bodies)


def gel(skin: Skin, body: Body | Deformation, pose: _Floats = HOME) -> Soft:
    """Soft body as drawn from its solution."""
    moved = skin.rest + np.asarray(body.displacement)[skin.nodes]
    forces = viewing.nodal(moved, np.asarray(body.contact_force)[skin.nodes])
    wrench = body.wrench if isinstance(body, (Pad, Deformation)) else None
    stress = skin.stress(np.asarray(body.von_mises))
    return Soft(pose, moved, skin.faces, stress, None, forces, wrench)


def summary(title: str, bodies: dict[str, Rigid | Soft], seconds: float = 0.5) -> ViewerFrame:
    """Frame of solved bodies, with curves of their forces and stress."""
    gels = {name: body for name, body in bodies.items() if isinstance(body, Soft)}
    peak = [float(body.von_mises.max()) / 1e3 for body in gels.values()]
    values: _Values = {"highest stress at a node (kPa)": peak}
    for name, body in gels.items():
        if body.wrench is not None:
            values[f"force on {name} (N)"] = list(body.wrench[:3])
            values[f"torque on {name} (N m)"] = list(body.wrench[3:])
    return ViewerFrame(title, bodies, values, seconds)
