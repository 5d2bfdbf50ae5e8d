"""Retrieval measures of a distance matrix: of each query, their means, and their chance level.

The shapes of a gallery are ranked for each query. If the query is one of them, it is removed by its
index, so that a duplicate at distance 0 counts as a result. N results remain, of which c are of its
class: relevant. g_i = 1 if the result at rank i is relevant. With results at equal distance,
measures are means over their orders.

References
----------
Shilane, Min, Kazhdan, Funkhouser, "The Princeton Shape Benchmark", SMI 2004 (NN, FT, ST, DCG, E).
Jarvelin & Kekalainen, "Cumulated gain-based evaluation of IR techniques", 2002 (nDCG); Manning,
Raghavan & Schutze, "Introduction to information retrieval", 2008 (mAP). McSherry & Najork,
"Computing information retrieval performance measures efficiently in the presence of tied scores",
ECIR 2008 (expected values under ties).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.errors import ConfigurationError

if TYPE_CHECKING:
    from benchmark.geometry.mesh import FloatArray


#: Decimals of the measures of single queries in records.
DECIMALS = 6

#: Length of the result list that the E-measure evaluates.
E_MEASURE_DEPTH = 32

#: Largest asymmetry of a distance matrix, and least negative entry, relative to its largest entry
#: off the diagonal.
ASYMMETRY = 1e-6

#: Largest entry on the diagonal, relative to the largest off it: where distances are computed from
#: products of vectors, rounding turns a distance of 0 into the root of what is lost.
SELF_DISTANCE = 1e-3


@dataclass(frozen=True, eq=False)
class RankedList:
    """The results of a query, nearest first, of which some are relevant.

    Parameters
    ----------
    gains
        Probability that the result at each rank is relevant, over the orders of tied results, shape
        (N,).
    hits
        Expected number of relevant results up to each rank if the one at this rank is relevant.
    n_relevant
        Number of relevant results, c.
    """

    gains: FloatArray
    hits: FloatArray
    n_relevant: int

    @property
    def ranks(self) -> NDArray[np.int64]:
        """Ranks of the results, from 1."""
        return np.arange(1, len(self.gains) + 1)


@dataclass(frozen=True)
class Measure:
    """A retrieval measure: everything that scorers, tables and tests know of it.

    Parameters
    ----------
    name
        Its name in records and tables.
    definition
        Its definition for one query.
    of_query
        Returns it for the results of a query.
    depth
        Most results whose order decides nothing: among so few, every ranking has the same score.
    """

    name: str
    definition: str
    of_query: Callable[[RankedList], float]
    depth: int = 1

    def says_something(self, n_results: int) -> bool:
        """Return whether two rankings of so many results can differ in it."""
        return n_results > self.depth


def _nearest_neighbour(results: RankedList) -> float:
    """Return NN."""
    return float(results.gains[0])


def _first_tier(results: RankedList) -> float:
    """Return FT."""
    return float(results.gains[: results.n_relevant].sum() / results.n_relevant)


def _second_tier(results: RankedList) -> float:
    """Return ST."""
    return float(results.gains[: 2 * results.n_relevant].sum() / results.n_relevant)


def _gain_of_princeton(results: RankedList) -> float:
    """Return DCG, as the Princeton Shape Benchmark defines it."""
    weights = 1 / np.log2(np.maximum(results.ranks, 2))
    return float(weights @ results.gains / weights[: results.n_relevant].sum())


def _e_measure(results: RankedList) -> float:
    """Return E."""
    depth = min(E_MEASURE_DEPTH, len(results.gains))
    return float(2 * results.gains[:depth].sum() / (depth + results.n_relevant))


def _normalised_gain(results: RankedList) -> float:
    """Return nDCG."""
    weights = 1 / np.log2(results.ranks + 1)
    return float(weights @ results.gains / weights[: results.n_relevant].sum())


def _average_precision(results: RankedList) -> float:
    """Return mAP of one query."""
    return float((results.gains * results.hits / results.ranks).sum() / results.n_relevant)


_ALL = (
    Measure("NN", "nearest neighbour: g_1", _nearest_neighbour),
    Measure("FT", "first tier: (g_1 + ... + g_c) / c", _first_tier),
    Measure("ST", "second tier: (g_1 + ... + g_min(2c, N)) / c", _second_tier, depth=2),
    Measure(
        "DCG",
        (
            "discounted cumulative gain: sum w_i g_i / (w_1 + ... + w_c) with w_1 = 1, w_i = 1 / "
            "log2(i)"
        ),
        _gain_of_princeton,
        depth=2,
    ),
    Measure(
        "E",
        "E-measure: 2 h / (k + c), h hits in the first k = min(32, N) ranks",
        _e_measure,
        depth=E_MEASURE_DEPTH,
    ),
    Measure(
        "nDCG",
        "normalised discounted cumulative gain: as DCG with w_i = 1 / log2(i + 1)",
        _normalised_gain,
    ),
    Measure(
        "mAP",
        "mean average precision: mean over the relevant shapes of the precision at their rank",
        _average_precision,
    ),
)

MEASURES: Mapping[str, Measure] = {measure.name: measure for measure in _ALL}
"""All measures in a record, by name."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of a gallery.

    Parameters
    ----------
    means
        Each of :data:`MEASURES`, averaged over all queries that have a relevant result.
    per_query
        The same for each query; NaN for one without a relevant result.
    tied_queries
        Number of queries with a relevant and an irrelevant result at the same distance, at any
        rank.
    lone_queries
        Number of queries without a relevant result; the means exclude them.
    """

    means: dict[str, float]
    per_query: dict[str, FloatArray]
    tied_queries: int
    lone_queries: int


@dataclass(frozen=True, eq=False)
class Targets:
    """The gallery of queries.

    Parameters
    ----------
    labels
        Class of each shape, shape (N,).
    own
        For each query, the index of the shape that is left out for it, such as itself; -1 for none.
    answered
        Indices of the shapes that have a result; None for all.
    """

    labels: ArrayLike
    own: ArrayLike = -1
    answered: ArrayLike | None = None


def evaluate(
    distances: ArrayLike,
    labels: ArrayLike,
    answered: ArrayLike | None = None,
    targets: Targets | None = None,
) -> Scores:
    """Score distances between queries and a gallery against their classes.

    A shape without a result scores 0 in every measure as a query, and ranks behind all other shapes
    as a target.

    Parameters
    ----------
    distances
        Distances between the m queries and the n shapes of the gallery that have a result, shape
        (m, n), finite; if the queries are the gallery, symmetric with a diagonal of 0.
    labels
        Class of each query, shape (M,), of any comparable type.
    answered
        Indices of the m queries that have a result, in their order; None for all.
    targets
        The gallery; None if it is the queries, each of which is left out for itself.

    Raises
    ------
    ConfigurationError
        If the matrix is refused by :func:`check_distances`, does not fit the labels, or there is
        nothing to retrieve.
    """
    names = np.asarray(labels)
    gallery = targets or Targets(names, np.arange(len(names)), answered)
    rows = _places(answered, names)
    columns = _places(gallery.answered, gallery.labels)
    matrix = check_distances(distances, (len(rows), len(columns)), is_square=targets is None)
    of_queries, of_gallery = _numbered_classes(names, gallery.labels)
    left_out = np.broadcast_to(gallery.own, names.shape)
    others = np.arange(len(of_gallery)) != left_out[:, None]
    relevant = (of_queries[:, None] == of_gallery) & others
    values = np.zeros((len(names), len(MEASURES)))
    n_tied = 0
    for row, query in zip(matrix, rows, strict=True):
        # Shapes without a result rank last.
        whole = np.full(len(of_gallery), 2.0 * np.abs(row).max() + 1.0)
        whole[columns] = row
        if relevant[query].any():
            values[query], is_tied = _of_query(whole[others[query]], relevant[query][others[query]])
            n_tied += is_tied
    values[~relevant.any(axis=1)] = np.nan
    return Scores(
        means=_means(values, has_targets=targets is not None),
        per_query=dict(zip(MEASURES, values.T, strict=True)),
        tied_queries=n_tied,
        lone_queries=int(np.isnan(values[:, 0]).sum()),
    )


def _numbered_classes(
    queries: NDArray[Any], gallery: ArrayLike
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the class of each query, and of each shape of the gallery, as a number."""
    both = np.concatenate([queries, np.asarray(gallery)])
    classes = np.unique(both, return_inverse=True)[1]
    return classes[: len(queries)], classes[len(queries) :]


