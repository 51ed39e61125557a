"""A million steps over all tasks but InsertPeg, a quarter of an hour; --quick ten thousand.

Half of the environments act at random; the others play the scripted policy under random pushes, so
that fingers meet objects in every clumsy way. Checked at every step: observations finite and within
their space, rewards in [0, 1], endings and errors named. At the end of each part a snapshot is
taken and played twice, bit for bit.
"""

from __future__ import annotations

import time
from argparse import Namespace
from collections import Counter
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from engine import Rows, made, run, table, text
from ruffini.evaluation import Policy
from ruffini.policies import part, scripted
from timing import resident_bytes

MADE_OF = ["env-core", "py/src", "py/reports/soak.py", "py/python/ruffini/policies"]
COUNT = 32
"""Environments of a part; a quick one has a quarter."""
REPLAYED = 20
"""Steps that are played twice."""
EVERYTHING = ["proprio", "object", "markers", "stress", "traction", "wrench", "slip", "depth"]
EVERYTHING += ["displacement", "predicted_error"]
PARTS: dict[str, tuple[str, int, dict[str, Any]]] = {
    "lift, rigid": ("GraspLift", 410_000, {"tactile": "none"}),
    "lift, network": ("GraspLift", 150_000, {}),
    "lift, network, all channels": ("GraspLift", 25_000, {"observation": EVERYTHING}),
    "fragile, network": ("GraspFragile", 60_000, {}),
    "soft object": ("GraspSoft", 1_000, {}),
    "hold, rigid": ("HoldStill", 250_000, {"tactile": "none"}),
    "hold, network": ("HoldStill", 100_000, {}),
    "hold, linear": ("HoldStill", 3_000, {"tactile": "compliance"}),
    "hold, fem": ("HoldStill", 500, {"tactile": "fem"}),
}
"""Task, steps and settings of each part."""


