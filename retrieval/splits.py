"""Scores of every choice of test subjects: how much a table depends on this choice.

A measure of a query is a sum over its relevant results, each with a weight that depends only on its rank. In the
gallery of some subjects, the rank of a result is one more than the number of nearer shapes, and that number is a sum
over the subjects of the gallery. One count of nearer shapes by subject therefore serves all galleries.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.errors import ConfigurationError
from retrieval.measures import MEASURES, PRINTED, FloatArray
from retrieval.metrics import with_missing

__all__ = ["Range", "all_splits", "ranges", "scores_of_splits"]

Label = TypeVar("Label", bound=Hashable)


@dataclass(frozen=True)
class Range:
    """Range of one measure over the splits.

    Parameters
    ----------
    low, median, high
        Quantiles .05, .5 and .95.
    """

    low: float
    median: float
    high: float


def all_splits(
    subjects: Iterable[Label],
    size: int,
    kinds: Mapping[Label, str] | None = None,
    wanted: Mapping[str, int] | None = None,
) -> list[tuple[Label, ...]]:
    """List every choice of test subjects, in the order of the subjects.

    Parameters
    ----------
    subjects
        Labels, each counted once.
    size
        Number of test subjects.
    kinds
        Kind of each subject, e.g. ``"man"``.
    wanted
        Keep only choices with this number of each kind; kinds that are not named may occur any number of times.

    Raises
    ------
    ConfigurationError
        If there is no such choice.
    """
    known = list(dict.fromkeys(subjects))
    splits = list(combinations(known, size))
    if wanted is not None:
        kind_of = kinds or {}
        splits = [
            split
            for split in splits
            if all(sum(kind_of.get(subject) == kind for subject in split) == n for kind, n in wanted.items())
        ]
    if not splits:
        raise ConfigurationError(f"no {size} of {len(known)} subjects can be taken so", "take fewer")
    return splits


def scores_of_splits(
    distances: ArrayLike,
    labels: Sequence[Label],
    splits: Sequence[Sequence[Label]],
    answered: ArrayLike | None = None,
) -> dict[str, FloatArray]:
    """Score the gallery of each split like :func:`retrieval.metrics.evaluate`, with expected values for ties.

    The distances are those of the whole set. If they depend on a codebook, its words were also drawn from the whole set
    and not from each gallery, so a run on one gallery alone may score slightly differently.

    Parameters
    ----------
    distances
        Shape (n, n), symmetric and finite; the diagonal is ignored.
    labels
        Class of each shape, N of them.
    splits
        Classes of each gallery.
    answered
        Indices of the n shapes that have a result; None for all. See :func:`retrieval.metrics.evaluate`.

    Returns
    -------
    dict
        The printed measures that are weighted sums over ranks, each of shape (splits,), averaged over the queries of
        the gallery that have a relevant model.

    Raises
    ------
    ConfigurationError
        If the matrix is not square, finite and symmetric or does not fit the labels; if a split names an unknown class
        or a class twice, or has no class with two members.
    """
    names = list(dict.fromkeys(labels))
    number = {name: k for k, name in enumerate(names)}
    classes = np.array([number[label] for label in labels], dtype=np.intp)
    matrix, _, has_result = with_missing(distances, classes, answered)
    chosen = _membership(splits, number)
    members = [np.flatnonzero(classes == k) for k in range(len(names))]
    summed = {measure.name: measure.cumulated for measure in MEASURES if measure.cumulated and measure.name in PRINTED}
    counts = np.arange(len(classes) + 1, dtype=np.float64)
    totals, queries = np.zeros((len(splits), len(summed))), np.zeros(len(splits))
    for own, of_class in enumerate(members):
        n_relevant = len(of_class) - 1
        if not n_relevant:
            continue
        with_class = np.flatnonzero(chosen[:, own])
        nearer, as_near = _counts(matrix, members, own)
        inside = chosen[with_class].T.astype(np.int64)
        first, size = nearer @ inside, as_near @ inside
        counted = np.repeat(has_result[of_class], n_relevant)
        # A group of equal distances fills the ranks first + 1 ... first + size in random order.
        for column, cumulated in enumerate(summed.values()):
            reached = cumulated(counts, n_relevant)
            gains = (reached[first + size] - reached[first]) / size
            totals[with_class, column] += gains[counted].sum(axis=0)
        queries[with_class] += len(of_class)
    if not queries.all():
        raise ConfigurationError("a split has no class with two members", "leave it out: nothing can be retrieved")
    means = totals / queries[:, None]
    return {measure: means[:, column] for column, measure in enumerate(summed)}


def ranges(scores: Mapping[str, FloatArray]) -> dict[str, Range]:
    """Compute the quantiles .05, .5 and .95 of each measure over the splits."""
    return {measure: Range(*np.quantile(values, (0.05, 0.5, 0.95)).tolist()) for measure, values in scores.items()}


def _membership(splits: Sequence[Sequence[Label]], number: Mapping[Label, int]) -> NDArray[np.bool_]:
    """Return which classes each split contains, shape (splits, classes)."""
    chosen = np.zeros((len(splits), len(number)), dtype=np.bool_)
    for row, split in enumerate(splits):
        unknown = [name for name in split if name not in number]
        if unknown:
            raise ConfigurationError(f"a split names the class {unknown[0]!r}, which no shape has", "correct the split")
        if len(set(split)) < len(split):
            raise ConfigurationError(f"the split {tuple(split)!r} names a class twice", "name each class once")
        chosen[row, [number[name] for name in split]] = True
    return chosen


def _counts(
    matrix: FloatArray, members: Sequence[NDArray[np.intp]], own: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Count the shapes of each class nearer than, and as near as, each relevant result of each query of a class.

    Returns
    -------
    tuple
        Two arrays of shape (queries x relevant results, classes). The result itself counts in the second.
    """
    queries = members[own]
    shape = (len(queries), len(queries) - 1, len(members))
    nearer, up_to = np.empty(shape, dtype=np.int64), np.empty(shape, dtype=np.int64)
    for place, query in enumerate(queries):
        row = matrix[query]
        results = row[np.delete(queries, place)]
        for column, of_class in enumerate(members):
            ordered = np.sort(results if column == own else row[of_class])
            nearer[place, :, column] = np.searchsorted(ordered, results, side="left")
            up_to[place, :, column] = np.searchsorted(ordered, results, side="right")
    flat = (-1, len(members))
    return nearer.reshape(flat), (up_to - nearer).reshape(flat)
