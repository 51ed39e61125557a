"""Colour of a gel's face from its slope, and how far two pictures are apart.

With p = ∂z/∂x and q = ∂z/∂y of the pressed face less those of the face at rest, and the place
x, y on the face in halves of the longer side of the view, each channel of a picture in 0..1 is

    I(x, y, p, q) = Σ_k b_k x^{a_k} y^{b_k} + Σ_k r_k p^{a_k} q^{b_k} x^{c_k} y^{d_k},

a_k + b_k ≥ 1 in the second sum, so that gel at rest shows the background. z leaves the gel.

The camera is behind the gel and looks along z: the columns of a frame run along y, its rows along
−x. Pictures here are (along, across, 3): entry [j, i] lies at y_j, x_i, both ascending.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import numpy as np
import tomllib
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Colour:
    """Coefficients of one camera."""

    background_terms: Array
    """Exponents of x and y (B, 2)."""
    background: Array
    """Red, green and blue of each (B, 3)."""
    terms: Array
    """Exponents of p, q, x and y (K, 4)."""
    response: Array
    """Red, green and blue of each (K, 3)."""
    steepest: float
    """Slopes beyond are shortened to this one."""

    @classmethod
    def read(cls, file: Path) -> Colour:
        """From the table `camera.image` of a TOML file."""
        image = tomllib.loads(file.read_text())["camera"]["image"]
        parts = ("background_terms", "background", "terms", "response")
        return cls(*(np.array(image[part], float) for part in parts), float(image["steepest"]))

    def picture(self, x: Array, y: Array, p: Array, q: Array) -> Array:
        """Intensities (..., 3) in 0..1 at places and slopes of the same shape (...)."""
        still = monomials(self.background_terms, x, y) @ self.background
        p, q = shortened(p, q, self.steepest)
        return np.clip(still + monomials(self.terms, p, q, x, y) @ self.response, 0, 1)


def monomials(terms: Array, *variables: Array) -> Array:
    """Products of powers of the variables (...), one for each row of exponents (..., K)."""
    most = np.max(terms, axis=0).astype(int)
    powers = [
        [np.ones_like(v), *itertools.accumulate([v] * n, np.multiply)]
        for v, n in zip(variables, most, strict=True)
    ]
    columns = np.empty((*variables[0].shape, len(terms)))
    for k, row in enumerate(terms):
        factors = [some[int(e)] for some, e in zip(powers, row, strict=True) if e]
        columns[..., k] = reduce(np.multiply, factors) if factors else 1.0
    return columns


def shortened(p: Array, q: Array, steepest: float) -> tuple[Array, Array]:
    """Slopes no longer than `steepest`, in the same direction."""
    factor = np.minimum(1, steepest / np.maximum(np.hypot(p, q), 1e-12))
    return p * factor, q * factor


def degrees(variables: int, least: int, most: int) -> list[tuple[int, ...]]:
    """Exponents of so many variables whose sum is from `least` to `most`, low sums first."""
    grids = np.meshgrid(*[np.arange(most + 1)] * variables, indexing="ij")
    rows = np.stack([g.reshape(-1) for g in grids], axis=-1)
    total = rows.sum(axis=1)
    rows = rows[(total >= least) & (total <= most)]
    return [tuple(map(int, row)) for row in sorted(rows, key=lambda row: (row.sum(), *-row))]


def places(shape: tuple[int, int]) -> tuple[Array, Array]:
    """Places x, y of the pixels of a whole picture (along, across)."""
    along, across = shape
    half = max(shape) / 2
    y, x = np.meshgrid(*(np.arange(n) - (n - 1) / 2 for n in shape), indexing="ij")
    assert x.shape == (along, across)
    return x / half, y / half


def turned(frame: NDArray) -> NDArray:
    """A frame of the camera (rows, columns, ...) as a picture (along, across, ...)."""
    return np.swapaxes(frame, 0, 1)[:, ::-1]


def shown(picture: NDArray) -> NDArray:
    """A picture (along, across, ...) as the camera gives it (rows, columns, ...)."""
    return np.swapaxes(picture[:, ::-1], 0, 1)


def similarity(one: Array, other: Array) -> Array:
    """Structural similarity at every pixel, mean of the channels (along, across).

    Wang et al. 2004: Gaussian window of standard deviation 1.5 pixels cut at 3.5 of them,
    K1 = 0.01, K2 = 0.03, intensities 0..1, moments as in the paper.
    """

    def mean(field: Array) -> Array:
        return gaussian_filter(field, (1.5, 1.5, 0), truncate=3.5)

    a, b = mean(one), mean(other)
    aa, bb, ab = mean(one * one) - a * a, mean(other * other) - b * b, mean(one * other) - a * b
    c1, c2 = 0.01**2, 0.03**2
    likeness = (2 * a * b + c1) * (2 * ab + c2) / ((a * a + b * b + c1) * (aa + bb + c2))
    return likeness.mean(axis=-1)
