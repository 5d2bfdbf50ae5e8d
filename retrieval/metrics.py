"""Scores of a distance matrix: each measure for each query, and its mean.

The query itself is removed by its index, so that a duplicate at distance 0 counts as a result. For the measures, see
:mod:`retrieval.measures`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.errors import ConfigurationError
from retrieval.measures import MEASURES, FloatArray, RankedResults

#: Largest asymmetry of a distance matrix, relative to its largest entry off the diagonal.
ASYMMETRY = 1e-6
#: Number of rows of a distance matrix that are checked together.
ROWS = 256


@dataclass(frozen=True, eq=False)
class Query:
    """Results of one query, in any order.

    Parameters
    ----------
    distances, relevant
        Distance of each result from the query, and whether it is relevant, shape (n,) each.
    is_answered
        Whether the query has results; without them it scores 0 in every measure.
    """

    distances: FloatArray
    relevant: NDArray[np.bool_]
    is_answered: bool = True


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of a gallery.

    Parameters
    ----------
    means
        Each of :data:`retrieval.measures.MEASURES`, averaged over all queries that have a relevant model.
    per_query
        The same for each query, each of shape (N,); NaN for the only member of a class.
    tied_queries
        Number of queries with a relevant and an irrelevant result at the same distance.
    lone_queries
        Number of queries without a relevant model; the means exclude them.
    """

    means: dict[str, float]
    per_query: dict[str, FloatArray]
    tied_queries: int
    lone_queries: int


def evaluate(
    distances: ArrayLike,
    labels: ArrayLike,
    ties: Literal["expected", "index"] = "expected",
    answered: ArrayLike | None = None,
) -> Scores:
    """Score a distance matrix against the classes of its shapes.

    A shape without a result scores 0 in every measure as a query, and ranks behind all other shapes as a target.

    Parameters
    ----------
    distances
        Distances between the shapes that have a result, shape (n, n), symmetric and finite; the diagonal is ignored.
    labels
        Class of each shape of the gallery, shape (N,), of any comparable type.
    ties
        ``"expected"``: the exact mean over all orders of results at equal distance, so that neither names nor file
        order matter. ``"index"``: the lower index first, as in the benchmark's program psbTable.
    answered
        Indices of the n shapes that have a result, in their order; None for all.

    Returns
    -------
    Scores
        Means, measures per query, and number of queries with ties.

    Raises
    ------
    ConfigurationError
        If the matrix is not square, finite and symmetric, does not fit the labels, or ``ties`` is unknown.
    """
    names = np.asarray(labels)
    places = np.arange(len(names)) if answered is None else np.asarray(answered, dtype=np.intp)
    return evaluate_rows(check_distances(distances, names[places])[0], labels, ties, answered)[0]


def evaluate_rows(
    rows: Iterable[FloatArray],
    labels: ArrayLike,
    ties: Literal["expected", "index"] = "expected",
    answered: ArrayLike | None = None,
) -> tuple[Scores, Scores | None]:
    """Score the rows of a distance matrix one by one, so that the matrix need not be in memory.

    Parameters
    ----------
    rows
        The n rows, shape (n,) each; read once.
    labels, ties, answered
        As in :func:`evaluate`.

    Returns
    -------
    tuple
        Scores of the gallery; and those of the answered shapes among themselves, None if these are all shapes, belong
        to one class, or are of distinct classes.
    """
    classes = np.unique(np.asarray(labels), return_inverse=True)[1]
    count = len(classes)
    places = np.arange(count) if answered is None else np.asarray(answered, dtype=np.intp)
    alone = classes[places]
    is_partial = answered is not None and 1 < len(set(alone.tolist())) < len(alone) < count
    values = [
        _of_query(Query(np.zeros(count - 1), _relevant(classes, k), is_answered=False), ties) for k in range(count)
    ]
    values_alone = []
    for number, (place, row) in enumerate(zip(places, rows, strict=True)):
        whole = np.full(count, 2.0 * np.abs(row).max(initial=0.0) + 1.0)  # shapes without a result rank last
        whole[places] = row
        values[place] = _of_query(Query(np.delete(whole, place), _relevant(classes, place)), ties)
        if is_partial:
            values_alone.append(_of_query(Query(np.delete(row, number), _relevant(alone, number)), ties))
    return _scores(values), _scores(values_alone) if is_partial else None


def _relevant(classes: NDArray[np.intp], query: int) -> NDArray[np.bool_]:
    return np.asarray(np.delete(classes, query) == classes[query])


def evaluate_queries(queries: Iterable[Query], ties: Literal["expected", "index"] = "expected") -> Scores:
    """Score queries with separate results; see :func:`evaluate`.

    Raises
    ------
    ConfigurationError
        If no query has a relevant result, or ``ties`` is unknown.
    """
    return _scores([_of_query(query, ties) for query in queries])


def _of_query(query: Query, ties: str) -> tuple[list[float], bool]:
    """Return all measures of a query (NaN if nothing is relevant), and whether ties matter."""
    if ties not in ("expected", "index"):
        raise ConfigurationError(f"unknown rule for ties '{ties}'", "choose expected or index")
    if not query.relevant.any():
        return [np.nan] * len(MEASURES), False
    if not query.is_answered:
        return [0.0] * len(MEASURES), False
    results, is_tied = _ranked(query, ties)
    return [measure.of_query(results) for measure in MEASURES], is_tied


