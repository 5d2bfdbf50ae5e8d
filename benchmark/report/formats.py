"""Tables as LaTeX, Markdown and JSON: pure functions of records, byte for byte."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, groupby, product
from textwrap import wrap
from typing import Any

from benchmark.errors import ConfigurationError
from benchmark.pipeline.records import Record
from benchmark.protocols.tables import ROBUST, TABLES, TITLES, Block
from benchmark.reference.paper import entry_of
from benchmark.report.columns import (
    OBJECTS,
    PRINTED_QUANTITIES,
    PRINTED_SCORES,
    Column,
    Group,
    Place,
    cells,
    score_groups,
    values,
)
from benchmark.report.data_titles import data_title
from benchmark.report.notation import BLANK, hundredths
from benchmark.report.notes import table_notes
from benchmark.report.record_facts import (
    DataChange,
    change_of,
    fold_of,
    of_newest_versions,
    scored_by,
)
from benchmark.report.rows import BLOCKS, TableRow
from benchmark.report.table_view import PAPER, QUICK_RUN, SECOND, TableView
from benchmark.text import clean_text

#: Title of the line of a random order.
CHANCE = "Random order"

#: Key of the paper in the bibliography.
_PAPER_KEY = "canonicalreconstruction"

#: Characters of a line of Markdown, at most; a long name may need more.
MARKDOWN_WIDTH = 100

#: Scores that fit one column of a two-column page.
_SCORES_OF_ONE_COLUMN = 8

#: Characters of a line of a heading in LaTeX.
_HEADING_WIDTH = 17

#: Last code of a character that pdflatex has in its fonts (Latin Extended-A).
_LAST_OF_PDFLATEX = 0x17F

#: Characters of the longest title from which the column of titles has a fixed share of the page.
_LONG_TITLE = 25

_MARKDOWN = {
    **{character: f"\\{character}" for character in "\\|*_`[]#$~"},
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
    "[": "{[}",  # behind the end of a row, it would begin an option, and a star be part of that
    "*": "{*}",
}


def markdown_text(text: str) -> str:
    """Return text as Markdown shows it literally, in a table, too."""
    return "".join(_MARKDOWN.get(character, character) for character in clean_text(text))


def latex_text(text: str) -> str:
    """Return text as LaTeX shows it literally.

    Characters that pdflatex lacks become question marks.
    """
    characters = []
    for character in clean_text(text):
        known = character if ord(character) <= _LAST_OF_PDFLATEX else "?"
        characters.append(_LATEX.get(known, known))
    return "".join(characters)


def latex_title(title: str) -> str:
    """Return a title as LaTeX, where lines may also end within parameters."""
    parts = re.split(r"(?<=[\[\]=,_/:])(?=[\w.])", title)
    return r"\allowbreak{}".join(map(latex_text, parts))


# Lines and cells, for all formats
# ------------------------------------------------------------------------------------------------


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
    row: TableRow | None = None

    @property
    def has_folds(self) -> bool:
        """Whether a cell has scores over folds."""
        return any(cell.folds for cell in chain.from_iterable(self.groups))


def blocks(view: TableView) -> Iterator[tuple[str, list[Line]]]:
    """Yield the blocks of rows of a table, such as canonical forms: a heading, and the lines.

    The last block has no heading, and one line: the scores of a random order.
    """
    has_mixed_inputs = all(column.has_mixed_inputs for column in view.columns)
    groups = score_groups(view)
    for block, heading in BLOCKS.items():
        rows = [row for row in view.printed_rows if row.kind == block]
        if not rows:
            continue
        remarks = list(_draws_in_words(view, rows))
        if has_mixed_inputs:
            remarks.insert(0, _input_in_words(block, rows))
        details = "; ".join(filter(None, remarks))
        if details:
            heading = f"{heading} ({details})"
        yield heading, [_line(view, groups, row) for row in rows]
    yield "", [_chance_line(view, groups)]


def _input_in_words(block: Block, rows: Iterable[TableRow]) -> str:
    """Return what the rows of a block see."""
    if block == "external":
        return ""
    if block != "network":
        return "complete surfaces"
    records = chain.from_iterable(row.records for row in rows)
    if any(record.input == "mesh" for record in records):
        return "one depth view unless named"
    return "one depth view"


def _draws_in_words(view: TableView, rows: Sequence[TableRow]) -> Iterator[str]:
    """Say in which columns the rows of a block rank fewer draws of the data than other rows do."""
    for column in view.columns:
        if column.over_draws:
            most = max(row.n_galleries(column.title) for row in view.printed_rows)
            fewer = max(row.n_galleries(column.title) for row in rows)
            if 0 < fewer < most:
                yield f"{column.title}: {fewer} of {most} draws"


def _line(view: TableView, groups: Iterable[Group], row: TableRow) -> Line:
    """Return the line of a row."""
    return Line(
        clean_text(row.title),
        tuple(_cells(view, group, row) for group in groups),
        [Cell(column.cell(row), value=column.value(row)) for column in PRINTED_QUANTITIES],
        row,
    )


def _cells(view: TableView, group: Group, row: TableRow) -> list[Cell]:
    """Return the cells of a row in a group of columns.

    Parameters
    ----------
    view
        The table.
    group
        Columns below one heading, such as the four measures of a gallery.
    row
        The row.

    Returns
    -------
    list of Cell
        One per column, with score, mark and range over folds. If the row has no scores, a single
        cell that says why.
    """
    if not view.scores(row, group.title):
        return [Cell(_why_empty(group.title, row))]
    marks = view.marks.get((row.method, group.title), {})
    ranges: list[tuple[str, str] | None] = [None for _ in group.columns]
    over_folds = view.of_folds(row, group.title)
    if over_folds:
        ranges = [(hundredths(low), hundredths(high)) for low, high in over_folds]
    cells = []
    for column, range_over_folds in zip(group.columns, ranges, strict=True):
        mark = marks.get(column.key, "")
        cells.append(Cell(column.cell(row), mark, column.value(row), range_over_folds))
    return cells


def _why_empty(group: str, row: TableRow) -> str:
    """Return what stands where a row has no scores in a group."""
    if group in (PAPER, SECOND):
        return ""
    if group in row.failed:
        return row.failed[group][0].status
    return BLANK


def _chance_line(view: TableView, groups: Iterable[Group]) -> Line:
    """Return the line of the scores of a random order."""
    of_groups = tuple(_chance_cells(view, group) for group in groups)
    return Line(CHANCE, of_groups, [Cell("") for _ in PRINTED_QUANTITIES])


def _chance_cells(view: TableView, group: Group) -> list[Cell]:
    """Return the scores of a random order in a group; a blank where there is none."""
    scores = view.chance.get(group.title)
    if scores is None:
        return [Cell("")]
    return [
        Cell(column.text(scores[column.key]), value=scores[column.key]) for column in group.columns
    ]


# Markdown
# ------------------------------------------------------------------------------------------------


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
    """Return a table as Markdown: caption, cells, and a list of notes, in lines of 100 characters.

    A row with ranges over folds has a second line for them.
    """
    table = markdown_table(_markdown_head(view), [*_markdown_body(view)])
    notes: list[str] = []
    for note in table_notes(view):
        notes += _wrapped(f"- {markdown_text(note)}", "  ")
    return "\n".join([*_wrapped(_markdown_caption(view)), "", *table, "", *notes]) + "\n"


def _markdown_caption(view: TableView) -> str:
    """Return the caption of a table, whose name is bold; own data have no name of a table."""
    if view.table in TABLES:
        name = markdown_text(view.table.identifier)
        return f"**Table {name}.** {markdown_text(view.caption)}."
    title = view.table.caption
    return f"**{markdown_text(title)}**{markdown_text(view.caption.removeprefix(title))}."


def _markdown_head(view: TableView) -> list[str]:
    """Return the headings of a table.

    The first group names its columns, and so does each one whose columns differ from the last.
    """
    headings = []
    last_names = ""
    for group in score_groups(view):
        names = " ".join(column.title for column in group.columns)
        headings.append(group.title if names == last_names else f"{group.title}: {names}")
        last_names = names
    return ["Method", *headings, *(column.title for column in PRINTED_QUANTITIES)]


def _wrapped(words: str, indent: str = "") -> list[str]:
    """Return words as lines, without dividing a word."""
    return wrap(
        words,
        MARKDOWN_WIDTH,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def markdown_table(head: Sequence[str], body: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table; rows with fewer cells are filled."""
    n_columns = len(head)
    rule = ["---"] + ["---:"] * (n_columns - 1)
    lines = [_markdown_row(head), _markdown_row(rule)]
    for row in body:
        missing = [""] * (n_columns - len(row))
        lines.append(_markdown_row([*row, *missing]))
    return lines


