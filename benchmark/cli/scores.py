"""``score``: print the scores of distances of another program, and keep them as a row."""

from __future__ import annotations

import json
import shlex
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from benchmark.commands.score import Evaluation, score
from benchmark.errors import ConfigurationError
from benchmark.text import say, say_lines

if TYPE_CHECKING:
    from pandas import DataFrame

    from benchmark.api.contracts import Input


def print_scores_of_file(
    distances: Path,
    labels: Path,
    order: str,
    gallery: Path | None,
    title: str,
    dataset: str,
    format: str,
    input_: Input | None,
) -> None:
    """Print the scores of distances in a file; refuse options of a row that is kept."""
    if dataset or input_:
        option = "--dataset names the data" if dataset else "--input names the input"
        raise ConfigurationError(f"{option} of a row that is kept", "pass --results, too")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # these are among the notes
        evaluation = score(distances, labels, order, gallery)
    _print_evaluation(evaluation, title, format)


def print_kept_scores(
    distances: Path,
    labels: Path,
    order: str,
    gallery: Path | None,
    title: str,
    dataset: str,
    format: str,
    results: Path,
    input_: Input,
) -> None:
    """Score the distances in a file, print the scores, and keep them as a row of the tables.

    Parameters
    ----------
    distances
        File with a matrix of distances.
    labels
        File with the class of each shape, or folder of shapes.
    order
        Order of rows without names, such as ``"natural"``; "" if there is one only.
    gallery
        File with the classes of other columns, with which a row cannot be kept; None for none.
    title
        Title of the row.
    dataset
        Name of the data set beside whose rows it stands.
    format
        ``"csv"``, ``"json"``, ``"latex"``, or text for people.
    results
        The results folder.
    input_
        Whether the distances are of surfaces or of views.

    Raises
    ------
    ConfigurationError
        If another gallery is given, or the distances cannot be scored or kept.
    """
    from benchmark.commands.external_rows import score_and_keep  # whose rows need the runner

    if gallery is not None:
        raise ConfigurationError(
            "a row that is kept has the queries as its gallery", "omit --gallery or --results"
        )
    evaluation, record = score_and_keep(
        distances, labels, order, results=results, title=title, dataset=dataset, input=input_
    )
    _print_evaluation(evaluation, title, format)
    chosen = shlex.join(["-d", record.data.name, "--results", str(results)])
    say(f"kept as {record.method}: 'tables {chosen}' and 'report {chosen}' show it", err=True)


def _print_evaluation(evaluation: Evaluation, title: str, format: str) -> None:
    """Print scores in a format, and notes on them on stderr.

    Parameters
    ----------
    evaluation
        The scores.
    title
        What they are called.
    format
        ``"csv"``, ``"json"``, ``"latex"``, or text for people.
    """
    for note in evaluation.notes:
        say(note, err=True)
    scores = evaluation.scores.rename_axis(title)
    if format == "csv":
        say_lines(scores.to_csv(float_format="%.6f"))
    elif format == "json":
        say_lines(_as_json(scores, title, len(evaluation.queries)))
    elif format == "latex":
        from benchmark.report.formats import latex_of_scores

        say_lines("\n".join(latex_of_scores(title, scores["score"])))
    else:
        from benchmark.report.notation import two_decimals

        say_lines(scores.map(two_decimals).to_string())


def _as_json(scores: DataFrame, title: str, n_shapes: int) -> str:
    """Return scores as JSON, with null for what does not exist."""
    rounded = scores.round(6).astype(object).where(scores.notna(), None)
    content = {"title": title, "n_shapes": n_shapes, **rounded.T.to_dict()}
    return json.dumps(content, indent=1)
