"""Films and pictures of tasks: episodes of the agents of the package, seen from nearby.

Filmed are, of the evaluation seeds in order, the first episodes that succeed and whose objects
differ. They are played twice, for a camera that follows the hand smoothly must know where it goes.
The camera turns with the hand, so as to see between the fingers, and is the nearer the nearer the
hand is to the object. `page` is a picture of what `ruffini view` writes, in Chromium.
"""

from __future__ import annotations

import itertools
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from PIL import Image

from ruffini import TASKS, video, viewing
from ruffini._core import CAMERAS
from ruffini.agents import Agent, load
from ruffini.commands import view
from ruffini.commands.policy import choose
from ruffini.evaluation import FIRST_SEED

FILM, PICTURE = (480, 360), (320, 240)
"""Width and height (pixels)."""
COUNT = {"GraspLift": 3}
"""Episodes of a film; 2 if not given."""
AFTER, PAUSE = 6, 14
"""Steps that are shown after the first with success, and how often the last is repeated."""

VIEWED, VIEWED_STEP = "GraspFragile", 40
"""Task and step in the picture of a page."""
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
DRAWN = ["--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
DRAWN += ["--window-size=1280,800", "--virtual-time-budget=8000"]
"""Options of Chromium: no GPU, size of the window, time (ms) until it is pictured."""
CROPPED = (0, 55, 1280, 710)
"""Part of the window that is kept, without the bar of the player (pixels)."""
NO_NOTES = "<style>.mantine-Notifications-root { display: none }</style></head>"
"""Hides the note that the page is drawn without a GPU."""

AZIMUTH, ELEVATION = np.radians(-60.0), np.radians(28.0)
"""Direction of the camera from the object, from that of the grip and over the table (rad)."""
NEAR = 0.26
"""Distance of the camera from a held object (m)."""
RECEDES = 1.5
"""Growth of that distance with the distance of the hand."""
MIDDLE = np.array([0.032, 0.0, 0.034])
"""Middle of the picture from that of the object: to the right, forward and upward (m). The inset of
touch is at the right, the palm over the object."""
FIELD_OF_VIEW = 0.65
SMOOTH = 4.0
"""Deviation of the weights with which the camera's path is smoothed (steps)."""
STILL = ("HoldStill", "InsertPeg")
"""Tasks whose motion is small: the camera stands still."""


@dataclass
class Episode:
    """An episode that succeeded, up to `AFTER` steps later."""

    seed: int
    actions: list[np.ndarray]
    looks: list[dict[str, Any]]
    """`look` of the environment before each action, and at the end."""


def made(task: str, agent: Agent, **picture: Any) -> Any:
    """Environment of the agent."""
    return gymnasium.make(f"ruffini/{task}-v0", **agent.settings, **picture)


def played(env: Any, agent: Agent, seed: int) -> Episode | None:
    """Episode of that seed; `None` if it fails."""
    observation, _ = env.reset(seed=seed)
    episode, over, after = Episode(seed, [], [env.unwrapped.look()]), False, 0
    while not over and after <= AFTER:
        rows = {name: values[None] for name, values in observation.items()}
        action = agent.predict(rows, deterministic=True)[0][0]
        observation, _, terminated, truncated, info = env.step(action)
        episode.actions.append(action)
        episode.looks.append(env.unwrapped.look())
        over, after = terminated or truncated, after + (after > 0 or info["is_success"])
    return episode if info["is_success"] else None


def shown(task: str, agent: Agent) -> list[Episode]:
    """First episodes of the evaluation seeds that succeed, with different objects."""
    env, found = made(task, agent), {}
    for seed in itertools.count(FIRST_SEED):
        env.reset(seed=seed)
        thing = env.unwrapped.look()["object"]
        episode = None if thing in found else played(env, agent, seed)
        if episode is not None:
            print(f"{task}, seed {seed}: {thing}, {len(episode.actions)} steps")
            found[thing] = episode
        if len(found) == COUNT.get(task, 2):
            break
    return list(found.values())


def smooth(path: np.ndarray) -> np.ndarray:
    """Path (N, ...) with its rows smoothed by Gaussian weights."""
    steps = np.arange(len(path))
    weights = np.exp(-0.5 * ((steps[:, None] - steps) / SMOOTH) ** 2)
    return (weights / weights.sum(axis=1, keepdims=True)) @ path


def camera(middle: np.ndarray, apart: float, yaw: float) -> dict[str, Any]:
    """Pose of the camera for an object and a hand with that middle, distance and yaw."""
    angle = yaw + AZIMUTH
    level, up = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([0.0, 0.0, 1.0])
    target = middle + MIDDLE @ [np.cross(up, level), -level, up]
    back = np.cos(ELEVATION) * level + np.sin(ELEVATION) * up
    eye = target + (NEAR + RECEDES * apart) * back
    return {"position": eye, "target": target, "field_of_view": FIELD_OF_VIEW}


def cameras(task: str, episode: Episode) -> list[dict[str, Any]]:
    """Pose of the camera at each step."""
    thing, hand = (
        np.array([look[name] for look in episode.looks])
        for name in ("object_position", "tool_position")
    )
    away = np.linalg.norm(hand - thing, axis=1)
    yaw = np.unwrap([look["tool_yaw"] for look in episode.looks])
    path = smooth(np.column_stack([(thing + hand) / 2, away, yaw]))
    if task in STILL:
        path[:] = path.mean(axis=0)
    return [camera(row[:3], row[3], row[4]) for row in path]


def replayed(env: Any, episode: Episode) -> Iterator[int]:
    """Numbers of the steps, the environment being there."""
    env.reset(seed=episode.seed)
    yield 0
    for number, action in enumerate(episode.actions, 1):
        env.step(action)
        yield number


def film(env: Any, task: str, episodes: list[Episode], out: Path) -> None:
    """Writes the film of these episodes."""
    frames: list[np.ndarray] = []
    for episode in episodes:
        poses = cameras(task, episode)
        frames += [env.unwrapped.render(poses[number]) for number in replayed(env, episode)]
        frames += frames[-1:] * PAUSE
    path = out / f"{task}.gif"
    video.write(path, frames, env.metadata["render_fps"])
    print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")


def pictures(out: Path) -> None:
    """Writes the film and <task>.png of every task, and cameras.png.

    The pictures are the end of the film's second episode.
    """
    for task in TASKS:
        agent = load(f"{task}-v0")
        episodes = shown(task, agent)
        size = {"render_mode": "rgb_array", "width": FILM[0], "height": FILM[1]}
        film(made(task, agent, **size), task, episodes, out)
        size |= {"width": PICTURE[0], "height": PICTURE[1]}
        env, second = made(task, agent, **size), episodes[1]
        *_, end = cameras(task, second)
        for _ in replayed(env, second):
            pass
        Image.fromarray(env.unwrapped.render(end)).save(out / f"{task}.png", optimize=True)
        if task == "GraspLift":
            views = [env.unwrapped.render(camera) for camera in CAMERAS[1:]]
            sheet = np.vstack([np.hstack(views[:2]), np.hstack(views[2:])])
            picture = Image.fromarray(sheet).quantize(256, dither=Image.Dither.NONE)
            picture.save(out / "cameras.png", optimize=True)


def page(out: Path) -> None:
    """Writes view.png: the page of an episode, at one of its steps."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        print(f"view.png: not made, for there is none of {', '.join(BROWSERS)}")
        return
    frames = list(view.episode(choose(VIEWED, "trained", {}), FIRST_SEED))
    for number, frame in enumerate(frames):
        frame.seconds = 1000.0 if number == VIEWED_STEP else 0.0
    with tempfile.TemporaryDirectory() as folder:
        file, shot = Path(folder) / "page.html", Path(folder) / "page.png"
        viewing.view([frames], file, table=True)
        file.write_text(file.read_text().replace("</head>", NO_NOTES, 1))
        command = [browser, *DRAWN, f"--screenshot={shot}", file.as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=300)
        picture = Image.open(shot).convert("RGB").crop(CROPPED)
    picture.save(out / "view.png", optimize=True)
