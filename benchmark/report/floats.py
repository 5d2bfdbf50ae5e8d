r"""The frame of a table in LaTeX: caption, label, rules, and a width that never passes that of the text.

It needs the packages booktabs and graphicx; the notes go away with ``\newcommand{\tablenotes}[1]{}`` before the first
table.
"""

from __future__ import annotations

from collections.abc import Sequence

from benchmark.report.escaping import latex_text

#: Lines of a table and its notes that a page has room for, and characters of a line of notes in one column, across two.
_PAGE, _LINES = 56, (55, 100)


def table_float(
    name: str,
    caption: str,
    columns: str,
    lines: Sequence[str],
    *,
    remark: str = "",
    notes: Sequence[str] = (),
    spans_columns: bool = False,
) -> str:
    r"""A table for ``\input``; where the text is narrower it is scaled down, never up.

    Parameters
    ----------
    name
        Stem of the file, which the label has, too.
    caption
        As text, not yet escaped.
    columns
        Of the tabular, as LaTeX.
    lines
        What stands between the outer rules, as LaTeX.
    remark
        Further words of the first line, a comment.
    notes
        Sentences under the table, as text.
    spans_columns
        Whether it spans both columns of a paper.
    """
    environment = "table*" if spans_columns else "table"
    said = " ".join(latex_text(_sentence(note)) for note in notes)
    # Of two sizes that a paper's tables have the one that fits its page: LaTeX lets what is too tall run off it.
    is_tall = len(lines) + len(said) / _LINES[spans_columns] > _PAGE
    size = r"\scriptsize" if is_tall else r"\footnotesize"
    found = [
        f"% {name}{f', {remark}' if remark else ''}; needs booktabs and graphicx",
        r"\providecommand{\tablenotes}[1]{\par\smallskip{\footnotesize\raggedright #1\par}}",
        rf"\begin{{{environment}}}",
        r"\centering",
        rf"\caption{{{latex_text(caption)}}}",
        rf"\label{{tab:{name}}}",
        rf"\smallskip{size}\setlength{{\tabcolsep}}{{3pt}}",
        rf"\sbox0{{\begin{{tabular}}{{@{{}}{columns}@{{}}}}",
        r"\toprule",
        *lines,
        r"\bottomrule",
        r"\end{tabular}}",
        r"\ifdim\wd0>\linewidth\resizebox{\linewidth}{!}{\usebox0}\else\usebox0\fi",
    ]
    if said:
        found.append(rf"\tablenotes{{{f'{size} ' if is_tall else ''}{said}}}")
    return "\n".join([*found, rf"\end{{{environment}}}"]) + "\n"


def _sentence(note: str) -> str:
    return note if note.endswith(".") else f"{note}."