def _means(values: FloatArray, *, has_targets: bool) -> dict[str, float]:
    """Return the mean of each measure over the queries that are not NaN.

    Raises
    ------
    ConfigurationError
        If there is no such query.
    """
    if np.isnan(values).all():
        problem = "no class has two members"
        if has_targets:
            problem = "no query has a shape of its class in the gallery"
        raise ConfigurationError(problem, "check the labels: nothing can be retrieved")
    return dict(zip(MEASURES, np.nanmean(values, axis=0).tolist(), strict=True))


def _places(answered: ArrayLike | None, labels: ArrayLike) -> NDArray[np.intp]:
    """Return the indices of the shapes that have a result: all, if none are named."""
    if answered is None:
        return np.arange(len(np.asarray(labels)))
    return np.asarray(answered, dtype=np.intp)


def score_draws(
    matrices: Iterable[FloatArray],
    labels: Sequence[str],
    answered: Sequence[int] | None = None,
    targets: Targets | None = None,
) -> dict[str, Any]:
    """Return the measures of a gallery as plain numbers, means over the matrices.

    Parameters
    ----------
    matrices
        One for each draw of the scorer, shape (m, n); only one is in memory at a time.
    labels, answered, targets
        As for :func:`evaluate`.

    Returns
    -------
    dict
        ``scores``, ``per_query`` (None for a query without a relevant result) and ``draw_errors``
        (standard error of a mean over several draws) by measure, ``tied_queries`` and
        ``lone_queries``.

    Raises
    ------
    ConfigurationError
        As for :func:`evaluate`.
    """
    draws = [evaluate(matrix, labels, answered, targets) for matrix in matrices]
    scores: dict[str, float] = {}
    per_query: dict[str, list[float | None]] = {}
    draw_errors: dict[str, float] = {}
    for name in draws[0].means:
        means = [draw.means[name] for draw in draws]
        scores[name] = float(np.mean(means))
        if len(draws) > 1:
            draw_errors[name] = float(np.std(means, ddof=1) / len(draws) ** 0.5)
        of_queries = np.mean([draw.per_query[name] for draw in draws], axis=0)
        per_query[name] = [_in_record(value) for value in of_queries]
    return {
        "scores": scores,
        "per_query": per_query,
        "draw_errors": draw_errors,
        "tied_queries": max(draw.tied_queries for draw in draws),
        "lone_queries": draws[0].lone_queries,
    }


