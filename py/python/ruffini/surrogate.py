"""Training and evaluation of surrogates, networks that approximate finite element solutions.

They are trained on a dataset of solved presses or grasps (`ruffini.dataset`) and solve presses as
`ruffini.Surrogate`, `ruffini.PaperNetwork` or `ruffini.SoftSurrogate`.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any

from ruffini import dataset
from ruffini._core import evaluate_surrogate, train_surrogate
from ruffini._settings import plain
from ruffini._words import nearest

Watch = Callable[[str, dict[str, Any]], bool]
"""Called with the name of a stage and its values; stops the training if it returns false.

``shard``: ``done`` of ``all`` shards read. ``samples``: number of frames to ``train`` on, and of
``lost`` ones that the linear model could not solve. ``epoch``: its number, ``steps``, mean relative
``errors`` on its batches, ``seconds``, a summary of the ``validation`` part or None, seconds
``left``. The errors are those of displacement and stress, then of nodal forces and net force, or,
for the paper's networks, which give light presses less weight, of the object's motion and the rigid
motion (0 if the network does not output it).
"""


def train(
    data: str | PathLike[str],
    out: str | PathLike[str],
    *,
    coarser: str | PathLike[str] | None = None,
    variant: str = "corrector",
    commit: str = "",
    watch: Watch | None = None,
    **settings: Any,
) -> dict[str, Any] | None:
    """Train a network, or continue a stopped run; return its card, or ``None`` if stopped.

    Writes to `out`: ``last.safetensors`` after every epoch, from which the same call continues bit
    for bit; ``best.safetensors`` if there are validation grasps; at the end ``weights.safetensors``
    and its ``card.toml``.

    ========== ========================== ================================ ======================
    variant    network                    loaded by                        dataset
    ========== ========================== ================================ ======================
    corrector  corrects the linear        `ruffini.Surrogate.load`         presses of one pad, or
               solution                                                    grasps by soft pads
    baseline,  of the paper, uses no      `ruffini.PaperNetwork.load`, if  grasps by soft pads
    a, b       linear solution            its input is a translation
    soft       corrects the linear        `ruffini.SoftSurrogate`          grasps of soft objects
               solution of a free object
    ========== ========================== ================================ ======================

    Args:
        data: A dataset, finished or not.
        out: Folder of the run.
        coarser: A second dataset to learn from, of presses of the same gels that were solved on
            coarser meshes; for the corrector. The network is told which of the two a press is from,
            and answers like `data`: many cheap solutions and some accurate ones.
        variant: Kind of network; see the table.
        commit: Commit of this library, recorded in the card.
        watch: See `Watch`.
        settings: ``seed``, ``epochs``, ``batch``, ``rate`` and ``network``, the network's sizes.
            Further settings of the variants, with ``split`` as for `evaluate`:

            - corrector: ``split``, ``warmup``, ``clip``, ``linear_nodes``, ``mirrors`` (whether
              presses are also seen in the pad's mirrors); the network's ``width``, ``down``,
              ``up``, ``corner``.
            - baseline, a, b: ``split``, ``seconds``, ``every`` (one in so many frames is
              evaluated), ``density`` (of nodes on the objects' surfaces: ``"coarse"`` or
              ``"dense"``); the network's ``input`` (``"translation"``, or ``"force"``, with which
              the object's motion is learnt, too), ``width``, ``rounds``, ``shared``, ``norm``.
            - soft: ``seconds``; the network's ``width``, ``down``, ``up``, ``corner``.

            ``seconds`` of processor time replace ``epochs``; such a run leaves no checkpoint and
            is not reproducible.

    Raises:
        FileNotFoundError: If there is no such dataset.
        ValueError: If a setting is invalid or not one of the variant, the dataset cannot be read,
            or `out` holds another run.
        SimulationError: If a gradient is not finite.
    """

    def tell(stage: str, value: str) -> bool:
        return watch is None or watch(stage, json.loads(value))

    clock = time.process_time
    if variant != "soft" and (split := _split(data, settings.get("split"))):
        settings["split"] = split
    card = train_surrogate(
        data, coarser, out, variant, json.dumps(settings, default=plain), commit, clock, tell
    )
    return None if card is None else dict(json.loads(card))


def evaluate(
    weights: str | PathLike[str],
    data: str | PathLike[str],
    split: str | None = None,
    *,
    coarser: bool = False,
) -> list[dict[str, Any]]:
    """Errors of a corrector, or of one of the paper's networks, on the test part of a split.

    Args:
        weights: The .safetensors file.
        data: A dataset, finished or not.
        split: Name of the split; ``None`` takes the only one of a finished dataset, as of presses,
            or else ``novel-14``.
        coarser: Whether the dataset was the coarser one of two that a corrector learnt from: it
            then answers as it does there.

    Returns:
        For each frame ``grasp``, and the errors of the ``surrogate`` and of the ``linear`` solution
        that it corrects (None for the paper's networks, which correct none). Errors are relative
        ones of ``displacement``, ``stress``, ``stressed`` (stress above 5 % of the peak), ``peak``,
        ``nodal_force`` and ``force``, None for quantities that a network does not output, and the
        absolute ``displacement_mae`` (m) and ``stress_mae`` (Pa).

    Raises:
        FileNotFoundError: If there are no such weights, or no such dataset.
        ValueError: If the weights, the dataset or the split cannot be read.
    """
    found = evaluate_surrogate(weights, data, _split(data, split) or "novel-14", coarser)
    return [
        {
            "grasp": grasp,
            "surrogate": json.loads(network),
            "linear": None if linear is None else json.loads(linear),
        }
        for grasp, network, linear in found
    ]


def _split(data: str | PathLike[str], given: str | None) -> str | None:
    """The split that is given, else that of a finished dataset that has one alone.

    Raises:
        ValueError: If a finished dataset has none of that name.
    """
    if not Path(data, "manifest.json").exists():
        return given
    names = list(dataset.open(data).splits)
    if given is not None and given not in names:
        near = nearest(given, names)
        raise ValueError(f"split: found {given}{near} expected one of {', '.join(names)}")
    return names[0] if given is None and len(names) == 1 else given
