"""The pages of the report; everything that comes from data is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from benchmark.report.content import TableContent
from benchmark.report.escaping import html_line, html_text
from benchmark.report.grid import number
from benchmark.report.html.scripts import script_json
from benchmark.report.html.table import plain_table, score_table
from benchmark.report.notes import notes
from retrieval.measures import MEASURES, PRINTED

TITLE = "Canonical forms benchmark"


@dataclass(frozen=True)
class TablePages:
    """Parts of the pages of one table.

    Parameters
    ----------
    table
        The table.
    has_forms
        Whether there is a page of canonical forms.
    n_ranked, n_distances
        Jobs with scores, and those of them whose distances are kept.
    run
        The command that makes what is not kept.
    costs
        Rows of the table of costs: method, input, seconds by phase, their sum, peak memory.
    phases
        Names of the phases.
    """

    table: TableContent
    has_forms: bool
    n_ranked: int
    n_distances: int
    run: str
    costs: Sequence[Sequence[object]] = ()
    phases: Sequence[str] = ()

    @property
    def stem(self) -> str:
        """Name of the pages."""
        return self.table.file_stem

    @property
    def short(self) -> str:
        """Name of the table in the navigation."""
        identifier, name = self.table.identifier, str(self.table.data["name"])
        return identifier if identifier == name else f"{identifier} · {name}"

    @property
    def heading(self) -> str:
        """Name of the table."""
        identifier = self.table.identifier
        own = identifier == str(self.table.data["name"])
        return self.table.caption if own else f"Table {identifier}. {self.table.caption}"


@dataclass(frozen=True)
class Overview:
    """Content of the first page, about all tables together.

    Parameters
    ----------
    failures
        Table, method, input, status and reason of each job without scores.
    left_out
        Table, method, input, number of shapes left out, and why.
    environments
        Where stages were computed, and how many.
    data
        Data set, what it stands in for, shapes, classes.
    commands
        Commands that make the report again.
    facts
        Further facts: name and value.
    """

    failures: Sequence[Sequence[object]] = ()
    left_out: Sequence[Sequence[object]] = ()
    environments: Sequence[Sequence[object]] = ()
    data: Sequence[Sequence[object]] = ()
    commands: Sequence[str] = ()
    facts: Mapping[str, str] = field(default_factory=dict)


def index_page(tables: Sequence[TablePages], overview: Overview, hero: Mapping[str, str]) -> str:
    """The first page: the tables, what failed, and how all of it was made.

    Parameters
    ----------
    tables
        The tables.
    overview
        What is told of all of them.
    hero
        Path of a strip of forms, by the stem of the table that it belongs to.
    """
    cards = []
    for pages in tables:
        strip = f"<img src='{html_text(hero[pages.stem])}' alt='' loading='lazy'>" if pages.stem in hero else ""
        cards.append(
            f"<article class='card'><h3><a href='{pages.stem}.html'>{html_text(pages.heading)}</a></h3>{strip}"
            f"<p>{html_text(pages.table.data_title)}<br><span class='faint'>{html_text(pages.table.size)}</span></p>"
            f"{_best(pages.table)}<p class='links'>{_links(pages)}</p></article>"
        )
    printed = [measure for measure in MEASURES if measure.name in PRINTED]
    measures = "".join(f"<dt>{m.name}</dt><dd>{html_text(m.title)}: {html_text(m.formula)}</dd>" for m in printed)
    parts = [
        "<p class='lead'>Each method turns a shape into its <em>canonical form</em>, in which the pose is gone; one "
        "scorer compares the forms, and every shape of a gallery is a query. Of a form that keeps the body and loses "
        "the pose, the nearest matches are the same body in other poses.</p>",
        f"<section class='cards'>{''.join(cards)}</section>",
        _section("failures", "Failures", _failures(overview)),
        _section(
            "data", "Data", _framed(plain_table(("Data set", "What it is", "Shapes", "Classes"), overview.data, 2))
        ),
        _section("made", "How this was made", _made(overview)),
        _section(
            "measures",
            "Measures",
            "<p>For a query of a class with c others; g<sub>i</sub> is 1 if the match at rank i is of that class. All "
            f"lie between 0 and 1, and 1 is best.</p><dl>{measures}</dl>",
        ),
    ]
    return page(TITLE, tables, "".join(parts))


def table_page(pages: TablePages, tables: Sequence[TablePages]) -> str:
    """Scores of one table, and the charts that go with them."""
    table = pages.table
    lines = notes(table)
    told = f"<ul>{''.join(f'<li>{html_line(line)}</li>' for line in lines)}</ul>" if lines else ""
    missing = (
        f"<p class='missing'>{pages.n_distances} of {pages.n_ranked} jobs have their distances here; "
        f"<code>{html_text(pages.run)}</code> makes the others, then write this report again.</p>"
        if pages.n_distances < pages.n_ranked
        else ""
    )
    same = "<p class='faint'>See <a href='#precision'>above</a> for what is missing here.</p>" if missing else ""
    families = list(dict.fromkeys(row.family for row in table.rows))
    boxes = "".join(
        f"<label><input type='checkbox' data-family='{html_text(name)}' checked> {html_text(name)}</label>"
        for name in families
    )
    head = ["Method", "Input", *(f"{name}, s" for name in pages.phases), "All, s", "Peak, MiB"]
    parts = [
        _subnavigation(pages, "scores"),
        f"<p class='lead'>{html_text(table.data_title)} ({html_text(table.size)})</p>",
        _section(
            "scores",
            "Scores",
            "<div class='controls'><label>Filter <input type='search' class='filter' placeholder='name of a method'>"
            f"</label><fieldset><legend>Rows</legend>{boxes}</fieldset></div>"
            f"{_framed(score_table(table), filtered=True)}<div class='notes'>{told}</div>",
        ),
        _section(
            "cost",
            "Accuracy against cost",
            "<p>Seconds a shape, all phases together, on a logarithmic axis. On the line: no other method is both "
            "cheaper and better; controls and descriptors have a line of their own. Vertical: 95 % over classes.</p>"
            + _chart("cost", ("input", "measure"))
            + f"<details><summary>Seconds by phase, and memory</summary>{_framed(plain_table(head, pages.costs, 2))}"
            "</details>",
        ),
        _section(
            "precision",
            "Precision over recall",
            "<p>Interpolated precision, the mean over all queries.</p>" + missing + _chart("precision", ("input",)),
        ),
        _section(
            "classes",
            "Class by class",
            "<p>Mean over the queries of each class.</p>" + _chart("classes", ("input", "measure")),
        ),
        _section(
            "attraction",
            "The subject or the pose?",
            "<p>What the nearest match shares with its query. A canonical form should bring the subject; what brings "
            "the pose has kept it.</p>" + same + _chart("attraction", ("input",)),
        ),
        _section(
            "confusion",
            "Confusion",
            "<p>Rows are queries, columns their nearest matches.</p>"
            + same
            + _chart("confusion", ("input", "method", "kind")),
        ),
    ]
    return page(pages.heading, tables, "".join(parts), pages.stem, scripts=("charts",), data={"table": pages.stem})


def forms_page(pages: TablePages, tables: Sequence[TablePages], gallery: Mapping[str, Any] | None) -> str:
    """The canonical forms of some shapes, and a viewer of each."""
    if gallery is None:
        body = (
            "<p class='missing'>No canonical form of this table is kept here. "
            f"<code>{html_text(pages.run)}</code> makes them, then write this report again.</p>"
        )
    else:
        body = (
            "<p>What each method makes of the same shapes, one scale for all poses. Colours go from "
            "the middle of the body to its tips, measured along the surface, so a part keeps its colour. "
            "Choose a form to turn it.</p>"
            "<div class='controls'><label>Input <select id='forms-input'></select></label>"
            "<label>Subject <select id='forms-subject'></select></label></div>"
            "<div id='forms'></div>" + _VIEWER
        )
    parts = [_subnavigation(pages, "forms"), f"<section>{body}</section>"]
    data = {"gallery": gallery} if gallery is not None else {}
    return page(f"Canonical forms, {pages.heading}", tables, "".join(parts), pages.stem, scripts=("forms",), data=data)


def queries_page(pages: TablePages, tables: Sequence[TablePages], sheets: str) -> str:
    """The browser of queries."""
    if not pages.n_ranked:
        body = "<p class='missing'>No job of this table has scores.</p>"
    else:
        missing = (
            f"<p class='missing'>{pages.n_distances} of {pages.n_ranked} jobs have their distances here; of the others "
            f"the scores are shown. <code>{html_text(pages.run)}</code> makes what is missing, then write this report "
            "again.</p>"
            if pages.n_distances < pages.n_ranked
            else ""
        )
        body = (
            missing + "<div class='controls'><label>Gallery <select id='query-gallery'></select></label>"
            "<label>Shape <input id='query-name' list='query-names' type='search' autocomplete='off'></label>"
            "<datalist id='query-names'></datalist>"
            "<span id='query-none' class='nothing' role='status'></span>"
            "<span><button type='button' id='query-before' title='Shape before, key P'>← before</button> "
            "<button type='button' id='query-next' title='Next shape, key N'>next →</button></span></div>"
            "<div id='query'></div><div id='matches'></div>"
            "<p class='faint'>✓ the same subject, ✗ another one. Of equal distances the first is shown; the scores "
            "count every order of them alike. The nearest shapes are those of the mean distance over all codebooks.</p>"
        )
    parts = [_subnavigation(pages, "queries"), f"<section>{body}</section>"]
    data = {"queries": pages.stem, "sheets": sheets}
    return page(f"Queries, {pages.heading}", tables, "".join(parts), pages.stem, scripts=("queries",), data=data)


def page(
    title: str,
    tables: Sequence[TablePages],
    body: str,
    current: str = "",
    scripts: Iterable[str] = (),
    data: Mapping[str, Any] | None = None,
) -> str:
    """A whole page: head, navigation, and a body that is HTML already."""
    links = [("index.html", "Overview", not current)]
    links += [(f"{pages.stem}.html", pages.short, pages.stem == current) for pages in tables]
    navigation = "".join(
        f"<a href='{address}'{' aria-current=' + chr(39) + 'true' + chr(39) if here else ''}>{html_text(name)}</a>"
        for address, name, here in links
    )
    loaded = "".join(f"<script src='parts/assets/{name}.js' defer></script>" for name in ("report", *scripts))
    value = f"<script type='application/json' id='page-data'>{script_json(data)}</script>" if data else ""
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        "<meta name='color-scheme' content='light dark'><link rel='icon' href='data:,'>"
        f"<title>{html_text(title)}</title><link rel='stylesheet' href='parts/assets/report.css'>{loaded}</head>"
        "<body><a class='skip' href='#main'>To the content</a>"
        f"<header><strong>{TITLE}</strong><nav aria-label='Tables'>{navigation}</nav>"
        "<button type='button' id='theme' title='Light or dark'>◐</button></header>"
        f"<main id='main'><h1>{html_text(title)}</h1>{body}</main>{value}</body></html>\n"
    )


_VIEWER = (
    "<dialog id='viewer' aria-labelledby='viewer-title'><div class='viewer-head'><h2 id='viewer-title'></h2>"
    "<button type='button' id='viewer-close' title='Close, key Escape'>✕</button></div>"
    "<div class='controls'><label>Shape <select id='viewer-shape'></select></label>"
    "<label>Method <select id='viewer-method'></select></label>"
    "<span class='turn'><button type='button' data-turn='left' title='Turn left'>⟲</button>"
    "<button type='button' data-turn='right' title='Turn right'>⟳</button>"
    "<button type='button' data-turn='in' title='Nearer'>+</button>"
    "<button type='button' data-turn='out' title='Farther'>−</button></span></div>"
    "<div id='scene'></div><p class='faint'>Shape and form are turned together. Drag to turn, scroll to zoom; or arrow "
    "keys, + and −; N and P for the next and the previous method.</p></dialog>"
)


def _subnavigation(pages: TablePages, current: str) -> str:
    links = (
        (f"{pages.stem}.html", "scores"),
        (f"{pages.stem}-forms.html", "forms"),
        (f"{pages.stem}-queries.html", "queries"),
    )
    told = "".join(
        f"<a href='{address}'{' aria-current=' + chr(39) + 'page' + chr(39) if name == current else ''}>"
        f"{name.capitalize()}</a>"
        for address, name in links
    )
    return f"<nav class='tabs' aria-label='Pages of this table'>{told}</nav>"


def _links(pages: TablePages) -> str:
    links = [(f"{pages.stem}.html", "Scores")]
    links += [(f"{pages.stem}-forms.html", "Forms")] if pages.has_forms else []
    links += [(f"{pages.stem}-queries.html", "Queries")] if pages.n_ranked else []
    return " ".join(f"<a href='{address}'>{name}</a>" for address, name in links)


def _best(table: TableContent) -> str:
    """The method with the highest DCG under each input, controls aside."""
    lines = []
    for input_ in table.inputs:
        contest = [
            (scores["DCG"], row.label)
            for row in table.rows
            if row.family != "control" and (cell := row.cells.get(input_)) and (scores := cell.scores)
        ]
        if contest:
            score, label = max(contest, key=lambda each: each[0])
            lines.append(f"<dt>{html_text(input_)}</dt><dd>{html_text(label)} <b>{number(score)}</b></dd>")
    chance = number(table.chance["DCG"])
    if not lines:
        return "<p class='faint'>No job has scores; <a href='#failures'>why</a>.</p>"
    return f"<dl class='best'><dt>best DCG</dt><dd class='faint'>chance {chance}</dd>{''.join(lines)}</dl>"


def _failures(overview: Overview) -> str:
    parts = []
    if overview.failures:
        parts.append(_framed(plain_table(("Table", "Method", "Input", "Status", "Reason"), overview.failures, 5)))
    else:
        parts.append("<p>Every recorded job has its scores.</p>")
    if overview.left_out:
        head = ("Table", "Method", "Input", "Shape", "Why it was left out")
        parts.append(f"<h3>Shapes left out</h3>{_framed(plain_table(head, overview.left_out, 5))}")
    return "".join(parts)


def _made(overview: Overview) -> str:
    commands = "\n".join(html_text(command) for command in overview.commands)
    facts = "".join(f"<dt>{html_text(name)}</dt><dd>{html_text(value)}</dd>" for name, value in overview.facts.items())
    table = _framed(plain_table(("Environment", "Stages"), overview.environments))
    return f"<pre tabindex='0'><code>{commands}</code></pre><dl>{facts}</dl>{table}"


def _section(name: str, title: str, body: str) -> str:
    return f"<section id='{name}'><h2>{title}</h2>{body}</section>"


def _framed(table: str, *, filtered: bool = False) -> str:
    mark = " data-filtered" if filtered else ""
    return f"<div class='frame'{mark} tabindex='0' role='region' aria-label='Table'>{table}</div>"


def _chart(name: str, choices: Iterable[str]) -> str:
    selects = "".join(
        f"<label>{choice.capitalize()} <select data-choice='{choice}'>"
        + ("".join(f"<option>{m}</option>" for m in PRINTED) if choice == "measure" else "")
        + "</select></label>"
        for choice in choices
    )
    return f"<div class='chart' data-chart='{name}'><div class='controls'>{selects}</div><div class='plot'></div></div>"
