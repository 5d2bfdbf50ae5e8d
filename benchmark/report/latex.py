r"""Tables for ``\input`` in a paper.

Of a table with several inputs there is one file for each, as wide as the text of an article, and one with all of them,
which spans both columns of a paper. Where the text is narrower still, a table is scaled down, never up. They need the
packages booktabs and graphicx, and ``references.bib`` for the sources of the methods; the notes go away with
``\newcommand{\tablenotes}[1]{}`` before the first table.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmark.methods.registry import BUILT_IN, MethodSpec
from benchmark.report.cell import Cell
from benchmark.report.columns import BLANK, Group, Style, cells, groups_of, number
from benchmark.report.content import Row, TableContent
from benchmark.report.escaping import latex_text
from benchmark.report.floats import table_float
from benchmark.report.notes import notes
from benchmark.storage.keys import digest
from retrieval.measures import PRINTED

_STYLE = Style(r"\textbf{{{}}}", r"\textit{{{}}}", r"{{\tiny$\,\pm${}}}", "$-$")

_INPUTS = {"mesh": "mesh: complete surface", "view": "view: surface seen by one depth camera"}


def latex_files(tables: Sequence[TableContent]) -> dict[str, str]:
    """Texts by file name: of each table all inputs, each input alone, and the paper's rows beside ours."""
    files: dict[str, str] = {}
    for table in tables:
        files[f"{table.file_stem}.tex"] = latex(table)
        for input_ in table.inputs:
            if len(table.inputs) > 1:
                name = f"{table.file_stem}-{input_}"
                files[f"{name}.tex"] = latex(table.of(input_), name)
            if table.has_paper:
                name = f"paper-{table.file_stem}-{input_}"
                difference = Group(f"{input_} minus paper", input_, is_difference=True)
                files[f"{name}.tex"] = latex(table.of(input_, paper_only=True), name, [difference])
    return files


def latex(table: TableContent, name: str = "", further: Sequence[Group] = ()) -> str:
    r"""One table for ``\input``; one with two inputs spans both columns of a paper.

    Parameters
    ----------
    table
        The table.
    name
        Stem of the file, which the label and the first line have, too; "" for that of the table.
    further
        Columns behind those of the inputs.
    """
    groups, name = [*groups_of(table), *further], name or table.file_stem
    lines = [
        *_head(groups),
        r"\midrule",
        *_body(table, groups),
        r"\midrule",
        " & ".join(["Chance", *_chance(table, groups)]) + r" \\",
    ]
    return table_float(
        name,
        _caption(table),
        f"l{'r' * len(PRINTED) * len(groups)}",
        lines,
        remark=f"made from records {_digest(table)}",
        notes=notes(table, reasons=False),
        spans_columns=len(table.inputs) > 1,
    )


def _head(groups: Sequence[Group]) -> list[str]:
    spans, rules, column = [], [], 2
    for group in groups:
        spans.append(rf"\multicolumn{{{len(PRINTED)}}}{{c}}{{{latex_text(group.title)}}}")
        rules.append(rf"\cmidrule(lr){{{column}-{column + len(PRINTED) - 1}}}")
        column += len(PRINTED)
    return [
        " & ".join(["", *spans]) + r" \\",
        " ".join(rules),
        " & ".join(["Method", *(metric for _ in groups for metric in PRINTED)]) + r" \\",
    ]


def _body(table: TableContent, groups: Sequence[Group]) -> list[str]:
    lines, last = [], ""
    for row, values in zip(table.rows, cells(table, groups, _STYLE), strict=True):
        if last and row.family != last:
            lines.append(r"\midrule")
        last = row.family
        lines.append(" & ".join([latex_text(row.label) + _citation(row), *values]) + r" \\")
    return lines


def _chance(table: TableContent, groups: Sequence[Group]) -> list[str]:
    return [BLANK if group.is_difference else number(table.chance[metric]) for group in groups for metric in PRINTED]


def _citation(row: Row) -> str:
    """The source of a method of this suite; those of plugins are in nobody's list of references."""
    base = row.method.partition("[")[0]
    if base not in BUILT_IN:
        return ""
    cite = MethodSpec(base, BUILT_IN[base]).info.cite
    return rf"~\cite{{{cite}}}" if cite else ""


def _caption(table: TableContent) -> str:
    ours = " and ".join(_INPUTS[input_] for input_ in table.inputs)
    return (
        f"{table.caption}: {table.data_title} ({table.size}). "
        f"Columns: {'paper: as printed there; ' if table.has_paper else ''}{ours}."
    )


def _digest(table: TableContent) -> str:
    def part(cell: Cell) -> Mapping[str, Any]:
        return {"key": cell.record.get("key"), "scores": cell.scores, "status": cell.status}

    return digest([(row.method, {input_: part(cell) for input_, cell in row.cells.items()}) for row in table.rows])
