"""Pages of queries: what each method finds for each shape, and why it fails."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.pipeline.record_arrays import read_distances
from benchmark.pipeline.records import RankedShapes, Record
from benchmark.report.figures import MEASURE, first_records
from benchmark.report.notation import file_name
from benchmark.report.page_builder import Pages
from benchmark.report.table_view import TableView
from benchmark.text import clean_text, listed

#: Matches of a query that a page names.
_N_MATCHES = 5

#: Failed queries whose forms are drawn, the hardest ones.
_HARDEST = 20

#: Pixels of the picture of a shape.
_PIXELS = 96

#: What a row does with a query.
_REFUSED = 0
_MISSED = 1
_HIT = 2

#: What follows the class in the name of a shape whose pose has a name.
_POSE = re.compile(r"[_/-]([^\W\d_][^\d]*)")


class Match(NamedTuple):
    """A shape that is near to a query.

    Parameters
    ----------
    number
        Its number in the gallery.
    rank
        Its rank, counted from 1.
    ratio
        Its distance over that of the first shape of the class of the query; None if that is 0, or
        there is none.
    """

    number: int
    rank: int
    ratio: float | None


#: Matches of queries by number.
Nearest = Mapping[int, Sequence[Match]]


class _Outcome(NamedTuple):
    """What a row does with a query: refused, missed or hit, and its score."""

    state: int
    score: float


@dataclass(frozen=True)
class _QueryRow:
    """A row on a page of queries.

    Parameters
    ----------
    title, method
        Title and name of its method.
    record
        Its record.
    nearest
        Its matches.
    """

    title: str
    method: str
    record: Record
    nearest: Nearest

    @cached_property
    def outcomes(self) -> dict[int, _Outcome]:
        """What it does with each query."""
        scores = self.record.per_query[MEASURE]
        return {
            number: _Outcome(self._state(number), score or 0.0)
            for number, score in enumerate(scores)
        }

    def _state(self, number: int) -> int:
        """Return whether a query is refused, missed, or a hit."""
        if number not in self.nearest:
            return _REFUSED
        labels = self.record.sides[-1].labels
        for match in self.nearest[number][:1]:
            if labels[match.number] == self.record.labels[number]:
                return _HIT
        return _MISSED


def queries_of_column(pages: Pages, view: TableView) -> dict[str, Any]:
    """Add pictures of queries and their matches to the report, and return what its page shows.

    Parameters
    ----------
    pages
        The report, to which files are added.
    view
        A table with a single column.

    Returns
    -------
    dict
        What the template ``queries.html`` reads: ``title`` of the column; ``queries``, those that
        methods refuse or miss first, with the outcome of each method; ``rows``, title and anchor of
        each method; ``kept``, see :func:`kept_pose`; ``refused`` shapes with reasons; ``data`` for
        the script. Nothing if no distances are stored.
    """
    rows = _rows(pages, view)
    if not rows:
        return {}
    first = rows[0].record  # all rows rank the same shapes
    # A shape that has nothing to find has no score, and is no query.
    queries = [number for number, score in enumerate(first.per_query[MEASURE]) if score is not None]
    outcomes = {number: _outcomes_of(number, rows) for number in queries}

    # The hardest come first. Pictures of forms are added for some of those that a row misses.
    order = sorted(queries, key=lambda number: _hardness(outcomes[number]))
    missed = [number for number in order if not _is_fine(outcomes[number])][:_HARDEST]
    of_rows = [(row.title, row.nearest, _pictures_of_missed(pages, row, missed)) for row in rows]
    lines = []
    for number in order:
        cells = outcomes[number]
        lines.append({"number": number, "cells": cells, "is_fine": _is_fine(cells)})
    return {
        "title": view.columns[0].title,
        "queries": lines,
        "rows": [(row.title, file_name(row.method)) for row in rows],
        "kept": [kept_pose(row.record, row.nearest) for row in rows],
        "refused": _refusals(rows),
        "data": {"sides": [_shapes(pages, side) for side in first.sides], "rows": of_rows},
    }


def _outcomes_of(number: int, rows: Iterable[_QueryRow]) -> list[_Outcome]:
    """Return what each row does with a query."""
    return [row.outcomes[number] for row in rows]


def _is_fine(outcomes: Iterable[_Outcome]) -> bool:
    """Return whether all rows find a query's match."""
    return all(outcome.state == _HIT for outcome in outcomes)


def _hardness(outcomes: Sequence[_Outcome]) -> tuple[int, float]:
    """Return what queries are sorted by: the worst outcome, then the sum of scores."""
    return min(outcomes).state, sum(outcome.score for outcome in outcomes)


def _rows(pages: Pages, view: TableView) -> list[_QueryRow]:
    """Return the rows of a table whose distances are stored."""
    rows = []
    for row, record in first_records(view).items():
        matrix = read_distances(pages.forms.folder, record)
        if matrix is not None:
            nearest = nearest_matches(record, matrix)
            rows.append(_QueryRow(row.title, row.method, record, nearest))
    return rows


