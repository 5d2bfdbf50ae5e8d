"""Measures of a gallery from its distances."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrieval.measures import evaluate

#: Decimals of the measures of single queries.
DECIMALS = 6


def score(
    matrices: Iterable[NDArray[np.float64]], labels: Sequence[str], answered: Sequence[int] | None = None
) -> dict[str, Any]:
    """Return the measures of a gallery as plain numbers, means over the matrices.

    Parameters
    ----------
    matrices
        One for each draw of the scorer, shape (n, n); only one is in memory at a time.
    labels
        Class of each shape of the gallery, N of them.
    answered
        Indices of the n shapes that have a result; None for all. The others are queries with 0 in every measure.

    Returns
    -------
    dict
        ``scores`` and ``per_query`` by measure (None for the only member of a class), ``tied_queries`` and
        ``lone_queries``.

    Raises
    ------
    ConfigurationError
        If a matrix is not square, finite and symmetric, or no class has two members.
    """
    draws = [evaluate(matrix, labels, answered=answered) for matrix in matrices]
    queries = {name: np.mean([draw.per_query[name] for draw in draws], axis=0) for name in draws[0].per_query}
    return {
        "scores": {name: float(np.mean([draw.means[name] for draw in draws])) for name in draws[0].means},
        "per_query": {
            name: [None if np.isnan(value) else round(float(value), DECIMALS) for value in values]
            for name, values in queries.items()
        },
        "tied_queries": max(draw.tied_queries for draw in draws),
        "lone_queries": draws[0].lone_queries,
    }
