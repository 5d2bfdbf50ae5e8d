r"""LaTeX tables for ``\input`` or for pasting into a paper.

A table with several inputs has one file for each input and one for all. LaTeX sets a table at its natural width, or
breaks titles if the text is narrower. A table that is still too wide or too long continues in another part, and nothing
is smaller than footnote size. Tables need the packages booktabs and tabularx, and ``references.bib`` for the sources of
methods, data and scorers. Notes are printed under the table, in a separate file for an appendix, or not at all;
``\newcommand{\tablenotes}[1]{}`` before the first table removes them.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import Any, Literal, TypeVar

from benchmark.datasets.changes import last_change
from benchmark.datasets.official import SETS
from benchmark.pipeline.storage.keys import digest
from benchmark.plugins.registry import BUILT_IN, MethodSpec
from benchmark.plugins.scorers import DEFAULT, scorers
from benchmark.reference.paper import is_listed
from benchmark.report.content import TableContent
from benchmark.report.escaping import environment, latex_prose, latex_text
from benchmark.report.frame import Extra, Style, figures, labels, printed
from benchmark.report.notes import notes
from benchmark.report.results import MISSING
from benchmark.text import clean

T = TypeVar("T")

Notes = Literal["table", "appendix", "none"]
"""Place of notes: under their table, in a separate file, or nowhere."""

_STYLE = Style(r"\textbf{{{}}}", r"\textit{{{}}}", r"\,$\pm${}", "$-$")

#: Maximum number of values side by side in a part, and in a table of one column of a two-column page; a value with
#: spread or interval counts twice.
_MOST_FIGURES, _OF_COLUMN = 12, 4

#: Lines of a page, of the frame of a tabular, and of the caption of a continued part; characters of a line, and of a
#: title next to many values.
_PAGE, _FRAME, _CONTINUED, _LINE, _TITLE = 36, 4, 3, 80, 22

_INPUTS = {"mesh": "mesh: complete surface", "view": "view: surface seen by one depth camera"}

_SOURCES = {"tosca": "bronstein2008tosca"} | {name: official.citation for name, official in SETS.items()}


class Latex(str):
    """Text that is already LaTeX."""

    __slots__ = ()

    def __html__(self) -> str:
        """Return the text as a template prints it."""
        return self


@dataclass(frozen=True)
class Columns:
    """Columns that stay together: their common heading, their headings, and their cells; all as LaTeX."""

    title: str
    heads: Sequence[str]
    cells: Sequence[str]
    width: int


def latex_files(tables: Sequence[TableContent], where: Notes = "table", *, has_variants: bool = True) -> dict[str, str]:
    """Return each table with all inputs and, with variants, each input alone and the paper's rows with ours.

    Parameters
    ----------
    tables
        The tables.
    where
        Where to print notes; those for an appendix are in files ``notes-NAME.tex``.
    has_variants
        Whether to write more than one file for each table.

    Returns
    -------
    dict
        Texts by file name.
    """
    variants: list[tuple[str, TableContent, Extra | None]] = []
    for table in tables:
        variants.append((table.file_stem, table, None))
        for input_ in table.inputs if has_variants else ():
            if len(table.inputs) > 1:
                variants.append((f"{table.file_stem}-{input_}", table.of(input_), None))
            if table.has_paper:
                variants.append((f"paper-{table.file_stem}-{input_}", table.of(input_, paper_only=True), "difference"))
    files = {}
    for name, table, extra in variants:
        files[f"{name}.tex"] = latex(table, name, extra, has_notes=where == "table")
        if where == "appendix" and (below := notes(table, reasons=False)):
            files[f"notes-{name}.tex"] = appendix(name, below)
    return files


def latex(table: TableContent, name: str = "", extra: Extra | None = None, *, has_notes: bool = True) -> str:
    r"""Return one table for ``\input``.

    Parameters
    ----------
    table
        The table.
    name
        Stem of the file, also used in the label and the first line; "" for that of the table.
    extra
        Columns after those of the inputs.
    has_notes
        Whether to print its notes.
    """
    return float_of(
        name or table.file_stem,
        _caption(table),
        _titles(table),
        _columns(table, extra),
        rules=_rules(table),
        notes=notes(table, reasons=False) if has_notes else (),
        remark=f"made from records {_digest(table)}",
    )


def latex_rows(table: TableContent) -> str:
    """Return only the rows of a table, for the user's own tabular."""
    titles = _titles(table)
    rows = _rows(_columns(table, None), titles, range(len(titles)), _rules(table))
    return "".join(f"{row}\n" for row in rows)


