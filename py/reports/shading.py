"""Slopes of a pressed face from its pictures, where they were not measured.

Twenty-four pictures show the same small tip pressed straight down. Around the place of contact the
face is a surface of revolution, so that each press is a profile g(r), the slope at distance r from
the middle. Three distant lights on a matt face of even colour (Lambert) give

    I_c − I_c(at rest) = Σ_l k_cl (max(0, t_l + p cos φ_l + q sin φ_l) / √(1 + p² + q²) − t_l),

with azimuth φ_l and tangent of elevation t_l of light l. The root and the shadows fix the scale of
the slopes: with even colour and no shadows, a flatter relief under other lights looks different
(Belhumeur, Kriegman and Yuille 1999, the bas-relief ambiguity). Lengths are pixels of the frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter
from scipy.optimize import least_squares

Array = NDArray[np.float64]
NODES = np.array([0, 3, 6, 9, 12, 15, 18, 22, 27, 33, 40, 50, 62, 80, 110, 140.0])
"""Distances at which a profile is given; it is 0 at both ends (G + 2,)."""
REACH = 96
"""Half of the window of which pixels are used."""
NOISE = 5 / 255
"""Residuals beyond this count less (soft L1)."""
UNEVEN = 0.5
"""Weight of second differences of the logarithm of a profile."""
SOFT = 1e-3
"""Rounding of the edge of a shadow, in squared slope."""


@dataclass(frozen=True)
class Pixels:
    """Pixels of one press: more of them near the middle."""

    x: Array
    y: Array
    weight: Array
    difference: Array
    """Picture less background (P, 3)."""


@dataclass(frozen=True)
class Lights:
    """Three lights."""

    strength: Array
    """Of each channel by each light (3, 3)."""
    azimuth: Array
    tangent: Array

    def difference(self, p: Array, q: Array) -> Array:
        """Change of the picture (..., 3) by slopes (...)."""
        lit = self.tangent + np.multiply.outer(p, np.cos(self.azimuth))
        lit += np.multiply.outer(q, np.sin(self.azimuth))
        lit = (lit + np.sqrt(lit * lit + SOFT)) / 2
        return (lit / np.sqrt(1 + p * p + q * q)[..., None] - self.tangent) @ self.strength.T


def pixels(picture: Array, background: Array, middle: Array) -> Pixels:
    """Those of a press (along, across, 3) around a place (x, y) in pixels from the corner."""
    change = gaussian_filter(picture - background, (1, 1, 0))
    x0, y0 = np.round(middle).astype(int)
    y, x = np.mgrid[y0 - REACH : y0 + REACH, x0 - REACH : x0 + REACH]
    r = np.hypot(x - x0, y - y0)
    near, far = r < 24, r >= 48
    step = np.where(near, (x + y) % 2, np.where(far, x % 8 + y % 8, x % 4 + y % 4))
    keep = step == 0
    weight = np.where(near, 1.0, np.where(far, 4.0, 2.0))[keep]
    return Pixels(x[keep] * 1.0, y[keep] * 1.0, np.sqrt(weight), change[y[keep], x[keep]])


def sloped(profile: Array, middle: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Slopes p, q of a face around a middle at places (...); the profile is between its ends."""
    away_x, away_y = x - middle[0], y - middle[1]
    r = np.hypot(away_x, away_y) + 1e-9
    steep = np.interp(r, NODES, np.concatenate([[0], profile, [0]]))
    return steep * away_x / r, steep * away_y / r


def _residual(lights: Lights, seen: Pixels, middle: Array, profile: Array) -> Array:
    change = lights.difference(*sloped(profile, middle, seen.x, seen.y))
    return ((change - seen.difference) * seen.weight[:, None]).reshape(-1) / NOISE


