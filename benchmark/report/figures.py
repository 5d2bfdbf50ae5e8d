"""Figures for papers and pages, drawn by matplotlib from records and stored forms."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from statistics import mode
from textwrap import fill
from typing import NamedTuple, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from pandas import DataFrame, Series, concat
from PIL import Image
from scipy.spatial.distance import squareform
from scipy.stats import rankdata
from sklearn.manifold import MDS

from benchmark.depth.frame import UPRIGHT
from benchmark.errors import ConfigurationError, check_known
from benchmark.geometry.camera import Camera
from benchmark.geometry.mesh import Points
from benchmark.pipeline.record_arrays import read_distances
from benchmark.pipeline.records import Record
from benchmark.report.drawing import OBLIQUE, shaded
from benchmark.report.forms import Drawn, StoredForms
from benchmark.report.grids import (
    DPI,
    LETTERS_PER_INCH,
    ON_WHITE,
    TEXT_WIDTH,
    TITLE_SIZE,
    grid,
    usual_style,
)
from benchmark.report.notation import file_name
from benchmark.report.rows import RowScores, TableRow
from benchmark.report.table_view import TableView
from benchmark.text import brief, clean_text

_Value = TypeVar("_Value")

#: Side in inches of a picture in a figure of forms, at most.
_LARGEST_SIDE = 0.85

#: Maps beside each other, at most, and the side of one in inches.
_MAPS_ACROSS = 3
_LARGEST_MAP = 4.0

#: Room for the title of a map in inches, and letters on each of its lines.
_TITLE_ROOM = 0.2
_TITLE_LETTERS = 30

#: Letters of the name of a class in a map.
_NAME_LETTERS = 20

#: Height and width of a letter on a map, as shares of the extents of its points.
_LETTER_HEIGHT = 0.055
_LETTER_WIDTH = 0.03

#: Size in points of remarks below pictures, and their height in inches.
_REMARK_SIZE = 6
_REMARK_HEIGHT = 0.12

#: Classes whose names stand in a map, at most: those with the most wrong matches.
_NAMED_CLASSES = 15

#: Heights, a quarter of a letter apart, that are tried so that the name of a class covers no point.
_TRIED_HEIGHTS = 8

#: Measure of pages and figures that show one.
MEASURE = "DCG"

#: Colours of classes and of their names, in turn: contrast with white of at least 4.5, as WCAG asks
#: of text.
COLOURS = (
    "#3a6ea5",
    "#bb4a33",
    "#347d55",
    "#8a5fa8",
    "#9c6b14",
    "#0f7a87",
    "#b0457f",
    "#66751c",
    "#5b5b5b",
    "#222222",
)

#: Colour of lines.
GREY = "#737373"

#: Colour of a shape whose nearest match is wrong.
MISSED = "#8c2318"


def rows_of_figures(view: TableView) -> list[tuple[TableRow, RowScores]]:
    """Return the rows that a figure draws, each with its scores in one column of the table.

    They are those of the first column in which the row has scores. The title of a row names this
    column if it is not the first one of the table.
    """
    rows = []
    for row in view.printed_rows:
        titles = [column.title for column in view.columns if column.title in row.scored]
        if not titles:
            continue
        column = titles[0]
        title = row.title
        if column != view.columns[0].title:
            title = f"{title}, {column}"
        rows.append((replace(row, title=clean_text(title)), row.scored[column]))
    return rows


def class_means(view: TableView) -> DataFrame:
    """Return the mean of each class that all rows rank, by row, the hardest class first.

    Classes of one name are the same: folds share those of their data set, and no two random draws
    have a subject of the same name.
    """
    rows: dict[str, Series] = {}
    for row, scores in rows_of_figures(view):
        queries = [
            Series(record.per_query[MEASURE], record.labels, float) for record in scores.all_records
        ]
        rows[row.title] = concat(queries).groupby(level=0).mean()
    means = DataFrame(rows).T.rename_axis("method").dropna(axis=1)
    return means[means.mean().sort_values().index]


# Maps
# ------------------------------------------------------------------------------------------------


@usual_style()
def map_figure(view: TableView, forms: StoredForms, page: str = "") -> Figure:
    """Draw a map of the shapes for each method: the nearer two points, the more alike their forms.

    Distances on the map have about the same order as those of the forms. Lines lead from each shape
    to the middle of its class. A ring marks a shape whose nearest match is of another class.

    Parameters
    ----------
    view
        The table whose rows are drawn.
    forms
        Reader of the stored forms and distances.
    page
        Address of the page to whose queries the points link; "" for no links.

    Raises
    ------
    ConfigurationError
        If no distances of shapes among each other are stored.
    """
    maps = []
    for row, record in first_records(view).items():
        matrix = read_distances(forms.folder, record)
        if matrix is not None and len(record.sides) == 1:
            maps.append((row, record, matrix))
    if not maps:
        raise ConfigurationError("no distances of this table are stored here", "run it here")
    n_columns = min(len(maps), _MAPS_ACROSS)
    n_rows = math.ceil(len(maps) / n_columns)
    side = min(TEXT_WIDTH / n_columns, _LARGEST_MAP)
    size = n_columns * side, n_rows * (side + _TITLE_ROOM)
    figure = Figure(size, layout="constrained")
    for place in figure.subplots(n_rows, n_columns, squeeze=False).flat:
        place.axis("off")
        place.set_aspect("equal", "datalim")
    for place, (row, record, matrix) in zip(figure.axes, maps, strict=False):
        _draw_map(place, record, matrix, page)
        place.set_title(fill(row.title, _TITLE_LETTERS), fontsize=TITLE_SIZE, parse_math=False)
    return figure


def _draw_map(place: Axes, record: Record, matrix: NDArray[np.float64], page: str) -> None:
    """Draw the shapes as points on the map of one method; see :func:`map_figure`.

    Parameters
    ----------
    place
        Axes to draw into.
    record
        Names and classes of all shapes, and which n of them have a form.
    matrix
        Distances between these, shape (n, n).
    page
        Address to which the points link; "" for no links.
    """
    labels = np.array(record.labels)[record.answered]
    # A shape is missed if the nearest other shape is of another class.
    without_itself = matrix + np.diag(np.full(len(matrix), np.inf))
    is_missed = labels[without_itself.argmin(axis=1)] != labels
    points = _positions(matrix)
    classes = np.unique(record.labels)
    class_colours = np.resize(COLOURS, len(classes))  # repeated if there are more classes

    # There is room to name some classes: those with the most missed shapes.
    by_misses = sorted(np.unique(labels), key=lambda label: -is_missed[labels == label].sum())
    names = []
    for number, label in enumerate(by_misses):
        of_class = points[labels == label]
        centre = of_class.mean(axis=0)
        _draw_lines(place, centre, of_class)
        if number < _NAMED_CLASSES:
            colour = str(class_colours[np.searchsorted(classes, label)])
            name = brief(label, _NAME_LETTERS)
            names.append(_ClassName(name, centre[0], of_class[:, 1].max(), colour))
    _write_names(place, names, points)

    place.plot(*points[is_missed].T, "o", ms=5.5, mfc="none", mew=0.8, color=MISSED)
    addresses = None
    if page:
        addresses = [f"{page}-{file_name(record.shapes[shape])}" for shape in record.answered]
    colours = class_colours[np.searchsorted(classes, labels)]
    place.scatter(points[:, 0], points[:, 1], 9, colours, urls=addresses)


def _positions(matrix: NDArray[np.float64]) -> Points:
    """Return points in the plane, shape (n, 2), whose distances have the order of a matrix."""
    if len(matrix) == 1:  # which has no distances to keep
        return np.zeros((1, 2))
    symmetric = (matrix + matrix.T) / 2
    ranks = rankdata(squareform(symmetric, checks=False))
    scaling = MDS(metric_mds=True, metric="precomputed", init="classical_mds", n_init=1)
    return np.asarray(scaling.fit_transform(squareform(ranks)))


class _ClassName(NamedTuple):
    """The name of a class in a map: where its middle and its top are, and its colour."""

    text: str
    middle: float
    top: float
    colour: str


def _draw_lines(place: Axes, centre: NDArray[np.float64], points: Points) -> None:
    """Draw a thin line from a centre to each of some points, below all points."""
    lines = np.stack([np.broadcast_to(centre, points.shape), points], axis=1)
    place.add_collection(LineCollection([*lines], colors=GREY, lw=0.5, zorder=0))


def _write_names(place: Axes, names: Sequence[_ClassName], points: Points) -> None:
    """Write the names of classes above their points, moved up where they would overlap.

    A name moves up a little to cover no point, and as far as needed to overlap no other name.

    Parameters
    ----------
    place
        Axes to write into.
    names
        Text, position and colour of each name.
    points
        All points of the map, shape (n, 2). Their extent tells how large letters are on the map.
    """
    height = _LETTER_HEIGHT * np.ptp(points[:, 1])
    letter_width = _LETTER_WIDTH * np.ptp(points[:, 0])
    taken: list[tuple[float, float, float]] = []  # middle, height and half width of each name
    for name in sorted(names, key=lambda name: name.top):
        half_width = len(name.text) * letter_width / 2
        x = name.middle
        lowest = name.top + 0.6 * height  # just above the highest point of the class
        heights = _free_heights(x, lowest, half_width, height, taken)
        beside = points[np.abs(points[:, 0] - x) < half_width, 1]
        clear = [y for y in heights if np.all(np.abs(beside - y) >= 0.75 * height)]
        y = (clear or heights)[0]
        taken.append((x, y, half_width))
        place.annotate(
            name.text,
            (x, y),
            fontsize=TITLE_SIZE,
            ha="center",
            va="center",
            parse_math=False,
            color=name.colour,
            weight="bold",
            path_effects=[withStroke(linewidth=2, foreground="white")],
        )


def _free_heights(
    x: float,
    lowest: float,
    half_width: float,
    height: float,
    taken: Sequence[tuple[float, float, float]],
) -> list[float]:
    """Return the lowest heights at which a name overlaps no other one.

    Parameters
    ----------
    x, lowest
        Middle of the name, and the first height to try.
    half_width, height
        Half the width of the name, and its height.
    taken
        Middle, height and half width of each other name.
    """
    free: list[float] = []
    y = lowest
    while len(free) < _TRIED_HEIGHTS:
        if not any(_overlaps(x, y, half_width, height, other) for other in taken):
            free.append(y)
        y += height / 4
    return free


def _overlaps(
    x: float, y: float, half: float, height: float, other: tuple[float, float, float]
) -> bool:
    """Return whether a name of this middle, half width and height overlaps another one."""
    other_x, other_y, other_half = other
    return bool(abs(x - other_x) < half + other_half and abs(y - other_y) < height)


# Forms
# ------------------------------------------------------------------------------------------------


def forms_figure(view: TableView, forms: StoredForms, shapes: Sequence[str] = ()) -> Figure:
    """Draw poses of subjects (rows) and the forms that methods make of them (columns).

    Each form is turned to that of the first pose.

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
    # What compares itself, as a descriptor or distances of another program, has no scorer.
    records = {row.title: record for row, record in first_records(view).items() if record.scorer}
    if not records:
        raise ConfigurationError(
            f"no selected row of table {view.table.identifier} has forms", "select another method"
        )
    return figure_of_records(records, forms, shapes)


