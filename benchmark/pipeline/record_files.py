"""Files of records: which there are, reading and checking them, writing and deleting them."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple, get_args

import msgspec

from benchmark.code_digest import ROOT, digest, digest_of_bytes
from benchmark.defaults import RESULTS
from benchmark.files import read_file, write_atomically
from benchmark.pipeline.cache import RUNS, Stage, StorageError, storing
from benchmark.pipeline.code_store import definitions_file
from benchmark.pipeline.record_checks import find_contradiction
from benchmark.pipeline.record_layout import (
    LAYOUT_FIELD,
    NewerRecord,
    RecordError,
    check_layout,
    content_of,
    convert_older,
    gather_unknown,
    is_newer,
)
from benchmark.pipeline.records import Record, make_printable
from benchmark.text import say

#: Results in an installed package.
_INSTALLED_RESULTS = ROOT / "benchmark" / "results"

#: Results folder of the suite, with its published records.
SUITE_RESULTS = _INSTALLED_RESULTS if _INSTALLED_RESULTS.is_dir() else ROOT / "results"

#: Largest size of a file of records, in bytes.
LARGEST_RECORDS_FILE = 2**28

#: Number of records that a process keeps once it has read them: more than are published.
_KEPT_RECORDS = 2048


def published_folder(results: Path) -> Path:
    """Return the folder with what was published beside a results folder.

    A results folder has its own published records, as in a checkout. Elsewhere, the one of commands
    that name none has those of the suite.
    """
    has_own = (results / "records").is_dir()
    is_named = results.absolute() != RESULTS.absolute()
    return results if has_own or is_named else SUITE_RESULTS


def read_records(results: Path, *, local: bool = True, published: bool = True) -> list[Record]:
    """Read the records of a results folder, one for each row of a table, oldest first.

    Records of jobs that ran here replace published ones of the same row. Damaged files and lines
    are named on stderr and passed over.

    Parameters
    ----------
    results
        The results folder.
    local
        Whether to read records of jobs that ran here.
    published
        Whether to read published records.
    """
    here: list[Record] = []
    if local:
        here = sorted(read_files(local_files(results)), key=age_of)

    # Leave out published records of a gallery that holds other shapes here. A folder of the user is
    # another data set, also if it has the name of one of the suite.
    digests = {(record.gallery, record.row.paths): record.gallery_digest for record in here}
    fitting: list[Record] = []
    if published:
        folder = published_folder(results) / "records"
        for record in read_files(folder.glob("*.jsonl")):
            gallery = record.gallery, record.row.paths
            if digests.get(gallery, record.gallery_digest) == record.gallery_digest:
                fitting.append(msgspec.structs.replace(record, published=True))
    return last_of_rows([*sorted(fitting, key=age_of), *here])


def local_folder(results: Path) -> Path:
    """Return the folder of the records of jobs that ran here; it need not exist."""
    return results / RUNS / "records"


def local_files(results: Path) -> list[Path]:
    """Return the files of the records of jobs that ran here."""
    return sorted(local_folder(results).glob("*.json"))


def last_of_rows(records: Sequence[Record]) -> list[Record]:
    """Return the last record of each row, oldest first.

    Those of other shapes than the rest of their gallery are named on stderr and left out.
    """
    last = {record.row: record for record in _of_same_shapes(records)}
    return sorted(last.values(), key=age_of)


def _of_same_shapes(records: Sequence[Record]) -> list[Record]:
    """Return the records that agree with most others on the shapes of their gallery.

    Records with the same digest of a gallery must have the same shapes and classes. One that has
    others is false: it is left out, and named on stderr.
    """
    lists_of_shapes = [facts_of_shapes(record) for record in records]
    counts: defaultdict[str, Counter[str]] = defaultdict(Counter)  # of each list, by gallery
    for record, shapes in zip(records, lists_of_shapes, strict=True):
        counts[record.gallery_digest][shapes] += 1

    most_frequent = {}
    for gallery, count in counts.items():
        most_frequent[gallery] = max(count, key=count.__getitem__)  # the first of several

    fitting = []
    for record, shapes in zip(records, lists_of_shapes, strict=True):
        if shapes == most_frequent[record.gallery_digest]:
            fitting.append(record)
        else:
            _say_skipped(
                f"record {record.key} ({record.row}): its shapes or classes are not those of the "
                "other records of its gallery; run its job again or remove it"
            )
    return fitting


def facts_of_shapes(record: Record) -> str:
    """Return a digest of the shapes and classes of queries and gallery."""
    sides = [(side.shapes, side.labels, side.views) for side in record.sides]
    return digest([record.keeps_same_names, sides])


def age_of(record: Record) -> tuple[str, str]:
    """Return what orders records from the oldest to the newest."""
    return record.finished, record.key


class SkippedRecord(NamedTuple):
    """A file or line that is not used as a record, and why."""

    where: str
    error: RecordError

    def __str__(self) -> str:
        return f"{self.where}: {self.error}"


class ScannedFiles(NamedTuple):
    """What files of records hold."""

    records: list[Record]
    skipped: list[SkippedRecord]


def read_files(paths: Iterable[Path]) -> list[Record]:
    """Return the records in files; what is none is named on stderr and passed over."""
    scanned = scan_files(paths)
    say_skipped(scanned.skipped)
    return scanned.records


def say_skipped(skipped: Iterable[SkippedRecord]) -> None:
    """Name files and lines that are not used on stderr, each once in a process."""
    for item in skipped:
        _say_skipped(str(item))


def scan_files(paths: Iterable[Path]) -> ScannedFiles:
    """Read the records in files, and note the files and lines that hold none.

    Parameters
    ----------
    paths
        Files. A ``.json`` file holds one record, and its name is the key of that; a ``.jsonl`` file
        holds one record a line.
    """
    records: list[Record] = []
    skipped: list[SkippedRecord] = []
    for path in sorted(paths):
        try:
            text = read_file(path, LARGEST_RECORDS_FILE)
        except OSError as error:
            skipped.append(SkippedRecord(str(path), RecordError(str(error.strerror))))
            continue
        # Texts of records by their place, for messages.
        if path.suffix == ".json":
            texts = {str(path): text}
            key = path.stem
        else:
            texts = {f"{path}:{number}": line for number, line in enumerate(text.splitlines(), 1)}
            key = ""  # any
        for place, text_of_record in texts.items():
            try:
                records.append(_parse_named(text_of_record, key))
            except RecordError as error:
                skipped.append(SkippedRecord(place, error))
    return ScannedFiles(records, skipped)


def _parse_named(text: bytes, key: str) -> Record:
    """Return the record of a JSON object; raise ``RecordError`` if its file has another name.

    Without a key, any record will do.
    """
    record = parse_record(text)
    if key and record.key != key:
        raise RecordError("its name is not its key", f"name it {record.key}.json, or remove it")
    return record


@lru_cache(maxsize=_KEPT_RECORDS)
def parse_record(text: bytes) -> Record:
    """Return the record that a JSON text holds, after all checks.

    The record may be shared by several callers, so that nothing in it may be changed.

    Raises
    ------
    NewerRecord
        If its layout is of a newer major version.
    RecordError
        If the text is no record, was changed after it was written, or contradicts itself.
    """
    content, is_whole = _parse_content(text)  # whole: as it was written, by its checksum
    content = convert_older(content)
    if not is_whole:
        problem = "it is not a record: it was changed after it was written, or written by hand"
        raise RecordError(problem, "remove it")
    try:
        record = msgspec.convert(gather_unknown(content, Record), Record)
    except msgspec.ValidationError as error:
        hint = "update the suite" if is_newer(content) else "remove it"
        raise RecordError(f"it is not a record: {error}", hint) from error
    contradiction = find_contradiction(record)
    if contradiction:
        problem = f"it contradicts itself: {contradiction}"
        raise RecordError(problem, "run its job again or remove it")
    return msgspec.structs.replace(record, published=False, checksum="")


def _parse_content(text: bytes) -> tuple[dict[str, Any], bool]:
    """Return a JSON object without its checksum, and whether that is right.

    Raises ``RecordError`` if it is none, or in a layout that this release cannot read.
    """
    try:
        content = msgspec.json.decode(text)
        if not isinstance(content, dict):
            raise RecordError("it is not a record: it is no JSON object", "remove it")
        check_layout(content)
        checksum = content.pop("checksum", "")
        return content, checksum == _checksum(content)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise RecordError(f"it is not a record: {error}", "remove it") from error


def encode_record(record: Record) -> bytes:
    """Return a record as JSON, with the version of its layout and its checksum."""
    content = {LAYOUT_FIELD: record.layout} | content_of(record)
    return msgspec.json.encode(content | {"checksum": _checksum(content)})


def _checksum(content: Mapping[str, Any]) -> str:
    """Return the digest of a record, in which the order of its fields does not count."""
    return digest_of_bytes(msgspec.json.encode(content, order="sorted"))


@cache
def _say_skipped(what: str) -> None:
    """Name a file or line that is not used, once however often it is read."""
    say(f"skipped {what}", err=True)


# Writing
# ------------------------------------------------------------------------------------------------


def write_record(results: Path, record: Record, replaces: str = "") -> None:
    """Write the record of a job that ran here.

    Parameters
    ----------
    results
        The results folder.
    record
        The record.
    replaces
        Key of an earlier record of the same row, which is deleted with its distances; "" for none.

    Raises
    ------
    StorageError
        If it cannot be written, or would replace a record of a newer version of the suite.
    """
    folder = local_folder(results)
    newer_record = newer_record_at(results, record.key)
    if newer_record:
        raise StorageError(newer_record, "update the suite, or choose another --results DIR")
    try:
        text = encode_record(record)
    except UnicodeEncodeError:  # from names of files that are not UTF-8
        text = encode_record(msgspec.convert(make_printable(msgspec.to_builtins(record)), Record))
    text = msgspec.json.format(text, indent=1)
    with storing(results):
        write_atomically(folder / f"{record.key}.json", lambda file: file.write(text), durable=True)
        if replaces not in ("", record.key):
            (folder / f"{replaces}.json").unlink(missing_ok=True)
            (folder / f"{replaces}.npz").unlink(missing_ok=True)


def newer_record_at(results: Path, key: str) -> str:
    """Return why the record under a key may not be replaced: its layout is newer; "" if it may."""
    path = local_folder(results) / f"{key}.json"
    if not path.exists():
        return ""
    for skipped in scan_files([path]).skipped:
        if isinstance(skipped.error, NewerRecord):
            return f"{path}: {skipped.error.problem}"
    return ""


def unneeded(
    results: Path, is_unwanted: Callable[[Record], bool], named: Collection[str] = ()
) -> tuple[list[Record], list[Path]]:
    """Return the records to delete, and all files that no other record needs.

    Parameters
    ----------
    results
        The results folder, of which only jobs that ran here are considered.
    is_unwanted
        Returns whether a record is one to delete.
    named
        Further records to delete, each by its row or its key, which is the name of its file.

    Returns
    -------
    records : list of Record
        The records to delete.
    files : list of Path
        Their files, and files of arrays that no record needs. A file that cannot be read as a
        record, perhaps because it is of another version, is not among them unless it is named, nor
        are the files of arrays whose keys it holds.
    """
    paths = local_files(results)
    records = sorted(read_files(paths), key=age_of)
    unwanted: list[Record] = []
    needed_files: set[str] = set()
    for record in records:
        if is_unwanted(record) or record.key in named or str(record.row) in named:
            unwanted.append(record)
        else:
            needed_files.update(_files_of(record))
    files = [results / RUNS / "records" / f"{record.key}.json" for record in unwanted]

    # Files that cannot be read as records.
    keys_of_records = {record.key for record in records}
    unreadable = [path for path in paths if path.stem not in keys_of_records]
    kept_keys: set[str] = set()
    for path in unreadable:
        if path.stem in named:
            files.append(path)
        else:
            kept_keys |= _keys_in(path)

    files += _unneeded_arrays(results, needed_files, kept_keys)
    is_all_unwanted = len(unwanted) == len(records) and not kept_keys
    if is_all_unwanted and definitions_file(results).is_file():
        files.append(definitions_file(results))  # which explain the records
    return unwanted, files


def _unneeded_arrays(
    results: Path, needed_files: Collection[str], kept_keys: Collection[str]
) -> Iterator[Path]:
    """Yield the files of arrays that nothing names.

    Parameters
    ----------
    results
        The results folder.
    needed_files
        Files that records name, as ``"forms/KEY.npz"``.
    kept_keys
        Keys in files that cannot be read as records.
    """
    for stage in get_args(Stage):
        for path in sorted((results / RUNS / stage).glob("*.npz")):
            is_named = f"{stage}/{path.name}" in needed_files
            if not is_named and path.stem not in kept_keys:
                yield path


def _keys_in(path: Path) -> set[str]:
    """Return the keys in a file that is no record, or one of another layout, with its own."""
    try:
        text = read_file(path, LARGEST_RECORDS_FILE)
    except OSError:
        text = b""
    return {path.stem, *(key.decode() for key in re.findall(rb"(?<!\w)[0-9a-f]{32}(?!\w)", text))}


def _files_of(record: Record) -> Iterator[str]:
    """Yield the files of a record; the frame of the camera is kept beside prepared shapes."""
    yield f"records/{record.key}.npz"
    yield f"prepared/{record.parts.get('the camera')}.npz"
    for side in record.sides:
        for stage, keys in side.files.items():
            for key in keys:
                yield f"{stage}/{key}.npz"