def _markdown_row(cells: Iterable[str]) -> str:
    """Return a row of a Markdown table."""
    return f"|{'|'.join(cells)}|"


# LaTeX
# ------------------------------------------------------------------------------------------------

_LATEX_STYLES = {
    "bold": r"\textbf{{{}}}",
    "italic": r"\textit{{{}}}",
    "scatter": "({})",
    "": "{}",
}


def _markdown_body(view: TableView) -> Iterator[list[str]]:
    """Yield the cells of the lines of a table as Markdown, with a line for each heading."""
    for heading, lines in blocks(view):
        if heading:
            yield [f"**{heading}**"]
        for line in lines:
            title = markdown_text(line.title) if heading else f"*{line.title}*"
            measured = [cell.text for cell in line.measured]
            yield [title, *map(_joined, line.groups), *measured]
            if line.has_folds:
                yield ["", *map(_joined_folds, line.groups)]


def latex(view: TableView) -> str:
    r"""Return a table as LaTeX, to be read by ``\input``.

    A narrow table fits one column of a two-column paper, a wide one spans both (``table*``). The
    paper has to load booktabs and tabularx.
    """
    groups = score_groups(view)
    all_blocks = list(blocks(view))
    all_lines = chain.from_iterable(lines for _, lines in all_blocks)
    has_folds = any(line.has_folds for line in all_lines)
    n_scores = sum(len(group.columns) for group in groups)

    # The layout follows from the width.
    is_wide = n_scores > _SCORES_OF_ONE_COLUMN or has_folds  # ranges do not fit one column
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
        *_latex_body(groups, all_blocks),
        r"\bottomrule",
        rf"\end{{{kind}}}",
        rf"\par\smallskip\parbox{{\linewidth}}{{\scriptsize\raggedright {latex_text(notes)}}}",
        rf"\end{{{environment}}}",
    ]
    return "\n".join(lines) + "\n"


