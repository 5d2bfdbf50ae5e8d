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
    """Score the rankings of a gallery by distance, for queries with known classes.

    Each query ranks the shapes of the gallery, without itself; those of its class are relevant. A
    shape without a result scores 0 in every measure as a query, and ranks behind all other shapes
    as a target.

    Parameters
    ----------
    distances
        Distances between the m queries and the n shapes of the gallery that have a result, shape
        (m, n), finite. If the queries are the gallery, the matrix is symmetric, with zeros on its
        diagonal.
    labels
        Class of each of the M queries, with and without a result, of any comparable type.
    answered
        Indices of the m queries that have a result, in their order; None for all.
    targets
        The gallery of N shapes; None if it is the queries.

    Returns
    -------
    Scores
        Means of all measures, and their values for each query.

    Raises
    ------
    ConfigurationError
        If the matrix is refused by :func:`check_distances`, does not fit the labels, or there is
        nothing to retrieve.
    """
    names = np.asarray(labels)
    gallery = targets or Targets(names, np.arange(len(names)), answered)
    queries_with_result = _places(answered, names)
    shapes_with_result = _places(gallery.answered, gallery.labels)
    size = (len(queries_with_result), len(shapes_with_result))
    matrix = check_distances(distances, size, is_square=targets is None)
    query_classes, gallery_classes = _numbered_classes(names, gallery.labels)
    n_shapes = len(gallery_classes)
    # Which shapes each query ranks (all but itself), and which of these are relevant: shape (M, N).
    left_out = np.broadcast_to(gallery.own, names.shape)
    is_ranked = np.arange(n_shapes) != left_out[:, None]
    is_relevant = (query_classes[:, None] == gallery_classes) & is_ranked
    values = np.zeros((len(names), len(MEASURES)))
    n_tied = 0
    for known_distances, query in zip(matrix, queries_with_result, strict=True):
        ranked = is_ranked[query]
        if is_relevant[query].any():
            all_distances = _with_others_last(known_distances, shapes_with_result, n_shapes)
            values[query], is_tied = _of_query(all_distances[ranked], is_relevant[query][ranked])
            n_tied += is_tied
    # A query without a relevant shape has no values.
    values[~is_relevant.any(axis=1)] = np.nan
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


def _with_others_last(
    distances: FloatArray, shapes: NDArray[np.integer], n_shapes: int
) -> FloatArray:
    """Return distances to all shapes of a gallery, of which some have no distance yet.

    These get one distance, which is larger than any other, so that they rank last.

    Parameters
    ----------
    distances
        Distances to the shapes with a result, shape (n,).
    shapes
        Indices of these shapes in the gallery, shape (n,).
    n_shapes
        Number of shapes in the gallery.
    """
    farther_than_any = 2.0 * np.abs(distances).max() + 1.0
    all_distances = np.full(n_shapes, farther_than_any)
    all_distances[shapes] = distances
    return all_distances


