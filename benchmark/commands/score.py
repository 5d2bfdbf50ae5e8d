"""Score a distance matrix of queries and a gallery, as a rule the same; with ties, scores are means over orders."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmark.commands.distance_files import (
    Labels,
    Orders,
    are_row_numbers,
    as_distances,
    as_labels,
)
from benchmark.datasets.labels import MISCELLANEOUS
from benchmark.errors import ConfigurationError, did_you_mean
from benchmark.report.statistics import FEWEST_CLASSES, class_intervals
from retrieval.measures import MEASURES, Targets, chance_levels, evaluate

if TYPE_CHECKING:
    from pandas import DataFrame

#: Precision of intervals.
_ROUNDING = 1e-6

_REVERSED = "the nearest are of other classes more often than by chance: are these similarities, or in another order?"


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Scores of a distance matrix.

    Parameters
    ----------
    scores
        One row for each measure that the gallery can move: ``score``, the mean over queries,
        ``low`` and ``high``, its interval (:data:`benchmark.report.statistics.INTERVALS`; NaN below
        eight classes), and ``chance``, the mean over random orders.
    queries
        One row for each query, under its name if it has one: ``class`` and each measure; NaN
        without another shape of its class.
    distances
        The matrix, with a row for each query; if they are the gallery, with a diagonal of 0.
    notes
        How many shapes are no queries, why there are no intervals, and whether the nearest are of
        other classes more often than by chance.
    """

    scores: DataFrame
    queries: DataFrame
    distances: NDArray[np.float64]
    notes: tuple[str, ...] = ()


def score(distances: object, labels: object, order: str = "", gallery: object = None) -> Evaluation:
    """Score distances computed by any program.

    Parameters
    ----------
    distances
        Shape (N, N), symmetric: an array, a pandas frame whose index and columns name the shapes,
        or the path of a file (.npy, .npz, .txt, .csv, .mat, .matrix). The diagonal is ignored. With
        a ``gallery``, any shape (M, N).
    labels
        Class of each shape: a list in the order of the rows, a mapping by name, or the path of a
        ``.cla`` file, a text file with lines ``label`` or ``name label``, or a folder of shapes.
    order
        Order of rows without names: ``"list"`` or ``"number"`` of a ``.cla`` file, ``"listing"``
        (as Python sorts) or ``"natural"`` (cat2 before cat10) of a folder. It is needed where they
        differ, but for ``.matrix`` files, which follow the list.
    gallery
        Class of each column, given like the labels, if rows are queries of another gallery; nothing
        is left out of it.

    Returns
    -------
    Evaluation
        Measures with intervals and chance levels, over all queries and for each query.

    Raises
    ------
    ConfigurationError
        If sizes or names do not fit, the order of the rows is unknown, the matrix is not symmetric,
        or a distance is NaN, infinite or negative.

    Examples
    --------
    >>> import benchmark
    >>> distances = [[0, 1, 4, 3], [1, 0, 5, 2], [4, 5, 0, 1], [3, 2, 1, 0]]
    >>> benchmark.score(distances, ["cat", "cat", "dog", "dog"]).scores.loc["NN", "score"]
    1.0
    """
    from pandas import DataFrame

    matrix, ((names, classes), *others) = _joined(
        distances, order, [labels] if gallery is None else [labels, gallery]
    )
    in_gallery = [
        f"{of} there" if of.startswith(f"{MISCELLANEOUS} ") else of
        for _, each in others
        for of in each
    ]
    if len(every := {*classes, *in_gallery}) == 1:
        problem = f"there is one class ('{every.pop()}'), so every ranking is perfect"
        raise ConfigurationError(problem, "check the labels")
    if others and len(in_gallery) == 1:
        problem = "the gallery holds one shape, so every ranking is perfect"
        raise ConfigurationError(problem, "pass the labels of a larger gallery")
    targets = Targets(in_gallery) if others else None
    diagonal = matrix.diagonal().copy()
    if targets is None:
        np.fill_diagonal(matrix, 0)
    scores = evaluate(matrix, classes, targets=targets)
    values = np.column_stack(list(scores.per_query.values()))
    is_query = ~np.isnan(values[:, 0])
    of_queries = [label for label, counts in zip(classes, is_query, strict=True) if counts]
    ends = class_intervals(values[is_query], of_queries)
    columns = {
        "score": scores.means,
        "low": ends[:, 0],
        "high": ends[:, 1],
        "chance": chance_levels(classes, targets),
    }
    table = DataFrame(columns, index=list(scores.means))
    n_results = matrix.shape[1] - 1 if targets is None else matrix.shape[1]
    table = table.loc[[name for name in table.index if MEASURES[name].says_something(n_results)]]
    # Of few classes, too: this interval only raises a question.
    low, high = class_intervals(values[is_query][:, :1], of_queries, fewest=2)[0]
    is_reversed = bool(high < table.loc["NN", "chance"] - _ROUNDING)
    if targets is None and not low > table.loc["NN", "chance"]:
        _check_diagonal(diagonal, matrix)
    queries = DataFrame(
        {"class": classes, **scores.per_query}, index=list(names) or None
    ).rename_axis("shape")
    n_lone = scores.lone_queries
    lone = f"ranked, but no queries: {n_lone} of {len(matrix)} shapes (alone in their class, or of class -1)"
    notes = [lone] * bool(n_lone)
    if targets:
        notes = [
            f"{len(matrix) - n_lone} queries; {n_lone} left out, as the gallery has no shape of their class"
        ]
        n_found = int((matrix == 0).any(axis=1).sum())
        notes += [
            f"{n_found} queries are at distance 0 of a shape: if the gallery holds them, omit it"
        ] * bool(n_found)
    if (n_classes := len({*of_queries})) < FEWEST_CLASSES:
        few = f"no intervals: the queries are of {n_classes} classes, fewer than {FEWEST_CLASSES}"
        notes.append(few)
    if is_reversed:
        warnings.warn(_REVERSED, stacklevel=2)
    return Evaluation(table, queries, matrix, (*notes, *[_REVERSED] * is_reversed))


