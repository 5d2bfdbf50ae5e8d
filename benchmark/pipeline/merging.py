"""Join the records of several results folders."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import NamedTuple, TypeVar

import msgspec

from benchmark.pipeline.cache import RUNS, StorageError
from benchmark.pipeline.records import RankedShapes, Record, key_at, read_records, write_record

RankedSide = TypeVar("RankedSide", bound=RankedShapes)


class Merged(NamedTuple):
    """Outcome of a merge: new records, the number of known ones, and pairs of other results for one row."""

    added: list[Record]
    known: int
    conflicts: list[tuple[Record, Record]]


def merge(folders: Iterable[Path], results: Path) -> Merged:
    """Add the records of other results folders; a result replaces a failure, and the later of two failures stays.

    Records of a folder with the name, shapes and cameras of one here are of that one. Two results
    of one row that are not the same are a conflict: the one here stays.

    Raises
    ------
    StorageError
        If a folder holds no records.
    """
    known = {record.row: record for record in read_records(results, published=False)}
    added, n_known, conflicts = list[Record](), 0, list[tuple[Record, Record]]()
    for folder in folders:
        if not (folder / RUNS / "records").is_dir():
            raise StorageError(
                f"{folder} holds no records", "name a results folder, which has runs/records"
            )
        for theirs in read_records(folder, published=False):
            record = _of_data_here(theirs.without_files(), known.values())
            existing = known.get(record.row)
            is_later = (
                existing is None or record.status == "ok" or record.finished > existing.finished
            )
            if existing is None or (existing.status != "ok" and is_later):
                known[record.row] = record
                write_record(results, record, existing.key if existing else "")
                added.append(record)
            elif record.status == "ok" and (record.key, record.scores) != (
                existing.key,
                existing.scores,
            ):
                conflicts.append((existing, record))
            else:
                n_known += 1
    return Merged(added, n_known, conflicts)


def _of_data_here(record: Record, known: Collection[Record]) -> Record:
    """Return a record whose data lie where the same data lie here."""
    here = [side for other in known for side in other.sides]

    def moved(side: RankedSide) -> RankedSide:
        same = [of.data.path for of in here if _facts(of) == _facts(side)]
        path = side.data.path if side.data.path in same or not same else same[-1]
        return msgspec.structs.replace(side, data=msgspec.structs.replace(side.data, path=path))

    gallery = record.gallery_of_queries and moved(record.gallery_of_queries)
    record = moved(msgspec.structs.replace(record, gallery_of_queries=gallery))
    key = key_at(record.result_key, record.row.paths) if record.result_key else record.key
    return msgspec.structs.replace(record, key=key)


def _facts(side: RankedShapes) -> tuple[str, ...]:
    return side.gallery, side.gallery_digest, side.input, side.data.name
