"""Join the records of several results folders."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Literal, NamedTuple, TypeVar

import msgspec

from benchmark.code_digest import FIRST_PARTY
from benchmark.errors import ConfigurationError
from benchmark.pipeline.cache import RUNS, Cache, StorageError, storing
from benchmark.pipeline.records import (
    Origin,
    RankedShapes,
    Record,
    RowId,
    age_of,
    facts_of_shapes,
    key_at,
    last_of_rows,
    local_files,
    read_files,
    read_records,
    say_skipped,
    scan_files,
    write_record,
)
from benchmark.text import printable

RankedSide = TypeVar("RankedSide", bound=RankedShapes)

#: Which of two results of a row that differ is kept.
Side = Literal["ours", "theirs"]


class Refused(NamedTuple):
    """A record that cannot be taken, and why."""

    record: Record
    reason: str


class Merged(NamedTuple):
    """Outcome of a merge.

    Parameters
    ----------
    added
        Records that are new here, or took the place of one.
    known
        Number of records that say nothing new, or that ours was kept instead of.
    conflicts
        Pairs of two results of a row, ours and theirs; ours stays.
    refused
        Records that contradict what is here.
    n_skipped
        Number of files in the other folders that are not used as records.
    """

    added: list[Record]
    known: int
    conflicts: list[tuple[Record, Record]]
    refused: list[Refused]
    n_skipped: int


def merge_records(
    folders: Iterable[Path], results: Path, take: Side | None = None, rows: Collection[str] = ()
) -> Merged:
    """Add the records of other results folders; a result replaces a failure, and the later of two failures stays.

    Records of a folder with the name, shapes and cameras of one here are of that one. No file is
    written that is there already, except those of a row that is replaced.

    Parameters
    ----------
    folders, results
        The other results folders, and the one to add to.
    take
        Which of two results of a row that differ is kept. By default they are a conflict, and ours
        stays. Two folders that differ from each other stay in conflict.
    rows
        The conflicts that ``take`` resolves, each by the name of its row or the key of one of its
        records; empty for all.

    Raises
    ------
    StorageError
        If a folder holds no records, or this one cannot be written.
    ConfigurationError
        If one of the rows is in no conflict, or names several.
    """
    merging = _Merging(results, take, rows)
    for folder in folders:
        if not (folder / RUNS / "records").is_dir():
            raise StorageError(
                f"{folder} holds no records", "name a results folder, which has runs/records"
            )
        merging.add_folder(folder)
    merging.check_rows()
    merging.write()
    return Merged(
        [*merging.added.values()],
        merging.n_known,
        merging.conflicts,
        merging.refused,
        merging.n_skipped,
    )


class _Merging:
    """What a merge will write, which is decided before anything is written."""

    def __init__(self, results: Path, take: Side | None, rows: Collection[str]) -> None:
        self.results, self.take, self.rows = results, take, rows
        #: All records here by row; the last one counts.
        self.here: dict[RowId, list[Record]] = {}
        for record in sorted(read_files(local_files(results)), key=age_of):
            self.here.setdefault(record.row, []).append(record)
        self.known = {row: records[-1] for row, records in self.here.items()}
        #: Row of each file, by its key; None of a file that is not used as a record.
        self.owners: dict[str, RowId | None] = {path.stem: None for path in local_files(results)}
        for row, records in self.here.items():
            self.owners |= {record.key: row for record in records}
        #: Shapes and classes of each gallery here, by its digest.
        self.facts = {
            record.gallery_digest: facts_of_shapes(record)
            for record in read_records(results, published=False)
        }
        self.added: dict[RowId, Record] = {}
        self.n_known = self.n_skipped = 0
        self.conflicts = list[tuple[Record, Record]]()
        self.refused = list[Refused]()
        #: Names and keys of each row in conflict, resolved or not.
        self.names_of_conflicts: dict[RowId, set[str]] = {}

    def add_folder(self, folder: Path) -> None:
        """Decide on each record of a folder."""
        files = scan_files(local_files(folder))
        say_skipped(files.skipped)
        self.n_skipped += len(files.skipped)
        records = sorted(files.records, key=age_of)
        theirs = last_of_rows(records)
        self.n_skipped += len({record.row for record in records}) - len(theirs)
        for record in theirs:
            self._add(_as_merged(_of_data_here(record, self.known.values()), folder))

    def _add(self, record: Record) -> None:
        existing = self.known.get(record.row)
        if existing is not None and not self._is_wanted(existing, record):
            return
        if reason := self._refusal(record):
            self.refused.append(Refused(record, reason))
            return
        self.known[record.row] = self.added[record.row] = record
        self.owners[record.key] = record.row
        self.facts.setdefault(record.gallery_digest, facts_of_shapes(record))

    def _is_wanted(self, existing: Record, record: Record) -> bool:
        """Return whether a record takes the place of the one here; note it if it is known or in conflict."""
        is_result = record.status == "ok"
        if existing.status != "ok" and (is_result or record.finished > existing.finished):
            return True
        if existing.status != "ok" or not is_result or _is_same(existing, record):
            self.n_known += 1
            return False
        names = {str(record.row), existing.key, record.key}
        self.names_of_conflicts.setdefault(record.row, set()).update(names)
        is_chosen = not self.rows or bool(names & {*self.rows})
        is_between_folders = record.row in self.added
        if self.take is None or not is_chosen or is_between_folders:
            self.conflicts.append((existing, record))
            return False
        if self.take == "ours":
            self.n_known += 1
        return self.take == "theirs"

    def _refusal(self, record: Record) -> str:
        """Return why a record cannot be written here; "" if it can."""
        owner = self.owners.get(record.key, record.row)
        if owner is None:
            return f"{record.key}.json is there already, and is not used as a record"
        if owner != record.row:
            return f"its key is that of another row here, {owner}"
        facts = facts_of_shapes(record)
        if self.facts.get(record.gallery_digest, facts) != facts:
            return "its shapes or classes are not those of its gallery here"
        return ""

    def check_rows(self) -> None:
        """Raise ``ConfigurationError`` unless each of the named rows is in one conflict."""
        for name in self.rows:
            found = [row for row, names in self.names_of_conflicts.items() if name in names]
            if not found:
                conflicts = ", ".join(f"'{row}'" for row in self.names_of_conflicts)
                problem = f"no two results of row '{name}' differ"
                raise ConfigurationError(problem, f"name one of {conflicts}" if conflicts else "")
            if len(found) > 1:
                paths = ", ".join(path for row in found for path in row.paths)
                problem = f"'{name}' names rows of several data sets: {paths}"
                raise ConfigurationError(problem, "pass the key of a record instead")

    def write(self) -> None:
        """Write the new records, each in place of all files of its row."""
        for row, record in self.added.items():
            before = {one.key for one in self.here.get(row, [])}
            for key in before:
                Cache(self.results).remove("records", key)  # distances of the record that goes
            write_record(self.results, record)
            with storing(self.results):
                for key in before - {record.key}:
                    (self.results / RUNS / "records" / f"{key}.json").unlink(missing_ok=True)


def _is_same(one: Record, other: Record) -> bool:
    """Return whether two results of a row are the same."""
    return (one.key, one.scores, one.per_query) == (other.key, other.scores, other.per_query)


def _as_merged(record: Record, folder: Path) -> Record:
    """Return a record that says where it came from, without its files."""
    origin = Origin(printable(str(folder)), _plugins_of(record))
    return msgspec.structs.replace(record.without_files(), merged_from=origin)


def _plugins_of(record: Record) -> dict[str, str]:
    """Return the digests of the files of a record's plugins: sources that are not of the suite."""
    return {
        name: part
        for name, part in record.parts.items()
        if name.endswith(".py") and name.partition("/")[0] not in FIRST_PARTY
    }


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
