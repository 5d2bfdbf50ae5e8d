"""Tables as LaTeX, Markdown and JSON: pure functions of records, byte for byte."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from textwrap import wrap
from typing import Any, NamedTuple

from benchmark.errors import ConfigurationError
from benchmark.pipeline.records import Record
from benchmark.protocols.tables import ROBUST, TITLES, Kind
from benchmark.reference.paper import entry_of
from benchmark.report.columns import (
    OBJECTS,
    PRINTED_OF_ROW,
    PRINTED_SCORES,
    Column,
    Group,
    Place,
    cells,
    score_groups,
    values,
)
from benchmark.report.data_titles import data_title
from benchmark.report.frames import BLANK, changed, fold_of, hundredths, scored_by
from benchmark.report.notes import table_notes
from benchmark.report.tables import BLOCKS, PAPER, SECOND, Row, TableView
from benchmark.text import clean_text

CHANCE = "Random order"

#: Key of the paper in the bibliography.
_PAPER = "canonicalreconstruction"

#: Columns of Markdown, at most; a long name may need more.
WIDTH = 100

#: Scores that fit one column of a two-column page.
_ONE_COLUMN = 8

_MARKDOWN = {character: f"\\{character}" for character in "\\|*_`[]#$~"} | {
    "<": "&lt;",
    ">": "&gt;",
    "&": "&amp;",
}
_LATEX = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    '"': "''",
    "|": r"\textbar{}",
    "`": r"\textasciigrave{}",
    "[": "{[}",
}


def markdown_text(text: str) -> str:
    """Return text as Markdown shows it literally, in a table, too."""
    return "".join(_MARKDOWN.get(character, character) for character in clean_text(text))


def latex_text(text: str) -> str:
    """Return text as LaTeX shows it literally; characters that pdflatex lacks become question marks."""
    known = (c if ord(c) < 0x180 else "?" for c in clean_text(text))
    return "".join(_LATEX.get(character, character) for character in known)


def latex_title(title: str) -> str:
    """Return a title as LaTeX, where lines may also end within parameters."""
    return r"\allowbreak{}".join(map(latex_text, re.split(r"(?<=[\[\]=,_/:])(?=[\w.])", title)))


@dataclass(frozen=True)
class Cell:
    """A cell of a table.

    Parameters
    ----------
    text
        What it shows.
    mark
        ``"bold"``, ``"italic"``, ``"scatter"`` or "".
    value
        Its number; None if it has none.
    folds
        The least and the greatest score over folds, as text; None without folds.
    """

    text: str
    mark: str = ""
    value: float | None = None
    folds: tuple[str, str] | None = None


@dataclass(frozen=True)
class Line:
    """A line of a table.

    Parameters
    ----------
    title
        Title of the row.
    groups
        Cells of the columns of each group; a single cell where a row has no scores, which says why.
    measured
        Cells of what was measured.
    row
        The row; None for a random order.
    """

    title: str
    groups: tuple[Sequence[Cell], ...]
    measured: Sequence[Cell]
    row: Row | None = None

    @property
    def has_folds(self) -> bool:
        """Whether a cell has scores over folds."""
        return any(cell.folds for cells in self.groups for cell in cells)


def blocks(view: TableView) -> Iterator[tuple[str, list[Line]]]:
    """Yield the blocks of a table: their headings with their lines; a random order stands last, without a heading."""
    is_as_printed = {column.input for column in view.columns} == {"as printed"}
    groups = score_groups(view)
    for kind, name in BLOCKS.items():
        rows = [row for row in view.printed_rows if row.kind == kind]
        if rows:
            seen = [_input_in_words(kind, rows)] if is_as_printed else []
            words = "; ".join(filter(None, [*seen, *_draws_in_words(view, rows)]))
            heading = f"{name} ({words})" if words else name
            yield heading, [_line(view, groups, row) for row in rows]
    yield "", [_chance_line(view, groups)]


def _input_in_words(kind: Kind, rows: Iterable[Row]) -> str:
    """Return what the rows of a block see."""
    if kind == "external":
        return ""
    if kind != "network":
        return "complete surfaces"
    has_surfaces = any(record.input == "mesh" for row in rows for record in row.records)
    return "one depth view unless named" if has_surfaces else "one depth view"


def _draws_in_words(view: TableView, rows: Sequence[Row]) -> Iterator[str]:
    """Say in which columns the rows of a block rank fewer draws of the data than other rows do."""
    for column in view.columns:
        if column.over_draws:
            most = max(row.n_galleries(column.title) for row in view.printed_rows)
            fewer = max(row.n_galleries(column.title) for row in rows)
            if 0 < fewer < most:
                yield f"{column.title}: {fewer} of {most} draws"


def _line(view: TableView, groups: Iterable[Group], row: Row) -> Line:
    return Line(
        clean_text(row.title),
        tuple(_cells(view, group, row) for group in groups),
        [Cell(column.cell(row), value=column.value(row)) for column in PRINTED_OF_ROW],
        row,
    )


def _cells(view: TableView, group: Group, row: Row) -> list[Cell]:
    """Return the cells of a row in a group; without scores, a single one that says why."""
    if not view.scores(row, group.title):
        return [Cell(_why_empty(group.title, row))]
    marks = view.marks.get((row.method, group.title), {})
    ends = [(hundredths(low), hundredths(high)) for low, high in view.of_folds(row, group.title)]
    folds: Sequence[tuple[str, str] | None] = ends or [None] * len(group.columns)
    return [
        Cell(column.cell(row), marks.get(column.key, ""), column.value(row), of_column)
        for column, of_column in zip(group.columns, folds, strict=True)
    ]


def _why_empty(group: str, row: Row) -> str:
    """Return what stands where a row has no scores in a group."""
    if group in (PAPER, SECOND):
        return ""
    return row.failed[group][0].status if group in row.failed else BLANK


def _chance_line(view: TableView, groups: Iterable[Group]) -> Line:
    """Return the line of the scores of a random order."""

    def cells(group: Group) -> list[Cell]:
        scores = view.chance.get(group.title)
        if scores is None:
            return [Cell("")]
        each = [(column, scores[column.key]) for column in group.columns]
        return [Cell(column.text(score), value=score) for column, score in each]

    return Line(CHANCE, tuple(map(cells, groups)), [Cell("") for _ in PRINTED_OF_ROW])


_MARKDOWN_STYLES = {"bold": "**{}**", "italic": "*{}*", "scatter": "({})", "": "{}"}


def _joined(cells: Iterable[Cell]) -> str:
    """Join the scores of a group; neighbours with one mark share its characters."""
    parts = []
    for mark, of_mark in groupby(cells, key=lambda cell: cell.mark):
        texts = " ".join(cell.text for cell in of_mark)
        parts.append(_MARKDOWN_STYLES[mark].format(texts))
    return " ".join(parts)


def _joined_folds(cells: Iterable[Cell]) -> str:
    """Join the scores over folds of a group; "" without folds."""
    return " ".join("-".join(cell.folds) for cell in cells if cell.folds)


def markdown(view: TableView) -> str:
    """Return a table as Markdown of at most 100 columns, with its notes."""
    body: list[list[str]] = []
    for heading, lines in blocks(view):
        if heading:
            body.append([f"**{heading}**"])
        for line in lines:
            title = markdown_text(line.title) if heading else f"*{line.title}*"
            measured = [cell.text for cell in line.measured]
            body.append([title, *map(_joined, line.groups), *measured])
            if line.has_folds:
                body.append(["", *map(_joined_folds, line.groups)])
    table = markdown_table(_markdown_head(view), body)
    caption = f"**Table {markdown_text(view.table.identifier)}.** {markdown_text(view.caption)}."
    notes = [
        line for note in table_notes(view) for line in _wrapped(f"- {markdown_text(note)}", "  ")
    ]
    return "\n".join([*_wrapped(caption), "", *table, "", *notes]) + "\n"


def _markdown_head(view: TableView) -> list[str]:
    """Return the headings of a table, of which the first group names its columns."""
    first, *others = score_groups(view)
    names = " ".join(column.title for column in first.columns)
    headings = [f"{first.title}: {names}", *(group.title for group in others)]
    return ["Method", *headings, *(column.title for column in PRINTED_OF_ROW)]


def _wrapped(words: str, indent: str = "") -> list[str]:
    return wrap(
        words, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


def markdown_table(head: Sequence[str], body: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table; rows with fewer cells are filled."""
    lines = [[*row, *[""] * (len(head) - len(row))] for row in body]
    return [
        f"|{'|'.join(cells)}|" for cells in (head, ["---", *["---:"] * (len(head) - 1)], *lines)
    ]


