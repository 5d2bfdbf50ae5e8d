"""``gather``: records in a few files."""

from __future__ import annotations

from pathlib import Path

import click

from benchmark.cli.options import name_skipped, results_option
from benchmark.errors import ConfigurationError
from benchmark.system.text import say


@click.command()
@click.option("--published", is_flag=True, help="Those of RESULTS/records, which are committed, instead.")
@results_option
def gather(published: bool, results: Path) -> None:
    """Bring the records of finished jobs, a file each, into one file for each data set, a line each."""
    from benchmark.jobs.execution.claims import Claims
    from benchmark.storage.store import StorageError, Store, sweep_leftovers

    store = Store.open(results)
    records = store.published if published else store.records
    with Claims.of(store) as claims:
        if not (published or claims.is_last()):
            raise ConfigurationError(f"a run in {results} writes records", "wait until it has ended")
        sweep_leftovers(store)
        try:
            count = records.gather()
        except OSError as error:
            raise StorageError(
                f"cannot write to {records.folder}: {error.strerror}", "make room; no record is lost"
            ) from error
    name_skipped(store)
    files = [path for path in records.folder.rglob("*.jsonl") if path.is_file()]
    size = sum(path.stat().st_size for path in files) / 1e6
    say(f"{count} records gathered; {records.folder} now has {len(files)} files of lines, {size:.1f} MB")
