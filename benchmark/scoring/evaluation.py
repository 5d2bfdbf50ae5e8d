"""Score a distance matrix: every shape is a query; with ties, scores are means over their orders."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import ConfigurationError, did_you_mean
from benchmark.report.statistics import bootstrap_intervals
from benchmark.scoring.files import Orders, are_row_numbers, as_distances, as_labels
from retrieval.measures import chance_levels, evaluate

if TYPE_CHECKING:
    from pandas import DataFrame

#: Confidence level of the intervals.
LEVEL = 0.95

#: Precision of intervals.
_ROUNDING = 1e-6

_REVERSED = "the nearest are of other classes more often than by chance: are these similarities, or in another order?"


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
        The matrix, shape (N, N), in the order of ``queries``, with a diagonal of 0.
    notes
        How many shapes are no queries, and whether the nearest are of other classes more often than by chance.
    """

    scores: DataFrame
    queries: DataFrame
    distances: NDArray[np.float64]
    notes: tuple[str, ...] = ()


def score(distances: object, labels: object, order: str = "") -> Evaluation:
    """Score distances computed by any program.

    Parameters
    ----------
    distances
        Shape (N, N), symmetric: an array, a pandas frame whose index and columns name the shapes, or the path of a file
        (.npy, .npz, .txt, .csv, .mat, .matrix). The diagonal is ignored.
    labels
        Class of each shape: a list in the order of the rows, a mapping by name, or the path of a ``.cla`` file, a text
        file with lines ``label`` or ``name label``, or a folder of shapes.
    order
        Order of rows without names: ``"list"`` or ``"number"`` of a ``.cla`` file, ``"listing"`` (as Python sorts) or
        ``"natural"`` (cat2 before cat10) of a folder. It is needed where they differ, but for ``.matrix`` files, which
        follow the list.

    Returns
    -------
    Evaluation
        Measures with intervals and chance levels, over all queries and for each query.

    Raises
    ------
    ConfigurationError
        If sizes or names do not fit, the order of the rows is unknown, the matrix is not symmetric, or a distance is
        NaN, infinite or negative.

    Examples
    --------
    >>> import benchmark
    >>> distances = [[0, 1, 4, 3], [1, 0, 5, 2], [4, 5, 0, 1], [3, 2, 1, 0]]
    >>> benchmark.score(distances, ["cat", "cat", "dog", "dog"]).scores.loc["NN", "score"]
    1.0
    """
    from pandas import DataFrame

    matrix, names, classes = _joined(distances, labels, order)
    diagonal = matrix.diagonal().copy()
    np.fill_diagonal(matrix, 0)
    _check(matrix)
    scores = evaluate(matrix, classes)
    values = np.column_stack(list(scores.per_query.values()))
    is_query = ~np.isnan(values[:, 0])
    of_queries = [label for label, counts in zip(classes, is_query, strict=True) if counts]
    ends = bootstrap_intervals(values[is_query], of_queries, LEVEL)
    columns = {"score": scores.means, "low": ends[:, 0], "high": ends[:, 1], "chance": chance_levels(classes)}
    table = DataFrame(columns, index=list(scores.means))
    is_reversed = bool(table.loc["NN", "high"] < table.loc["NN", "chance"] - _ROUNDING)
    is_farthest = np.isfinite(diagonal).all() and (diagonal >= matrix.max(axis=1)).all() and diagonal.min() > 0
    if is_farthest and np.unique(matrix).size > 2 and not table.loc["NN", "low"] > table.loc["NN", "chance"]:
        hint = "pass distances, not similarities; set the diagonal of distances to 0"
        raise ConfigurationError("each shape is farthest from itself", hint)
    queries = DataFrame({"class": classes, **scores.per_query}, index=list(names) or None).rename_axis("shape")
    n_lone = scores.lone_queries
    lone = f"ranked, but no queries: {n_lone} of {len(matrix)} shapes (alone in their class, or of class -1)"
    if is_reversed:
        warnings.warn(_REVERSED, stacklevel=2)
    return Evaluation(table, queries, matrix, (*[lone] * bool(n_lone), *[_REVERSED] * is_reversed))


def _joined(distances: object, labels: object, order: str) -> tuple[NDArray[np.float64], tuple[str, ...], list[str]]:
    """Return distances with the name and class of each shape, joined by name if both have names; () without names."""
    given, orders = as_labels(labels)
    matrix, names = as_distances(distances, len(given))
    if names and are_row_numbers(names):
        if isinstance(given, dict) and {*given} == {*names}:
            orders = {"list": list(given), "number": names, **orders}
        names = ()
    if isinstance(given, dict):
        if unknown := [name for name in names if name not in given]:
            problem = f"shapes without a label: {len(unknown)}, the first is '{unknown[0]}'"
            raise ConfigurationError(problem, f"use the names of the labels: {', '.join(list(given)[:3])} ...")
        is_psb = isinstance(distances, str | Path) and Path(distances).suffix.lower() == ".matrix"
        names = names or _ordered(orders or {"": list(given)}, order or ("list" if is_psb and "list" in orders else ""))
    elif order:
        raise ConfigurationError(f"labels without names have no order '{order}'", "omit the order")
    classes = [given[name] for name in names] if isinstance(given, dict) else given
    if len(classes) != len(matrix) or len(set(names)) < len(names):
        problem = f"there are {len(matrix)} rows of distances and {len(classes)} labels, or a name appears twice"
        raise ConfigurationError(problem, "pass one label for each shape, and no header")
    return matrix, names, classes


def _ordered(orders: Orders, order: str) -> tuple[str, ...]:
    """Return the names of rows that have none, in the order that is named, or in which all agree."""
    if order and order not in orders:
        raise did_you_mean("order of these labels", order, filter(None, orders))
    first, *others = [orders[order]] if order else orders.values()
    for row, names in enumerate(zip(first, *others, strict=True)):
        if len({*names}) > 1:
            shown = "; ".join(f"{kind}: {', '.join(names[row : row + 3])}" for kind, names in orders.items())
            raise ConfigurationError(
                f"the rows have no names, and the shapes have several orders, which differ from row {row + 1}: {shown}",
                f"pass --order {' or '.join(orders)} (order= in Python), or name rows and columns",
            )
    return tuple(first)


def _check(values: NDArray[np.float64]) -> None:
    """Raise ``ConfigurationError`` if a distance off the diagonal, which is 0, is not finite or negative."""
    if len(wrong := np.argwhere(~np.isfinite(values))):
        row, column = wrong[0] + 1
        problem = f"distances are NaN or infinite, the first in row {row}, column {column}"
        raise ConfigurationError(problem, "use a distance larger than all others if a method has no result")
    if values.min() < 0:
        problem = f"a distance is negative ({values.min():.3g})"
        raise ConfigurationError(problem, "subtract similarities from the largest")
