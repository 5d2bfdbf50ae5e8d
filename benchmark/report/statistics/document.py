"""Tables beside a table: intervals and tests of its figures, and their quantiles over all choices of test subjects."""

from __future__ import annotations

from collections.abc import Sequence

from benchmark.api.contracts import Input
from benchmark.report.content import TIED, Row, TableContent
from benchmark.report.escaping import markdown_table, markdown_text
from benchmark.report.rounding import number
from benchmark.report.statistics.significance import DRAWS, RESAMPLES
from benchmark.report.statistics.table_significance import FigureSignificance
from retrieval.measures import PRINTED


def intervals_markdown(table: TableContent) -> str:
    """Each figure of ours with its interval, its spread over codebooks, and its test against the best, as Markdown."""
    head = ["Method", "input", *PRINTED, "codebooks NN", *(f"p {name}" for name in PRINTED)]
    lines = [
        f"**How sure the figures of table {markdown_text(table.identifier)} are: {markdown_text(table.data_title)} "
        f"({table.size}).**",
        "",
    ]
    body = []
    for input_ in table.inputs:
        for row in table.of(input_).rows:
            judged = [table.significance.get((row.method, input_, name)) for name in PRINTED]
            scores = row.cells[input_].scores if input_ in row.cells else None
            if scores is None or None in judged:
                continue
            figures = [
                f"{number(scores[name])} ({number(one.low)} to {number(one.high)})"
                for name, one in zip(PRINTED, judged, strict=True)
                if one
            ]
            tests = [_probability(one) for one in judged if one]
            body.append([markdown_text(row.label), input_, *figures, _codebooks(row, input_), *tests])
    lines += markdown_table(head, body, 2)
    lines += [
        "",
        f"- In brackets: 95 % of {DRAWS} means over classes drawn anew with replacement; with few classes rather too "
        "narrow.",
        "- Codebooks NN: standard deviation of NN over the codebooks of the scorer, the mean over the jobs of the row; "
        "0 for a descriptor, which has none.",
        "- p: probability of so large a difference from the best row of the column if there were none "
        f"({RESAMPLES + 1} exchanges of the two methods, query by query; Holm's correction over the rows). Best: the "
        "best row itself. Controls take no part.",
    ]
    if any(judged.is_tied for judged in table.significance.values()):
        lines.append(f"- {TIED}: results tie at the first rank.")
    return "\n".join(lines) + "\n"


def _probability(judged: FigureSignificance) -> str:
    if judged.is_best:
        return "best"
    return number(judged.probability, 4)


def _codebooks(row: Row, input_: Input) -> str:
    records = row.cells[input_].records
    found = [each["codebook_deviation"]["NN"] for each in records if each.get("codebook_deviation") is not None]
    return number(sum(found) / len(found) if found else None, 3)


def has_splits(table: TableContent) -> bool:
    """Return whether some row tells of all splits."""
    return any(_quantiles(row, input_) for row in table.rows for input_ in table.inputs)


def splits_markdown(table: TableContent) -> str:
    """Median and quantiles .05 and .95 of each measure over all splits as Markdown, a line for each row and input."""
    found = [
        (row.label, input_, quantiles)
        for input_ in table.inputs
        for row in table.of(input_).rows
        if (quantiles := _quantiles(row, input_))
    ]
    counts = next(cell.record["splits"] for row in table.rows for cell in row.cells.values() if "splits" in cell.record)
    names = [name for name in PRINTED if all(name in quantiles for *_, quantiles in found)]
    lines = [
        f"**All {counts['count']} ways to take {counts['size']} of {table.data['n_classes']} subjects for testing: "
        f"{markdown_text(table.data_title)}. Median (5 % to 95 %).**",
        "",
    ]
    rows = [
        [markdown_text(label), input_, *("{1} ({0} to {2})".format(*map(number, quantiles[name])) for name in names)]
        for label, input_, quantiles in found
    ]
    lines += markdown_table(["Method", "input", *names], rows, 2)
    return "\n".join(lines) + "\n"


def _quantiles(row: Row, input_: Input) -> dict[str, Sequence[float]]:
    return row.cells[input_].record.get("splits", {}).get("quantiles", {}) if input_ in row.cells else {}
