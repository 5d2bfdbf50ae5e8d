"""Tables as Markdown, CSV and JSON: pure functions of their content, stable to the byte."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from benchmark.api.contracts import Input
from benchmark.pipeline.storage.records import chance_of
from benchmark.protocols.tables import INPUTS
from benchmark.report.cell import Cell, Figures
from benchmark.report.content import Row, TableContent
from benchmark.report.escaping import csv_text, markdown_line, markdown_table, markdown_text
from benchmark.report.frame import Style, figures, labels, printed
from benchmark.report.notes import notes
from benchmark.report.rounding import number
from benchmark.report.statistics.table_significance import FigureSignificance
from retrieval.measures import PRINTED

_STYLE = Style("**{}**", "*{}*")


def markdown(table: TableContent) -> str:
    """A table as aligned Markdown with its notes, to be read in a terminal as well."""
    wide = printed(figures(table), _STYLE)
    header = ["Method", *map(" ".join, wide.columns)]
    *names, chance = labels(table)
    names = [*map(markdown_text, names), f"*{chance}*"]
    body = [[name, *row] for name, row in zip(names, wide.to_numpy().tolist(), strict=True)]
    caption = f"Table {table.identifier}. {table.caption}: {table.data_title} ({table.size})."
    lines = [f"**{markdown_text(caption)}**", ""]
    lines += markdown_table(header, body, aligned=True)
    told = notes(table)
    return "\n".join([*lines, *([""] if told else []), *(f"- {markdown_line(note)}" for note in told)]) + "\n"


def overview(tables: Sequence[TableContent]) -> str:
    """One line for each row of several tables, as aligned Markdown without notes: where it is, and our figures."""
    inputs = [input_ for input_ in INPUTS if any(input_ in table.inputs for table in tables)]
    header = ["Table", "data", "Method", *(f"{input_} {metric}" for input_ in inputs for metric in PRINTED)]
    body = []
    for table in tables:
        where = [markdown_text(part) for part in (table.identifier, table.data["name"])]
        for row in table.rows:
            found = [row.cells[input_].scores if input_ in row.cells else None for input_ in inputs]
            figures = [number(scores.get(metric) if scores else None) for scores in found for metric in PRINTED]
            body.append([*where, markdown_text(row.label), *figures])
    return "\n".join(markdown_table(header, body, n_left=3, aligned=True)) + "\n"


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
    names += ["n_shapes", "n_classes", "unsupported", "coverage", "seconds", "peak_mib"]
    names += [f"{part}_{m}" for part in ("low", "high", "p_best", "spread") for m in PRINTED] + [
        "n_models",
        "n_galleries",
        "origin",
        "status",
        "outdated",
    ]
    rows, made = [], rows_as_json(tables)
    if any("preparation_sd" in row for row in made):
        names += [f"preparation_sd_{m}" for m in PRINTED]
    for row in made:
        flat = {name: row[name] for name in names if name in row}
        for part in ("paper", "chance", "spread", "p_best"):
            flat |= {f"{part}_{metric}": (row[part] or {}).get(metric) for metric in PRINTED}
        flat |= {f"preparation_sd_{metric}": value for metric, value in row.get("preparation_sd", {}).items()}
        for metric, ends in (row["interval"] or {}).items():
            flat |= {f"low_{metric}": ends[0], f"high_{metric}": ends[1]}
        rows.append(flat)
    return csv_text(names, rows)


def _json_row(table: TableContent, row: Row, input_: Input, cell: Cell) -> dict[str, Any]:
    record, scores = cell.record, cell.scores
    judged: dict[str, FigureSignificance] = {
        metric: table.significance[row.method, input_, metric]
        for metric in PRINTED
        if (row.method, input_, metric) in table.significance
    }
    return {
        "table": table.identifier,
        "dataset": table.data["name"],
        "stand_in": bool(table.data["stand_in_for"]),
        "quick": table.quick,
        "input": input_,
        "method": row.method,
        "title": row.title,
        **{metric: round(scores[metric], 6) if scores and metric in scores else None for metric in PRINTED},
        "paper": dict(row.paper) if row.paper else None,
        "chance": {metric: round(_chance(table, cell)[metric], 6) for metric in PRINTED},
        "n_shapes": record.get("n_shapes"),
        "n_classes": record.get("n_classes"),
        "unsupported": len(record.get("unsupported", [])),
        "coverage": round(cell.coverage, 6) if scores else None,
        **_supported(cell),
        "seconds": None if cell.seconds is None else round(cell.seconds, 4),
        "peak_mib": record.get("peak_mib"),
        "spread": {m: round(cell.deviation[m], 6) for m in PRINTED} if cell.deviation else None,
        "interval": {metric: [round(one.low, 6), round(one.high, 6)] for metric, one in judged.items()} or None,
        "p_best": {metric: one.rounded_probability for metric, one in judged.items()} or None,
        "codebook_deviation": record.get("codebook_deviation"),
        "n_models": len(cell.models) or None,
        "n_galleries": table.n_galleries,
        **({"scorer": table.scorer} if table.scorer else {}),
        **_preparations(cell),
        "origin": cell.origin or None,
        "outdated": cell.outdated or None,
        **({"departs": row.departs} if row.departs else {}),
        "status": cell.status,
    }


def _chance(table: TableContent, cell: Cell) -> Figures:
    """Scores of a random ranking of what a cell shows: of its gallery, or the mean over several."""
    if "chance" in cell.record and "labels" not in cell.record:
        return cell.record["chance"]  # type: ignore[no-any-return]
    return chance_of(cell.record) if cell.scores else table.chance


def _supported(cell: Cell) -> dict[str, float]:
    """Scores over the shapes with a result alone, where there are others."""
    found = cell.record.get("supported", {})
    return {f"{metric}_supported": round(found[metric], 6) for metric in PRINTED if metric in found}


def _preparations(cell: Cell) -> dict[str, Any]:
    """Standard deviation of a row over its jittered preparations; nothing where there are none."""
    if (deviation := cell.preparation_sd) is None:
        return {}
    return {"preparation_sd": {metric: round(deviation[metric], 6) for metric in PRINTED}}
