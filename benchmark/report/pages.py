"""The report as HTML pages that work without a network: overview, and for each table scores, forms and queries."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader
from numpy.typing import NDArray
from plotly.offline import get_plotlyjs
from scipy.spatial import cKDTree

from benchmark.errors import ConfigurationError
from benchmark.geometry.preparation import decimate
from benchmark.pipeline.records import RankedShapes, Record, read_distances
from benchmark.protocols.tables import AGAINST, SURFACES, GalleryGroup, Kind
from benchmark.report import figures, grids
from benchmark.report.columns import PRINTED_OF_ROW, score_groups
from benchmark.report.data_titles import short_data_title
from benchmark.report.drawing import OBLIQUE, PALETTE, shaded, webp
from benchmark.report.figures import MEASURE
from benchmark.report.formats import BLOCKS, blocks
from benchmark.report.forms import Drawn, StoredForms, thumbnail
from benchmark.report.frames import changed, file_name, hundredths
from benchmark.report.notes import block_lead, leads, table_notes
from benchmark.report.play import play_galleries, play_page
from benchmark.report.statistics import INTERVALS
from benchmark.report.tables import Row, Scored, TableView
from benchmark.text import clean_text, listed, say

#: Pages of a table by the end of their name.
KINDS = {"": "Scores", "-forms": "Forms", "-queries": "Queries"}

#: The page to play with.
PLAY = "play.html"

#: Groups of the columns of the overview.
GROUPS = ("Complete surfaces", "One depth view", "View against surfaces")

#: Classes, and shapes of each, on a page of forms; vertices of a form in 3D, and pixels of its
#: picture.
CLASSES, POSES, VERTICES, SIDE = 3, 2, 2000, 240

#: Matches of a query, and failed queries whose forms are drawn, the hardest ones; pixels of the
#: picture of a shape.
MATCHES, HARDEST, _SMALL = 5, 20, 96

#: Matches of queries by number: number, rank, and distance over that of the first of the class,
#: unless it is 0.
Nearest = Mapping[int, Sequence[tuple[int, int, float | None]]]

#: What follows the class in the name of a shape whose pose has a name.
_POSE = re.compile(r"[_/-]([^\W\d_][^\d]*)")

_TEMPLATES = Environment(
    loader=PackageLoader("benchmark.report"),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
    finalize=lambda value: (
        "" if value is None else clean_text(value) if type(value) is str else value
    ),
)
_TEMPLATES.globals |= {"measure": MEASURE, "side": SIDE, "kind_names": KINDS}
_TEMPLATES.globals |= {"intervals": INTERVALS, "palette": PALETTE, "viewing": OBLIQUE.direction}
_TEMPLATES.filters |= {"anchor": file_name, "hundredths": hundredths}


@dataclass
class Pages:
    """Pages and pictures under construction.

    Parameters
    ----------
    forms
        Reader of the forms of a results folder.
    views
        The tables.
    files
        Contents by name.
    """

    forms: StoredForms
    views: Sequence[TableView]
    files: dict[str, str | bytes] = field(default_factory=dict)

    def add(self, name: str, template: str, title: str, **content: Any) -> None:
        """Add a page."""
        groups: dict[str, dict[str, str]] = {}
        for view in self.views:
            if self.main(view) is view:
                own = view.table.identifier == view.dataset
                groups.setdefault(_data_title(view), {})[view.stem] = (
                    "own" if own else view.table.identifier
                )
        content |= {"groups": groups, "has_overview": len(self.views) > 1}
        content["play"] = PLAY if PLAY in self.files else ""
        self.files[name] = _TEMPLATES.get_template(template).render(
            title=title, here=name, **content
        )

    def main(self, view: TableView) -> TableView:
        """Return the table on whose pages another one stands: that of the unchanged views."""
        base = (changed(view.dataset) or [""])[0] if view.table.is_cross else ""
        return next(
            (main for main in self.views if (main.table, main.dataset) == (view.table, base)), view
        )

    def picture(
        self, name: str, drawn: Drawn | None, size: int, *, is_coloured: bool = False
    ) -> str:
        """Return the name of the picture of a surface, which is drawn once; "" without a surface."""
        file = f"pictures/{file_name(name)}.webp" if drawn else ""
        if drawn and file not in self.files:
            values = drawn.values if is_coloured else None
            self.files[file] = webp(shaded(drawn.mesh, OBLIQUE, size, values))
        return file


def report_files(
    results: Path, views: Sequence[TableView], data_root: Path | None = None
) -> dict[str, str | bytes]:
    """Return the files of a report by name.

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
    pages.files |= {name: fixed_file(name) for name in ("style.css", "table.css", "report.js")}
    if galleries := play_galleries(pages.forms, _records_of(views)):
        pages.files[PLAY] = play_page(galleries, back="index.html")
    listed = [_add_table(pages, view) for view in views if pages.main(view) is view]
    pages.add(
        "index.html",
        "index.html",
        "Canonical forms benchmark",
        stem="index",
        matrix=_matrix(pages, views),
    )
    if len(views) == 1:
        pages.files["index.html"] = pages.files[f"{views[0].stem}.html"]
    if any("Forms" in kinds.values() for kinds in listed):
        pages.files["plotly.min.js"] = get_plotlyjs()
    return pages.files


