"""``merge`` and ``forget``: join results folders, and delete results."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from benchmark.cli.options import Selection
from benchmark.cli.run import outcome
from benchmark.datasets.catalogue import CATALOGUE
from benchmark.errors import ConfigurationError
from benchmark.pipeline.cache import writing
from benchmark.pipeline.records import Record, publish, read_records
from benchmark.pipeline.records import forget as forget_records
from benchmark.pipeline.records import merge as merge_records
from benchmark.protocols.tables import PARTS
from benchmark.registry import BUILT_IN
from benchmark.text import say


def merge(folders: Sequence[Path], results: Path, *, published: bool) -> bool:
    """Merge records, or publish those made here; print those that contradict each other."""
    with writing(results):
        others = [folder for folder in folders if folder.resolve() != results.resolve()]
        merged = merge_records(others, results)
        public = publish(results, is_public) if published else merged
    for existing, other in merged.conflicts:
        say(f"conflict: {existing.row}: {outcome(existing)} here, {outcome(other)} there")
    say(f"records: {len(public.added)} added, {public.known} known, {len(merged.conflicts)} in conflict")
    return not merged.conflicts


def is_public(record: Record) -> bool:
    """Return whether a record means something elsewhere: of a set and a method of the suite."""
    is_whole = record.gallery.removeprefix(record.data.name).strip() in PARTS
    is_known = record.data.name.partition("[")[0] in CATALOGUE and record.method.partition("[")[0] in BUILT_IN
    return is_whole and is_known


def forget(selection: Selection) -> None:
    """Delete the records of methods or data sets made here, and list them."""
    if not (selection.methods or selection.datasets):
        raise ConfigurationError("nothing is selected", "name methods with -m, or data sets with -d")
    wanted = {*selection.datasets, *map(os.path.realpath, selection.datasets)}

    def is_meant(record: Record) -> bool:
        names = {record.data.name, record.data.source, os.path.realpath(record.data.source)}
        is_of_method = {record.method, record.method.partition("[")[0]} & {*selection.methods}
        return bool((is_of_method or not selection.methods) and (names & wanted or not wanted))

    with writing(selection.results):
        records = list(read_records(selection.results, published=False))
        for record in filter(is_meant, records):
            say(f"{record.gallery} {record.input} {record.method}  {outcome(record)}")
        count = forget_records(selection.results, is_meant)
    if not count:
        known = ", ".join(sorted({record.method for record in records}))
        problem = f"no record under {selection.results} fits the selection"
        raise ConfigurationError(problem, f"there are {known}" if known else "run some first")
    say(f"records: {count} deleted, with their forms")
