"""Spaces, rendering and input checks of single and vectorised environments."""

from __future__ import annotations

import difflib
import os
import shutil
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from gymnasium.error import ClosedEnvironmentError
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray

from ruffini._core import CAMERAS, Batch
from ruffini._schema import DRAWS, SETTINGS, control_period
from ruffini._words import nearest

Observation = NDArray[np.float32] | dict[str, NDArray[np.float32]]
"""A flat vector, or one vector per channel."""

RenderFrame = NDArray[np.uint8]
"""A picture (height, width, 3)."""

Camera = str | Mapping[str, Any]
"""A name, or a mapping with ``position``, ``target`` (m) and maybe ``field_of_view`` (rad)."""

Layout = Sequence[tuple[str, list[tuple[str, list[float], list[float], str]]]]
"""Channels with their components: name, lower bounds, upper bounds, unit."""

ACTION_SIZE = 5
MOST_ENVIRONMENTS = 1_000_000
MOST_THREADS = 1024
MOST_STEPS = 10**12
NO_LIMIT = 1_000_000

_FIELD_OF_VIEW = 0.6
"""Field of view of a camera that has none, from top to bottom of the picture (rad)."""
_FARTHEST = 20.0
"""Largest coordinate of a camera (m): no more of the scene is drawn from farther away."""

RENDER_MODES = ["rgb_array"]

_LARGEST = float(np.finfo(np.float32).max)
"""Largest finite number of an action; larger ones count as this one."""

_WINDOW = (
    'gymnasium.make(..., render_mode="human") shows a window, with pip install "ruffini[human]"'
)


_UNSEEN = (
    "no display was found, so the window is drawn off screen and nobody sees it: film with "
    '`ruffini play --video lift.gif` or render_mode="rgb_array", or write a page with '
    "`ruffini view --out page.html` (SDL_VIDEODRIVER=dummy if no window is meant to be seen)"
)


def warn_of_unseen_window() -> None:
    """Warn if Gymnasium's window is drawn off screen without ``SDL_VIDEODRIVER`` asking for it.

    SDL, with which pygame opens windows, says nothing where it finds no display.
    """
    display = getattr(sys.modules.get("pygame"), "display", None)
    if display is None or not display.get_init() or "SDL_VIDEODRIVER" in os.environ:
        return
    if display.get_driver() == "offscreen":
        warnings.warn(_UNSEEN, UserWarning, stacklevel=3)


