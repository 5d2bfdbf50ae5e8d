r"""Tables for ``\input`` in a paper, or to be pasted into one.

Of a table with several inputs there is one file for each and one with all of them. LaTeX sets each as wide as it is, or
breaks its titles where the text is narrower; what is too wide or too long all the same goes on in a further part, and
nothing is below footnote size. They need the packages booktabs and tabularx, and ``references.bib`` for the sources of
methods, data and scorers. Notes stand under the table, in a file of their own to be put into an appendix, or nowhere;
``\newcommand{\tablenotes}[1]{}`` before the first table makes them vanish.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any, Literal

from jinja2 import Environment, PackageLoader, StrictUndefined

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
from benchmark.report.frame import Extra, Style, figures, labels, printed
from benchmark.report.notes import notes
from benchmark.report.rounding import number
from benchmark.text import clean

Notes = Literal["table", "appendix", "none"]
"""Where notes stand: under their table, in a file beside that of the table, or nowhere."""

_STYLE = Style(r"\textbf{{{}}}", r"\textit{{{}}}", r"\,$\pm${}", "$-$")

#: Figures beside each other in a part, and in a table that is as wide as one column of two; one with a spread, or an
#: interval, counts twice.
_MOST_FIGURES, _OF_COLUMN = 12, 4

#: Lines of a page, of the frame of a tabular, and of the caption of a part that goes on; characters of a line, and of a
#: title beside many figures.
_PAGE, _FRAME, _CONTINUED, _LINE, _TITLE = 36, 4, 3, 80, 22

_INPUTS = {"mesh": "mesh: complete surface", "view": "view: surface seen by one depth camera"}

_SOURCES = {"tosca": "bronstein2008tosca"} | {name: official.citation for name, official in SETS.items()}


class Latex(str):
    """Text that is LaTeX already."""

    __slots__ = ()

    def __html__(self) -> str:
        """Return the text as a template prints it."""
        return self


@dataclass(frozen=True)
class Columns:
    """Columns that stay together: what stands over them, their headings, and what is in each line; all as LaTeX."""

    title: str
    heads: Sequence[str]
    cells: Sequence[str]
    width: int


def latex_files(tables: Sequence[TableContent], where: Notes = "table", *, has_variants: bool = True) -> dict[str, str]:
    """Write of each table all inputs and, with variants, each input alone, and the paper's rows beside ours.

    Parameters
    ----------
    tables
        The tables.
    where
        Where their notes stand; those for an appendix are in files ``notes-NAME.tex``.
    has_variants
        Whether there is more than one file of each.

    Returns
    -------
    dict
        Texts by file name.
    """
    files: dict[str, str] = {}
    whole = ((table.file_stem, table, None) for table in tables)
    for name, table, extra in _variants(tables) if has_variants else whole:
        files[f"{name}.tex"] = latex(table, name, extra, has_notes=where == "table")
        if where == "appendix" and (said := notes(table, reasons=False)):
            files[f"notes-{name}.tex"] = appendix(name, said)
    return files


def _variants(tables: Sequence[TableContent]) -> Iterator[tuple[str, TableContent, Extra | None]]:
    """Name, content and extra columns of each file."""
    for table in tables:
        yield table.file_stem, table, None
        for input_ in table.inputs:
            if len(table.inputs) > 1:
                yield f"{table.file_stem}-{input_}", table.of(input_), None
            if table.has_paper:
                yield f"paper-{table.file_stem}-{input_}", table.of(input_, paper_only=True), "difference"


def latex(table: TableContent, name: str = "", extra: Extra | None = None, *, has_notes: bool = True) -> str:
    r"""Write one table for ``\input``.

    Parameters
    ----------
    table
        The table.
    name
        Stem of the file, which the label and the first line have, too; "" for that of the table.
    extra
        Columns behind those of the inputs.
    has_notes
        Whether its notes stand under it.
    """
    return float_of(
        name or table.file_stem,
        _caption(table),
        [label + _citation(row) for label, row in _titles(table)],
        _columns(table, extra),
        rules=_rules(table),
        notes=notes(table, reasons=False) if has_notes else (),
        remark=f"made from records {_digest(table)}",
    )


def latex_rows(table: TableContent) -> str:
    """Return the rows of a table alone, for a tabular of one's own."""
    titles = [label + _citation(row) for label, row in _titles(table)]
    rows = _tabular(_columns(table, None), titles, range(len(titles)), _rules(table))["rows"]
    return "".join(f"{row}\n" for row in rows)


def float_of(
    name: str, caption: str, titles: Sequence[str], columns: Sequence[Columns], *, rules: Collection[int] = (),
    notes: Iterable[str] = (), remark: str = "",
) -> str:  # fmt: skip
    """Return a table as one float, or as several under one number.

    Parameters
    ----------
    name
        Stem of the file, which the label has, too.
    caption, titles
        As LaTeX; a title for each line.
    columns
        In the order in which they stand beside each other.
    rules
        Lines that have a rule above them.
    notes
        Sentences under the table, as text.
    remark
        What its first line says of it.
    """
    breakable = [title.replace("=", r"=\allowbreak{}").replace(r"~\cite", r" \cite") for title in titles]
    parts: list[list[Columns]] = [[]]
    for group in columns:
        if parts[-1] and sum(other.width for other in parts[-1]) + group.width > _MOST_FIGURES:
            parts.append([])
        parts[-1].append(group)
    blocks: list[tuple[float, dict[str, Any]]] = []
    for part in parts:
        is_wide = sum(group.width for group in part) > 2 * _OF_COLUMN
        heights = [math.ceil(len(title.partition("~")[0]) / _TITLE) if is_wide else 1 for title in titles]
        for place in _even(heights):
            shown = _tabular(part, breakable, range(len(titles))[place], rules)
            blocks.append((_FRAME + sum(heights[place]), {"tabular": shown, "note": ""}))
    blocks += [(len(note) / _LINE, {"tabular": None, "note": _sentence(note)}) for note in notes]
    floats: list[list[dict[str, Any]]] = [[]]
    used: float = math.ceil(len(caption) / _LINE) + _CONTINUED
    for height, block in blocks:
        if floats[-1] and used + height > _PAGE:
            floats.append([])
            used = _CONTINUED
        floats[-1].append(block)
        used += height
    width = max(sum(group.width for group in part) for part in parts)
    return ENVIRONMENT.get_template("table.tex").render(
        name=Latex(name),
        remark=Latex(remark),
        caption=Latex(caption),
        floats=[(blocks, Latex(" ".join(block["note"] for block in blocks if block["note"]))) for blocks in floats],
        environment=Latex("table" if width <= _OF_COLUMN else "table*"),
    )


