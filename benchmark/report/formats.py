"""Tables as Markdown, CSV and JSON, and as files by name: pure functions of their content, byte for byte."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from typing import Any

from benchmark.protocols.tables import INPUTS
from benchmark.report.content import TableContent
from benchmark.report.escaping import csv_text, markdown_document, markdown_table, markdown_text, number
from benchmark.report.frame import Style, figures, labels, printed
from benchmark.report.latex import Notes, latex_files, latex_rows
from benchmark.report.notes import notes
from benchmark.report.reproduction import paper_tables, reproduction_markdown
from benchmark.report.results import Figures
from retrieval.measures import PRINTED

_STYLE = Style("**{}**", "*{}*")

#: First line of the BibTeX file, which distinguishes it from the user's own file.
_BIBLIOGRAPHY = (
    "% Sources of the canonical forms benchmark, written by 'tables'; keep entries of your own elsewhere.\n\n"
)


def render(
    tables: Sequence[TableContent], formats: Iterable[str], where: Notes = "table", *, has_variants: bool = True,
    rows_only: bool = False, has_sources: bool = True,
) -> dict[str, str]:  # fmt: skip
    """Return texts by file name: LaTeX and Markdown files for each table, one CSV and one JSON file for all.

    Parameters
    ----------
    tables, formats
        The tables, and names of formats.
    where, has_variants
        For LaTeX; see :func:`benchmark.report.latex.latex_files`.
    rows_only
        Whether LaTeX consists only of the rows of each table.
    has_sources
        Whether to add the BibTeX entries of methods, scorer and data to LaTeX.
    """
    files: dict[str, str] = {}
    for name in formats:
        if name == "latex":
            rows = {f"{table.file_stem}.tex": latex_rows(table) for table in tables if rows_only}
            files |= rows or latex_files(tables, where, has_variants=has_variants)
            files |= {"references.bib": bibliography()} if has_sources else {}
        elif name == "markdown":
            files |= {f"{table.file_stem}.md": markdown(table) for table in tables}
            files |= {"reproduction.md": reproduction_markdown(tables)} if paper_tables(tables) else {}
        elif name == "csv":
            files["tables.csv"] = as_csv(tables)
        else:
            files["tables.json"] = as_json(tables)
    return files


def bibliography() -> str:
    """Return the BibTeX file of the sources of methods, scorers and data."""
    return _BIBLIOGRAPHY + resources.files("benchmark.reference").joinpath("references.bib").read_text(encoding="utf-8")


def markdown(table: TableContent, most_notes: int | None = None) -> str:
    """Return a table as aligned Markdown with its notes, also for terminals; see :func:`.notes`."""
    wide = printed(figures(table), _STYLE)
    *names, chance = labels(table)
    names = [*map(markdown_text, names), f"*{chance}*"]
    body = [[name, *row] for name, row in zip(names, wide.to_numpy().tolist(), strict=True)]
    rows = markdown_table(["Method", *map(" ".join, wide.columns)], body, aligned=True)
    return markdown_document("table", table=table, rows=rows, notes=notes(table, most=most_notes))


def overview(tables: Sequence[TableContent]) -> str:
    """Return one line for each row of several tables as aligned Markdown: table, data, method, and scores by input."""
    inputs = [input_ for input_ in INPUTS if any(input_ in table.inputs for table in tables)]
    head = ["Table", "data", "Method", *(f"{input_} {measure}" for input_ in inputs for measure in PRINTED)]
    body = []
    rows = [(table, row) for table in tables for row in table.rows]
    for table, row in rows:
        shown = [table.line(row.method, input_) for input_ in inputs]
        scores = [(line.scores or {}) if line else {} for line in shown]
        where = map(markdown_text, (table.identifier, table.data["name"], row.label))
        body.append([*where, *(number(of_input.get(measure)) for of_input in scores for measure in PRINTED)])
    return f"{markdown_table(head, body, n_left=3, aligned=True)}\n"


def as_json(tables: Sequence[TableContent]) -> str:
    """Return all tables as one JSON list."""
    return json.dumps(rows_as_json(tables), indent=1) + "\n"


def as_csv(tables: Sequence[TableContent]) -> str:
    """Return all tables as one flat CSV: one line per table, input and method."""
    rows = []
    for row in rows_as_json(tables):
        ends = row.pop("interval") or {}
        row |= {"low": {name: low for name, (low, _) in ends.items()}}
        row |= {"high": {name: high for name, (_, high) in ends.items()}}
        nested = {
            f"{part}_{name}": value for part, of in row.items() if isinstance(of, dict) for name, value in of.items()
        }
        rows.append(row | nested)
    names = ["table", "dataset", "stand_in", "input", "method", "title", *PRINTED, *_of_measures("paper", "chance")]
    names += ["n_shapes", "n_classes", "unsupported", "coverage", "seconds", "peak_mib"]
    names += _of_measures("low", "high", "p_best", "spread")
    names += ["n_models", "n_galleries", "origin", "status", "outdated"]
    return csv_text(names, rows)


def _of_measures(*parts: str) -> list[str]:
    return [f"{part}_{name}" for part in parts for name in PRINTED]


def rows_as_json(tables: Sequence[TableContent]) -> list[dict[str, Any]]:
    """Return one object per table, input and method, with the keys on which other programs rely."""
    return [
        _json_row(table, line)
        for table in tables
        for input_ in table.inputs
        for line in table.lines
        if line.input == input_
    ]


def _json_row(table: TableContent, line: Any) -> dict[str, Any]:
    scores, judged = line.scores, table.judged(line)
    return {
        "table": table.identifier,
        "dataset": table.data["name"],
        "stand_in": bool(table.data["stand_in_for"]),
        "quick": table.quick,
        "input": line.input,
        "method": line.method,
        "title": line.title,
        **(_rounded(scores) or dict.fromkeys(PRINTED)),
        "paper": dict(line.paper) if line.paper else None,
        "chance": _rounded(line.chance or table.chance),
        "n_shapes": line.n_shapes,
        "n_classes": line.n_classes,
        "unsupported": len(line.unsupported),
        "coverage": round(line.coverage, 6) if scores else None,
        **{f"{name}_supported": round(line.supported[name], 6) for name in PRINTED if name in line.supported},
        "seconds": None if line.seconds is None else round(line.seconds, 4),
        "peak_mib": line.peak_mib,
        "spread": _rounded(line.deviation),
        "interval": {name: [round(one.low, 6), round(one.high, 6)] for name, one in judged.items()} or None,
        "p_best": {name: one.probability and round(one.probability, 4) for name, one in judged.items()} or None,
        "codebook_deviation": line.codebook_deviation,
        "n_models": len(line.models) or None,
        "n_galleries": table.n_galleries,
        **({"scorer": table.scorer} if table.scorer else {}),
        "origin": line.origin or None,
        "outdated": line.outdated or None,
        **({"departs": line.departs} if line.departs else {}),
        "status": line.status,
    }


def _rounded(values: Figures | None) -> Mapping[str, float | None] | None:
    return {name: round(values[name], 6) if name in values else None for name in PRINTED} if values else None
