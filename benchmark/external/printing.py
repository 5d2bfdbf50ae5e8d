"""An evaluation as text, JSON, CSV and LaTeX."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping

from benchmark.external.scoring import Evaluation
from benchmark.report.escaping import csv_text, latex_text, markdown_line, markdown_table, markdown_text
from benchmark.report.rounding import number


def markdown(title: str, evaluation: Evaluation) -> str:
    """A table with a row for the scores, their intervals and chance, and the notes below."""
    measures = list(evaluation.scores.index)
    cells = [[markdown_text(row[0]), *row[1:]] for row in _rows(title, evaluation)]
    notes = [f"- {markdown_line(note)}" for note in evaluation.notes]
    lines = markdown_table([f"{len(evaluation.queries)} queries", *measures], cells, aligned=True)
    return "\n".join([*lines, *([""] if notes else []), *notes]) + "\n"


def latex(title: str, evaluation: Evaluation) -> str:
    """The same as a ``tabular`` of the package booktabs."""
    head = " & ".join(["Method", *evaluation.scores.index])
    rows = [" & ".join([latex_text(row[0]), *row[1:]]) + r" \\" for row in _rows(title, evaluation)]
    columns = "l" + "r" * len(evaluation.scores)
    body = [rf"\begin{{tabular}}{{{columns}}}", r"\toprule", rf"{head} \\", r"\midrule", *rows, r"\bottomrule"]
    return "\n".join([*(f"% {note}" for note in evaluation.notes), *body, r"\end{tabular}"]) + "\n"


def _rows(title: str, evaluation: Evaluation) -> list[list[str]]:
    table = evaluation.scores
    ends = [f"{number(low)}-{number(high)}" for low, high in zip(table["low"], table["high"], strict=True)]
    return [
        [title, *map(number, table["score"])],
        ["95 % interval", *ends],
        ["Chance", *map(number, table["chance"])],
    ]


def _flat(title: str, evaluation: Evaluation) -> dict[str, object]:
    columns = {"score": "{}", "low": "low_{}", "high": "high_{}", "chance": "chance_{}"}
    figures = {
        pattern.format(measure): round(float(value), 6)
        for column, pattern in columns.items()
        for measure, value in evaluation.scores[column].items()
    }
    return {"title": title, **figures, "n_queries": len(evaluation.queries)}


def as_json(title: str, evaluation: Evaluation) -> str:
    """One object with the measures, their intervals, chance, and the notes."""
    return json.dumps({**_flat(title, evaluation), "notes": list(evaluation.notes)}, indent=1) + "\n"


def as_csv(title: str, evaluation: Evaluation) -> str:
    """A heading and one line."""
    row = _flat(title, evaluation)
    return csv_text(list(row), [row])


FORMATS: Mapping[str, Callable[[str, Evaluation], str]] = {
    "markdown": markdown,
    "latex": latex,
    "csv": as_csv,
    "json": as_json,
}
