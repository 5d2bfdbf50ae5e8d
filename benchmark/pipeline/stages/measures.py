"""Compute the measures of a gallery from its distances."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrieval.chance import chance_levels
from retrieval.measures import MEASURES
from retrieval.metrics import Scores, check_distances, evaluate_rows

Matrix = NDArray[np.float64]

#: Decimals to which a record rounds the measures of single queries.
_DECIMALS = 6


def scores(
    matrices: Iterable[Iterable[Matrix]], labels: Sequence[str], answered: Sequence[int] | None = None
) -> dict[str, Any]:
    """Return the measures of a gallery as plain numbers: means over the matrices, and their standard deviation.

    Parameters
    ----------
    matrices
        One per draw of the scorer: shape (n, n), or an iterator over its rows, which are not checked again. Only one is
        in memory at a time.
    labels
        Class of each shape of the gallery, N of them.
    answered
        Indices of the n shapes that have a result; None for all. The others are queries with 0 in every measure.

    Returns
    -------
    dict
        ``scores`` and ``codebook_deviation`` by measure, ``per_query`` (None for the only member of a class),
        ``tied_queries``, ``lone_queries``, and ``chance``; if shapes lack a result, also ``supported``: the scores of
        the others among themselves, provided that two of them share a class and there are two classes.

    Raises
    ------
    ConfigurationError
        If a matrix is not square, finite and symmetric, or no class has two members.
    """
    ranked = labels if answered is None else [labels[place] for place in answered]

    def scored(matrix: Iterable[Matrix]) -> tuple[Scores, Scores | None]:
        rows = check_distances(matrix, ranked)[0] if isinstance(matrix, np.ndarray) else matrix
        return evaluate_rows(rows, labels, answered=answered)

    draws, alone = zip(*map(scored, matrices), strict=True)
    means, of_supported = _by_measure(draws), _by_measure([draw for draw in alone if draw is not None])
    queries = {measure.name: np.mean([draw.per_query[measure.name] for draw in draws], axis=0) for measure in MEASURES}
    return {
        "scores": {name: float(np.mean(values)) for name, values in means.items()},
        "codebook_deviation": {name: float(np.std(values)) for name, values in means.items()},
        "per_query": {
            name: [None if np.isnan(value) else round(float(value), _DECIMALS) for value in values]
            for name, values in queries.items()
        },
        "tied_queries": max(draw.tied_queries for draw in draws),
        "lone_queries": draws[0].lone_queries,
        "chance": chance_levels(labels),
        **({"supported": {name: float(np.mean(v)) for name, v in of_supported.items()}} if any(alone) else {}),
    }


def _by_measure(draws: Sequence[Scores]) -> dict[str, list[float]]:
    return {measure.name: [draw.means[measure.name] for draw in draws] for measure in MEASURES}
