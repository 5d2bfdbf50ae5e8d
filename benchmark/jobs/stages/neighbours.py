"""The nearest shapes of a gallery in place of the distances of all pairs, and their measures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from retrieval.chance import chance_levels
from retrieval.nearest_measures import NEAREST_MEASURES, evaluate_nearest
from retrieval.neighbours import Nearest

#: Decimals of the measures of single queries in a record.
_DECIMALS = 6


def nearest_scores(
    found: Iterable[Nearest], labels: Sequence[str], count: int, answered: Sequence[int] | None = None
) -> dict[str, Any]:
    """Measures of a gallery as plain numbers: means over the draws, and their standard deviation.

    Parameters
    ----------
    found
        The neighbours under each draw of the scorer, of the n shapes that have a result.
    labels
        Class of each shape of the gallery, N of them.
    count
        Neighbours of each shape.
    answered
        Places of the n shapes; None for all.

    Returns
    -------
    dict
        As of :func:`benchmark.jobs.stages.measures.scores`, and ``neighbours``: their number.

    Raises
    ------
    ConfigurationError
        If no class has two members.
    """
    made, ties = zip(*(evaluate_nearest(each, labels, count, answered) for each in found), strict=True)
    queries = {name: np.mean([each[name] for each in made], axis=0) for name in NEAREST_MEASURES}
    means = {name: [float(np.nanmean(each[name])) for each in made] for name in NEAREST_MEASURES}
    return {
        "neighbours": count,
        "scores": {name: float(np.mean(values)) for name, values in means.items()},
        "codebook_deviation": {name: float(np.std(values)) for name, values in means.items()},
        "per_query": {
            name: [None if np.isnan(value) else round(float(value), _DECIMALS) for value in values]
            for name, values in queries.items()
        },
        "tied_queries": max(ties),
        "lone_queries": int(np.isnan(queries[NEAREST_MEASURES[0]]).sum()),
        "chance": chance_levels(labels),
    }
