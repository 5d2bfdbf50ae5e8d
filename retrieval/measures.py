"""Retrieval measures: one table of their values for a query, at chance level, and over parts of a gallery.

For a query of a class of size C there are c = C - 1 relevant models among the N - 1 others; g_i = 1 if the model at
rank i is relevant. New measures are added here and nowhere else.

References
----------
Shilane, Min, Kazhdan, Funkhouser, "The Princeton Shape Benchmark", SMI 2004.
McSherry & Najork, "Computing information retrieval performance measures efficiently in the presence of tied scores",
ECIR 2008 (expected values under ties).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

__all__ = ["MEASURES", "PRINTED", "Measure", "RandomOrder", "RankedResults"]

FloatArray = NDArray[np.float64]

#: Length of the result list that the E-measure evaluates.
E_MEASURE_DEPTH = 32


@dataclass(frozen=True, eq=False)
class RankedResults:
    """Ranked results of one query.

    Parameters
    ----------
    gains
        Relevance at each rank, shape (N - 1,): 0 or 1, or its expectation if results tie.
    hits_up_to
        Number of relevant results up to each rank, given that there is one at this rank, shape (N - 1,).
    n_relevant
        Number of relevant results in the whole list.
    """

    gains: FloatArray
    hits_up_to: FloatArray
    n_relevant: int

    @property
    def ranks(self) -> NDArray[np.int64]:
        """Ranks 1 ... N - 1."""
        return np.arange(1, len(self.gains) + 1)


@dataclass(frozen=True)
class RandomOrder:
    """List of N - 1 results in random order."""

    n_results: int
    n_relevant: int

    @property
    def share(self) -> float:
        """Share of relevant results."""
        return self.n_relevant / self.n_results

    def hits(self, rank: int) -> float:
        """Return the expected number of relevant results up to a rank."""
        return self.share * min(rank, self.n_results)


@dataclass(frozen=True)
class Measure:
    """One measure.

    Parameters
    ----------
    name
        Name in tables, records and CSV.
    title
        Name in words.
    formula
        Definition for one query.
    source
        Source of the definition.
    of_query
        Value for a query.
    by_chance
        Expected value for a query with results in random order.
    cumulated
        Maximum contribution of the first k ranks of a query with ``n_relevant`` relevant results, for an array of the
        numbers k = 0 ... N - 1; None for a measure that is not a weighted sum over ranks.
    """

    name: str
    title: str
    formula: str
    source: str
    of_query: Callable[[RankedResults], float]
    by_chance: Callable[[RandomOrder], float]
    cumulated: Callable[[FloatArray, int], FloatArray] | None = None


def discounts(count: int) -> FloatArray:
    """Return the weights of the ranks 1 ... ``count`` in the benchmark's DCG, shape (count,): 1, then 1 / log2(i)."""
    return 1.0 / np.log2(np.maximum(np.arange(1, count + 1), 2))


def _text_discounts(count: int) -> FloatArray:
    """Return the weights of the ranks in evaluation packages for text retrieval: 1 / log2(i + 1)."""
    return 1.0 / np.log2(np.arange(1, count + 1) + 1)


@lru_cache(maxsize=64)
def _sums(weights: Callable[[int], FloatArray], count: int) -> FloatArray:
    """Return the sums of the weights of the first k ranks, k = 0 ... ``count``."""
    sums = np.concatenate([[0.0], np.cumsum(weights(count))])
    sums.flags.writeable = False
    return sums


def _discounted(results: RankedResults, weights: FloatArray) -> float:
    return float((weights * results.gains).sum() / weights[: results.n_relevant].sum())


def _discounted_by_chance(order: RandomOrder, weights: Callable[[int], FloatArray]) -> float:
    sums = _sums(weights, order.n_results)
    return float(order.share * sums[order.n_results] / sums[order.n_relevant])


def _cumulated_discounts(counts: FloatArray, n_relevant: int) -> FloatArray:
    sums: FloatArray = _sums(discounts, len(counts) - 1)
    shares: FloatArray = sums / sums[n_relevant]
    return shares


def _e_measure(results: RankedResults) -> float:
    depth = min(E_MEASURE_DEPTH, len(results.gains))
    return float(2.0 * results.gains[:depth].sum() / (depth + results.n_relevant))


def _e_measure_by_chance(order: RandomOrder) -> float:
    depth = min(E_MEASURE_DEPTH, order.n_results)
    return 2.0 * order.hits(depth) / (depth + order.n_relevant)


def _average_precision_by_chance(order: RandomOrder) -> float:
    """Return the expected average precision.

    Each rank before a relevant result holds another one with probability ``(n_relevant - 1) / (n_results - 1)``.
    """
    before = np.arange(order.n_results) * (order.n_relevant - 1) / max(order.n_results - 1, 1)
    return float(((1.0 + before) / np.arange(1, order.n_results + 1)).mean())


_PSB = "Shilane, Min, Kazhdan, Funkhouser 2004"

MEASURES: tuple[Measure, ...] = (
    Measure(
        "NN", "nearest neighbour", "g_1", _PSB,
        lambda results: float(results.gains[0]),
        lambda order: order.hits(1),
        lambda counts, n_relevant: np.minimum(counts, 1.0),
    ),
    Measure(
        "FT", "first tier", "(g_1 + ... + g_c) / c", _PSB,
        lambda results: float(results.gains[: results.n_relevant].sum() / results.n_relevant),
        lambda order: order.hits(order.n_relevant) / order.n_relevant,
        lambda counts, n_relevant: np.minimum(counts, n_relevant) / n_relevant,
    ),
    Measure(
        "ST", "second tier", "(g_1 + ... + g_min(2c, N - 1)) / c", _PSB,
        lambda results: float(results.gains[: 2 * results.n_relevant].sum() / results.n_relevant),
        lambda order: order.hits(2 * order.n_relevant) / order.n_relevant,
        lambda counts, n_relevant: np.minimum(counts, 2.0 * n_relevant) / n_relevant,
    ),
    Measure(
        "DCG", "discounted cumulative gain", "sum w_i g_i / (w_1 + ... + w_c) with w_1 = 1, w_i = 1 / log2(i)", _PSB,
        lambda results: _discounted(results, discounts(len(results.gains))),
        lambda order: _discounted_by_chance(order, discounts),
        _cumulated_discounts,
    ),
    Measure(
        "E", "E-measure", "2 h / (k + c), h hits in the first k = min(32, N - 1) ranks", _PSB,
        _e_measure, _e_measure_by_chance,
    ),
    Measure(
        "nDCG", "normalised discounted cumulative gain", "as DCG with w_i = 1 / log2(i + 1)",
        "Jarvelin, Kekalainen 2002",
        lambda results: _discounted(results, _text_discounts(len(results.gains))),
        lambda order: _discounted_by_chance(order, _text_discounts),
    ),
    Measure(
        "mAP", "mean average precision", "mean over the relevant shapes of the precision at their rank",
        "Manning, Raghavan, Schutze 2008",
        lambda results: float((results.gains * results.hits_up_to / results.ranks).sum() / results.n_relevant),
        _average_precision_by_chance,
    ),
)  # fmt: skip
"""All measures in a record."""

PRINTED: tuple[str, ...] = tuple(measure.name for measure in MEASURES[:4])
"""Measures that the paper and the tables print, in the order of the paper."""