def _wide_columns(view: TableView, groups: Iterable[Group]) -> str:
    """Return columns that spread over the page, so that no name is far from its scores."""
    longest = max(len(row.title) for row in view.printed_rows) + 5  # and a citation
    width = r"0.26\linewidth"
    if longest < _LONG_TITLE:
        width = f"{0.5 * longest:.1f}em"
    names = rf">{{\raggedright\hangindent1em\arraybackslash}}p{{{width}}}"
    scores = "".join(rf"*{{{len(group.columns)}}}{{c}}" for group in groups)
    return rf"@{{\extracolsep{{\fill}}}}{names}{scores}{'r' * len(PRINTED_QUANTITIES)}@{{}}"


def _narrow_columns(groups: Iterable[Group]) -> str:
    """Return columns of which the names of rows get the rest of the width."""
    scores = "".join(rf"*{{{len(group.columns)}}}{{c}}@{{\hskip6pt}}" for group in groups)
    measured = "r" * len(PRINTED_QUANTITIES)
    return rf"@{{}}>{{\raggedright\hangindent1em}}X{scores}{measured}@{{}}"


def _latex_size(*, is_wide: bool, has_folds: bool) -> str:
    """Return the size of the letters, and the distances of columns and rows."""
    style = r"\scriptsize\setlength{\tabcolsep}{1.7pt}"
    if is_wide:  # on a page of one narrow column, smaller
        narrow = r"\scriptsize\setlength{\tabcolsep}{.9pt}"
        wide = r"\footnotesize\setlength{\tabcolsep}{2pt}"
        style = rf"\ifdim\linewidth<400pt{narrow}\else{wide}\fi"
    if has_folds:
        return style + r"\renewcommand{\arraystretch}{1.25}"
    return style


def _latex_head(groups: Sequence[Group]) -> list[str]:
    """Return the lines of the head: headings of groups, rules below these, titles of columns."""
    # The last columns are measured quantities, such as seconds, which have no heading of a group.
    blank = [""] * len(PRINTED_QUANTITIES)
    measured = [column.title for column in PRINTED_QUANTITIES]
    headings = [_spread(_latex_heading(group.title), group) for group in groups]
    columns = chain.from_iterable(group.columns for group in groups)
    titles = [column.title for column in columns]
    rules = []
    last = 1  # the first column of a table holds the titles of the rows
    for group in groups:
        first = last + 1
        last += len(group.columns)
        rules.append(rf"\cmidrule(r){{{first}-{last}}}")
    return [
        latex_row("", *headings, *blank),
        "".join(rules),
        latex_row("", *titles, *measured),
    ]


