"""Facts about the jobs behind a table, for the protocol and the statistics of a paper."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from benchmark.api.contracts import Input
from benchmark.plugins.registry import BUILT_IN
from benchmark.report.cell import Cell
from benchmark.report.content import Row, TableContent


@dataclass(frozen=True)
class Lead:
    """The best row of a table by a measure.

    Parameters
    ----------
    input, measure
        The column.
    title, score, low, high
        The row, its figure and the ends of its interval.
    n_others
        Rows that were tested against it, but for those whose first ranks tie.
    inseparable
        Titles of those that cannot be told from it.
    """

    input: Input
    measure: str
    title: str
    score: float
    low: float
    high: float
    n_others: int
    inseparable: tuple[str, ...]


def leads(table: TableContent, measure: str) -> list[Lead]:
    """Return the best row under each input, controls aside; none under an input without complete rows."""
    found = []
    for input_ in table.inputs:
        judged = {row.method: table.significance.get((row.method, input_, measure)) for row in table.rows}
        best = next((row for row in table.rows if (one := judged[row.method]) and one.is_best), None)
        if best is None or (one := judged[best.method]) is None:
            continue
        others = [
            row
            for row in table.rows
            if (other := judged[row.method]) and other.probability is not None and not other.is_tied
        ]
        same = tuple(row.title for row in others if (other := judged[row.method]) and other.is_inseparable)
        score = (best.cells[input_].scores or {})[measure]
        found.append(Lead(input_, measure, best.title, score, one.low, one.high, len(others), same))
    return found


def cells(table: TableContent) -> list[tuple[Row, Input, Cell]]:
    """Return the rows of a table that were run, under each input."""
    found = ((row, input_, cell) for row in table.rows for input_, cell in row.cells.items())
    return [each for each in found if each[2].status != "missing"]


def coverage(table: TableContent) -> tuple[int, list[tuple[str, Input, str]]]:
    """Return how many rows, counted under each input, have a result of every shape, and what the others lack."""
    lacking = []
    for row, input_, cell in cells(table):
        if cell.scores is None:
            lacking.append((row.title, input_, f"none ({cell.status})"))
        elif not cell.is_complete:
            lacking.append((row.title, input_, f"{cell.coverage:.1%} of the shapes"))
    return len(cells(table)) - len(lacking), lacking


def own_methods(tables: Iterable[TableContent]) -> list[str]:
    """Return the titles of methods that are no part of the suite, whose sources nobody here knows."""
    rows = (row for table in tables for row in table.rows)
    return list(dict.fromkeys(row.title for row in rows if row.method.partition("[")[0] not in BUILT_IN))


def records(tables: Iterable[TableContent]) -> list[Mapping[str, Any]]:
    """Return all records with scores behind some tables, each once."""
    found = {r["key"]: r for table in tables for _, _, cell in cells(table) for r in cell.records}
    return list(found.values())


def versions(made: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return the versions of system and packages that some records were made with, those that differ side by side."""
    found: dict[str, dict[str, None]] = {}
    for record in made:
        for each in record.get("environments", ()):
            for name, version in _plain(each.get("environment", each)).items():
                found.setdefault(name, {})[str(version)] = None
    return {name: " and ".join(sorted(values)) for name, values in found.items()}


def _plain(environment: Any) -> dict[str, Any]:
    try:
        found = json.loads(environment) if isinstance(environment, str) else environment
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}
