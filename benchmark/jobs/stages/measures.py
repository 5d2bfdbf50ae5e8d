"""Measures of a gallery from its distances."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrieval.chance import chance_levels
from retrieval.measures import MEASURES
from retrieval.metrics import evaluate
from retrieval.splits import all_splits, ranges, scores_of_splits

Matrix = NDArray[np.float64]

#: Decimals of the measures of single queries in a record.
_DECIMALS = 6


def scores(matrices: Iterable[Matrix], labels: Sequence[str]) -> dict[str, Any]:
    """Measures of a gallery as plain numbers: means over the matrices, and their standard deviation.

    Parameters
    ----------
    matrices
        One per draw of the scorer, each of shape (N, N); each is forgotten before the next one is asked for.
    labels
        Class of each shape.

    Returns
    -------
    dict
        ``scores`` and ``codebook_deviation`` by measure, ``per_query`` (None for the only member of a class),
        ``tied_queries``, ``lone_queries``, and ``chance``.

    Raises
    ------
    ConfigurationError
        If a matrix is not square, finite and symmetric, or no class has two members.
    """
    found = list(map(partial(evaluate, labels=labels), matrices))
    means = {measure.name: [float(getattr(each, measure.attribute)) for each in found] for measure in MEASURES}
    queries = {
        measure.name: np.mean([getattr(each.per_query, measure.query_attribute) for each in found], axis=0)
        for measure in MEASURES
    }
    return {
        "scores": {name: float(np.mean(values)) for name, values in means.items()},
        "codebook_deviation": {name: float(np.std(values)) for name, values in means.items()},
        "per_query": {
            name: [None if np.isnan(value) else round(float(value), _DECIMALS) for value in values]
            for name, values in queries.items()
        },
        "tied_queries": max(each.tied_queries for each in found),
        "lone_queries": found[0].lone_queries,
        "chance": chance_levels(labels),
    }


def over_splits(matrices: Iterable[Matrix], labels: Sequence[str], size: int) -> dict[str, Any]:
    """How the measures are spread over every way to take some of the subjects for testing.

    Parameters
    ----------
    matrices
        One per codebook, each of shape (N, N); the measures of a split are means over them.
    labels
        Subject of each shape.
    size
        Subjects to take.

    Returns
    -------
    dict
        ``splits``: the number of ways, and by measure the quantiles .05, .5 and .95.
    """
    splits = all_splits(labels, size)
    scored = list(map(partial(scores_of_splits, labels=labels, splits=splits), matrices))
    means = {name: np.mean([each[name] for each in scored], axis=0) for name in scored[0]}
    found = {name: [r.low, r.median, r.high] for name, r in ranges(means).items()}
    return {"splits": {"count": len(splits), "size": size, "quantiles": found}}