def lights_of(presses: list[Pixels], middles: Array, scale: float) -> tuple[Lights, Array, float]:
    """Lights that explain some presses, their profiles, and the mean absolute error in 0..1.

    Args:
        presses: Pixels of each.
        middles: First guess of each middle (N, 2).
        scale: Slope that the search starts from.
    """
    count = len(NODES) - 2
    inner = NODES[1:-1]
    guess = scale * np.exp(-np.maximum(inner - 15, 0) / 25) * np.minimum(1, inner / 12)

    def parts(t: Array) -> tuple[Lights, Array]:
        lights = Lights(t[:9].reshape(3, 3), t[9:12], np.exp(t[12:15]))
        return lights, t[15:].reshape(len(presses), 2 + count)

    def residual(t: Array) -> Array:
        lights, rest = parts(t)
        fits = [
            _residual(lights, seen, row[:2], np.exp(row[2:]))
            for seen, row in zip(presses, rest, strict=True)
        ]
        return np.concatenate([*fits, UNEVEN * np.diff(rest[:, 2:], n=2, axis=1).reshape(-1)])

    start = [
        (np.eye(3) * 0.4 / scale).reshape(-1),
        np.radians([0.0, 90.0, 190.0]),
        np.log(np.full(3, 0.5 * scale)),
        *(np.concatenate([middle, np.log(guess)]) for middle in middles),
    ]

    def slopes(t: Array) -> Array:
        """Derivatives by differences: a press's own numbers move its residuals alone."""
        step, base = 1e-6, residual(t)
        table = np.zeros((len(base), len(t)))
        for n in range(15):
            table[:, n] = (residual(t + step * (np.arange(len(t)) == n)) - base) / step
        lights, rest = parts(t)
        ends = np.cumsum([0] + [3 * len(seen.x) for seen in presses])
        width, bend = 2 + count, ends[-1]
        for m, (seen, row) in enumerate(zip(presses, rest, strict=True)):
            own = slice(ends[m], ends[m + 1])
            for n in range(width):
                moved = row + step * (np.arange(width) == n)
                fit = _residual(lights, seen, moved[:2], np.exp(moved[2:]))
                table[own, 15 + m * width + n] = (fit - base[own]) / step
            block = UNEVEN * np.diff(np.eye(count), n=2, axis=0)
            at = bend + m * (count - 2)
            first = 15 + m * width + 2
            table[at : at + count - 2, first : first + count] = block
        return table

    found = least_squares(
        residual, np.concatenate(start), slopes, x_scale="jac", max_nfev=60, loss="soft_l1"
    )
    lights, rest = parts(found.x)
    errors = [
        np.abs(_residual(lights, seen, row[:2], np.exp(row[2:])) * NOISE).mean()
        for seen, row in zip(presses, rest, strict=True)
    ]
    return lights, np.exp(rest[:, 2:]), float(np.mean(errors))


def profile_of(lights: Lights, seen: Pixels, middle: Array) -> tuple[Array, Array]:
    """Middle (2,) and profile (G,) of a press under known lights."""
    inner = NODES[1:-1]
    guess = 0.7 * np.exp(-np.maximum(inner - 15, 0) / 25) * np.minimum(1, inner / 12)

    def residual(t: Array) -> Array:
        fit = _residual(lights, seen, t[:2], np.exp(t[2:]))
        return np.concatenate([fit, UNEVEN * np.diff(t[2:], n=2)])

    start = np.concatenate([middle, np.log(guess)])
    t = least_squares(residual, start, x_scale="jac", max_nfev=60, loss="soft_l1").x
    return t[:2], np.exp(t[2:])


def depth(profile: Array) -> float:
    """Depth of the middle under the face far away (pixels)."""
    return float(np.trapezoid(np.concatenate([[0], profile, [0]]), NODES))


@dataclass(frozen=True)
class Family:
    """Profiles of one tip by depth alone: each node a parabola of the depth."""

    coefficients: Array
    """Of the logarithm of the slope at each node (3, G)."""
    middle: float
    """Depth about which the parabolas are taken (pixels)."""

    @classmethod
    def of(cls, profiles: Array) -> Family:
        """The one nearest to some profiles (N, G)."""
        depths = np.array([depth(row) for row in profiles])
        middle = float(depths.mean())
        return cls(np.polynomial.polynomial.polyfit(depths - middle, np.log(profiles), 2), middle)

    def profile(self, depth: float) -> Array:
        """Slopes at the nodes (G,)."""
        powers = (depth - self.middle) ** np.arange(3)
        return np.exp(powers @ self.coefficients)


def placed(lights: Lights, seen: Pixels, family: Family, start: Array) -> Array:
    """Middle x, y and depth of a press of a family (3,), in pixels."""

    def residual(t: Array) -> Array:
        return _residual(lights, seen, t[:2], family.profile(t[2]))

    return least_squares(residual, start, x_scale="jac", loss="soft_l1", max_nfev=60).x


def smooth(profile: Array) -> PchipInterpolator:
    """The profile as a smooth function of distance, 0 from the last node on."""
    return PchipInterpolator(NODES, np.concatenate([[0], profile, [0]]), extrapolate=False)
