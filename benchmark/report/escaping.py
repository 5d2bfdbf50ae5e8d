"""Text as each format takes it for text: names, titles and reasons may hold anything and stay what they are.

And the rows that such texts are put into.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from decimal import ROUND_HALF_UP, Decimal
from html import escape

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from benchmark.text import clean

#: Stands where there is no figure.
BLANK = "--"


def millionths(value: float) -> float:
    """Return a figure without what differs between processors, for a comparison that decides something in print."""
    return round(float(value), 6) + 0.0


def number(value: float | None, decimals: int = 2) -> str:
    """Return a figure with so many decimals: rounded to 1e-6, then half up."""
    if value is None:
        return BLANK
    rounded = Decimal(repr(millionths(value))).quantize(Decimal(1).scaleb(-decimals), ROUND_HALF_UP)
    return str(rounded + 0)  # nothing is negative that reads as zero


#: Marks of Markdown that mean something anywhere; an underscore means nothing within a word, an ampersand only before a
#: name or a number.
_MARKS = re.compile(r"[\\*\[\]<|~$]|(?<![^\W_])_|_(?![^\W_])|&(?=[#\w])|`")

#: What begins a list, a quotation or a heading where it begins a line.
_AT_START = re.compile(r"\d{1,9}(?=[.)])|(?=[#>+=-])")

_LONG_WORD = re.compile(r"(\S{31,})")

_LATEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "<": r"\textless{}",
    ">": r"\textgreater{}", "|": r"\textbar{}", "†": r"\dag{}", "‡": r"\ddag{}", "±": r"$\pm$", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
} | {digit: rf"\textsuperscript{{{number}}}" for number, digit in enumerate("⁰¹²³⁴⁵⁶⁷⁸⁹")}  # fmt: skip


def markdown_text(text: object) -> str:
    """A name in Markdown, in a table or a line."""
    return _MARKS.sub(r"\\\g<0>", clean(text))


def markdown_line(text: object) -> str:
    """A sentence in Markdown that begins a line; commands between single backticks stay code."""
    line = clean(text).strip()
    if "``" in line or line.count("`") % 2:
        marked = markdown_text(line)
    else:
        parts = line.split("`")
        marked = "`".join(part if number % 2 else markdown_text(part) for number, part in enumerate(parts))
    begins = _AT_START.match(marked)
    return marked if begins is None else f"{begins[0]}\\{marked[begins.end() :]}"


def latex_text(text: object) -> str:
    r"""Text in LaTeX; what stands after a line break must not look like an argument of ``\\``."""
    escaped = "".join(_LATEX.get(character, character) for character in clean(text))
    escaped = re.sub("-(?=-)", "-{}", escaped)  # two hyphens are an option of a command, no dash
    return f"{{}}{escaped}" if escaped.lstrip().startswith(("[", "*")) else escaped


def latex_prose(text: object) -> str:
    r"""Text in LaTeX that may be broken within words of more than thirty characters, as paths are."""
    parts = _LONG_WORD.split(clean(text))
    return "".join(
        r"\allowbreak{}".join(map(latex_text, re.findall(".{1,12}", part))) if place % 2 else latex_text(part)
        for place, part in enumerate(parts)
    )


def html_text(text: object) -> Markup:
    """Text in HTML, also between quotes; what is markup already stays."""
    return text if isinstance(text, Markup) else Markup(escape(clean(text), quote=True))


def html_line(text: object) -> Markup:
    """A sentence in HTML; commands between single backticks are code."""
    parts = html_text(text).split("`")
    if len(parts) % 2 == 0:
        return Markup("`").join(parts)
    code = Markup("<code>{}</code>")
    return Markup("").join(code.format(part) if number % 2 else part for number, part in enumerate(parts))


def csv_cell(value: object) -> object:
    """A cell that no spreadsheet takes for a formula; numbers stay numbers."""
    if not isinstance(value, str):
        return value
    text = clean(value)
    return f"'{text}" if text.lstrip().startswith(("=", "+", "-", "@")) else text


def csv_text(names: Sequence[str], rows: Iterable[Mapping[str, object]]) -> str:
    """A CSV file with a heading; what a row has beyond these names is left out, and what it lacks is empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: csv_cell(row[name]) for name in names if name in row})
    return text.getvalue()


def markdown_table(
    head: Sequence[str], rows: Iterable[Sequence[str]], n_left: int = 1, *, aligned: bool = False
) -> Markup:
    """A Markdown table of cells that are Markdown already.

    Parameters
    ----------
    head, rows
        Headings and rows.
    n_left
        Columns to the left; all others are numbers, to the right.
    aligned
        Whether the cells of a column have one width, for a terminal.
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
    """Render a template of Markdown: what it prints is escaped as text, but for tables and lines."""
    return _DOCUMENTS.get_template(f"{template}.md").render(content)


_DOCUMENTS = Environment(
    loader=PackageLoader("benchmark.report"),
    autoescape=True,
    undefined=StrictUndefined,
    finalize=lambda value: value if isinstance(value, Markup) else Markup(markdown_text(value)),  # noqa: S704
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_DOCUMENTS.filters |= {"line": lambda text: Markup(markdown_line(text)), "number": number}  # noqa: S704