def nearest_matches(record: Record, matrix: NDArray[np.float64]) -> Nearest:
    """Return the nearest shapes of the gallery for each query that has a form.

    Parameters
    ----------
    record
        Names and classes of queries and gallery.
    matrix
        Distances of the queries (rows) to the shapes of the gallery (columns), both without those
        that have no form.

    Returns
    -------
    dict
        Matches by the index of the query, which is not among them; see :func:`_matches`.
    """
    gallery = record.sides[-1]
    numbers = np.array(gallery.answered)  # index in the gallery of each column of the matrix
    shapes = np.array(gallery.shapes)[numbers]
    labels = np.array(gallery.labels)[numbers]
    matches: dict[int, list[Match]] = {}
    for query, distances in zip(record.answered, matrix, strict=True):
        order = np.argsort(distances, kind="stable")
        if not record.keeps_same_names:
            order = order[shapes[order] != record.shapes[query]]
        is_right = labels[order] == record.labels[query]
        matches[query] = _matches(numbers[order], distances[order], is_right)
    return matches


def _matches(
    numbers: NDArray[np.int64], distances: NDArray[np.float64], is_right: NDArray[np.bool_]
) -> list[Match]:
    """Return the first shapes of a ranking, and the first one of the right class, at any rank.

    Parameters
    ----------
    numbers
        Indices of the shapes of the gallery, nearest first.
    distances
        Their distances from the query.
    is_right
        Whether they are of the class of the query.

    Returns
    -------
    list of Match
        Index of the shape, its rank, counted from 1, and its distance in units of that of the first
        shape of the right class.
    """
    ranks = list(range(min(_N_MATCHES, len(numbers))))
    unit = 0.0
    right_ranks = np.flatnonzero(is_right)
    if len(right_ranks):
        first_right = int(right_ranks[0])
        unit = float(distances[first_right])
        if first_right >= _N_MATCHES:
            ranks.append(first_right)
    return [Match(int(numbers[rank]), rank + 1, _ratio(distances[rank], unit)) for rank in ranks]


def _ratio(distance: float, unit: float) -> float | None:
    """Return a distance over another one; None if that is 0."""
    if not unit:
        return None
    return round(float(distance) / unit, 3)


def kept_pose(record: Record, nearest: Nearest) -> list[float]:
    """Return how often a wrong match has the pose of its query, and how often it would by chance.

    If wrong matches often have the same pose, the forms have kept the pose, which they should not.

    Parameters
    ----------
    record
        Names and classes of queries and gallery. Poses are read from names such as
        ``man-1_kneeling``.
    nearest
        Matches of each query, nearest first.

    Returns
    -------
    list of float
        Share of the wrong matches that have the pose of their query, and the mean share of shapes
        with this pose among all shapes of other classes. Empty if names do not tell poses, or no
        query has a wrong match.
    """
    poses = [_poses(side) for side in record.sides]
    if not all(poses):
        return []
    of_queries = poses[0]
    in_gallery = np.array(poses[-1])
    labels = np.array(record.sides[-1].labels)
    keeps_pose = []
    shares_by_chance = []
    for query, matches in nearest.items():
        is_of_other_class = labels != record.labels[query]
        if not matches or not is_of_other_class[matches[0].number]:  # the nearest match is right
            continue
        pose = of_queries[query]
        keeps_pose.append(in_gallery[matches[0].number] == pose)
        shares_by_chance.append(np.mean(in_gallery[is_of_other_class] == pose))
    if not any(shares_by_chance):
        return []
    return [float(np.mean(keeps_pose)), float(np.mean(shares_by_chance))]


def _poses(side: RankedShapes) -> list[str]:
    """Return the poses of shapes, as their names say them; empty if a name says none."""
    poses = []
    for shape, label in zip(side.shapes, side.labels, strict=True):
        pose = _POSE.fullmatch(shape.removeprefix(label))
        if pose is None:
            return []
        poses.append(pose[1])
    return poses


def _refusals(rows: Iterable[_QueryRow]) -> list[tuple[str, str, str]]:
    """Return the shapes that were refused, the reason with its remedy, and the rows that say so."""
    titles = defaultdict[tuple[str, str], dict[str, None]](dict)
    for row in rows:
        for shape, reason in chain.from_iterable(side.unsupported for side in row.record.sides):
            titles[shape, reason][row.title] = None
    return [
        (clean_text(shape), clean_text(reason), listed(of_refusal))
        for (shape, reason), of_refusal in titles.items()
    ]


def _shapes(pages: Pages, side: RankedShapes) -> list[tuple[str, str, str]]:
    """Return names, classes and pictures of shapes that are queries or ranked."""
    place = f"{side.input}-{side.data.path or side.data.name}"  # two folders may have one name
    shapes = []
    for shape, label in zip(side.shapes, side.labels, strict=True):
        picture = pages.picture(f"{place}-{shape}", pages.forms.shape(side, shape), _PIXELS)
        shapes.append((clean_text(shape), clean_text(label), picture))
    return shapes


def _pictures_of_missed(pages: Pages, row: _QueryRow, missed: Sequence[int]) -> dict[int, str]:
    """Add pictures of the forms of queries that a method misses, and of their matches.

    Parameters
    ----------
    pages
        The report, to which the pictures are added.
    row
        The method, with its record and its matches.
    missed
        Indices of the queries.

    Returns
    -------
    dict
        Files of the pictures by index of the shape; empty if no forms are stored.
    """
    record = row.record
    # Shapes that are drawn: queries, and their matches unless these are of another gallery.
    numbers = {query for query in missed if query in row.nearest}
    if len(record.sides) == 1:
        for query in missed:
            numbers.update(match.number for match in row.nearest.get(query, ()))
    name = f"{record.input}-{record.data.name}-{record.method}-near"
    files = {}
    for number in sorted(numbers):
        shape = record.shapes[number]
        form = pages.forms.form_like_shape(record, shape)
        file = pages.picture(f"{name}-{shape}", form, _PIXELS, is_coloured=True)
        if file:
            files[number] = file
    return files
