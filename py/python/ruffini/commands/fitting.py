"""A gel's material from measured forces of an indenter by depth.

In quasi-statics the force F of a rigid indenter on a gel of Young's modulus E is E times a function
of the geometry, Poisson's ratio and Coulomb's coefficient. So finite elements are solved once, for
one E, on a grid of what else is fitted (`Table`), and the fit interpolates: by cubic splines
through (F/E)^(2/3), which under a ball is nearly straight in depth. What holds the gel and the
indenter may yield, as a spring of stiffness k in series: of a measured way w the gel takes d, and
d + F(d)/k = w.

The fit minimises the squares of errors relative to F + 2 % of the curve's largest force. Its
intervals are those of the profile likelihood with unknown noise: a value lies inside if the sum of
squares, all else fitted anew, is at most S (1 + t²/(N − P)), where S is the least sum and t
Student's quantile of N − P degrees of freedom. ``python py/reports reality`` counts how often they
hold the truth.

Shapes: D depths of a curve, N points of all curves, P parameters. SI units.
"""

from __future__ import annotations

import csv
import itertools
import json
import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ruffini
from ruffini import Fem, Press, PressError, Shape, SoftBody
from ruffini._core import read_sensor
from ruffini.commands.press import touching_height

_Array = NDArray[np.float64]

RANGES = {
    "young": (1e4, 1e7),
    "poisson": (0.3, 0.495),
    "friction": (0.0, 2.0),
    "thickness": (0.8, 1.25),
    "offset": (-3e-4, 3e-4),
    "stiffness": (1e3, 1e8),
}
"""Range of a parameter: Pa; 1; 1; times that of the sensor's file; m, added to each depth; N/m."""
GRIDS = {
    "poisson": (0.3, 0.4, 0.45, 0.475, 0.495),
    "friction": (0.0, 0.2, 0.5, 1.0, 2.0),
    "thickness": (0.8, 1.0, 1.25),
}
FLOOR = 0.02
"""Share of a curve's largest force that is added to a force where its error is relative, and below
which a load cell's readings without load may lie."""
_SEVERAL = (*GRIDS, "stiffness")
"""Parameters for which a fit begins at several values."""
STEP = 1e-4
"""Longest step between two depths of a table (m)."""
_YOUNG = 1e6
"""Young's modulus with which tables are solved (Pa)."""
_DEEPEST = 0.5
"""Share of the gel's thickness to which it may be pressed."""
_SHALLOWEST = 0.02
"""Share of the gel's thickness that the last depth has at least, where its unit is guessed."""
_FALL = 0.25
"""Share of the largest force by which a force may lie below one at a smaller depth."""
_LENGTHS = {"cm": 1e-2, "mm": 1e-3, "µm": 1e-6}
"""Units (m) in which depths may be by mistake, the largest first."""


@dataclass(frozen=True)
class Curve:
    """Measured forces of one indenter that is pressed straight into the apex, its z axis first."""

    name: str
    indenter: Shape
    depths: _Array
    """Way from the first touch (D,) in m, increasing."""
    forces: _Array
    """Normal force (D,) in N."""
    unloaded: int = 0
    """Number of points before the first force, which are left out."""


