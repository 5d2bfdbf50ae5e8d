"""``score``: measures of distances computed by any program."""

from __future__ import annotations

from benchmark.cli.options import Score, name_skipped
from benchmark.errors import ConfigurationError
from benchmark.external.files import read_distances, read_labels, read_ranked
from benchmark.external.records import keep_distances
from benchmark.external.scoring import FORMATS, Task, evaluated
from benchmark.pipeline.storage.store import Store
from benchmark.text import say, say_lines


def score(options: Score) -> None:
    """Print the measures, and store them as an external row if a folder is given."""
    if options.dataset and options.folder is None:
        raise ConfigurationError("--dataset has no effect without --results", "pass --results DIR, too")
    gallery = read_labels(options.labels)
    matrix = read_ranked(options.distances, gallery) if options.ranked else read_distances(options.distances)
    task = Task.of(matrix, gallery, read_labels(options.query_labels) if options.query_labels else None)
    title = options.title or options.distances.stem
    say_lines(FORMATS[options.format](title, evaluated(task)))
    if options.folder is not None:
        store = Store.open(options.folder)
        dataset = options.dataset or options.labels.resolve().stem
        record = keep_distances(store, task, title, dataset, options.input)
        name_skipped(store)
        name = record["data"]["name"]
        say(f"kept as {record['method']}: 'tables -d {name}' and 'report -d {name}' show it", err=True)