def _records_of(views: Iterable[TableView]) -> list[Record]:
    """Return the records that tables show, each once."""
    found: dict[str, Record] = {}
    for view in views:
        for row in view.printed_rows:
            for scored in row.scored.values():
                for record in scored.all_records:
                    found.setdefault(record.key, record)
    return [*found.values()]


def _add_table(pages: Pages, view: TableView) -> dict[str, str]:
    """Add the pages of a table that have content, and return their titles by address."""
    say(f"table {_label(view)}", err=True)
    facets = [replace(view, columns=(column,)) for column in view.columns]
    forms = [found for facet in facets if (found := _forms(pages, facet))]
    queries = [found for facet in facets if (found := _queries(pages, facet))]
    of_angles = [other for other in pages.views if pages.main(other) is view]
    scores = _scores(view, forms, queries)
    scores["classes"] = [(facet.columns[0].title, figures.class_means(facet)) for facet in facets]
    scores["maps"] = {
        facet.columns[0].title: name for facet in facets if (name := _map(pages, facet))
    }
    for row in view.printed_rows:
        if (anchor := file_name(row.method)) not in scores["pictures"]:
            published = thumbnail(pages.forms.folder, view.dataset, row.method)
            if published.is_file():
                scores["pictures"][anchor] = f"pictures/{published.name}"
                pages.files[scores["pictures"][anchor]] = published.read_bytes()
    scores["matrix"] = _matrix(pages, of_angles) if len(of_angles) > 1 else {}
    content = {"": scores, "-forms": {"facets": forms}, "-queries": {"facets": queries}}
    kinds = {
        f"{view.stem}{ending}.html": KINDS[ending]
        for ending, shown in content.items()
        if any(shown.values())
    }
    for name, kind in kinds.items():
        ending = name.removeprefix(view.stem).removesuffix(".html")
        title = _title(view) + (ending and f": {kind.lower()}")
        pages.add(
            name, f"{kind.lower()}.html", title, kinds=kinds, stem=view.stem, **content[ending]
        )
    return kinds


def _matrix(pages: Pages, views: Iterable[TableView]) -> dict[str, Any]:
    """Return the columns of some tables by group and label, and by block the rows with their scores in each column."""
    columns: dict[tuple[int, str], tuple[TableView, GalleryGroup]] = {}
    for view in views:
        for column in view.columns:
            columns.setdefault(_place(view, column), (view, column))
    places = sorted(columns, key=lambda place: place[0])  # stable
    rows: dict[str, dict[str, list[tuple[Row, Scored, bool] | None]]] = {}
    for kind, name in BLOCKS.items():
        of = [
            _column_scores(kind, *columns[place], views_apart=(1, place[1]) in columns)
            for place in places
        ]
        if titles := dict.fromkeys(chain(*of)):
            rows[name] = {title: [scores.get(title) for scores in of] for title in titles}
    groups = {name: sum(GROUPS[group] == name for group, _ in places) for name in GROUPS}
    shown = [
        (label, pages.main(columns[group, label][0]).stem, *columns[group, label])
        for group, label in places
    ]
    return {"columns": shown, "groups": groups, "rows": rows, "leads": _leads(columns)}


