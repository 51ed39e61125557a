"""Fits the colours of a GelSight Mini to 20 real presses; some minutes.

The presses are those of the package `taxim` 1.4.1 (MIT): ``pip download --no-deps taxim==1.4.1``,
then ``python py/reports/colour_fit.py taxim-1.4.1-py3-none-any.whl``. Four presses, drawn before
anything was fitted, are left out of all that is fitted and judge it. Writes the coefficients, the
figures and those four presses to ``tests/reference``.
"""

from __future__ import annotations

import argparse
import io
import json
import zipfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.optimize import least_squares

import colour
import shading
from colour import Array, Colour
from faces import ball_faces, blurred, capped, hertz
from shading import Family, Lights, Pixels
from taxim_table import Table

OUT = Path(__file__).resolve().parents[2] / "tests/reference"
FOLDER = "taxim/calib/gelsight_mini/"
SEED, HELD, FOLDS = 26, 4, 5
PIXEL = 2.95e-5
"""Size of a pixel on the gel (m), from the package's params.json."""
LIT = slice(None, None, 4)
"""Presses from which the lights are found."""
STARTS = (0.3, 1.0, 2.0)
"""Slopes from which the search for the lights starts."""
WINDOW, NEAR, INNER = 110, 40, 24
"""Half of the window around a press, and radii that count as near (pixels)."""
DEGREE, STILL_DEGREE = 6, 6
"""Of the response in the slopes and of the background in the place."""
STEEPEST = 0.75
DIGITS = 5
DEVIATIONS = (0, 1, 2, 3, 4, 5, 6, 8, 10)
"""Standard deviations of the Gaussian that are tried (pixels)."""


@dataclass(frozen=True)
class Data:
    """Pictures (24, along, across, 3) in 0..1, and what the package says about them."""

    still: Array
    pictures: Array
    labels: Array
    """Annotated row, column and radius of contact (24, 3)."""
    table: Table

    @classmethod
    def read(cls, wheel: Path) -> Data:
        """From the package's file."""
        with zipfile.ZipFile(wheel) as archive:

            def stored(name: str) -> dict[str, NDArray]:
                with np.load(io.BytesIO(archive.read(FOLDER + name))) as file:
                    return {key: file[key] for key in file.files if key != "img_size"}

            pack, table = stored("dataPack.npz"), stored("polycalib.npz")
        # Stored in blue, green, red.
        still = pack["f0"][..., ::-1] / 255
        pictures = np.stack([colour.turned(frame[..., ::-1] / 255) for frame in pack["imgs"]])
        middle, radius = pack["touch_center"].astype(float), pack["touch_radius"].astype(float)
        labels = np.column_stack([middle[:, 1], middle[:, 0], radius])
        return cls(colour.turned(still), pictures, labels, Table.read(table, still))

    def brightest(self, number: int) -> Array:
        """Place that a press changes most: a first guess of its middle (x, y) (pixels)."""
        change = gaussian_filter(self.pictures[number] - self.still, (3, 3, 0))
        weight = (change**2).sum(axis=-1)
        weight[weight < 0.05 * weight.max()] = 0
        y, x = np.indices(weight.shape)
        return np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()


@dataclass(frozen=True)
class Press:
    """A press with a face of revolution, in a window around it."""

    real: Array
    still: Array
    x: Array
    y: Array
    """Places as in `colour`."""
    away_x: Array
    away_y: Array
    """From the middle (pixels)."""
    p: Array
    q: Array

    @cached_property
    def distance(self) -> Array:
        """From the middle (pixels)."""
        return np.hypot(self.away_x, self.away_y) + 1e-9

    def with_face(self, steep: Callable[[Array], Array]) -> Press:
        """The same press with another profile."""
        g = np.nan_to_num(steep(self.distance)) / self.distance
        return replace(self, p=g * self.away_x, q=g * self.away_y)

    def thinned(self) -> Press:
        """Every second pixel of each axis, each the mean of four."""

        def mean(a: Array) -> Array:
            n, m = a.shape[0] // 2, a.shape[1] // 2
            return a[: 2 * n, : 2 * m].reshape(n, 2, m, 2, *a.shape[2:]).mean(axis=(1, 3))

        return Press(**{name: mean(getattr(self, name)) for name in self.__dataclass_fields__})


