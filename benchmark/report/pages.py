"""The report as HTML pages that work without a network.

It has an overview, a page to play with, and for each table scores, forms and queries.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

from plotly.offline import get_plotlyjs

from benchmark.defaults import RESULTS
from benchmark.errors import ConfigurationError
from benchmark.pipeline.records import Record
from benchmark.protocols.tables import TABLES
from benchmark.report.columns import PRINTED_QUANTITIES, score_groups
from benchmark.report.figures import MEASURE, class_means, map_figure
from benchmark.report.form_pages import forms_of_column
from benchmark.report.formats import blocks
from benchmark.report.forms import StoredForms, thumbnail
from benchmark.report.grids import figure_bytes
from benchmark.report.notation import file_name
from benchmark.report.notes import leads, table_notes
from benchmark.report.overview import matrix_of
from benchmark.report.page_builder import (
    PAGES_OF_TABLE,
    PLAY_PAGE,
    TEMPLATES,
    Pages,
    heading_of_table,
    label_of_table,
)
from benchmark.report.play import play_galleries, play_page
from benchmark.report.query_pages import queries_of_column
from benchmark.report.table_view import TableView
from benchmark.text import say

#: Styles, script and icon of all pages.
_FIXED_FILES = ("style.css", "table.css", "report.js", "icon.svg")

#: Least score on a scale from which its ticks are a tenth apart; below it, two tenths.
_SHORT_SCALE = 0.7


def report_files(
    results: Path, views: Sequence[TableView], data_root: Path | None = None
) -> dict[str, str | bytes]:
    """Return the files of a report by name: pages, pictures, surfaces to turn, and scripts.

    Parameters
    ----------
    results
        The results folder, whose stored forms and distances the pages show.
    views
        The tables.
    data_root
        Folder of the official data sets, whose cameras say which side of a shape is up.
    """
    pages = Pages(StoredForms(results, data_root), views)
    for name in _FIXED_FILES:
        pages.files[name] = fixed_file(name)
    galleries = play_galleries(pages.forms, _records_of(views))
    if galleries:
        pages.files[PLAY_PAGE] = play_page(galleries, back="index.html")
    titles = [_add_table(pages, view) for view in views if pages.main(view) is view]
    # The first page is made last, because it links to pages that were added for the tables.
    pages.add(
        "index.html",
        "index.html",
        "Canonical forms benchmark",
        stem="index",
        matrix=matrix_of(pages, views),
    )
    if len(views) == 1:  # no overview is needed
        pages.files["index.html"] = pages.files[f"{views[0].stem}.html"]
    if any("Forms" in of_table.values() for of_table in titles):
        pages.files["plotly.min.js"] = get_plotlyjs()
    return pages.files


def _records_of(views: Iterable[TableView]) -> list[Record]:
    """Return the records that tables show, each once."""
    records: dict[str, Record] = {}
    for row in chain.from_iterable(view.printed_rows for view in views):
        for record in row.records:
            records.setdefault(record.key, record)
    return [*records.values()]


# The pages of a table
# ------------------------------------------------------------------------------------------------


def _add_table(pages: Pages, view: TableView) -> dict[str, str]:
    """Add the pages of one table to the report: its scores, forms and queries.

    A page without content is left out, for example that of forms if none are stored.

    Parameters
    ----------
    pages
        The report, to which files are added.
    view
        The table.

    Returns
    -------
    dict
        Titles of the added pages by address.
    """
    say(f"table {label_of_table(view)}", err=True)
    # Each page has a section for each column. A facet is the table with one of its columns alone.
    facets = [replace(view, columns=(column,)) for column in view.columns]
    forms = _without_empty(forms_of_column(pages, facet) for facet in facets)
    queries = _without_empty(queries_of_column(pages, facet) for facet in facets)
    scores = _content_of_scores(view, forms, queries)
    scores["classes"] = [(facet.columns[0].title, class_means(facet)) for facet in facets]
    scores["maps"] = _add_maps(pages, facets)
    _add_published_pictures(pages, view, scores["pictures"])
    scores["command"] = _command(view, pages.forms.folder)
    scores["matrix"] = {}
    of_same_data = [other for other in pages.views if pages.main(other) is view]
    if len(of_same_data) > 1:  # seen by several cameras, whose pages it leads to
        scores["matrix"] = matrix_of(pages, of_same_data)

    contents = {"": scores, "-forms": {"facets": forms}, "-queries": {"facets": queries}}
    return _add_pages(pages, view, contents)


def _command(view: TableView, results: Path) -> str:
    """Return the command that makes the forms and the distances of a table in a results folder."""
    words = ["python", "-m", "benchmark", "run"]
    table = view.table
    data = view.sample.data
    if table in TABLES and table.identifier != view.dataset:
        words += ["-t", table.part_of or table.identifier]
    words += ["-d", data.path or view.dataset]
    if table not in TABLES:
        words += _options_of_gallery(view.sample)
    if view.quick:
        words.append("--quick")
    words += view.scored_by.options
    if results.absolute() != RESULTS.absolute():
        words += ["--results", str(results)]
    return shlex.join(words)


def _options_of_gallery(record: Record) -> list[str]:
    """Return the options that name the gallery of the queries of a record; none without one."""
    gallery = record.gallery_of_queries
    if gallery is None:
        return []
    words = []
    if (gallery.data.name, gallery.data.path) != (record.data.name, record.data.path):
        words += ["--gallery", gallery.data.path or gallery.data.source]
        if not record.keeps_same_names:
            words.append("--same-names")
    if gallery.views > 1:
        words += ["--gallery-views", str(gallery.views)]
    return words


def _add_pages(
    pages: Pages, view: TableView, contents: Mapping[str, Mapping[str, Any]]
) -> dict[str, str]:
    """Add those pages of a table to the report that have content, each with links to the others.

    Parameters
    ----------
    pages
        The report.
    view
        The table.
    contents
        What the template of each page reads, by the end of the address of the page.

    Returns
    -------
    dict
        Titles of the added pages by address.
    """
    endings = [ending for ending, content in contents.items() if any(content.values())]
    titles = {f"{view.stem}{ending}.html": PAGES_OF_TABLE[ending] for ending in endings}
    for ending, (address, title) in zip(endings, titles.items(), strict=True):
        heading = heading_of_table(view)
        if ending:
            heading += f": {title.lower()}"
        template = f"{title.lower()}.html"
        window = f"{title} | {label_of_table(view)}"
        content = contents[ending]
        pages.add(address, template, heading, window, kinds=titles, stem=view.stem, **content)
    return titles


def _without_empty(facets: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return what pages show of the columns of a table, without those that have nothing."""
    return [facet for facet in facets if facet]


