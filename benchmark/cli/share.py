"""``merge`` and ``score``: results folders and external distances."""

from __future__ import annotations

import shlex

from benchmark.cli.options import Merge, Score, name_skipped
from benchmark.cli.plan import scores_in_words
from benchmark.errors import ConfigurationError
from benchmark.execution.claims import Claims
from benchmark.external.files import read_distances, read_labels, read_ranked
from benchmark.external.records import keep_distances
from benchmark.external.scoring import FORMATS, Task, evaluated
from benchmark.pipeline.storage.merging import job_name, merge_records, publish, records_under
from benchmark.pipeline.storage.store import Store, sweep_leftovers
from benchmark.text import say, say_lines


def merge(options: Merge) -> bool:
    """Merge records, and print those that contradict each other."""
    store = Store.open(options.results)
    is_target = options.results.resolve().__eq__
    stores = [store if is_target(folder.resolve()) else Store(folder / "runs") for folder in options.folders]
    try:
        records = [record for source in stores for record in records_under(source)]
    finally:
        name_skipped(*stores)
    with Claims(store.root) as claims:
        merged = publish(records, store.published) if options.published else merge_records(records, store.records)
        if claims.is_last():
            sweep_leftovers(store)
            if not options.published:
                store.records.gather()
    name_skipped(store)
    for existing, other in merged.conflicts:
        scores = f"{scores_in_words(existing)} here, {scores_in_words(other)} there"
        say(f"conflict: {job_name(existing)} ({existing['key'][:12]}): {scores}")
    say(f"{len(merged.added)} records added, {merged.known} known, {len(merged.conflicts)} conflicts")
    return not merged.conflicts


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
        chosen = shlex.join(["-d", record["data"]["name"], "--results", str(options.folder)])
        say(f"kept as {record['method']}: 'tables {chosen}' and 'report {chosen}' show it", err=True)
