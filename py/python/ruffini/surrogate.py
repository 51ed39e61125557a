"""Training and judging of surrogates, the networks that answer as finite elements do.

A surrogate is trained on a dataset of solved grasps (`ruffini.dataset`) and answers presses as
`ruffini.Surrogate`.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from os import PathLike
from typing import Any

from ruffini._core import evaluate_surrogate, train_surrogate

Watch = Callable[[str, dict[str, Any]], bool]
"""Called with a stage and what is known of it; false stops.

``shard``: ``done`` of ``all`` shards read. ``samples``: frames to ``train`` on, and ``lost`` ones
that the linear model did not answer. ``epoch``: its number, ``steps``, mean relative ``errors`` of
displacement, stress, nodal forces and net force on its batches, ``seconds``, a summary of the
``validation`` part or None, seconds ``left``.
"""


def train(
    data: str | PathLike[str],
    out: str | PathLike[str],
    *,
    commit: str = "",
    watch: Watch | None = None,
    **settings: Any,
) -> dict[str, Any] | None:
    """Trains a surrogate, or goes on with one; its card, or ``None`` if it was stopped.

    Writes into `out`: ``last.safetensors`` after every epoch, from which the same call goes on;
    ``best.safetensors`` where the split has grasps to choose by; at the end
    ``weights.safetensors``, which `ruffini.Surrogate.load` reads, and its ``card.toml``.

    Args:
        data: A dataset, finished or not.
        out: Folder of the run.
        commit: Commit of this library, kept in the card.
        watch: See `Watch`.
        settings: ``seed``, ``split``, ``epochs``, ``batch``, ``rate``, ``warmup``, ``clip``,
            ``linear_nodes``, ``contact`` (of the linear answer: ``"points"``, or ``"nodes"`` for
            speed), and ``network``: ``width``, ``down``, ``up``, ``corner``.

    Raises:
        ValueError: If a setting makes no sense, the dataset cannot be read or `out` holds another
            run.
        SimulationError: If a gradient is not finite.
    """

    def tell(stage: str, value: str) -> bool:
        return watch is None or watch(stage, json.loads(value))

    card = train_surrogate(data, out, json.dumps(settings), commit, tell)
    return None if card is None else dict(json.loads(card))


def evaluate(
    weights: str | PathLike[str], data: str | PathLike[str], split: str
) -> list[dict[str, Any]]:
    """Errors of a surrogate and of the linear answer on every frame of a split's test part.

    Returns:
        For each frame ``grasp``, ``surrogate`` and ``linear``; the errors are relative ones of
        ``displacement``, ``stress``, ``stressed`` (above 5 % of the peak), ``peak``,
        ``nodal_force``, ``force``, and ``displacement_mae`` (m) and ``stress_mae`` (Pa).

    Raises:
        ValueError: If the weights, the dataset or the split cannot be read.
    """
    return [
        {"grasp": grasp, "surrogate": json.loads(network), "linear": json.loads(linear)}
        for grasp, network, linear in evaluate_surrogate(weights, data, split)
    ]