def _leads(columns: Mapping[tuple[int, str], tuple[TableView, GalleryGroup]]) -> list[str]:
    """Say for each block and group which row is significantly above all others, by more than the scatter."""
    found: dict[str, list[str]] = {}
    for (group, label), (view, column) in sorted(columns.items()):
        for (title, kind), tested in view.tests.items():
            if title != column.title or (group, kind) == (0, "network"):  # which see views
                continue
            row, n_behind = block_lead(view, title, kind)
            if n_behind == len(tested.rivals) - 1:
                found.setdefault(
                    f"{BLOCKS[kind]}, {GROUPS[group].lower()}: {row.title}", []
                ).append(label)
    return [f"{leader} on {'; '.join(labels)}." for leader, labels in sorted(found.items())]


def _place(view: TableView, column: GalleryGroup) -> tuple[int, str]:
    """Return the number of the group of a column in the overview, and its label."""
    is_against = any(part.startswith(AGAINST) for part in column.parts)
    has_parts = column.parts not in [("",), (SURFACES,)] and not view.table.is_ablation
    title = f", {column.title.removeprefix(AGAINST)}" * has_parts
    label = _data_title(view) + ", ablation" * view.table.is_ablation + title
    return 2 if is_against else int(column.input == "view"), label


def _column_scores(
    kind: Kind, view: TableView, column: GalleryGroup, *, views_apart: bool
) -> dict[str, tuple[Row, Scored, bool]]:
    """Return the rows of a block by title with their scores in a column, and whether these are of views.

    In a column of complete surfaces, networks have scores of views; with ``views_apart``, these
    stand in their own.
    """
    rows = [
        (row, row.scored[column.title])
        for row in view.printed_rows
        if row.kind == kind and column.title in row.scored
    ]
    is_view = {
        row: column.input == "as printed" and one.all_records[0].input == "view"
        for row, one in rows
    }
    return {
        row.title: (row, one, is_view[row])
        for row, one in rows
        if not (views_apart and is_view[row])
    }


# Scores
# ------------------------------------------------------------------------------------------------


def fixed_file(name: str) -> str:
    """Return a style or a script that all pages use."""
    return _TEMPLATES.get_template(name).render()


def table_html(view: TableView) -> str:
    """Return a table alone, with its notes, for a page with ``table.css``."""
    return _TEMPLATES.get_template("table.html").render(_scores(view))


def _scores(
    view: TableView, forms: Sequence[Any] = (), queries: Sequence[Any] = ()
) -> dict[str, Any]:
    """Return what ``table.html`` shows of a table, whose rows link to their forms and queries."""
    made = {anchor: shown for facet in forms[::-1] for _, anchor, shown in facet["rows"]}
    pictures = {anchor: next(filter(None, shown))["picture"] for anchor, shown in made.items()}
    linked = {
        "-forms": made,
        "-queries": {anchor for facet in queries for _, anchor in facet["rows"]},
    }
    rows = {clean_text(row.title): row for row in view.printed_rows}
    every = [one for row in rows.values() for one in row.scored.values()]
    ranges = [end for one in every for end in (one.means[MEASURE], *one.intervals.get(MEASURE, ()))]
    papers = [scores[MEASURE] for scores in view.paper.values()]
    least = (
        min([1.0, *ranges, *papers, *(chance[MEASURE] for chance in view.chance.values())])
        // 0.1
        / 10
    )
    return {
        "least": least,
        "ticks": [number / 10 for number in range(round(10 * least), 11, 2 if least < 0.7 else 1)],
        "view": view,
        "score_groups": score_groups(view),
        "measured": PRINTED_OF_ROW,
        "blocks": blocks(view),
        "rows": rows,
        "pictures": pictures,
        "linked": linked,
        "notes": table_notes(view),
        "leads": leads(view),
    }


# Forms and queries
# ------------------------------------------------------------------------------------------------


def _forms(pages: Pages, view: TableView) -> dict[str, Any]:
    """Return some shapes of a column, and the rows with stored forms: title, anchor and forms; empty without any."""
    records, forms = figures.first_records(view), pages.forms
    first = next(iter(records.values()), None)
    shapes = figures.some_shapes(first, CLASSES, POSES) if first else []
    rows = [
        (row.title, file_name(row.method), made)
        for row, record in records.items()
        if any(
            made := [
                _form(pages, record, shape, f" by {row.title}", forms.form(record, shape))
                for shape in shapes
            ]
        )
    ]
    if not first or not rows:
        return {}
    rows.insert(
        0,
        (
            "Shape",
            "shape",
            [_form(pages, first, shape, "", forms.shape(first, shape)) for shape in shapes],
        ),
    )
    return {"title": view.columns[0].title, "shapes": shapes, "rows": rows}


