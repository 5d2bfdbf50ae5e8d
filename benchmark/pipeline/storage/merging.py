"""Records of several machines joined into one folder."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from benchmark.pipeline.storage.records import DEFAULT_SCORER, Record, Records, by_place, outcome, place, portable
from benchmark.pipeline.storage.store import StorageError, Store


@dataclass
class Merged:
    """Outcome of a merge.

    Parameters
    ----------
    added, known
        Records that were new; and places where the same outcome, or what is worth more, was there already.
    conflicts
        Pairs of records with one key and two outcomes; nothing of them was taken.
    """

    added: list[Record] = field(default_factory=list)
    known: int = 0
    conflicts: list[tuple[Record, Record]] = field(default_factory=list)


def records_under(results: Store) -> list[Record]:
    """All records of a results folder, those that came with it before those made there.

    Raises
    ------
    StorageError
        If it holds no record and no folder of them, which a shard without jobs has.
    """
    places = (results.published, results.records)
    records = list({record["key"]: record for folder in places for record in folder}.values())
    if not (records or results.records.folder.is_dir()):
        raise StorageError(
            f"{results.root.parent} holds no records", "name a results folder: DIR/runs/records or DIR/records"
        )
    return records


def merge_records(records: Iterable[Record], target: Records) -> Merged:
    """Add records to a folder; one key with two outcomes is a conflict, and the folder keeps what it has.

    Parameters
    ----------
    records
        What to add; failures give way to results under the same key.
    target
        Where to.
    """
    merged = Merged()
    for record in records:
        there = target.read(record["key"])
        if there is None or (there["status"] != "ok" and record["status"] == "ok"):
            target.write(record)
            merged.added.append(record)
        elif record["status"] != "ok" or outcome(portable(there)) == outcome(portable(record)):
            merged.known += 1
        else:
            merged.conflicts.append((there, record))
    return merged


def publish(records: Iterable[Record], target: Records) -> Merged:
    """Bring the newest record of each place into the folder that travels with the suite.

    Quick runs, private folders, methods of plugin files, and jobs whose package or model was missing are left out: they
    mean nothing to others. A record replaces all older ones of its place, whatever their keys; but a record without
    scores, of a job that failed or was stopped, never replaces one with scores.

    Parameters
    ----------
    records
        Records of finished jobs.
    target
        The folder.
    """
    merged, replaced = Merged(), list[str]()
    before = by_place(target)
    for where, found in by_place(record for record in records if _is_for_all(record)).items():
        there = before.get(where, [])
        newest = max([*found, *there], key=_worth)  # of two equal ones, the one that is to be published
        if any(old["key"] == newest["key"] and outcome(old) == outcome(newest) for old in there):
            merged.known += 1
        else:
            target.write(portable(newest))
            merged.added.append(portable(newest))
        replaced += [old["key"] for old in there if old["key"] != newest["key"]]
    target.gather()
    target.remove(*replaced)
    return merged


def _worth(record: Record) -> tuple[bool, str]:
    return record["status"] == "ok", str(record.get("finished", ""))


def _is_for_all(record: Record) -> bool:
    data = record["data"]
    is_public = data["source"] == data["name"] and bool(record["target"])
    return is_public and not data["quick"] and record["status"] != "unavailable"


def job_name(record: Record) -> str:
    """Return where a record belongs, in words."""
    gallery, input_, method, seed, scorer = place(record)
    by = "" if scorer == DEFAULT_SCORER else f" by {scorer}"
    return f"{gallery} {input_} {method}" + (f" seed {seed}" if seed else "") + by
