"""The report as HTML pages that work without a network: overview, a page a table, forms in 3D, and worst queries."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib import resources
from itertools import islice
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Drawing
from numpy.typing import NDArray
from plotly.graph_objects import Figure, Mesh3d
from plotly.offline import get_plotlyjs
from scipy.spatial import cKDTree

from benchmark.depth.frame import UPRIGHT
from benchmark.errors import ConfigurationError
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import decimate
from benchmark.pipeline.records import Ranked, Record
from benchmark.reference.paper import MEASURES
from benchmark.report import figures
from benchmark.report.drawing import PALETTE, shaded
from benchmark.report.figures import MEASURE
from benchmark.report.formats import blocks, hundredths
from benchmark.report.forms import Drawn, StoredForms
from benchmark.report.notes import table_notes
from benchmark.report.output import write_files
from benchmark.report.results import Results
from benchmark.report.tables import TableView
from benchmark.text import clean, say

#: Vertices of a form in 3D and pixels of its height; forms of a shape, and shapes, for browsers draw at most 16.
VERTICES, SIDE, SIDE_BY_SIDE, POSES = 700, 180, 6, 2

#: Methods, queries and matches on the page of queries.
METHODS, WORST, MATCHES = 6, 20, 5

ITSELF = "the shape"

#: Pixels of a picture of a shape.
_PIXELS = 96


@dataclass
class Pages:
    """Pages and pictures under construction.

    Parameters
    ----------
    results
        The results folder.
    forms
        Reader of its forms.
    views
        The tables.
    files
        Contents by name.
    """

    results: Results
    forms: StoredForms
    views: Sequence[TableView]
    files: dict[str, str | bytes] = field(default_factory=dict)

    def add(self, name: str, title: str, body: Iterable[str], view: TableView | None = None) -> None:
        """Add a page."""
        links = [_link("index.html", "Overview", is_here=view is None)]
        links += [_link(f"{v.stem}.html", _short(v), is_here=v is view) for v in self.views]
        tabs = []
        if view is not None:
            names = {f"{view.stem}{ending}.html": text for ending, (text, _) in KINDS.items()}
            tabs = ["<nav>", *(_link(place, text, is_here=place == name) for place, text in names.items()), "</nav>"]
        lines = [
            "<!doctype html>", "<html lang='en'><head><meta charset='utf-8'>",
            "<meta name='viewport' content='width=device-width, initial-scale=1'>",
            "<link rel='icon' href='data:,'><link rel='stylesheet' href='style.css'>",
            "<script src='plotly.min.js'></script>", f"<title>{_text(title)}</title></head><body>",
            "<header><nav>", *links, "</nav></header>", f"<main><h1>{_text(title)}</h1>", *tabs, *body,
            "</main></body></html>",
        ]  # fmt: skip
        self.files[name] = "\n".join(lines) + "\n"

    def picture(self, record: Ranked, shape: str) -> str:
        """Return an image of a shape, which is drawn once; "" where it is not stored."""
        file = f"pictures/{_safe(f'{record.input}-{record.data.name}-{shape}')}.webp"
        if file not in self.files:
            if (drawn := self.forms.shape(record, shape)) is None:
                return ""
            stream = io.BytesIO()
            shaded(drawn.mesh, UPRIGHT, _PIXELS).save(stream, format="WEBP", quality=80)
            self.files[file] = stream.getvalue()
        return f"<img src='{file}' width='{_PIXELS}' height='{_PIXELS}' alt='' loading='lazy'>"


def write_report(
    results: Results, views: Sequence[TableView], folder: Path, *, data_root: Path | None = None, force: bool = False
) -> list[str]:
    """Write the report into its folder.

    Parameters
    ----------
    results
        The results, whose stored forms and distances the pages show.
    views
        The tables.
    folder
        Folder of the report.
    data_root
        Folder of the official data sets, whose cameras say which side of a shape is up.
    force
        Whether to replace files that were edited or come from elsewhere.

    Returns
    -------
    list of str
        Names of the written files.

    Raises
    ------
    ConfigurationError
        If a file would be replaced that the report did not write.
    """
    pages = Pages(results, StoredForms(results.folder, data_root), views)
    style = resources.files("benchmark.report").joinpath("style.css").read_text(encoding="utf-8")
    pages.files |= {"plotly.min.js": get_plotlyjs(), "style.css": style}
    pages.add("index.html", "Canonical forms benchmark", overview(pages))
    for view in views:
        say(f"table {view.table.identifier}, {view.dataset}", err=True)
        for ending, (name, page) in KINDS.items():
            title = _title(view) + (f": {name.lower()}" if ending else "")
            pages.add(f"{view.stem}{ending}.html", title, page(pages, view), view)
    write_files(folder, pages.files, force=force)
    return list(pages.files)


def overview(pages: Pages) -> Iterator[str]:
    """Yield the first page: all tables."""
    for view in pages.views:
        yield f"<h2>{_link(f'{view.stem}.html', _title(view))}</h2>"
        yield from html_table(view)


def table_page(pages: Pages, view: TableView) -> Iterator[str]:
    """Yield the page of a table: scores with intervals, cost against score, and precision over recall."""
    yield from html_table(view)
    yield from ("<ul>", *(f"<li>{_text(note)}</li>" for note in table_notes(view)), "</ul>")
    yield "<h2>Scores with intervals</h2><p>95 % of resampled classes; dashed: a random order.</p>"
    yield _svg(figures.scores_figure(view))
    column = f", {_text(view.columns[0].title)}" if len(view.columns) > 1 else ""
    yield f"<h2>Score against cost{column}</h2><p>No row is both faster and better than those on the line.</p>"
    yield _svg(figures.cost_figure(view))
    curves = figures.precision_recall(view, pages.forms)
    if curves:
        yield f"<h2>Precision over recall{column}</h2><p>Mean over all queries; a refused shape finds nothing.</p>"
        yield _svg(figures.precision_recall_figure(curves))


def html_table(view: TableView) -> Iterator[str]:
    """Yield a table with its blocks and marks."""
    heads = "".join(f"<th colspan='{len(MEASURES)}'>{_text(group)}</th>" for group in view.groups)
    yield f"<p>{_text(view.caption)}</p><div class='frame'><table><thead><tr><th></th>{heads}<th></th></tr>"
    names = "".join(f"<th>{name}</th>" for name in MEASURES * len(view.groups))
    yield f"<tr><th>Method</th>{names}<th title='seconds a shape'>s</th></tr></thead><tbody>"
    for heading, lines in blocks(view):
        if heading:
            yield f"<tr class='block'><th colspan='{len(view.groups) * len(MEASURES) + 2}'>{_text(heading)}</th></tr>"
        for line in lines:
            cells = [
                f"<td class='{mark}'{'' if len(group) > 1 else f' colspan={len(MEASURES)}'}>{_text(text)}</td>"
                for group in line.groups for text, mark in group
            ]  # fmt: skip
            place = "" if heading else " class='chance'"
            yield f"<tr{place}><th>{_text(line.title)}</th>{''.join(cells)}<td>{line.seconds}</td></tr>"
    yield "</tbody></table></div>"


def forms_page(pages: Pages, view: TableView) -> Iterator[str]:
    """Yield the page of forms: poses of one subject, each with its forms by several methods."""
    records = dict(islice(figures.effect_records(view).items(), SIDE_BY_SIDE - 1))
    shapes = figures.some_shapes(next(iter(records.values())), POSES) if records else []
    rows = {shape: _forms_of(pages, records, shape) for shape in shapes}
    if not any(len(meshes) > 1 for meshes in rows.values()):
        yield f"<p>No forms of this table are stored here. Make them with: <code>{_text(_command(view))}</code></p>"
        return
    yield (
        "<p>Drag to turn, scroll to zoom. The colour shows how far a point is from the centre of the body. "
        "Forms are turned to that of the first pose of the subject.</p>"
    )
    for shape, meshes in rows.items():
        yield f"<h2>{_text(shape)}</h2><div class='forms'>"
        for title, form in meshes.items():
            name = f"{title}, mirrored" if form.is_mirrored else title
            chart = mesh_chart(form.mesh, form.values)
            yield f"<figure>{_html(chart)}<figcaption>{_text(name)}</figcaption></figure>"
        yield "</div>"


def _forms_of(pages: Pages, records: Mapping[str, Record], shape: str) -> dict[str, Drawn]:
    """Return a shape and its stored forms by the title of their row."""
    meshes: dict[str, Drawn] = {}
    for title, record in records.items():
        form, surface = pages.forms.form(record, shape), pages.forms.shape(record, shape)
        if form is not None and surface is not None:
            meshes |= {ITSELF: surface, title: form}
    return meshes


def mesh_chart(mesh: Mesh, values: NDArray[np.float64]) -> Figure:
    """Return a mesh in 3D."""
    small = decimate(mesh, VERTICES) if mesh.n_vertices > VERTICES else mesh
    shown = values[cKDTree(mesh.vertices).query(small.vertices)[1]]
    (x, y, z), (i, j, k) = small.vertices.T.round(3), small.faces.T
    figure = Figure(Mesh3d(
        x=x, y=-z, z=y, i=i, j=j, k=k, intensity=shown.round(2), colorscale=list(PALETTE), showscale=False,
        hoverinfo="skip",
    ))  # fmt: skip
    extents = np.ptp(small.vertices, axis=0)
    # The diagonal fits, however the mesh is turned; no side is 0.
    width, height, depth = (1.9 * extents / np.linalg.norm(extents)).clip(min=1e-3)
    figure.update_scenes(
        xaxis_visible=False, yaxis_visible=False, zaxis_visible=False,
        aspectratio={"x": width, "y": depth, "z": height},
        camera={"eye": {"x": 0, "y": -1.9, "z": 0.2}, "projection": {"type": "orthographic"}},
    )  # fmt: skip
    return figure.update_layout(height=SIDE, margin={"l": 0, "r": 0, "t": 0, "b": 0})


def queries_page(pages: Pages, view: TableView) -> Iterator[str]:
    """Yield the page of queries: for each method, those that find least, with their nearest matches."""
    title = view.columns[0].title
    rows = [row for row in view.printed_rows if title in row.scored]
    worst = ((row.title, _worst(pages, row.scored[title].all_records[0])) for row in rows)
    shown = list(islice(((name, lines) for name, lines in worst if lines), METHODS))
    for name, lines in shown:
        yield f"<h2>{_text(name)}</h2><div class='frame'><table class='queries'><tbody>"
        yield from lines
        yield "</tbody></table></div>"
    if not shown:
        yield f"<p>No distances of this table are stored here. Make them with: <code>{_text(_command(view))}</code></p>"


def _worst(pages: Pages, record: Record) -> list[str]:
    """Return a table row for each of the worst queries of a job; none if its distances are not stored."""
    classes = dict(zip(record.shapes, record.labels, strict=True))
    scores = dict(zip(record.shapes, record.per_query[MEASURE], strict=True))
    answered = [(scores[shape], shape) for shape in (record.shapes[number] for number in record.answered)]
    lines = []
    for score, query in sorted(pair for pair in answered if pair[0] is not None)[:WORST]:
        try:
            matches = pages.results.matches(record.key, query, MATCHES)
        except ConfigurationError:
            return []
        cells = [f"<th>{pages.picture(record, query)}<br>{_text(query)}<br>{MEASURE} {hundredths(score)}</th>"]
        for shape, label in zip(matches["shape"], matches["class"], strict=True):
            mark = "hit" if label == classes[query] else "miss"
            cells.append(f"<td class='{mark}'>{pages.picture(record.sides[-1], shape)}<br>{_text(shape)}</td>")
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return lines


#: Pages of a table by the end of their name.
KINDS = {"": ("Scores", table_page), "-forms": ("Forms", forms_page), "-queries": ("Worst queries", queries_page)}


def _html(figure: Figure) -> str:
    return str(figure.to_html(full_html=False, include_plotlyjs=False, config={"displayModeBar": False}))


def _svg(figure: Drawing) -> str:
    """Return a figure of matplotlib as an element of a page."""
    stream = io.BytesIO()
    figures.write(figure, stream, ".svg")
    text = stream.getvalue().decode()
    return text[text.index("<svg") :]


def _command(view: TableView) -> str:
    table = view.table.part_of or view.table.identifier
    chosen = f"-t {table}" if view.table.identifier != view.dataset else f"-d {view.dataset}"
    return f"python -m benchmark run {chosen}{' --quick' if view.quick else ''}"


def _title(view: TableView) -> str:
    return f"Table {view.table.identifier}. {view.table.caption}"


def _short(view: TableView) -> str:
    return view.table.identifier if view.table.identifier == view.dataset else f"{view.table.identifier} {view.dataset}"


def _link(address: str, text: str, *, is_here: bool = False) -> str:
    return f"<a href='{address}'{' aria-current=page' if is_here else ''}>{_text(text)}</a>"


def _safe(name: str) -> str:
    return "".join(c if c.isascii() and (c.isalnum() or c in "-_") else f"{ord(c):x}" for c in name)[:100]


def _text(text: str) -> str:
    return escape(clean(text), quote=True)
