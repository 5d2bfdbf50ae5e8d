"""Chance level: the scores of a ranking without knowledge of the class, printed under every table."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.errors import ConfigurationError
from retrieval.measures import MEASURES, RandomOrder


def chance_levels(labels: ArrayLike) -> dict[str, float]:
    """Exact expectation of the measures for a random ranking.

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
    return _levels(names, np.zeros(len(names), dtype=np.int64))


def pose_first_levels(labels: ArrayLike, poses: ArrayLike) -> dict[str, float]:
    """Exact expectation of the measures when the pose leads: the signature of a form that has kept its pose.

    All shapes of other classes in the pose of the query come first, the rest follows in random order.

    Parameters
    ----------
    labels
        Class of each shape, shape (N,).
    poses
        Pose of each shape, shape (N,).

    Returns
    -------
    dict
        As :func:`chance_levels`.

    Raises
    ------
    ConfigurationError
        If the arrays differ in length or no class has two members.
    """
    names, pose_names = np.asarray(labels), np.asarray(poses)
    if names.shape != pose_names.shape:
        raise ConfigurationError(f"{len(names)} labels but {len(pose_names)} poses", "pass one pose per shape")
    same_pose = pose_names[:, None] == pose_names
    other_class = names[:, None] != names
    return _levels(names, (same_pose & other_class).sum(axis=1))


def _levels(labels: NDArray[Any], n_leading: NDArray[np.int64]) -> dict[str, float]:
    """Average over the queries when ``n_leading`` irrelevant results precede a random order of the others."""
    n_results = len(labels) - 1
    n_relevant = (labels[:, None] == labels).sum(axis=1) - 1
    if not (n_relevant > 0).any():
        raise ConfigurationError("no class has two members", "check the labels: nothing can be retrieved")
    kinds, multiplicity = np.unique(np.stack([n_relevant, n_leading], axis=1), axis=0, return_counts=True)
    total, n_queries = np.zeros(len(MEASURES)), 0
    for (relevant, leading), queries in zip(kinds.tolist(), multiplicity.tolist(), strict=True):
        if relevant:
            order = RandomOrder(n_results, relevant, leading)
            total += queries * np.array([measure.by_chance(order) for measure in MEASURES])
            n_queries += queries
    return dict(zip((measure.name for measure in MEASURES), (total / n_queries).tolist(), strict=True))