@usual_style()
def figure_of_records(
    records: Mapping[str, Record], forms: StoredForms, shapes: Sequence[str] = ()
) -> Figure:
    """Draw poses of subjects and the forms that methods make of them.

    Each subject has a column with its shapes, and one for each method with their forms.

    Parameters
    ----------
    records
        Records of one gallery by the title of their method.
    forms
        Reader of the stored forms.
    shapes
        Names of the shapes; by default three poses of the first class.

    Raises
    ------
    ConfigurationError
        If there is no such shape, or no form of these shapes is stored.
    """
    first = next(iter(records.values()))
    labels = dict(zip(first.shapes, first.labels, strict=True))
    names = list(shapes) or some_shapes(first)
    check_known("shape", names, labels)
    subjects = list(dict.fromkeys(labels[name] for name in names))

    columns: list[_Column] = []
    has_forms = False
    for subject in subjects:
        poses = [name for name in names if labels[name] == subject]
        heading = clean_text(subject) if len(subjects) > 1 else "Shape"
        columns.append(_Column(heading, [forms.shape(first, name) for name in poses]))
        for title, record in records.items():
            column = _Column(title, [forms.form(record, name) for name in poses])
            columns.append(column)
            has_forms = has_forms or any(column.drawn)
    if not has_forms:
        raise ConfigurationError(
            "no forms of these shapes are stored here", "run the methods here, then draw again"
        )
    columns = [column for column in columns if any(column.drawn)]  # leave out empty ones
    return _pictures(columns, UPRIGHT if first.input == "mesh" else OBLIQUE)


