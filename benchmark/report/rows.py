"""Rows of tables, and their scores in one column: means, intervals, and what they lack."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.pipeline.records import Record
from benchmark.protocols.tables import Block
from benchmark.registry import BUILT_IN, Component
from benchmark.registry.names import base_name
from benchmark.report.statistics import class_intervals

#: Headings of the blocks of a table, in their order.
BLOCKS: Mapping[Block, str] = {
    "form": "Canonical forms",
    "network": "Networks",
    "descriptor": "Descriptors",
    "external": "Other programs",
}


@dataclass(frozen=True, eq=False)
class RowScores:
    """Scores of a row in one column.

    Parameters
    ----------
    records
        Records with scores, by gallery; several of a gallery are trainings, over which it is
        averaged.
    missing
        Names of galleries without scores, which count as 0.
    measures
        Names of the measures.
    values
        Measures of all queries of all galleries, shape (N, measures); 0 where a gallery is missing.
    labels
        Class of each of these queries, with its gallery.
    excused
        Refused shapes that all rows of its block lack: none of them is ahead by these.
    """

    records: Mapping[str, Sequence[Record]]
    missing: tuple[str, ...]
    measures: Sequence[str]
    values: NDArray[np.float64]
    labels: Sequence[str]
    excused: frozenset[str] = frozenset()

    @cached_property
    def of_galleries(self) -> NDArray[np.float64]:
        """Scores of each gallery, shape (galleries, measures): means over trainings.

        It is 0 for a missing one.
        """
        means = []
        for records in self.records.values():
            of_trainings = [scores_in(record, self.measures) for record in records]
            means.append(np.mean(of_trainings, axis=0))
        means += [np.zeros(len(self.measures)) for _ in self.missing]
        return np.array(means)

    @cached_property
    def means(self) -> dict[str, float]:
        """Means over galleries, by measure."""
        means = self.of_galleries.mean(axis=0).tolist()
        return dict(zip(self.measures, means, strict=True))

    @property
    def all_records(self) -> list[Record]:
        """All records with scores."""
        return [*chain.from_iterable(self.records.values())]

    @property
    def trainings(self) -> list[NDArray[np.float64]]:
        """Measures of all queries by training; galleries with fewer trainings repeat theirs."""
        n_trainings = max(len(records) for records in self.records.values())
        return [self._values_of_training(number) for number in range(n_trainings)]

    def _values_of_training(self, number: int) -> NDArray[np.float64]:
        """Return the measures of all queries by one training of each gallery."""
        chosen = [records[number % len(records)] for records in self.records.values()]
        return np.concatenate([query_measures([record], self.measures) for record in chosen])

    @cached_property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Interval of each mean of enough classes.

        See :data:`benchmark.report.statistics.INTERVALS`.
        """
        ends = class_intervals(self.values, self.labels).tolist()
        return {
            measure: (low, high)
            for measure, (low, high) in zip(self.measures, ends, strict=True)
            if not math.isnan(low)
        }

    @property
    def is_complete(self) -> bool:
        """Whether every gallery and every shape has a result."""
        return not self.missing and all(record.coverage >= 1 for record in self.all_records)

    @cached_property
    def refused(self) -> frozenset[str]:
        """Shapes without a result, with their gallery."""
        return self.refused_in(self.records)

    def refused_in(self, galleries: Iterable[str]) -> frozenset[str]:
        """Return the shapes without a result in the rankings of some galleries that it has."""
        refused = set[str]()
        for record in chain.from_iterable(self.records[name] for name in galleries):
            for side in record.sides:
                refused.update(f"{side.gallery} {shape}" for shape, _ in side.unsupported)
        return frozenset(refused)

    def is_rival(self, seen: frozenset[str] = frozenset()) -> bool:
        """Return whether it can be compared.

        It lacks no shape that others have, and was trained on none.

        Parameters
        ----------
        seen
            Classes, with their gallery, of which it may have been trained on shapes, because they
            are left out of the comparison.
        """
        lacks_shapes = self.missing or self.refused - self.excused
        return not (lacks_shapes or self.seen_classes - seen)

    @cached_property
    def seen_classes(self) -> frozenset[str]:
        """Classes of which a model was trained on a shape, with their gallery."""
        classes = set[str]()
        for record in self.all_records:
            classes.update(f"{record.gallery} {label}" for label in seen_classes(record))
        return frozenset(classes)


@dataclass(frozen=True, eq=False)
class TableRow:
    """A row of a table.

    Parameters
    ----------
    method, title, kind
        Name and title of the method with its parameters, and its block.
    scored
        Scores by the title of the column.
    failed
        Records without scores by the title of the column.
    parameters, defaults
        Parameters of the method that were chosen, and all others.
    """

    method: str
    title: str
    kind: Block
    scored: Mapping[str, RowScores]
    failed: Mapping[str, Sequence[Record]] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)
    defaults: Mapping[str, Any] = field(default_factory=dict)

    @property
    def base_name(self) -> str:
        """Name of its method without parameters."""
        return base_name(self.method)

    def n_galleries(self, group: str) -> int:
        """Return how many galleries its scores in a column are means over."""
        if group not in self.scored:
            return 0
        return len(self.scored[group].records)

    @property
    def records(self) -> list[Record]:
        """All records with scores."""
        return [*chain.from_iterable(scores.all_records for scores in self.scored.values())]

    @property
    def is_published(self) -> bool:
        """Whether none of its jobs ran here."""
        return all(record.published for record in self.records)

    @property
    def cite(self) -> str:
        """What it cites: a key of the bibliography, or a BibTeX entry; "" for nothing.

        A method of the suite cites what it cites today, whatever its records say.
        """
        if self.base_name in BUILT_IN and self.kind != "external":
            return str(Component("method", self.base_name, BUILT_IN[self.base_name]).info.cite)
        return next((record.cite for record in self.records if record.cite), "")


def seen_classes(record: Record) -> set[str]:
    """Return the classes of which a model of a record was trained on a shape."""
    seen = frozenset(record.seen)
    shapes = zip(record.shapes, record.labels, strict=True)
    return {label for shape, label in shapes if shape in seen}


def ranked_classes(record: Record) -> list[str]:
    """Return the classes of the queries that have something to find; the others count nowhere."""
    queries = zip(record.labels, record.are_queries, strict=True)
    return [label for label, counts in queries if counts]


def query_measures(
    records: Sequence[Record], measures: Sequence[str], labels: Sequence[str] = ()
) -> NDArray[np.float64]:
    """Return measures of each query of a gallery, shape (N, measures), averaged over trainings.

    Parameters
    ----------
    records
        Records of the gallery; without any, all measures are 0.
    measures
        Names of the measures.
    labels
        Classes of its queries, which say how many there are if there is no record.
    """
    if not records:
        return np.zeros((len(labels), len(measures)))
    values = np.mean([_values_of_shapes(record, measures) for record in records], axis=0)
    is_query = ~np.isnan(values).any(axis=1)
    return np.asarray(values[is_query])


def _values_of_shapes(record: Record, measures: Sequence[str]) -> NDArray[np.float64]:
    """Return measures of each shape of a record, shape (N, measures).

    It is NaN for those that are no queries.
    """
    columns = [record.per_query[measure] for measure in measures]
    return np.array(columns, dtype=np.float64).T


def scores_in(record: Record, measures: Sequence[str]) -> list[float]:
    """Return the scores of a record in some measures."""
    return [record.scores[measure] for measure in measures]
