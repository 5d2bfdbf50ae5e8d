"""Escape text for each format, since names, titles and reasons may contain anything, and format rows of text."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from decimal import ROUND_HALF_UP, Decimal
from html import escape
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from benchmark.text import clean

#: Placeholder for a missing value.
BLANK = "--"


def millionths(value: float) -> float:
    """Return a value without digits that vary between processors, for comparisons that affect the output."""
    return round(float(value), 6) + 0.0


def number(value: float | None, decimals: int = 2) -> str:
    """Format a value with a number of decimals: round it to 1e-6, then half up; NaN is missing."""
    if value is None or math.isnan(value):
        return BLANK
    rounded = Decimal(repr(millionths(value))).quantize(Decimal(1).scaleb(-decimals), ROUND_HALF_UP)
    return str(rounded + 0)  # no minus sign before zero


#: Characters with a meaning in Markdown; an underscore has none inside a word, an ampersand only before a name or a
#: number.
_MARKS = re.compile(r"[\\*\[\]<|~$]|(?<![^\W_])_|_(?![^\W_])|&(?=[#\w])|`")

#: Start of a list item, a quotation or a heading, at the start of a line.
_AT_START = re.compile(r"\d{1,9}(?=[.)])|(?=[#>+=-])")

_LONG_WORD = re.compile(r"(\S{31,})")

_LATEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "<": r"\textless{}",
    ">": r"\textgreater{}", "|": r"\textbar{}", "†": r"\dag{}", "‡": r"\ddag{}", "±": r"$\pm$", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
} | {digit: rf"\textsuperscript{{{number}}}" for number, digit in enumerate("⁰¹²³⁴⁵⁶⁷⁸⁹")}  # fmt: skip


def markdown_text(text: object) -> str:
    """Escape a name for Markdown, in a table or a line."""
    return _MARKS.sub(r"\\\g<0>", clean(text))


def markdown_line(text: object) -> str:
    """Escape a sentence for Markdown at the start of a line; commands in single backticks stay code."""
    line = clean(text).strip()
    if "``" in line or line.count("`") % 2:
        marked = markdown_text(line)
    else:
        parts = line.split("`")
        marked = "`".join(part if number % 2 else markdown_text(part) for number, part in enumerate(parts))
    begins = _AT_START.match(marked)
    return marked if begins is None else f"{begins[0]}\\{marked[begins.end() :]}"


def latex_text(text: object) -> str:
    r"""Escape text for LaTeX; text after a line break must not look like an argument of ``\\``."""
    escaped = "".join(_LATEX.get(character, character) for character in clean(text))
    escaped = re.sub("-(?=-)", "-{}", escaped)  # two hyphens begin a command-line option, not a dash
    return f"{{}}{escaped}" if escaped.lstrip().startswith(("[", "*")) else escaped


def latex_prose(text: object) -> str:
    r"""Escape text for LaTeX and allow breaks inside words of more than thirty characters, such as paths."""
    parts = _LONG_WORD.split(clean(text))
    return "".join(
        r"\allowbreak{}".join(map(latex_text, re.findall(".{1,12}", part))) if place % 2 else latex_text(part)
        for place, part in enumerate(parts)
    )


def html_text(text: object) -> Markup:
    """Escape text for HTML, also inside quotes; markup stays unchanged."""
    return text if isinstance(text, Markup) else Markup(escape(clean(text), quote=True))


def html_line(text: object) -> Markup:
    """Escape a sentence for HTML; commands in single backticks become code."""
    parts = html_text(text).split("`")
    if len(parts) % 2 == 0:
        return Markup("`").join(parts)
    code = Markup("<code>{}</code>")
    return Markup("").join(code.format(part) if number % 2 else part for number, part in enumerate(parts))


def csv_cell(value: object) -> object:
    """Escape a cell that spreadsheets would read as a formula; numbers stay numbers."""
    if not isinstance(value, str):
        return value
    text = clean(value)
    return f"'{text}" if text.lstrip().startswith(("=", "+", "-", "@")) else text


def csv_text(names: Sequence[str], rows: Iterable[Mapping[str, object]]) -> str:
    """Return a CSV file with a heading; additional entries of rows are omitted, and missing ones are empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: csv_cell(row[name]) for name in names if name in row})
    return text.getvalue()


def markdown_table(
    head: Sequence[str], rows: Iterable[Sequence[str]], n_left: int = 1, *, aligned: bool = False
) -> Markup:
    """Return a Markdown table of cells that are already Markdown.

    Parameters
    ----------
    head, rows
        Headings and rows.
    n_left
        Number of left-aligned columns; the others are numbers, aligned to the right.
    aligned
        Whether to pad cells to the width of their column, for a terminal.
    """
    lines = [head, *rows]
    widths = [max(len(line[k]) for line in lines) if aligned else 0 for k in range(len(head))]
    rule = ["-" * (width or 3) if k < n_left else "-" * ((width or 4) - 1) + ":" for k, width in enumerate(widths)]
    signs = ["<" if k < n_left else ">" for k in range(len(head))]
    padded = (
        [f"{cell:{sign}{width}}" for cell, sign, width in zip(line, signs, widths, strict=True)]
        for line in [head, rule, *lines[1:]]
    )
    return Markup("\n".join(f"| {' | '.join(cells)} |" for cells in padded))  # noqa: S704


def markdown_document(template: str, **content: object) -> str:
    """Render a Markdown template; all values are escaped as text, except tables and lines."""
    return _DOCUMENTS.get_template(f"{template}.md").render(content)


def environment(package: str, finalize: Callable[[object], str], **marks: Any) -> Environment:
    """Return an environment for the templates of a package that escapes all values; without blanks around blocks.

    Parameters
    ----------
    package
        The package.
    finalize
        Escapes a value, unless it is markup.
    **marks
        Marks of blocks, variables and comments, instead of the usual ones.
    """
    return Environment(
        loader=PackageLoader(package), autoescape=True, undefined=StrictUndefined, finalize=finalize,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True, **marks,
    )  # fmt: skip


_DOCUMENTS = environment(
    "benchmark.report",
    lambda value: value if isinstance(value, Markup) else Markup(markdown_text(value)),  # noqa: S704
)
_DOCUMENTS.filters |= {"line": lambda text: Markup(markdown_line(text)), "number": number}  # noqa: S704
