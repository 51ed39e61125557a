"""Videos of episodes: GIF by the Rust crate, MP4 by ffmpeg."""

from __future__ import annotations

import importlib
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from ruffini import SimulationError
from ruffini._core import encode_gif
from ruffini._spaces import Frame, check_writable
from ruffini.evaluation import Policy

__all__ = ["SIZES", "check", "film", "write"]

SIZES = {".gif": (320, 240), ".mp4": (640, 480)}
"""Width and height of a picture (pixels) by the suffix of the video."""

_GIF_STRIDE = 2
"""A GIF has one of every so many frames, to limit its size."""
_PAUSE = 12
"""Number of frames for which the end of an episode is shown."""


def check(path: Path) -> None:
    """Check in advance that a video can be written to `path`.

    Raises:
        ValueError: If the suffix is unknown, ffmpeg is missing, or the path cannot be written.
    """
    if path.suffix not in SIZES:
        raise ValueError(f"video: found {path}, expected a {' or '.join(SIZES)} file")
    if path.suffix == ".mp4":
        _ffmpeg()
    check_writable("video", path)


def write(path: Path, frames: Sequence[Frame], rate: int = 25) -> None:
    """Write `frames`, arrays (height, width, 3), at `rate` frames a second.

    Raises:
        OSError: If the file cannot be written, or ffmpeg fails.
    """
    if path.suffix == ".gif":
        path.write_bytes(encode_gif(frames[::_GIF_STRIDE], _GIF_STRIDE * 1000 // rate))
        return
    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder) / path.name
        try:
            _encode(film, frames, rate)
        except (OSError, RuntimeError) as error:
            # What follows is the command line of ffmpeg.
            raise OSError(f"ffmpeg: {str(error).splitlines()[0]}") from None
        if not film.exists():
            raise OSError("ffmpeg wrote nothing")
        # By ourselves, for ffmpeg does not say why it cannot.
        path.write_bytes(film.read_bytes())


def _encode(path: Path, frames: Sequence[Frame], rate: int = 25) -> None:
    """Have ffmpeg write a video, and print nothing."""
    height, width, _ = frames[0].shape
    size = width, height
    writer = _ffmpeg().write_frames(path, size, fps=rate, ffmpeg_log_level="quiet")
    writer.send(None)
    for frame in frames:
        writer.send(np.ascontiguousarray(frame))
    writer.close()


def film(policy: Policy, env_id: str, path: Path, seeds: range, **settings: Any) -> str:
    """Write a policy's episodes of these seeds as a video; return a line that describes it.

    Raises:
        SimulationError: If the video cannot be written.
    """
    size = dict(zip(("width", "height"), SIZES[path.suffix], strict=True))
    env = gym.make(env_id, render_mode="rgb_array", **size | settings)
    frames: list[Frame] = []
    endings = []
    for seed in seeds:
        observation, _ = env.reset(seed=seed)
        frames.append(_picture(env))
        over, state = False, None
        while not over:
            action, state = policy.predict(_row(observation), state, deterministic=True)
            observation, _, terminated, truncated, info = env.step(action[0])
            frames.append(_picture(env))
            over = terminated or truncated
        frames += frames[-1:] * _PAUSE
        endings.append("success" if info["is_success"] else info.get("ending", "failure"))
    try:
        write(path, frames, env.metadata["render_fps"])
    except OSError as error:
        raise SimulationError(f"video: {path}: {error.strerror or error}") from None
    megabytes = path.stat().st_size / 1e6
    return f"{path}: {len(seeds)} episodes ({', '.join(endings)}), {megabytes:.1f} MB"


def _row(observation: Any) -> Any:
    """Batch of one observation."""
    if isinstance(observation, dict):
        return {name: values[None] for name, values in observation.items()}
    return observation[None]


def _picture(env: gym.Env[Any, Any]) -> Frame:
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