def metadata(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Gymnasium's metadata of an environment with these settings: a frame for each step."""
    return {"render_modes": RENDER_MODES, "render_fps": round(1 / control_period(settings))}


class Spaces:
    """Spaces of one environment, and extraction of observations from a matrix of all channels.

    `observed` names the channels that the agent sees, the first of the layout; all by default.
    """

    def __init__(self, layout: Layout, obs: str, observed: Sequence[str] | None = None) -> None:
        if obs not in ("dict", "flat"):
            raise ValueError(f"obs: found {obs!r}, expected 'dict' or 'flat'")
        self.action = Box(-1.0, 1.0, (ACTION_SIZE,), np.float32)
        boxes: dict[str, Box] = {}
        self._slices: dict[str, slice] = {}
        start = 0
        for channel, components in layout:
            low = np.concatenate([np.array(c[1], np.float32) for c in components])
            high = np.concatenate([np.array(c[2], np.float32) for c in components])
            if observed is None or channel in observed:
                boxes[channel] = Box(low, high, dtype=np.float32)
                self._slices[channel] = slice(start, start + len(low))
            start += len(low)
        # Channels that are not observed come last.
        self.size = sum(box.shape[0] for box in boxes.values())
        self._all = self.size == start
        self._flat = obs == "flat"
        self.observation: Box | Dict
        if self._flat:
            low = np.concatenate([box.low for box in boxes.values()])
            high = np.concatenate([box.high for box in boxes.values()])
            self.observation = Box(low, high, dtype=np.float32)
        else:
            self.observation = Dict(boxes)  # type: ignore[arg-type]

    def cut(self, values: NDArray[np.float32]) -> Observation:
        """Observation from `values`, whose last axis holds all channels in a row."""
        if self._flat:
            return values if self._all else values[..., : self.size].copy()
        return {name: values[..., part].copy() for name, part in self._slices.items()}


class Renderer:
    """Renderer of pictures of one size, from one camera if no other is asked for."""

    def __init__(self, mode: str | None, width: int, height: int, camera: Camera) -> None:
        if mode is not None and mode not in RENDER_MODES:
            hint = f"; {_WINDOW}" if mode == "human" else ""
            raise ValueError(f"render_mode: found {mode!r}, expected None or 'rgb_array'{hint}")
        for name, pixels in (("width", width), ("height", height)):
            if not (isinstance(pixels, (int, np.integer)) and 16 <= pixels <= 4096):
                raise ValueError(f"{name}: found {pixels!r}, expected 16 to 4096 pixels")
        self.mode, self.width, self.height = mode, int(width), int(height)
        self.camera = as_camera(camera)

    def draw(self, batch: Batch, row: int, camera: Camera | None = None) -> RenderFrame:
        return batch.render(row, self.width, self.height, self.view(camera))

    def view(self, camera: Camera | None) -> str | tuple[list[float], list[float], float]:
        """The usual camera, or another one; a ``ValueError`` if there is no such camera."""
        return self.camera if camera is None else as_camera(camera)


def as_camera(camera: Camera) -> str | tuple[list[float], list[float], float]:
    """Name of a camera, or its position, target and field of view.

    Raises:
        ValueError: If there is no such camera.
    """
    pose: dict[str, Any] = {"position": None, "target": None, "field_of_view": _FIELD_OF_VIEW}
    if isinstance(camera, str) and camera in CAMERAS:
        return camera
    if not isinstance(camera, Mapping):
        near = nearest(camera, CAMERAS) if isinstance(camera, str) else ","
        expected = f"one of {', '.join(CAMERAS)}, or a mapping with {', '.join(pose)}"
        raise ValueError(f"camera: found {camera!r}{near} expected {expected}")
    for name in camera:
        if name not in pose:
            near = nearest(str(name), pose)
            raise ValueError(f"camera: found {name!r}{near} expected {', '.join(pose)}")
    given = pose | dict(camera)
    position, target = _point("position", given["position"]), _point("target", given["target"])
    if position == target:
        raise ValueError(f"camera.target: found {target}, expected another point than the position")
    angle = given["field_of_view"]
    if not (isinstance(angle, (int, float, np.number)) and 0.01 < angle < 3.0):
        raise ValueError(f"camera.field_of_view: found {angle!r}, expected 0.01 to 3 rad")
    return position, target, float(angle)


def _point(name: str, value: Any) -> list[float]:
    """Convert a point of a camera to floats, or raise a ``ValueError``."""
    try:
        point = np.asarray(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        point = np.empty(0)
    if point.shape != (3,) or not (np.abs(point) < _FARTHEST).all():
        expected = f"three numbers within {_FARTHEST:g} m of the origin"
        raise ValueError(f"camera.{name}: found {value!r}, expected {expected}")
    return [float(x) for x in point]


def is_whole(number: Any) -> bool:
    """Returns whether it is a whole number of Python or NumPy."""
    return isinstance(number, (int, np.integer)) and not isinstance(number, bool)


def check_count(name: str, count: Any, most: int = MOST_ENVIRONMENTS) -> None:
    """Raise a ``ValueError`` unless `count` is a whole number from 1 to `most`."""
    if not (is_whole(count) and 1 <= count <= most):
        expected = f"a whole number from 1 to {most}"
        raise ValueError(f"{name}: found {count!r}, expected {expected}")


def check_seed(seed: Any) -> None:
    """Raise a ``ValueError`` unless `seed` is a whole number with room for a seed per row."""
    if not (is_whole(seed) and 0 <= seed < 2**63):
        raise ValueError(f"seed: found {seed!r}, expected a whole number from 0 below 2**63")


def check_writable(name: str, path: Path) -> None:
    """Raise a ``ValueError`` unless a file can be written at `path`; leave none behind."""
    there = path.exists()
    try:
        path.open("ab").close()
    except OSError as error:
        hint = "" if path.parent.exists() else f"; make the folder {path.parent} first"
        raise ValueError(f"{name}: {path}: {error.strerror}{hint}") from None
    if not there:
        path.unlink()


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Raise a ``ValueError`` that names the file where writing to `path` fails."""
    try:
        yield
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror or error}") from None


def replace_file(path: Path, content: str | bytes) -> None:
    """Write a file beside it and put it in its place, so that what is there stays whole.

    Raises:
        ValueError: If it cannot be written.
    """
    data = content.encode() if isinstance(content, str) else content
    with writing(path):
        if path.exists() and not path.is_file():
            path.write_bytes(data)  # /dev/stdout or the like
            return
        target = path.resolve()
        new = target.with_name(f".{target.name}.{os.getpid()}.new")
        try:
            new.write_bytes(data)
            if target.exists():
                shutil.copymode(target, new)
            new.replace(target)
        finally:
            new.unlink(missing_ok=True)


def check_options(options: Any, known: Sequence[str] = ()) -> None:
    """Raise a ``ValueError`` unless `options` is ``None`` or a mapping of `known` names."""
    if options is not None and not isinstance(options, Mapping):
        raise ValueError(f"options: found {options!r}, expected a mapping or None")
    for name in options or ():
        if name not in known:
            near = difflib.get_close_matches(str(name), [*known, *SETTINGS, "seed"], 1)
            hint = f"; did you mean {near[0]!r}, {_place(near[0], known)}?" if near else ""
            hint = f"; it is {_place(name, known)}" if name in near else hint
            if name in DRAWS:
                place = hint if name in near else ""
                hint = f"{place}; a start is chosen by the method `draw` of a ruffini.custom.Task"
            expected = f"one of {', '.join(known)}" if known else "none"
            raise ValueError(f"options: found {name!r}, expected {expected}{hint}")


def _place(name: str, known: Sequence[str]) -> str:
    """Name the place where an option or setting is given."""
    if name in known:
        return "an option"
    return "an argument of reset" if name == "seed" else "a setting of the environment"


def check_open(batch: Batch, what: str) -> None:
    """Raise gymnasium's error if `what` was asked of an environment that is closed."""
    if isinstance(batch, ClosedBatch):
        getattr(batch, what)


class ClosedBatch:
    """Batch of a closed environment: it holds no memory, and every use of it is an error."""

    def __getattr__(self, name: str) -> NoReturn:
        asked = {"save": "state", "load": "set_state", "layout": "channels"}.get(name, name)
        raise ClosedEnvironmentError(f"{asked}: found a closed environment, expected an open one")


def as_actions(actions: Any, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Convert `actions` to floats of that shape, or raise a ``ValueError`` that shows them."""
    try:
        given = np.asarray(actions)
        if given.dtype.kind not in "fiub":
            raise TypeError(f"of type {given.dtype}")
        wide = given.astype(np.float64)
        np.clip(wide, -_LARGEST, _LARGEST, out=wide, where=np.isfinite(wide))
        array = wide.astype(np.float32)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"actions: found {actions!r}, expected numbers ({error})") from None
    if array.shape != shape:
        raise ValueError(f"actions: found shape {array.shape}, expected {shape}")
    return array
