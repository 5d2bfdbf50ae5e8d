"""Score a distance matrix of queries and a gallery, as a rule the same.

With ties, scores are means over orders.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.commands.distance_files import as_distances
from benchmark.commands.shape_labels import ShapeLabels, are_row_numbers, as_labels
from benchmark.datasets.labels import MISCELLANEOUS, spelled_alike
from benchmark.errors import ConfigurationError, did_you_mean
from benchmark.report.statistics import FEWEST_CLASSES, class_intervals
from benchmark.text import listed
from retrieval.measures import MEASURES, Targets, chance_levels, evaluate

if TYPE_CHECKING:
    from pandas import DataFrame

#: Precision of intervals.
_ROUNDING = 1e-6

_REVERSED = (
    "the nearest are of other classes more often than by chance: are these similarities, or in "
    "another order?"
)


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
        How many shapes are no queries, which classes are spelled alike, why there are no intervals,
        and whether the nearest are of other classes more often than by chance.
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
    if gallery is None:  # each shape is a query that ranks the others
        matrix, (rows,) = _joined(distances, order, [labels])
        _check_classes(set(rows.classes))
        return _evaluation(matrix, rows, targets=None)

    matrix, (rows, columns) = _joined(distances, order, [labels, gallery])
    in_gallery = _classes_of_gallery(columns.classes)
    _check_classes({*rows.classes, *in_gallery})
    if len(in_gallery) == 1:
        problem = "the gallery holds one shape, so every ranking is perfect"
        raise ConfigurationError(problem, "pass the labels of a larger gallery")
    return _evaluation(matrix, rows, Targets(in_gallery))


def _classes_of_gallery(classes: Sequence[str]) -> list[str]:
    """Return the classes of a gallery, of which those without a class are no class of a query."""
    return [
        f"{label} there" if label.startswith(f"{MISCELLANEOUS} ") else label for label in classes
    ]


def _check_classes(classes: set[str]) -> None:
    """Raise ``ConfigurationError`` if there is a single class."""
    if len(classes) == 1:
        problem = f"there is one class ('{classes.pop()}'), so every ranking is perfect"
        raise ConfigurationError(problem, "check the labels")


def _evaluation(matrix: NDArray[np.float64], rows: _Side, targets: Targets | None) -> Evaluation:
    """Return all measures of distances, with intervals, chance levels and notes.

    Parameters
    ----------
    matrix
        The distances, with a row for each query and a column for each shape of the gallery. If both
        are the same shapes, the diagonal is set to 0 in place.
    rows
        Names and classes of the queries.
    targets
        The gallery; None if it is the queries.

    Raises
    ------
    ConfigurationError
        If each shape is farthest from itself, so that the distances must be similarities.

    Warns
    -----
    UserWarning
        If the scores are so far below chance that the distances may be similarities.
    """
    from pandas import DataFrame

    diagonal = matrix.diagonal().copy()
    n_results = matrix.shape[1]
    if targets is None:
        np.fill_diagonal(matrix, 0)
        n_results -= 1
    scores = evaluate(matrix, rows.classes, targets=targets)

    # Shapes that have nothing to find are no queries: their measures are NaN.
    values = np.column_stack(list(scores.per_query.values()))  # (shapes, measures)
    is_query = ~np.isnan(values[:, 0])
    values = values[is_query]
    query_classes = list(compress(rows.classes, is_query))

    ends = class_intervals(values, query_classes)
    table = _table_of_measures(
        scores.means, ends, chance_levels(rows.classes, targets), n_results=n_results
    )
    if targets is None:
        notes = _notes_on_shapes(len(matrix), scores.lone_queries)
    else:
        notes = _notes_on_queries(matrix, scores.lone_queries)
    in_gallery: list[str] = [] if targets is None else np.asarray(targets.labels).tolist()
    notes += _notes_on_classes(query_classes, [*rows.classes, *in_gallery])

    # Nearest neighbours that are not clearly above chance, by their interval, raise doubts.
    low, high = class_intervals(values[:, :1], query_classes, fewest=2)[0]
    chance = table.loc["NN", "chance"]
    if targets is None and not low > chance:
        _check_diagonal(diagonal, matrix)
    if high < chance - _ROUNDING:
        warnings.warn(_REVERSED, stacklevel=3)
        notes.append(_REVERSED)
    content = {"class": rows.classes, **scores.per_query}
    queries = DataFrame(content, index=list(rows.names) or None).rename_axis("shape")
    return Evaluation(table, queries, matrix, tuple(notes))


def _table_of_measures(
    means: Mapping[str, float],
    ends: NDArray[np.float64],
    chance: Mapping[str, float],
    *,
    n_results: int,
) -> DataFrame:
    """Return a frame with a row for each measure: ``score``, ``low``, ``high`` and ``chance``.

    Parameters
    ----------
    means, chance
        Score, and that of a random order, by measure.
    ends
        Ends of the interval of each score, shape (measures, 2).
    n_results
        Number of results of each query. Measures in which so few cannot differ are left out.
    """
    from pandas import DataFrame

    columns = {"score": means, "low": ends[:, 0], "high": ends[:, 1], "chance": chance}
    table = DataFrame(columns, index=list(means))
    return table.loc[[name for name in means if MEASURES[name].says_something(n_results)]]


def _notes_on_shapes(n_shapes: int, n_lone: int) -> list[str]:
    """Say how many shapes are no queries, where shapes rank each other."""
    if not n_lone:
        return []
    return [
        f"ranked, but no queries: {n_lone} of {n_shapes} shapes "
        "(alone in their class, or of class -1)"
    ]


def _notes_on_queries(matrix: NDArray[np.float64], n_lone: int) -> list[str]:
    """Say how many queries have an answer in another gallery, and how many it may hold itself.

    Parameters
    ----------
    matrix
        Distances of the queries (rows) to the shapes of the gallery (columns).
    n_lone
        Number of queries of whose class the gallery has no shape.
    """
    notes = [
        f"{len(matrix) - n_lone} queries; {n_lone} left out, as the gallery has no shape of their "
        "class"
    ]
    n_copies = int((matrix == 0).any(axis=1).sum())
    if n_copies:
        notes.append(
            f"{n_copies} queries are at distance 0 of a shape: if the gallery holds them, omit it"
        )
    return notes


def _notes_on_classes(of_queries: Iterable[str], classes: Iterable[str]) -> list[str]:
    """Say which classes are spelled alike, and whether there are too few for intervals.

    Parameters
    ----------
    of_queries
        Class of each query.
    classes
        Classes of all shapes.
    """
    notes = []
    pairs = spelled_alike(classes)
    if pairs:
        notes.append(f"classes that differ in spelling alone count as two: {listed(pairs)}")
    n_classes = len(set(of_queries))
    if n_classes < FEWEST_CLASSES:
        notes.append(
            f"no intervals: the queries are of {n_classes} classes, fewer than {FEWEST_CLASSES}"
        )
    return notes


def _check_diagonal(diagonal: NDArray[np.float64], matrix: NDArray[np.float64]) -> None:
    """Raise ``ConfigurationError`` if distances with this diagonal seem to be similarities."""
    is_positive = np.isfinite(diagonal).all() and diagonal.min() > 0
    is_farthest = is_positive and (diagonal >= matrix.max(axis=1)).all()
    if is_farthest and np.unique(matrix).size > 2:
        hint = "pass distances, not similarities; set the diagonal of distances to 0"
        raise ConfigurationError("each shape is farthest from itself", hint)


# Names and classes of rows and columns
# ------------------------------------------------------------------------------------------------


class _Side(NamedTuple):
    """Names and classes of rows or columns; the names are () if there are none."""

    names: tuple[str, ...]
    classes: list[str]


def _joined(
    distances: object, order: str, given: Sequence[object]
) -> tuple[NDArray[np.float64], list[_Side]]:
    """Read distances and labels, and join them by name, or by the order of the rows.

    Parameters
    ----------
    distances
        An array, a pandas frame whose index and columns name the shapes, or a file.
    order
        Order in which rows without names list the labels, such as ``"natural"``; "" if there is one
        only.
    given
        Labels of the rows; and those of the columns, if these are other shapes.

    Returns
    -------
    matrix : numpy.ndarray
        The distances.
    sides : list of _Side
        Names and classes of the rows, and of the columns if these are other shapes.

    Raises
    ------
    ConfigurationError
        If numbers or names do not fit, or the order of rows without names is not known.
    """
    all_labels = [as_labels(labels) for labels in given]
    sizes = [len(labels.classes) for labels in all_labels]
    matrix, *all_names = as_distances(distances, *sizes)  # names of rows, and of columns
    _check_order(order, all_labels, has_names=any(all_names))
    # Files of the Princeton Shape Benchmark.
    is_psb = isinstance(distances, str | Path) and Path(distances).suffix.lower() == ".matrix"
    sides = []
    for labels, names, what, count in zip(
        all_labels, all_names, ("rows", "columns"), matrix.shape, strict=False
    ):
        side = _side(labels, names, _order_of(labels, order, is_psb=is_psb))
        if len(side.classes) != count or len(set(side.names)) < len(side.names):
            problem = (
                f"there are {count} {what} of distances and {len(side.classes)} labels, or a name "
                "appears twice"
            )
            raise ConfigurationError(problem, "pass one label for each shape, and no header")
        sides.append(side)
    return matrix, sides


def _check_order(order: str, labels: Sequence[ShapeLabels], *, has_names: bool) -> None:
    """Raise ``ConfigurationError`` if no labels have an order that is named.

    Labels without names have the order of a list, where distances name their shapes.
    """
    known: dict[str, None] = {}
    for each in labels:
        known.update(dict.fromkeys(each.orders))
    if not order or order in known:
        return
    if any(each.are_named for each in labels):
        raise did_you_mean("order of these labels", order, known)
    if order != "list" or not has_names:
        raise ConfigurationError(f"labels without names have no order '{order}'", "omit the order")


def _order_of(labels: ShapeLabels, order: str, *, is_psb: bool) -> str:
    """Return the order of the rows that labels are for; "" if none is known.

    Distances of the tools of the Princeton Shape Benchmark follow the list.
    """
    if order in labels.orders or not labels.orders:
        return order
    if is_psb and "list" in labels.orders:
        return "list"
    return ""


def _side(labels: ShapeLabels, names: tuple[str, ...], order: str) -> _Side:
    """Return the names and classes of the rows, or of the columns, in their order.

    Parameters
    ----------
    labels
        The classes: a mapping by name, or a list.
    names
        Names that the distances give to the rows, by which both are joined; empty, or row numbers,
        if they give none.
    order
        Which of the orders of the labels the rows have, if they have no names; "" if there is one
        only.

    Raises
    ------
    ConfigurationError
        If a name has no label, or only one of both has names.
    """
    if are_row_numbers(names):
        names = ()
    classes = labels.classes
    if isinstance(classes, dict):  # by name
        unknown = [name for name in names if name not in classes]
        if unknown:
            problem = f"shapes without a label: {len(unknown)}, the first is '{unknown[0]}'"
            some = ", ".join(list(classes)[:3])
            raise ConfigurationError(problem, f"use the names of the labels: {some} ...")
        names = names or _ordered(labels.orders or {"": list(classes)}, order)
        return _Side(names, [classes[name] for name in names])
    if names and order != "list":
        hint = (
            "write lines 'name label', or pass --order list (order= in Python) if they are in the "
            "order of the rows"
        )
        raise ConfigurationError("the distances name their shapes, and the labels do not", hint)
    return _Side(names, classes)


def _ordered(orders: Mapping[str, Sequence[str]], order: str) -> tuple[str, ...]:
    """Return the names of all shapes in the order of the rows, which have no names themselves.

    Parameters
    ----------
    orders
        The names in each order in which programs may list them, such as ``"natural"``.
    order
        The order that the user chose; "" if they chose none.

    Raises
    ------
    ConfigurationError
        If the user chose none, and the orders differ; the error shows where.
    """
    if order:
        return tuple(orders[order])
    for row, names in enumerate(zip(*orders.values(), strict=True)):
        if len(set(names)) > 1:
            kinds = [
                f"{kind}: {', '.join(listed[row : row + 3])}" for kind, listed in orders.items()
            ]
            problem = (
                "the rows have no names, and the shapes several orders, which differ from row "
                f"{row + 1}: {'; '.join(kinds)}"
            )
            hint = (
                f"pass --order {' or '.join(orders)} (order= in Python), or name rows and columns"
            )
            raise ConfigurationError(problem, hint)
    return tuple(next(iter(orders.values())))