def read_curve(path: Path, indenter: Shape, thickness: float) -> Curve:
    """Read a .csv file with the columns ``depth_m`` and ``force_n``, for a gel that thick (m).

    Lines that begin with # are left out, and so are points before the first force: those of at
    most 0, or of no more than the largest negative reading, which is the load cell's noise.

    Raises:
        ValueError: If a column or a number is missing, depths do not increase, a force after the
            first is negative, or one before it by more than 2 % of the largest, forces do not
            grow, or a depth is beyond half of the gel.
    """
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = csv.DictReader((line for line in file if line[0] != "#"), skipinitialspace=True)
        try:
            columns = rows.fieldnames or ()
        except (UnicodeDecodeError, csv.Error):
            raise ValueError(f"{path}: found no text, expected a .csv file") from None
        if not {"depth_m", "force_n"} <= {*columns}:
            found = ", ".join(columns) or "none"
            text = f"found columns {found}, expected depth_m and force_n, with a comma between them"
            raise ValueError(f"{path}: {text}")
        points = [_point(f"{path}, point {number}", row) for number, row in enumerate(rows, 1)]
    if not points:
        raise ValueError(f"{path}: found no points")
    depths, forces = np.array(points).T
    # Where nothing is felt yet, the depth says nothing of the gel.
    noise = max(0.0, -forces.min())
    touching = int(np.argmax(forces > noise))
    lowest = np.where(np.arange(len(forces)) < touching, -FLOOR * forces.max(), 0.0)
    if (forces < lowest).any():
        first = int(np.argmax(forces < lowest))
        text = f"found force_n = {forces[first]:g}, expected a number from {lowest[first]:.2g}"
        raise ValueError(f"{path}, point {first + 1}: {text}")
    if forces[touching] <= 0.0:
        raise ValueError(f"{path}: found no force above 0")
    if (steps := np.diff(depths)).min(initial=1.0) <= 0.0:
        first = int(np.argmax(steps <= 0.0))
        text = f"found depth {depths[first + 1]:g} m after {depths[first]:g} m"
        raise ValueError(f"{path}, point {first + 2}: {text}, expected depths that increase")
    if depths[-1] > (most := _DEEPEST * thickness) * (1 + 1e-9):
        least = _SHALLOWEST * thickness
        units = [u for u, m in _LENGTHS.items() if least <= depths[-1] * m <= most]
        hint = f"; it seems to be in {' or '.join(units)}" if units else ""
        deeper = ", deeper than the gel" if not hint and depths[-1] > thickness else ""
        text = f"expected at most {most:g} m, half of the gel's thickness{hint}"
        raise ValueError(f"{path}: found a depth of {depths[-1]:g} m{deeper}, {text}")
    highest = np.maximum.accumulate(forces)
    # The last of the deepest falls: of a constant force the last point.
    worst = len(forces) - 1 - int(np.argmax((highest - forces)[::-1]))
    fall = highest[worst] - forces[worst]
    if forces[1:].size and (forces[-1] <= forces[0] or fall > _FALL * highest[-1]):
        text = f"found {forces[worst]:g} N at {depths[worst]:g} m after {highest[worst]:g} N"
        raise ValueError(f"{path}: {text}, expected forces that grow with depth")
    return Curve(str(path), indenter, depths[touching:], forces[touching:], touching)


def _point(place: str, row: Mapping[str, Any]) -> tuple[float, float]:
    """Depth (m) and force (N) of a row."""
    numbers = []
    for column in ("depth_m", "force_n"):
        try:
            numbers.append(float(row[column]))
        except (TypeError, ValueError):
            numbers.append(math.nan)
        least = 0.0 if column == "depth_m" else -math.inf
        if not least <= numbers[-1] or math.isinf(numbers[-1]):
            found = row[column] or "nothing"
            text = f"found {column} = {found}, expected a number from 0"
            raise ValueError(f"{place}: {text}")
    return numbers[0], numbers[1]


