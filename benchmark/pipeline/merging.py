"""Join the records of several results folders."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from benchmark.pipeline.cache import RUNS, StorageError
from benchmark.pipeline.records import Record, read_records, write_record


class Merged(NamedTuple):
    """Outcome of a merge: new records, the number of known ones, and pairs with one key and different scores."""

    added: list[Record]
    known: int
    conflicts: list[tuple[Record, Record]]


def merge(folders: Iterable[Path], results: Path) -> Merged:
    """Add the records of other results folders: a result replaces a failure, and a newer job an older one of its kind.

    Raises
    ------
    StorageError
        If a folder holds no records.
    """
    known = read_records(results, published=False)
    added, n_known, conflicts = list[Record](), 0, list[tuple[Record, Record]]()
    for folder in folders:
        if not (folder / RUNS / "records").is_dir():
            raise StorageError(f"{folder} holds no records", "name a results folder, which has runs/records")
        for record in read_records(folder, published=False):
            existing = next((other for other in known if other.row == record.row), None)
            if existing is None or _replaces(record, existing):
                new = record.without_files()
                known = [*(other for other in known if other is not existing), new]
                write_record(results, new, existing.key if existing else "")
                added.append(record)
            elif record.key == existing.key and record.status == "ok" and record.scores != existing.scores:
                conflicts.append((existing, record))
            else:
                n_known += 1
    return Merged(added, n_known, conflicts)


def _replaces(record: Record, other: Record) -> bool:
    if (record.status == "ok") != (other.status == "ok"):
        return record.status == "ok"
    return record.key != other.key and record.finished > other.finished
