"""``score``: measures of distances that any program computed."""

from __future__ import annotations

from pathlib import Path

import click

from benchmark.api.contracts import Input
from benchmark.cli.declare import PATH, argument, flag, option
from benchmark.cli.options import name_skipped, verb
from benchmark.errors import ConfigurationError
from benchmark.external.files import read_distances, read_labels, read_ranked
from benchmark.external.records import keep_distances
from benchmark.external.scoring import FORMATS, Task, evaluated
from benchmark.pipeline.storage.store import Store
from benchmark.text import say, say_lines
from retrieval.metrics import evaluate_queries


@verb
def score(
    distances: Path = argument("DISTANCES", type=PATH),
    labels: Path = option(
        "--labels", required=True, type=PATH, metavar="FILE|FOLDER",
        help="Labels: .cla, lines 'label' or 'name label', or a folder of shapes.",
    ),
    query_labels: Path | None = option(
        "--query-labels", type=PATH, metavar="FILE|FOLDER", help="Labels of the rows, if they are not the columns."
    ),
    ranked: bool = flag("--ranked", help="DISTANCES holds ranked lists: a query and its results per line."),
    format_: str = option(
        "--format", type=click.Choice(["markdown", "latex", "csv", "json"]), default="markdown"
    ),
    title: str = option("--title", default="", help="Name of the row. [name of the file]"),
    results: Path | None = option(
        "--results", type=PATH, metavar="DIR", help="Also keep it as an external row in this folder."
    ),
    dataset: str = option("--dataset", default="", metavar="NAME", help="Data set of that row. [name of the labels]"),
    input_: Input = option("--input", type=click.Choice(["mesh", "view"]), default="mesh", help="Input of that row."),
) -> None:  # fmt: skip
    """Score a distance matrix or ranked lists of any program.

    DISTANCES is an N x N or queries x gallery matrix: text, CSV, .npy, .npz, .mat, or PSB's .matrix.
    """
    if dataset and results is None:
        raise ConfigurationError("--dataset has no effect without --results", "pass --results DIR, too")
    gallery = read_labels(labels)
    matrix = read_ranked(distances, gallery) if ranked else read_distances(distances)
    task = Task.of(matrix, gallery, read_labels(query_labels) if query_labels else None)
    scores = evaluate_queries(task.answers())
    title = title or distances.stem
    say_lines(FORMATS[format_](title, evaluated(task, scores)))
    if results is not None:
        store = Store.open(results)
        record = keep_distances(store, task, scores, title, dataset or labels.resolve().stem, input_)
        name_skipped(store)
        name = record["data"]["name"]
        say(f"kept as {record['method']}: 'tables -d {name}' and 'report -d {name}' show it", err=True)
