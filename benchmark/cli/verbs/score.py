"""``score``: measures of distances that any program computed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from benchmark.cli.options import PathOption, name_skipped
from benchmark.errors import ConfigurationError
from benchmark.text import say, say_lines

if TYPE_CHECKING:
    from benchmark.api.contracts import Input


@click.command()
@click.argument("distances", type=PathOption(), metavar="DISTANCES")
@click.option(
    "--labels",
    required=True,
    type=PathOption(),
    metavar="FILE|FOLDER",
    help="Labels: .cla, lines 'label' or 'name label', or a folder of shapes.",
)
@click.option(
    "--query-labels", type=PathOption(), metavar="FILE|FOLDER", help="Labels of the rows, if they are not the columns."
)
@click.option("--ranked", is_flag=True, help="DISTANCES holds ranked lists: a query and its results per line.")
@click.option(
    "--format",
    "format_",
    type=click.Choice(["markdown", "latex", "csv", "json"]),
    default="markdown",
    show_default=True,
)
@click.option("--title", default="", help="Name of the row. [name of the file]")
@click.option("--results", type=PathOption(), metavar="DIR", help="Also keep it as an external row in this folder.")
@click.option("--dataset", default="", metavar="NAME", help="Data set of that row. [name of the labels]")
@click.option(
    "--input",
    "input_",
    type=click.Choice(["mesh", "view"]),
    default="mesh",
    show_default=True,
    help="Input of that row.",
)
def score(
    distances: Path, labels: Path, query_labels: Path | None, ranked: bool, format_: str, title: str,
    results: Path | None, dataset: str, input_: Input,
) -> None:  # fmt: skip
    """Score a distance matrix or ranked lists of any program.

    DISTANCES is an N x N or queries x gallery matrix: text, CSV, .npy, .npz, .mat, or PSB's .matrix.
    """
    if dataset and results is None:
        raise ConfigurationError("--dataset names the data set of a row that is kept", "pass --results DIR, too")
    from benchmark.external.distances import read_distances, read_ranked
    from benchmark.external.labels import read_labels
    from benchmark.external.printing import FORMATS
    from benchmark.external.scoring import Task, evaluated
    from retrieval.metrics import evaluate_queries

    gallery = read_labels(labels)
    matrix = read_ranked(distances, gallery) if ranked else read_distances(distances)
    task = Task.of(matrix, gallery, read_labels(query_labels) if query_labels else None)
    scores = evaluate_queries(task.answers())
    title = title or distances.stem
    say_lines(FORMATS[format_](title, evaluated(task, scores)))
    if results is not None:
        from benchmark.external.records import keep_distances
        from benchmark.pipeline.storage.store import Store

        store = Store.open(results)
        record = keep_distances(store, task, scores, title, dataset or labels.resolve().stem, input_)
        name_skipped(store)
        name = record["data"]["name"]
        say(f"kept as {record['method']}: 'tables -d {name}' and 'report -d {name}' show it", err=True)
