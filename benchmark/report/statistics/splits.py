"""Dependence of a table on the choice of its test subjects: quantiles over all ways to choose."""

from __future__ import annotations

from collections.abc import Sequence

from benchmark.report.content import Row, TableContent
from benchmark.report.escaping import markdown_row, markdown_rule, markdown_text
from retrieval.measures import PRINTED


def has_splits(table: TableContent) -> bool:
    """Return whether some row tells of all splits."""
    return any(_quantiles(row, input_) for row in table.rows for input_ in table.inputs)


def splits_markdown(table: TableContent) -> str:
    """Median and quantiles .05 and .95 of each measure over all splits as Markdown, a line for each row and input."""
    found = [
        (row.label, input_, quantiles)
        for input_ in table.inputs
        for row in table.rows
        if (quantiles := _quantiles(row, input_))
    ]
    counts = next(cell.record["splits"] for row in table.rows for cell in row.cells.values() if "splits" in cell.record)
    names = [name for name in PRINTED if all(name in quantiles for *_, quantiles in found)]
    lines = [
        f"**All {counts['count']} ways to take {counts['size']} of {table.data['n_classes']} subjects for testing: "
        f"{markdown_text(table.data_title)}. Median (5 % to 95 %).**",
        "",
        markdown_row(["Method", "input", *names]),
        markdown_rule(2 + len(names), 2),
    ]
    for label, input_, quantiles in found:
        figures = ("{1:.2f} ({0:.2f} to {2:.2f})".format(*quantiles[name]) for name in names)
        lines.append(markdown_row([markdown_text(label), input_, *figures]))
    return "\n".join(lines) + "\n"


def _quantiles(row: Row, input_: str) -> dict[str, Sequence[float]]:
    cell = next((cell for name, cell in row.cells.items() if name == input_), None)
    return cell.record.get("splits", {}).get("quantiles", {}) if cell else {}