def score_draws(
    matrices: Iterable[FloatArray],
    labels: Sequence[str],
    answered: Sequence[int] | None = None,
    targets: Targets | None = None,
) -> dict[str, Any]:
    """Score each of several matrices of distances, and average the measures over them.

    Parameters
    ----------
    matrices
        Distances of the same queries and gallery in each draw of the scorer, of shape (m, n). An
        iterator keeps only one matrix in memory at a time.
    labels
        Class of each query, shape (M,).
    answered
        Indices of the m queries that have a result, in their order; None for all.
    targets
        The gallery of n shapes with a result; None if it is the queries.

    Returns
    -------
    dict
        - ``scores``: mean over all draws and queries, by measure;
        - ``per_query``: means of each query over all draws, by measure; None for a query without a
          relevant shape;
        - ``draw_errors``: standard error of the mean over the draws, by measure; empty for one
          draw;
        - ``tied_queries``, ``lone_queries``: numbers of queries with ties, and without a relevant
          shape.

    Raises
    ------
    ConfigurationError
        If :func:`evaluate` refuses a matrix.
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
    """Return the expected value of each measure if all rankings are random.

    These are the values for distances that are all equal, because a measure is averaged over the
    orders of equal distances.

    Parameters
    ----------
    labels
        Class of each query, shape (M,).
    targets
        The gallery; None if it is the queries.

    Returns
    -------
    dict
        Mean of each measure by its name.
    """
    names = np.asarray(labels)
    gallery = targets or Targets(names, np.arange(len(names)))
    query_classes, gallery_classes = _numbered_classes(names, gallery.labels)
    n_classes = max(query_classes.max(initial=-1), gallery_classes.max(initial=-1)) + 1
    # Index of each query in the gallery, -1 if it is not there. A query does not rank itself.
    own = np.broadcast_to(gallery.own, names.shape)
    is_in_gallery = own >= 0
    is_relevant_itself = is_in_gallery & (gallery_classes[own] == query_classes)
    class_sizes = np.bincount(gallery_classes, minlength=n_classes)
    n_relevant = class_sizes[query_classes] - is_relevant_itself
    n_results = len(gallery_classes) - is_in_gallery
    # The values of a query depend on two numbers alone: of its results, and of the relevant ones.
    numbers = np.column_stack([n_results, n_relevant])
    kinds, kind_of_query = np.unique(numbers, axis=0, return_inverse=True)
    values = np.full((len(names), len(MEASURES)), np.nan)
    for kind, (results, relevant) in enumerate(kinds.tolist()):
        if relevant:
            all_tied = np.zeros(results)
            values_of_kind, _ = _of_query(all_tied, np.arange(results) < relevant)
            values[kind_of_query == kind] = values_of_kind
    return _means(values, has_targets=targets is not None)


def check_distances(distances: ArrayLike, shape: tuple[int, int], *, is_square: bool) -> FloatArray:
    """Check a matrix of distances, and return it as float64.

    Parameters
    ----------
    distances
        Distances of queries (rows) to shapes (columns), in any form that numpy reads.
    shape
        Number of queries and of shapes.
    is_square
        Whether the shapes are the queries, so that the matrix must be symmetric, with zeros on its
        diagonal.

    Raises
    ------
    ConfigurationError
        If the matrix has another shape; if a distance is negative or not finite; or if the matrix
        should be symmetric with zeros on its diagonal, and is not.
    """
    matrix = np.asarray(distances, dtype=np.float64)
    if matrix.shape != shape:
        problem = f"{shape[0]} queries and {shape[1]} shapes have distances of shape {matrix.shape}"
        raise ConfigurationError(problem, "compare all pairs")
    not_finite = np.argwhere(~np.isfinite(matrix))
    if len(not_finite):
        row, column = not_finite[0] + 1
        problem = f"distances are NaN or infinite, the first in row {row}, column {column}"
        hint = "use a distance larger than all others if a method has no result"
        raise ConfigurationError(problem, hint)
    # Rounding may make a distance slightly negative, measured by the largest one.
    is_off_diagonal = ~np.eye(*shape, dtype=bool) if is_square else True
    largest = np.abs(matrix).max(initial=0.0, where=is_off_diagonal)
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
    """Compute all measures for the ranking of one query.

    Shapes are ranked by distance. If several have the same distance, a measure is its mean over all
    orders of these shapes.

    Parameters
    ----------
    distances
        Distance of the query to each shape that it ranks, shape (k,).
    relevant
        Which of these shapes have the class of the query, shape (k,). A rank of such a shape is
        called a hit.

    Returns
    -------
    values : list of float
        Value of each measure, in the order of :data:`MEASURES`.
    is_tied : bool
        Whether ties matter: a shape of the class and another one have the same distance.
    """
    order = np.argsort(distances, kind="stable")
    hits = relevant[order].astype(np.float64)
    # Groups of equal distances: the first rank, the number of ranks, and the hits of each group.
    starts = np.flatnonzero(np.diff(distances[order], prepend=-np.inf) > 0)
    sizes = np.diff(starts, append=len(order))
    group_hits = np.add.reduceat(hits, starts)
    results = _expected_ranking(starts, sizes, group_hits)
    values = [measure.of_query(results) for measure in MEASURES.values()]
    is_mixed = (group_hits > 0) & (group_hits < sizes)
    return values, bool(is_mixed.any())


def _expected_ranking(
    starts: NDArray[np.int64], sizes: NDArray[np.int64], hits: FloatArray
) -> RankedList:
    """Return the mean ranking over all orders of the shapes at equal distances.

    Parameters
    ----------
    starts
        First rank, from 0, of each group of shapes at an equal distance, shape (groups,).
    sizes
        Number of ranks of each group, shape (groups,).
    hits
        Number of hits in each group, shape (groups,).
    """
    # Each rank gets the mean of its group: with 1 hit in 4 ranks, each holds 1/4 of a hit.
    size = np.repeat(sizes, sizes)
    hits_of_group = np.repeat(hits, sizes)
    expected_hits = hits_of_group / size
    # Expected number of hits up to a rank if the rank itself is a hit: those of the groups before,
    # the hit itself, and, in a group of t ranks with h hits, (h - 1) / (t - 1) for each earlier
    # rank of the group.
    ranks_before = np.arange(len(size)) - np.repeat(starts, sizes)
    hits_before_group = np.repeat(np.cumsum(hits) - hits, sizes)
    hits_of_others = ranks_before * (hits_of_group - 1) / np.maximum(size - 1, 1)
    hits_up_to = hits_before_group + 1 + hits_of_others
    return RankedList(expected_hits, hits_up_to, int(hits.sum()))
