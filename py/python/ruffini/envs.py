"""Environments: for each task that the Rust crate lists, a single and a vector environment.

The docstring of each single environment is the specification of its task; it is made of what the
task's file in Rust says.
"""

from __future__ import annotations

from ruffini._single import NativeEnv
from ruffini._spaces import Observation, RenderFrame
from ruffini._vector import NativeVectorEnv

__all__ = [
    "GraspFragileEnv",
    "GraspFragileVectorEnv",
    "GraspLiftEnv",
    "GraspLiftVectorEnv",
    "GraspSoftEnv",
    "GraspSoftVectorEnv",
    "HoldStillEnv",
    "HoldStillVectorEnv",
    "InsertPegEnv",
    "InsertPegVectorEnv",
    "NativeEnv",
    "NativeVectorEnv",
    "Observation",
    "RenderFrame",
]


class GraspLiftEnv(NativeEnv, task="GraspLift"): ...


class GraspLiftVectorEnv(NativeVectorEnv, task="GraspLift"): ...


class GraspFragileEnv(NativeEnv, task="GraspFragile"): ...


class GraspFragileVectorEnv(NativeVectorEnv, task="GraspFragile"): ...


class GraspSoftEnv(NativeEnv, task="GraspSoft"): ...


class GraspSoftVectorEnv(NativeVectorEnv, task="GraspSoft"): ...


class HoldStillEnv(NativeEnv, task="HoldStill"): ...


class HoldStillVectorEnv(NativeVectorEnv, task="HoldStill"): ...


class InsertPegEnv(NativeEnv, task="InsertPeg"): ...


class InsertPegVectorEnv(NativeVectorEnv, task="InsertPeg"): ...
