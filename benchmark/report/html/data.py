"""Data for the charts of a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.api.contracts import Input
from benchmark.report.content import TableContent
from benchmark.report.rankings import (
    CLASSES,
    POSES,
    RECALLS,
    RankedCell,
    classes_of,
    costs_and_scores,
    pareto_front,
    poses_of,
)
from retrieval.measures import PRINTED

#: Maximum number of classes, or of poses, shown individually; more would be unreadable.
_MOST_KINDS = 400


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
