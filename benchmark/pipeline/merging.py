"""Join the records of several results folders, and publish them."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import msgspec

from benchmark.datasets.catalogue import CATALOGUE
from benchmark.errors import ConfigurationError
from benchmark.files import write_atomically
from benchmark.pipeline.cache import RUNS, StorageError, storing
from benchmark.pipeline.environment import has_edits
from benchmark.pipeline.records import Record, read_records, write_record
from benchmark.protocols.tables import PARTS
from benchmark.reference.paper import MEASURES
from benchmark.registry import BUILT_IN
from benchmark.text import LONGEST_NAME


class Merged(NamedTuple):
    """Outcome of a merge: new records, the number of known ones, and pairs with one key and different scores."""

    added: list[Record]
    known: int
    conflicts: list[tuple[Record, Record]]


def merge(folders: Iterable[Path], results: Path) -> Merged:
    """Add the records of other results folders to this one: a result replaces a failure, a newer job an older one.

    Raises
    ------
    StorageError
        If a folder holds no records.
    """
    known = {record.row: record for record in read_records(results, published=False)}
    added, n_known, conflicts = list[Record](), 0, list[tuple[Record, Record]]()
    for folder in folders:
        if not (folder / RUNS / "records").is_dir():
            raise StorageError(f"{folder} holds no records", "name a results folder, which has runs/records")
        for record in read_records(folder, published=False):
            existing = known.get(record.row)
            if existing is None or _replaces(record, existing):
                known[record.row] = msgspec.structs.replace(record, files={})
                write_record(results, known[record.row], existing.key if existing else "")
                added.append(record)
            elif record.key == existing.key and record.status == "ok" and record.scores != existing.scores:
                conflicts.append((existing, record))
            else:
                n_known += 1
    return Merged(added, n_known, conflicts)


def _replaces(record: Record, other: Record) -> bool:
    is_result = record.status == "ok" and other.status != "ok"
    return is_result or (record.key != other.key and record.finished > other.finished)


def publish(results: Path) -> Merged:
    """Write the public records made here among the published ones, in place of earlier ones of their rows.

    Raises
    ------
    ConfigurationError
        If the working tree has changes, or the records of a gallery and input were made at several commits.
    """
    if has_edits():
        raise ConfigurationError("the working tree has changes", "commit them, and run again")
    here = [record for record in read_records(results, published=False) if is_public(record)]
    commits = defaultdict[str, set[str]](set)
    for record in here:
        commits[f"{record.gallery} {record.input}"].add(record.commit)
    for name, made_at in commits.items():
        if len(made_at) > 1 or any(commit.endswith("+") for commit in made_at):
            problem = f"the rows of {name} were made at {', '.join(sorted(made_at))}"
            raise ConfigurationError(problem, "run them again at one commit")
    before = {record.row: portable(record) for record in read_records(results, local=False)}
    now = before | {record.row: portable(record) for record in here}
    write_published(results, now.values())
    added = [record for row, record in now.items() if record != before.get(row)]
    return Merged(added, len(now) - len(added), [])


def is_public(record: Record) -> bool:
    """Return whether a record means something elsewhere: a full run of a set and a method of the suite."""
    is_whole = record.gallery.removeprefix(record.data.name).strip() in PARTS
    is_known = record.data.name.partition("[")[0] in CATALOGUE and record.method.partition("[")[0] in BUILT_IN
    return is_whole and is_known and record.status != "unavailable"


def portable(record: Record) -> Record:
    """Return a record without what means nothing on another machine."""
    per_query = {name: values for name, values in record.per_query.items() if name in MEASURES}
    return msgspec.structs.replace(record, per_query=per_query, parts={}, files={}, traceback="", published=False)


def write_published(results: Path, records: Iterable[Record]) -> None:
    """Write records as lines, a file for each data set, in the order of their rows."""
    files = defaultdict[str, bytes](bytes)
    for record in sorted(records, key=lambda record: record.row):
        base = re.sub("[^A-Za-z0-9-]+", "-", record.data.name.partition("[")[0])[:LONGEST_NAME] or "records"
        files[f"{base}.jsonl"] += msgspec.json.encode(record) + b"\n"
    folder = results / "records"
    with storing(results):
        for name, text in files.items():
            write_atomically(folder / name, lambda file, text=text: file.write(text), durable=True)  # type: ignore[misc]
        for path in folder.glob("*.jsonl"):
            if path.name not in files:
                path.unlink()
