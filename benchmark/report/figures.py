"""Figures for papers and pages, drawn by matplotlib from records and stored forms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmark.depth.frame import UPRIGHT
from benchmark.errors import ConfigurationError
from benchmark.files import write_atomically
from benchmark.geometry.camera import Camera
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.records import Record, read_distances
from benchmark.protocols.tables import Kind
from benchmark.report.drawing import outwardness, shaded
from benchmark.report.forms import StoredForms
from benchmark.report.sheets import spread
from benchmark.report.tables import Row, TableView
from benchmark.text import clean

#: Widths in inches of one column and of the text of a two-column paper.
COLUMN, WIDTH = 3.5, 7.16

#: View of forms of depth images, whose errors do not show from the front.
OBLIQUE = Camera((-0.9, 0.0, -1.0), (0.0, 1.0, 0.0))

#: Measure of charts that show one.
MEASURE = "DCG"

COLOURS: Mapping[Kind, str] = {"form": "#3a6ea5", "network": "#c8553d", "descriptor": "#4c956c", "external": "#777777"}

#: Levels of recall at which precision is interpolated.
RECALLS = np.round(np.arange(1, 21) * 0.05, 2)

_SIZE = 7
_STYLE = {"axes.labelsize": _SIZE, "axes.spines.top": False, "axes.spines.right": False}

#: Metadata by file extension, without the date and the version of matplotlib.
_UNDATED: dict[str, dict[str, str | None]] = {
    ".png": {"Software": None},
    ".pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    ".svg": {"Date": None, "Creator": None},
}

#: File extensions of figures.
ENDINGS = tuple(_UNDATED)


def scores_figure(view: TableView) -> Figure:
    """Draw the scores of a table with their intervals over classes (95 %), one line a row."""
    titles = [column.title for column in view.columns]
    figure, axes = subplots(WIDTH, 0.5 + 0.14 * len(view.printed_rows), n_columns=len(titles), sharey=True)
    rows = view.printed_rows[::-1]
    for place, title in zip(axes[0], titles, strict=True):
        for height, row in enumerate(rows):
            if one := row.scored.get(title):
                place.plot(one.intervals[MEASURE], [height, height], color=COLOURS[row.kind], lw=1)
                place.plot(one.means[MEASURE], height, "o", ms=3, color=COLOURS[row.kind])
        place.axvline(view.chance[title][MEASURE], color="0.6", lw=0.8, ls="--", zorder=0)
        place.set(xlim=(0, 1.02), xlabel=f"{MEASURE}, {title}")
    axes[0, 0].set_yticks(range(len(rows)), [clean(row.title) for row in rows], parse_math=False)
    return figure


def cost_figure(view: TableView) -> Figure:
    """Draw seconds a shape against a measure; no row is both faster and better than those on the line."""
    points = costs(view)
    figure, ((place,),) = subplots(COLUMN, 2.8)
    for row, seconds, score in points:
        place.plot(seconds, score, "o", ms=3.5, color=COLOURS[row.kind])
        place.annotate(clean(row.title), (seconds, score), (3, 2), textcoords="offset points", fontsize=5,
                       parse_math=False)  # fmt: skip
    front = pareto_front([(seconds, score) for _, seconds, score in points])
    if front:
        place.plot(*zip(*front, strict=True), color="0.7", lw=0.8, zorder=0)
    place.set(xscale="log", xlabel="seconds a shape: form and geodesics", ylabel=MEASURE)
    return figure


def costs(view: TableView) -> list[tuple[Row, float, float]]:
    """Return rows with their seconds a shape and their score in the first column."""
    title = view.columns[0].title
    return [
        (row, max(row.seconds, 1e-3), row.scored[title].means[MEASURE])
        for row in view.printed_rows
        if title in row.scored and row.seconds is not None
    ]


def pareto_front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points with no other one of lower cost (first) and higher score (second), cheapest first."""
    front: list[tuple[float, float]] = []
    for cost, score in sorted(points, key=lambda point: (point[0], -point[1])):
        if not front or score > front[-1][1]:
            front.append((cost, score))
    return front


def precision_recall_figure(curves: Sequence[tuple[Row, NDArray[np.float64]]]) -> Figure:
    """Draw interpolated precision over recall, a mean over all queries; a refused shape finds nothing.

    Raises
    ------
    ConfigurationError
        If there are no curves.
    """
    if not curves:
        raise ConfigurationError("no distances of this table are stored here", "run it here")
    figure, ((place,),) = subplots(COLUMN, 2.8)
    for row, curve in curves:
        place.plot(RECALLS, curve, lw=1, label=clean(row.title))
    place.set(xlim=(0, 1), ylim=(0, 1.02), xlabel="recall", ylabel="precision")
    place.legend(fontsize=5, frameon=False)
    return figure


def precision_recall(view: TableView, forms: StoredForms) -> list[tuple[Row, NDArray[np.float64]]]:
    """Return rows whose distances are all stored with their mean interpolated precision at :data:`RECALLS`."""
    title, curves = view.columns[0].title, []
    for row in view.printed_rows:
        records = row.scored[title].all_records if title in row.scored else []
        stored = [(record, read_distances(forms.folder, record)) for record in records]
        each = [_precision(record, matrix) for record, matrix in stored if matrix is not None]
        if records and len(each) == len(records):
            curves.append((row, np.mean(each, axis=0)))
    return curves


