"""Additional results from the distances of a record: nearest shapes, precision over recall, and confusions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmark.errors import BenchmarkError
from benchmark.pipeline.storage.records import Record, answered_labels, answered_shapes
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import TableContent
from benchmark.report.escaping import millionths
from benchmark.report.pictures.posing import have_same_poses
from benchmark.report.significance import UNIT, queries_of
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


def mean_distances(matrices: Iterable[ArrayLike]) -> NDArray[np.float64] | None:
    """Return the mean of the matrices of several codebooks, shape (N, N); None if there are none."""
    total, count = np.zeros(()), 0
    for matrix in matrices:
        total, count = total + np.asarray(matrix, dtype=np.float64), count + 1
    return total / count if count else None


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


def confusion(nearest: NDArray[np.intp], kinds: Sequence[str]) -> dict[tuple[str, str], int]:
    """Return the numbers of queries by their own kind and that of their nearest match."""
    matches = nearest[:, 0].tolist() if nearest.size else ()
    return dict(Counter((kinds[query], kinds[match]) for query, match in enumerate(matches)))


#: What a query and its nearest match have in common: only the subject, only the pose, neither, or both (a second scan
#: of the shape).
Attraction = dict[str, float]


def attraction(nearest: NDArray[np.intp], subjects: Sequence[str], poses: Sequence[str]) -> Attraction | None:
    """Return how often nearest matches share the query's subject or pose; None if no two shapes share a pose."""
    if len(set(poses)) == len(poses) or not nearest.size:
        return None
    same, alike = (np.array(kinds)[nearest[:, 0]] == np.array(kinds) for kinds in (subjects, poses))
    return _shares(int(same.sum()), int(alike.sum()), int((same & alike).sum()), len(same))


def expected_attraction(subjects: Sequence[str], poses: Sequence[str]) -> Attraction | None:
    """Return the :func:`attraction` of random matches."""
    count = len(subjects)
    if len(set(poses)) == len(poses) or count < 2:
        return None
    kinds = (subjects, poses, zip(subjects, poses, strict=True))
    same, alike, both = (sum(n * (n - 1) for n in Counter(of_kind).values()) for of_kind in kinds)
    return _shares(same, alike, both, count * (count - 1))


def _shares(same: int, alike: int, both: int, total: int) -> Attraction:
    """Return fractions from the numbers of pairs with the same subject, the same pose, and both."""
    counts = {"subject": same - both, "pose": alike - both, "neither": total - same - alike + both, "both": both}
    return {name: count / total for name, count in counts.items()}


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

    def confusion(self, kind: str) -> Counter[tuple[str, str]]:
        """Return the numbers of queries by their class, or pose, and that of their nearest match."""
        counts: Counter[tuple[str, str]] = Counter()
        for gallery, ranks in self._rankings:
            if kinds := gallery.kinds(kind):
                counts.update(confusion(ranks.nearest, kinds))
        return counts

    def attraction(self) -> tuple[Attraction, Attraction] | None:
        """Return the attraction of the nearest matches, and that of random ones."""
        shares, weights = [], []
        for gallery, ranks in self._rankings:
            classes, poses = gallery.kinds(CLASSES), gallery.kinds(POSES)
            of_match = attraction(ranks.nearest, classes, poses) if poses else None
            at_random = expected_attraction(classes, poses) if poses else None
            if of_match is not None and at_random is not None:
                shares.append([[*of_match.values()], [*at_random.values()]])
                weights.append(len(poses))
                names = list(of_match)
        if not shares:
            return None
        means = np.average(shares, axis=0, weights=weights).round(4).tolist()
        ours, random = (dict(zip(names, values, strict=True)) for values in means)
        return ours, random

    def by_class(self, classes: Sequence[str]) -> dict[str, list[float | None]]:
        """Return the mean of each measure over the queries of each class."""
        queries = queries_of([self.line.records])
        place = {name: number for number, name in enumerate(classes)}
        numbers = np.array([place[label] for label in queries.labels], dtype=np.intp)
        counts = np.bincount(numbers, minlength=len(classes))
        sums = np.zeros((len(classes), len(PRINTED)))
        np.add.at(sums, numbers, queries.values[:, :, 0])
        return {
            name: [millionths(total / n) if n else None for total, n in zip(of_measure * UNIT, counts, strict=True)]
            for name, of_measure in zip(PRINTED, sums.T, strict=True)
        }


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
        entries = artefacts.dataset(record).entries
    except BenchmarkError:
        return {}
    return {entry.identifier: entry.pose for entry in entries} if have_same_poses(entries) else {}


def _ranking(record: Record, artefacts: ArtefactReader) -> Ranking | None:
    matrix = mean_distances(artefacts.distances(record))
    try:
        return None if matrix is None else ranking(matrix, answered_labels(record))
    except BenchmarkError:
        return None  # damaged, for example a NaN
