"""Data of the charts of a table: scores with intervals, cost, classes, precision over recall, confusions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmark.api.contracts import Input
from benchmark.errors import BenchmarkError
from benchmark.pipeline.storage.records import Record, answered_labels, answered_shapes
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.cell import Cell
from benchmark.report.content import Row, TableContent
from benchmark.report.rounding import millionths
from benchmark.report.statistics.queries import UNIT, queries_of
from benchmark.report.statistics.rankings import (
    RECALLS,
    Attraction,
    Ranking,
    attraction,
    confusion,
    expected_attraction,
    mean_distances,
    ranking,
)
from benchmark.report.statistics.table_significance import CONTROL, pareto_front
from benchmark.text import brief
from retrieval.measures import PRINTED

#: Kinds of confusions, by the name that the page has for them.
SUBJECTS, POSES = "subjects", "poses"


@dataclass(frozen=True, eq=False)
class Ranked:
    """One method on one gallery under one input: its record, and its ranking where the distances are kept."""

    input: Input
    method: str
    record: Record
    ranking: Ranking | None


@dataclass
class Measured:
    """Data of a page about a table.

    Parameters
    ----------
    data
        For the charts, as the page reads it.
    ranked
        Rankings, for the browser of queries.
    n_distances
        How many of them have distances.
    failed
        Rows without scores: input, title of the method, and why.
    """

    data: dict[str, Any]
    ranked: list[Ranked] = field(default_factory=list)
    failed: list[dict[str, str]] = field(default_factory=list)

    @property
    def n_distances(self) -> int:
        """Jobs whose distances are kept here."""
        return sum(each.ranking is not None for each in self.ranked)


def measured(table: TableContent, artefacts: ArtefactReader, *, most_kinds: int = 400) -> Measured:
    """Collect what the charts of a table show.

    Parameters
    ----------
    table
        The table.
    artefacts
        Where distances are.
    most_kinds
        Classes, or poses, beyond which nothing is shown class by class: nobody could read it.
    """
    classes = _classes(table)
    shown = classes if len(classes) <= most_kinds else []
    found = Measured(
        {
            "stem": table.file_stem,
            "title": f"Table {table.identifier}",
            "data": table.data_title,
            "inputs": list(table.inputs),
            "measures": list(PRINTED),
            "recalls": list(RECALLS),
            "classes": shown,
            "chance": dict(table.chance),
            "attraction": {},
            "poses": [],
            "fronts": _fronts(table),
        }
    )
    poses: dict[str, None] = {}
    rows = [_row(table, row, shown, artefacts, found, poses) for row in table.rows]
    found.data["poses"] = list(poses) if len(poses) <= most_kinds else []
    number = {SUBJECTS: {name: k for k, name in enumerate(shown)}, POSES: {name: k for k, name in enumerate(poses)}}
    for row in rows:
        for cell in row["inputs"].values():
            for kind in (SUBJECTS, POSES):
                counts = cell.pop(kind)
                many = len(number[kind]) > most_kinds or (kind == SUBJECTS and not shown)
                cell[kind] = [] if many else [[number[kind][a], number[kind][b], n] for (a, b), n in counts.items()]
    found.data["rows"] = rows
    return found


def _fronts(table: TableContent) -> dict[str, dict[str, dict[str, list[str]]]]:
    """By input and measure: than which methods none is both cheaper and better, controls aside, and among all rows."""
    found: dict[str, dict[str, dict[str, list[str]]]] = {}
    for input_ in table.inputs:
        rows = [row for row in table.rows if input_ in row.cells and row.cells[input_].scores]
        for measure in PRINTED:
            points = {
                row.method: (seconds, millionths((row.cells[input_].scores or {})[measure]))
                for row in rows
                if (seconds := row.cells[input_].seconds) is not None
            }
            contest = {row.method: points[row.method] for row in rows if row.family != CONTROL and row.method in points}
            found.setdefault(input_, {})[measure] = {"methods": pareto_front(contest), "all": pareto_front(points)}
    return found


#: Share of all subjects in all poses that a data set must hold for the names of its poses to mean the same pose.
_SAME_POSES = 0.9


def poses_of(record: Record, artefacts: ArtefactReader) -> dict[str, str]:
    """Pose of each shape, where the data set is here and its subjects take the same poses; empty otherwise.

    Poses that are merely numbered differ from subject to subject, and so does how many there are.
    """
    try:
        entries = artefacts.dataset(record).entries
    except BenchmarkError:
        return {}
    poses, subjects = {entry.pose for entry in entries}, {entry.subject for entry in entries}
    if len(entries) < _SAME_POSES * len(poses) * len(subjects):
        return {}
    return {entry.identifier: entry.pose for entry in entries}


def _classes(table: TableContent) -> list[str]:
    found: dict[str, None] = {}
    for row in table.rows:
        for cell in row.cells.values():
            for record in cell.records:
                found |= dict.fromkeys(record["labels"])
    return list(found)


def _row(
    table: TableContent,
    row: Row,
    classes: Sequence[str],
    artefacts: ArtefactReader,
    found: Measured,
    poses: dict[str, None],
) -> dict[str, Any]:
    inputs: dict[str, Any] = {}
    for input_, cell in row.cells.items():
        if not cell.scores:
            if cell.status != "missing":
                why = f"{cell.status}: {brief(cell.record.get('reason', ''))}"
                found.failed.append({"input": input_, "title": row.label, "why": why})
            continue
        judged = {name: table.significance.get((row.method, input_, name)) for name in PRINTED}
        told: dict[str, Any] = {
            "scores": {name: cell.scores[name] for name in PRINTED},
            "intervals": {name: [j.low, j.high] for name, j in judged.items() if j is not None},
            "n": cell.record.get("n_shapes"),
            "phases": dict(cell.record.get("cost", {}).get("seconds_per_shape", {})),
            "seconds": cell.seconds,
            "peak": cell.record.get("peak_mib"),
            "classes": _by_class(cell, classes),
        }
        ranked = [_ranked(record, input_, row.method, artefacts) for record in _one_each(cell)]
        found.ranked += ranked
        inputs[input_] = told | _of_rankings(ranked, artefacts, found, poses)
    return {"method": row.method, "title": row.label, "family": row.family, "inputs": inputs}


def _one_each(cell: Cell) -> list[Record]:
    """One record for each gallery: of several trainings the first."""
    return list({record["gallery"]: dict(record) for record in reversed(cell.records)}.values())[::-1]


def _by_class(cell: Cell, classes: Sequence[str]) -> dict[str, list[float | None]]:
    """Mean of each measure over the queries of each class."""
    if not classes:
        return {}
    queries = queries_of(cell.records, PRINTED)
    place = {name: k for k, name in enumerate(classes)}
    of = np.array([place[label] for label in queries.labels], dtype=np.intp)
    counts = np.bincount(of, minlength=len(classes))
    means: dict[str, list[float | None]] = {}
    for name in PRINTED:
        sums = np.bincount(of, queries.values[name], minlength=len(classes)) * UNIT
        means[name] = [millionths(s / n) if n else None for s, n in zip(sums, counts, strict=True)]
    return means


def _ranked(record: Record, input_: Input, method: str, artefacts: ArtefactReader) -> Ranked:
    matrix = mean_distances(artefacts.distances(record))
    try:
        found = None if matrix is None else ranking(matrix, answered_labels(record))
    except BenchmarkError:
        found = None  # damaged: a number that is none, say
    return Ranked(input_, method, record, found)


def _of_rankings(
    ranked: Sequence[Ranked], artefacts: ArtefactReader, found: Measured, poses: dict[str, None]
) -> dict[str, Any]:
    known = [each for each in ranked if each.ranking is not None]
    told: dict[str, Any] = {"precision": None, "attraction": None, SUBJECTS: {}, POSES: {}}
    if not known or len(known) < len(ranked):
        return told
    rows = np.concatenate([each.ranking.precision for each in known if each.ranking])
    rows = rows[~np.isnan(rows[:, 0])]
    told["precision"] = [millionths(value) for value in rows.mean(axis=0)] if len(rows) else None
    shares: list[tuple[int, Attraction]] = []
    by_chance: list[tuple[int, Attraction]] = []
    for each in known:
        if each.ranking is None:
            continue
        nearest, subjects = each.ranking.nearest, answered_labels(each.record)
        _add(told[SUBJECTS], confusion(nearest, subjects))
        pose_of = poses_of(each.record, artefacts)
        shown = [pose_of.get(shape, "") for shape in answered_shapes(each.record)]
        share, expected = attraction(nearest, subjects, shown), expected_attraction(subjects, shown)
        if all(shown) and share is not None and expected is not None:
            _add(told[POSES], confusion(nearest, shown))
            poses |= dict.fromkeys(shown)
            shares.append((len(shown), share))
            by_chance.append((len(shown), expected))
    if shares:
        told["attraction"] = _mean(shares)
        found.data["attraction"].setdefault(known[0].input, _mean(by_chance))
    return told


def _add(counts: dict[tuple[str, str], int], more: Mapping[tuple[str, str], int]) -> None:
    for pair, count in more.items():
        counts[pair] = counts.get(pair, 0) + count


def _mean(shares: Sequence[tuple[int, Attraction]]) -> Attraction:
    """Mean over the galleries, by their queries."""
    total = sum(count for count, _ in shares)
    return {name: round(sum(count * share[name] for count, share in shares) / total, 4) for name in shares[0][1]}