_Side = tuple[tuple[str, ...], list[str]]


def _joined(
    distances: object, order: str, labels: Sequence[object]
) -> tuple[NDArray[np.float64], list[_Side]]:
    """Return distances with the names and classes of their rows, and of their columns if these are others."""
    sides = [as_labels(of_side) for of_side in labels]
    matrix, *names = as_distances(distances, *(len(given) for given, _ in sides))
    known = dict.fromkeys(name for _, orders in sides for name in orders)
    is_named = any(isinstance(given, dict) for given, _ in sides)
    if order and order not in known and (is_named or order != "list" or not any(names)):
        if not is_named:
            raise ConfigurationError(
                f"labels without names have no order '{order}'", "omit the order"
            )
        raise did_you_mean("order of these labels", order, known)
    is_psb = isinstance(distances, str | Path) and Path(distances).suffix.lower() == ".matrix"
    joined = list[_Side]()
    for (given, orders), of_side, what, count in zip(
        sides, names, ("rows", "columns"), matrix.shape, strict=False
    ):
        default = "list" if is_psb and "list" in orders else ""
        joined.append(
            side := _side(
                given, orders, of_side, order if order in orders or not orders else default
            )
        )
        if len(side[1]) != count or len(set(side[0])) < len(side[0]):
            problem = f"there are {count} {what} of distances and {len(side[1])} labels, or a name appears twice"
            raise ConfigurationError(problem, "pass one label for each shape, and no header")
    return matrix, joined


def _side(given: Labels, orders: Orders, names: tuple[str, ...], order: str) -> _Side:
    """Return the names and classes of rows or columns, joined by name if both have names; () without names."""
    names = () if are_row_numbers(names) else names
    if isinstance(given, dict):
        if unknown := [name for name in names if name not in given]:
            problem = f"shapes without a label: {len(unknown)}, the first is '{unknown[0]}'"
            raise ConfigurationError(
                problem, f"use the names of the labels: {', '.join(list(given)[:3])} ..."
            )
        names = names or _ordered(orders or {"": list(given)}, order)
    elif names and order != "list":
        hint = "write lines 'name label', or pass --order list (order= in Python) if they are in the order of the rows"
        raise ConfigurationError("the distances name their shapes, and the labels do not", hint)
    return names, [given[name] for name in names] if isinstance(given, dict) else given


def _ordered(orders: Orders, order: str) -> tuple[str, ...]:
    """Return the names of rows that have none, in the order that is named, or in which all agree."""
    first, *others = [orders[order]] if order else orders.values()
    for row, names in enumerate(zip(first, *others, strict=True)):
        if len({*names}) > 1:
            shown = "; ".join(
                f"{kind}: {', '.join(names[row : row + 3])}" for kind, names in orders.items()
            )
            problem = f"the rows have no names, and the shapes several orders, which differ from row {row + 1}: {shown}"
            hint = (
                f"pass --order {' or '.join(orders)} (order= in Python), or name rows and columns"
            )
            raise ConfigurationError(problem, hint)
    return tuple(first)


def _check_diagonal(diagonal: NDArray[np.float64], matrix: NDArray[np.float64]) -> None:
    """Raise ``ConfigurationError`` if distances, with the diagonal that they had, seem to be similarities."""
    is_farthest = (
        np.isfinite(diagonal).all()
        and (diagonal >= matrix.max(axis=1)).all()
        and diagonal.min() > 0
    )
    if is_farthest and np.unique(matrix).size > 2:
        hint = "pass distances, not similarities; set the diagonal of distances to 0"
        raise ConfigurationError("each shape is farthest from itself", hint)
