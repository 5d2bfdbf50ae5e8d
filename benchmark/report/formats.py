"""Tables as Markdown, LaTeX, CSV and JSON: pure functions of their content, stable to the byte."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from typing import Any

from benchmark.contracts import Input
from benchmark.report.cell import Cell, Figures
from benchmark.report.content import Row, TableContent
from benchmark.report.escaping import csv_cell, latex_text, markdown_line, markdown_text
from benchmark.storage.keys import digest
from retrieval.measures import PRINTED

BLANK = "--"


def markdown(table: TableContent) -> str:
    """A table as aligned Markdown with its notes, to be read in a terminal as well."""
    header = ["Method", *(f"{group} {metric}" for group, _ in column_groups(table) for metric in PRINTED)]
    figures = cells(table, "**{}**", " ± ")
    body = [[markdown_text(row.label), *values] for row, values in zip(table.rows, figures, strict=True)]
    body.append(["*Chance*", *(number(table.chance[metric]) for _ in column_groups(table) for metric in PRINTED)])
    widths = [max(len(line[k]) for line in [header, *body]) for k in range(len(header))]
    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    lines = [f"**{markdown_text(f'{_title(table)}. {table.table.caption}: {table.data_title} ({table.size}).')}**", ""]
    for line in [header, rule, *body]:
        first, *rest = line
        lines.append(
            f"| {first.ljust(widths[0])} | "
            + " | ".join(c.rjust(w) for c, w in zip(rest, widths[1:], strict=True))
            + " |"
        )
    notes = table.notes()
    return "\n".join([*lines, *([""] if notes else []), *(f"- {markdown_line(note)}" for note in notes)]) + "\n"


def latex(table: TableContent) -> str:
    r"""A table for ``\input`` in a paper; needs the package booktabs. Its first line names what it was made from."""
    groups = column_groups(table)
    column = 2
    spans, rules = [], []
    for group, _ in groups:
        spans.append(rf"\multicolumn{{{len(PRINTED)}}}{{c}}{{{latex_text(group)}}}")
        rules.append(rf"\cmidrule(lr){{{column}-{column + len(PRINTED) - 1}}}")
        column += len(PRINTED)
    caption = f"{table.table.caption}: {table.data_title} ({table.size}). {_legend(table)}"
    lines = [
        f"% {table.file_stem}, made from records {_digest(table)}",
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{latex_text(caption)}}}",
        rf"\label{{tab:{table.file_stem}}}",
        rf"\begin{{tabular}}{{l{'r' * len(PRINTED) * len(groups)}}}",
        r"\toprule",
        " & ".join(["", *spans]) + r" \\",
        " ".join(rules),
        " & ".join(["Method", *(metric for _ in groups for metric in PRINTED)]) + r" \\",
        r"\midrule",
    ]
    last = ""
    for row, values in zip(table.rows, cells(table, r"\textbf{{{}}}", r" $\pm$ "), strict=True):
        if last and row.family != last:
            lines.append(r"\midrule")
        last = row.family
        lines.append(" & ".join([latex_text(row.label), *values]) + r" \\")
    chance = [number(table.chance[metric]) for _ in groups for metric in PRINTED]
    lines += [r"\midrule", " & ".join(["Chance", *chance]) + r" \\", r"\bottomrule", r"\end{tabular}"]
    notes = table.notes()
    if notes:
        lines.append(r"\par\smallskip{\footnotesize " + " ".join(latex_text(_sentence(note)) for note in notes) + "}")
    return "\n".join([*lines, r"\end{table}"]) + "\n"


def rows_as_json(tables: Sequence[TableContent]) -> list[dict[str, Any]]:
    """One object per table, input and method, with the keys that other programs rely on."""
    return [
        _json_row(table, row, input_, row.cells[input_])
        for table in tables
        for input_ in table.inputs
        for row in table.rows
        if input_ in row.cells
    ]


def as_json(tables: Sequence[TableContent]) -> str:
    """All tables as one JSON list."""
    return json.dumps(rows_as_json(tables), indent=1) + "\n"


def as_csv(tables: Sequence[TableContent]) -> str:
    """All tables as one flat CSV: one line per table, input and method."""
    names = ["table", "dataset", "stand_in", "input", "method", "title", *PRINTED]
    names += [f"paper_{m}" for m in PRINTED] + [f"chance_{m}" for m in PRINTED]
    names += ["n_shapes", "n_classes", "unsupported", "seconds", "peak_mib"]
    names += [f"spread_{m}" for m in PRINTED] + ["n_models", "n_galleries", "status", "outdated"]
    text = io.StringIO()
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    for row in rows_as_json(tables):
        flat = {name: row[name] for name in names if name in row}
        for part in ("paper", "chance", "spread"):
            flat |= {f"{part}_{metric}": (row[part] or {}).get(metric) for metric in PRINTED}
        writer.writerow({name: csv_cell(value) for name, value in flat.items()})
    return text.getvalue()


def _json_row(table: TableContent, row: Row, input_: Input, cell: Cell) -> dict[str, Any]:
    record, scores = cell.record, cell.scores
    return {
        "table": table.identifier,
        "dataset": table.data["name"],
        "stand_in": bool(table.data["stand_in_for"]),
        "quick": table.quick,
        "input": input_,
        "method": row.method,
        "title": row.title,
        **{metric: round(scores[metric], 6) if scores else None for metric in PRINTED},
        "paper": dict(row.paper) if row.paper else None,
        "chance": {metric: round((record.get("chance") or table.chance)[metric], 6) for metric in PRINTED},
        "n_shapes": record.get("n_shapes"),
        "n_classes": record.get("n_classes"),
        "unsupported": len(record.get("unsupported", [])),
        "seconds": round(sum(record["cost"]["seconds_per_shape"].values()), 4) if "cost" in record else None,
        "peak_mib": record.get("peak_mib"),
        "spread": {metric: round(cell.deviation[metric], 6) for metric in PRINTED} if cell.deviation else None,
        "n_models": len(cell.models) or None,
        "n_galleries": table.n_galleries,
        "outdated": cell.outdated or None,
        "status": cell.status,
    }


def column_groups(table: TableContent) -> list[tuple[str, Input | None]]:
    """Column groups: the paper first, then the inputs."""
    ours: list[tuple[str, Input | None]] = [(input_, input_) for input_ in table.inputs]
    return [("paper", None), *ours] if table.has_paper else ours


def cells(table: TableContent, mark: str, plus_minus: str) -> list[list[str]]:
    """Format the figures of each row; the best of each of our columns is marked.

    Marked is what reads as best: figures are compared after rounding, and equals are all marked. Means are followed by
    their spread.
    """
    columns: list[list[str]] = []
    for _, input_ in column_groups(table):
        for metric in PRINTED:
            values = [_value(row, input_, metric) for row in table.rows]
            texts = [number(value) for value in values]
            best = max((text for text in texts if text != BLANK), default=None) if input_ else None
            marked = [mark.format(text) if text == best else text for text in texts]
            spreads = [_spread(row, input_, metric) for row in table.rows]
            columns.append(
                [
                    text if spread is None else f"{text}{plus_minus}{number(spread)}"
                    for text, spread in zip(marked, spreads, strict=True)
                ]
            )
    return [list(line) for line in zip(*columns, strict=True)]


def _value(row: Row, input_: Input | None, metric: str) -> float | None:
    if input_ is None:
        scores: Figures | None = row.paper
    else:
        cell = row.cells.get(input_)
        scores = cell.scores if cell else None
    return scores[metric] if scores else None


def _spread(row: Row, input_: Input | None, metric: str) -> float | None:
    cell = row.cells.get(input_) if input_ else None
    return cell.deviation[metric] if cell and cell.deviation else None


def number(value: float | None) -> str:
    """Two decimals, as the paper prints them."""
    return BLANK if value is None else f"{value:.2f}"


def _title(table: TableContent) -> str:
    return f"Table {table.identifier}"


def _legend(table: TableContent) -> str:
    ours = " and ".join(
        {"mesh": "mesh: complete surface", "view": "view: surface seen by one depth camera"}[input_]
        for input_ in table.inputs
    )
    return f"Columns: {'paper: as printed there; ' if table.has_paper else ''}{ours}. {BLANK}: no result."


def _sentence(note: str) -> str:
    return note if note.endswith(".") else f"{note}."


def _digest(table: TableContent) -> str:
    def part(cell: Cell) -> Mapping[str, Any]:
        return {"key": cell.record.get("key"), "scores": cell.scores, "status": cell.status}

    return digest([(row.method, {input_: part(cell) for input_, cell in row.cells.items()}) for row in table.rows])
