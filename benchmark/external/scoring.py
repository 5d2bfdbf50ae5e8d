"""Score distances from any source: every query ranks the gallery; with ties, scores are means over their orders."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import ConfigurationError
from benchmark.external.files import SEVERAL, DistanceMatrix, Labels, as_distances, as_labels
from benchmark.report.escaping import csv_text, latex_text, markdown_line, markdown_table, markdown_text, number
from benchmark.report.significance import UNIT, intervals
from retrieval.chance import chance_of_queries
from retrieval.measures import MEASURES
from retrieval.metrics import ASYMMETRY, Query, Scores, evaluate_queries

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Scores of a distance matrix.

    Parameters
    ----------
    scores
        One row for each measure: ``score``, the mean over queries, ``low`` and ``high``, its 95 % interval over
        classes, and ``chance``, the chance level.
    queries
        One row for each query: ``labels`` and each measure; NaN if the gallery has no relevant shape.
    notes
        Warnings: asymmetry, ties, queries that are excluded from means.
    """

    scores: DataFrame
    queries: DataFrame
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Task:
    """Distances with the labels of their rows and columns.

    Parameters
    ----------
    values
        Shape (queries, gallery).
    queries, gallery
        Labels of rows and columns.
    """

    values: NDArray[np.float64]
    queries: Labels
    gallery: Labels

    @property
    def is_square(self) -> bool:
        """Whether queries and gallery are the same shapes in the same order."""
        return self.queries == self.gallery

    @classmethod
    def of(cls, distances: DistanceMatrix, labels: Labels, query_labels: Labels | None = None) -> Task:
        """Join distances and labels.

        Raises
        ------
        ConfigurationError
            If they do not fit together, or the numbers are not distances.
        """
        gallery = labels.of(distances.gallery, "the columns") if distances.gallery else labels
        of_queries = query_labels or (labels if distances.queries else gallery)
        queries = of_queries.of(distances.queries, "the rows") if distances.queries else of_queries
        shape = (len(queries.classes), len(gallery.classes))
        if distances.values.shape != shape:
            raise ConfigurationError(
                f"the distances have shape {distances.values.shape}, and the labels are of {shape[0]} queries and "
                f"{shape[1]} shapes of the gallery",
                "pass one label per row and column, and --query-labels if the rows have other labels",
            )
        task = cls(np.array(distances.values, dtype=np.float64), queries, gallery)
        task._check()
        return task

    def _check(self) -> None:
        values = self.values
        if self.is_square:
            own = values.diagonal()
            if (own > 0).all() and (own >= values.max(axis=1)).all() and (own > values.min(axis=1)).any():
                raise ConfigurationError("each shape is farthest from itself", "pass distances, not similarities")
            np.fill_diagonal(values, 0.0)
        wrong = np.argwhere(~np.isfinite(values))
        if len(wrong):
            row, column = (int(place) for place in wrong[0])
            raise ConfigurationError(
                f"{len(wrong)} distances are NaN or infinite, the first in row {row + 1}, column {column + 1}",
                "use a distance larger than all others if a method has no result",
            )
        if values.min() < -ASYMMETRY * np.abs(values).max():
            raise ConfigurationError(
                f"a distance is negative ({values.min():.3g})", "subtract similarities from the largest one"
            )

    def answers(self) -> Iterator[Query]:
        """Yield the results of each query, without the query itself."""
        known = {label: n for n, label in enumerate(dict.fromkeys(c for of in self.gallery.classes for c in of))}
        members = np.zeros((len(self.gallery.classes), len(known)), dtype=np.bool_)
        for place, classes in enumerate(self.gallery.classes):
            members[place, [known[label] for label in classes]] = True
        places = {name: place for place, name in enumerate(self.gallery.names)}
        for row, classes in enumerate(self.queries.classes):
            shared = members[:, [known[label] for label in classes if label in known]]
            relevant = np.logical_or.reduce(shared, axis=1)
            own = places.get(self.queries.names[row]) if self.queries.names else None
            own = row if self.is_square else own
            others = np.arange(len(relevant)) != (-1 if own is None else own)
            yield Query(self.values[row, others], relevant[others])

    def chance(self) -> dict[str, float]:
        """Return the chance levels: the expected measures of a random ranking."""
        sizes = np.array([(len(query.relevant), query.relevant.sum()) for query in self.answers()])
        return chance_of_queries(sizes[:, 0], sizes[:, 1])

    def notes(self, scores: Scores) -> Iterator[str]:
        """Yield warnings."""
        skew = np.abs(self.values - self.values.T).max() if self.is_square else 0.0
        if skew > ASYMMETRY * self.values.max():
            share = skew / self.values.max()
            yield f"The matrix is not symmetric (by {share:.2g} of its largest distance): rows are queries."
        if scores.tied_queries:
            yield f"{scores.tied_queries} queries have ties that matter; scores are means over their orders."
        if scores.lone_queries:
            yield f"{scores.lone_queries} queries have no relevant shape and count in no mean."


