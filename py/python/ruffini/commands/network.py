"""``ruffini network``: training and evaluation of networks that approximate finite elements."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ruffini import surrogate
from ruffini._spaces import check_writable, replace_file

_SETTINGS = {
    "seed": (int, "seed of weights and batches; 0 if not given"),
    "split": (str, "split of the dataset; its only one, else novel-14, if not given"),
    "epochs": (int, "times that every frame is seen; 80, of the paper's 10, of soft 40"),
    "seconds": (float, "processor time in place of epochs; such a run cannot be resumed"),
    "batch": (int, "frames in a step; 16, of the paper's 1, of soft 8"),
    "rate": (float, "highest learning rate; 0.002 if not given"),
    "linear-nodes": (int, "nodes of the linear model's mesh; 2000 if not given"),
    "density": (str, "of nodes on the objects' surfaces: coarse (if not given) or dense"),
}
_SIZES = ("input", "width", "rounds", "down", "up")
_PAPER = {"seed", "split", "epochs", "seconds", "batch", "rate", "density", "input", "width"}
_OPTIONS = {
    "corrector": set(_SETTINGS) - {"seconds", "density"} | {"width", "down", "up"},
    **dict.fromkeys(("baseline", "a", "b"), _PAPER | {"rounds"}),
    "soft": {"seed", "epochs", "seconds", "batch", "rate", "width", "down", "up"},
}
_PARTS = {
    "corrector": ("u", "stress", "nodal forces", "force"),
    **dict.fromkeys(("baseline", "a", "b"), ("u", "stress", "object's motion", "rigid motion")),
    "soft": ("u", "stress", "nodal forces", "force"),
}
"""Names of the four errors of an epoch."""


def add_to(commands: Any) -> None:
    """Add the subcommand to the parser."""
    network: argparse.ArgumentParser = commands.add_parser(
        "network", help="train or evaluate a network of pads or of soft objects"
    )
    parts = network.add_subparsers(metavar="train|evaluate", required=True)
    parser = parts.add_parser(
        "train",
        help="train a network on a dataset",
        description="Trains the network of pads that corrects linear elasticity (corrector), one "
        "of DefGraspNets by Huang et al. 2023 (the paper's: baseline, a, b), or that of soft "
        "objects (soft). Stopped with Ctrl-C, the same command goes on from the last whole epoch. "
        "RAYON_NUM_THREADS sets the threads. In brackets: the variants that have an option.",
    )
    parser.add_argument("data", help="the dataset, finished or not; of soft objects for soft")
    parser.add_argument("out", help="folder for checkpoints, weights and their card")
    parser.add_argument(
        "--coarser",
        metavar="DATA",
        help="a second dataset, of presses solved on coarser meshes: many cheap solutions beside "
        "some accurate ones (corrector)",
    )
    parser.add_argument(
        "--variant", choices=_OPTIONS, default="corrector", help="corrector if not given"
    )
    for name, (kind, text) in _SETTINGS.items():
        parser.add_argument(f"--{name}", type=kind, help=f"{text} ({_had_by(name)})")
    text = f"input that gives the load; translation if not given ({_had_by('input')})"
    parser.add_argument("--input", choices=("translation", "force"), help=text)
    parser.add_argument("--width", type=int, help="latent width; 32, of the paper's 16")
    parser.add_argument("--rounds", type=int, help=f"rounds of messages; 4 ({_had_by('rounds')})")
    rounds, had = "rounds of messages at each scale, finest first", _had_by("down")
    down, up = "to coarser scales; 1 1 1, of soft 1 1 2", "to finer scales; 1 1, of soft 2 1"
    parser.add_argument("--down", type=int, nargs=3, help=f"{rounds}, {down} ({had})")
    parser.add_argument("--up", type=int, nargs=2, help=f"{rounds}, {up} ({had})")
    parser.add_argument("--commit", default="", help="commit of ruffini, noted in the card")
    parser.set_defaults(run=_train)
    judge = parts.add_parser(
        "evaluate",
        help="errors of a network on a dataset",
        description="Errors of a corrector and of the linear solution that it corrects, or of one "
        "of the paper's networks, on the test part of a split, by object. Those of a network of "
        "soft objects are in its card, card.toml.",
    )
    judge.add_argument("weights", help="the .safetensors file")
    judge.add_argument("data", help="the dataset")
    judge.add_argument("--split", help="split; the only one, else novel-14, if not given")
    judge.add_argument(
        "--coarser", action="store_true", help="the dataset is the coarser one that it learnt from"
    )
    judge.add_argument("--json", type=Path, help="file for the errors of every frame")
    judge.set_defaults(run=_evaluate)


def _had_by(name: str) -> str:
    return ", ".join(variant for variant, options in _OPTIONS.items() if name in options)


def _train(options: argparse.Namespace) -> None:
    given = {name: getattr(options, name.replace("-", "_")) for name in (*_SETTINGS, *_SIZES)}
    given = {name: value for name, value in given.items() if value is not None}
    for name in given:
        if name not in _OPTIONS[options.variant]:
            known = ", ".join(sorted(_OPTIONS[options.variant]))
            raise ValueError(f"--{name} is no option of {options.variant}, which has {known}")
    settings = {k.replace("-", "_"): value for k, value in given.items() if k in _SETTINGS}
    if sizes := {name: value for name, value in given.items() if name in _SIZES}:
        settings["network"] = sizes
    card = surrogate.train(
        options.data,
        options.out,
        coarser=options.coarser,
        variant=options.variant,
        commit=options.commit,
        watch=_teller(_PARTS[options.variant]),
        **settings,
    )
    if card is None:
        raise KeyboardInterrupt
    print(summary(_answerers(card)))


def _teller(parts: tuple[str, ...]) -> Callable[[str, dict[str, Any]], bool]:
    def tell(stage: str, progress: dict[str, Any]) -> bool:
        if stage == "epoch":
            errors = zip(parts, progress["errors"], strict=True)
            text = ", ".join(f"{part} {100 * error:.2f} %" for part, error in errors if error)
            text = f"epoch {progress['epoch']}: {text}"
            if found := progress["validation"]:
                medians = [found[part]["median"] for part in ("displacement", "stress", "force")]
                text += ", validation " + " / ".join(f"{100 * error:.2f} %" for error in medians)
                text += f" ({found['displacement_mae']:.1e} m, {found['stress_mae']:.0f} Pa)"
            text += f", {progress['seconds']:.1f} s, {progress['left'] / 60:.0f} min left"
        elif stage == "shard":
            text = f"{progress['done']}/{progress['all']} shards"
        else:
            text = f"{progress['train']} frames to train on, "
            text += f"{progress['lost']} without a linear solution"
        end = "\r" if stage == "shard" and sys.stderr.isatty() else "\n"
        print(text, end=end, file=sys.stderr, flush=True)
        return True

    return tell


def _answerers(card: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Errors in a card by model and part of the data."""
    if card["variant"] == "corrector":
        return {"surrogate": card["test"], "linear": card["linear"]}
    if card["variant"] == "soft":
        parts = [(part, who) for part in ("known", "novel") for who in ("network", "linear")]
        return {f"{who}, {part}": card[part][who] for part, who in parts}
    return {f"{part} objects": card[part]["all"] for part in ("known", "novel")}


