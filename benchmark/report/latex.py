r"""Tables for ``\input`` in a paper.

Of a table with several inputs there is one file for each and one with all of them. Nothing in them is below footnote
size: what has no room beside or below the rest is a part of its own (:mod:`benchmark.report.floats`). They need the
packages booktabs and graphicx, and ``references.bib`` for the sources of methods, data and scorers; notes stand under
the table, in a file of their own to be put into an appendix, or nowhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal

from benchmark.datasets.decimated import parsed_decimation
from benchmark.datasets.official.sets import SETS
from benchmark.datasets.perturbations.dataset import parsed
from benchmark.pipeline.storage.keys import digest
from benchmark.plugins.registry import BUILT_IN, MethodSpec
from benchmark.plugins.scorers import DEFAULT, scorers
from benchmark.reference.bibliography import is_listed
from benchmark.report.cell import Cell
from benchmark.report.content import Row, TableContent
from benchmark.report.escaping import latex_prose, latex_text
from benchmark.report.floats import SEPARATION, Block, Line, Page, head, points, table_floats
from benchmark.report.grid import Grid, Group, Style, grid_of
from benchmark.report.grid import Line as GridLine
from benchmark.report.notes import notes

Notes = Literal["table", "appendix", "none"]
"""Where notes stand: under their table, in a file beside that of the table, or nowhere."""

_STYLE = Style(r"\textbf{{{}}}", r"\textit{{{}}}", r"\,$\pm${}", "$-$")

#: Points that a measure takes at footnote size by the kind of its group, and its spread.
_WIDTHS, _SPREAD = {"paper": 15.6, "ours": 17.6, "difference": 22.2}, 23.5

#: Points of the space before an interval, which is as wide as two figures.
_BEFORE_INTERVAL = 5.0

_INPUTS = {"mesh": "mesh: complete surface", "view": "view: surface seen by one depth camera"}

_SOURCES = {"tosca": "bronstein2008tosca"} | {name: official.citation for name, official in SETS.items()}


def latex_files(tables: Sequence[TableContent], where: Notes = "table") -> dict[str, str]:
    """Write of each table all inputs, each input alone, and the paper's rows beside ours.

    Parameters
    ----------
    tables
        The tables.
    where
        Where their notes stand; those for an appendix are in files ``notes-NAME.tex``.

    Returns
    -------
    dict
        Texts by file name.
    """
    files: dict[str, str] = {}
    for name, table, further in _variants(tables):
        files[f"{name}.tex"] = latex(table, name, further, has_notes=where == "table")
        if where == "appendix" and (said := notes(table, reasons=False)):
            files[f"notes-{name}.tex"] = appendix(name, said)
    return files


def _variants(tables: Sequence[TableContent]) -> Iterator[tuple[str, TableContent, tuple[Group, ...]]]:
    """Name, content and further columns of each file."""
    for table in tables:
        yield table.file_stem, table, ()
        for input_ in table.inputs:
            if len(table.inputs) > 1:
                yield f"{table.file_stem}-{input_}", table.of(input_), ()
            if table.has_paper:
                difference = Group(f"{input_} minus paper", "difference", input_)
                yield f"paper-{table.file_stem}-{input_}", table.of(input_, paper_only=True), (difference,)


def latex(
    table: TableContent,
    name: str = "",
    further: Sequence[Group] = (),
    page: Page | None = None,
    *,
    has_notes: bool = True,
) -> str:
    r"""Write one table for ``\input``.

    Parameters
    ----------
    table
        The table.
    name
        Stem of the file, which the label and the first line have, too; "" for that of the table.
    further
        Columns behind those of the inputs.
    page
        Room for it; None where nothing is known of the paper.
    has_notes
        Whether its notes stand under it.
    """
    grid, name = grid_of(table, further), name or table.file_stem
    return head(name, f"made from records {_digest(table)}") + table_floats(
        name,
        _caption(table),
        [_block(grid, place) for place in range(len(grid.groups))],
        list(_body(grid)),
        notes=notes(table, reasons=False) if has_notes else (),
        page=page or Page(),
    )


def appendix(name: str, said: Sequence[str]) -> str:
    """Write the notes of a table as a paragraph that refers to it."""
    sentences = " ".join(latex_prose(note if note.endswith(".") else f"{note}.") for note in said)
    return f"% notes to {name}\n\\paragraph{{Table~\\ref{{tab:{name}}}.}} {sentences}\n"


def _block(grid: Grid, place: int) -> Block:
    group = grid.groups[place]
    spread = _SPREAD if any(figure.spread for line in grid.lines for figure in line.groups[place]) else 0.0
    widest = _BEFORE_INTERVAL + max(points(figure.text) for line in grid.lines for figure in line.groups[place])
    figure = _WIDTHS.get(group.kind, widest) + spread
    width = sum(max(figure, points(name)) + SEPARATION for name in group.names)
    return Block(latex_text(group.title), group.names, width)


def _body(grid: Grid) -> Iterator[Line]:
    last = ""
    for line in grid.lines:
        cite = _citation(line.row) if line.row else ""
        family = line.row.family if line.row else ""
        blocks = tuple(_figures(line, place, group) for place, group in enumerate(grid.groups))
        has_rule = bool(last) and family != last
        yield Line(latex_prose(line.label) + cite, points(line.label, cited=bool(cite)), blocks, has_rule)
        last = family


def _figures(line: GridLine, place: int, group: Group) -> tuple[str, ...]:
    """Return the figures of a line, or the status of a job that has none."""
    cell = line.row.cells.get(group.input) if line.row and group.input else None
    if cell is None or cell.status in ("ok", "missing"):
        space = r"\enspace " if group.kind == "interval" else ""
        return tuple(space + _STYLE.write(figure) for figure in line.groups[place])
    return (rf"\multicolumn{{{len(group.names)}}}{{c}}{{\textit{{{latex_text(cell.status)}}}}}",)


def _citation(row: Row) -> str:
    """The source of a method of this suite; those of plugins are in nobody's list of references."""
    base = row.method.partition("[")[0]
    return _cited(MethodSpec(base, BUILT_IN[base]).info.cite) if base in BUILT_IN else ""


def _cited(key: str) -> str:
    return rf"~\cite{{{key}}}" if is_listed(key) else ""


def _caption(table: TableContent) -> str:
    """Caption as LaTeX, with the sources of data and scorer."""
    ours = " and ".join(_INPUTS[input_] for input_ in table.inputs)
    columns = f"Columns: {'paper: as printed there; ' if table.has_paper else ''}{ours}."
    scorer = f" Scorer: {found}." if (found := scorer_cited(table)) else ""
    words = latex_prose(f"{table.caption}: {table.data_title}")
    return f"{words}{data_source(table)} {latex_text(f'({table.size}). {columns}')}{scorer}"


def data_source(table: TableContent) -> str:
    """Return the citation of the data set of a table; "" for one that names none."""
    name = str(table.data["name"])
    return _cited(_SOURCES.get((parsed_decimation(name) or parsed(name) or (name,))[0], ""))


def scorer_cited(table: TableContent) -> str:
    """Return the title of the scorer of a table, with its citation; "" for one that is not known."""
    known = scorers().get((table.scorer or DEFAULT).partition("[")[0])
    return f"{latex_text(known.info.title)}{_cited(known.info.cite)}" if known is not None else ""


def _digest(table: TableContent) -> str:
    def part(cell: Cell) -> Mapping[str, Any]:
        return {"scores": cell.scores, "status": cell.status}

    return digest([(row.method, {input_: part(cell) for input_, cell in row.cells.items()}) for row in table.rows])
