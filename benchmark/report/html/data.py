"""Data for the charts and the query browser of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Input
from benchmark.pipeline.storage.records import answered_shapes
from benchmark.report.artefact_reader import NOT_STORED
from benchmark.report.content import TableContent
from benchmark.report.html.forms import Files, Sheets, add_script
from benchmark.report.pictures.posing import spread
from benchmark.report.rankings import (
    CLASSES,
    POSES,
    RECALLS,
    RankedCell,
    RankedGallery,
    classes_of,
    costs_and_scores,
    pareto_front,
    poses_of,
)
from benchmark.text import brief
from retrieval.measures import PRINTED

#: Maximum number of classes, or of poses, shown individually; more would be unreadable.
_MOST_KINDS = 400

#: Queries in one script; approximate bytes of one query of one method; maximum bytes of a table.
_PART, _QUERY_BYTES, _MOST_BYTES = 100, 100, 6_000_000


def chart_data(table: TableContent, cells: Sequence[RankedCell]) -> dict[str, Any]:
    """Return the data of the charts of a table: scores, cost, classes, precision over recall, confusions."""
    names = {
        kind: known if len(known) <= _MOST_KINDS else []
        for kind, known in ((CLASSES, classes_of(cells)), (POSES, poses_of(cells)))
    }
    at_random: dict[str, Any] = {}
    rows: dict[str, dict[str, Any]] = {
        row.method: {"method": row.method, "title": row.label, "family": row.family, "inputs": {}} for row in table.rows
    }
    for cell in cells:
        line = cell.line
        method, input_ = line.method, line.input
        attraction, by_chance = cell.attraction()
        if by_chance is not None:
            at_random.setdefault(input_, by_chance)
        rows[method]["inputs"][input_] = {
            "scores": {name: line.scores[name] for name in PRINTED},
            "intervals": {name: [one.low, one.high] for name, one in table.judged(line).items()},
            "phases": line.phases,
            "seconds": line.seconds,
            "peak": line.peak_mib,
            "precision": cell.precision(),
            "attraction": attraction,
            "classes": cell.by_class(names[CLASSES]) if names[CLASSES] else {},
            "confusion": {kind: _counts(cell.confusion(kind, known)) for kind, known in names.items() if known},
        }
    return {
        "inputs": table.inputs,
        "recalls": RECALLS,
        "classes": names[CLASSES],
        "poses": names[POSES],
        "chance": table.chance,
        "attraction": at_random,
        "fronts": {input_: {name: _fronts(table, input_, name) for name in PRINTED} for input_ in table.inputs},
        "rows": list(rows.values()),
    }


def _counts(matrix: NDArray[np.int64]) -> list[tuple[int, ...]]:
    """Return row, column and value of each entry that is not 0."""
    return [(*place, int(matrix[place])) for place in zip(*np.nonzero(matrix), strict=True)]


def _fronts(table: TableContent, input_: Input, measure: str) -> dict[str, list[str]]:
    """Return the Pareto fronts of cost and score, without controls and over all rows."""
    both = {"methods": False, "all": True}
    return {
        name: pareto_front(costs_and_scores(table, input_, measure, with_controls=with_controls))
        for name, with_controls in both.items()
    }


def write_queries(
    stem: str, table: TableContent, cells: Sequence[RankedCell], pictures: Mapping[Input, Sheets], files: Files
) -> None:
    """Write the scripts of the query browser; for large galleries, as many evenly spaced queries as fit."""
    places: dict[tuple[str, Input], list[tuple[RankedCell, RankedGallery]]] = {}
    for cell in cells:
        for gallery in cell.galleries:
            places.setdefault((gallery.record["gallery"], cell.line.input), []).append((cell, gallery))
    room = max(_PART, int(_MOST_BYTES / max(len(places), 1) / max(len(table.rows), 1) / _QUERY_BYTES))
    galleries: list[dict[str, Any]] = []
    for number, ((name, input_), pairs) in enumerate(places.items()):
        labels: dict[str, str] = {}
        for _, gallery in pairs:
            labels |= zip(gallery.record["shapes"], gallery.record["labels"], strict=True)
        names, poses = list(labels), pairs[0][1].poses
        chosen = spread(range(len(names)), room)
        for part in range(0, len(chosen), _PART):
            queries = [names[k] for k in chosen[part : part + _PART]]
            answers = {cell.line.method: _answers(gallery, names, queries) for cell, gallery in pairs}
            add_script(files, f"queries-{stem}-{number}-{part // _PART}", answers)
        sheets = pictures.get(input_) or Sheets("", {})
        galleries.append(
            {
                "gallery": name,
                "input": input_,
                "number": number,
                "names": names,
                "classes": list(labels.values()),
                "poses": [poses.get(shape, "") for shape in names],
                "sheets": sheets.stem,
                "pictures": [sheets.places.get(shape, -1) for shape in names],
                "queries": chosen if len(chosen) < len(names) else None,
                "methods": [
                    {
                        "name": cell.line.method,
                        "title": cell.line.label,
                        "sheet": sheets.numbers.get(cell.line.method, 0),
                        "is_ranked": gallery.ranking is not None,
                        "missing": _missing(gallery, names, sheets.reasons.get(cell.line.method, {})),
                    }
                    for cell, gallery in pairs
                ],
            }
        )
    failed = [
        {"input": line.input, "title": line.label, "why": f"{line.status}: {brief(line.reason)}"}
        for line in table.lines
        if not line.scores and line.status != "missing"
    ]
    shared = {"part": _PART, "measures": PRINTED, "galleries": galleries, "failed": failed}
    add_script(files, f"{stem}-queries", shared)


def _missing(gallery: RankedGallery, names: Sequence[str], reasons: Mapping[str, str]) -> dict[str, list[int]]:
    """Return the shapes without a picture of their form, by reason."""
    reasons = {**reasons, **{name: brief(reason) for name, reason in gallery.record["unsupported"]}}
    missing: dict[str, list[int]] = {}
    for place, name in enumerate(names):
        if reason := reasons.get(name, NOT_STORED):
            missing.setdefault(reason, []).append(place)
    return missing


def _answers(gallery: RankedGallery, names: Sequence[str], queries: Sequence[str]) -> dict[str, Any]:
    """Return the nearest shapes of each query, by index among the names, and its scores, or None."""
    record, ranking = gallery.record, gallery.ranking
    place, answered = {name: k for k, name in enumerate(names)}, answered_shapes(record)
    own, row = ({name: k for k, name in enumerate(shapes)} for shapes in (record["shapes"], answered))
    nearest = None
    if ranking is not None:
        matches = [[place[answered[match]] for match in of_query] for of_query in ranking.nearest.tolist()]
        nearest = [matches[row[query]] if query in row else None for query in queries]
    return {
        "nearest": nearest,
        "scores": [
            [record["per_query"][name][own[query]] for name in PRINTED] if query in own else None for query in queries
        ],
    }
