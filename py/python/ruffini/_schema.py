"""Rust's description of tasks, channels and settings, and the docstrings that are made of it."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable, Mapping
from typing import Any

from ruffini import _core

SCHEMA: dict[str, Any] = json.loads(_core.schema())
"""Description of all tasks; ``tasks``, ``settings`` that all have, ``channels``, ``endings``."""

SHARED_CHANNELS: list[str] = [channel["name"] for channel in SCHEMA["channels"]]
"""Names of the channels that every environment has."""

TACTILE_CHANNELS: list[str] = [each["name"] for each in SCHEMA["tactile_channels"]]
"""Names of the channels of tactile fingers."""

ENDINGS: list[str] = [ending["name"] for ending in SCHEMA["endings"]]
"""Names of the endings; native gives the place in this list, counted from 1."""

RULES: list[str] = [ending["name"] for ending in SCHEMA["endings"] if ending["is_rule"]]
"""Names of the endings by a rule of the task; the others are failures, which earn no reward."""

TASKS: dict[str, dict[str, Any]] = {task["name"]: task for task in SCHEMA["tasks"]}
"""Description of each task by its name."""

SHAPES: dict[str, dict[str, Any]] = {shape["name"]: shape for shape in SCHEMA["shapes"]}
"""Kinds of shapes: names and examples of their lengths (m), and whether edges can be rounded."""

_OF_TASKS = [channel["name"] for task in TASKS.values() for channel in task["channels"]]
CHANNELS: list[str] = [*SHARED_CHANNELS, *_OF_TASKS, *TACTILE_CHANNELS]
"""Names of all channels: those that every environment has, of tasks, of tactile fingers."""

_TERMS = (term["name"] for task in TASKS.values() for term in task["terms"])
REWARD_TERMS: list[str] = list(dict.fromkeys(_TERMS))
"""Names of the terms of all rewards."""

SHARED: dict[str, dict[str, Any]] = {each["name"]: each for each in SCHEMA["settings"]}
"""Settings that all tasks have."""

_OWN = (each["name"] for task in TASKS.values() for each in task["settings"])
SETTINGS: list[str] = list(dict.fromkeys([*SHARED, *_OWN]))
"""Names of the settings of all tasks."""

DRAWS: list[str] = list(dict.fromkeys(name for task in TASKS.values() for name in task["draws"]))
"""Names of the quantities of the start that a task of one's own may draw."""


def full_id(env_id: Any) -> Any:
    """Id of an environment that may be given by the name of a built-in task, ``GraspLift``."""
    return f"ruffini/{env_id}-v0" if isinstance(env_id, str) and env_id in TASKS else env_id


def control_period(settings: Mapping[str, Any] | None = None) -> float:
    """Time of a step (s) of an environment with these settings, or with none."""
    others = next(iter(TASKS.values()))["others"]
    usual = next(each["default"] for each in others if each["name"] == "physics.control_period")
    return float(((settings or {}).get("physics") or {}).get("control_period", usual))


def specification(task: dict[str, Any]) -> str:
    """Specification of a task with its tables, indented as a docstring is."""
    tables = {
        "{channels}": _channels(_described(task)),
        "{tactile_channels}": _tactile_channels(),
        "{terms}": _terms(task["terms"]),
        "{settings}": _settings(task),
    }
    text: str = task["doc"]
    for mark, table in tables.items():
        text = text.replace(mark, table)
    return textwrap.indent(text, "    ").strip()


def _table(*rows: Iterable[str]) -> str:
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([lines[0], "|" + " --- |" * lines[0].count(" | ") + " --- |", *lines[1:]])


def _described(task: dict[str, Any]) -> list[dict[str, Any]]:
    """Channels in the docstring of a task: of another than the first, its own if it has any."""
    own: list[dict[str, Any]] = task["channels"]
    is_first = task is next(iter(TASKS.values()))
    return own if own and not is_first else [*SCHEMA["channels"], *own]


def _channels(channels: list[dict[str, Any]]) -> str:
    def size(channel: dict[str, Any]) -> str:
        return str(sum(part["size"] for part in channel["components"]))

    rows = ([f"``{each['name']}``", size(each), each["doc"]] for each in channels)
    return _table(["channel", "size", "content"], *rows)


def _tactile_channels() -> str:
    channels = SCHEMA["tactile_channels"]
    rows = ([f"``{each['name']}``", each["size"], each["doc"]] for each in channels)
    return _table(["channel", "size of each pad", "content"], *rows)


def _terms(terms: list[dict[str, Any]]) -> str:
    rows = ([f"``{each['name']}``", str(each["weight"]), each["doc"]] for each in terms)
    name = f'Weighted mean of {len(terms)} terms in [0, 1], each in ``info["reward_terms"]``:'
    return f"{name}\n\n{_table(['term', 'weight', '1 where'], *rows)}"


def _settings(task: dict[str, Any]) -> str:
    """Table of the settings; of another than the first task, of those that differ from its own."""
    first = next(iter(TASKS.values()))
    usual = {each["name"]: each["default"] for each in _all(first)}
    rows = [
        [f"``{each['name']}``", _default(each), _range(each), each["unit"] or "1", each["doc"]]
        for each in _all(task)
        if task is first or usual.get(each["name"]) != each["default"]
    ]
    return _table(["setting", "default", "range", "unit", "meaning"], *rows)


def _all(task: dict[str, Any]) -> list[dict[str, Any]]:
    """Settings of a task, entry by entry where they are mappings of numbers."""
    return [*task["settings"], *task["others"]]


def _default(setting: dict[str, Any]) -> str:
    default = setting["default"]
    if setting.get("kind") == "range":
        return " to ".join(map(_number, sorted(set(default))))
    if isinstance(default, int | float):
        return _number(default)
    if isinstance(default, list) and not isinstance(default[0], str):
        return f"({', '.join(map(_number, default))})"
    if isinstance(default, list):
        return ", ".join(f'``"{name}"``' for name in default)
    if isinstance(default, str):
        return f'``"{default}"``'
    return f"``{json.dumps(default)}``" if default else "none"


def _range(setting: dict[str, Any]) -> str:
    words: str | None = setting.get("range")
    return words or " to ".join(map(_number, setting["bounds"]))


def _number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
