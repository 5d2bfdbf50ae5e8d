"""Figures for papers and pages, drawn by matplotlib from records and stored forms."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import mode
from textwrap import fill

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pandas import DataFrame
from scipy.spatial.distance import squareform
from scipy.stats import rankdata
from sklearn.manifold import MDS

from benchmark.depth.frame import UPRIGHT
from benchmark.errors import ConfigurationError, did_you_mean
from benchmark.files import write_atomically
from benchmark.geometry.camera import Camera
from benchmark.pipeline.records import Record, read_distances
from benchmark.protocols.tables import Kind
from benchmark.reference.paper import MEASURES
from benchmark.report.drawing import OBLIQUE, shaded
from benchmark.report.formats import hundredths
from benchmark.report.forms import Drawn, StoredForms, spread_of_forms
from benchmark.report.frames import file_name
from benchmark.report.sheets import spread
from benchmark.report.tables import Row, Scored, TableView
from benchmark.report.verdicts import TOLERANCE
from benchmark.text import clean

#: Widths in inches of one column and of the text of a two-column paper.
COLUMN, WIDTH = 3.5, 7.16

#: Pixels per inch that papers ask for.
DPI = 300

#: Side in inches of a picture in a figure of forms, at most, and height of the titles above them.
_TALLEST, _HEAD = 0.85, 0.44

#: Maps side by side in a figure, and title of the shapes beside forms.
_ACROSS, _ITSELF = 3, "Shape"

#: Most classes whose means are printed on a chart of classes; the names of more stand upright.
_UPRIGHT = 24

#: Classes that are named on a map: those with most wrong matches.
_NAMED = 15

#: Smallest class, and fewest points, of which a chart of precision, or of the paper's scores, is drawn.
_FEWEST_SHAPES, _FEWEST_POINTS = 5, 8

#: Measure of charts that show one.
MEASURE = "DCG"

#: Colours of blocks, and of lines beside them: contrast with white of at least 3, as WCAG asks of graphics.
COLOURS: Mapping[Kind, str] = {"form": "#3a6ea5", "network": "#c8553d", "descriptor": "#3d8a5f", "external": "#777777"}
GREY = "#737373"

#: Colour of a shape whose nearest match is wrong.
MISSED = "#8c2318"

#: Least seconds that are drawn: shorter ones are not measured.
FASTEST = 1e-3

#: Levels of recall at which precision is interpolated.
RECALLS = np.round(np.arange(1, 21) * 0.05, 2)

_SIZE, _MARKERS, _DASHES = 7, "os^DvP<X>*ph", ("-", "--", "-.", ":")
_STYLE = {"axes.labelsize": _SIZE, "axes.titlesize": _SIZE, "axes.spines.top": False, "axes.spines.right": False,
          "xtick.labelsize": _SIZE, "ytick.labelsize": _SIZE}  # fmt: skip

#: Metadata by file extension, without the date and the version of matplotlib.
_UNDATED: dict[str, dict[str, str | None]] = {
    ".png": {"Software": None},
    ".pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    ".svg": {"Date": None, "Creator": None},
}

#: File extensions of figures.
ENDINGS = tuple(_UNDATED)


def shown_rows(view: TableView) -> list[tuple[Row, Scored]]:
    """Return printed rows with their scores in the first column that has some; titles name another than the table's."""
    found = []
    for row in view.printed_rows:
        if column := next((column.title for column in view.columns if column.title in row.scored), ""):
            title = row.title if column == view.columns[0].title else f"{row.title}, {column}"
            found.append((replace(row, title=clean(title)), row.scored[column]))
    return found