class _Column(NamedTuple):
    """A column of pictures below its title; None is no picture."""

    title: str
    drawn: list[Drawn | None]


def _pictures(columns: Sequence[_Column], camera: Camera) -> Figure:
    """Draw columns of surfaces; those of a column have one scale and one centre.

    Parameters
    ----------
    columns
        Title and surfaces of each column; None where there is nothing to draw.
    camera
        Direction from which all are seen.
    """
    side = min(TEXT_WIDTH / len(columns), _LARGEST_SIDE)  # inches
    panels = []
    for column in columns:
        # Each picture has room for all surfaces of the column.
        frame = np.concatenate([surface.mesh.vertices for surface in column.drawn if surface])
        n_pixels = round(side * DPI)
        pictures = [_picture(surface, camera, n_pixels, frame) for surface in column.drawn]
        title = fill(column.title, round(LETTERS_PER_INCH * side))
        panels.append((title, pictures))
    drawn = chain.from_iterable(column.drawn for column in columns)
    has_remarks = any(surface.is_mirrored for surface in drawn if surface)
    figure = grid(panels, side, _REMARK_HEIGHT if has_remarks else 0.0)
    for number, column in enumerate(columns):
        axes_of_column = figure.axes[number :: len(columns)]
        for place, surface in zip(axes_of_column, column.drawn, strict=False):
            if surface and surface.is_mirrored:
                _write_remark(place, "mirrored")
    return figure