_LATEX_STYLES = {
    "bold": r"\textbf{{{}}}",
    "italic": r"\textit{{{}}}",
    "scatter": "({})",
    "": "{}",
}


def latex(view: TableView) -> str:
    r"""Return a table for ``\input``, which needs booktabs and tabularx: one column of a paper, or ``table*``."""
    groups = score_groups(view)
    every = [*blocks(view)]
    has_folds = any(line.has_folds for _, lines in every for line in lines)
    n_scores = sum(len(group.columns) for group in groups)
    is_wide = n_scores > _ONE_COLUMN or has_folds  # ranges of folds do not fit one column
    environment = "table*" if is_wide else "table"
    kind = "tabular*" if is_wide else "tabularx"
    columns = _wide_columns(view, groups) if is_wide else _narrow_columns(groups)
    notes = " ".join(table_notes(view)[:-1])  # the last one is for those who have the suite
    lines = [
        "% needs booktabs and tabularx",
        rf"\begin{{{environment}}}",
        r"\centering",
        rf"\caption{{{latex_text(view.caption)}.}}",
        rf"\label{{tab:{view.stem.removeprefix('table-')}}}",
        _latex_size(is_wide=is_wide, has_folds=has_folds),
        rf"\begin{{{kind}}}{{\linewidth}}{{{columns}}}",
        r"\toprule",
        *_latex_head(groups),
        *_latex_body(groups, every),
        r"\bottomrule",
        rf"\end{{{kind}}}",
        rf"\par\smallskip\parbox{{\linewidth}}{{\scriptsize\raggedright {latex_text(notes)}}}",
        rf"\end{{{environment}}}",
    ]
    return "\n".join(lines) + "\n"


