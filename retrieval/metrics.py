"""Retrieval measures as the Princeton Shape Benchmark and the SHREC tracks define them.

For a query of a class of size C there are c = C - 1 relevant models among the N - 1 others; the query itself is removed
by its index, so that a duplicate at distance 0 counts as a result. With g_i = 1 if the model at rank i is relevant:

- NN (nearest neighbour) = g_1
- FT (first tier) = sum of g_1 ... g_c, divided by c; ST (second tier) the same up to rank min(2c, N - 1)
- E (E-measure) = 2 h / (k + c) with h hits in the first k = min(32, N - 1) ranks
- DCG = sum w_i g_i / (sum of w_1 ... w_c) with w_1 = 1 and w_i = 1 / log2(i), over the full list
- nDCG: the same with w_i = 1 / log2(i + 1), as evaluation packages for text have it; another number
- AP (average precision) = mean over the relevant models of the precision at their rank

References
----------
Shilane, Min, Kazhdan, Funkhouser, "The Princeton Shape Benchmark", SMI 2004.
McSherry & Najork, "Computing information retrieval performance measures efficiently in the presence of tied scores",
ECIR 2008 (expected values under ties).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.errors import ConfigurationError

FloatArray = NDArray[np.float64]

#: Length of the result list that the E-measure looks at.
E_MEASURE_DEPTH = 32
#: Largest asymmetry of a distance matrix, relative to its largest entry.
ASYMMETRY = 1e-6
#: Rows of a distance matrix that are looked at together.
ROWS = 256


@dataclass(frozen=True, eq=False)
class PerQuery:
    """Measures of each query, each of shape (N,); NaN for the only member of a class."""

    nn: FloatArray
    ft: FloatArray
    st: FloatArray
    e: FloatArray
    dcg: FloatArray
    ndcg: FloatArray
    ap: FloatArray


@dataclass(frozen=True, eq=False)
class Scores:
    """Measures averaged over all queries that have a relevant model.

    Parameters
    ----------
    nn, ft, st, e, dcg, ndcg
        Means of the measures defined at the top of this module.
    mean_ap
        Mean average precision.
    per_query
        The same for each query.
    tied_queries
        Number of queries with two results at the same distance of which one is relevant and one is not.
    lone_queries
        Number of queries without a relevant model; they count in no mean.
    """

    nn: float
    ft: float
    st: float
    e: float
    dcg: float
    ndcg: float
    mean_ap: float
    per_query: PerQuery
    tied_queries: int
    lone_queries: int


def evaluate(
    distances: ArrayLike,
    labels: ArrayLike,
    ties: Literal["expected", "index"] = "expected",
    answered: ArrayLike | None = None,
) -> Scores:
    """Score a distance matrix against the classes of its shapes.

    A shape without a result is a query with 0 in every measure, and a target behind all shapes that have one.

    Parameters
    ----------
    distances
        Shape (n, n), symmetric and finite, of the shapes that have a result; the diagonal is ignored.
    labels
        Class of each shape of the gallery, shape (N,), of any type that can be compared.
    ties
        ``"expected"``: the exact mean over all orders of results at equal distance, so that neither names nor file
        order matter. ``"index"``: the lower index first, as the benchmark's program psbTable does.
    answered
        Places of the n shapes that have a result, in their order; None for all.

    Returns
    -------
    Scores
        Means, measures per query, and the number of queries with ties.

    Raises
    ------
    ConfigurationError
        If the matrix is not square, finite and symmetric, does not fit the labels, or ``ties`` is unknown.
    """
    matrix, classes, has_result = with_missing(distances, labels, answered)
    if ties not in ("expected", "index"):
        raise ConfigurationError(f"unknown rule for ties '{ties}'", "choose expected or index")
    rows = [_score_query(matrix[query], classes, query, ties) for query in range(len(classes))]
    rows = [row if has else _failed(row) for row, has in zip(rows, has_result, strict=True)]
    values = np.array([row[:-1] for row in rows]).reshape(-1, len(fields(PerQuery)))
    scored = ~np.isnan(values[:, 0])
    if not scored.any():
        raise ConfigurationError("no class has two members", "check the labels: nothing can be retrieved")
    nn, ft, st, e, dcg, ndcg, mean_ap = values[scored].mean(axis=0).tolist()
    return Scores(
        nn=nn,
        ft=ft,
        st=st,
        e=e,
        dcg=dcg,
        ndcg=ndcg,
        mean_ap=mean_ap,
        per_query=PerQuery(*values.T),
        tied_queries=sum(bool(row[-1]) for row in rows),
        lone_queries=int((~scored).sum()),
    )


def with_missing(
    distances: ArrayLike, labels: ArrayLike, answered: ArrayLike | None
) -> tuple[FloatArray, NDArray[np.intp], NDArray[np.bool_]]:
    """Return the distances of a whole gallery, in which shapes without a result are farther away than all others.

    Parameters
    ----------
    distances, labels, answered
        As of :func:`evaluate`.

    Returns
    -------
    tuple
        Distances, shape (N, N); number of the class of each shape, shape (N,); which shapes have a result, shape (N,).

    Raises
    ------
    ConfigurationError
        As of :func:`check_distances`.
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


