"""Differences of paired samples: two policies or models on the same seeds, with 95 % intervals."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from ruffini.evaluation import bootstrap, wilson

RESAMPLED = 10_000
"""Resamples of a bootstrap."""


def mcnemar(one: int, other: int) -> float:
    """Exact two-sided p of McNemar's test, from the counts of pairs that differ either way."""
    count = one + other
    tail = sum(math.comb(count, k) for k in range(min(one, other) + 1))
    return min(1.0, 2.0 * tail / 2**count)


def paired_interval(both: int, first: int, second: int, neither: int) -> tuple[float, float]:
    """95 % interval of a difference of paired proportions (Newcombe 1998, method 10).

    Args:
        both: Pairs in which both succeed.
        first: Pairs in which the first alone does.
        second: Pairs in which the second alone does.
        neither: Pairs in which none does.
    """
    count = both + first + second + neither
    one, other = both + first, both + second
    p, q = one / count, other / count
    (p_low, p_high), (q_low, q_high) = wilson(one, count), wilson(other, count)
    product = one * (count - one) * other * (count - other)
    covariance = both * neither - first * second
    if covariance > 0:
        covariance = max(covariance - count / 2, 0)
    phi = covariance / math.sqrt(product) if product else 0.0

    def reach(below: float, above: float) -> float:
        return math.sqrt(max(below**2 - 2 * phi * below * above + above**2, 0.0))

    return p - q - reach(p - p_low, q_high - q), p - q + reach(p_high - p, q - q_low)


def mean_with_interval(differences: list[float]) -> dict[str, Any]:
    """Mean with its bootstrapped 95 % interval, and the median."""
    found = np.array(differences)
    return {
        "difference": float(found.mean()),
        "interval": list(bootstrap(found, partial(np.mean, axis=-1), RESAMPLED)),
        "median": float(np.median(found)),
    }