def _wide_columns(view: TableView, groups: Iterable[Group]) -> str:
    """Return columns that spread over the page, so that no name is far from its scores."""
    longest = max(len(row.title) for row in view.printed_rows) + 5  # and a citation
    width = rf"{0.5 * longest:.1f}em" if longest < 25 else r"0.26\linewidth"
    names = rf">{{\raggedright\hangindent1em\arraybackslash}}p{{{width}}}"
    scores = "".join(rf"*{{{len(group.columns)}}}{{c}}" for group in groups)
    return rf"@{{\extracolsep{{\fill}}}}{names}{scores}{'r' * len(PRINTED_OF_ROW)}@{{}}"


def _narrow_columns(groups: Iterable[Group]) -> str:
    """Return columns of which the names of rows get the rest of the width."""
    scores = "".join(rf"*{{{len(group.columns)}}}{{c}}@{{\hskip6pt}}" for group in groups)
    measured = "r" * len(PRINTED_OF_ROW)
    return rf"@{{}}>{{\raggedright\hangindent1em}}X{scores}{measured}@{{}}"


def _latex_size(*, is_wide: bool, has_folds: bool) -> str:
    """Return the size of the letters, and the distances of columns and rows."""
    style = r"\scriptsize\setlength{\tabcolsep}{1.7pt}"
    if is_wide:  # on a page of one narrow column, smaller
        narrow = r"\scriptsize\setlength{\tabcolsep}{.9pt}"
        wide = r"\footnotesize\setlength{\tabcolsep}{2pt}"
        style = rf"\ifdim\linewidth<400pt{narrow}\else{wide}\fi"
    return style + r"\renewcommand{\arraystretch}{1.25}" if has_folds else style


def _latex_head(groups: Sequence[Group]) -> list[str]:
    """Return the headings of the groups, rules below these, and the headings of the columns."""
    blank = [""] * len(PRINTED_OF_ROW)
    measured = [column.title for column in PRINTED_OF_ROW]
    headings = [_spread(_latex_heading(group.title), group) for group in groups]
    titles = [column.title for group in groups for column in group.columns]
    rules = []
    last = 1
    for group in groups:
        first, last = last + 1, last + len(group.columns)
        rules.append(rf"\cmidrule(r){{{first}-{last}}}")
    return [
        latex_row("", *headings, *blank),
        "".join(rules),
        latex_row("", *titles, *measured),
    ]


def _latex_heading(title: str) -> str:
    """Return the heading of a group, in lines if it is long."""
    if title == PAPER:
        return rf"Paper~\cite{{{_PAPER}}}"
    lines = r"\\".join(latex_text(line) for line in wrap(title.capitalize(), 17))
    return rf"\shortstack{{{lines}}}" if r"\\" in lines else lines


def _latex_body(
    groups: Sequence[Group], every: Iterable[tuple[str, Sequence[Line]]]
) -> Iterator[str]:
    """Yield the rows of a table by block."""
    n_columns = 1 + sum(len(group.columns) for group in groups) + len(PRINTED_OF_ROW)
    for heading, lines in every:
        yield r"\midrule"
        if heading:
            emphasised = rf"\emph{{{latex_text(heading)}}}"
            yield rf"\multicolumn{{{n_columns}}}{{@{{}}l}}{{{emphasised}}} \\"
        for line in lines:
            scores = [
                cell
                for cells, group in zip(line.groups, groups, strict=True)
                for cell in _latex_cells(cells, group)
            ]
            measured = [cell.text for cell in line.measured]
            yield latex_row(latex_title(line.title) + _cited(line.row), *scores, *measured)