@dataclass(frozen=True)
class GelModel:
    """A sensor's gel but for what is fitted, and how it is solved."""

    sensor: str
    """Name or file."""
    law: str
    nodes: int = 1000
    element: str = "p2"

    def solve(self, indenter: Shape, depths: _Array, at: Mapping[str, float]) -> _Array:
        """Normal force (D,) over Young's modulus (m²) at increasing depths.

        The mesh is refined where the indenter meets the gel at the last depth, if that is no wider
        than twice the thickness of the sensor's file.

        Args:
            indenter: What is pressed.
            depths: Ways from the first touch (D,) in m.
            at: ``poisson``, ``friction``, and ``thickness`` over that of the sensor's file.

        Raises:
            PressError: If a press is not solved.
        """
        scale = at.get("thickness", 1.0)
        pad = self._pad(scale)
        touch = touching_height(indenter, pad.mesh.vertices)
        thickness = float(np.ptp(pad.mesh.vertices[:, 2])) / scale
        line = np.linspace(-thickness, thickness, 81)
        face = np.stack(np.meshgrid(line, line, [0.0]), axis=-1).reshape(-1, 3)
        gaps, _ = indenter.distance((face - [0.0, 0.0, touch - depths[-1]]) * [1, -1, -1])
        met = face[gaps <= max(0.0, gaps.min())]
        if np.abs(met).max() < 0.99 * thickness:
            pad = self._pad(scale, met)
            touch = touching_height(indenter, pad.mesh.vertices)
        body = SoftBody(pad.mesh, _YOUNG, at["poisson"], self.law, pad.fixed)  # type: ignore[arg-type]
        fem = Fem(body, friction=at["friction"], element=self.element)  # type: ignore[arg-type]
        # Friction depends on the path, so that there are frames between depths that lie apart.
        ends = np.concatenate([[0.0], depths])
        counts = np.ceil(np.diff(ends) / STEP - 1e-6).astype(int).clip(1)
        ways = np.concatenate(
            [np.linspace(a, b, n + 1)[1:] for a, b, n in zip(ends, depths, counts, strict=False)]
        )
        path = [((0.0, 0.0, touch - way), (1.0, 0.0, 0.0, 0.0)) for way in ways]
        frames = fem.solve_path(Press(indenter, path))
        forces = []
        for frame in frames:
            if isinstance(frame, PressError):
                raise frame
            forces.append(-frame.wrench[2] / _YOUNG)
        asked: _Array = np.array(forces)[np.cumsum(counts) - 1]
        return asked

    def _pad(self, scale: float, around: _Array | None = None) -> SoftBody:
        """The pad, its thickness scaled, its mesh refined towards points (K, 3)."""
        if scale == 1.0:
            return self._meshed(self.sensor, around)
        found = json.loads(read_sensor(self.sensor))
        found["outline"]["thickness"] *= scale
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "scaled.toml"
            file.write_text(toml(found))
            return self._meshed(str(file), around)

    def _meshed(self, sensor: str, around: _Array | None) -> SoftBody:
        try:
            return ruffini.sensor(sensor, resolution=self.nodes, around=around)
        except ValueError as error:
            raise ValueError(str(error).replace("resolution: ", "nodes: ", 1)) from None


@dataclass(frozen=True)
class Table:
    """Forces of an indenter, solved on a grid of what is fitted."""

    depths: _Array
    """From 0 (D,) in m."""
    axes: dict[str, _Array]
    """Values on the grid by parameter."""
    values: _Array
    """(F/E)^(2/3), the axes first and depth last."""

    @classmethod
    def solve(
        cls,
        gel: GelModel,
        indenter: Shape,
        deepest: float,
        fitted: Sequence[str],
        held: Mapping[str, float],
        watch: Callable[[int, int], None] = lambda done, whole: None,
    ) -> Table:
        """Solve one to `deepest` (m); `watch` gets the numbers of paths done and in all."""
        axes = {name: np.array(grid) for name, grid in GRIDS.items() if name in fitted}
        depths = np.linspace(0.0, deepest, max(13, math.ceil(deepest / STEP) + 1))
        corners = list(itertools.product(*axes.values()))
        rows = []
        for done, corner in enumerate(corners):
            watch(done, len(corners))
            at = {**held, **dict(zip(axes, corner, strict=True))}
            rows.append(np.concatenate([[0.0], gel.solve(indenter, depths[1:], at)]))
        watch(len(corners), len(corners))
        values = np.array(rows).clip(0.0) ** (2 / 3)
        return cls(depths, axes, values.reshape(*map(len, axes.values()), -1))

    @cached_property
    def _bases(self) -> list[Any]:
        """For each axis, and depth, the cubic splines that are 1 at one point of it, else 0."""
        from scipy.interpolate import CubicSpline

        grids = [*self.axes.values(), self.depths]
        return [CubicSpline(grid, np.eye(len(grid))) for grid in grids]

    def force(self, at: Mapping[str, float], depths: _Array) -> _Array:
        """Force over Young's modulus (m²) at depths (D,); none before the first touch."""
        values, (*bases, last) = self.values, self._bases
        for name, basis in zip(self.axes, bases, strict=True):
            values = np.tensordot(basis(at[name]), values, 1)
        forces: _Array = (last(depths.clip(0.0)) @ values).clip(0.0) ** 1.5
        return forces


