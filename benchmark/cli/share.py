"""``merge`` and ``score``: results folders and external distances."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from benchmark.cli.options import name_skipped
from benchmark.cli.plan import scores_in_words
from benchmark.execution.claims import Claims
from benchmark.external.files import read_distances, read_labels, read_ranked
from benchmark.external.records import keep_distances
from benchmark.external.scoring import FORMATS, Task, evaluated
from benchmark.pipeline.storage.merging import job_name, merge_records, publish, records_under
from benchmark.pipeline.storage.store import Store, sweep_leftovers
from benchmark.text import say, say_lines


def merge(folders: Sequence[Path], results: Path, *, published: bool) -> bool:
    """Merge records, and print those that contradict each other."""
    store = Store.open(results)
    is_target = results.resolve().__eq__
    stores = [store if is_target(folder.resolve()) else Store(folder / "runs") for folder in folders]
    try:
        records = [record for source in stores for record in records_under(source)]
    finally:
        name_skipped(*stores)
    with Claims(store.root) as claims:
        merged = publish(records, store.published) if published else merge_records(records, store.records)
        if claims.is_last():
            sweep_leftovers(store)
            if not published:
                store.records.gather()
    name_skipped(store)
    for existing, other in merged.conflicts:
        scores = f"{scores_in_words(existing)} here, {scores_in_words(other)} there"
        say(f"conflict: {job_name(existing)} ({existing['key'][:12]}): {scores}")
    say(f"{len(merged.added)} records added, {merged.known} known, {len(merged.conflicts)} conflicts")
    return not merged.conflicts


def read_task(distances: Path, labels: Path, query_labels: Path | None, *, ranked: bool) -> Task:
    """Read distances or ranked lists, and the classes of their rows and columns."""
    gallery = read_labels(labels)
    matrix = read_ranked(distances, gallery) if ranked else read_distances(distances)
    return Task.of(matrix, gallery, read_labels(query_labels) if query_labels else None)


def score(
    task: Task, title: str, format: str, results: Path | None, dataset: str, input_: Literal["mesh", "view"]
) -> None:
    """Print the measures, and store them as an external row if a folder is given."""
    say_lines(FORMATS[format](title, evaluated(task)))
    if results is not None:
        store = Store.open(results)
        record = keep_distances(store, task, title, dataset, input_)
        name_skipped(store)
        chosen = shlex.join(["-d", record["data"]["name"], "--results", str(results)])
        say(f"kept as {record['method']}: 'tables {chosen}' and 'report {chosen}' show it", err=True)