def _precision(record: Record, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean precision of the queries of a record; refused shapes rank nothing and are found by nobody."""
    labels = np.array([record.labels[number] for number in record.answered])
    sizes = {label: record.labels.count(label) - 1 for label in set(record.labels)}
    n_queries = sum(sizes[label] > 0 for label in record.labels)
    total = np.zeros(len(RECALLS))
    for query, label in enumerate(labels):
        order = np.argsort(np.delete(matrix[query], query), kind="stable")
        hits = np.cumsum(np.delete(labels, query)[order] == label)
        if sizes[label] and len(hits):
            precision = np.maximum.accumulate((hits / np.arange(1, len(hits) + 1))[::-1])[::-1]
            places = np.searchsorted(hits, np.ceil(RECALLS * sizes[label] - 1e-9))
            total += np.where(places < len(hits), precision[np.minimum(places, len(hits) - 1)], 0.0)
    return total / max(n_queries, 1)


def effect_figure(view: TableView, forms: StoredForms, shapes: Sequence[str] = ()) -> Figure:
    """Draw some shapes in a row, and below them their forms by each method; those of views from an angle.

    Parameters
    ----------
    view
        The table, whose first column gives the gallery.
    forms
        Reader of the forms.
    shapes
        Names of the shapes; by default some poses of the first two classes.

    Raises
    ------
    ConfigurationError
        If no form of these shapes is stored.
    """
    records = effect_records(view)
    if not records:
        raise ConfigurationError(f"no selected row of table {view.table.identifier} has forms", "select another method")
    first = next(iter(records.values()))
    names = list(shapes) or some_shapes(first)
    lines: list[tuple[str, list[Mesh | None]]] = [("", [forms.shape(first, name) for name in names])]
    lines += [(title, [forms.form(record, name) for name in names]) for title, record in records.items()]
    lines = [(title, meshes) for title, meshes in lines if any(meshes)]
    if len(lines) < 2:
        raise ConfigurationError("no forms of these shapes are stored here", "run the methods here, then draw again")
    figure, axes = subplots(WIDTH, WIDTH / len(names) * len(lines), len(lines), len(names))
    camera = UPRIGHT if first.input == "mesh" else OBLIQUE
    for of_line, (title, meshes) in zip(axes, lines, strict=True):
        of_line[0].set_title(clean(title), fontsize=_SIZE, loc="left", parse_math=False)
        for place, mesh, shape in zip(of_line, meshes, lines[0][1], strict=True):
            place.axis("off")
            if mesh is not None:
                place.imshow(np.asarray(shaded(mesh, camera, 280, values_like(mesh, shape))))
    return figure


def effect_records(view: TableView) -> dict[str, Record]:
    """Return one record of the first gallery for each printed row that makes forms, by the title of the row."""
    column = view.columns[0].title
    rows = [row for row in view.printed_rows if row.kind in ("form", "network") and column in row.scored]
    every = {row.title: row.scored[column].all_records[0] for row in rows}
    galleries = [record.gallery for record in every.values()]
    return {title: record for title, record in every.items() if record.gallery == galleries[0]}


def values_like(form: Mesh, shape: Mesh | None) -> NDArray[np.float64]:
    """Return how far each vertex is from the centre of the body, on the shape where it has the same vertices."""
    return outwardness(shape if shape is not None and np.array_equal(form.faces, shape.faces) else form)


def some_shapes(record: Record, n_classes: int = 2, n_shapes: int = 3) -> list[str]:
    """Return some shapes of some classes of a record that have a result."""
    classes: dict[str, list[str]] = {}
    for number in record.answered:
        classes.setdefault(record.labels[number], []).append(record.shapes[number])
    return [shape for of_class in spread([*classes.values()], n_classes) for shape in spread(of_class, n_shapes)]


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PDF, PNG or SVG by its extension."""
    write_atomically(path, lambda file: write(figure, file, path.suffix.lower()))


def write(figure: Figure, file: IO[bytes], ending: str) -> None:
    """Write a figure as PDF, PNG or SVG, without dates; publishers take the fonts (Type 42)."""
    with mpl.rc_context({"svg.hashsalt": "figure", "pdf.fonttype": 42}):
        figure.savefig(file, format=ending[1:], metadata=_UNDATED[ending], bbox_inches="tight", pad_inches=0.03)


def subplots(
    width: float, height: float, n_rows: int = 1, n_columns: int = 1, *, sharey: bool = False
) -> tuple[Figure, NDArray[np.object_]]:
    """Return a figure of a size in inches, and its axes, shape (n_rows, n_columns)."""
    figure = Figure(figsize=(width, height), layout="constrained")
    with mpl.rc_context(_STYLE):
        axes = figure.subplots(n_rows, n_columns, squeeze=False, sharey=sharey)
    for place in axes.flat:
        place.tick_params(labelsize=_SIZE - 1)
    return figure, axes
