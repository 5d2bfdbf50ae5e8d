"""Merge the records of several machines into one folder."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from benchmark.pipeline.storage.keys import is_edited
from benchmark.pipeline.storage.records import DEFAULT_SCORER, Record, Records, by_place, outcome, place, portable
from benchmark.pipeline.storage.store import StorageError, Store


@dataclass
class Merged:
    """Outcome of a merge.

    Parameters
    ----------
    added, known
        New records, and the number of records whose outcome, or a better one, was already present.
    conflicts
        Pairs of records with the same key and different outcomes; neither replaces the other.
    """

    added: list[Record] = field(default_factory=list)
    known: int = 0
    conflicts: list[tuple[Record, Record]] = field(default_factory=list)


def records_under(results: Store) -> list[Record]:
    """Return all records of a results folder, published ones first.

    Raises
    ------
    StorageError
        If it has neither records nor a folder for them.
    """
    records = results.all_records()
    if not (records or results.records.folder.is_dir()):
        raise StorageError(
            f"{results.root.parent} holds no records", "name a results folder: DIR/runs/records or DIR/records"
        )
    return records


def merge_records(records: Iterable[Record], target: Records) -> Merged:
    """Add records to a folder; a key with two outcomes is a conflict, and its existing record stays.

    Parameters
    ----------
    records
        The records to add; results replace failures under the same key.
    target
        The folder.
    """
    merged = Merged()
    for record in records:
        existing = target.read(record["key"])
        if existing is None or (existing["status"] != "ok" and record["status"] == "ok"):
            target.write(record)
            merged.added.append(record)
        elif record["status"] != "ok" or outcome(portable(existing)) == outcome(portable(record)):
            merged.known += 1
        else:
            merged.conflicts.append((existing, record))
    return merged


def publish(records: Iterable[Record], target: Records) -> Merged:
    """Copy the newest record of each place to the folder of published records.

    Quick runs, private folders, methods of plugin files, results of edited code, and jobs with a missing package or
    model are omitted, since they are meaningless elsewhere. A record replaces all older ones of its place, whatever
    their keys, but a record without scores, of a failed or stopped job, never replaces one with scores.

    Parameters
    ----------
    records
        Records of finished jobs.
    target
        The folder.
    """
    merged, replaced = Merged(), list[str]()
    before = by_place(target)
    for where, rivals in by_place(record for record in records if _is_for_all(record)).items():
        existing = before.get(where, [])
        newest = max([*rivals, *existing], key=_worth)  # of two equal ones, the new one
        if any(old["key"] == newest["key"] and outcome(old) == outcome(newest) for old in existing):
            merged.known += 1
        else:
            target.write(portable(newest))
            merged.added.append(portable(newest))
        replaced += [old["key"] for old in existing if old["key"] != newest["key"]]
    target.gather()
    target.remove(*replaced)
    return merged


def _worth(record: Record) -> tuple[bool, str]:
    return record["status"] == "ok", str(record.get("finished", ""))


def _is_for_all(record: Record) -> bool:
    data = record["data"]
    is_public = data["source"] == data["name"] and bool(record["target"])
    return is_public and not data["quick"] and record["status"] != "unavailable" and not is_edited(record["key"])


def job_name(record: Record) -> str:
    """Return the name of a job for messages."""
    gallery, input_, method, seed, scorer = place(record)
    by = "" if scorer == DEFAULT_SCORER else f" by {scorer}"
    return f"{gallery} {input_} {method}" + (f" seed {seed}" if seed else "") + by
