"""Tables as LaTeX, Markdown and JSON: pure functions of records, byte for byte."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, groupby
from textwrap import wrap
from typing import Any

from benchmark.errors import ConfigurationError
from benchmark.pipeline.records import Record
from benchmark.protocols.tables import ROBUST, TITLES
from benchmark.reference.paper import MEASURES, entry_of
from benchmark.report.frames import BLANK, changed, fold_of, hundredths, scored_by
from benchmark.report.notes import table_notes
from benchmark.report.tables import BLOCKS, PAPER, SECOND, Row, TableView, ranked_classes
from benchmark.text import clean

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


def duration(seconds: float | None) -> str:
    """Return seconds in two digits."""
    if seconds is None:
        return BLANK
    return (
        hundredths(seconds)
        if seconds < 1
        else f"{seconds:.1f}"
        if seconds < 10
        else f"{seconds:.0f}"
    )


def markdown_text(text: str) -> str:
    """Return text as Markdown shows it literally, in a table, too."""
    return "".join(_MARKDOWN.get(character, character) for character in clean(text))


def latex_text(text: str) -> str:
    """Return text as LaTeX shows it literally; characters that pdflatex lacks become question marks."""
    known = (c if ord(c) < 0x180 else "?" for c in clean(text))
    return "".join(_LATEX.get(character, character) for character in known)


def latex_title(title: str) -> str:
    """Return a title as LaTeX, where lines may also end within parameters."""
    return r"\allowbreak{}".join(map(latex_text, re.split(r"(?<=[\[\]=,_/:])(?=[\w.])", title)))


@dataclass(frozen=True)
class Line:
    """A line of a table: by group, its scores with their marks, and the least and the greatest score over folds.

    A group without scores has a single text.
    """

    title: str
    groups: tuple[Sequence[tuple[str, str]], ...]
    seconds: str = ""
    row: Row | None = None
    folds: tuple[Sequence[tuple[str, str]], ...] = ()


def blocks(view: TableView) -> Iterator[tuple[str, list[Line]]]:
    """Yield the blocks of a table: their headings with their lines; a random order stands last, without a heading."""
    is_as_printed = {column.input for column in view.columns} == {"as printed"}
    for kind, name in BLOCKS.items():
        rows = [row for row in view.printed_rows if row.kind == kind]
        has_surfaces = any(record.input == "mesh" for row in rows for record in row.records)
        views = " (one depth view unless named)" if has_surfaces else " (one depth view)"
        seen = {"network": views, "external": ""}.get(kind, " (complete surfaces)")
        if rows:
            yield name + (seen if is_as_printed else ""), [_line(view, row) for row in rows]
    chance = (
        [(hundredths(score), "") for score in view.chance.get(group, {}).values()]
        for group in view.groups
    )
    yield "", [Line(CHANCE, tuple(scores or [("", "")] for scores in chance))]


def _line(view: TableView, row: Row) -> Line:
    groups: list[Sequence[tuple[str, str]]] = []
    for group in view.groups:
        scores, marks = (
            view.scores(row, group),
            view.marks.get((row.method, group), [""] * len(MEASURES)),
        )
        status = (
            ""
            if group in (PAPER, SECOND)
            else row.failed[group][0].status
            if group in row.failed
            else BLANK
        )
        texts = map(str if group == SECOND else hundredths, scores.values())
        groups.append(list(zip(texts, marks, strict=True)) if scores else [(status, "")])
    folds = (
        [(hundredths(low), hundredths(high)) for low, high in view.of_folds(row, group)]
        for group in view.groups
    )
    return Line(
        clean(row.title), tuple(groups), duration(view.seconds.get(row.method)), row, tuple(folds)
    )


def _joined(group: Iterable[tuple[str, str]], styles: Mapping[str, str]) -> str:
    """Join the scores of a group; neighbours with one mark share its characters."""
    parts = [
        (mark, " ".join(text for text, _ in of))
        for mark, of in groupby(group, key=lambda cell: cell[1])
    ]
    return " ".join(styles.get(mark, "{}").format(text) for mark, text in parts)


def markdown(view: TableView) -> str:
    """Return a table as Markdown of at most 100 columns, with its notes."""
    first, *others = view.groups
    styles, body = {"bold": "**{}**", "italic": "*{}*"}, []
    for heading, lines in blocks(view):
        body += [[f"**{heading}**"]] if heading else []
        for line in lines:
            title = markdown_text(line.title) if heading else f"*{line.title}*"
            body.append([title, *(_joined(group, styles) for group in line.groups), line.seconds])
            if any(line.folds):
                body.append(
                    ["", *(" ".join(map("-".join, of_group)) for of_group in line.folds), ""]
                )
    table = markdown_table(["Method", f"{first}: {' '.join(MEASURES)}", *others, "s"], body)
    caption = f"**Table {markdown_text(view.table.identifier)}.** {markdown_text(view.caption)}."
    notes = [
        line for note in table_notes(view) for line in _wrapped(f"- {markdown_text(note)}", "  ")
    ]
    return "\n".join([*_wrapped(caption), "", *table, "", *notes]) + "\n"


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


def latex(view: TableView) -> str:
    r"""Return a table for ``\input``, which needs booktabs and tabularx: one column of a paper, or ``table*``."""
    n_groups, n_scores = len(view.groups), len(view.groups) * len(MEASURES)
    has_folds = any(
        row for row in view.printed_rows for group in view.groups if view.of_folds(row, group)
    )
    is_wide = n_scores > _ONE_COLUMN or has_folds  # ranges of folds do not fit one column
    environment = "table*" if is_wide else "table"
    rules = "".join(rf"\cmidrule(r){{{4 * k + 2}-{4 * k + 5}}}" for k in range(n_groups))
    styles, body = {"bold": r"\textbf{{{}}}", "italic": r"\textit{{{}}}", "": "{}"}, []
    for heading, lines in blocks(view):
        body.append(r"\midrule")
        if heading:
            body.append(
                rf"\multicolumn{{{n_scores + 2}}}{{@{{}}l}}{{\emph{{{latex_text(heading)}}}}} \\"
            )
        for line in lines:
            cells = [
                [
                    styles[mark].format(score) + ends
                    for (score, mark), ends in zip(group, _ends(folds), strict=False)
                ]
                if len(group) > 1
                else [_spread(group[0][0])]
                for group, folds in zip(line.groups, line.folds or [()] * n_groups, strict=True)
            ]
            key = entry_of(line.row.cite)[0] if line.row else ""
            cited = rf"~\cite{{{key}}}" if key else ""
            body.append(latex_row(latex_title(line.title) + cited, *chain(*cells), line.seconds))
    paper = rf"Paper~\cite{{{_PAPER}}}"
    texts = (r"\\".join(map(latex_text, wrap(group.capitalize(), 17))) for group in view.groups)
    groups = (
        paper if text == "Paper" else rf"\shortstack{{{text}}}" if r"\\" in text else text
        for text in texts
    )
    head = [
        latex_row("", *map(_spread, groups), ""),
        rules,
        latex_row("", *MEASURES * n_groups, "s"),
    ]
    # A wide table spreads over the page, so that no name is far from its scores; a narrow one gives
    # names the rest.
    longest = max(len(row.title) for row in view.printed_rows) + 5  # and a citation
    names = rf">{{\raggedright\hangindent1em\arraybackslash}}p{{{min(0.5 * longest, 17):.1f}em}}"
    wide = rf"@{{\extracolsep{{\fill}}}}{names}" + rf"*{{{len(MEASURES)}}}{{c}}" * n_groups + "r@{}"
    narrow = (
        r"@{}>{\raggedright\hangindent1em}X"
        + rf"*{{{len(MEASURES)}}}{{c}}@{{\hskip6pt}}" * n_groups
        + "r@{}"
    )
    kind, columns = ("tabular*", wide) if is_wide else ("tabularx", narrow)
    style = (
        r"\footnotesize\setlength{\tabcolsep}{2pt}"
        if is_wide
        else r"\scriptsize\setlength{\tabcolsep}{1.7pt}"
    )
    style += r"\renewcommand{\arraystretch}{1.25}" * has_folds
    notes = " ".join(table_notes(view)[:-1])  # the last one is for those who have the suite
    return (
        "\n".join(
            [
                "% needs booktabs and tabularx",
                rf"\begin{{{environment}}}",
                r"\centering",
                rf"\caption{{{latex_text(view.caption)}.}}",
                rf"\label{{tab:{view.stem.removeprefix('table-')}}}",
                style,
                rf"\begin{{{kind}}}{{\linewidth}}{{{columns}}}",
                r"\toprule",
                *head,
                *body,
                r"\bottomrule",
                rf"\end{{{kind}}}",
                rf"\par\smallskip\parbox{{\linewidth}}{{\scriptsize\raggedright {latex_text(notes)}}}",
                rf"\end{{{environment}}}",
            ]
        )
        + "\n"
    )


def bibliography(views: Sequence[TableView]) -> str:
    """Return the BibTeX entries that tables in LaTeX cite; raise ``ConfigurationError`` if two have one key."""
    rows = [row.cite for view in views for row in view.printed_rows]
    entries: dict[str, str] = {}
    for key, entry in map(entry_of, [*[_PAPER] * any(view.paper for view in views), *rows]):
        if entries.setdefault(key, entry) != entry:
            raise ConfigurationError(
                f"two methods cite '{key}' with different entries", "rename a key, and run again"
            )
    return "\n\n".join(filter(None, entries.values())) + "\n"


def _ends(folds: Sequence[tuple[str, str]]) -> list[str]:
    return [rf"$_{{\mathrm{{{low}}}}}^{{\mathrm{{{high}}}}}$" for low, high in folds] or [""] * len(
        MEASURES
    )


def _spread(words: str) -> str:
    return rf"\multicolumn{{{len(MEASURES)}}}{{c}}{{{words}}}"


def latex_row(*cells: str) -> str:
    """Return a row of a table."""
    return " & ".join(cells) + r" \\"


def robustness_markdown(records: Iterable[Record]) -> str:
    """Return the table of robustness: NN of some methods on each changed set; "" without results on any."""
    known = [
        record
        for record in records
        if record.input == "mesh" and record.method in ROBUST and not fold_of(record)
    ]
    scores = defaultdict[tuple[str, str, str], dict[str, float]](dict)
    for record in known:
        scores[changed(record.data.name) or (record.data.name, "", "0")][record.method] = (
            record.scores.get("NN", 0.0)
        )
    titles = {base: base for base, change, _ in sorted(scores) if change}
    titles |= {
        record.data.name: record.data.title for record in known if record.data.name in titles
    }
    places = [place for place in sorted(scores) if place[0] in titles]
    methods = [name for name in ROBUST if any(name in scores[place] for place in places)]
    names = {record.method: TITLES.get(record.method, record.title) for record in known}
    body = [
        [
            change or "unchanged",
            strength,
            *(hundredths(scores[base, change, strength].get(name)) for name in methods),
        ]
        for base, change, strength in places
    ]
    sets = ", ".join(map(markdown_text, titles.values()))
    words = f"**Robustness.** NN of complete surfaces of {sets}; a destroyed shape counts 0. {scored_by(known).note}"
    table = markdown_table(["Change", "strength", *(names[name] for name in methods)], body)
    return "\n".join([words, "", *table]) + "\n" if body else ""


def as_json(views: Iterable[TableView]) -> list[dict[str, Any]]:
    """Return one object for each row and column of each table, with the keys on which other programs rely."""
    return [
        _json(view, row, column.title)
        for view in views
        for row in view.printed_rows
        for column in view.columns
    ]


def _json(view: TableView, row: Row, title: str) -> dict[str, Any]:
    galleries = [ranked_classes(sample) for sample in view.samples.get(title, ())]
    records = row.scored[title].all_records if title in row.scored else []
    status = "ok" if records else row.failed[title][0].status if title in row.failed else "missing"
    scores = dict.fromkeys(MEASURES) | {
        name: round(value, 6) for name, value in view.scores(row, title).items()
    }
    return {
        "table": view.table.identifier,
        "dataset": view.dataset,
        "stand_in": "stand-in" in view.title,
        "column": title,
        "scorer": records[0].scorer if records else "",
        "seed": records[0].seed if records else None,
        "input": records[0].input if records else "",
        "method": row.method,
        "title": row.title,
        **scores,
        "paper": view.paper.get(row.method),
        "chance": view.chance.get(title),
        "status": status,
        "n_shapes": sum(map(len, galleries)),
        "n_classes": sum(len(set(of)) for of in galleries),
        "coverage": min((record.coverage for record in records), default=None),
        "seconds": row.seconds(of_wall=True),
        "processor_seconds": row.seconds(),
    }