def _form(pages: Pages, record: Record, shape: str, by: str, drawn: Drawn | None) -> dict[str, Any]:
    """Add the picture of a form, or shape, and its surface in 3D, and return their names; empty if it is not stored."""
    if drawn is None:
        return {}
    name = f"{record.input}-{record.data.name}-{record.method if by else 'shape'}-of-{shape}"
    small = decimate(drawn.mesh, VERTICES) if drawn.mesh.n_vertices > VERTICES else drawn.mesh
    shown = drawn.values[cKDTree(drawn.mesh.vertices).query(small.vertices)[1]]
    surface = {
        "points": small.vertices.T.round(3).tolist(),
        "faces": small.faces.T.tolist(),
        "values": shown.round(2).tolist(),
    }
    file = f"forms/{file_name(name)}.js"
    pages.files[file] = f"show('{file}', {json.dumps(surface, separators=(',', ':'))});"
    picture = pages.picture(name, drawn, SIDE, is_coloured=True)
    says = (f"Form of {shape}{by}" if by else shape) + ", mirrored" * drawn.is_mirrored
    return {
        "picture": picture,
        "mesh": file,
        "says": says,
        "is_mirrored": drawn.is_mirrored,
        "apart": drawn.apart,
    }


def _queries(pages: Pages, view: TableView) -> dict[str, Any]:
    """Return the queries of a column with what each row does with them, refused and missed ones first; or nothing."""
    rows = [
        (row, record, _nearest(record, matrix))
        for row, record in figures.first_records(view).items()
        if (matrix := read_distances(pages.forms.folder, record)) is not None
    ]
    if not rows:
        return {}
    first = rows[0][1]
    every = [number for number, score in enumerate(first.per_query[MEASURE]) if score is not None]
    cells = {
        number: [_outcome(record, nearest, number) for _, record, nearest in rows]
        for number in every
    }
    worst = {number: min(cells[number])[0] for number in every}
    order = sorted(
        every, key=lambda number: (worst[number], sum(score for _, score in cells[number]))
    )
    missed = [number for number in order if worst[number] < 2][:HARDEST]
    return {
        "title": view.columns[0].title,
        "queries": [{"number": of, "cells": cells[of], "is_fine": worst[of] == 2} for of in order],
        "rows": [(row.title, file_name(row.method)) for row, *_ in rows],
        "kept": [_kept_pose(record, nearest) for _, record, nearest in rows],
        "refused": _refusals([(row.title, record) for row, record, _ in rows]),
        "data": {
            "sides": [_shapes(pages, side) for side in first.sides],
            "rows": [
                (row.title, near, _drawn(pages, record, near, missed)) for row, record, near in rows
            ],
        },
    }


def _refusals(rows: Iterable[tuple[str, Record]]) -> list[tuple[str, str, str]]:
    """Return the shapes that were refused, the reason with its remedy, and the rows that say so."""
    found: dict[tuple[str, str], list[str]] = {}
    for title, record in rows:
        for side in record.sides:
            for shape, reason in side.unsupported:
                titles = found.setdefault((shape, reason), [])
                titles += [] if title in titles else [title]
    return [
        (clean_text(shape), clean_text(reason), listed(titles))
        for (shape, reason), titles in found.items()
    ]


def _shapes(pages: Pages, side: RankedShapes) -> list[tuple[str, str, str]]:
    """Return names, classes and pictures of shapes that are queries or ranked."""
    place = f"{side.input}-{side.data.name}"
    pictures = [
        pages.picture(f"{place}-{shape}", pages.forms.shape(side, shape), _SMALL)
        for shape in side.shapes
    ]
    return [*zip(map(clean_text, side.shapes), map(clean_text, side.labels), pictures, strict=True)]