def _write_remark(place: Axes, remark: str) -> None:
    """Write a remark below a picture."""
    place.text(
        0.5,
        0,
        remark,
        ha="center",
        va="top",
        fontsize=_REMARK_SIZE,
        transform=place.transAxes,
        bbox=ON_WHITE,
    )


def _picture(drawn: Drawn | None, camera: Camera, size: int, frame: Points) -> Image.Image | None:
    """Return the picture of a surface that has room for some points; None without a surface."""
    if drawn is None:
        return None
    return shaded(drawn.mesh, camera, size, drawn.values, frame)


def first_records(view: TableView) -> dict[TableRow, Record]:
    """Return a record of each row of figures, all of one gallery, that of most rows."""
    records = {row: scores.all_records[0] for row, scores in rows_of_figures(view)}
    if not records:
        return {}
    gallery = mode(record.gallery for record in records.values())
    return {row: record for row, record in records.items() if record.gallery == gallery}


def some_shapes(record: Record, n_classes: int = 1, n_shapes: int = 3) -> list[str]:
    """Return some shapes of some classes of a record that have a result."""
    classes: dict[str, list[str]] = {}
    for number in record.answered:
        classes.setdefault(record.labels[number], []).append(record.shapes[number])
    shapes: list[str] = []
    for of_class in _evenly_spaced([*classes.values()], n_classes):
        shapes += _evenly_spaced(of_class, n_shapes)
    return shapes


def _evenly_spaced(values: Sequence[_Value], most: int) -> list[_Value]:
    """Return at most ``most`` evenly spaced values, including the first and the last."""
    last = max(len(values) - 1, 0)
    places = np.unique(np.linspace(0, last, min(most, len(values))).astype(int))
    return [values[place] for place in places.tolist()]
