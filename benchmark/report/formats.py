"""Tables as LaTeX, Markdown, text for a terminal, CSV and JSON: pure functions of records, byte for byte."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any

from benchmark.pipeline.records import Record
from benchmark.protocols.tables import Column
from benchmark.reference.paper import MEASURES, bibliography
from benchmark.report.frames import chosen_records, scores_frame
from benchmark.report.robustness import robustness_markdown
from benchmark.report.tables import BLOCKS, PAPER, Row, TableView
from benchmark.report.verdicts import verdicts_markdown
from benchmark.text import clean

if TYPE_CHECKING:
    from pandas.io.formats.style import Styler

FORMATS = ("latex", "markdown", "csv", "json")

BLANK = "--"

CHANCE = "Random order"

#: Key of the paper in the bibliography.
_PAPER = "canonicalreconstruction"

#: Columns of Markdown, at most; a long name may need more.
WIDTH = 100

#: Titles in a terminal are not cut below this many characters.
_SHORTEST = 20

#: Scores that fit one column of a two-column page, and the column of titles, which are broken where they are long.
_ONE_COLUMN = 8
_TITLES = {
    "table": r"@{}>{\raggedright\hangindent1em}p{.29\linewidth}",
    "table*": r"@{}>{\raggedright\hangindent1em}p{.26\linewidth}",
}

_MARKDOWN = {character: f"\\{character}" for character in "\\|*_`[]#$~"} | {"<": "&lt;", ">": "&gt;", "&": "&amp;"}
_LATEX = {"\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
          "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}", '"': "''",
          "|": r"\textbar{}", "`": r"\textasciigrave{}", "[": "{[}"}  # fmt: skip


def hundredths(value: float | None) -> str:
    """Return a score with two decimals and no leading zero; halves, up to the six decimals of records, round up."""
    if value is None or math.isnan(value):
        return BLANK
    text = f"{math.floor(round(value * 1e6) / 1e4 + 0.5) / 100:.2f}"
    return text.removeprefix("0") if value >= 0 else text.replace("-0", "-", 1)


def duration(seconds: float | None) -> str:
    """Return seconds in two digits."""
    if seconds is None:
        return BLANK
    return hundredths(seconds) if seconds < 1 else f"{seconds:.1f}" if seconds < 10 else f"{seconds:.0f}"


def markdown_text(text: str) -> str:
    """Return text as Markdown shows it literally, in a table, too."""
    return "".join(_MARKDOWN.get(character, character) for character in clean(text))


def latex_text(text: str) -> str:
    """Return text as LaTeX shows it literally; characters that pdflatex lacks become question marks."""
    known = (c if ord(c) < 0x180 else "?" for c in clean(text))
    return "".join(_LATEX.get(character, character) for character in known)


def _breakable(character: str) -> str:
    """Return a character of a title as LaTeX; lines may end behind what is no letter."""
    return latex_text(character) + ("" if character.isalnum() or character == " " else r"\allowbreak{}")


def heading(kind: str, columns: Iterable[Column]) -> str:
    """Return the heading of a block, with the input of its rows where that differs between blocks."""
    inputs = {column.input for column in columns}
    if inputs == {"as printed"} and kind in ("form", "descriptor"):
        return f"{BLOCKS[kind]} (complete surfaces)"  # type: ignore[index]
    return f"{BLOCKS[kind]} (one depth view)" if inputs == {"as printed"} and kind == "network" else BLOCKS[kind]  # type: ignore[index]


def _blocks(view: TableView) -> Iterator[tuple[str, list[Row]]]:
    for kind in BLOCKS:
        rows = [row for row in view.printed_rows if row.kind == kind]
        if rows:
            yield heading(kind, view.columns), rows


def _groups(view: TableView) -> list[str]:
    return list(dict.fromkeys(group for group, _ in view.scores.columns))


def _merged(texts: Sequence[str], marks: Sequence[str], styles: dict[str, str]) -> str:
    """Join scores; neighbours with one mark share its characters."""
    parts: list[tuple[str, list[str]]] = []
    for text, mark in zip(texts, marks, strict=True):
        if parts and parts[-1][0] == mark:
            parts[-1][1].append(text)
        else:
            parts.append((mark, [text]))
    return " ".join(styles.get(mark, "{}").format(" ".join(each)) for mark, each in parts)


def _cells(view: TableView, row: Row | None, styles: dict[str, str]) -> list[str]:
    """Return a row's scores by group, then its seconds; chance for None."""
    cells = []
    for group in _groups(view):
        if row is None:
            cells.append(" ".join(hundredths(view.chance.get(group, {}).get(name)) for name in MEASURES))
            continue
        values = [hundredths(view.scores.loc[row.method, (group, name)]) for name in MEASURES]
        is_ours_absent = group != PAPER and group not in row.scored
        if is_ours_absent or set(values) == {BLANK}:
            cells.append("" if group == PAPER else row.failed[0].status if row.failed else BLANK)
        else:
            cells.append(_merged(values, [view.marks.loc[row.method, (group, name)] for name in MEASURES], styles))
    return [*cells, duration(row.seconds) if row else ""]


