"""Join the records of several results folders."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import Literal, NamedTuple, TypeVar

import msgspec

from benchmark.code_digest import FIRST_PARTY
from benchmark.errors import ConfigurationError
from benchmark.pipeline.cache import Cache, StorageError, storing
from benchmark.pipeline.record_files import (
    age_of,
    facts_of_shapes,
    last_of_rows,
    local_files,
    local_folder,
    read_files,
    read_records,
    say_skipped,
    scan_files,
    write_record,
)
from benchmark.pipeline.records import Origin, RankedShapes, Record, RowId, key_at
from benchmark.text import printable

RankedSide = TypeVar("RankedSide", bound=RankedShapes)

#: Whose result is kept of two results of a row that differ.
Choice = Literal["ours", "theirs"]


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
    folders: Iterable[Path], results: Path, take: Choice | None = None, rows: Collection[str] = ()
) -> Merged:
    """Add the records of other results folders to one.

    Of two records of one row, a result replaces a failure, and the later of two failures stays.
    Existing files stay as they are, except those of a row that is replaced. Folders of data with
    the same name, shapes and cameras count as the same data, wherever they lie.

    Parameters
    ----------
    folders
        The other results folders.
    results
        The one to add to.
    take
        Which of two results of a row is kept that differ: ``"ours"`` or ``"theirs"``. By default,
        ours stays, and they are returned as a conflict. So are results of two added folders that
        differ from each other.
    rows
        The conflicts that ``take`` resolves, each by the name of its row or the key of one of its
        records; empty for all.

    Returns
    -------
    Merged
        Added records, conflicts, refused records, and how many were known or skipped.

    Raises
    ------
    StorageError
        If a folder holds no records, or this one cannot be written.
    ConfigurationError
        If one of the rows is in no conflict, or names several.
    """
    merging = _Merging(results, take, rows)
    for folder in folders:
        if not local_folder(folder).is_dir():
            raise StorageError(
                f"{folder} holds no records", "name a results folder, which has runs/records"
            )
        merging.add_folder(folder)
    merging.check_rows()
    merging.write()
    return Merged(
        added=list(merging.added.values()),
        known=merging.n_known,
        conflicts=merging.conflicts,
        refused=merging.refused,
        n_skipped=merging.n_skipped,
    )


class _Merging:
    """What a merge will write, which is decided before anything is written.

    Parameters
    ----------
    results, take, rows
        As for :func:`merge_records`.
    """

    def __init__(self, results: Path, take: Choice | None, rows: Collection[str]) -> None:
        """Read the records that the results folder has, to which others will be added."""
        self.results = results
        self.take = take
        self.rows = rows
        #: All records here by row; the last one counts.
        self.here: defaultdict[RowId, list[Record]] = defaultdict(list)
        #: Row of each record here, by its key; None for a file that cannot be read as a record.
        self.owners: dict[str, RowId | None] = {path.stem: None for path in local_files(results)}
        for record in sorted(read_files(local_files(results)), key=age_of):
            self.here[record.row].append(record)
            self.owners[record.key] = record.row
        #: The record of each row that counts: the last one here, or one that was added.
        self.known = {row: records[-1] for row, records in self.here.items()}
        #: Shapes and classes of each gallery here, by its digest.
        self.facts_of_gallery = {
            record.gallery_digest: facts_of_shapes(record)
            for record in read_records(results, published=False)
        }
        self.added: dict[RowId, Record] = {}
        self.n_known = 0
        self.n_skipped = 0
        self.conflicts: list[tuple[Record, Record]] = []
        self.refused: list[Refused] = []
        #: Names and keys of each row in conflict, resolved or not.
        self.names_of_conflicts: defaultdict[RowId, set[str]] = defaultdict(set)

    def add_folder(self, folder: Path) -> None:
        """Decide for each record of another folder whether it is added."""
        files = scan_files(local_files(folder))
        say_skipped(files.skipped)
        records = sorted(files.records, key=age_of)
        last_records = last_of_rows(records)
        n_rows = len({record.row for record in records})
        # Files that cannot be read; and rows whose records contradict those of other rows.
        self.n_skipped += len(files.skipped) + n_rows - len(last_records)
        for record in last_records:
            moved = _with_data_here(record, self.known.values())
            self._add(_as_merged(moved, folder))

    def _add(self, record: Record) -> None:
        """Add a record of another folder, unless the one here is better or it cannot be written."""
        known = self.known.get(record.row)
        if known is not None and not self._is_wanted(known, record):
            return
        reason = self._refusal(record)
        if reason:
            self.refused.append(Refused(record, reason))
            return
        self.known[record.row] = record
        self.added[record.row] = record
        self.owners[record.key] = record.row
        self.facts_of_gallery.setdefault(record.gallery_digest, facts_of_shapes(record))

    def _is_wanted(self, known: Record, record: Record) -> bool:
        """Return whether a record takes the place of the known one; if not, note why."""
        if known.status != "ok":
            if record.status == "ok" or record.finished > known.finished:
                return True
            self.n_known += 1
            return False
        if record.status != "ok" or _is_same(known, record):
            self.n_known += 1
            return False
        return self._is_taken(known, record)

    def _is_taken(self, known: Record, record: Record) -> bool:
        """Return whether a result of another folder replaces the one here, as the user decides.

        If the user has not decided this conflict, the one here stays, and the conflict is noted.
        """
        names = {str(record.row), known.key, record.key}
        self.names_of_conflicts[record.row] |= names
        is_decided = not self.rows or not names.isdisjoint(self.rows)
        # If the one here was added just now, from a third folder, it is not "ours".
        is_between_folders = record.row in self.added
        if self.take is None or not is_decided or is_between_folders:
            self.conflicts.append((known, record))
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
        if self.facts_of_gallery.get(record.gallery_digest, facts) != facts:
            return "its shapes or classes are not those of its gallery here"
        return ""

    def check_rows(self) -> None:
        """Check that each name for which the user decides conflicts belongs to one conflict.

        Raises
        ------
        ConfigurationError
            If it belongs to none, or to the rows of several data sets.
        """
        for name in self.rows:  # of a row, or the key of a record
            rows = [row for row, names in self.names_of_conflicts.items() if name in names]
            if not rows:
                conflicts = ", ".join(f"'{row}'" for row in self.names_of_conflicts)
                hint = f"name one of {conflicts}" if conflicts else ""
                raise ConfigurationError(f"no two results of row '{name}' differ", hint)
            if len(rows) > 1:
                paths = ", ".join(chain.from_iterable(row.paths for row in rows))
                problem = f"'{name}' names rows of several data sets: {paths}"
                raise ConfigurationError(problem, "pass the key of a record instead")

    def write(self) -> None:
        """Write the new records, each in place of all files of its row."""
        for row, record in self.added.items():
            replaced = {known.key for known in self.here.get(row, [])}
            for key in replaced:
                Cache(self.results).remove("records", key)  # distances of the record that goes
            write_record(self.results, record)
            with storing(self.results):
                for key in replaced - {record.key}:
                    (local_folder(self.results) / f"{key}.json").unlink(missing_ok=True)


def _is_same(ours: Record, theirs: Record) -> bool:
    """Return whether two results of a row are the same."""
    return (
        ours.key == theirs.key
        and ours.scores == theirs.scores
        and ours.per_query == theirs.per_query
    )


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


def _with_data_here(record: Record, known: Iterable[Record]) -> Record:
    """Return a record of another folder with the path that its data have here.

    Data are the same as those of a record here if name, shapes and cameras are.

    Parameters
    ----------
    record
        The record.
    known
        Records here, in the order in which they were made. If the same data lie at several paths,
        the one that was used last counts.
    """
    paths: defaultdict[tuple[str, ...], list[str]] = defaultdict(list)
    for other in known:
        for side in other.sides:
            paths[_identity_of_data(side)].append(side.data.path)

    # Queries and their gallery may be of different data.
    gallery = record.gallery_of_queries
    if gallery:
        gallery = _moved(gallery, paths[_identity_of_data(gallery)])
    record = _moved(
        msgspec.structs.replace(record, gallery_of_queries=gallery),
        paths[_identity_of_data(record)],
    )
    if not record.result_key:  # a job that could not run
        return record
    # Paths are part of the key.
    return msgspec.structs.replace(record, key=key_at(record.result_key, record.row.paths))


def _moved(side: RankedSide, paths: Sequence[str]) -> RankedSide:
    """Return shapes with the last of some paths of their data, unless theirs is among these."""
    if not paths or side.data.path in paths:
        return side
    return msgspec.structs.replace(side, data=msgspec.structs.replace(side.data, path=paths[-1]))


def _identity_of_data(side: RankedShapes) -> tuple[str, ...]:
    """Return what the same data have in common at any path."""
    return side.gallery, side.gallery_digest, side.input, side.data.name
