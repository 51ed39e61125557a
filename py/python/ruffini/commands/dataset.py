"""``ruffini dataset``: generation, inspection and errors of solved grasps and presses."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ruffini import _distributions, dataset
from ruffini._words import counted
from ruffini.dataset import Progress

_SETTINGS = {
    "objects": "number of drawn objects, spread evenly over the catalogue",
    "grasps": "number of grasps or presses of each object",
    "frames": "number of frames, of growing force, in each grasp; presses have 7, or 4 "
    "if not moved on, and take no other number than 7",
    "seed": "seed of objects, grasps and presses",
}
_MOST_BYTES = 2_000_000_000
_MOST_HOURS = 4
"""Size and processor time above which a generation asks for confirmation."""


def add_to(commands: Any) -> None:
    """Add the subcommand to the parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "dataset", help="make or look into a dataset of solved grasps or presses"
    )
    parts = parser.add_subparsers(metavar="generate|inspect|error|plot|export", required=True)
    maker = parts.add_parser(
        "generate",
        help="solve grasps or presses and store them",
        description="Solves grasps or presses by finite elements. After Ctrl-C, which drops those "
        "being solved, or a kill the same command goes on with what is missing.",
    )
    maker.add_argument("folder", help="where the dataset is made")
    maker.add_argument(
        "--config",
        help=".toml file, which may list meshes of one's own as [[object]]; 63 objects x 100 "
        "grasps x 50 frames if not given",
    )
    for name, text in _SETTINGS.items():
        maker.add_argument(f"--{name}", type=int, help=f"{text}; as configured if not given")
    maker.add_argument(
        "--scenario",
        choices=("pads", "soft", "presses"),
        help="soft pads on rigid objects, soft objects between rigid fingers, or indenters of any "
        "size on one pad; as configured if not given",
    )
    maker.add_argument("--threads", type=int, help="threads; one a core if not given")
    maker.add_argument(
        "--yes",
        action="store_true",
        help=f"do not ask before more than {_size(_MOST_BYTES)} or {_MOST_HOURS} processor hours",
    )
    maker.add_argument("--commit", default="", help="commit of ruffini, for the manifest")
    maker.set_defaults(run=_generate)
    viewer = parts.add_parser(
        "inspect",
        help="say what a finished dataset holds, and check its files",
        description="Checks every shard against its hash, and for numbers that are not finite, and "
        "says what the dataset holds. Exit status 2 if a file is missing, damaged or foreign.",
    )
    viewer.add_argument("folder", help="the dataset")
    viewer.set_defaults(run=_inspect)
    judge = parts.add_parser(
        "error",
        help="say how far the finite elements of a dataset are from those on a finer mesh",
        description="Solves some shards of a dataset of soft pads again on a finer mesh, and says "
        "how far apart the two are in displacement, stress and force. A model that learns from "
        "the dataset, or is judged by it, cannot be known better than that.",
    )
    judge.add_argument("folder", help="the dataset")
    judge.add_argument("finer", help="where they are solved again; goes on with what is there")
    judge.add_argument("--sample", type=int, default=14, help="shards to solve; 14 if not given")
    judge.add_argument("--nodes", type=int, help="most nodes; four times as many if not given")
    judge.add_argument(
        "--across",
        type=float,
        help="of presses: distances between nodes across the indenter; twice as many if not given",
    )
    judge.add_argument("--threads", type=int, help="threads; one a core if not given")
    judge.set_defaults(run=_error)
    artist = parts.add_parser("plot", help="draw distributions by family of objects")
    artist.add_argument("folder", help="the dataset")
    artist.add_argument("-o", "--out", required=True, help=".png or .svg file")
    artist.set_defaults(run=_plot)
    writer = parts.add_parser("export", help="write a frame for ParaView")
    writer.add_argument("folder", help="the dataset")
    writer.add_argument("index", type=int, help="number of the frame; from the end if negative")
    writer.add_argument(
        "out", help=".vtu or .npz file; -first or -second, the pad, is added to its name"
    )
    writer.set_defaults(run=_export)


def _generate(options: argparse.Namespace) -> None:
    given = {name: getattr(options, name) for name in (*_SETTINGS, "scenario")}
    given = {name: value for name, value in given.items() if value is not None}
    if not options.yes:
        _confirm(dataset.estimate(options.folder, options.config, **given))
    dataset.generate(
        options.folder,
        options.config,
        threads=options.threads,
        commit=options.commit,
        watch=_Line(options.folder),
        **given,
    )
    _inspect(options)


def _confirm(found: dataset.Estimate) -> None:
    """Ask before a long generation.

    Raises:
        ValueError: If the answer is no, or there is no terminal to ask at.
    """
    hours = found.seconds / 3600
    if found.bytes <= _MOST_BYTES and hours <= _MOST_HOURS:
        return
    what = (
        f"{found.grasps} grasps with {found.frames} frames take about {_size(found.bytes)} on disk "
        f"and {hours:.0f} hours of one core"
    )
    if sys.stdin is None or not sys.stdin.isatty():
        raise ValueError(f"{what}: expected --yes, or fewer --objects, --grasps or --frames")
    if input(f"{what}. Go on? [y/N] ").strip().lower() not in ("y", "yes"):
        raise ValueError("nothing was made")


