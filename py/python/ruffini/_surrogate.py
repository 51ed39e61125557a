"""The network of pads, and the warning that a gel is unlike those that it learnt from."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from ruffini import _core
from ruffini._core import Deformation, Press, PressError, SoftBody

SHIPPED: dict[str, Any] = {"sensors": ["digit", "gelsight-mini"], "poisson": [0.3, 0.499]}
"""Gels that the shipped network was trained on, as ``data`` of its card has them."""

_LENGTHS = ("thickness", "width", "length", "radius_across", "radius_along")
"""Entries of a sensor's outline that are compared."""
_MEASURED = (
    "On four other pads, 3 to 5 mm thick, its median errors were 4.5 % in displacement, 7.9 % in "
    "stress and 2.1 % in force (py/docs/sensor.md); elsewhere they are unknown"
)


class OutsideTrainingWarning(UserWarning):
    """A network of pads is asked about a gel unlike those that it was trained on."""


class Surrogate:
    """Graph network that corrects a linear solution, to approximate finer finite elements quickly.

    The linear elastic solution is computed first, as by `LinearPad`, with contact on cells of 1.3
    to 0.04 mm; the network adds the effect of large strain, on the mesh of `body`. It was trained
    on indenters of 0.5 to 40 mm. Without contact the correction is exactly zero.

    An `OutsideTrainingWarning` tells of a pad whose thickness, sides or radii, or of a gel whose
    Poisson's ratio, is not between those that the network was trained on. Young's modulus only
    scales its answers.

    Args:
        sensor: Name of a sensor, or the path of its .toml file.
        calibration: Name of the material; the first of the sensor if not given.
        young: Young's modulus (Pa), in place of the calibration's.
        poisson: Poisson's ratio, in place of the calibration's.
        friction: Coefficient of friction; the sensor's at rest if not given.

    Raises:
        ValueError: If a name is not known, or the network does not fit the sensor's pad.
    """

    _model: _core.Surrogate

    def __init__(
        self,
        sensor: str = "gelsight-mini",
        calibration: str | None = None,
        young: float | None = None,
        poisson: float | None = None,
        friction: float | None = None,
    ) -> None:
        self._model = _core.Surrogate(sensor, calibration, young, poisson, friction)
        _warn(SHIPPED, sensor, calibration, poisson)

    @classmethod
    def load(
        cls,
        path: str | PathLike[str],
        sensor: str = "gelsight-mini",
        calibration: str | None = None,
        young: float | None = None,
        poisson: float | None = None,
        friction: float | None = None,
    ) -> Surrogate:
        """Load a network of one's own, from weights written by ``ruffini network train``.

        Args:
            path: The .safetensors file.
            sensor: As for `Surrogate`, like all that follow.
            calibration: See there.
            young: See there.
            poisson: See there.
            friction: See there.

        Raises:
            ValueError: If the file is missing, damaged or of another kind of network.
        """
        model = _core.Surrogate.load(path, sensor, calibration, young, poisson, friction)
        _warn(json.loads(model.card)["data"], sensor, calibration, poisson)
        return cls._of(model)

    @classmethod
    def _of(cls, model: _core.Surrogate) -> Surrogate:
        made = cls.__new__(cls)
        made._model = model
        return made

    def plain(self) -> Surrogate:
        """Return the network evaluated by Candle's layers, the reference for the fast code.

        It is slower, with the same solutions up to rounding.
        """
        return self._of(self._model.plain())

    @property
    def body(self) -> SoftBody:
        """Body, with mesh and material, to which solutions refer."""
        return self._model.body

    @property
    def card(self) -> str:
        """Description of the weights as JSON: form, training, data, errors on unseen data."""
        return self._model.card

    def solve(self, presses: Press | Sequence[Press]) -> list[Deformation | PressError]:
        """Solve each press and return its last frame, as `Fem.solve`.

        Args:
            presses: A list of `Press`, or one.

        Returns:
            A list with a `Deformation` for each press, or a `PressError` with the reason if it is
            not solved. ``residual`` is the residual force with the elements of `body`'s own coarse
            mesh; it is not zero even for the exact solution.
        """
        return self._model.solve(presses)

    def solve_path(self, press: Press) -> list[Deformation | PressError]:
        """Solve every frame of one press, in order, as `Fem.solve_path`.

        Returns:
            A list with a `Deformation` for each frame. It ends early with a `PressError` at the
            first frame that is not solved.
        """
        return self._model.solve_path(press)

    def knows(self, answer: Deformation) -> bool:
        """Return whether a solution of this network is like its training data.

        Poisson's ratio and friction must lie within those of the data, displacement, net force and
        number of force-bearing nodes within the bounds of most of the data (``usual`` in the card),
        and the residual may be at most half of the net force. Without contact force, the skin must
        not overlap a shape. A solution with a smaller force or fewer nodes than usual may still be
        accurate.
        """
        return self._model.knows(answer)


def unlike(
    trained: Mapping[str, Any],
    sensor: str,
    calibration: str | None = None,
    poisson: float | None = None,
) -> list[str]:
    """What of a gel is not between those that a network was trained on, in words.

    Args:
        trained: ``sensors`` and ``poisson`` of the training data.
        sensor: Name of the sensor, or its file.
        calibration: Name of its material; the first if not given.
        poisson: Poisson's ratio in place of the calibration's.
    """

    def read(name: str) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(_core.read_sensor(name))
        return found

    found, known = read(sensor), [read(name)["outline"] for name in trained["sensors"]]
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
    trained, material = SHIPPED, given.get("material")
    if "network" in given:
        card = _core.read_tensors(Path(given["network"]).read_bytes())[1]
        trained = json.loads(card)["data"]
    calibration, poisson = (
        (None, material["poisson"]) if isinstance(material, Mapping) else (material, None)
    )
    sensor = os.fspath(given.get("sensor", "gelsight-mini"))
    _warn(trained, sensor, calibration, poisson, stacklevel=5)


def _warn(
    trained: Mapping[str, Any],
    sensor: str,
    calibration: str | None,
    poisson: float | None,
    stacklevel: int = 3,
) -> None:
    """Warn if the gel is unlike those that the network was trained on."""
    if words := unlike(trained, sensor, calibration, poisson):
        is_measured = trained is SHIPPED and not words[0].startswith("Poisson")
        measured = _MEASURED if is_measured else "Its errors there are unknown"
        warnings.warn(
            f"{sensor}: found {', '.join(words)}; in brackets what the network was trained on. "
            f"{measured}, and predicted_error does not look at the pad's shape. Compare with Fem "
            'on the same press, or in an environment with tactile="fem".',
            OutsideTrainingWarning,
            stacklevel=stacklevel,
        )
