"""``python -m tools.failures``: draw what each form does to a query of its worst class of TOSCA.

Which query that is, and what was found instead, comes from the published records and their
distances. The shapes come from the folder of the official data sets (``CANONICAL_FORMS_DATA``).
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmark.api.contracts import Shape
from benchmark.datasets.catalogue import open_dataset
from benchmark.defaults import DATA_VARIABLE, DEFAULT_SCORER
from benchmark.geometry.camera import Camera
from benchmark.geometry.preparation import prepare
from benchmark.pipeline.record_arrays import read_distances
from benchmark.pipeline.record_files import read_records
from benchmark.pipeline.records import Record
from benchmark.registry import select_one
from benchmark.report.drawing import shaded
from benchmark.report.figures import MEASURE
from benchmark.report.forms import Drawn, drawn_form, drawn_from, turned_to
from benchmark.report.grids import TEXT_WIDTH, grid
from tools.form_costs import METHODS

RESULTS = Path(__file__).parents[1] / "results"

#: Side of a picture in inches, and size of the names above in points. On a telephone, the three
#: columns are as wide as the screen, and the names stay readable.
SIDE = TEXT_WIDTH / 6
NAME_SIZE = 9

#: Pixels per inch, which say how large a page shows the pictures where it has the room.
PAGE_DPI = 150

#: Drawn shapes are turned as they are looked at.
TOWARDS_VIEWER = Camera((0.0, 0.0, -1.0), (0.0, 1.0, 0.0))


@dataclass(frozen=True)
class Failure:
    """A query whose first match is wrong.

    Parameters
    ----------
    label, score
        Its class, and the mean score of that class.
    query, found
        Names of the query and of its first match.
    right, rank
        Name and rank of the first match of the right class.
    """

    label: str
    score: float
    query: str
    found: str
    right: str
    rank: int


def published_forms() -> dict[str, Record]:
    """Return the published records of complete surfaces of TOSCA by their method."""
    return {
        record.method: record
        for record in read_records(RESULTS, local=False)
        if record.gallery == "tosca" and record.input == "mesh" and record.scorer == DEFAULT_SCORER
    }


def means_of_classes(record: Record) -> dict[str, float]:
    """Return the mean score of the queries of each class."""
    values: dict[str, list[float]] = {}
    for label, value in zip(record.labels, record.per_query[MEASURE], strict=True):
        if value is not None:
            values.setdefault(label, []).append(value)
    return {label: float(np.mean(of_class)) for label, of_class in values.items()}


def failure_of(record: Record) -> Failure:
    """Return the query with the lowest score of the worst class, of those whose match is wrong."""
    matrix = read_distances(RESULTS, record)
    assert matrix is not None, f"{record.method} has no published distances"
    np.fill_diagonal(matrix, np.inf)
    means = means_of_classes(record)
    label = min(means, key=lambda name: means[name])
    answered = record.answered
    names = [record.shapes[number] for number in answered]
    labels = np.array([record.labels[number] for number in answered])
    scores = np.array([record.per_query[MEASURE][number] for number in answered], dtype=float)
    is_missed = (labels == label) & (labels[matrix.argmin(axis=1)] != label)
    query = int(np.where(is_missed, scores, np.inf).argmin())
    order = np.argsort(matrix[query], kind="stable")
    rank = int((labels[order] == label).argmax())
    found, right = names[order[0]], names[order[rank]]
    return Failure(label, means[label], names[query], found, right, rank + 1)


# The pictures
# ------------------------------------------------------------------------------------------------


def figure_of_failure(method: str, failure: Failure) -> Figure:
    """Return a query, its wrong match and the right one, each in a column above its form."""
    first = form_of(method, failure.query)
    columns = []
    for name in (failure.query, failure.found, failure.right):
        form = first
        if name != failure.query:
            form = turned_to(form_of(method, name), first)
        columns.append((name, [picture_of(drawn_shape(name)), picture_of(form)]))
    return grid(columns, SIDE, title_size=NAME_SIZE)


def picture_of(drawn: Drawn) -> object:
    """Return the picture of a shape or form."""
    return shaded(drawn.mesh, TOWARDS_VIEWER, round(SIDE * PAGE_DPI), drawn.values)


@cache
def drawn_shape(name: str) -> Drawn:
    """Return a shape of TOSCA as its camera sees it."""
    shape, camera = prepared_shape(name)
    return drawn_from(shape.mesh, camera)


def form_of(method: str, name: str) -> Drawn:
    """Return the form of a shape of TOSCA, turned as the shape."""
    shape, _ = prepared_shape(name)
    form = select_one(method).create().canonicalise(shape)
    return drawn_form(form.mesh, drawn_shape(name))


@cache
def prepared_shape(name: str) -> tuple[Shape, Camera]:
    """Return a shape of TOSCA as methods get it, and its camera."""
    tosca = open_dataset("tosca", Path(os.environ[DATA_VARIABLE]))
    (entry,) = [entry for entry in tosca.shapes if entry.identifier == name]
    return Shape(identifier=name, mesh=prepare(tosca.load(entry)).mesh), tosca.camera(entry)


def main() -> None:
    """Draw the failures of all forms."""
    from tools.guide_figures import save

    records = published_forms()
    for method in METHODS:
        figure = figure_of_failure(method, failure_of(records[method]))
        save(figure, f"fails-{method}", dpi=PAGE_DPI)


if __name__ == "__main__":
    main()
