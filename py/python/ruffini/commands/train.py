"""``ruffini train``: a surrogate trained on a dataset."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from ruffini import surrogate

_SETTINGS = {
    "seed": (int, "what weights and batches are drawn from"),
    "split": (str, "split of the dataset"),
    "epochs": (int, "times that every frame is seen"),
    "batch": (int, "frames in a step"),
    "rate": (float, "highest learning rate"),
    "linear-nodes": (int, "nodes of the linear model's mesh"),
    "contact": (str, "where the linear model feels contact: points, or nodes for speed"),
}


def add_to(commands: Any) -> None:
    """Adds the subcommand to the parser's."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "train",
        help="train a surrogate on a dataset",
        description="Trains the network that corrects the linear answer. Stopped with Ctrl-C, the "
        "same command goes on from the last whole epoch. RAYON_NUM_THREADS sets the threads.",
    )
    parser.add_argument("data", help="the dataset, finished or not")
    parser.add_argument("out", help="folder for checkpoints, weights and their card")
    for name, (kind, text) in _SETTINGS.items():
        parser.add_argument(f"--{name}", type=kind, help=text)
    parser.add_argument("--width", type=int, help="latent width of the network")
    rounds = "rounds of messages at each scale on the way"
    parser.add_argument("--down", type=int, nargs=3, help=f"{rounds} down, the finest first")
    parser.add_argument("--up", type=int, nargs=2, help=f"{rounds} up, the finest first")
    parser.add_argument("--commit", default="", help="commit of ruffini, for the card")
    parser.set_defaults(run=_train)


def _train(options: argparse.Namespace) -> None:
    names = [name.replace("-", "_") for name in _SETTINGS]
    given = {name: getattr(options, name) for name in names}
    settings = {name: value for name, value in given.items() if value is not None}
    sizes = {name: getattr(options, name) for name in ("width", "down", "up")}
    if sizes := {name: value for name, value in sizes.items() if value is not None}:
        settings["network"] = sizes
    card = surrogate.train(
        options.data, options.out, commit=options.commit, watch=_tell, **settings
    )
    if card is None:
        raise KeyboardInterrupt
    print(summary(card["test"], card["linear"]))


def _tell(stage: str, told: dict[str, Any]) -> bool:
    if stage == "epoch":
        u, stress, _, force = (f"{100 * error:.2f}" for error in told["errors"])
        text = f"epoch {told['epoch']}: u {u} %, stress {stress} %, force {force} %"
        if found := told["validation"]:
            parts = [found[part]["median"] for part in ("displacement", "stress", "force")]
            text += ", validation " + " / ".join(f"{100 * part:.2f} %" for part in parts)
            text += f" ({found['displacement_mae']:.1e} m, {found['stress_mae']:.0f} Pa)"
        text += f", {told['seconds']:.1f} s, {told['left'] / 60:.0f} min left"
    elif stage == "shard":
        text = f"{told['done']}/{told['all']} shards"
    else:
        text = f"{told['train']} frames to train on, {told['lost']} without a linear answer"
    end = "\r" if stage == "shard" and sys.stderr.isatty() else "\n"
    print(text, end=end, file=sys.stderr, flush=True)
    return True


def summary(network: dict[str, Any], linear: dict[str, Any]) -> str:
    """A table of the errors of a surrogate beside those of the linear answer."""
    rows = [f"{'':<18}{'surrogate':>16}{'linear':>18}   median / 95 % of presses"]
    for part in ("displacement", "stress", "stressed", "peak", "nodal_force", "force"):
        cells = [
            f"{100 * of[part]['median']:.2f} / {100 * of[part]['p95']:.2f} %"
            for of in (network, linear)
        ]
        rows.append(f"{part.replace('_', ' '):<18}{cells[0]:>16}{cells[1]:>18}")
    for part, unit in (("displacement_mae", "m"), ("stress_mae", "Pa")):
        cells = [f"{of[part]:.3g} {unit}" for of in (network, linear)]
        rows.append(f"{part.replace('_', ' '):<18}{cells[0]:>16}{cells[1]:>18}")
    rows.append(f"{network['presses']} presses, {network['still']} that hardly move counted apart")
    return "\n".join(rows)