def _cited(row: Row | None) -> str:
    """Return the citation behind the title of a row."""
    key = entry_of(row.cite)[0] if row else ""
    return rf"~\cite{{{key}}}" if key else ""


def _latex_cells(cells: Sequence[Cell], group: Group) -> list[str]:
    """Return the cells of a group; one that says why there are no scores spreads over all of them."""
    if len(cells) < len(group.columns):
        return [_spread(cells[0].text, group)]
    return [_LATEX_STYLES[cell.mark].format(cell.text) + _latex_folds(cell) for cell in cells]


def _latex_folds(cell: Cell) -> str:
    if not cell.folds:
        return ""
    low, high = cell.folds
    return rf"$_{{\mathrm{{{low}}}}}^{{\mathrm{{{high}}}}}$"


def _spread(words: str, group: Group) -> str:
    return rf"\multicolumn{{{len(group.columns)}}}{{c}}{{{words}}}"


def bibliography(views: Sequence[TableView]) -> str:
    """Return the BibTeX entries that tables in LaTeX cite; raise ``ConfigurationError`` if two have one key."""
    rows = [row.cite for view in views for row in view.printed_rows]
    papers = [_PAPER] if any(view.paper for view in views) else []
    entries: dict[str, str] = {}
    for key, entry in map(entry_of, [*papers, *rows]):
        if entries.setdefault(key, entry) != entry:
            raise ConfigurationError(
                f"two methods cite '{key}' with different entries", "rename a key, and run again"
            )
    return "\n\n".join(filter(None, entries.values())) + "\n"


def latex_row(*cells: str) -> str:
    """Return a row of a table."""
    return " & ".join(cells) + r" \\"


def latex_of_scores(title: str, scores: Mapping[str, float]) -> list[str]:
    """Return a row of a table with the scores of a matrix, below a comment with the headings of its columns."""
    heading = " ".join(column.title for column in PRINTED_SCORES)
    texts = [
        column.text(scores[column.key]) if column.key in scores else BLANK
        for column in PRINTED_SCORES
    ]
    return [f"% {heading}", latex_row(latex_title(title), *texts)]


def robustness_markdown(records: Iterable[Record]) -> str:
    """Return the table of robustness: NN of some methods on each changed set; "" without results on any."""
    known = [
        record
        for record in records
        if record.input == "mesh" and record.method in ROBUST and not fold_of(record)
    ]
    scores = defaultdict[_Change, dict[str, float]](dict)
    for record in known:
        change = _Change(*(changed(record.data.name) or (record.data.name, "", "0")))
        scores[change][record.method] = record.scores.get("NN", 0.0)
    titles = {change.base: change.base for change in sorted(scores) if change.kind}
    titles |= {
        record.data.name: data_title(record) for record in known if record.data.name in titles
    }
    changes = [change for change in sorted(scores) if change.base in titles]
    if not changes:
        return ""
    names = {record.method: TITLES.get(record.method, record.title) for record in known}
    columns = [
        Column[_Change]("change", lambda change: change.kind or "unchanged", "Change"),
        Column[_Change]("strength", lambda change: change.strength, "strength"),
    ]
    tried = [name for name in ROBUST if any(name in scores[change] for change in changes)]
    columns += [_robust(name, names[name], scores) for name in tried]
    sets = ", ".join(map(markdown_text, titles.values()))
    words = f"**Robustness.** NN of complete surfaces of {sets}; a destroyed shape counts 0. {scored_by(known).note}"
    table = markdown_table(
        [column.title for column in columns], [cells(columns, change) for change in changes]
    )
    return "\n".join([words, "", *table]) + "\n"


class _Change(NamedTuple):
    """A change of a data set; "" for none."""

    base: str
    kind: str
    strength: str


def _robust(
    method: str, title: str, scores: Mapping[_Change, Mapping[str, float]]
) -> Column[_Change]:
    return Column(method, lambda change: scores[change].get(method), title, text=hundredths)


def as_json(views: Iterable[TableView]) -> list[dict[str, Any]]:
    """Return one object for each row and column of each table, with the keys on which other programs rely."""
    return [
        values(OBJECTS, Place(view, row, column.title))
        for view in views
        for row in view.printed_rows
        for column in view.columns
    ]
