"""Figures for papers and pages, drawn by matplotlib from records and stored forms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from statistics import mode
from textwrap import fill
from typing import TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from pandas import DataFrame, Series, concat
from scipy.spatial.distance import squareform
from scipy.stats import rankdata
from sklearn.manifold import MDS

from benchmark.depth.frame import UPRIGHT
from benchmark.errors import ConfigurationError, check_known
from benchmark.geometry.camera import Camera
from benchmark.geometry.mesh import Points
from benchmark.pipeline.records import Record, read_distances
from benchmark.report.drawing import OBLIQUE, shaded
from benchmark.report.forms import Drawn, StoredForms
from benchmark.report.frames import file_name
from benchmark.report.grids import DPI, TITLE_SIZE, WIDTH, grid
from benchmark.report.tables import Row, Scored, TableView
from benchmark.text import clean_text

T = TypeVar("T")

#: Side in inches of a picture in a figure of forms, at most.
_TALLEST = 0.85

#: Measure of pages and figures that show one.
MEASURE = "DCG"

#: Colours of classes, in turn, and of lines: contrast with white of at least 3, as WCAG asks of
#: graphics.
COLOURS = (
    "#3a6ea5",
    "#c8553d",
    "#3d8a5f",
    "#8a5fa8",
    "#9c6b14",
    "#128391",
    "#b0457f",
    "#66751c",
    "#5b5b5b",
    "#222222",
)
GREY = "#737373"

#: Colour of a shape whose nearest match is wrong.
MISSED = "#8c2318"


def shown_rows(view: TableView) -> list[tuple[Row, Scored]]:
    """Return printed rows with their scores in the first column that has some; titles name another than the table's."""
    found = []
    for row in view.printed_rows:
        if column := next(
            (column.title for column in view.columns if column.title in row.scored), ""
        ):
            title = row.title if column == view.columns[0].title else f"{row.title}, {column}"
            found.append((replace(row, title=clean_text(title)), row.scored[column]))
    return found


def class_means(view: TableView) -> DataFrame:
    """Return the mean of each class that all rows rank, from the hardest class to the easiest, by row."""
    each = dict[str, Series]()
    for row, one in shown_rows(view):
        queries = [Series(of.per_query[MEASURE], of.labels, float) for of in one.all_records]
        each[row.title] = concat(queries).groupby(level=0).mean()
    means = DataFrame(each).T.rename_axis("method").dropna(axis=1)
    return means[means.mean().sort_values().index]


