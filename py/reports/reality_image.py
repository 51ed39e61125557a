"""Pictures of real presses of a GelSight Mini beside those of the fitted colours."""

from __future__ import annotations

import json
from argparse import Namespace
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

import colour
from colour import Colour
from engine import ROOT, Rows, grid, made, run, table, text
from ruffini import Press, PressError, Shape, Skin, Surrogate

MADE_OF = ["env-core/src/tactile", "env-core/src/surrogate", "env-core/assets/weights"]
MADE_OF += ["py/reports/colour.py", "py/reports/colour_fit.py", "py/reports/reality_image.py"]
MADE_OF += ["env-core/assets/sensors/gelsight-mini.toml", "tests/reference/gelsight_presses.npz"]
REFERENCE = ROOT / "tests/reference"
COEFFICIENTS = ROOT / "env-core/assets/sensors/gelsight-mini.toml"
FIGURES = REFERENCE / "gelsight_image.json"
PRESSES = REFERENCE / "gelsight_presses.npz"
SHAPE = (640, 480)
"""Pixels of a frame along and across."""
NEAR = 40
"""Distance from the middle that counts as near (pixels of the frame)."""
RADII = (5e-4, 7.5e-4, 1e-3, 1.25e-3, 1.5e-3, 2e-3, 3e-3, 5e-3)
"""Radii (m) that the ball may have, which nobody states."""
DEPTHS = (1e-4, 1.6e-3)
"""Depths (m) between which that of a press is sought."""
STEP = 2e-4
"""Longest load step (m)."""
QUICK = 1
"""Presses of the quick form."""


@dataclass(frozen=True)
class HeldOut:
    """A press that nothing was fitted to: every pixel is the mean of four of the frame."""

    number: int
    real: NDArray[np.float64]
    """Intensities (N, N, 3) in 0..1."""
    middle: NDArray[np.float64]
    """Middle of contact (x, y), pixels of the frame from its corner."""
    distances: NDArray[np.float64]
    slopes: NDArray[np.float64]
    """Of the face at those distances (pixels of the frame)."""

    @cached_property
    def face(self) -> tuple[NDArray[np.float64], ...]:
        """Places x, y and slopes p, q at the pixels of the frame in the window."""
        half = self.real.shape[0]
        i, j = np.round(self.middle).astype(int)
        at = np.s_[j - half : j + half, i - half : i + half]
        x, y = (a[at] for a in colour.places(SHAPE))
        rows, columns = (a[at] for a in np.indices(SHAPE))
        away_x, away_y = columns - self.middle[0], rows - self.middle[1]
        r = np.hypot(away_x, away_y) + 1e-9
        steep = np.interp(r, self.distances, self.slopes) / r
        return x, y, steep * away_x, steep * away_y

    def picture(self, colours: Colour, still: bool = False) -> NDArray[np.float64]:
        """As the colours have it, pressed or still (N, N, 3)."""
        x, y, p, q = self.face
        whole = colours.picture(x, y, *((0 * p, 0 * q) if still else (p, q)))
        half = self.real.shape[0]
        return whole.reshape(half, 2, half, 2, 3).mean(axis=(1, 3))

    def error(self, picture: NDArray[np.float64]) -> float:
        """Mean absolute error, of 255."""
        return 255 * float(np.abs(picture - self.real).mean())

    @property
    def near(self) -> NDArray[np.bool_]:
        """Pixels (N, N) near the middle of contact."""
        corner = np.round(self.middle).astype(int) - self.real.shape[0]
        i, j = (
            2 * np.arange(self.real.shape[0]) + 0.5 + c - m
            for c, m in zip(corner, self.middle, strict=True)
        )
        return np.hypot(i, j[:, None]) <= NEAR

    def judged(self, picture: NDArray[np.float64]) -> dict[str, float]:
        """Mean absolute error (of 255) and structural similarity, in the window and near."""
        error = 255 * np.abs(picture - self.real).mean(axis=2)
        alike = colour.similarity(picture, self.real)
        return {
            "window": float(error.mean()),
            "near": float(error[self.near].mean()),
            "similarity": float(alike.mean()),
            "similarity near": float(alike[self.near].mean()),
        }


def held_out() -> list[HeldOut]:
    """The presses that lie in `tests/reference`."""
    with np.load(PRESSES) as file:
        parts = [file[k] for k in ("numbers", "pictures", "places", "slopes")]
        distances = file["distances"]
    return [
        HeldOut(int(number), picture / 255, middle.astype(float), distances, slopes.astype(float))
        for number, picture, middle, slopes in zip(*parts, strict=True)
    ]


