"""Agreement of two scorers on the order of the methods in a table: a pure function of records."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from benchmark.api.contracts import Input
from benchmark.pipeline.storage.records import scorer_name
from benchmark.report.content import TableContent, contents
from benchmark.report.escaping import markdown_table, markdown_text
from benchmark.report.results import Result
from benchmark.report.rounding import BLANK, millionths, number
from retrieval.agreement import FEWEST, Agreement, agreement
from retrieval.measures import PRINTED

_Place = tuple[str, str, bool]


@dataclass(frozen=True)
class TableAgreement:
    """Agreement of two scorers on one table under one input.

    Parameters
    ----------
    table, data
        Numeral of the table, and the data in words.
    input
        What the methods were given.
    methods
        Those that both scorers have scores for; descriptors, which have no scorer, are not among them.
    measures
        Kendall's tau by measure.
    """

    table: str
    data: str
    input: Input
    methods: tuple[str, ...]
    measures: Mapping[str, Agreement]


def agreements(first: Iterable[Result], second: Iterable[Result]) -> list[TableAgreement]:
    """Compare the orders of the methods in each table, input and measure that both scorers have three methods of.

    Parameters
    ----------
    first, second
        What each scorer brought.
    """
    one, other = _tables(first), _tables(second)
    found = []
    for place, table in one.items():
        if place not in other:
            continue
        for input_ in table.inputs:
            ours, theirs = _scores(table, input_), _scores(other[place], input_)
            methods = tuple(name for name in ours if name in theirs)
            if len(methods) < FEWEST:
                continue
            measures = {
                measure: agreement([ours[m][measure] for m in methods], [theirs[m][measure] for m in methods])
                for measure in PRINTED
            }
            quick = " (quick)" if table.quick else ""
            found.append(TableAgreement(table.identifier, f"{table.data_title}{quick}", input_, methods, measures))
    return found


def _tables(results: Iterable[Result]) -> dict[_Place, TableContent]:
    made = contents(result for result in results if scorer_name(result.record))
    return {(table.identifier, table.data["name"], table.quick): table for table in made}


def _scores(table: TableContent, input_: Input) -> dict[str, Mapping[str, float]]:
    cells = {row.method: row.cells[input_] for row in table.rows if input_ in row.cells}
    # A mean over fewer galleries than there are is no score of the table.
    return {
        m: {name: millionths(value) for name, value in c.scores.items()}
        for m, c in cells.items()
        if c.scores is not None and c.n_averaged == c.n_wanted
    }


def markdown(rows: Sequence[TableAgreement], first: str, second: str) -> str:
    """Agreements as a Markdown table with the share of random orders that agree or disagree as much."""
    lines = [
        f"Kendall's tau-b between the orders of the methods by {first} and by {second}; in brackets the share of "
        "random orders with a tau as far from 0.",
        "",
    ]
    body = [
        [
            *map(markdown_text, (row.table, row.data, row.input, len(row.methods))),
            *(_figure(row.measures.get(measure)) for measure in PRINTED),
        ]
        for row in rows
    ]
    lines += markdown_table(["table", "data", "input", "methods", *PRINTED], body, 3)
    return "\n".join(lines) + "\n"


def _figure(found: Agreement | None) -> str:
    return BLANK if found is None or math.isnan(found.tau) else f"{number(found.tau)} ({number(found.p_value, 4)})"