def score(distances: object, labels: object, query_labels: object = None) -> Evaluation:
    """Score distances computed by any program.

    Parameters
    ----------
    distances
        Shape (N, N), or (queries, gallery); an array, a pandas frame whose index and columns name the shapes, or the
        path of a file. In a square matrix the diagonal is ignored.
    labels
        Label of each shape of the gallery, or several in a list; a mapping from names; or the path of a ``.cla`` file,
        a text file or a folder of shapes.
    query_labels
        Labels of the rows, if they differ from those of the gallery. A query whose name is also in the gallery is not
        its own result.

    Returns
    -------
    Evaluation
        Measures with intervals and chance levels, over all queries and for each query.

    Raises
    ------
    ConfigurationError
        If sizes or names do not fit, or a number is NaN, infinite or negative.

    Examples
    --------
    >>> import benchmark
    >>> distances = [[0, 1, 4, 3], [1, 0, 5, 2], [4, 5, 0, 1], [3, 2, 1, 0]]
    >>> benchmark.score(distances, ["cat", "cat", "dog", "dog"]).scores.loc["NN", "score"]
    1.0
    """
    task = Task.of(
        as_distances(distances), as_labels(labels), None if query_labels is None else as_labels(query_labels)
    )
    return evaluated(task)


def evaluated(task: Task) -> Evaluation:
    """Return measures, intervals and chance levels of a task."""
    from pandas import DataFrame

    scores = evaluate_queries(task.answers())
    names = [measure.name for measure in MEASURES]
    values = np.column_stack([scores.per_query[name] for name in names])
    ends = intervals(np.rint(values / UNIT), [tuple(sorted(classes)) for classes in task.queries.classes])
    chance = task.chance()
    table = {
        "score": [scores.means[name] for name in names],
        "low": ends[:, 0],
        "high": ends[:, 1],
        "chance": [chance[name] for name in names],
    }
    index: Sequence[object] = task.queries.names or range(1, len(values) + 1)
    labels = [SEVERAL.join(classes) for classes in task.queries.classes]
    queries = DataFrame({"labels": labels, **scores.per_query}, index=list(index))
    notes = list(task.notes(scores))
    if ends[names.index("mAP"), 1] < chance["mAP"]:
        notes.append("mAP is below chance: if these are similarities, subtract them from the largest one.")
    return Evaluation(DataFrame(table, index=names), queries.rename_axis("query"), tuple(notes))


def _markdown(title: str, evaluation: Evaluation) -> str:
    cells = [[markdown_text(row[0]), *row[1:]] for row in _rows(title, evaluation)]
    notes = [f"- {markdown_line(note)}" for note in evaluation.notes]
    head = [f"{len(evaluation.queries)} queries", *evaluation.scores.index]
    table = markdown_table(head, cells, aligned=True)
    return "\n".join([table, *([""] if notes else []), *notes]) + "\n"


def _latex(title: str, evaluation: Evaluation) -> str:
    """Return a ``tabular`` of the package booktabs."""
    head = " & ".join(["Method", *evaluation.scores.index])
    rows = [" & ".join([latex_text(row[0]), *row[1:]]) + r" \\" for row in _rows(title, evaluation)]
    columns = "l" + "r" * len(evaluation.scores)
    body = [rf"\begin{{tabular}}{{{columns}}}", r"\toprule", rf"{head} \\", r"\midrule", *rows, r"\bottomrule"]
    return "\n".join([*(f"% {note}" for note in evaluation.notes), *body, r"\end{tabular}"]) + "\n"


def _rows(title: str, evaluation: Evaluation) -> list[list[str]]:
    table = evaluation.scores
    ends = [f"{number(low)}-{number(high)}" for low, high in zip(table["low"], table["high"], strict=True)]
    return [[title, *map(number, table["score"])], ["95 % interval", *ends], ["Chance", *map(number, table["chance"])]]


def _flat(title: str, evaluation: Evaluation) -> dict[str, object]:
    columns = {"score": "{}", "low": "low_{}", "high": "high_{}", "chance": "chance_{}"}
    figures = {
        pattern.format(measure): round(float(value), 6)
        for column, pattern in columns.items()
        for measure, value in evaluation.scores[column].items()
    }
    return {"title": title, **figures, "n_queries": len(evaluation.queries)}


def _json(title: str, evaluation: Evaluation) -> str:
    return json.dumps({**_flat(title, evaluation), "notes": list(evaluation.notes)}, indent=1) + "\n"


def _csv(title: str, evaluation: Evaluation) -> str:
    row = _flat(title, evaluation)
    return csv_text(list(row), [row])


#: Functions that format an evaluation, given the title of its row, by name of the format.
FORMATS: Mapping[str, Callable[[str, Evaluation], str]] = {
    "markdown": _markdown,
    "latex": _latex,
    "csv": _csv,
    "json": _json,
}