def _latex_heading(title: str) -> str:
    """Return the heading of a group, in lines if it is long."""
    if title == PAPER:
        return rf"Paper~\cite{{{_PAPER_KEY}}}"
    lines = [latex_text(line) for line in wrap(title.capitalize(), _HEADING_WIDTH)]
    if len(lines) == 1:
        return lines[0]
    stacked = r"\\".join(lines)
    return rf"\shortstack{{{stacked}}}"


def _latex_body(
    groups: Sequence[Group], every: Iterable[tuple[str, Sequence[Line]]]
) -> Iterator[str]:
    """Yield the lines of the body: a rule and a heading for each block, then its rows.

    Parameters
    ----------
    groups
        Groups of columns with scores.
    every
        Heading and rows of each block; "" for no heading.
    """
    # Title, scores, and measured quantities.
    n_columns = 1 + sum(len(group.columns) for group in groups) + len(PRINTED_QUANTITIES)
    for heading, lines in every:
        yield r"\midrule"
        if heading:
            emphasised = rf"\emph{{{latex_text(heading)}}}"
            yield rf"\multicolumn{{{n_columns}}}{{@{{}}l}}{{{emphasised}}} \\"
        for line in lines:
            scores: list[str] = []
            for cells_of_group, group in zip(line.groups, groups, strict=True):
                scores += _latex_cells(cells_of_group, group)
            measured = [cell.text for cell in line.measured]
            yield latex_row(latex_title(line.title) + _cited(line.row), *scores, *measured)


def _cited(row: TableRow | None) -> str:
    """Return the citation behind the title of a row; "" if it cites nothing."""
    key = entry_of(row.cite)[0] if row else ""
    return rf"~\cite{{{key}}}" if key else ""


def _latex_cells(cells: Sequence[Cell], group: Group) -> list[str]:
    """Return the cells of a group.

    One that says why there are no scores spreads over all of them.
    """
    if len(cells) < len(group.columns):
        return [_spread(cells[0].text, group)]
    return [_LATEX_STYLES[cell.mark].format(cell.text) + _latex_folds(cell) for cell in cells]


def _latex_folds(cell: Cell) -> str:
    """Return the least and the greatest fold of a score, below and above it; "" without folds."""
    if cell.folds is None:
        return ""
    low, high = cell.folds
    return rf"$_{{\mathrm{{{low}}}}}^{{\mathrm{{{high}}}}}$"


def _spread(words: str, group: Group) -> str:
    """Return a cell over all columns of a group."""
    return rf"\multicolumn{{{len(group.columns)}}}{{c}}{{{words}}}"


def bibtex_of_tables(views: Sequence[TableView]) -> str:
    """Return the BibTeX entries that LaTeX tables cite, as the content of a ``.bib`` file.

    Raises
    ------
    ConfigurationError
        If two methods cite different entries under one key.
    """
    cited = [_PAPER_KEY] if any(view.paper for view in views) else []
    for view in views:
        cited += [row.cite for row in view.printed_rows]
    entries: dict[str, str] = {}
    for key, entry in map(entry_of, cited):
        known_entry = entries.setdefault(key, entry)
        if known_entry != entry:
            raise ConfigurationError(
                f"two methods cite '{key}' with different entries", "rename a key, and run again"
            )
    return "\n\n".join(filter(None, entries.values())) + "\n"


def latex_row(*cells: str) -> str:
    """Return a row of a table."""
    return " & ".join(cells) + r" \\"


def latex_of_scores(title: str, scores: Mapping[str, float]) -> list[str]:
    """Return a row with the scores of a matrix, below a comment with its headings."""
    heading = " ".join(column.title for column in PRINTED_SCORES)
    texts = []
    for column in PRINTED_SCORES:
        has_score = column.key in scores
        texts.append(column.text(scores[column.key]) if has_score else BLANK)
    return [f"% {heading}", latex_row(latex_title(title), *texts)]


# Robustness
# ------------------------------------------------------------------------------------------------

#: Measure in the table of robustness.
_ROBUSTNESS_MEASURE = "NN"


