"""Errors of one answer against another on the same mesh, and answers that are none."""

from __future__ import annotations

from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from ruffini._core import Deformation, Grasped, PaperAnswer, PressError

_OF_ANSWERS = {
    name
    for answer in (Deformation, Grasped, PaperAnswer)
    for name in vars(answer)
    if not name.startswith("_")
}


class _UnsolvedError(PressError, AttributeError):
    """The error of a press where an attribute of its answer is asked for; `hasattr` is false."""


def _unsolved(error: PressError, name: str) -> NoReturn:
    """Raise the error in place of an answer whose attribute is asked for."""
    if name not in _OF_ANSWERS:
        raise AttributeError(f"'PressError' object has no attribute {name!r}")
    kind = vars(error).get("kind", "of no kind")
    raised = _UnsolvedError(f"{name}: found none, for the press was not solved ({kind}): {error}")
    vars(raised).update(vars(error))
    raise raised


PressError.__getattr__ = _unsolved  # type: ignore[method-assign]


def relative_error(answer: Deformation, reference: Deformation) -> tuple[float, float, float]:
    """Relative errors of an answer against a better one on the same mesh.

    The order is that of `Deformation.predicted_error`, so a predicted error can be compared.

    Args:
        answer: Answer of any model.
        reference: Answer to the same press on the same mesh, as of
            ``Fem(model.body, element="p2")``, whose quadratic elements take some ten times as long
            as ``"p1-bar"``.

    Returns:
        Errors in displacement, von Mises stress and net force: L² norms of the difference over
        those of the reference; infinite where the reference is zero and the answer is not.

    Raises:
        ValueError: If the answers are on different numbers of nodes.
    """
    nodes, expected = (len(one.displacement) for one in (answer, reference))
    if nodes != expected:
        raise ValueError(
            f"answer: found one on {nodes} nodes, expected {expected}, the reference's"
        )
    pairs = [
        (answer.displacement, reference.displacement),
        (answer.von_mises, reference.von_mises),
        (answer.wrench[:3], reference.wrench[:3]),
    ]
    displacement, stress, force = (apart(found, exact) for found, exact in pairs)
    return displacement, stress, force


def apart(found: NDArray[Any], exact: NDArray[Any]) -> float:
    """Relative L² difference."""
    off, size = (float(np.linalg.norm(field)) for field in (found - exact, exact))
    return off / size if size > 0 else (np.inf if off > 0 else 0.0)