def _add_maps(pages: Pages, facets: Iterable[TableView]) -> dict[str, str]:
    """Add the maps of the columns of a table, and return their files by the title of the column."""
    files = {}
    for facet in facets:
        file = _add_map(pages, facet)
        if file:
            files[facet.columns[0].title] = file
    return files


def _add_map(pages: Pages, view: TableView) -> str:
    """Add the map of one column to the report: shapes as points, which link to their queries.

    Returns
    -------
    str
        Name of its file; "" if no distances are stored.
    """
    title = view.columns[0].title
    page = f"{view.stem}-queries.html#{file_name(title)}"
    try:
        figure = map_figure(view, pages.forms, page)
    except ConfigurationError:
        return ""
    file = f"{view.stem}-map-{file_name(title.replace(' ', '-'))}.svg"
    # Links of matplotlib open new windows; these shall open in that of the page.
    svg = figure_bytes(figure, ".svg")
    pages.files[file] = svg.replace(b'target="_blank"', b'target="_top"')
    return file


def _add_published_pictures(pages: Pages, view: TableView, pictures: dict[str, str]) -> None:
    """Add the published pictures of forms of the rows that have no picture yet, by anchor."""
    for row in view.printed_rows:
        anchor = file_name(row.method)
        published = thumbnail(pages.forms.folder, view.dataset, row.method)
        if anchor not in pictures and published.is_file():
            pictures[anchor] = f"pictures/{published.name}"
            pages.files[pictures[anchor]] = published.read_bytes()


# Scores
# ------------------------------------------------------------------------------------------------


def fixed_file(name: str) -> str:
    """Return a style, a script or the icon that all pages use."""
    return TEMPLATES.get_template(name).render()


def table_html(view: TableView) -> str:
    """Return a table alone, with its notes, for a page with ``table.css``."""
    return TEMPLATES.get_template("table.html").render(_content_of_scores(view))


def _content_of_scores(
    view: TableView,
    forms: Sequence[Mapping[str, Any]] = (),
    queries: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Return what the template ``table.html`` reads of a table, by name.

    Parameters
    ----------
    view
        The table.
    forms, queries
        Content of the pages of forms and of queries, one item for each column. Rows of the table
        link to the rows (anchors) of these pages.
    """
    # A row shows the first picture of its forms.
    pictures: dict[str, str] = {}
    for facet in forms:
        for _, anchor, forms_of_row in facet["rows"]:
            first = next(form for form in forms_of_row if form)
            pictures.setdefault(anchor, first["picture"])
    anchors_of_queries = set[str]()
    for facet in queries:
        anchors_of_queries.update(anchor for _, anchor in facet["rows"])
    least = _least_tenth(view)
    return {
        "least": least,
        "ticks": _ticks(least),
        "view": view,
        "score_groups": score_groups(view),
        "measured": PRINTED_QUANTITIES,
        "blocks": blocks(view),
        "pictures": pictures,
        "linked": {"-forms": {*pictures}, "-queries": anchors_of_queries},
        "notes": table_notes(view),
        "leads": leads(view),
    }


def _least_tenth(view: TableView) -> float:
    """Return the least score or end of an interval of a table, rounded down to tenths."""
    values = [1.0]
    for row in view.printed_rows:
        for scores in row.scored.values():
            values.append(scores.means[MEASURE])
            values += scores.intervals.get(MEASURE, ())
    values += [scores[MEASURE] for scores in view.paper.values()]
    values += [scores[MEASURE] for scores in view.chance.values()]
    return min(values) // 0.1 / 10


def _ticks(least: float) -> list[float]:
    """Return the ticks of a scale that ends at 1."""
    step = 2 if least < _SHORT_SCALE else 1
    return [number / 10 for number in range(round(10 * least), 11, step)]
