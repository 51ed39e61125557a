"""The warning that a gel is unlike those that its network was trained on."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ruffini import _core

SHIPPED: dict[str, Any] = {"sensors": ["digit", "gelsight-mini"], "poisson": [0.3, 0.499]}
"""Gels that the shipped network was trained on, as ``data`` of its card has them."""

_LENGTHS = ("thickness", "width", "length", "radius_across", "radius_along")
"""Entries of a sensor's outline that are compared."""
_MEASURED = (
    "On six other pads, 3 to 5 mm thick, its median errors were 3.3 % in displacement, 5.3 % in "
    "stress and 1.4 % in force (py/docs/sensor.md); elsewhere they are unknown"
)


class OutsideTrainingWarning(UserWarning):
    """A network of pads is asked about a gel unlike those that it was trained on."""


def unlike(
    trained: Mapping[str, Any],
    sensor: str,
    calibration: str | None = None,
    poisson: float | None = None,
) -> list[str]:
    """Properties of a gel outside of those that a network was trained on, in words.

    Args:
        trained: ``sensors`` and ``poisson`` of the training data, and ``definitions``, the texts of
            the files of those sensors that are not built in.
        sensor: Name of the sensor, or its file.
        calibration: Name of its material; the first if not given.
        poisson: Poisson's ratio in place of the calibration's.
    """

    def read(name: str, text: str | None = None) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(_core.read_sensor(name, text))
        return found

    files = trained.get("definitions", {})
    found = read(sensor)
    known = [read(name, files.get(name))["outline"] for name in trained["sensors"]]
    words = []
    for entry in _LENGTHS:
        # A straight line has no radius.
        length, *lengths = (
            float("inf") if outline[entry] is None else outline[entry]
            for outline in (found["outline"], *known)
        )
        low, high = min(lengths), max(lengths)
        if not low <= length <= high:
            name = entry.replace("_", " ")
            words.append(f"{name} {1e3 * length:.4g} mm ({1e3 * low:.4g} to {1e3 * high:.4g} mm)")
    if poisson is None:
        materials = found["calibration"]
        poisson = next(
            (each["poisson"] for each in materials if each["name"] == calibration),
            materials[0]["poisson"],
        )
    low, high = trained["poisson"]
    if not low <= poisson <= high:
        words.append(f"Poisson's ratio {poisson:g} ({low:g} to {high:g})")
    return words


def warn_of(settings: Mapping[str, Any]) -> None:
    """Warn of the settings of an environment whose network of pads was trained on other gels."""
    given = {name: value for name, value in settings.items() if value is not None}
    if given.get("tactile", "surrogate") != "surrogate":
        return
    card, material = None, given.get("material")
    if "network" in given:
        card = _core.read_tensors(Path(given["network"]).read_bytes())[1]
    calibration, poisson = (
        (None, material["poisson"]) if isinstance(material, Mapping) else (material, None)
    )
    sensor = os.fspath(given.get("sensor", "gelsight-mini"))
    warn(card, sensor, calibration, poisson, depth=4)


def warn(
    card: str | None, sensor: str, calibration: str | None, poisson: float | None, depth: int = 1
) -> None:
    """Warn if a gel is unlike those that a network was trained on.

    Args:
        card: Card of the network as JSON; that of the shipped one if not given.
        sensor: Name of the sensor, or its file.
        calibration: Name of its material; the first if not given.
        poisson: Poisson's ratio in place of the calibration's.
        depth: Number of callers between this function and who is warned.
    """
    trained = SHIPPED if card is None else json.loads(card)["data"]
    if words := unlike(trained, sensor, calibration, poisson):
        is_measured = card is None and not words[0].startswith("Poisson")
        measured = _MEASURED if is_measured else "Its errors there are unknown"
        warnings.warn(
            f"{sensor}: found {', '.join(words)}; in brackets what the network was trained on. "
            f"{measured}, and predicted_error does not look at the pad's shape. Compare with Fem "
            'on the same press, or in an environment with tactile="fem".',
            OutsideTrainingWarning,
            stacklevel=depth + 1,
        )