def _in_record(value: float) -> float | None:
    """Return a measure of a query as records hold it; None for NaN."""
    return None if np.isnan(value) else round(float(value), DECIMALS)


def chance_levels(labels: ArrayLike, targets: Targets | None = None) -> dict[str, float]:
    """Return the exact means of all measures over random rankings.

    They are those of a matrix in which all distances tie. Queries with as many results, of which as
    many are relevant, have the same values, so that no matrix is needed.
    """
    names = np.asarray(labels)
    gallery = targets or Targets(names, np.arange(len(names)))
    of_queries, of_gallery = _numbered_classes(names, gallery.labels)
    n_classes = max(of_queries.max(initial=-1), of_gallery.max(initial=-1)) + 1
    own = np.broadcast_to(gallery.own, names.shape)
    is_left_out = own >= 0
    loses_one = is_left_out & (of_gallery[own] == of_queries)
    n_relevant = np.bincount(of_gallery, minlength=n_classes)[of_queries] - loses_one
    n_results = len(of_gallery) - is_left_out
    values = np.full((len(names), len(MEASURES)), np.nan)
    sizes, places = np.unique(np.column_stack([n_results, n_relevant]), axis=0, return_inverse=True)
    for place, (results, relevant) in enumerate(sizes.tolist()):
        if relevant:
            of_query, _ = _of_query(np.zeros(results), np.arange(results) < relevant)
            values[places == place] = of_query
    return _means(values, has_targets=targets is not None)