@dataclass(frozen=True)
class Fit:
    """Parameters fitted to curves, with errors and confidence intervals."""

    values: dict[str, float]
    """Of the parameters fitted, in SI units, the thickness over that of the file."""
    errors: list[_Array]
    """Of the force, by curve: (D,), relative to the measured one; NaN where that is 0."""
    intervals: dict[str, dict[float, tuple[float, float]]]
    """By parameter and level; infinite where the range of the parameter ends first."""
    correlation: _Array
    """Of the parameters (P, P), to first order."""


def parameters(curves: Sequence[Curve], fitted: Sequence[str]) -> list[str]:
    """Names of the parameters: of several curves, each has an offset of its own.

    Raises:
        ValueError: If the curves have too few points.
    """
    names = [name for name in fitted if name != "offset"]
    if "offset" in fitted:
        names += [f"offset {n}" for n in range(1, len(curves) + 1)] if curves[1:] else ["offset"]
    if (points := sum(len(curve.depths) for curve in curves)) <= len(names):
        files = ", ".join(curve.name for curve in curves)
        text = f"{files}: found {points} point{'s' * (points > 1)} for {', '.join(names)}"
        raise ValueError(f"{text}, expected at least {len(names) + 1}")
    return names


class Problem:
    """Curves, their tables, and the parameters that are fitted."""

    def __init__(
        self,
        curves: Sequence[Curve],
        tables: Sequence[Table],
        fitted: Sequence[str],
        held: Mapping[str, float],
    ):
        self.curves, self.tables, self.held = curves, tables, held
        self.names = parameters(curves, fitted)
        self._logs = np.array([name in ("young", "stiffness") for name in self.names])
        ranges = [RANGES[name.split()[0]] for name in self.names]
        ends = [np.log(two) if log else two for two, log in zip(ranges, self._logs, strict=True)]
        self._low, high = np.array(ends).T
        self._width = high - self._low
        self._points = sum(len(curve.depths) for curve in curves)

    def forces(self, values: Mapping[str, float]) -> list[_Array]:
        """Force (D,) in N of each curve."""
        at = {**self.held, **values}
        return [
            at["young"] * table.force(at, self.indentation(values, number, curve.depths))
            for number, (curve, table) in enumerate(zip(self.curves, self.tables, strict=True))
        ]

    def indentation(self, values: Mapping[str, float], number: int, depths: _Array) -> _Array:
        """Depth (D,) to which a curve's gel is pressed (m) at depths as they are measured (D,)."""
        from scipy.optimize import newton

        at, table = {**self.held, **values}, self.tables[number]
        offset = values.get("offset", values.get(f"offset {number + 1}", 0.0))
        ways = (depths + offset).clip(0.0)
        if (compliance := at["young"] / at.get("stiffness", math.inf)) == 0.0:
            return ways

        def excess(depths: _Array) -> _Array:
            left: _Array = depths + compliance * table.force(at, depths) - ways
            return left

        # It is convex and grows, so that the secant method from above comes down to the root.
        found: _Array = newton(excess, ways, tol=1e-12, maxiter=200)
        return found

    def fit(self, levels: Sequence[float] = (0.68, 0.95)) -> Fit:
        """Fit the parameters, from several starts."""
        from scipy.stats import t as student

        several = [(0.2, 0.5, 0.8) if name in _SEVERAL else (0.5,) for name in self.names]
        starts = [np.array(start) for start in itertools.product(*several)]
        best = min((self._least(start) for start in starts), key=lambda least: least.squares)
        freedom = self._points - len(self.names)
        intervals: dict[str, dict[float, tuple[float, float]]] = {n: {} for n in self.names}
        for level, (number, name) in itertools.product(levels, enumerate(self.names)):
            share = student.ppf(0.5 + level / 2, freedom) ** 2 / freedom
            most = best.squares + share * max(best.squares, 1e-12 * self._points)
            low, high = (self._end(best, number, side, most) for side in (0.0, 1.0))
            intervals[name][level] = (low, high)
        values = self._values(best.unit)
        covariance = np.linalg.pinv(best.jacobian.T @ best.jacobian)
        spread = np.sqrt(np.diag(covariance).clip(1e-30))
        correlation = covariance / np.outer(spread, spread)
        return Fit(values, self._errors(values), intervals, correlation)

    def left_out(self, fit: Fit) -> list[_Array]:
        """Errors (D,) of the forces that a fit to all other points gives, by curve."""
        values = np.array([fit.values[name] for name in self.names])
        values[self._logs] = np.log(values[self._logs])
        unit = (values - self._low) / self._width
        found = []
        for left in range(self._points):
            least = self._least(unit, kept=np.arange(self._points) != left)
            found.append(np.concatenate(self._errors(self._values(least.unit)))[left])
        return np.split(np.array(found), np.cumsum([len(c.depths) for c in self.curves])[:-1])

    def _errors(self, values: Mapping[str, float]) -> list[_Array]:
        """Errors of the force (D,), relative to the measured one, by curve; NaN where that is 0."""
        measured = [np.where(curve.forces > 0, curve.forces, np.nan) for curve in self.curves]
        return [f / m - 1 for f, m in zip(self.forces(values), measured, strict=True)]

    def residuals(self, values: Mapping[str, float]) -> _Array:
        """Errors (N,), relative to the force and a floor."""
        pairs = zip(self.forces(values), self.curves, strict=True)
        return np.concatenate(
            [(f - c.forces) / (c.forces + FLOOR * c.forces.max()) for f, c in pairs]
        )

    def _values(self, unit: _Array) -> dict[str, float]:
        """Values of the parameters from 0 to 1 in their ranges, of some by their logarithm."""
        values = self._low + self._width * unit
        values[self._logs] = np.exp(values[self._logs])
        return dict(zip(self.names, values.tolist(), strict=True))

    def _least(
        self, start: _Array, held: dict[int, float] | None = None, kept: Any = slice(None)
    ) -> _Least:
        """The least squares of the points `kept`, with some parameters `held`."""
        from scipy.optimize import least_squares

        unit = start.copy()
        for number, value in (held or {}).items():
            unit[number] = value
        free = [number for number in range(len(unit)) if number not in (held or {})]

        def residuals(some: _Array) -> _Array:
            unit[free] = some
            errors: _Array = self.residuals(self._values(unit))[kept]
            return errors

        if not free:
            return _Least(unit, float(np.sum(residuals(unit[free]) ** 2)), np.empty((0, 0)))
        found = least_squares(residuals, start[free].clip(1e-6, 1 - 1e-6), bounds=(0.0, 1.0))
        unit[free] = found.x
        return _Least(unit, 2 * float(found.cost), found.jac)

    def _end(self, best: _Least, number: int, side: float, most: float) -> float:
        """Value where the parameter's profile reaches `most` on a side, or infinity."""
        from scipy.optimize import brentq

        def excess(value: float) -> float:
            return self._least(best.unit, {number: value}).squares - most

        if excess(side) <= 0.0:
            return math.inf if side else -math.inf
        unit = best.unit.copy()
        unit[number] = brentq(excess, best.unit[number], side, xtol=1e-4)
        return self._values(unit)[self.names[number]]


@dataclass(frozen=True)
class _Least:
    """A least sum of squares."""

    unit: _Array
    """Parameters (P,), from 0 to 1 in their ranges."""
    squares: float
    jacobian: _Array


def toml(found: Mapping[str, Any]) -> str:
    """Write a sensor as its file; what is None is left out, but a radius without end is inf."""

    def word(value: Any) -> str:
        if isinstance(value, dict):
            return "{ " + ", ".join(f"{k} = {word(v)}" for k, v in value.items()) + " }"
        return "inf" if value is None else json.dumps(value, ensure_ascii=False)

    lines, tables = [], []
    for name, value in found.items():
        if name == "calibration":
            tables += [("[[calibration]]", one) for one in value]
        elif isinstance(value, dict):
            tables.append((f"[{name}]", value))
        elif value is not None:
            lines.append(f"{name} = {word(value)}")
    for head, table in tables:
        kept = {k: v for k, v in table.items() if v is not None or k.startswith("radius")}
        lines += ["", head, *(f"{k} = {word(v)}" for k, v in kept.items())]
    return "\n".join(lines) + "\n"