def _failed(row: tuple[float, ...]) -> tuple[float, ...]:
    """Measures of a query without a result: none, but where it has no relevant model anyway."""
    return (*np.where(np.isnan(row[:-1]), np.nan, 0.0).tolist(), False)


def discounts(count: int) -> FloatArray:
    """Weights of the ranks 1 ... ``count`` in the benchmark's DCG, shape (count,): 1, then 1 / log2(i)."""
    return 1.0 / np.log2(np.maximum(np.arange(1, count + 1), 2))


def check_distances(distances: ArrayLike, labels: ArrayLike) -> tuple[FloatArray, NDArray[np.intp]]:
    """The matrix of shape (N, N) and the number of the class of each shape, shape (N,).

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
    for start in range(0, len(matrix), ROWS):  # a copy of the whole matrix may not fit beside it
        rows, columns = matrix[start : start + ROWS], matrix[:, start : start + ROWS]
        if not np.isfinite(rows).all():
            raise ConfigurationError(
                "a distance is NaN or infinite", "leave out the shapes that the method cannot treat"
            )
        with np.errstate(invalid="ignore"):  # what is infinite below is found below
            difference = max(difference, float(np.abs(rows - columns.T).max(initial=0.0)))
        largest = max(largest, float(np.abs(rows).max(initial=0.0)))
    if difference > ASYMMETRY * largest:
        raise ConfigurationError(
            f"the distances are not symmetric (largest difference {difference:.3g})", "average them with the transpose"
        )
    return matrix, np.unique(names, return_inverse=True)[1]


def _score_query(row: FloatArray, classes: NDArray[np.intp], query: int, ties: str) -> tuple[float, ...]:
    """Return NN, FT, ST, E, DCG, nDCG, AP and whether ties matter."""
    others = np.delete(np.arange(len(row)), query)
    order = others[np.argsort(row[others], kind="stable")]
    relevant = (classes[order] == classes[query]).astype(np.float64)
    n_relevant, n_results = int(relevant.sum()), len(order)
    if n_relevant == 0:
        return (*[np.nan] * len(fields(PerQuery)), False)

    # Each rank lies in a group of equal distances: its first rank, its size, and the hits in it and before it.
    starts = np.flatnonzero(np.diff(row[order], prepend=-np.inf) > 0)
    sizes = np.diff(starts, append=n_results)
    group_hits = np.add.reduceat(relevant, starts)
    tied = bool(((group_hits > 0) & (group_hits < sizes)).any())
    ranks = np.arange(1, n_results + 1)
    if ties == "index":
        gains = relevant
        hits_up_to = np.cumsum(relevant)
    else:
        size, hits = np.repeat(sizes, sizes), np.repeat(group_hits, sizes)
        gains = hits / size
        # Given a hit at this rank, the earlier ranks of its group hold (h - 1) / (t - 1) hits each, on average.
        inside = ranks - 1 - np.repeat(starts, sizes)
        before = np.repeat(np.cumsum(group_hits) - group_hits, sizes)
        hits_up_to = before + 1 + inside * (hits - 1) / np.maximum(size - 1, 1)

    depth = min(E_MEASURE_DEPTH, n_results)
    weights, text_weights = discounts(n_results), 1.0 / np.log2(ranks + 1)
    return (
        gains[0],
        gains[:n_relevant].sum() / n_relevant,
        gains[: 2 * n_relevant].sum() / n_relevant,
        2.0 * gains[:depth].sum() / (depth + n_relevant),
        (weights * gains).sum() / weights[:n_relevant].sum(),
        (text_weights * gains).sum() / text_weights[:n_relevant].sum(),
        (gains * hits_up_to / ranks).sum() / n_relevant,
        tied,
    )