def float_of(
    name: str, caption: str, titles: Sequence[str], columns: Sequence[Columns], *, rules: Collection[int] = (),
    notes: Iterable[str] = (), remark: str = "",
) -> str:  # fmt: skip
    """Return a table as one float, or as several with one number.

    Parameters
    ----------
    name
        Stem of the file, also used in the label.
    caption, titles
        As LaTeX; a title for each line.
    columns
        Columns, in order.
    rules
        Lines with a rule above.
    notes
        Sentences under the table, as plain text.
    remark
        Comment in the first line.
    """
    breakable = [title.replace("=", r"=\allowbreak{}").replace(r"~\cite", r" \cite") for title in titles]
    parts = _packed(((group.width, group) for group in columns), _MOST_FIGURES)
    tabulars: list[tuple[float, Any]] = []
    for part in parts:
        is_wide = sum(group.width for group in part) > 2 * _OF_COLUMN
        heights = [math.ceil(len(title.partition("~")[0]) / _TITLE) if is_wide else 1 for title in titles]
        for lines in _even(heights):
            rows = _rows(part, breakable, range(len(titles))[lines], rules)
            tabulars.append((_FRAME + sum(heights[lines]), {"columns": part, "rows": rows}))
    sentences = ((len(note) / _LINE, _sentence(note)) for note in notes)
    floats = _packed(chain(tabulars, sentences), _PAGE - _CONTINUED, math.ceil(len(caption) / _LINE))
    width = max(sum(group.width for group in part) for part in parts)
    environment = "table" if width <= _OF_COLUMN else "table*"
    return _TEMPLATE.render(name=name, remark=remark, caption=caption, floats=floats, environment=environment)


def _packed(items: Iterable[tuple[float, T]], most: float, used: float = 0) -> list[list[T]]:
    """Distribute items in order over as few lists as their sizes allow; part of the first list is already used."""
    packed: list[list[T]] = [[]]
    for size, item in items:
        if packed[-1] and used + size > most:
            packed.append([])
            used = 0
        packed[-1].append(item)
        used += size
    return packed


def _rows(part: Sequence[Columns], titles: Sequence[str], lines: range, rules: Collection[int]) -> list[str]:
    """Return some lines of a tabular as LaTeX, with the rules above them."""
    cells = [" & ".join([titles[line], *(group.cells[line] for group in part)]) for line in lines]
    above = ["\\midrule\n" if line in rules and line != lines[0] else "" for line in lines]
    return [rf"{rule}{row} \\" for rule, row in zip(above, cells, strict=True)]


def _sentence(note: str) -> str:
    return latex_prose(clean(note if note.endswith(".") else f"{note}."))


def _even(heights: Sequence[int]) -> list[slice]:
    """Divide the lines of a tabular into parts of similar height, none higher than a page."""
    count = math.ceil(sum(heights) / (_PAGE - _FRAME - 2 * _CONTINUED))
    ends, height = [0], 0
    for place, of_line in enumerate(heights, start=1):
        height += of_line
        if height * count >= len(ends) * sum(heights):
            ends.append(place)
    return [slice(start, end) for start, end in pairwise(ends)]