def scores_figure(view: TableView) -> Figure:
    """Draw the scores of a table with their intervals over classes (95 %), and seconds a shape, one line a row.

    Hollow diamonds are the paper's scores; no row is both faster and better than those of full circles of seconds.
    """
    titles = [column.title for column in view.columns]
    rows = [
        row for row in view.printed_rows[::-1] if row.method in view.paper or not row.scored.keys().isdisjoint(titles)
    ]
    figure, axes = subplots(WIDTH, 0.55 + 0.16 * len(rows), n_columns=len(titles) + 1, sharey=True)
    for place, title in zip(axes[0], titles, strict=False):
        for height, row in enumerate(rows):
            if one := row.scored.get(title):
                place.plot(one.intervals[MEASURE], [height, height], color=COLOURS[row.kind], lw=1.2)
                place.plot(one.means[MEASURE], height, "o", ms=3.5, color=COLOURS[row.kind])
            if printed := view.paper.get(row.method):
                place.plot(printed[MEASURE], height, "D", ms=3.5, mew=0.8, mfc="none", color=COLOURS[row.kind])
        place.axvline(view.chance[title][MEASURE], color=GREY, lw=0.8, ls="--", zorder=0)
        place.set(xlim=(None, 1.02), xlabel=f"{MEASURE}, {title}{' (hollow: paper)' if view.paper else ''}")
    cost, best = axes[0, -1], 0.0
    timed = [(max(row.seconds, FASTEST), -one.means[MEASURE], row.method) for row, one in shown_rows(view)
             if row.seconds is not None]  # fmt: skip
    for seconds, score, method in sorted(timed):
        height, row = next((k, row) for k, row in enumerate(rows) if row.method == method)
        face, best = ("none", best) if -score <= best else (COLOURS[row.kind], -score)
        cost.plot(seconds, height, "o" if seconds > FASTEST else "<", ms=3.5, mfc=face, color=COLOURS[row.kind])
    cost.set(xscale="log", xlabel="seconds per shape")
    axes[0, 0].set_yticks(range(len(rows)), [clean(row.title) for row in rows], parse_math=False)
    axes[0, 0].set_ylim(-0.6, len(rows) - 0.4)
    for place in figure.axes:
        place.grid(axis="y", lw=0.3, color="0.85")
        place.tick_params(axis="y", length=0)
    return figure


def classes_figure(view: TableView) -> Figure:
    """Draw the mean of each class by each row; dark is high.

    Raises
    ------
    ConfigurationError
        If no row has scores.
    """
    each = class_means(view)
    if each.empty:
        raise ConfigurationError(f"no row of {view.stem} has scores", "run a method here")
    names = [clean(name) for name in each]
    turn = 0 if len(names) <= 8 else 40 if len(names) <= _UPRIGHT else 90
    figure, ((place,),) = subplots(WIDTH, 0.5 + 0.16 * len(each) + (0.06 * max(map(len, names)) if turn else 0.2))
    place.imshow(each, cmap="Blues", vmin=0, vmax=1.25, aspect="auto")
    place.set_yticks(range(len(each)), each.index, parse_math=False)
    aligned = {"ha": "right" if turn else "center", "va": "center" if turn == 90 else "top"}
    place.set_xticks(range(len(names)), names, rotation=turn, rotation_mode="anchor", parse_math=False, **aligned)
    place.tick_params(length=0)
    if len(names) <= _UPRIGHT:
        for (down, across), score in np.ndenumerate(each):
            place.text(across, down, hundredths(score), ha="center", va="center", fontsize=_SIZE,
                       color="white" if score > 0.75 else "black")  # fmt: skip
    return figure


def class_means(view: TableView) -> DataFrame:
    """Return the mean of each class, from the hardest class to the easiest, by row."""
    each = {
        row.title: DataFrame(of.per_query).groupby(of.labels)[MEASURE].mean() for row, of in first_records(view).items()
    }
    means = DataFrame(each).T.rename_axis("method").dropna(axis=1)
    return means[means.mean().sort_values().index]


def precision_recall_figure(curves: Sequence[tuple[Row, NDArray[np.float64]]]) -> Figure:
    """Draw interpolated precision over recall, a mean over all queries; a refused shape finds nothing.

    Raises
    ------
    ConfigurationError
        If there are no curves.
    """
    if not curves:
        raise ConfigurationError("no distances of classes of five or more shapes are stored here", "run them here")
    figure, ((place,),) = subplots(WIDTH, 3)
    for number, (row, curve) in enumerate(curves):
        place.plot(RECALLS, curve, lw=0.8, mew=0.8, mfc="none", ms=3.5, marker=_MARKERS[number % len(_MARKERS)],
                   markevery=(number % 4, 4), color=COLOURS[row.kind], ls=_DASHES[number % 4],
                   label=fill(row.title, 28), clip_on=False)  # fmt: skip
    place.set(xlim=(0, 1), ylim=(0, 1.02), xlabel="recall", ylabel="precision")
    figure.legend(loc="outside right center", fontsize=_SIZE, frameon=False)
    return figure