class _Line:
    """Callback that prints the progress of a generation on one line."""

    def __init__(self, folder: str):
        self._folder = folder
        self._before: int | None = None

    def __call__(self, now: Progress) -> bool:
        if self._before is None:
            self._before = now.done
            self._announce(now)
        else:
            end = "\r" if sys.stderr.isatty() and now.done < now.all else "\n"
            print(self._text(now, now.done - self._before), end=end, file=sys.stderr, flush=True)
        return True

    def _announce(self, now: Progress) -> None:
        free = shutil.disk_usage(self._folder).free
        print(
            f"{counted(now.all, 'grasp')}, {now.done} of them done; "
            f"about {_size(now.bytes)} on disk, {_size(free)} free",
            file=sys.stderr,
            flush=True,
        )
        claim = Path(self._folder, "config.json").read_text()
        config = json.loads(claim)
        if config["scenario"] != "presses" and (note := _held_out(config["grasps"])):
            print(note, file=sys.stderr, flush=True)

    @staticmethod
    def _text(now: Progress, solved: int) -> str:
        left = now.seconds / solved * (now.all - now.done)
        return (
            f"{now.done}/{counted(now.all, 'grasp')}, {counted(now.frames, 'frame')}, "
            f"{now.unsolved} unsolved, "
            f"{_time(now.seconds)} gone, {_time(left)} left "
        )


def _held_out(grasps: int) -> str:
    """Note on the parts of the splits that are empty with few grasps per object."""
    if grasps >= 3:
        return ""
    parts = "no validation part" if grasps == 2 else "no validation part, no test on known objects"
    return f"{grasps} of 3 grasps an object that splits need: {parts}"


def _inspect(options: argparse.Namespace) -> None:
    found = dataset.open(Path(options.folder))
    found.verify()
    shards, unsolved = found.manifest["shards"], found.manifest["unsolved"]
    grasps = [grasp for shard in shards for grasp in shard["grasps"]]
    objects = {grasp["name"].split("/")[0] for grasp in grasps}
    print(f"{'objects':<12} {len(objects)}")
    print(f"{'grasps':<12} {len(grasps)}")
    print(f"{'frames':<12} {len(found)}")
    size = _size(sum(shard["bytes"] for shard in shards))
    print(f"{'size':<12} {size}, {counted(len(shards), 'shard')}")
    print(f"{'unsolved':<12} {len(unsolved)}")
    for reason, count in _distributions.reasons(found).most_common():
        print(f"{'':<12} {count} of: {reason}")
    _balance(found)
    for name, split in found.splits.items():
        print(f"{name:<12} {', '.join(f'{len(part)} {use}' for use, part in split.items())}")


def _error(options: argparse.Namespace) -> None:
    config = dataset.open(options.folder).manifest["config"]
    finer = {"truth_nodes": options.nodes or 4 * config["truth_nodes"]}
    if config.get("scenario") == "presses":
        finer["truth_across"] = options.across or 2 * config.get("truth_across", 8.0)
        if linear := config.get("truth_linear_nodes"):
            finer["truth_linear_nodes"] = 2 * linear
    elif options.across:
        raise ValueError("--across: found grasps, expected a dataset of presses")
    found = dataset.truth_errors(
        options.folder,
        options.finer,
        sample=options.sample,
        threads=options.threads,
        watch=_Line(options.finer),
        **finer,
    )
    if not found:
        raise ValueError(f"{options.finer}: no frame that both meshes solved")
    parts = ("displacement", "stress", "force")
    print(f"{counted(len(found), 'frame')} on both meshes; relative L², in %")
    print(f"{'':<22}" + "".join(f"{part:>14}" for part in parts))

    def line(name: str, rows: list[dataset.TruthError], share: float) -> None:
        values = (np.quantile([getattr(row, part) for row in rows], share) for part in parts)
        print(f"{name:<22}" + "".join(f"{100 * value:14.1f}" for value in values))

    line("median", found, 0.5)
    line("95th percentile", found, 0.95)
    for grasp in dict.fromkeys(row.grasp for row in found):
        line(grasp, [row for row in found if row.grasp == grasp], 0.5)


def _balance(found: dataset.Dataset) -> None:
    """Print the largest imbalances of all frames, and in which frames they occur."""
    units = {"contact": "N", "force": "N", "torque": "N m"}
    worst: dict[str, tuple[float, str]] = {}
    for frame in found:
        for name, value in frame.imbalance().items():
            found_here = (value, f"{frame.grasp} frame {frame.number}")
            worst[name] = max(worst.get(name, found_here), found_here)
    for name, (value, place) in worst.items():
        print(f"{name:<12} at most {value:.1e} {units[name]} out of balance, {place}")


def _plot(options: argparse.Namespace) -> None:
    dataset.open(options.folder).plot(options.out)
    print(options.out)


def _export(options: argparse.Namespace) -> None:
    try:
        files = dataset.open(options.folder).export(options.index, options.out)
    except IndexError as error:
        raise ValueError(error) from error
    print(*files, sep="\n")


def _size(count: float) -> str:
    for unit in ("B", "kB", "MB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.1f} GB"


def _time(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02}:{rest:02}"