def appendix(name: str, lines: Iterable[str]) -> str:
    """Return the notes of a table as a paragraph that refers to it."""
    sentences = " ".join(map(_sentence, lines))
    return f"% notes to {name}\n\\paragraph{{Table~\\ref{{tab:{name}}}.}} {sentences}\n"


def _titles(table: TableContent) -> list[str]:
    """Return labels with citations of the suite's methods; the bibliography lacks those of plugins."""
    titles = [latex_prose(label) for label in labels(table)]
    for place, row in enumerate(table.rows):
        base = row.method.partition("[")[0]
        titles[place] += _cited(MethodSpec(base, BUILT_IN[base]).info.cite) if base in BUILT_IN else ""
    return titles


def _rules(table: TableContent) -> list[int]:
    """Return the lines whose family differs from that of the line above; the last is chance."""
    families = [*(row.family for row in table.rows), ""]
    return [place for place in range(1, len(families)) if families[place] != families[place - 1]]


def _columns(table: TableContent, extra: Extra | None) -> list[Columns]:
    """Return the values by group, or the status of a job without scores."""
    frame = figures(table, extra)
    wide, columns = printed(frame, _STYLE), []
    for (group, kind, input_), of_group in frame.groupby(["group", "kind", "input"], sort=False, dropna=False):
        heads = list(of_group["measure"].unique())
        space = r"\enspace " if kind == "interval" else ""
        cells = [" & ".join(space + text for text in texts) for texts in wide[group].to_numpy().tolist()]
        for place, row in enumerate(table.rows):
            line = table.line(row.method, input_)
            if line is not None and line.status not in ("ok", MISSING):
                cells[place] = rf"\multicolumn{{{len(heads)}}}{{c}}{{\textit{{{latex_text(line.status)}}}}}"
        is_wide = kind == "interval" or of_group["spread"].any()
        columns.append(Columns(latex_text(group), heads, cells, len(heads) * (1 + is_wide)))
    return columns


def _cited(key: str) -> str:
    return rf"~\cite{{{key}}}" if is_listed(key) else ""


def _caption(table: TableContent) -> str:
    """Return the caption as LaTeX, with citations of data and scorer."""
    ours = " and ".join(_INPUTS[input_] for input_ in table.inputs)
    columns = f"Columns: {'paper: as printed there; ' if table.has_paper else ''}{ours}."
    scorer = f" Scorer: {cited}." if (cited := scorer_cited(table)) else ""
    words = latex_prose(f"{table.caption}: {table.data_title}")
    return f"{words}{data_source(table)} {latex_text(f'({table.size}). {columns}')}{scorer}"


def data_source(table: TableContent) -> str:
    """Return the citation of the data set of a table; "" if it has none."""
    name = str(table.data["name"])
    return _cited(_SOURCES.get((last_change(name) or (name,))[0], ""))


def scorer_cited(table: TableContent) -> str:
    """Return the title of the scorer of a table with its citation; "" for an unknown scorer."""
    known = scorers().get((table.scorer or DEFAULT).partition("[")[0])
    return f"{latex_text(known.info.title)}{_cited(known.info.cite)}" if known is not None else ""


def _digest(table: TableContent) -> str:
    """Return the digest of the scores and statuses of a table."""
    rows: dict[str, dict[str, Any]] = {}
    for line in table.lines:
        rows.setdefault(line.method, {})[line.input] = {"scores": line.scores, "status": line.status}
    return digest([*rows.items()])


def _finalized(value: object) -> Latex:
    return value if isinstance(value, Latex) else Latex(latex_prose(value))


#: All values in templates are cleaned and escaped, except LaTeX.
ENVIRONMENT = environment(
    "benchmark.report", _finalized, block_start_string="<%", block_end_string="%>",
    variable_start_string="<<", variable_end_string=">>", comment_start_string="<#", comment_end_string="#>",
)  # fmt: skip
#: Template of a table; all its values are LaTeX.
_TEMPLATE = ENVIRONMENT.overlay(autoescape=False, finalize=None).get_template("table.tex")