def _scores(of_queries: Sequence[tuple[list[float], bool]]) -> Scores:
    values = np.array([measures for measures, _ in of_queries]).reshape(-1, len(MEASURES))
    scored = ~np.isnan(values[:, 0])
    if not scored.any():
        raise ConfigurationError("no class has two members", "check the labels: nothing can be retrieved")
    names = [measure.name for measure in MEASURES]
    return Scores(
        means=dict(zip(names, values[scored].mean(axis=0).tolist(), strict=True)),
        per_query=dict(zip(names, values.T, strict=True)),
        tied_queries=sum(is_tied for _, is_tied in of_queries),
        lone_queries=int((~scored).sum()),
    )


def with_missing(
    distances: ArrayLike, labels: ArrayLike, answered: ArrayLike | None
) -> tuple[FloatArray, NDArray[np.intp], NDArray[np.bool_]]:
    """Return the distances of a whole gallery, with shapes without a result farther away than all others.

    Parameters
    ----------
    distances, labels, answered
        As in :func:`evaluate`.

    Returns
    -------
    tuple
        Distances, shape (N, N); class number of each shape, shape (N,); whether each shape has a result, shape (N,).

    Raises
    ------
    ConfigurationError
        As in :func:`check_distances`.
    """
    names = np.asarray(labels)
    if answered is None:
        matrix, classes = check_distances(distances, names)
        return matrix, classes, np.ones(len(classes), dtype=np.bool_)
    places = np.asarray(answered, dtype=np.intp)
    known, _ = check_distances(distances, names[places])
    has_result = np.zeros(len(names), dtype=np.bool_)
    has_result[places] = True
    whole = np.full((len(names), len(names)), 2.0 * np.abs(known).max(initial=0.0) + 1.0)
    whole[np.ix_(places, places)] = known
    return whole, np.unique(names, return_inverse=True)[1], has_result


def check_distances(distances: ArrayLike, labels: ArrayLike) -> tuple[FloatArray, NDArray[np.intp]]:
    """Check a distance matrix; return it, shape (N, N), and the class number of each shape, shape (N,).

    Raises
    ------
    ConfigurationError
        If the matrix is not square, finite and symmetric, or does not fit the labels.
    """
    matrix = np.asarray(distances, dtype=np.float64)
    names = np.asarray(labels)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ConfigurationError(f"the distances have shape {matrix.shape}, not (N, N)", "compare all pairs of shapes")
    if names.shape != (len(matrix),):
        raise ConfigurationError(
            f"there are {len(matrix)} rows of distances but labels of shape {names.shape}", "pass one label per shape"
        )
    difference = largest = 0.0
    for start in range(0, len(matrix), ROWS):  # a copy of the whole matrix may not fit in memory
        rows, columns = matrix[start : start + ROWS], matrix[:, start : start + ROWS]
        if not np.isfinite(rows).all():
            raise ConfigurationError(
                "a distance is NaN or infinite", "leave out the shapes that the method cannot treat"
            )
        with np.errstate(invalid="ignore"):  # infinite entries of later rows are found later
            difference = max(difference, float(np.abs(rows - columns.T).max(initial=0.0)))
        off_diagonal = np.arange(start, start + len(rows))[:, np.newaxis] != np.arange(len(matrix))
        largest = max(largest, float(np.abs(rows).max(initial=0.0, where=off_diagonal)))
    if difference > ASYMMETRY * largest:
        raise ConfigurationError(
            f"the distances are not symmetric (largest difference {difference:.3g})", "average them with the transpose"
        )
    return matrix, np.unique(names, return_inverse=True)[1]


def _ranked(query: Query, ties: str) -> tuple[RankedResults, bool]:
    """Return the ranked results of a query, and whether ties matter."""
    order = np.argsort(query.distances, kind="stable")
    relevant = query.relevant[order].astype(np.float64)
    n_relevant, n_results = int(relevant.sum()), len(order)

    # Each rank lies in a group of equal distances: its first rank, its size, and the hits in it and before it.
    starts = np.flatnonzero(np.diff(query.distances[order], prepend=-np.inf) > 0)
    sizes = np.diff(starts, append=n_results)
    group_hits = np.add.reduceat(relevant, starts)
    is_tied = bool(((group_hits > 0) & (group_hits < sizes)).any())
    if ties == "index":
        gains = relevant
        hits_up_to = np.cumsum(relevant)
    else:
        size, hits = np.repeat(sizes, sizes), np.repeat(group_hits, sizes)
        gains = hits / size
        # Given a hit at this rank, the earlier ranks of its group hold (h - 1) / (t - 1) hits each, on average.
        inside = np.arange(n_results) - np.repeat(starts, sizes)
        before = np.repeat(np.cumsum(group_hits) - group_hits, sizes)
        hits_up_to = before + 1 + inside * (hits - 1) / np.maximum(size - 1, 1)
    return RankedResults(gains, hits_up_to, n_relevant), is_tied