def _nearest(record: Record, matrix: NDArray[np.float64]) -> Nearest:
    """Return the nearest shapes of each query with a result but itself, and the first of its class if it is later."""
    last, found = record.sides[-1], {}
    numbers, shapes, labels = np.array(last.answered), np.array(last.shapes), np.array(last.labels)
    for query, distances in zip(record.answered, matrix, strict=True):
        order = np.argsort(distances, kind="stable")
        order = order[record.keeps_same_names | (shapes[numbers[order]] != record.shapes[query])]
        own = np.flatnonzero(labels[numbers[order]] == record.labels[query])[:1].tolist()
        unit = float(distances[order[own[0]]]) if own else 0.0
        ranks = [*range(min(MATCHES, len(order))), *(rank for rank in own if rank >= MATCHES)]
        ratios = [round(float(distances[order[k]]) / unit, 3) if unit else None for k in ranks]
        found[query] = [
            (int(numbers[order[k]]), k + 1, ratio) for k, ratio in zip(ranks, ratios, strict=True)
        ]
    return found


def _kept_pose(record: Record, nearest: Nearest) -> list[float]:
    """Return how often the match of a failed query has its pose, and how often a random shape of another class has it.

    Empty if poses have no names, as in ``man-1_kneeling``, or no query fails.
    """
    last = record.sides[-1]
    poses = [
        [
            _POSE.fullmatch(shape.removeprefix(label))
            for shape, label in zip(side.shapes, side.labels, strict=True)
        ]
        for side in record.sides
    ]
    if not all(map(all, poses)):
        return []
    names = [[pose[1] for pose in of_side if pose] for of_side in poses]
    labels, every = np.array(last.labels), np.array(names[-1])
    failed = [
        (query, of[0][0])
        for query, of in nearest.items()
        if of and labels[of[0][0]] != record.labels[query]
    ]
    others = [every[labels != record.labels[query]] == names[0][query] for query, _ in failed]
    if not any(map(np.any, others)):
        return []
    shares = (
        [every[match] == names[0][query] for query, match in failed],
        [of.mean() for of in others],
    )
    return [float(np.mean(of)) for of in shares]


def _drawn(pages: Pages, record: Record, nearest: Nearest, missed: Sequence[int]) -> dict[int, str]:
    """Return the pictures of the forms of missed queries, and of their matches, by number; empty without forms."""
    shown = {of for of in missed if of in nearest}
    if len(record.sides) == 1:
        shown |= {match for query in missed for match, *_ in nearest.get(query, ())}
    forms = {of: pages.forms.upright(record, record.shapes[of]) for of in sorted(shown)}
    name = f"{record.input}-{record.data.name}-{record.method}-near"
    files = {
        of: pages.picture(f"{name}-{record.shapes[of]}", form, _SMALL, is_coloured=True)
        for of, form in forms.items()
    }
    return {of: file for of, file in files.items() if file}


def _outcome(record: Record, nearest: Nearest, number: int) -> tuple[int, float]:
    """Return 0 for a refused query, 1 where the nearest match is of another class, otherwise 2; and its score."""
    first = nearest.get(number, ())[:1]
    is_hit = any(record.sides[-1].labels[match] == record.labels[number] for match, *_ in first)
    return (number in nearest) + is_hit, record.per_query[MEASURE][number] or 0.0


def _map(pages: Pages, view: TableView) -> str:
    """Add the map of a column as a file whose points lead to queries, and return its name; "" without distances."""
    name, title = (
        f"{view.stem}-map-{file_name(view.columns[0].title.replace(' ', '-'))}.svg",
        view.columns[0].title,
    )
    try:
        page = f"{view.stem}-queries.html#{file_name(title)}"
        svg = grids.encode(figures.map_figure(view, pages.forms, page), ".svg")
    except ConfigurationError:
        return ""
    pages.files[name] = svg.replace(b'target="_blank"', b'target="_top"')
    return name


def _title(view: TableView) -> str:
    name = view.table.identifier
    return view.caption if name == view.dataset else f"Table {name}. {view.caption}"


def _label(view: TableView) -> str:
    """Return a short name of a table and its data."""
    data = _data_title(view)
    return data if view.table.identifier == view.dataset else f"{view.table.identifier}: {data}"


def _data_title(view: TableView) -> str:
    """Return a short name of the data of a table."""
    return clean_text(short_data_title(next(iter(view.samples.values()))[0]))
