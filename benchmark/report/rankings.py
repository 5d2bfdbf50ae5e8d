"""Additional results from the distances of a record: nearest shapes, precision over recall, and confusions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.api.contracts import Input
from benchmark.errors import BenchmarkError
from benchmark.pipeline.storage.records import Record, answered_labels, answered_shapes
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import TableContent
from benchmark.report.escaping import millionths
from benchmark.report.pictures.posing import have_same_poses
from benchmark.report.significance import CONTROL, UNIT, queries_of
from retrieval.measures import PRINTED
from retrieval.metrics import ROWS, check_distances

#: Number of matches of each query in a report.
NEAREST = 10

#: Levels of recall at which precision is interpolated.
RECALLS = tuple(round(0.05 * k, 2) for k in range(1, 21))


@dataclass(frozen=True, eq=False)
class Ranking:
    """Ranking of a gallery by a method.

    Parameters
    ----------
    nearest
        Nearest other shapes of each query, shape (N, min(NEAREST, N - 1)); ties are in gallery order.
    precision
        Interpolated precision of each query at :data:`RECALLS`, shape (N, 20): the highest precision at this or a
        higher recall; NaN for the only shape of a class.
    """

    nearest: NDArray[np.intp]
    precision: NDArray[np.float64]


def ranking(distances: ArrayLike, labels: Sequence[str], n_nearest: int = NEAREST) -> Ranking:
    """Rank the gallery for each of its shapes.

    Parameters
    ----------
    distances
        Shape (N, N), symmetric and finite.
    labels
        Class of each shape.
    n_nearest
        Number of matches to return.

    Raises
    ------
    ConfigurationError
        If the matrix is not square, finite and symmetric, or does not fit the labels.
    """
    matrix, classes = check_distances(distances, labels)
    count = len(matrix)
    nearest = np.empty((count, min(n_nearest, count - 1)), dtype=np.intp)
    precision = np.full((count, len(RECALLS)), np.nan)
    for start in range(0, count, ROWS):
        rows = matrix[start : start + ROWS].copy()
        queries = np.arange(start, start + len(rows))
        rows[np.arange(len(rows)), queries] = np.inf  # a query does not match itself
        order = np.argsort(rows, axis=1, kind="stable")[:, :-1]
        nearest[queries] = order[:, : nearest.shape[1]]
        precision[queries] = _precision(classes[order] == classes[queries, None])
    return Ranking(nearest, precision)


def _precision(relevant: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the interpolated precision of queries, given the relevance of their matches by rank."""
    hits = np.cumsum(relevant, axis=1)
    best = np.maximum.accumulate((hits / np.arange(1, relevant.shape[1] + 1))[:, ::-1], axis=1)[:, ::-1]
    precision = np.full((len(relevant), len(RECALLS)), np.nan)
    for row, (of_query, at_best) in enumerate(zip(hits, best, strict=True)):
        if of_query.size and of_query[-1]:
            n_hits = [-(-round(100 * recall) * int(of_query[-1]) // 100) for recall in RECALLS]  # hits, rounded up
            precision[row] = at_best[np.searchsorted(of_query, n_hits)]
    return precision


def costs_and_scores(
    table: TableContent, input_: Input, measure: str, *, with_controls: bool = True
) -> dict[str, tuple[float, float]]:
    """Return seconds and score of each row that has both, by method."""
    return {
        line.method: (line.seconds, millionths(line.scores[measure]))
        for line in table.lines
        if line.input == input_ and line.scores and line.seconds and (with_controls or line.family != CONTROL)
    }


def pareto_front(points: Mapping[str, tuple[float, float]]) -> list[str]:
    """Return the names on the Pareto front of cost and score.

    Parameters
    ----------
    points
        Cost (lower is better) and score (higher is better) by name.

    Returns
    -------
    list of str
        Names, cheapest first, including all that are equal in both.
    """
    front: list[str] = []
    for name, (cost, score) in sorted(points.items(), key=lambda item: (item[1][0], -item[1][1], item[0])):
        if not front or score > points[front[-1]][1] or (cost, score) == points[front[-1]]:
            front.append(name)
    return front


#: Kinds of confusions.
CLASSES, POSES = "classes", "poses"

#: What a query and its match have in common: only the subject, only the pose, neither, or both (a second scan of the
#: shape).
_COMMON = ("subject", "pose", "neither", "both")

Attraction = dict[str, float]
"""Fraction of matches by what they have in common with their query."""


@dataclass(frozen=True, eq=False)
class RankedGallery:
    """A gallery ranked by a method: its record, the pose of each shape or "", and the ranking if it is stored."""

    record: Record
    poses: dict[str, str]
    ranking: Ranking | None

    def kinds(self, kind: str) -> list[str]:
        """Return class or pose of each ranked shape; empty if the poses are unknown or all different."""
        if kind == CLASSES:
            return answered_labels(self.record)
        poses = [self.poses.get(shape, "") for shape in answered_shapes(self.record)]
        return poses if all(poses) and len(set(poses)) < len(poses) else []


@dataclass(frozen=True, eq=False)
class RankedCell:
    """Galleries of one row of a table for one input, with the first of several trainings."""

    line: Any
    galleries: list[RankedGallery]

    @cached_property
    def _rankings(self) -> list[tuple[RankedGallery, Ranking]]:
        """Galleries with their rankings; empty unless all are stored."""
        rankings = [(gallery, gallery.ranking) for gallery in self.galleries if gallery.ranking is not None]
        return rankings if len(rankings) == len(self.galleries) else []

    def precision(self) -> list[float] | None:
        """Return the interpolated precision at each level of recall, averaged over all queries."""
        curves = [ranks.precision for _, ranks in self._rankings]
        rows = np.concatenate(curves) if curves else np.empty((0, 1))
        rows = rows[~np.isnan(rows[:, 0])]
        return [millionths(value) for value in rows.mean(axis=0)] if len(rows) else None

    def confusion(self, kind: str, names: Sequence[str]) -> NDArray[np.int64]:
        """Return the numbers of queries of each class, or pose, as rows, by that of their nearest match as columns."""
        counts = np.zeros((len(names), len(names)), dtype=np.int64)
        place = {name: number for number, name in enumerate(names)}
        for gallery, ranks in self._rankings:
            numbers = np.array([place[name] for name in gallery.kinds(kind)], dtype=np.intp)
            if numbers.size:
                np.add.at(counts, (numbers[:, None], numbers[ranks.nearest[:, :1]]), 1)
        return counts

    def attraction(self) -> tuple[Attraction, Attraction] | tuple[None, None]:
        """Return the attraction of the nearest matches, and that of random ones; None without poses to compare."""
        shares, weights = [], []
        for gallery, ranks in self._rankings:
            if poses := gallery.kinds(POSES):
                classes, count, matches = gallery.kinds(CLASSES), len(poses), ranks.nearest[:, 0].tolist()
                kinds = (classes, poses, [*zip(classes, poses, strict=True)])
                alike = (sum(of[query] == of[match] for query, match in enumerate(matches)) for of in kinds)
                pairs = (sum(n * (n - 1) for n in Counter(of).values()) for of in kinds)
                shares.append([_shares(alike, count), _shares(pairs, count * (count - 1))])
                weights.append(count)
        if not shares:
            return None, None
        means = np.average(shares, axis=0, weights=weights).round(4).tolist()
        ours, random = (dict(zip(_COMMON, values, strict=True)) for values in means)
        return ours, random

    def by_class(self, classes: Sequence[str]) -> dict[str, list[float]]:
        """Return the mean of each measure over the queries of each class; NaN without queries."""
        from pandas import DataFrame

        queries = queries_of([self.line.records])
        values = DataFrame(queries.values[:, :, 0], columns=PRINTED)
        groups = values.groupby(np.array(queries.labels, dtype=object))
        means = (groups.sum() * UNIT).div(groups.size(), axis=0).reindex(classes)
        return {name: [*map(millionths, of_measure)] for name, of_measure in means.items()}


def _shares(counts: Iterable[int], total: int) -> list[float]:
    """Return fractions from the numbers of pairs with the same subject, the same pose, and both."""
    same, alike, both = counts
    return [count / total for count in (same - both, alike - both, total - same - alike + both, both)]


def ranked_cells(table: TableContent, artefacts: ArtefactReader) -> list[RankedCell]:
    """Return the rows of a table with scores for each input, with stored rankings."""
    poses: dict[str, dict[str, str]] = {}
    cells = []
    for line in table.lines:
        if line.scores:
            galleries = []
            for record in {record["gallery"]: dict(record) for record in reversed(line.records)}.values():
                source = record["data"]["source"]
                if source not in poses:
                    poses[source] = _poses(record, artefacts)
                galleries.append(RankedGallery(record, poses[source], _ranking(record, artefacts)))
            cells.append(RankedCell(line, galleries[::-1]))
    return cells


def classes_of(cells: Sequence[RankedCell]) -> list[str]:
    """Return the names of all classes."""
    return list(dict.fromkeys(label for cell in cells for record in cell.line.records for label in record["labels"]))


def poses_of(cells: Sequence[RankedCell]) -> list[str]:
    """Return the names of all poses, if all classes of the data set have the same ones."""
    galleries = (gallery for cell in cells for gallery in cell.galleries)
    return list(dict.fromkeys(pose for gallery in galleries for pose in gallery.kinds(POSES)))


def _poses(record: Record, artefacts: ArtefactReader) -> dict[str, str]:
    """Return the pose of each shape; empty if the data set is missing or its classes have different poses."""
    try:
        entries = artefacts.dataset(record).shapes
    except BenchmarkError:
        return {}
    return {entry.identifier: entry.pose for entry in entries} if have_same_poses(entries) else {}


def _ranking(record: Record, artefacts: ArtefactReader) -> Ranking | None:
    """Rank a gallery by the mean of the matrices of all codebooks; None if they are not stored."""
    total, count = np.zeros(()), 0
    for matrix in artefacts.distances(record):
        total, count = total + np.asarray(matrix, dtype=np.float64), count + 1
    try:
        return ranking(total / count, answered_labels(record)) if count else None
    except BenchmarkError:
        return None  # damaged, for example a NaN
