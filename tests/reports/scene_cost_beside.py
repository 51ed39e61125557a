"""What is measured beside the scenes: PPO end to end, and peers by random actions.

What is not installed makes a row that says so.
"""

from __future__ import annotations

import sys
from importlib.metadata import version
from importlib.util import find_spec
from itertools import product
from typing import Any

from kept import ROOT

sys.path.append(str(ROOT / "policies"))
from rollout_speed import CONTROL_STEP, PEERS, peer, random_rollout

LIFT, HOLD = "ruffini/GraspLift-v0", "ruffini/HoldStill-v0"
RUNS: dict[str, tuple[str, dict[str, Any]]] = {
    "GraspLift, rigid": (LIFT, {"tactile": "none"}),
    "GraspLift, network, markers": (LIFT, {}),
    "HoldStill, network, wrench and slip": (HOLD, {}),
}
"""Environments that PPO runs in: an id, and what is not default."""
QUICK = ("GraspLift, network, markers",)
QUICK_ROLLOUT = 32
"""Steps of a rollout of the quick form; else the task's own."""
NEEDED = ("torch", "stable_baselines3", "tqdm")
"""Packages that training needs."""
OURS = {"rigid": {"tactile": "none"}, "network, markers": {"tactile": "surrogate"}}
"""Environments beside the peers."""


def beside(quick: bool) -> dict[str, tuple]:
    """What is measured: a function and its arguments by key."""
    found: dict[str, tuple] = {}
    for name, free in product(QUICK if quick else RUNS, (False, True)):
        key = f"sb3 {name}, free" if free else f"sb3 {name}"
        found[key] = (training, name, free, QUICK_ROLLOUT if quick else None)
    seconds = 0.3 if quick else 3.0
    for name in PEERS:
        found[f"peer {name}"] = (theirs, name, seconds)
    for name, count in product(OURS, (1, 16)):
        found[f"peer ruffini {name}, {count:02}"] = (ours, name, count, seconds)
    return found


def training(name: str, free: bool, steps: int | None) -> dict:
    """Steps a second of PPO end to end, or what it lacks."""
    row = {"run": name, "free": free}
    lacking = [package for package in NEEDED if find_spec(package) is None]
    if lacking:
        return row | {"missing": f"{lacking[0]} is not installed"}
    from scene_cost_training import end_to_end

    return row | end_to_end(*RUNS[name], free, steps) | versions("torch", "stable_baselines3")


def theirs(name: str, seconds: float) -> dict:
    """Steps a second of a peer, or why there are none."""
    found, row = peer(name, seconds), {"envs": name, "control step": PEERS[name].control_step}
    if isinstance(found, str):
        return row | {"missing": found}
    return row | {"rate": found} | versions(*PEERS[name].packages)


def ours(name: str, count: int, seconds: float) -> dict:
    """Steps a second by the same kind of rollout as the peers'."""
    envs = f"ruffini GraspLift, {name}, {count} environment{'s' if count > 1 else ''}"
    rate = random_rollout(count, 1, seconds, **OURS[name])
    return {"envs": envs, "control step": CONTROL_STEP, "rate": rate}


def versions(*packages: str) -> dict:
    """Versions of packages that a row depends on."""
    return {"versions": {package: version(package) for package in packages}}
