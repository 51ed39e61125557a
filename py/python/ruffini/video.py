"""Videos of episodes: GIF by the Rust crate, MP4 by ffmpeg."""

from __future__ import annotations

import contextlib
import importlib
import itertools
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ruffini import SimulationError
from ruffini._core import encode_gif
from ruffini._schema import full_id
from ruffini._spaces import RenderFrame, check_writable
from ruffini._words import counted
from ruffini.evaluation import Policy, as_policy

__all__ = ["SIZES", "check", "film", "write"]

SIZES = {".gif": (320, 240), ".mp4": (640, 480)}
"""Width and height of a picture (pixels) by the suffix of the video."""

_GIF_STRIDE = 2
"""A GIF has one of every so many frames, to limit its size."""
_COLORS = 255
"""Largest number of colours of a GIF; one of 256 stands for pixels that do not change."""
_PAUSE = 12
"""Number of frames for which the end of an episode is shown."""


def check(path: str | PathLike[str]) -> Path:
    """Check in advance that a video can be written to `path`, and return it.

    Raises:
        ValueError: If the suffix is unknown, ffmpeg is missing, or the path cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in SIZES:
        raise ValueError(f"video: found {path}, expected a {' or '.join(SIZES)} file")
    if path.suffix.lower() == ".mp4":
        _ffmpeg()
    check_writable("video", path)
    return path


def write(path: str | PathLike[str], frames: Iterable[RenderFrame], rate: int = 25) -> None:
    """Write `frames`, arrays (height, width, 3), at `rate` frames a second.

    Those of an .mp4 file are encoded as they come, those of a .gif file are gathered first.

    Raises:
        OSError: If the file cannot be written, or ffmpeg fails.
    """
    path = Path(path)
    if path.suffix.lower() == ".gif":
        shown = _in_few_colors(list(itertools.islice(frames, 0, None, _GIF_STRIDE)))
        path.write_bytes(encode_gif(shown, max(10, 10 * round(100 * _GIF_STRIDE / rate))))
        return
    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder) / path.name
        _encode(film, frames, rate)
        if not film.exists():
            raise OSError("ffmpeg wrote nothing")
        # By ourselves, for ffmpeg does not say why it cannot.
        path.write_bytes(film.read_bytes())


def _in_few_colors(frames: Sequence[RenderFrame]) -> list[RenderFrame]:
    """Return `frames` in at most `_COLORS` colours, the same in all frames.

    The encoder writes such frames exactly. With colours chosen frame by frame what does not move
    would flicker. Colours are split where they differ most, until there are as many parts as may be
    (variance-based cut; Wan, Prusinkiewicz and Wong, 1990); a part becomes its mean.
    """
    packed = np.stack(frames).astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
    found, places, counts = np.unique(packed, return_inverse=True, return_counts=True)
    colors = np.stack([found >> 16, found >> 8 & 255, found & 255], axis=1).astype(float)
    parts: list[tuple[float, Any]] = []
    split = [np.arange(len(found))]
    while True:
        for part in split:
            mean = np.average(colors[part], axis=0, weights=counts[part])
            spread = counts[part] @ (colors[part] - mean) ** 2
            axis = spread.argmax()
            high = colors[part, axis] > mean[axis]
            parts.append((spread[axis], (part, mean, high)))
        parts.sort(key=lambda each: each[0])
        spread, (part, _, high) = parts[-1]
        if len(parts) == _COLORS or spread == 0.0:
            break
        parts.pop()
        split = [part[high], part[~high]]
    for _, (part, mean, _) in parts:
        colors[part] = mean.round()
    return list(colors.astype(np.uint8)[places.reshape(packed.shape)])


def _encode(path: Path, frames: Iterable[RenderFrame], rate: int = 25) -> None:
    """Have ffmpeg write a video, and print nothing."""
    coming = iter(frames)
    first = next(coming)
    height, width, _ = first.shape
    size = width, height
    writer = _ffmpeg().write_frames(path, size, fps=rate, ffmpeg_log_level="quiet")
    with contextlib.closing(writer):
        with _naming_ffmpeg():
            writer.send(None)
        for frame in itertools.chain([first], coming):
            with _naming_ffmpeg():
                writer.send(np.ascontiguousarray(frame))


@contextlib.contextmanager
def _naming_ffmpeg() -> Iterator[None]:
    """Raise what ffmpeg says without its command line, which follows."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        raise OSError(f"ffmpeg: {str(error).splitlines()[0]}") from None


def film(
    policy: Policy | Callable[[Any], NDArray[np.float32]],
    env_id: str,
    path: str | PathLike[str],
    seeds: Iterable[int],
    **settings: Any,
) -> str:
    """Write a policy's episodes as a video; return a line that describes it.

    Args:
        policy: As for `ruffini.evaluation.evaluate`.
        env_id: Id of the environment, or the name of a built-in task.
        path: A .gif or .mp4 file.
        seeds: Seeds of the episodes.
        **settings: As for ``gymnasium.make``.

    Raises:
        SimulationError: If the video cannot be written.
        TypeError: If `policy` is neither a policy nor a function.
        ValueError: If `path` is no such file, there are no seeds, a setting is invalid, or a model
            is one that `ruffini.evaluation.evaluate` refuses.
    """
    path, seeds = check(path), list(seeds)
    if not seeds:
        raise ValueError("seeds: found none, expected at least one")
    env_id = full_id(env_id)
    size = dict(zip(("width", "height"), SIZES[path.suffix.lower()], strict=True))
    endings: list[str] = []
    with contextlib.closing(gym.make(env_id, render_mode="rgb_array", **size | settings)) as env:
        acting = as_policy(policy, env.observation_space)
        try:
            write(path, _played(acting, env, seeds, endings), env.metadata["render_fps"])
        except OSError as error:
            raise SimulationError(f"video: {path}: {error.strerror or error}") from None
    megabytes = path.stat().st_size / 1e6
    return f"{path}: {counted(len(seeds), 'episode')} ({', '.join(endings)}), {megabytes:.1f} MB"


def _played(
    acting: Policy, env: gym.Env[Any, Any], seeds: Sequence[int], endings: list[str]
) -> Iterator[RenderFrame]:
    """Pictures of a policy's episodes as they are played, with a pause after each."""
    for seed in seeds:
        observation, _ = env.reset(seed=seed)
        yield (picture := _picture(env))
        over, state = False, None
        while not over:
            action, state = acting.predict(_row(observation), state, deterministic=True)
            observation, _, terminated, truncated, info = env.step(action[0])
            yield (picture := _picture(env))
            over = terminated or truncated
        yield from itertools.repeat(picture, _PAUSE)
        endings.append("success" if info["is_success"] else info.get("ending", "failure"))


def _row(observation: Any) -> Any:
    """Batch of one observation."""
    if isinstance(observation, dict):
        return {name: values[None] for name, values in observation.items()}
    return observation[None]


def _picture(env: gym.Env[Any, Any]) -> RenderFrame:
    picture: Any = env.render()
    return np.asarray(picture, np.uint8)


def _ffmpeg() -> Any:
    """Import the module that runs ffmpeg; raise a ``ValueError`` if module or ffmpeg is missing."""
    otherwise = "pip install 'ruffini[video]', or write a .gif"
    try:
        module = importlib.import_module("imageio_ffmpeg")
    except ImportError:
        raise ValueError(f"video: found no imageio-ffmpeg for .mp4: {otherwise}") from None
    try:
        found = shutil.which(module.get_ffmpeg_exe())
    except RuntimeError:
        found = None
    if found is None:
        raise ValueError(f"video: found no ffmpeg for .mp4: {otherwise}")
    return module