def _tabular(part: Sequence[Columns], titles: Sequence[str], lines: range, rules: Collection[int]) -> dict[str, Any]:
    """Heading and rows of a tabular as LaTeX."""
    counts = [len(group.heads) for group in part]
    firsts = list(accumulate(counts, initial=2))
    spans = [rf"\multicolumn{{{count}}}{{c}}{{{group.title}}}" for count, group in zip(counts, part, strict=True)]
    rows = [" & ".join([titles[line], *(group.cells[line] for group in part)]) + r" \\" for line in lines]
    return {
        "count": sum(counts),
        "spans": Latex(" & ".join(["", *spans]) + r" \\") if any(group.title for group in part) else "",
        "span_rules": Latex(" ".join(rf"\cmidrule(lr){{{a}-{b - 1}}}" for a, b in pairwise(firsts))),
        "head": Latex(" & ".join(["Method", *(head for group in part for head in group.heads)]) + r" \\"),
        "rows": [
            Latex("\\midrule\n" * (line in rules and line != lines[0]) + row)
            for line, row in zip(lines, rows, strict=True)
        ],
    }


def _sentence(note: str) -> str:
    return latex_prose(clean(note if note.endswith(".") else f"{note}."))


def _even(heights: Sequence[int]) -> list[slice]:
    """Parts of the lines of a tabular that are about as high, none higher than a page."""
    count = math.ceil(sum(heights) / (_PAGE - _FRAME - 2 * _CONTINUED))
    ends, height = [0], 0
    for place, of_line in enumerate(heights, start=1):
        height += of_line
        if height * count >= len(ends) * sum(heights):
            ends.append(place)
    return [slice(start, end) for start, end in pairwise(ends)]


def appendix(name: str, said: Sequence[str]) -> str:
    """Write the notes of a table as a paragraph that refers to it."""
    sentences = " ".join(map(_sentence, said))
    return f"% notes to {name}\n\\paragraph{{Table~\\ref{{tab:{name}}}.}} {sentences}\n"


def _titles(table: TableContent) -> list[tuple[str, Row | None]]:
    return list(zip(map(latex_prose, labels(table)), [*table.rows, None], strict=True))


def _rules(table: TableContent) -> list[int]:
    """Lines whose family is another one than that of the line above; the last is chance."""
    families = [*(row.family for row in table.rows), ""]
    return [place for place in range(1, len(families)) if families[place] != families[place - 1]]


def _columns(table: TableContent, extra: Extra | None) -> list[Columns]:
    """Figures by group, or the status of a job that has none."""
    frame = figures(table, extra)
    wide, made = printed(frame, _STYLE), []
    for (group, kind, input_), of_group in frame.groupby(["group", "kind", "input"], sort=False, dropna=False):
        space = r"\enspace " if kind == "interval" else ""
        cells = [" & ".join(space + text for text in texts) for texts in wide[group].to_numpy().tolist()]
        for place, row in enumerate(table.rows):
            cell = row.cells.get(input_)
            if cell is not None and cell.status not in ("ok", "missing"):
                heads = of_group["measure"].nunique()
                cells[place] = rf"\multicolumn{{{heads}}}{{c}}{{\textit{{{latex_text(cell.status)}}}}}"
        heads = list(of_group["measure"].unique())
        is_wide = kind == "interval" or of_group["spread"].any()
        made.append(Columns(latex_text(group), heads, cells, len(heads) * (1 + is_wide)))
    return made


def _citation(row: Row | None) -> str:
    """The source of a method of this suite; those of plugins are in nobody's list of references."""
    base = row.method.partition("[")[0] if row else ""
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


def _joined(parts: Sequence[object]) -> Latex:
    *others, last = (part if isinstance(part, Latex) else latex_prose(part) for part in parts)
    return Latex(f"{', '.join(others)} and {last}" if others else last)


def _quoted(title: str) -> Latex:
    """Return a title between quotation marks, for some hold a comma."""
    return Latex(f"``{latex_prose(title)}''")


def _finalized(value: object) -> Latex:
    return value if isinstance(value, Latex) else Latex(latex_prose(value))


#: What a template prints is cleaned and escaped, whatever it is; what is LaTeX already stays.
ENVIRONMENT = Environment(
    loader=PackageLoader("benchmark.report.paper"),
    autoescape=True,
    undefined=StrictUndefined,
    finalize=_finalized,
    block_start_string="<%",
    block_end_string="%>",
    variable_start_string="<<",
    variable_end_string=">>",
    comment_start_string="<#",
    comment_end_string="#>",
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
ENVIRONMENT.filters |= {"join_with_and": _joined, "number": number, "quoted": _quoted}
