"""Results from the distances behind a table: nearest shapes, precision over recall, confusions, class by class."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from benchmark.errors import BenchmarkError
from benchmark.pipeline.storage.records import Record, answered_labels, answered_shapes
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.content import TableContent
from benchmark.report.pictures.posing import have_same_poses
from benchmark.report.rankings import (
    Attraction,
    Ranking,
    attraction,
    confusion,
    expected_attraction,
    mean_distances,
    ranking,
)
from benchmark.report.rounding import millionths
from benchmark.report.significance import UNIT, queries_of
from retrieval.measures import PRINTED

#: Kinds of confusions.
CLASSES, POSES = "classes", "poses"


@dataclass(frozen=True, eq=False)
class RankedGallery:
    """A gallery ranked by a method: its record, the pose of each shape, "" without one, and the ranking if stored."""

    record: Record
    poses: dict[str, str]
    ranking: Ranking | None

    def kinds(self, kind: str) -> list[str]:
        """Class or pose of each ranked shape; none where the poses are not known or all differ."""
        if kind == CLASSES:
            return answered_labels(self.record)
        poses = [self.poses.get(shape, "") for shape in answered_shapes(self.record)]
        return poses if all(poses) and len(set(poses)) < len(poses) else []


@dataclass(frozen=True, eq=False)
class RankedCell:
    """Galleries of one row of a table under one input; of several trainings the first."""

    line: Any
    galleries: list[RankedGallery]

    @cached_property
    def _rankings(self) -> list[tuple[RankedGallery, Ranking]]:
        """Galleries with their rankings; none unless all are stored."""
        rankings = [(gallery, gallery.ranking) for gallery in self.galleries if gallery.ranking is not None]
        return rankings if len(rankings) == len(self.galleries) else []

    def precision(self) -> list[float] | None:
        """Interpolated precision at the levels of recall, the mean over all queries."""
        curves = [ranks.precision for _, ranks in self._rankings]
        rows = np.concatenate(curves) if curves else np.empty((0, 1))
        rows = rows[~np.isnan(rows[:, 0])]
        return [millionths(value) for value in rows.mean(axis=0)] if len(rows) else None

    def confusion(self, kind: str) -> Counter[tuple[str, str]]:
        """How often a query of one class, or pose, has a nearest match of another, or of its own."""
        counts: Counter[tuple[str, str]] = Counter()
        for gallery, ranks in self._rankings:
            if kinds := gallery.kinds(kind):
                counts.update(confusion(ranks.nearest, kinds))
        return counts

    def attraction(self) -> tuple[Attraction, Attraction] | None:
        """What the nearest match has in common with its query, and what one drawn at random would have."""
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
        """Mean of each measure over the queries of each class."""
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
    """Return the rows of a table that have scores, under each input, with the rankings that are stored."""
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
    """Return the names of all poses, where the classes of a data set take the same ones."""
    galleries = (gallery for cell in cells for gallery in cell.galleries)
    return list(dict.fromkeys(pose for gallery in galleries for pose in gallery.kinds(POSES)))


def _poses(record: Record, artefacts: ArtefactReader) -> dict[str, str]:
    """Pose of each shape, where the data set is here and its classes take the same poses; empty otherwise."""
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
        return None  # damaged: a number that is none, say
