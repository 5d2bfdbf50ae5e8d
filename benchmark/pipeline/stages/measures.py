"""Measures of a gallery from its distances."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrieval.chance import chance_levels
from retrieval.measures import MEASURES
from retrieval.metrics import Scores, evaluate
from retrieval.splits import all_splits, ranges, scores_of_splits

Matrix = NDArray[np.float64]

#: Decimals of the measures of single queries in a record.
_DECIMALS = 6


def scores(matrices: Iterable[Matrix], labels: Sequence[str], answered: Sequence[int] | None = None) -> dict[str, Any]:
    """Measures of a gallery as plain numbers: means over the matrices, and their standard deviation.

    Parameters
    ----------
    matrices
        One per draw of the scorer, each of shape (n, n); each is forgotten before the next one is asked for.
    labels
        Class of each shape of the gallery, N of them.
    answered
        Places of the n shapes that have a result; None for all. The others are queries with 0 in every measure.

    Returns
    -------
    dict
        ``scores`` and ``codebook_deviation`` by measure, ``per_query`` (None for the only member of a class),
        ``tied_queries``, ``lone_queries``, and ``chance``; where shapes lack a result ``supported``: the scores of the
        others among themselves, if two of them are of one class and there are two classes.

    Raises
    ------
    ConfigurationError
        If a matrix is not square, finite and symmetric, or no class has two members.
    """
    of_answered = [labels[place] for place in answered] if answered is not None else []

    def scored(matrix: Matrix) -> tuple[Scores, Scores | None]:
        is_rankable = 1 < len(set(of_answered)) < len(of_answered)
        return evaluate(matrix, labels, answered=answered), evaluate(matrix, of_answered) if is_rankable else None

    made = list(map(scored, matrices))
    found, alone = [whole for whole, _ in made], [part for _, part in made if part is not None]
    means = _by_measure(found)
    queries = {measure.name: np.mean([each.per_query[measure.name] for each in found], axis=0) for measure in MEASURES}
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
        **({"supported": {name: float(np.mean(v)) for name, v in _by_measure(alone).items()}} if alone else {}),
    }


def _by_measure(found: Sequence[Scores]) -> dict[str, list[float]]:
    return {measure.name: [each.means[measure.name] for each in found] for measure in MEASURES}


def over_splits(
    matrices: Iterable[Matrix], labels: Sequence[str], size: int, answered: Sequence[int] | None = None
) -> dict[str, Any]:
    """Return how the measures are spread over every way to take some of the subjects for testing.

    Parameters
    ----------
    matrices
        One per codebook, each of shape (n, n); the measures of a split are means over them.
    labels
        Subject of each shape of the gallery, N of them.
    size
        Subjects to take.
    answered
        Places of the n shapes that have a result; None for all.

    Returns
    -------
    dict
        ``splits``: the number of ways, and by measure the quantiles .05, .5 and .95.
    """
    splits = all_splits(labels, size)
    scored = list(map(partial(scores_of_splits, labels=labels, splits=splits, answered=answered), matrices))
    means = {name: np.mean([each[name] for each in scored], axis=0) for name in scored[0]}
    found = {name: [r.low, r.median, r.high] for name, r in ranges(means).items()}
    return {"splits": {"count": len(splits), "size": size, "quantiles": found}}