def precision_recall(view: TableView, forms: StoredForms) -> list[tuple[Row, NDArray[np.float64]]]:
    """Return rows whose distances are all stored with their mean interpolated precision at :data:`RECALLS`.

    Of classes of fewer than five shapes, a query finds so few that a curve has two or three levels; they have none.
    """
    curves = []
    for row, pairs in _distances(view, forms):
        if all(min(Counter(record.sides[-1].labels).values()) >= _FEWEST_SHAPES for record, _ in pairs):
            curves.append((row, np.mean([_precision(*pair) for pair in pairs], axis=0)))
    return curves


def _distances(view: TableView, forms: StoredForms) -> list[tuple[Row, list[tuple[Record, NDArray[np.float64]]]]]:
    """Return rows whose distances are all stored, with their records and distances."""
    every = [(row, [(of, read_distances(forms.folder, of)) for of in one.all_records]) for row, one in shown_rows(view)]
    stored = [(row, [(of, matrix) for of, matrix in pairs if matrix is not None], len(pairs)) for row, pairs in every]
    return [(row, pairs) for row, pairs, count in stored if len(pairs) == count]


def _precision(record: Record, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean precision of the queries of a record; refused shapes rank nothing and are found by nobody."""
    names, labels = (np.array(values) for values in (record.sides[-1].shapes, record.sides[-1].labels))
    answered, total = record.sides[-1].answered, np.zeros(len(RECALLS))
    for row, query in zip(matrix, record.answered, strict=True):
        others = record.keeps_same_names | (names != record.shapes[query])
        size = np.count_nonzero(others & (labels == record.labels[query]))
        order = np.argsort(row[others[answered]], kind="stable")
        hits = np.cumsum(labels[answered][others[answered]][order] == record.labels[query])
        if size and len(hits):
            precision = np.maximum.accumulate((hits / np.arange(1, len(hits) + 1))[::-1])[::-1]
            places = np.searchsorted(hits, np.ceil(RECALLS * size - 1e-9))
            total += np.where(places < len(hits), precision[np.minimum(places, len(hits) - 1)], 0.0)
    return total / max(sum(record.are_queries), 1)


def paper_figure(view: TableView) -> Figure:
    """Draw our scores over the paper's; those in the band differ by at most :data:`TOLERANCE`.

    Raises
    ------
    ConfigurationError
        If the paper has no scores of these rows.
    """
    rows = [(view.paper[row.method], one.means) for row, one in shown_rows(view) if row.method in view.paper]
    if len(rows) * len(MEASURES) < _FEWEST_POINTS:
        problem = f"the paper has no scores of two rows of {view.stem}"
        raise ConfigurationError(problem, "select Table I, II, III or IV, and more methods")
    figure, ((place,),) = subplots(COLUMN, COLUMN)
    for name, marker in zip(MEASURES, _MARKERS, strict=False):
        theirs, ours = zip(*((printed[name], means[name]) for printed, means in rows), strict=True)
        place.plot(theirs, ours, marker, ms=4, mew=0.8, mfc="none", color=COLOURS["form"], label=name)
    place.fill_between([0, 1], [-TOLERANCE, 1 - TOLERANCE], [TOLERANCE, 1 + TOLERANCE], color="0.9", zorder=0)
    place.set(xlim=(0, 1), ylim=(0, 1), aspect="equal", xlabel="paper", ylabel=view.columns[0].title)
    place.legend(fontsize=_SIZE, frameon=False)
    return figure


def map_figure(view: TableView, forms: StoredForms) -> Figure:
    """Draw the shapes as points whose distances have the order of those of each row, and lines to the mean of a class.

    A ring marks a shape whose nearest match is of another class.

    Raises
    ------
    ConfigurationError
        If no distances of shapes among each other are stored.
    """
    known = [(row, of, matrix) for row, ((of, matrix), *_) in _distances(view, forms) if len(of.sides) == 1]
    if not known:
        raise ConfigurationError("no distances of this table are stored here", "run it here")
    n_columns = min(len(known), _ACROSS)
    n_rows, side = -(-len(known) // n_columns), min(WIDTH / n_columns, 4)
    figure, _ = subplots(n_columns * side, n_rows * (side + 0.2), n_rows, n_columns)
    for place in figure.axes:
        place.axis("off")
        place.set_aspect("equal", "datalim")
    for place, (row, record, matrix) in zip(figure.axes, known, strict=False):
        labels, names = (np.array(of)[record.answered] for of in (record.labels, record.shapes))
        near = matrix + np.diag(np.full(len(matrix), np.inf))
        is_missed = labels[near.argmin(axis=1)] != labels
        order = squareform(rankdata(squareform((matrix + matrix.T) / 2, checks=False)))
        points = MDS(metric_mds=True, metric="precomputed", init="classical_mds", n_init=1).fit_transform(order)
        for count, label in enumerate(sorted(np.unique(labels), key=lambda label: -is_missed[labels == label].sum())):
            mine = points[labels == label]
            centre = mine.mean(axis=0)
            place.plot(*np.stack([np.broadcast_to(centre, mine.shape), mine], axis=1).T, color=GREY, lw=0.5, zorder=0)
            if count < _NAMED:
                place.annotate(clean(label), centre, fontsize=_SIZE, ha="center", va="center", parse_math=False,
                               zorder=0, bbox={"pad": 0.4, "lw": 0, "fc": "white", "alpha": 0.7})  # fmt: skip
        place.plot(*points[is_missed].T, "o", ms=5.5, mfc="none", mew=0.8, color=MISSED)
        # A report makes addresses of queries of these.
        addresses = [f"#{file_name(name)}" for name in names.tolist()]
        place.scatter(points[:, 0], points[:, 1], 9, COLOURS[row.kind], urls=addresses)
        place.set_title(fill(row.title, 30), fontsize=_SIZE, parse_math=False)
    return figure


def forms_figure(
    view: TableView, forms: StoredForms, shapes: Sequence[str] = (), *, superposed: bool = False
) -> tuple[Figure, str]:
    """Draw poses of subjects and their forms, methods across, poses down; return the figure and its caption.

    Parameters
    ----------
    view
        The table.
    forms
        Reader of the forms.
    shapes
        Names of the shapes; by default three poses of the first class. Subjects stand side by side.
    superposed
        Whether to draw all poses of their subjects on top of each other, below the spread where it is kept.

    Raises
    ------
    ConfigurationError
        If there is no such shape, or no form of these shapes is stored.
    """
    records = effect_records(view)
    if not records:
        raise ConfigurationError(f"no selected row of table {view.table.identifier} has forms", "select another method")
    first = next(iter(records.values()))
    labels = dict(zip(first.shapes, first.labels, strict=True))
    names = list(shapes) or some_shapes(first)
    if unknown := [name for name in names if name not in labels]:
        raise did_you_mean("shape", unknown[0], labels)
    columns: list[tuple[str, list[Drawn | None]]] = []
    for subject in dict.fromkeys(labels[name] for name in names):
        poses = [name for name in (labels if superposed else names) if labels[name] == subject]
        columns.append((_ITSELF, [forms.shape(first, name) for name in poses]))
        columns += [(title, [forms.form(record, name) for name in poses]) for title, record in records.items()]
    columns = [(title, drawn) for title, drawn in columns if any(drawn)]
    if {title for title, _ in columns} <= {_ITSELF}:
        raise ConfigurationError("no forms of these shapes are stored here", "run the methods here, then draw again")
    figure = _pictures(columns, UPRIGHT if first.input == "mesh" else OBLIQUE, superposed=superposed)
    for place, (title, _) in zip(figure.axes, columns, strict=False):
        if superposed and title in records and (ratios := spread_of_forms(forms.folder, records[title])) is not None:
            place.text(0.5, 0, hundredths(ratios[0]), ha="center", fontsize=_SIZE, transform=place.transAxes)
    caption = (
        f"Shapes of {view.title} ({'all poses superposed' if superposed else ', '.join(names)}) and their canonical "
        "forms, turned to the form of the first pose of the subject, or mirrored where marked. "
        "The colour shows how far a point is from the centre of the body."
    )
    return figure, caption


def _pictures(columns: Sequence[tuple[str, list[Drawn | None]]], camera: Camera, *, superposed: bool) -> Figure:
    """Draw columns of pictures, each column at one scale and with one centre."""
    n_rows = 1 if superposed else max(len(drawn) for _, drawn in columns)
    side = min(WIDTH / len(columns), _TALLEST)
    figure = Figure((WIDTH, _HEAD + n_rows * side))
    axes = figure.subplots(n_rows, len(columns), squeeze=False)
    figure.subplots_adjust(0, 0, 1, n_rows * side / (_HEAD + n_rows * side), 0, 0)
    for place in figure.axes:
        place.axis("off")
    for places, (title, drawn) in zip(axes.T, columns, strict=True):
        places[0].set_title(fill(title, round(18 * side)), fontsize=_SIZE, parse_math=False)
        frame = np.concatenate([each.mesh.vertices for each in drawn if each])
        pictures = [each and shaded(each.mesh, camera, round(side * DPI), each.values, frame) for each in drawn]
        if superposed:
            mean = np.mean([np.asarray(picture) for picture in pictures if picture], axis=0) / 255
            places[0].imshow(1 - (1 - mean) ** 0.6)  # single poses stay visible
            continue
        for place, picture, each in zip(places, pictures, drawn, strict=False):
            if picture and each:
                place.imshow(np.asarray(picture))
                place.text(0.5, 0, "mirrored" * each.is_mirrored, ha="center", fontsize=5, transform=place.transAxes)
    return figure


def first_records(view: TableView) -> dict[Row, Record]:
    """Return a record of each row that is shown, all of one gallery, that of most rows."""
    every = {row: one.all_records[0] for row, one in shown_rows(view)}
    gallery = mode(record.gallery for record in every.values()) if every else ""
    return {row: record for row, record in every.items() if record.gallery == gallery}


def effect_records(view: TableView) -> dict[str, Record]:
    """Return the first records of rows that make forms, by the title of the row."""
    return {row.title: of for row, of in first_records(view).items() if row.kind in ("form", "network")}


def spread_rows(view: TableView, forms: StoredForms) -> list[tuple[str, ...]]:
    """Return the head, and a row for each method whose spread is kept; see :func:`spread_of_forms`."""
    kept = [(name, of, spread_of_forms(forms.folder, of)) for name, of in effect_records(view).items()]
    rows = [(name, *map(hundredths, found), str(len(of.unsupported))) for name, of, found in kept if found is not None]
    return [("Method", "spread", "or mirrored", "floor", "refused"), *rows]


def some_shapes(record: Record, n_classes: int = 1, n_shapes: int = 3) -> list[str]:
    """Return some shapes of some classes of a record that have a result."""
    classes: dict[str, list[str]] = {}
    for number in record.answered:
        classes.setdefault(record.labels[number], []).append(record.shapes[number])
    return [shape for of_class in spread([*classes.values()], n_classes) for shape in spread(of_class, n_shapes)]


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PDF, PNG or SVG by its extension."""
    write_atomically(path, lambda file: file.write(encode(figure, path.suffix.lower())))


def encode(figure: Figure, ending: str, dpi: int = DPI) -> bytes:
    """Return a figure as PDF, PNG or SVG, without dates; publishers take the fonts (Type 42)."""
    with mpl.rc_context({"svg.hashsalt": "figure", "pdf.fonttype": 42}):
        figure.savefig(file := io.BytesIO(), format=ending[1:], metadata=_UNDATED[ending], dpi=dpi)
    return file.getvalue()


def subplots(
    width: float, height: float, n_rows: int = 1, n_columns: int = 1, *, sharey: bool = False
) -> tuple[Figure, NDArray[np.object_]]:
    """Return a figure of a size in inches, and its axes, shape (n_rows, n_columns)."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        return figure, figure.subplots(n_rows, n_columns, squeeze=False, sharey=sharey)


#: Charts of a table, or of the first of its columns.
CHARTS: Mapping[str, Callable[[TableView, StoredForms], Figure]] = {
    "scores": lambda view, forms: scores_figure(view),
    "classes": lambda view, forms: classes_figure(view),
    "precision-recall": lambda view, forms: precision_recall_figure(precision_recall(view, forms)),
    "paper": lambda view, forms: paper_figure(view),
    "map": map_figure,
}
