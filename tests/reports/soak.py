"""A million steps over all tasks and models of touch: makes soak.json and soak.md.

    python tests/reports/soak.py            a quarter of an hour; goes on after a stop
    python tests/reports/soak.py --quick    ten thousand steps, into target/reports/quick

Half of the environments act at random; the others play the scripted policy under random pushes, so
that fingers meet objects in every clumsy way. Checked at every step: observations finite and within
their space, rewards in [0, 1], endings and errors named. At the end of each part a snapshot is
taken and played twice, bit for bit.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from typing import Any

import gymnasium as gym
import numpy as np
from kept import KEPT, Rows, arguments, folder, header, made, table
from numpy.typing import NDArray
from scene_cost import resident

from ruffini.evaluation import Policy
from ruffini.policies import part, scripted

MADE_OF = ["env-core", "py/src", "tests/reports/soak.py", "py/python/ruffini/policies"]
COUNT = 32
"""Environments of a part; a quick one has a quarter."""
REPLAYED = 20
"""Steps that are played twice."""
EVERYTHING = ["proprio", "object", "markers", "stress", "traction", "wrench", "slip", "depth"]
EVERYTHING += ["displacement", "trust"]
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


class Still:
    """Leaves the hand as it is: without touch nothing tells a hand that holds what to do."""

    def predict(self, observation: dict[str, NDArray[np.float32]], *_: Any) -> tuple:
        """No motion."""
        return np.zeros((len(observation["proprio"]), 5), np.float32), None


class Clumsy:
    """Random actions for the first half of the rows, pushed scripted ones for the others."""

    def __init__(self, policy: Policy, rows: int, seed: int):
        self._policy = policy
        self._random = np.random.default_rng(seed)
        self._push = np.zeros((rows, 5))

    def __call__(self, observation: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
        random, rows = self._random, len(self._push)
        action, _ = self._policy.predict(observation)
        pushed = random.random((rows, 1)) < 0.6
        push = random.normal(0.0, 0.5, (rows, 5)) * pushed
        self._push = np.where(random.random((rows, 1)) < 0.05, push, self._push)
        action = action + self._push + random.normal(0.0, 0.25, (rows, 5))
        action[: rows // 2] = random.uniform(-1.0, 1.0, (rows // 2, 5))
        return np.clip(action, -1.0, 1.0).astype(np.float32)


def soaked(name: str, steps: int, count: int) -> dict[str, Any]:
    """What happened in a part of `count` environments.

    Raises:
        ValueError: If a check fails.
    """
    task, _, settings = PARTS[name]
    envs = gym.make_vec(f"ruffini/{task}-v0", num_envs=count, **settings)
    observation, _ = envs.reset(seed=0)
    needs_touch = task == "HoldStill" and "slip" not in observation
    policy = Still() if needs_touch else scripted(f"ruffini/{task}-v0")
    act = Clumsy(policy, count, seed=len(name))
    endings, errors, touched = Counter(), Counter(), 0
    episodes, warm, before, begun = 0, steps // 10, 0.0, time.perf_counter()
    for taken in range(0, steps, count):
        if taken <= warm < taken + count:
            before = resident()
        observation, ended, info = stepped(envs, act(observation), name)
        forces = part(observation, "proprio", "normal force of each pad")
        touched += int((forces > 0).any(axis=1).sum())
        episodes += int(ended.sum())
        endings.update(kind for kind in info.get("ending", []) if kind)
        errors.update(kind for kind in info.get("press_error", []) if kind)
    spent, after = time.perf_counter() - begun, resident()
    replay(envs, act, observation, name)
    return {
        "steps": taken + count,
        "touching": touched / (taken + count),
        "episodes": episodes,
        "endings": dict(endings),
        "press errors": dict(errors),
        "MiB gained": after - before,
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


def replay(envs: gym.vector.VectorEnv, act: Clumsy, observation: Any, name: str) -> None:
    """Plays the same actions twice from a snapshot."""
    native: Any = envs.unwrapped
    snapshot, actions, seen = native.state(), [], []
    for _ in range(REPLAYED):
        actions.append(act(observation))
        observation, *_ = envs.step(actions[-1])
        seen.append(observation)
    native.set_state(snapshot)
    for action, first in zip(actions, seen, strict=True):
        again, *_ = envs.step(action)
        if any((again[key] != first[key]).any() for key in first):
            raise ValueError(f"{name}: a snapshot did not replay bit for bit")


def markdown(report: dict[str, Any]) -> str:
    """The page."""
    total = sum(row["steps"] for row in report["rows"])
    head = ["part", "steps", "touching", "episodes", "ended early", "press errors"]
    return "\n".join(
        [
            "# A million clumsy steps",
            "",
            made(report),
            "",
            f"{total:,} steps. No observation was infinite or outside its space, no reward outside "
            "[0, 1], no ending without a name, no panic and no hang, and every part replayed from "
            "a snapshot bit for bit: the run stops at the first that is not so. Of the press "
            "errors, those beyond `press_failed` are contacts that were taken up anew.",
            "",
            table([*head, "MiB gained", "steps/s"], [line(row) for row in report["rows"]]),
            "",
        ]
    )


def line(row: dict[str, Any]) -> list[str]:
    """A row of the page's table."""
    endings, errors = (
        ", ".join(f"{kind} {n:,}" for kind, n in sorted(row[name].items())) or "none"
        for name in ("endings", "press errors")
    )
    counts = [f"{row['steps']:,}", f"{row['touching']:.0%}", f"{row['episodes']:,}"]
    return [
        row["key"],
        *counts,
        endings,
        errors,
        f"{row['MiB gained']:+.1f}",
        f"{row['steps/s']:,.0f}",
    ]


def main() -> None:
    """Parses the command line and makes the report."""
    parser = arguments(__doc__)
    options = parser.parse_args()
    out = folder(parser, options)
    share, count = (0.01, COUNT // 4) if options.quick else (1.0, COUNT)
    sizes = {"environments": count, "steps": int(share * sum(p[1] for p in PARTS.values()))}
    about = header(MADE_OF, sizes) | {"note": options.note}
    rows = Rows(KEPT / ("soak-quick.jsonl" if options.quick else "soak.jsonl"), about)
    for name, (_, steps, _) in PARTS.items():
        if name not in rows:
            print(name, flush=True)
            rows.add({"key": name} | soaked(name, max(int(share * steps), 4 * count), count))
    report = about | {"rows": list(rows)}
    (out / "soak.json").write_text(json.dumps(report, indent=1) + "\n")
    (out / "soak.md").write_text(markdown(report))
    print(f"{out}/soak.json, soak.md")


if __name__ == "__main__":
    main()
