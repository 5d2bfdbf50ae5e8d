"""Score a distance matrix: every shape is a query; with ties, scores are means over their orders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import ConfigurationError
from benchmark.report.statistics import bootstrap_intervals
from benchmark.scoring.files import as_distances, as_labels
from retrieval.measures import chance_levels, evaluate

if TYPE_CHECKING:
    from pandas import DataFrame

#: Confidence level of the intervals.
LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Scores of a distance matrix.

    Parameters
    ----------
    scores
        One row for each measure: ``score``, the mean over queries, ``low`` and ``high``, its 95 % interval over
        classes, and ``chance``, the mean over random orders.
    queries
        One row for each shape, under its name if it has one: ``class`` and each measure; NaN for the only shape of a
        class.
    distances
        The matrix, shape (N, N), in the order of ``queries``.
    """

    scores: DataFrame
    queries: DataFrame
    distances: NDArray[np.float64]


def score(distances: object, labels: object) -> Evaluation:
    """Score distances computed by any program.

    Parameters
    ----------
    distances
        Shape (N, N), symmetric: an array, a pandas frame whose index and columns name the shapes, or the path of a file
        (.npy, .npz, .txt, .csv, .mat). The diagonal is ignored.
    labels
        Class of each shape: a list in the order of the rows, a mapping by name, or the path of a ``.cla`` file, a text
        file with lines ``label`` or ``name label``, or a folder of shapes.

    Returns
    -------
    Evaluation
        Measures with intervals and chance levels, over all queries and for each query.

    Raises
    ------
    ConfigurationError
        If sizes or names do not fit, the matrix is not symmetric, or a number is NaN, infinite or negative.

    Examples
    --------
    >>> import benchmark
    >>> distances = [[0, 1, 4, 3], [1, 0, 5, 2], [4, 5, 0, 1], [3, 2, 1, 0]]
    >>> benchmark.score(distances, ["cat", "cat", "dog", "dog"]).scores.loc["NN", "score"]
    1.0
    """
    from pandas import DataFrame

    matrix, names, classes = _joined(distances, labels)
    _check(matrix)
    scores = evaluate(matrix, classes)
    values = np.column_stack(list(scores.per_query.values()))
    is_query = ~np.isnan(values[:, 0])
    of_queries = [label for label, counts in zip(classes, is_query, strict=True) if counts]
    ends = bootstrap_intervals(values[is_query], of_queries, LEVEL)
    table = {"score": scores.means, "low": ends[:, 0], "high": ends[:, 1], "chance": chance_levels(classes)}
    queries = DataFrame({"class": classes, **scores.per_query}, index=list(names) or None).rename_axis("shape")
    return Evaluation(DataFrame(table, index=list(scores.means)), queries, matrix)


def _joined(distances: object, labels: object) -> tuple[NDArray[np.float64], tuple[str, ...], list[str]]:
    """Return distances with the name and class of each shape, joined by name if both have names; () without names."""
    (matrix, names), given = as_distances(distances), as_labels(labels)
    if isinstance(given, dict) and names:
        if unknown := [name for name in names if name not in given]:
            problem = f"{len(unknown)} shapes have no label, the first is '{unknown[0]}'"
            raise ConfigurationError(problem, f"use the names of the labels: {', '.join(list(given)[:3])} ...")
        given = {name: given[name] for name in names}
    names = names or tuple(given if isinstance(given, dict) else ())
    classes = list(given.values() if isinstance(given, dict) else given)
    if len(classes) != len(matrix) or len(set(names)) < len(names):
        problem = f"there are {len(matrix)} rows of distances and {len(classes)} labels, or a name appears twice"
        raise ConfigurationError(problem, "pass one label for each shape, and no header")
    return matrix, names, classes


def _check(values: NDArray[np.float64]) -> None:
    problem = ""
    if len(wrong := np.argwhere(~np.isfinite(values))):
        row, column = wrong[0] + 1
        problem = f"{len(wrong)} distances are NaN or infinite, the first in row {row}, column {column}"
        hint = "use a distance larger than all others if a method has no result"
    elif values.min() < 0:
        problem, hint = f"a distance is negative ({values.min():.3g})", "subtract similarities from the largest"
    elif (values.diagonal() >= values.max(axis=1)).all() and values.diagonal().min() > 0 and np.ptp(values) > 0:
        problem, hint = "each shape is farthest from itself", "pass distances, not similarities"
    if problem:
        raise ConfigurationError(problem, hint)