def markdown(view: TableView) -> str:
    """Return a table as Markdown of at most 100 columns, with its notes."""
    first, *others = _groups(view)
    head = ["Method", f"{first}: {' '.join(MEASURES)}", *others, "s"]
    styles = {"bold": "**{}**", "italic": "*{}*"}
    body = []
    for block, rows in _blocks(view):
        body.append([f"**{block}**"])
        body += [[markdown_text(row.title), *_cells(view, row, styles)] for row in rows]
    body.append([f"*{CHANCE}*", *(cell if cell.strip("- ") else "" for cell in _cells(view, None, {}))])
    caption = f"**Table {markdown_text(view.table.identifier)}.** {markdown_text(view.caption)}."
    lines = [*wrap(caption, WIDTH), "", *markdown_table(head, body), ""]
    return "\n".join([*lines, *_wrapped(map(markdown_text, view.notes), WIDTH)]) + "\n"


def _wrapped(notes: Iterable[str], width: int) -> Iterator[str]:
    for note in notes:
        yield from wrap(f"- {note}", width, subsequent_indent="  ", break_long_words=False)


def markdown_table(head: Sequence[str], body: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table; rows with fewer cells are filled."""
    lines = [[*row, *[""] * (len(head) - len(row))] for row in body]
    return [f"|{'|'.join(cells)}|" for cells in (head, ["---", *["---:"] * (len(head) - 1)], *lines)]


def text(view: TableView, width: int = 80, *, colour: bool = False) -> str:
    """Return a table as text for a terminal; groups that do not fit side by side follow each other.

    Parameters
    ----------
    view
        The table.
    width
        Columns of the terminal.
    colour
        Whether to print bold and italic with codes of the terminal.
    """
    styles = {"bold": "\x1b[1m{}\x1b[0m", "italic": "\x1b[3m{}\x1b[0m"} if colour else {}
    groups, of_group = _groups(view), len(" ".join([".00"] * len(MEASURES)))
    room = width - len(groups) * (of_group + 2) - 7
    titles = (CHANCE, *(row.title for row in view.printed_rows))
    longest = min(max(map(len, titles)), max(room, _SHORTEST))
    at_once = max(1, (width - longest - 7) // (of_group + 2))
    lines = wrap(f"Table {clean(view.table.identifier)}. {clean(view.caption)}", width)
    for start in range(0, len(groups), at_once):
        part = slice(start, start + at_once)
        heads = [f"{group[:of_group]:<{of_group}}" for group in groups[part]]
        names = " ".join(f"{name:>3}" for name in MEASURES)
        indent = " " * longest
        lines += ["", f"{indent}  {'  '.join(heads)}", f"{indent}  {'  '.join([names] * len(heads))}      s"]
        for block, rows in _blocks(view):
            lines += [block, *(_text_line(view, row, part, longest, of_group, styles) for row in rows)]
        lines.append(_text_line(view, None, part, longest, of_group, styles))
    return "\n".join([*lines, "", *_wrapped(map(clean, view.notes), width)]) + "\n"


def _text_line(view: TableView, row: Row | None, part: slice, longest: int, width: int, styles: dict[str, str]) -> str:
    plain, styled = ([cell.replace("1.00", "1.0") for cell in _cells(view, row, each)] for each in ({}, styles))
    title = clean(row.title) if row else CHANCE
    title = title if len(title) <= longest else f"{title[: longest - 1]}…"
    cells = [
        f"{shown}{' ' * (width - len(bare))}"
        for bare, shown in list(zip(plain, styled, strict=True))[:-1][part]
    ]  # fmt: skip
    return f"{title:<{longest}}  {'  '.join(cells)}  {plain[-1]:>5}".rstrip()


def latex(view: TableView) -> str:
    r"""Return a table for ``\input``, which needs array and booktabs: one column of a paper, or ``table*``."""
    n_scores = view.scores.shape[1]
    environment = "table" if n_scores <= _ONE_COLUMN else "table*"
    caption = latex_text(f"{view.caption}.") + (rf" Paper:~\cite{{{_PAPER}}}." if view.paper else "")
    lines = _styler(view).to_latex(
        hrules=True, convert_css=False, multicol_align="c", environment=environment, position_float="centering",
        column_format=f"{_TITLES[environment]}*{{{n_scores + 1}}}{{r}}@{{}}", caption=caption,
        label=f"tab:{view.stem.removeprefix('table-')}",
    ).splitlines()  # fmt: skip
    first = lines.index(r"\midrule") + 1
    body, rest = lines[first : first + len(view.printed_rows)], lines[first + len(view.printed_rows) :]
    blocks = []
    for block, rows in _blocks(view):
        blocks += [rf"\multicolumn{{{n_scores + 2}}}{{@{{}}l}}{{\emph{{{latex_text(block)}}}}} \\", *body[: len(rows)]]
        blocks, body = [*blocks, r"\midrule"], body[len(rows) :]
    chance = [view.chance.get(group, {}).get(name) for group, name in view.scores.columns]
    last = " & ".join([CHANCE, *("" if value is None else hundredths(value) for value in chance), ""])
    lines = [*lines[:first], *blocks, rf"{last} \\", *rest]
    begin = next(place for place, line in enumerate(lines) if line.startswith(r"\begin{tabular}"))
    lines.insert(begin, r"\footnotesize\setlength{\tabcolsep}{1.9pt}")
    below = " ".join(latex_text(note) for note in view.notes)
    lines.insert(-1, rf"\par\smallskip\parbox{{\linewidth}}{{\scriptsize\raggedright {below}}}")
    return "\n".join(["% needs array and booktabs", *lines]) + "\n"


def _styler(view: TableView) -> Styler:
    """Return scores and seconds by title, with marks, as pandas prints them."""
    shown = [row.method for row in view.printed_rows]
    frame, marks = view.scores.loc[shown].copy(), view.marks.loc[shown].copy()
    groups = {group: "Paper" if group == PAPER else latex_text(group.capitalize()) for group in _groups(view)}
    frame["", "s"] = [row.seconds if row.seconds is not None else math.nan for row in view.printed_rows]
    marks["", "s"] = ""
    frame.index = marks.index = [f"{place}" for place in range(len(shown))]  # titles need not be unique
    css = marks.map({"bold": "textbf:--rwrap;", "italic": "textit:--rwrap;", "": ""}.get)
    breakable = ["".join(map(_breakable, clean(row.title))) for row in view.printed_rows]
    titles = {f"{place}": title for place, title in enumerate(breakable)}
    formats: dict[Any, Callable[[float], str]] = dict.fromkeys(frame.columns, hundredths)
    formats |= {column: lambda value: "" if math.isnan(value) else hundredths(value)
                for column in frame.columns if column[0] == PAPER}  # fmt: skip
    formats["", "s"] = lambda value: duration(None if math.isnan(value) else value)
    return (
        frame.style.apply(lambda _: css, axis=None)
        .format(formats)
        .format_index(lambda name: titles[name], axis=0)
        .format_index(lambda name: groups.get(name, name), axis=1, level=0)
    )


def as_json(views: Iterable[TableView]) -> list[dict[str, Any]]:
    """Return one object for each row and column of each table, with the keys on which other programs rely."""
    return [
        _json(view, row, column.title, one.all_records[0].input if one else "")
        for view in views
        for row in view.printed_rows
        for column in view.columns
        for one in [row.scored.get(column.title)]
    ]


def _json(view: TableView, row: Row, title: str, input_: str) -> dict[str, Any]:
    one, galleries = row.scored.get(title), view.galleries.get(title, ())
    status = "ok" if one else row.failed[0].status if row.failed else "missing"
    return {
        "table": view.table.identifier, "dataset": view.dataset, "stand_in": "stand-in" in view.title, "column": title,
        "input": input_, "method": row.method, "title": row.title,
        **({name: round(value, 6) for name, value in one.means.items()} if one else dict.fromkeys(MEASURES)),
        "paper": view.paper.get(row.method), "chance": view.chance.get(title), "status": status,
        "n_shapes": sum(map(len, galleries)), "n_classes": sum(len(set(of)) for of in galleries),
        "coverage": min((record.coverage for record in one.all_records), default=0.0) if one else None,
        "seconds": None if row.seconds is None else round(row.seconds, 4),
    }  # fmt: skip


def scores_csv(records: Iterable[Record]) -> str:
    """Return all scores as CSV, one value a line; see :func:`benchmark.report.frames.scores_frame`."""
    return str(scores_frame(chosen_records(records)).to_csv(index=False, float_format="%.6f"))


def table_files(
    views: Sequence[TableView], records: Sequence[Record], formats: Iterable[str] = (), *, is_whole: bool = True
) -> dict[str, str]:
    """Return tables as text by file name: a LaTeX and a Markdown file each, one CSV and one JSON file for all.

    Parameters
    ----------
    views
        The tables.
    records
        The records that they come from.
    formats
        Names of formats; empty for all.
    is_whole
        Whether to add what the paper's claims come to, and the table of robustness.
    """
    files: dict[str, str] = {}
    for name in formats or FORMATS:
        if name == "latex":
            files |= {f"{view.stem}.tex": latex(view) for view in views} | {"references.bib": bibliography()}
        elif name == "markdown":
            files |= {f"{view.stem}.md": markdown(view) for view in views}
            more = {"reproduction.md": verdicts_markdown(records), "robustness.md": robustness_markdown(records)}
            files |= {name: text for name, text in more.items() if text and is_whole}
        elif name == "csv":
            files["scores.csv"] = scores_csv(records)
        else:
            files["tables.json"] = json.dumps(as_json(views), indent=1) + "\n"
    return files
