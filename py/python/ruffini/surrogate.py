"""Training and judging of surrogates, the networks that answer as finite elements do.

They are trained on a dataset of solved grasps (`ruffini.dataset`) and answer presses as
`ruffini.Surrogate`, `ruffini.PaperNetwork` or `ruffini.SoftSurrogate`.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from os import PathLike
from typing import Any

from ruffini._core import evaluate_surrogate, train_surrogate

Watch = Callable[[str, dict[str, Any]], bool]
"""Called with a stage and what is known of it; false stops.

``shard``: ``done`` of ``all`` shards read. ``samples``: frames to ``train`` on, and ``lost`` ones
that the linear model did not answer. ``epoch``: its number, ``steps``, mean relative ``errors`` on
its batches (of displacement and stress; then of nodal forces and net force, or, of the paper's
networks, which count light presses less, of the object's motion and of the rigid motion, 0 where
they are not said), ``seconds``, a summary of the ``validation`` part or None, seconds ``left``.
"""


def train(
    data: str | PathLike[str],
    out: str | PathLike[str],
    *,
    variant: str = "corrector",
    commit: str = "",
    watch: Watch | None = None,
    **settings: Any,
) -> dict[str, Any] | None:
    """Trains a network, or goes on with one; its card, or ``None`` if it was stopped.

    Writes into `out`: ``last.safetensors`` after every epoch, from which the same call goes on to
    the bit; ``best.safetensors`` where there are grasps to choose by; at the end
    ``weights.safetensors`` and its ``card.toml``.

    ========== ========================== ================================ ======================
    variant    network                    loaded by                        dataset
    ========== ========================== ================================ ======================
    corrector  of the linear answer       `ruffini.Surrogate.load`         grasps by soft pads
    baseline,  of the paper, which is     `ruffini.PaperNetwork.load`, if  grasps by soft pads
    a, b       shown no linear answer     it is told poses
    soft       of the linear answer of a  `ruffini.SoftSurrogate`          grasps of soft objects
               free soft object
    ========== ========================== ================================ ======================

    Args:
        data: A dataset, finished or not.
        out: Folder of the run.
        variant: What is trained.
        commit: Commit of this library, kept in the card.
        watch: See `Watch`.
        settings: ``seed``, ``epochs``, ``batch``, ``rate`` and ``network``, the network's sizes; of
            the variants besides

            - corrector: ``split``, ``warmup``, ``clip``, ``linear_nodes``, ``contact`` (of the
              linear answer: ``"points"``, or ``"nodes"`` for speed); the network's ``width``,
              ``down``, ``up``, ``corner``.
            - baseline, a, b: ``split``, ``seconds``, ``every`` (one in so many frames is judged),
              ``density`` (of nodes on the objects' surfaces: ``"coarse"`` or ``"dense"``); the
              network's ``input`` (``"translation"``, or ``"force"``: then the object's motion is
              learnt too), ``width``, ``rounds``, ``shared``, ``norm``.
            - soft: ``seconds``; the network's ``width``, ``down``, ``up``, ``corner``.

            ``seconds`` of processor time take the place of ``epochs``; such a run leaves no
            checkpoint, and does not come out the same again.

    Raises:
        ValueError: If a setting makes no sense or is not the variant's, the dataset cannot be read
            or `out` holds another run.
        SimulationError: If a gradient is not finite.
    """

    def tell(stage: str, value: str) -> bool:
        return watch is None or watch(stage, json.loads(value))

    clock = time.process_time
    card = train_surrogate(data, out, variant, json.dumps(settings), commit, clock, tell)
    return None if card is None else dict(json.loads(card))


def evaluate(
    weights: str | PathLike[str], data: str | PathLike[str], split: str
) -> list[dict[str, Any]]:
    """Errors of a corrector, or of one of the paper's networks, on a split's test part.

    Returns:
        For each frame ``grasp``, ``surrogate`` and ``linear`` (the answer that is corrected; None
        for the paper's networks, which correct none); the errors are relative ones of
        ``displacement``, ``stress``, ``stressed`` (above 5 % of the peak), ``peak``,
        ``nodal_force``, ``force``, None for what a network does not say, and ``displacement_mae``
        (m) and ``stress_mae`` (Pa).

    Raises:
        ValueError: If the weights, the dataset or the split cannot be read.
    """
    return [
        {
            "grasp": grasp,
            "surrogate": json.loads(network),
            "linear": None if linear is None else json.loads(linear),
        }
        for grasp, network, linear in evaluate_surrogate(weights, data, split)
    ]