def pressed(data: Data, number: int, place: Array, steep: Callable[[Array], Array]) -> Press:
    """The window around a press whose middle is at a place (x, y), with its profile."""
    i, j = np.round(place[:2]).astype(int)
    at = np.s_[j - WINDOW : j + WINDOW, i - WINDOW : i + WINDOW]
    x, y = (a[at] for a in colour.places(data.still.shape[:2]))
    rows, columns = (a[at].astype(float) for a in np.indices(data.still.shape[:2]))
    away = columns - place[0], rows - place[1]
    empty = np.zeros_like(x)
    one = Press(data.pictures[number][at], data.still[at], x, y, *away, empty, empty)
    return one.with_face(steep)


Sums = tuple[Array, Array]
"""Normal equations of a fit of the response."""


def columns_of(press: Press, terms: Array) -> Array:
    """Terms at each pixel (..., K)."""
    p, q = colour.shortened(press.p, press.q, STEEPEST)
    return colour.monomials(terms, p, q, press.x, press.y)


def sums(press: Press, columns: Array) -> Sums:
    """Of one press; a pixel weighs one over the root of its distance from the middle.

    So steep slopes, of which there are few pixels, count more than their share.
    """
    columns = columns.reshape(-1, columns.shape[-1])
    change = (press.real - press.still).reshape(-1, 3)
    weighted = columns / np.sqrt(np.maximum(press.distance, 3)).reshape(-1, 1)
    return weighted.T @ columns, weighted.T @ change


def solved(parts: Iterable[Sums]) -> Array:
    """Response (K, 3), with a millionth of ridge on scaled terms."""
    left, right = (sum(some) for some in zip(*parts, strict=True))
    size = np.sqrt(np.diag(left))
    scaled = left / np.outer(size, size) + 1e-6 * np.eye(len(size))
    return np.linalg.solve(scaled, right / size[:, None]) / size[:, None]


def change(press: Press, terms: Array, response: Array) -> Array:
    """Change of the background by the response (..., 3)."""
    return columns_of(press, terms) @ response


def with_place(slopes: int, with_place: int, place: int) -> list[tuple[int, ...]]:
    """Exponents: slopes to one degree, and to another degree times the place."""
    still = [(a, b, 0, 0) for a, b in colour.degrees(2, 1, slopes)]
    moved = [
        (*one, *two)
        for one in colour.degrees(2, 1, with_place)
        for two in colour.degrees(2, 1, place)
    ]
    return still + moved if place else still


CHOICES = [(n, 0, 0) for n in range(1, 9)] + [(3, 3, 1), (4, 2, 1), (5, 2, 2)]
"""Degrees that are compared, as in `with_place`."""


def compared(presses: dict[int, Press], series: list[list[int]]) -> list[dict[str, Any]]:
    """Errors of each choice of exponents: fitted, on folds left out, on series left out.

    The presses are thinned; errors are of 255.
    """
    drawn = np.random.default_rng(SEED).permutation(list(presses))
    folds = [[int(k) for k in drawn[i::FOLDS]] for i in range(FOLDS)]
    rows = []
    for choice in CHOICES:
        terms = np.array(with_place(*choice))
        columns = {k: columns_of(press, terms) for k, press in presses.items()}
        parts = {k: sums(press, columns[k]) for k, press in presses.items()}

        def errors(
            group: list[int], without: bool, columns: Any = columns, parts: Any = parts
        ) -> list[float]:
            used = [part for k, part in parts.items() if not (without and k in group)]
            response = solved(used)
            return [
                255 * float(np.abs(columns[k] @ response + one.still - one.real).mean())
                for k, one in ((k, presses[k]) for k in group)
            ]

        names = ("slopes", "slopes with place", "place")
        rows.append(
            dict(zip(names, choice, strict=True))
            | {"terms": len(terms), "fitted": float(np.mean(errors(list(presses), False)))}
            | {
                name: float(np.mean([one for group in groups for one in errors(group, True)]))
                for name, groups in (("folds", folds), ("series", series))
            }
        )
        print(rows[-1], flush=True)
    return rows


