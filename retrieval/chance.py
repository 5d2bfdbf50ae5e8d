"""Chance level: the expected scores of a random ranking, printed under every table."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.errors import ConfigurationError
from retrieval.measures import MEASURES, RandomOrder


def chance_levels(labels: ArrayLike) -> dict[str, float]:
    """Compute the exact expectation of the measures for a random ranking.

    Parameters
    ----------
    labels
        Class of each shape, shape (N,).

    Returns
    -------
    dict
        Each of :data:`retrieval.measures.MEASURES`, averaged over all queries that have a relevant model.

    Raises
    ------
    ConfigurationError
        If no class has two members.
    """
    names = np.asarray(labels)
    _, places, sizes = np.unique(names, return_inverse=True, return_counts=True)
    n_relevant = sizes[places] - 1
    return chance_of_queries(np.full(len(names), len(names) - 1), n_relevant)


def chance_of_queries(n_results: NDArray[Any], n_relevant: NDArray[Any]) -> dict[str, float]:
    """Compute the chance level of queries with separate results, from their numbers of results and relevant results."""
    if not (n_relevant > 0).any():
        raise ConfigurationError("no class has two members", "check the labels: nothing can be retrieved")
    sizes, multiplicity = np.unique(np.column_stack([n_results, n_relevant]), axis=0, return_counts=True)
    total, n_queries = np.zeros(len(MEASURES)), 0
    for (results, relevant), queries in zip(sizes.tolist(), multiplicity.tolist(), strict=True):
        if relevant:
            order = RandomOrder(results, relevant)
            total += queries * np.array([measure.by_chance(order) for measure in MEASURES])
            n_queries += queries
    return dict(zip((measure.name for measure in MEASURES), (total / n_queries).tolist(), strict=True))