def make(options: Namespace) -> dict[str, Any]:
    """One part after the other, in this process."""
    share, count = (0.005, COUNT // 8) if options.quick else (1.0, COUNT)
    sizes = {"environments": count, "steps": int(share * sum(p[1] for p in PARTS.values()))}
    rows = Rows.of("soak", options, MADE_OF, sizes)
    steps = {name: max(int(share * part[1]), 4 * count) for name, part in PARTS.items()}
    run(rows, {name: (soaked, name, steps[name], count) for name in PARTS})
    return rows.header | {"note": options.note, "rows": list(rows)}


class Clumsy:
    """Random actions for the first half of the rows, pushed scripted ones for the others.

    Without a policy the hand is left as it is but for the pushes: without touch nothing tells a
    hand that holds what to do.
    """

    def __init__(self, policy: Policy | None, rows: int, seed: int):
        self._policy = policy
        self._random = np.random.default_rng(seed)
        self._push = np.zeros((rows, 5))
        self._state: Any = None
        self._over = np.zeros(rows, bool)

    def __call__(
        self, observation: dict[str, NDArray[np.float32]], over: NDArray[np.bool_]
    ) -> NDArray[np.float32]:
        """The next actions, after a step in which the episodes of some rows were `over`."""
        random, rows = self._random, len(self._push)
        action: Any = 0.0
        if self._policy is not None:
            action, self._state = self._policy.predict(observation, self._state, self._over)
        self._over = over  # The step after an episode's last one begins the next.
        pushed = random.random((rows, 1)) < 0.6
        push = random.normal(0.0, 0.5, (rows, 5)) * pushed
        self._push = np.where(random.random((rows, 1)) < 0.05, push, self._push)
        action = action + self._push + random.normal(0.0, 0.25, (rows, 5))
        action[: rows // 2] = random.uniform(-1.0, 1.0, (rows // 2, 5))
        return np.clip(action, -1.0, 1.0).astype(np.float32)


def soaked(name: str, steps: int, count: int) -> dict[str, Any]:
    """Results of a part of `count` environments.

    Raises:
        ValueError: If a check fails.
    """
    task, _, settings = PARTS[name]
    envs = gym.make_vec(f"ruffini/{task}-v0", num_envs=count, **settings)
    observation, _ = envs.reset(seed=0)
    blind = task == "HoldStill" and "slip" not in observation
    act = Clumsy(None if blind else scripted(f"ruffini/{task}-v0"), count, seed=len(name))
    endings, errors, touched = Counter(), Counter(), 0
    episodes, warm, before, begun = 0, steps // 10, 0.0, time.perf_counter()
    ended = np.zeros(count, bool)
    for taken in range(0, steps, count):
        if taken <= warm < taken + count:
            before = resident_bytes()
        observation, ended, info = stepped(envs, act(observation, ended), name)
        forces = part(observation, "proprio", "normal force of each pad")
        touched += int((forces > 0).any(axis=1).sum())
        episodes += int(ended.sum())
        endings.update(kind for kind in info.get("ending", []) if kind)
        errors.update(kind for kind in info.get("press_error", []) if kind)
    spent, after = time.perf_counter() - begun, resident_bytes()
    replay(envs, act, observation, ended, name)
    return {
        "steps": taken + count,
        "touching": touched / (taken + count),
        "episodes": episodes,
        "endings": dict(endings),
        "press errors": dict(errors),
        "MiB gained": (after - before) / 2**20,
        "steps/s": (taken + count) / spent,
    }


def stepped(envs: gym.vector.VectorEnv, action: NDArray[np.float32], name: str) -> tuple:
    """Observation, ended rows and info of a step, checked."""
    observation, reward, terminated, truncated, info = envs.step(action)
    if not all(np.isfinite(values).all() for values in observation.values()):
        raise ValueError(f"{name}: an observation is not finite")
    if not envs.observation_space.contains(observation):
        raise ValueError(f"{name}: an observation is outside its space")
    if not ((reward >= 0.0) & (reward <= 1.0)).all():
        raise ValueError(f"{name}: a reward is outside [0, 1]")
    named = np.array([kind is not None for kind in info.get("ending", [None] * len(reward))])
    if (terminated != named).any():
        raise ValueError(f"{name}: an episode ended without a name")
    return observation, terminated | truncated, info


def replay(
    envs: gym.vector.VectorEnv, act: Clumsy, observation: Any, ended: Any, name: str
) -> None:
    """Plays the same actions twice from a snapshot."""
    native: Any = envs.unwrapped
    snapshot, actions, seen = native.state(), [], []
    for _ in range(REPLAYED):
        actions.append(act(observation, ended))
        observation, _, terminated, truncated, _ = envs.step(actions[-1])
        ended = terminated | truncated
        seen.append(observation)
    native.set_state(snapshot)
    for action, first in zip(actions, seen, strict=True):
        again, *_ = envs.step(action)
        if any((again[key] != first[key]).any() for key in first):
            raise ValueError(f"{name}: a snapshot did not replay bit for bit")


PAGE = """# A million clumsy steps

Half of the environments act at random, the others play the scripted policy under random pushes, so
that fingers meet objects in every clumsy way: all tasks but InsertPeg, all models of touch.

{made}

{total:,} steps, {rigid:,} of them with rigid pads, {network:,} with the network of pads and
{others:,} with other models. No observation was infinite or outside its space, no reward outside
[0, 1], no ending without a name, no panic and no hang, and every part replayed from a snapshot bit
for bit: the run stops at the first that is not so. A press error either ends its episode
(`press_failed`), or the contact is solved from rest and the episode goes on. Memory is what a part
adds to the process.

{parts}"""


def page(report: dict[str, Any]) -> str:
    """A row a part."""

    def counted(name: str):
        return lambda row: ", ".join(f"{k} {n:,}" for k, n in sorted(row[name].items())) or "none"

    columns = {
        "part": "{key}",
        "steps": "{steps:,}",
        "touching": "{touching:100*.0f} %",
        "episodes": "{episodes:,}",
        "ended early": counted("endings"),
        "press errors": counted("press errors"),
        "MiB gained": "{MiB gained:+.1f}",
        "steps/s": "{steps/s:,.0f}",
    }
    steps = {row["key"]: row["steps"] for row in report["rows"]}
    rigid, network = (
        sum(count for name, count in steps.items() if kind in name) for kind in ("rigid", "network")
    )
    total = {"total": sum(steps.values()), "rigid": rigid, "network": network}
    total["others"] = total["total"] - rigid - network
    return text(PAGE, report | total, made=made(report), parts=table(columns, report["rows"]))