def summary(answerers: dict[str, dict[str, Any]]) -> str:
    """Format a table of errors, one column per model."""
    rows = [f"{'':<18}" + "".join(f"{who:>18}" for who in answerers) + "   median / 95 %"]
    for part in ("displacement", "stress", "stressed", "peak", "nodal_force", "force"):
        cells = [
            f"{100 * of[part]['median']:.2f} / {100 * of[part]['p95']:.2f} %"
            if of["presses"] and part in of
            else "-"
            for of in answerers.values()
        ]
        rows.append(f"{part.replace('_', ' '):<18}" + "".join(f"{cell:>18}" for cell in cells))
    for part, unit in (("displacement_mae", "m"), ("stress_mae", "Pa")):
        cells = [f"{of[part]:.3g} {unit}" if of["presses"] else "-" for of in answerers.values()]
        rows.append(f"{part.replace('_', ' '):<18}" + "".join(f"{cell:>18}" for cell in cells))
    for part, name in (("presses", "presses"), ("still", "hardly moved")):
        rows.append(f"{name:<18}" + "".join(f"{of[part]:>18}" for of in answerers.values()))
    return "\n".join(rows)


def _evaluate(options: argparse.Namespace) -> None:
    if options.json is not None:
        check_writable("json", options.json)
    frames = surrogate.evaluate(
        options.weights, options.data, options.split, coarser=options.coarser
    )
    if not frames:
        where = f"of {options.split}" if options.split else "of the split"
        raise ValueError(f"{options.data}: no frames in the test part {where}")
    if options.json is not None:
        replace_file(options.json, json.dumps(frames))
    by_object: dict[str, list[dict[str, Any]]] = {}
    for frame in frames:
        by_object.setdefault(frame["grasp"].split("/")[0], []).append(frame)
    answerers = [who for who in ("surrogate", "linear") if frames[0][who] is not None]
    linear = "   linear: u, stress, force" if "linear" in answerers else ""
    print(f"{'medians':<16}{'u':>8}{'stress':>8}{'force':>8}" + linear)
    for name, part in {**by_object, "all": frames}.items():
        cells = [
            _median([frame[who][what] for frame in part])
            for who in answerers
            for what in ("displacement", "stress", "force")
        ]
        print(f"{name:<16}" + "".join(f"{cell:>8}" for cell in cells) + " %")


def _median(values: list[float | None]) -> str:
    """Format the median in percent; a dash if there are no values."""
    ordered = sorted(value for value in values if value is not None)
    return f"{100 * ordered[len(ordered) // 2]:.2f}" if ordered else "-"