def check_distances(distances: ArrayLike, shape: tuple[int, int], *, is_square: bool) -> FloatArray:
    """Return distances of a shape, which are finite and not negative.

    If queries are the gallery, a symmetric matrix.

    Raises
    ------
    ConfigurationError
        If they are anything else, or differ from 0 on the diagonal, as similarities do.
    """
    matrix = np.asarray(distances, dtype=np.float64)
    if matrix.shape != shape:
        problem = f"{shape[0]} queries and {shape[1]} shapes have distances of shape {matrix.shape}"
        raise ConfigurationError(problem, "compare all pairs")
    wrong = np.argwhere(~np.isfinite(matrix))
    if len(wrong):
        row, column = wrong[0] + 1
        problem = f"distances are NaN or infinite, the first in row {row}, column {column}"
        hint = "use a distance larger than all others if a method has no result"
        raise ConfigurationError(problem, hint)
    is_compared = ~np.eye(*shape, dtype=bool) if is_square else True
    largest = np.abs(matrix).max(initial=0.0, where=is_compared)
    if matrix.min(initial=0.0) < -ASYMMETRY * largest:
        problem = f"a distance is negative ({matrix.min():.3g})"
        raise ConfigurationError(problem, "subtract similarities from the largest")
    if is_square:
        _check_square(matrix, largest)
    return matrix


def _check_square(matrix: FloatArray, largest: float) -> None:
    """Raise ``ConfigurationError`` unless a matrix is symmetric with a diagonal of 0."""
    difference = float(np.abs(matrix - matrix.T).max(initial=0.0))
    if difference > ASYMMETRY * largest:
        problem = f"the distances are not symmetric (largest difference {difference:.3g})"
        raise ConfigurationError(problem, "average them with the transpose")
    itself = matrix.diagonal().max(initial=0.0)
    if itself > SELF_DISTANCE * largest:
        problem = f"a shape is at a distance of {itself:.3g} from itself"
        hint = "return distances, not similarities, with a diagonal of 0"
        raise ConfigurationError(problem, hint)


def _of_query(distances: FloatArray, relevant: NDArray[np.bool_]) -> tuple[list[float], bool]:
    """Return all measures of a query, and whether ties matter."""
    order = np.argsort(distances, kind="stable")
    hits = relevant[order].astype(np.float64)
    n_results = len(order)
    # Each rank lies in a group of equal distances: its first rank, its size, and the hits in it and
    # before it.
    starts = np.flatnonzero(np.diff(distances[order], prepend=-np.inf) > 0)
    sizes = np.diff(starts, append=n_results)
    group_hits = np.add.reduceat(hits, starts)
    size = np.repeat(sizes, sizes)
    in_group = np.repeat(group_hits, sizes)
    gains = in_group / size
    # Given a hit at this rank, the earlier ranks of its group hold (h - 1) / (t - 1) hits each, on
    # average.
    inside = np.arange(n_results) - np.repeat(starts, sizes)
    before = np.repeat(np.cumsum(group_hits) - group_hits, sizes)
    hits_up_to = before + 1 + inside * (in_group - 1) / np.maximum(size - 1, 1)
    results = RankedList(gains, hits_up_to, int(hits.sum()))
    values = [measure.of_query(results) for measure in MEASURES.values()]
    return values, bool(((group_hits > 0) & (group_hits < sizes)).any())