def robustness_markdown(records: Iterable[Record]) -> str:
    """Return a table of how well methods retrieve shapes whose meshes were damaged.

    It has a line for each kind of damage, such as noise or holes, and its strength, and a column
    for each of some methods. Lines of several data sets name theirs. "" if there is no result for
    damaged shapes.
    """
    known = records_of_robustness(records)
    by_change = _methods_by_change(known)
    if not by_change:
        return ""

    changes = sorted(by_change)
    # Kind and strength of the change, then one column for each method that ran.
    columns = [
        Column[DataChange]("change", lambda change: change.kind or "unchanged", "Change"),
        Column[DataChange]("strength", lambda change: change.strength, "strength"),
    ]
    if len({change.base for change in changes}) > 1:
        columns.insert(
            0, Column[DataChange]("data", lambda change: markdown_text(change.base), "Data")
        )
    titles = {record.method: TITLES.get(record.method, record.title) for record in known}
    methods = set(chain.from_iterable(by_change.values()))
    columns += [
        _robustness_of(method, titles[method], by_change) for method in ROBUST if method in methods
    ]
    head = [column.title for column in columns]
    table = markdown_table(head, [cells(columns, change) for change in changes])

    return "\n".join([_robustness_caption(known), "", *table]) + "\n"


def records_of_robustness(records: Iterable[Record], methods: Iterable[str] = ()) -> list[Record]:
    """Return the records that the table of robustness shows: of changed sets and unchanged ones.

    Those of other versions of the data are left out.

    Parameters
    ----------
    records
        Records of all data sets.
    methods
        Names of methods; empty for all that stand in the table.
    """
    known = [record for record in of_newest_versions(records) if _is_of_robustness(record)]
    wanted = frozenset(methods)
    if wanted:
        known = [record for record in known if record.method in wanted]
    changes = filter(None, (change_of(record.data.name) for record in known))
    changed_sets = {change.base for change in changes}
    return [record for record in known if _change_of_data(record).base in changed_sets]


def _robustness_caption(records: Sequence[Record]) -> str:
    """Return the caption of the table of robustness, which shows these records.

    It names the data sets that were changed; a record of one unchanged gives its title.
    """
    changes = sorted(map(_change_of_data, records))
    titles = {change.base: change.base for change in changes if change.kind}
    for record in records:
        if record.data.name in titles:
            titles[record.data.name] = data_title(record)
    sets = ", ".join(map(markdown_text, titles.values()))
    quick = f" ({QUICK_RUN})" if any(record.data.quick for record in records) else ""
    return (
        f"**Robustness.** {_ROBUSTNESS_MEASURE} of complete surfaces of {sets}{quick}; "
        f"a destroyed shape counts 0. {scored_by(records).note}"
    )


def _methods_by_change(records: Iterable[Record]) -> dict[DataChange, dict[str, Record]]:
    """Return the record of each method, by the change of its data."""
    by_change = defaultdict[DataChange, dict[str, Record]](dict)
    for record in records:
        by_change[_change_of_data(record)][record.method] = record
    return by_change


def _change_of_data(record: Record) -> DataChange:
    """Return how the data of a record were changed; the kind of unchanged data is ""."""
    name = record.data.name
    return change_of(name) or DataChange(name, "", "0")


def _is_of_robustness(record: Record) -> bool:
    """Return whether a record may stand in the table of robustness."""
    return record.input == "mesh" and record.method in ROBUST and not fold_of(record)


def _robustness_of(
    method: str, title: str, by_change: Mapping[DataChange, Mapping[str, Record]]
) -> Column[DataChange]:
    """Return the column of a method in the table of robustness."""
    return Column(
        method, lambda change: by_change[change].get(method), title, text=_robustness_text
    )


def _robustness_text(record: Record) -> str:
    """Return the score of a record; without scores, its status, such as ``timeout``."""
    if record.status != "ok":
        return record.status
    return hundredths(record.scores[_ROBUSTNESS_MEASURE])


# JSON
# ------------------------------------------------------------------------------------------------


def as_json(views: Iterable[TableView]) -> list[dict[str, Any]]:
    """Return an object for each row and column of each table, with keys on which programs rely."""
    places: list[Place] = []
    for view in views:
        printed = product(view.printed_rows, view.columns)
        places += [Place(view, row, column.title) for row, column in printed]
    return [values(OBJECTS, place) for place in places]
