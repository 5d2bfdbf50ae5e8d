r"""Tables in LaTeX: captions, rules, and tabulars that fit the text of an article without being scaled.

What is too wide is split between groups of columns, and what is too tall between rows; the parts share one number. A
table is as wide as one column of two where it fits, and else a ``table*``. They need the packages booktabs and
graphicx, the latter where the text is narrower than that of an article; the notes go away with
``\newcommand{\tablenotes}[1]{}`` before the first table.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from benchmark.report.escaping import latex_prose
from benchmark.text import clean

#: Points between two columns of figures.
SEPARATION = 3.0

#: Lines of footnote size of the frame of a tabular, and of the caption of a part that goes on.
_FRAME, _CONTINUED = 4.0, 3.0

#: Rows that are worth a part.
_FEWEST = 4

#: Widths of characters at footnote size: figures are as wide as bold ones.
_WIDTHS = {**dict.fromkeys(" .,:;'|()[]il", 2.9), **dict.fromkeys("0123456789", 4.9), "±": 7.0, "+": 6.7, "-": 3.0}
_CAPITAL, _LETTER, _CITATION = 6.2, 4.3, 15.0


@dataclass(frozen=True)
class Page:
    """Room for a table.

    Parameters
    ----------
    text, column
        Points of the text, and of one of two columns. By default those of an article, less what styles differ by:
        footnotes of 8 points in 345, of 9 in 347, of 10 in 390.
    lines
        Lines of footnote size; by default of the shortest page.
    titles
        Points of the narrowest column of titles.
    """

    text: float = 329.0
    column: float = 220.0
    lines: float = 40.0
    titles: float = 64.0


_ANY_PAGE = Page()


@dataclass(frozen=True)
class Block:
    """Columns that stay together.

    Parameters
    ----------
    title
        What stands over them, as LaTeX; "" for none.
    heads
        Their headings, as LaTeX.
    width
        Points at footnote size, with the space between them.
    """

    title: str
    heads: tuple[str, ...]
    width: float


@dataclass(frozen=True)
class Line:
    """A row.

    Parameters
    ----------
    title
        As LaTeX.
    width
        Points that the title takes on one line.
    cells
        What stands in each block, as LaTeX; one cell may span several columns.
    has_rule
        Whether a rule stands above it.
    """

    title: str
    width: float
    cells: tuple[tuple[str, ...], ...]
    has_rule: bool = False


@dataclass
class _Float:
    """Content of one float so far: parts as LaTeX, and lines that they take."""

    used: float
    parts: list[str] = field(default_factory=list)
    width: float = 0.0


def points(text: str, *, cited: bool = False) -> float:
    """Estimate the width of a text at footnote size, with a number in brackets behind it where it is cited."""
    known = (_WIDTHS.get(c, _CAPITAL if c.isupper() else _LETTER) for c in text)
    return sum(known) + (_CITATION if cited else 0.0)


def head(name: str, remark: str = "") -> str:
    """Write the first lines of a file, with further words about it."""
    return (
        f"% {name}{f', {remark}' if remark else ''}; needs booktabs and graphicx\n"
        "\\providecommand{\\tablenotes}[1]{\\par\\smallskip{\\footnotesize\\raggedright #1\\par}}\n"
    )


def table_floats(
    name: str,
    caption: str,
    blocks: Sequence[Block],
    lines: Sequence[Line],
    *,
    notes: Sequence[str] = (),
    page: Page = _ANY_PAGE,
) -> str:
    """Write a table below its :func:`head`: one float or several, nothing in them below footnote size.

    Parameters
    ----------
    name
        Stem of the file, which the label has, too.
    caption
        As LaTeX.
    blocks, lines
        Columns and rows.
    notes
        Sentences under the table, as text.
    page
        Room for it.
    """
    floats = [_Float(2 + 1.3 * math.ceil(1.25 * points(caption) / page.text))]
    for shown in _by_width(blocks, page.text - page.titles):
        _add_rows(floats, [blocks[k] for k in shown], lines, shown, page)
    said: list[str] = []
    for note in notes:
        said.append(clean(note if note.endswith(".") else f"{note}."))
        if floats[-1].used + 1 + points(" ".join(said)) / page.text > page.lines:
            if len(said) > 1:
                floats[-1].parts.append(_table_notes(said[:-1]))
            floats.append(_Float(_CONTINUED))
            said = said[-1:]
    if said:
        floats[-1].parts.append(_table_notes(said))
    written: list[str] = []
    environment = "table" if max(made.width for made in floats) <= page.column else "table*"
    for number, made in enumerate(floats):
        written += _framed(made, environment, name, caption, number)
    return "\n".join(written) + "\n"


def _table_notes(said: Sequence[str]) -> str:
    """Sentences below a tabular."""
    return rf"\tablenotes{{{' '.join(map(latex_prose, said))}}}"


def _framed(made: _Float, environment: str, name: str, caption: str, number: int) -> Iterator[str]:
    """Lines of a float; of several, the first has the caption and the label."""
    yield rf"\begin{{{environment}}}"
    yield r"\centering"
    yield r"\addtocounter{table}{-1}\caption{(continued)}" if number else rf"\caption{{{caption}}}"
    if not number:
        yield rf"\label{{tab:{name}}}"
    yield r"\smallskip\footnotesize\setlength{\tabcolsep}{1.5pt}"
    yield "\n\\par\\medskip\n".join(made.parts)
    yield rf"\end{{{environment}}}"


def _by_width(blocks: Sequence[Block], room: float) -> list[list[int]]:
    """Numbers of the blocks that stand side by side, as many as there is room for."""
    found: list[list[int]] = [[]]
    for number, block in enumerate(blocks):
        if found[-1] and sum(blocks[k].width for k in found[-1]) + block.width > room:
            found.append([])
        found[-1].append(number)
    return found


def _add_rows(
    floats: list[_Float], blocks: Sequence[Block], lines: Sequence[Line], shown: Sequence[int], page: Page
) -> None:
    """Add a tabular of these blocks to the floats, and new floats where a page has no room for all rows."""
    natural = max(line.width for line in lines)
    titles = min(natural, page.text - sum(block.width for block in blocks))
    heights = [math.ceil(line.width / titles) + 0.6 * line.has_rule for line in lines]
    start = 0
    while start < len(lines):
        room, rest = page.lines - floats[-1].used - _FRAME, sum(heights[start:])
        fits = next((k for k in range(start, len(lines)) if sum(heights[start : k + 1]) > room), len(lines))
        is_new = not floats[-1].parts
        if not is_new and fits < len(lines) and (fits - start < _FEWEST or rest <= page.lines - _CONTINUED - _FRAME):
            floats.append(_Float(_CONTINUED))
            continue
        end = max(fits, start + 1)
        if 0 < len(lines) - end < _FEWEST:
            end = max(start + 1, len(lines) - _FEWEST)
        made = floats[-1]
        made.parts.append(_tabular(blocks, lines[start:end], shown, titles if titles < natural else None))
        made.used += _FRAME + sum(heights[start:end])
        made.width = max(made.width, titles + sum(block.width for block in blocks))
        start = end
        if start < len(lines):
            floats.append(_Float(_CONTINUED))


def _tabular(blocks: Sequence[Block], lines: Sequence[Line], shown: Sequence[int], titles: float | None) -> str:
    """Write a tabular; titles are broken where their column has a width."""
    n_columns = sum(len(block.heads) for block in blocks)
    column = "l" if titles is None else f"p{{{titles:.0f}pt}}"
    rows = []
    if any(block.title for block in blocks):
        rows += _titles_of(blocks)
    rows += [" & ".join(["Method", *(head for block in blocks for head in block.heads)]) + r" \\", r"\midrule"]
    for number, line in enumerate(lines):
        rows += [r"\midrule"] if line.has_rule and number else []
        title = line.title if titles is None else _broken(line.title)
        rows.append(" & ".join([title, *(cell for k in shown for cell in line.cells[k])]) + r" \\")
    return "\n".join(
        [
            rf"\sbox0{{\begin{{tabular}}{{@{{}}{column}{'r' * n_columns}@{{}}}}",
            r"\toprule",
            *rows,
            r"\bottomrule",
            r"\end{tabular}}",
            r"\ifdim\wd0>\linewidth\resizebox{\linewidth}{!}{\usebox0}\else\usebox0\fi",
        ]
    )


def _broken(title: str) -> str:
    """Let a title go on in the next line, also behind an equals sign and before its source."""
    return rf"\raggedright\hangindent1em {title}".replace("=", r"=\allowbreak{}").replace(r"~\cite", r" \cite")


def _titles_of(blocks: Sequence[Block]) -> list[str]:
    spans, rules, column = [], [], 2
    for block in blocks:
        spans.append(rf"\multicolumn{{{len(block.heads)}}}{{c}}{{{block.title}}}")
        rules.append(rf"\cmidrule(lr){{{column}-{column + len(block.heads) - 1}}}")
        column += len(block.heads)
    return [" & ".join(["", *spans]) + r" \\", " ".join(rules)]
