"""Measures of which the nearest shapes of each query are enough: nearest neighbour, and precision at K."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import ConfigurationError
from retrieval.measures import PRINTED, FloatArray

if TYPE_CHECKING:
    from retrieval.neighbours import Nearest

__all__ = ["NEAREST_MEASURES", "PRECISION", "evaluate_nearest", "printed_of"]

#: Share of the first K results that is of the class of the query; K is the number of neighbours of the job.
PRECISION = "P@K"
#: The measures of a job with neighbours, in the order of the tables.
NEAREST_MEASURES = ("NN", PRECISION)


def printed_of(scores: Iterable[str]) -> tuple[str, ...]:
    """Return the measures among some that tables print, in their order."""
    found = set(scores)
    return tuple(name for name in (*PRINTED, PRECISION) if name in found)


def evaluate_nearest(
    nearest: Nearest, labels: Sequence[str], count: int, answered: Sequence[int] | None = None
) -> tuple[dict[str, FloatArray], int]:
    """Return the measures of each query, the exact mean over all orders of results at equal distance.

    A shape without a result is a query with 0 in every measure, and a target behind all shapes that have one.

    Parameters
    ----------
    nearest
        Neighbours of the n shapes that have a result.
    labels
        Class of each shape of the gallery, N of them.
    count
        K: results that are looked at, or N - 1 where there are fewer.
    answered
        Places of the n shapes in the gallery; None for all.

    Returns
    -------
    per_query
        Each of :data:`NEAREST_MEASURES`, shape (N,); NaN for the only member of a class.
    tied_queries
        Queries of which a tie among those results leaves open what is found.

    Raises
    ------
    ConfigurationError
        If no class has two members.
    """
    classes = np.unique(np.asarray(labels), return_inverse=True)[1]
    places = np.arange(len(classes)) if answered is None else np.asarray(answered, dtype=np.intp)
    members = np.bincount(classes)
    if members.max(initial=0) < 2:
        raise ConfigurationError("no class has two members", "check the labels: nothing can be retrieved")
    missing = np.setdiff1d(np.arange(len(classes)), places)
    depth = min(count, len(classes) - 1)
    values = np.where(members[classes] > 1, 0.0, np.nan)[:, None].repeat(2, axis=1)
    tied = 0
    for number, query in enumerate(places):
        if members[classes[query]] < 2:
            continue
        shapes, distances = nearest.of(number)
        # What has no result ties behind all that has one; it is reached where all of these are listed.
        is_whole = len(shapes) == len(places) - 1
        listed = np.concatenate([places[shapes], missing]) if is_whole else places[shapes]
        behind = np.full(len(listed) - len(shapes), np.inf)
        gains = _gains(np.concatenate([distances, behind]), classes[listed] == classes[query])[:depth]
        values[query] = gains[0], gains.sum() / depth
        tied += bool(((gains > 0) & (gains < 1)).any())
    return dict(zip(NEAREST_MEASURES, values.T, strict=True)), tied


def _gains(distances: FloatArray, relevant: NDArray[np.bool_]) -> FloatArray:
    """Relevance of each rank of ascending distances: the share of what is relevant among those that tie with it."""
    starts = np.flatnonzero(np.concatenate([[True], distances[1:] != distances[:-1]]))
    sizes = np.diff(starts, append=len(distances))
    return np.repeat(np.add.reduceat(relevant.astype(np.float64), starts) / sizes, sizes)
