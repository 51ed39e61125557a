"""Pictures by Taxim's published method and calibration (Si and Yuan 2022), written anew.

A ball's height map is laid on the flat gel, blurred by Gaussians of falling width outside a part of
the contact, and once more as a whole; angle and direction of its slope choose, from a table, a
quadratic polynomial of the pixel that is added to the background. Without shadows. Widths and
bins as in `params.json` of the package `taxim` 1.4.1. Frames here are the camera's, (rows, columns)
in red, green, blue, 0..1; lengths are pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Array = NDArray[np.float64]
PYRAMID = (30.5, 15.5, 8.0, 3.5, 2.0, 1.1)
LAST = 2.0
STILL = 50.0
"""Standard deviations: before and after the contact is put back in, and of the still picture."""
MIXED = 0.15
"""Share of the blurred still picture in the background."""
CONTACT = 0.4
"""Share of the depth beyond which the face is the ball's."""


@dataclass(frozen=True)
class Table:
    """Polynomials by bins of angle and direction (A, D, 3, 6), and the background (H, W, 3)."""

    polynomials: Array
    background: Array

    @classmethod
    def read(cls, stored: dict[str, NDArray], still: Array) -> Table:
        """From `polycalib.npz`, whose red and blue are exchanged, and the still frame."""
        parts = [stored[f"grad_{name}"] for name in "bgr"]
        blurred = gaussian_filter(still, (STILL, STILL, 0))
        return cls(np.stack(parts, axis=-2) / 255, MIXED * blurred + (1 - MIXED) * still)

    def picture(self, down: Array, right: Array) -> Array:
        """Frame of a face whose height out of the gel rises by `down`, `right` a pixel (H, W)."""
        bins = self.polynomials.shape[0] - 1
        angle = np.arctan(np.hypot(down, right))
        # Flat gel has direction 0, as there.
        turn = np.where(angle > 0, np.arctan2(-down, -right), 0.0) + np.pi
        a = np.floor(angle / (np.pi / 2 / bins)).astype(int)
        d = np.floor(turn / (2 * np.pi / bins)).astype(int)
        y, x = np.mgrid[: down.shape[0], : down.shape[1]].astype(float)
        powers = np.stack([x * x, y * y, x * y, x, y, np.ones_like(x)], axis=-1)
        change = np.einsum("hwck,hwk->hwc", self.polynomials[a, d], powers)
        return np.clip(self.background + change, 0, 1)

    def flat_taken_off(self, frame: Array) -> Array:
        """A frame without what the table adds to flat gel, which is not nothing."""
        flat = np.zeros(frame.shape[:2])
        return np.clip(frame - self.picture(flat, flat) + self.background, 0, 1)

    def ball(self, row: float, column: float, radius: float, contact: float) -> Array:
        """Frame of a ball that touches within `contact` of a place."""
        height, width = self.background.shape[:2]
        y, x = np.mgrid[:height, :width].astype(float)
        squared = (y - row) ** 2 + (x - column) ** 2
        contact = min(contact, 0.98 * radius)
        edge = np.sqrt(radius**2 - contact**2)
        ball = edge - np.sqrt(np.maximum(radius**2 - squared, 0))
        sunk = np.where(squared < contact**2, ball, 0.0)
        kept = sunk < CONTACT * sunk.min()
        face = sunk
        for deviation in PYRAMID:
            face = np.where(kept, sunk, gaussian_filter(face, deviation))
        down, right = np.gradient(gaussian_filter(face, LAST))
        return self.picture(down, right)