class Channel:
    """The channel `image`, of a gel under a ball that the network solves."""

    def __init__(self, pixel: float) -> None:
        self.pixel = pixel
        self._model = Surrogate()
        along, across = (n // 2 for n in SHAPE)
        self._skin = Skin(self._model.body, resolution={"image": (across, along)})
        self._rest = self._skin.read("depth")

    def picture(self, press: HeldOut, radius: float, depth: float) -> NDArray[np.float64] | None:
        """The window of a press (N, N, 3) by a ball so deep (m); `None` if it is not solved."""
        half = press.real.shape[0]
        corner = np.round(press.middle).astype(int) - half
        # A window from an odd pixel on is moved by one, with the ball.
        corner, middle = corner + corner % 2, press.middle + corner % 2
        x, y = (self.pixel * (m - (n - 1) / 2) for m, n in zip(middle, SHAPE[::-1], strict=True))
        apart = np.hypot(*(self._skin.places["depth"] - (x, y)).T)
        height = self._rest.ravel()[apart.argmin()] + radius
        depths = np.linspace(0, depth, int(np.ceil(depth / STEP)) + 1)[1:]
        path = [((x, y, height - d), (0, 0, 0, 1)) for d in depths]
        answer = self._model.solve(Press(Shape.sphere(radius), path))[0]
        if isinstance(answer, PressError):
            return None
        i, j = corner // 2
        return self._skin.read("image", answer)[j : j + half, i : i + half]


def by_radius(number: int, pixel: float) -> dict[str, Any]:
    """Depth of a press with the least error in the window, and errors, for balls of each radius."""
    channel, press = Channel(pixel), held_out()[number]

    def error(depth: float, radius: float) -> float:
        picture = channel.picture(press, radius, depth)
        return np.inf if picture is None else press.error(picture)

    found = []
    for radius in RADII:
        # The error may have several minima: the search begins at the least of a few depths.
        some = np.linspace(*DEPTHS, 7)
        least = min(some, key=lambda depth: error(depth, radius))
        ends = np.clip([least - some[1] + some[0], least + some[1] - some[0]], *DEPTHS)
        depth = minimize_scalar(
            error, bounds=ends, args=(radius,), method="bounded", options={"xatol": 1e-5}
        ).x
        picture = channel.picture(press, radius, depth)
        assert picture is not None
        found.append({"radius": radius, "depth": float(depth), **press.judged(picture)})
    return {"press": press.number, "balls": found}


def chosen(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Of each press the ball whose error in the window is least on all the others."""
    found = []
    for row in rows:
        others = [other for other in rows if other is not row] or [row]
        sums = [sum(other["balls"][k]["window"] for other in others) for k in range(len(RADII))]
        found.append({"press": row["press"], **row["balls"][int(np.argmin(sums))]})
    return found


def make(options: Namespace) -> dict[str, Any]:
    """Results of the fit, and errors of its coefficients on the presses that it left out."""
    rows = Rows.of("reality_image", options, MADE_OF, {})
    colours = Colour.read(COEFFICIENTS)
    again = [
        {
            "press": press.number,
            "error": press.error(press.picture(colours)),
            "still": press.error(press.picture(colours, still=True)),
        }
        for press in held_out()
    ]
    fit = json.loads(FIGURES.read_text())
    numbers = range(QUICK if options.quick else len(again))
    run(rows, {f"channel {n}": (by_radius, n, fit["pixel"]) for n in numbers})
    presses = held_out()
    reduced = {
        "background": [p.judged(p.picture(colours, still=True)) for p in presses],
        "ours": [p.judged(p.picture(colours)) for p in presses],
        "the channel": chosen(sorted(rows, key=lambda row: row["press"])),
    }
    return rows.header | {"note": options.note, "fit": fit, "again": again, "reduced": reduced}


HEIGHT = 4.2
SECTION = """## Pictures of a GelSight Mini

The colours of a picture are polynomials of the slope of the gel's face (`camera.image` in
`env-core/assets/sensors/gelsight-mini.toml`), fitted by `py/reports/colour_fit.py` to {count} of 24
real presses of one GelSight Mini, those of the package `taxim` 1.4.1 (MIT). Four presses ({held}),
drawn with seed {fit[seed]} before anything was fitted, are in no fit and judge it; their errors
stood beside those of the others while degree and weights were chosen. Errors are mean absolute
differences of intensity, of 255, and structural similarity (Gaussian window of 1.5 pixels, K1 0.01,
K2 0.03, mean of the channels), in a window of 220 × 220 pixels around the middle, within 40 pixels
of it, and over the frame of 480 × 640. Frames without contact differ by {fit[noise]:.1f}, their
noise.

{errors}

*Background* is the still picture's polynomial alone. *Taxim* is the published polynomial table with
the published contacts, a ball of {fit[table][Taxim][value]:.0f} pixels and Taxim's own face,
without shadows, in code of our own; its authors fitted it to all 24 presses, these four included.
*Taxim, our faces* is the same table with the slopes described below, times
{fit[table][Taxim, our faces][value]:g}. Of each, the number was chosen for the least error on
presses that are fitted. The table changes the colour of flat gel; *flat taken off* is without that
change, which is kinder to it than the method is. *Flat* and *Hertz outside* are our colours fitted
anew to the cap of a ball in a face that is flat outside contact or that of an elastic half space,
with the ball and Gaussian of twelve pairs and the contact radii that fit best; *ours* takes the
faces below.

**The channel itself.** *Ours* takes its slopes from the real picture: it judges the colours alone.
Here is the channel `image` of a gel that the network deforms under a ball, beside both, on the
pictures reduced by 2 × 2 pixels. The radius of the ball, one of {radii} mm, is that with the least
error on the other three presses ({balls} mm); the depth is that with the least error in the window
({depths} mm), since neither is stated. The real face is steepest at its tip and falls off smoothly,
as under something pointed, where a ball's is steepest at the rim of its contact: what is left near
the middle is as much of the indenter as of the gel.

{channel}

**The contacts had to be found again.** The package states places and radii of contact. The pictures
show the tip {fit[places][label apart][median]:.0f} pixels (median; at most {fit[places][label
apart][max]:.0f}) beside them, and its strongest colours within 20 pixels of the middle where radii
of contact of {fit[places][label radius][0]:.0f} to {fit[places][label radius][1]:.0f} are stated;
the radius of the ball is not stated. So the slopes themselves were found by shape from shading:
three lights on a matt surface, a face of revolution, one family of profiles for all presses with
its depth as the only number of each. The scale of slopes follows from shadows and from the
foreshortening of steep parts alone: the cost of the best lights changes by {scale}. Taxim's table,
fitted by others to a ball that they measured, fits best with our slopes times {fit[table][Taxim,
our faces, flat taken off][value]:g}, a second hint at the scale. Starts from slopes of 0.3, 1 and 2
ended at peaks of {peaks}. Of a press that was left out, the middle and the depth, three numbers,
are found from its own picture.

**Terms.** Errors in the window of means of 2 × 2 pixels: fitted; with four presses at a time left
out; with one of three series (same place, growing depth) at a time left out.

{choices}

Shipped: degree 6, without the place. All 24 presses lie within {spread} mm of each other, so they
cannot tell how colours change over the face; terms with the place lower the error by describing
what is left here, the shadow that the imprint casts away from each light, which no function of the
slope has. Away from there the pictures have the real background and the response of that one spot.

**Smoothing.** Pictures from the face of our finite elements under a ball, by the Gaussian with
which its height is smoothed. The depth of each press and the ball, one of five, are those with the
least error, in the window (weighted as in the fit) and within 24 pixels:

{smoothing}

The window hardly tells them apart, and the error near contact is uneven. Shipped is the least near
contact, {best[deviation]:.0f} pixels or {wide:.2f} mm. The real face falls off more slowly around
the tip than our gel, which has no skin: part of this width stands for it.

Rounding of the coefficients to five digits moves no pixel by more than {fit[rounding]:.2f}. From
the reduced pictures in `tests/reference`: {again}. Pixels are taken as {pixel} mm, from the
package; widths in mm inherit its error (other sources state views from 15.2 × 20.3 to 18 × 24 mm).
The frames are taken as not mirrored, which nobody states: columns along y, rows along −x.

{made}"""
ERRORS = {
    "picture": "{picture}",
    "window": "{window:.2f}",
    "near": "{near:.2f}",
    "frame": "{frame:.2f}",
    "similarity, window": "{similarity:.3f}",
    "near ": "{similarity near:.3f}",
    "frame ": "{similarity frame:.3f}",
}
FOUND = ("window", "near", "similarity", "similarity near")
REDUCED = {
    "picture": "{picture}",
    "window": "{window:.2f}",
    "near": "{near:.2f}",
    "similarity, window": "{similarity:.3f}",
    "near ": "{similarity near:.3f}",
}
CHOICES = {
    "degree in slopes": "{slopes}",
    "with the place": lambda row: (
        f"to {row['slopes with place']} × {row['place']}" if row["place"] else "–"
    ),
    "terms": "{terms}",
    "fitted": "{fitted:.2f}",
    "presses left out": "{folds:.2f}",
    "series left out": "{series:.2f}",
}


def means(fit: dict[str, Any]) -> list[dict[str, Any]]:
    """Mean over the presses left out, by picture, the least error in the window first."""
    names = dict.fromkeys(row["picture"] for row in fit["presses"])
    found = []
    for name in names:
        rows = [row for row in fit["presses"] if row["picture"] == name]
        figures = {k: float(np.mean([row[k] for row in rows])) for k in rows[0] if k != "picture"}
        found.append({**figures, "picture": name})
    return sorted(found, key=lambda row: row["window"])


def reduced(part: dict[str, Any]) -> list[dict[str, Any]]:
    """Means over the presses of each reduced picture."""
    return [
        {"picture": name} | {key: float(np.mean([row[key] for row in rows])) for key in FOUND}
        for name, rows in part["reduced"].items()
    ]


def rows(part: dict[str, Any]) -> list[dict[str, str]]:
    """The pictures that no colour was fitted to."""
    fit = part["fit"]
    found = {row["picture"]: row for row in means(fit)}
    ours, theirs = found["ours"], found["Taxim, flat taken off"]
    row = {"what": f"{len(fit['held'])} pictures of a GelSight Mini under a ball"}
    row |= {"by": "the package `taxim`, measured", "ours": "colours by slope, of other presses"}
    [channel] = [one for one in reduced(part) if one["picture"] == "the channel"]
    row["difference"] = (
        f"{channel['window']:.2f} of 255, similarity {channel['similarity']:.3f} by the channel "
        f"`image` at half the size; with the slopes of the real face {ours['window']:.2f} and "
        f"{ours['similarity']:.3f} (Taxim's at best {theirs['window']:.2f} and "
        f"{theirs['similarity']:.3f} with its own faces)"
    )
    return [row | {"because": "shadows, the place on the face, and the face around the contact"}]


def section(part: dict[str, Any]) -> str:
    """Errors, terms, smoothing, and limits of the pictures."""
    fit = part["fit"]
    deviations = sorted({row["deviation"] for row in fit["smoothing"]})
    least = {
        words: [
            min(row[key] for row in fit["smoothing"] if row["deviation"] == deviation)
            for deviation in deviations
        ]
        for words, key in (("window", "error"), ("near", "near"))
    }
    best = min(fit["smoothing"], key=lambda row: row["near"])
    places = fit["places"]
    spread = [1e3 * fit["pixel"] * (places[axis][1] - places[axis][0]) for axis in "xy"]
    scale = ", ".join(
        f"{100 * (row['cost'] - 1):+.0f} % with slopes times {row['factor']:g}"
        for row in fit["lights"]["scale"]
        if row["factor"] != 1
    )
    return text(
        SECTION,
        {"fit": fit, "best": best, "wide": 1e3 * fit["pixel"] * best["deviation"]},
        count=str(24 - len(fit["held"])),
        held=", ".join(map(str, fit["held"])),
        errors=table(ERRORS, means(fit), absent="–"),
        scale=scale,
        radii=", ".join(f"{1e3 * radius:g}" for radius in RADII),
        balls=", ".join(f"{1e3 * row['radius']:g}" for row in part["reduced"]["the channel"]),
        depths=", ".join(f"{1e3 * row['depth']:.2f}" for row in part["reduced"]["the channel"]),
        channel=table(REDUCED, reduced(part)),
        peaks=", ".join(f"{peak:.2f}" for peak in fit["lights"]["steepest by start"].values()),
        choices=table(CHOICES, fit["choices"]),
        spread=" × ".join(f"{one:.1f}" for one in spread),
        smoothing=grid(
            ["Gaussian (pixels)", *map(str, deviations)],
            [[words, *(f"{one:.2f}" for one in errors)] for words, errors in least.items()],
        ),
        again="; ".join(
            f"press {row['press']} {row['error']:.2f} (background {row['still']:.2f})"
            for row in part["again"]
        ),
        pixel=f"{1e3 * fit['pixel']:.4f}",
        made=made(part, {}),
    )


def draw(part: dict[str, Any], figure: Any) -> None:
    """Real and ours, by the real face's slopes and by the channel, as the camera gives them."""
    colours, channel = Colour.read(COEFFICIENTS), Channel(part["fit"]["pixel"])
    balls = {row["press"]: row for row in part["reduced"]["the channel"]}
    presses = held_out()
    for row, press in zip(
        figure.subplots(2, 2 * len(presses), squeeze=False).reshape(-1, 4), presses, strict=True
    ):
        ours = press.picture(colours)
        felt = None
        if ball := balls.get(press.number):
            felt = channel.picture(press, ball["radius"], ball["depth"])
        apart = np.clip(0.5 + 2 * ((ours if felt is None else felt) - press.real), 0, 1)
        shown = {
            f"real press {press.number}": press.real,
            "ours, slopes of the real face": ours,
            "ours, the channel": felt,
            "the channel less real, twice": apart,
        }
        for axis, (word, picture) in zip(row, shown.items(), strict=True):
            axis.set_axis_off()
            if picture is not None:
                axis.imshow(np.round(255 * colour.shown(picture)).astype(np.uint8))
                axis.set_title(word, fontsize=7)