def map_figure(view: TableView, forms: StoredForms, page: str = "") -> Figure:
    """Draw the shapes as points whose distances have the order of those of each row, and lines to the mean of a class.

    A ring marks a shape whose nearest match is of another class. Points lead to the queries of a
    page, if it is named.

    Raises
    ------
    ConfigurationError
        If no distances of shapes among each other are stored.
    """
    each = [(row, of, read_distances(forms.folder, of)) for row, of in first_records(view).items()]
    known = [
        (row, of, matrix) for row, of, matrix in each if matrix is not None and len(of.sides) == 1
    ]
    if not known:
        raise ConfigurationError("no distances of this table are stored here", "run it here")
    n_columns = min(len(known), 3)
    n_rows, side = -(-len(known) // n_columns), min(WIDTH / n_columns, 4)
    figure = Figure((n_columns * side, n_rows * (side + 0.2)), layout="constrained")
    for place in figure.subplots(n_rows, n_columns, squeeze=False).flat:
        place.axis("off")
        place.set_aspect("equal", "datalim")
    for place, (row, record, matrix) in zip(figure.axes, known, strict=False):
        labels, names = (np.array(of)[record.answered] for of in (record.labels, record.shapes))
        near = matrix + np.diag(np.full(len(matrix), np.inf))
        is_missed = labels[near.argmin(axis=1)] != labels
        order = squareform(rankdata(squareform((matrix + matrix.T) / 2, checks=False)))
        points = MDS(
            metric_mds=True, metric="precomputed", init="classical_mds", n_init=1
        ).fit_transform(order)
        named: list[tuple[str, NDArray[np.float64], float, str]] = []
        for count, label in enumerate(
            sorted(np.unique(labels), key=lambda label: -is_missed[labels == label].sum())
        ):
            mine = points[labels == label]
            centre = mine.mean(axis=0)
            lines = np.stack([np.broadcast_to(centre, mine.shape), mine], axis=1)
            place.add_collection(LineCollection([*lines], colors=GREY, lw=0.5, zorder=0))
            if count < 15:  # most wrong matches are of these
                colour = COLOURS[
                    int(np.searchsorted(np.unique(record.labels), label)) % len(COLOURS)
                ]
                named.append((clean_text(label), centre, mine[:, 1].max(), colour))
        _annotate(place, named, points)
        place.plot(*points[is_missed].T, "o", ms=5.5, mfc="none", mew=0.8, color=MISSED)
        addresses = [f"{page}-{file_name(name)}" for name in names.tolist()] if page else None
        colours = np.resize(COLOURS, len(record.labels))[
            np.searchsorted(np.unique(record.labels), labels)
        ]
        place.scatter(points[:, 0], points[:, 1], 9, colours, urls=addresses)
        place.set_title(fill(row.title, 30), fontsize=TITLE_SIZE, parse_math=False)
    return figure


def _annotate(
    place: Axes, named: Sequence[tuple[str, NDArray[np.float64], float, str]], points: Points
) -> None:
    """Write names above their points, in their colours, moved up where they would overlap."""
    height, width = 0.055 * np.ptp(points[:, 1]), 0.03 * np.ptp(points[:, 0])
    taken: list[tuple[float, float, float]] = []
    for name, centre, top, colour in sorted(named, key=lambda each: each[2]):
        x, y, half = centre[0], top + 0.6 * height, len(name) * width / 2
        while any(abs(x - x_) < half + half_ and abs(y - y_) < height for x_, y_, half_ in taken):
            y += height / 4
        taken.append((x, y, half))
        place.annotate(
            name,
            (x, y),
            fontsize=TITLE_SIZE,
            ha="center",
            va="center",
            parse_math=False,
            color=colour,
            weight="bold",
            path_effects=[withStroke(linewidth=2, foreground="white")],
        )


def forms_figure(view: TableView, forms: StoredForms, shapes: Sequence[str] = ()) -> Figure:
    """Draw poses of subjects and their forms, methods across, poses down, each turned to the form of the first pose.

    Parameters
    ----------
    view
        The table.
    forms
        Reader of the forms.
    shapes
        Names of the shapes; by default three poses of the first class. Several subjects are named,
        side by side.

    Raises
    ------
    ConfigurationError
        If there is no such shape, or no form of these shapes is stored.
    """
    records = {
        row.title: of for row, of in first_records(view).items() if row.kind in ("form", "network")
    }
    if not records:
        raise ConfigurationError(
            f"no selected row of table {view.table.identifier} has forms", "select another method"
        )
    return figure_of_records(records, forms, shapes)


def figure_of_records(
    records: Mapping[str, Record], forms: StoredForms, shapes: Sequence[str] = ()
) -> Figure:
    """Draw poses of subjects and their forms, as :func:`forms_figure` does.

    Parameters
    ----------
    records
        Records of one gallery by the title of their method.
    forms, shapes
        See :func:`forms_figure`.

    Raises
    ------
    ConfigurationError
        If there is no such shape, or no form of these shapes is stored.
    """
    first = next(iter(records.values()))
    labels = dict(zip(first.shapes, first.labels, strict=True))
    names = list(shapes) or some_shapes(first)
    check_known("shape", names, labels)
    columns: list[tuple[str, list[Drawn | None]]] = []
    subjects = [*dict.fromkeys(labels[name] for name in names)]
    heads = [*map(clean_text, subjects)] if len(subjects) > 1 else ["Shape"]
    for subject, head in zip(subjects, heads, strict=True):
        poses = [name for name in names if labels[name] == subject]
        columns.append((head, [forms.shape(first, name) for name in poses]))
        columns += [
            (title, [forms.form(record, name) for name in poses])
            for title, record in records.items()
        ]
    columns = [(title, drawn) for title, drawn in columns if any(drawn)]
    if {title for title, _ in columns} <= {*heads}:
        raise ConfigurationError(
            "no forms of these shapes are stored here", "run the methods here, then draw again"
        )
    return _pictures(columns, UPRIGHT if first.input == "mesh" else OBLIQUE)


def _pictures(columns: Sequence[tuple[str, list[Drawn | None]]], camera: Camera) -> Figure:
    """Draw columns of pictures, each column at one scale and with one centre."""
    side = min(WIDTH / len(columns), _TALLEST)
    panels = []
    for title, drawn in columns:
        frame = np.concatenate([each.mesh.vertices for each in drawn if each])
        pictures = [
            each and shaded(each.mesh, camera, round(side * DPI), each.values, frame)
            for each in drawn
        ]
        panels.append((fill(title, round(18 * side)), pictures))
    figure = grid(panels, side)
    for number, (_, drawn) in enumerate(columns):
        for place, each in zip(figure.axes[number :: len(columns)], drawn, strict=False):
            place.text(
                0.5,
                0,
                "mirrored" * (each is not None and each.is_mirrored),
                ha="center",
                fontsize=5,
                transform=place.transAxes,
            )
    return figure


def first_records(view: TableView) -> dict[Row, Record]:
    """Return a record of each row that is shown, all of one gallery, that of most rows."""
    every = {row: one.all_records[0] for row, one in shown_rows(view)}
    gallery = mode(record.gallery for record in every.values()) if every else ""
    return {row: record for row, record in every.items() if record.gallery == gallery}


def _some(values: Sequence[T], most: int) -> list[T]:
    """Return at most ``most`` evenly spaced values, including the first and the last."""
    places = np.unique(np.linspace(0, max(len(values) - 1, 0), min(most, len(values))).astype(int))
    return [values[place] for place in places.tolist()]


def some_shapes(record: Record, n_classes: int = 1, n_shapes: int = 3) -> list[str]:
    """Return some shapes of some classes of a record that have a result."""
    classes: dict[str, list[str]] = {}
    for number in record.answered:
        classes.setdefault(record.labels[number], []).append(record.shapes[number])
    return [
        shape
        for of_class in _some([*classes.values()], n_classes)
        for shape in _some(of_class, n_shapes)
    ]