def scale_check(lights: Lights, seen: list[Pixels], faces: list[tuple[Array, Array]]) -> list[Any]:
    """Cost of the best lights if all slopes are scaled, over that of the slopes found."""

    def cost(factor: float) -> float:
        def residual(t: Array) -> Array:
            other = Lights(t[:9].reshape(3, 3), t[9:12], np.exp(t[12:]))
            fits = [
                shading._residual(other, one, middle, factor * profile)
                for one, (middle, profile) in zip(seen, faces, strict=True)
            ]
            return np.concatenate(fits)

        tilted = np.log(lights.tangent * factor)
        start = np.concatenate([(lights.strength / factor).reshape(-1), lights.azimuth, tilted])
        return float(
            least_squares(residual, start, x_scale="jac", loss="soft_l1", max_nfev=25).cost
        )

    costs = {factor: cost(factor) for factor in (0.5, 0.8, 1.0, 1.25, 2.0)}
    return [{"factor": factor, "cost": value / costs[1.0]} for factor, value in costs.items()]


def best_of_family(
    presses: dict[int, Press],
    faces: list[Callable[[Array], Array]],
    terms: Array,
    response: Array | None,
) -> tuple[dict[int, int], Array, float]:
    """Face of each press among some, the response (fitted in turn if not given), the error.

    The error is of thinned windows, weighted as in a fit.
    """
    small = {k: press.thinned().thinned() for k, press in presses.items()}
    columns = {
        k: [columns_of(press.with_face(face), terms) for face in faces]
        for k, press in small.items()
    }
    weights = {k: 1 / np.sqrt(np.maximum(press.distance, 3)) for k, press in small.items()}
    chosen = dict.fromkeys(presses, len(faces) // 2)
    fixed = response
    for _ in range(1 if fixed is not None else 6):
        if fixed is None:
            response = solved(sums(small[k], columns[k][at]) for k, at in chosen.items())
        errors = {
            k: [
                float(
                    (
                        np.abs(one @ response - small[k].real + small[k].still).mean(axis=-1)
                        * weights[k]
                    ).sum()
                    / weights[k].sum()
                )
                for one in columns[k]
            ]
            for k in presses
        }
        chosen = {k: int(np.argmin(some)) for k, some in errors.items()}
    assert response is not None
    total = float(np.mean([errors[k][at] for k, at in chosen.items()]))
    return chosen, response, 255 * total


def judged(picture: Array, press: Press) -> dict[str, float]:
    """Errors (of 255) and structural similarity in the window and near the middle."""
    apart = 255 * np.abs(picture - press.real).mean(axis=-1)
    alike = colour.similarity(picture, press.real)
    near = press.distance < NEAR
    return {
        "window": float(apart.mean()),
        "near": float(apart[near].mean()),
        "similarity": float(alike.mean()),
        "similarity near": float(alike[near].mean()),
    }


def other_faces(
    train: dict[int, Press], held: dict[int, Press], terms: Array
) -> tuple[dict[str, Any], dict[str, dict[int, Array]]]:
    """A ball's cap with a flat face, and with Hertz's, outside contact: settings and pictures."""
    radii, deviations = (14.0, 18.0, 24.0, 58.0), (0.0, 4.0, 8.0)
    contacts = np.arange(4.0, 61.0, 4.0)
    settings, pictures = {}, {}
    some = {k: train[k] for k in list(train)[::3]}
    for name, face in (("flat outside", capped), ("Hertz outside", hertz)):

        def faces(
            radius: float, deviation: float, face: Any = face
        ) -> list[Callable[[Array], Array]]:
            usable = contacts[contacts < 0.95 * radius]
            return [blurred(lambda r, a=a: face(r, radius, a), deviation) for a in usable]

        tried = [
            (best_of_family(some, faces(radius, deviation), terms, None)[2], radius, deviation)
            for radius in radii
            for deviation in deviations
        ]
        least, radius, deviation = min(tried)
        shapes = faces(radius, deviation)
        _, response, _ = best_of_family(train, shapes, terms, None)
        chosen, _, _ = best_of_family(held, shapes, terms, response)
        settings[name] = {"radius": radius, "deviation": deviation, "fitted": least}
        print(name, settings[name], flush=True)
        pictures[name] = {
            k: press.still + change(press.with_face(shapes[chosen[k]]), terms, response)
            for k, press in held.items()
        }
    return settings, pictures


def taxim(data: Data, places: Array, numbers: list[int], held: list[int], family: Family) -> Any:
    """Frames of held presses by Taxim's table, with its own faces and with ours.

    The ball's radius, which is not in the package, and a factor of our slopes are those that fit
    the presses `numbers` best; the table itself was fitted by its authors to all presses.
    """

    def own(k: int, radius: float) -> Array:
        return data.table.ball(*data.labels[k, :2], radius, data.labels[k, 2])

    def ours(k: int, factor: float) -> Array:
        rows, columns = (a.astype(float) for a in np.indices(data.still.shape[:2]))
        x, y = columns - places[k, 0], rows - places[k, 1]
        r = np.hypot(x, y) + 1e-9
        g = factor * np.nan_to_num(shading.smooth(family.profile(places[k, 2]))(r)) / r
        # Rows of a frame run along -x, its columns along y.
        return data.table.picture(-colour.shown(g * x), colour.shown(g * y))

    found = {}
    cases = (
        ("Taxim", own, (20.0, 30.0, 40.0, 58.0, 68.0, 80.0)),
        ("Taxim, our faces", ours, (0.5, 0.75, 1.0, 1.25, 1.5, 2.0)),
    )
    for name, make, values in cases:
        best: dict[str, tuple[float, float]] = {}
        for value in values:
            frames = {k: make(k, value) for k in numbers[::6]}
            for kind, taken in (("", False), (", flat taken off", True)):
                errors = []
                for k, frame in frames.items():
                    i, j = np.round(places[k, :2]).astype(int)
                    at = np.s_[j - WINDOW : j + WINDOW, i - WINDOW : i + WINDOW]
                    seen = data.table.flat_taken_off(frame) if taken else frame
                    errors.append(
                        255 * np.abs(colour.turned(seen)[at] - data.pictures[k][at]).mean()
                    )
                tried = (float(np.mean(errors)), value)
                best[kind] = min(best.get(kind, tried), tried)
        for kind, (least, value) in best.items():
            frames = {k: make(k, value) for k in held}
            if kind:
                frames = {k: data.table.flat_taken_off(frame) for k, frame in frames.items()}
            pictures = {k: colour.turned(frame) for k, frame in frames.items()}
            found[name + kind] = {"value": value, "fitted": least, "pictures": pictures}
            print(name + kind, value, least, flush=True)
    return found


def background(still: Array) -> tuple[Array, Array]:
    """Exponents (B, 2) and coefficients (B, 3) of the still picture."""
    terms = np.array(colour.degrees(2, 0, STILL_DEGREE))
    x, y = (a[::2, ::2].reshape(-1) for a in colour.places(still.shape[:2]))
    columns = colour.monomials(terms, x, y)
    return terms, np.linalg.lstsq(columns, still[::2, ::2].reshape(-1, 3), rcond=None)[0]


def rounded(values: Array) -> Array:
    """Values with `DIGITS` significant digits."""
    return np.vectorize(lambda v: float(f"{v:.{DIGITS}g}"))(values)


def smoothing(train: dict[int, Press], terms: Array, response: Array) -> list[dict[str, Any]]:
    """Errors of presses whose face is that of our finite elements, by Gaussian and ball.

    The depth of each is the one with the least weighted error; `near` is its error within `INNER`.
    """
    some = {k: train[k] for k in list(train)[::3]}
    thin = {k: press.thinned() for k, press in some.items()}
    rows = []
    for radius in (16.0, 18.0, 20.0, 22.0, 24.0):
        faces = ball_faces(radius)
        for deviation in DEVIATIONS:
            shapes = [blurred(face, deviation, slope=False) for face in faces]
            chosen, _, least = best_of_family(some, shapes, terms, response)
            near = []
            for k, at in chosen.items():
                press = thin[k].with_face(shapes[at])
                apart = np.abs(press.still + change(press, terms, response) - press.real)
                near.append(255 * float(apart[press.distance < INNER].mean()))
            row = {"radius": radius, "deviation": deviation, "error": least}
            rows.append(row | {"near": float(np.mean(near))})
    return rows


def toml(shipped: Colour, deviation: float) -> str:
    """The table of a sensor's file."""

    def lines(rows: Array) -> str:
        inner = "".join(f"    [{', '.join(f'{v:.{DIGITS}g}' for v in row)}],\n" for row in rows)
        return f"[\n{inner}]"

    def exponents(rows: Array) -> str:
        return f"[{', '.join(str([int(v) for v in row]) for row in rows)}]"

    return f"""# Colours of a GelSight Mini, made by: python py/reports/colour_fit.py
[camera.image]
background_terms = {exponents(shipped.background_terms)}
background = {lines(shipped.background)}
terms = {exponents(shipped.terms)}
response = {lines(shipped.response)}
steepest = {shipped.steepest}
smoothing = {deviation:.1e}
source = "20 presses of one GelSight Mini in taxim 1.4.1 (MIT), py/reports/colour_fit.py"
"""


def main() -> None:
    """Fits, judges and writes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("wheel", type=Path, help="taxim-1.4.1-py3-none-any.whl")
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args()
    data = Data.read(options.wheel)
    count = len(data.pictures)
    held = sorted(int(k) for k in np.random.default_rng(SEED).choice(count, HELD, replace=False))
    numbers = [k for k in range(count) if k not in held]
    guesses = np.array([data.brightest(k) for k in range(count)])
    seen = [shading.pixels(data.pictures[k], data.still, guesses[k]) for k in range(count)]

    lit = numbers[LIT]
    tries = [shading.lights_of([seen[k] for k in lit], guesses[lit], start) for start in STARTS]
    least = int(np.argmin([one[2] for one in tries]))
    lights = tries[least][0]
    peaks = [float(profiles.max(axis=1).mean()) for _, profiles, _ in tries]
    free = {k: shading.profile_of(lights, seen[k], guesses[k]) for k in numbers}
    checks = scale_check(lights, [seen[k] for k in lit], [free[k] for k in lit])
    family = Family.of(np.array([profile for _, profile in free.values()]))
    places = np.array(
        [
            shading.placed(lights, seen[k], family, np.array([*guesses[k], family.middle]))
            for k in range(count)
        ]
    )
    presses = {
        k: pressed(data, k, places[k], shading.smooth(family.profile(places[k, 2])))
        for k in range(count)
    }
    train = {k: presses[k] for k in numbers}
    judges = {k: presses[k] for k in held}
    # Three series of growing depth at three places.
    series = [
        [k for k in numbers if low <= k < high] for low, high in ((0, 13), (13, 18), (18, 24))
    ]
    thin = {k: press.thinned() for k, press in train.items()}
    choices = compared(thin, series)

    terms = np.array(with_place(DEGREE, 0, 0))
    response = solved(sums(press, columns_of(press, terms)) for press in thin.values())
    still_terms, still = background(data.still)
    exact = Colour(still_terms, still, terms, response, STEEPEST)
    shipped = replace(exact, background=rounded(still), response=rounded(response))
    tried = smoothing(train, terms, response)
    best = min(tried, key=lambda row: row["near"])

    settings, pictures = other_faces(train, judges, terms)
    table = taxim(data, places, numbers, held, family)
    x, y = colour.places(data.still.shape[:2])
    rows, frames = [], {}
    for k, press in judges.items():
        i, j = np.round(places[k, :2]).astype(int)
        at = np.s_[j - WINDOW : j + WINDOW, i - WINDOW : i + WINDOW]
        flat = np.zeros_like(press.x)
        made = {
            "background": shipped.picture(press.x, press.y, flat, flat),
            "ours": shipped.picture(press.x, press.y, press.p, press.q),
            **{name: np.clip(some[k], 0, 1) for name, some in pictures.items()},
            **{name: one["pictures"][k][at] for name, one in table.items()},
        }
        whole = shipped.picture(x, y, np.zeros_like(x), np.zeros_like(x))
        frames = {"background": whole.copy(), "ours": whole.copy()}
        frames["ours"][at] = made["ours"]
        frames |= {name: one["pictures"][k] for name, one in table.items()}
        real = data.pictures[k]
        for name, picture in made.items():
            row = {"press": k, "picture": name, **judged(picture, press)}
            if name in frames:
                row["frame"] = 255 * float(np.abs(frames[name] - real).mean())
                row["similarity frame"] = float(colour.similarity(frames[name], real).mean())
            rows.append(row)
    loss = max(
        float(
            255
            * np.abs(
                exact.picture(press.x, press.y, press.p, press.q)
                - shipped.picture(press.x, press.y, press.p, press.q)
            ).max()
        )
        for press in judges.values()
    )
    far = np.abs(data.pictures[numbers] - data.still)[:, :150].mean()
    apart = np.hypot(479 - data.labels[:, 0] - places[:, 0], data.labels[:, 1] - places[:, 1])
    figures = {
        "held": held,
        "seed": SEED,
        "pixel": PIXEL,
        "lights": {
            "presses": lit,
            "steepest by start": dict(zip(map(str, STARTS), peaks, strict=True)),
            "error": 255 * tries[least][2],
            "azimuth": np.degrees(lights.azimuth).tolist(),
            "elevation": np.degrees(np.arctan(lights.tangent)).tolist(),
            "scale": checks,
        },
        "places": {
            "x": [float(places[:, 0].min()), float(places[:, 0].max())],
            "y": [float(places[:, 1].min()), float(places[:, 1].max())],
            "depth": [float(places[:, 2].min()), float(places[:, 2].max())],
            "label apart": {"median": float(np.median(apart)), "max": float(apart.max())},
            "label radius": [float(data.labels[:, 2].min()), float(data.labels[:, 2].max())],
        },
        "noise": 255 * float(far),
        "choices": choices,
        "smoothing": tried,
        "faces": settings,
        "table": {name: {k: one[k] for k in ("value", "fitted")} for name, one in table.items()},
        "rounding": loss,
        "presses": rows,
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "gelsight_image.json").write_text(json.dumps(figures, indent=1) + "\n")
    deviation = float(f"{best['deviation'] * PIXEL:.1e}")
    (options.out / "gelsight_image.toml").write_text(toml(shipped, deviation))
    small = {
        k: np.round(255 * press.thinned().real).astype(np.uint8) for k, press in judges.items()
    }
    np.savez_compressed(
        options.out / "gelsight_presses.npz",
        numbers=np.array(held),
        pictures=np.stack([small[k] for k in held]),
        places=places[held][:, :2].astype(np.float32),
        distances=shading.NODES,
        slopes=np.stack(
            [np.concatenate([[0], family.profile(places[k, 2]), [0]]) for k in held]
        ).astype(np.float32),
        still=np.round(255 * data.still[::4, ::4]).astype(np.uint8),
    )


if __name__ == "__main__":
    main()
