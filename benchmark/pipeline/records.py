"""Records of finished jobs: one JSON object a job, checked when it is read."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
from msgspec import Meta

from benchmark.api.contracts import Input
from benchmark.errors import ConfigurationError
from benchmark.files import write_atomically
from benchmark.pipeline.cache import RUNS, StorageError, storing
from benchmark.pipeline.environment import has_edits
from benchmark.pipeline.measures import DECIMALS
from benchmark.text import LONGEST_NAME
from retrieval.measures import PRINTED

Share = Annotated[float, Meta(ge=0, le=1 + 1e-9)]  # rounding may push a mean slightly above 1
Seconds = Annotated[float, Meta(ge=0, le=1e9)]
Name = Annotated[str, Meta(pattern=r"^[^\x00-\x1f\x7f]*$", max_length=1000)]

Status = Literal[
    "ok", "failed", "crashed", "killed", "timeout", "memory", "unavailable", "unsupported"
]  # fmt: skip

#: Scorer of the tables.
DEFAULT_SCORER = "cm-bof"

#: Largest size of a file of records in bytes.
LARGEST_FILE = 2**28

#: Family of rows whose distances or forms come from other programs.
EXTERNAL = "external"


class Data(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The data set of a job: ``source`` is what the command line calls it."""

    name: Name
    title: Name
    source: Name
    stand_in_for: Name = ""
    quick: bool = False


class Model(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A trained model that a job used."""

    training: Name
    data: str
    digest: str
    schedule: str = ""
    extra_data: bool = False


class Note(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A number that preparation or method reported, over all shapes."""

    mean: float
    max: float


class Files(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Keys of the cached files of each shape, in the order of the gallery; meaningless on another machine."""

    prepared: list[str]
    forms: list[str]
    signatures: list[str]


class Record(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """What a finished job leaves: its scores, or why it has none.

    Parameters
    ----------
    key
        Digest of everything that determines the scores.
    status, reason, traceback
        Outcome of the job; what went wrong unless it is ``"ok"``.
    gallery, gallery_digest
        Name of the gallery, and the digest of its shapes, classes and data.
    input, method, title, family, parameters, seed
        What ran; ``parameters`` are those that differ from their defaults.
    scorer, scorer_title
        What compared the forms; "" for a descriptor.
    data, shapes, labels
        Data set, shapes and their classes, in the order of the distance matrix.
    scores, per_query
        Each measure: its mean, and its values; None for the only shape of a class. Published records have values of
        the printed measures only.
    tied_queries, lone_queries
        Numbers of queries with ties that matter, and of queries without a relevant shape.
    unsupported, unprepared
        Shapes without a result, with the reason, and those of them that could not be prepared for any method.
    models, seen
        Trained models, and shapes that they were trained on.
    notes
        Mean and maximum of each number that preparation or method reported.
    seconds
        Median seconds a shape by stage.
    finished, commit, packages
        When it ended, and by which code and packages.
    parts, files
        Digests of the parts of the key by name, and keys of cached files; in local records only.
    published
        Whether it was read from the published records; never stored.
    """

    key: Annotated[str, Meta(pattern="^[0-9a-f]{32}$")]
    status: Status
    gallery: Name
    gallery_digest: str
    input: Input
    method: Name
    title: Name
    family: Name
    data: Data
    shapes: list[Name]
    labels: list[Name]
    reason: str = ""
    traceback: str = ""
    parameters: dict[str, Any] = {}
    seed: int = 0
    scorer: Name = DEFAULT_SCORER
    scorer_title: Name = "CM-BOF"
    scores: dict[str, Share] = {}
    per_query: dict[str, list[Share | None]] = {}
    tied_queries: int = 0
    lone_queries: int = 0
    unsupported: list[tuple[Name, str]] = []
    unprepared: list[Name] = []
    models: list[Model] = []
    seen: list[Name] = []
    notes: dict[str, Note] = {}
    seconds: dict[str, Seconds] = {}
    finished: str = ""
    commit: str = ""
    packages: dict[str, str] = {}
    parts: dict[str, str] = {}
    files: Files | None = None
    published: bool = False

    @property
    def place(self) -> Place:
        """What the record is the result of; there is one result for each place."""
        return Place(self.gallery, self.input, self.method, self.seed, self.scorer)

    @property
    def answered(self) -> list[int]:
        """Indices of the shapes with a result, in the order of the distances."""
        refused = {name for name, _ in self.unsupported}
        return [number for number, name in enumerate(self.shapes) if name not in refused]

    @property
    def coverage(self) -> float:
        """Share of the shapes with a result; 0 without scores."""
        return len(self.answered) / len(self.shapes) if self.scores and self.shapes else 0.0


class Place(NamedTuple):
    """What a record is the result of."""

    gallery: str
    input: str
    method: str
    seed: int = 0
    scorer: str = DEFAULT_SCORER

    def __str__(self) -> str:
        seed = f" seed {self.seed}" if self.seed else ""
        return f"{self.gallery} {self.input} {self.method}{seed}" + (
            "" if self.scorer in ("", DEFAULT_SCORER) else f" by {self.scorer}"
        )


# Reading -------------------------------------------------------------------------------------------------------------


@dataclass
class Records:
    """Records of a results folder, one for each place, oldest first.

    Parameters
    ----------
    records
        The records.
    skipped
        A line for each file or line that is not a record.
    """

    records: list[Record] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)

    def __iter__(self) -> Iterator[Record]:
        return iter(self.records)


def read_records(results: Path, *, local: bool = True, published: bool = True) -> Records:
    """Read the records of a results folder: those of jobs that ran here, and published ones for other places.

    A published record fills in only where no record of other shapes of the gallery was made here. Damaged files and
    lines are named in ``skipped`` and passed over.
    """
    here = _read(sorted((results / RUNS / "records").glob("*.json"))) if local else Records()
    elsewhere = _read(sorted((results / "records").glob("*.jsonl"))) if published else Records()
    digests = {record.gallery: record.gallery_digest for record in here}
    fitting = (
        msgspec.structs.replace(record, published=True)
        for record in elsewhere
        if digests.get(record.gallery, record.gallery_digest) == record.gallery_digest
    )
    newest: dict[Place, Record] = {}
    for record in (*sorted(fitting, key=_age), *sorted(here, key=_age)):
        newest[record.place] = record
    return Records(sorted(newest.values(), key=_age), [*here.skipped, *elsewhere.skipped])


def _age(record: Record) -> tuple[str, str]:
    return record.finished, record.key


def _read(paths: Sequence[Path]) -> Records:
    found = Records()
    for path in paths:
        try:
            text = path.read_bytes() if path.stat().st_size <= LARGEST_FILE else None
        except OSError as error:
            found.skipped.append(f"skipped {path}: it cannot be read ({error.strerror})")
            continue
        if text is None:
            found.skipped.append(f"skipped {path}: it is larger than {LARGEST_FILE:,} bytes")
            continue
        is_one = path.suffix == ".json"
        for number, line in enumerate([text] if is_one else text.splitlines(), 1):
            where = str(path) if is_one else f"{path}:{number}"
            try:
                found.records.append(parse_record(line))
            except ConfigurationError as error:
                found.skipped.append(f"skipped {where}: {error.problem}; remove it")
    return found


_decoder = msgspec.json.Decoder(Record)


def parse_record(text: bytes) -> Record:
    """Return the record in a text; raise ``ConfigurationError`` that names the field if it is not one."""
    try:
        record = _decoder.decode(text)
    except (msgspec.DecodeError, RecursionError) as error:  # ValidationError is one
        raise ConfigurationError(f"it is not a record: {error}") from error
    for fault in _faults(record):
        raise ConfigurationError(f"it is not a record: {fault}")
    return record


def _faults(record: Record) -> Iterator[str]:
    """Yield the contradictions in a record whose fields have the right types."""
    known = set(record.shapes)
    if len(known) != len(record.shapes) or len(record.labels) != len(record.shapes):
        yield "`shapes` names a shape twice, or has another length than `labels`"
    for name in ("unprepared", "seen"):
        if not known.issuperset(getattr(record, name)):
            yield f"`{name}` names a shape that is not in `shapes`"
    if not known.issuperset(name for name, _ in record.unsupported):
        yield "`unsupported` names a shape that is not in `shapes`"
    if (record.status == "ok") != bool(record.scores) or not record.scores.keys() >= record.per_query.keys():
        yield "`scores`, `per_query` and `status` do not fit together"
    members = Counter(record.labels)
    lone = [members[label] < 2 for label in record.labels]
    for name, values in record.per_query.items():
        if [value is None for value in values] != lone:
            yield f"`per_query.{name}` does not fit `labels`"
            continue
        known_values = [value for value in values if value is not None]
        mean = sum(known_values) / len(known_values) if known_values else 0.0
        if abs(mean - record.scores[name]) > 10.0**-DECIMALS:
            yield f"`scores.{name}` is not the mean of its queries"


# Writing -------------------------------------------------------------------------------------------------------------


def write_record(results: Path, record: Record, replaces: str = "") -> None:
    """Write the record of a job that ran here, in place of the one with the key ``replaces``.

    Raises
    ------
    StorageError
        If it cannot be written.
    """
    folder = results / RUNS / "records"
    text = msgspec.json.format(msgspec.json.encode(record), indent=1)
    with storing(results):
        write_atomically(folder / f"{record.key}.json", lambda file: file.write(text), durable=True)
        if replaces not in ("", record.key):
            _remove(folder, replaces)


def forget(results: Path, is_meant: Callable[[Record], bool]) -> int:
    """Delete the records made here for which ``is_meant`` holds, with the cached files that only they use.

    Returns
    -------
    int
        Number of deleted records.
    """
    folder = results / RUNS / "records"
    here = _read(sorted(folder.glob("*.json"))).records
    meant = [record for record in here if is_meant(record)]
    meant_keys = {record.key for record in meant}
    needed = {key for record in here if record.key not in meant_keys for key in _files_of(record)}
    with storing(results):
        _remove(folder, *meant_keys)
        for kind, key in {key for record in meant for key in _files_of(record)} - needed:
            (results / RUNS / kind / f"{key}.npz").unlink(missing_ok=True)
    return len(meant)


def _files_of(record: Record) -> Iterator[tuple[str, str]]:
    if record.files:
        for kind in ("forms", "signatures"):
            yield from ((kind, key) for key in getattr(record.files, kind) if key)


def _remove(folder: Path, *keys: str) -> None:
    for key in keys:
        for suffix in (".json", ".npz"):
            (folder / f"{key}{suffix}").unlink(missing_ok=True)


# Joining and publishing ----------------------------------------------------------------------------------------------


@dataclass
class Merged:
    """Outcome of a merge.

    Parameters
    ----------
    added, known
        New records, and the number of those that were there.
    conflicts
        Pairs of records with one key and different scores; neither replaces the other.
    skipped
        A line for each file or line that is not a record.
    """

    added: list[Record] = field(default_factory=list)
    known: int = 0
    conflicts: list[tuple[Record, Record]] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)


def merge(folders: Iterable[Path], results: Path) -> Merged:
    """Add the records of other results folders to this one; results replace failures of the same job.

    Raises
    ------
    StorageError
        If a folder holds no records.
    """
    merged = Merged()
    known = {record.place: record for record in read_records(results, published=False)}
    for folder in folders:
        others = _read(sorted((folder / RUNS / "records").glob("*.json")))
        merged.skipped += others.skipped
        if not (folder / RUNS / "records").is_dir():
            raise StorageError(f"{folder} holds no records", "name a results folder, which has runs/records")
        for record in others:
            _add(record, known, results, merged)
    return merged


def _add(record: Record, known: dict[Place, Record], results: Path, merged: Merged) -> None:
    """Add a record unless there is one of its place; of two jobs, the newer one counts."""
    existing = known.get(record.place)
    is_other = existing is not None and existing.key != record.key and _age(existing) < _age(record)
    if existing is None or is_other or (existing.status != "ok" and record.status == "ok"):
        known[record.place] = msgspec.structs.replace(record, files=None)
        write_record(results, known[record.place], existing.key if existing else "")
        merged.added.append(record)
    elif (
        existing.key != record.key
        or record.status != "ok"
        or (record.scores, record.per_query) == (existing.scores, existing.per_query)
    ):
        merged.known += 1
    else:
        merged.conflicts.append((existing, record))


def publish(results: Path, is_public: Callable[[Record], bool]) -> Merged:
    """Write the public records made here among the published ones, in place of earlier ones of their places.

    Parameters
    ----------
    results
        The results folder.
    is_public
        Whether a record means something elsewhere: of a set and a method of the suite.

    Raises
    ------
    ConfigurationError
        If the working tree has changes, or the records of a gallery and input were made at several commits.
    """
    merged = Merged()
    here = [r for r in read_records(results, published=False) if is_public(r) and not r.data.quick]
    if has_edits():
        raise ConfigurationError("the working tree has changes", "commit them, and run again")
    commits: dict[str, set[str]] = {}
    for record in here:
        commits.setdefault(f"{record.gallery} {record.input}", set()).add(record.commit)
    for name, found in commits.items():
        if len(found) > 1 or any(commit.endswith("+") for commit in found):
            raise ConfigurationError(
                f"the rows of {name} were made at {', '.join(sorted(found))}", "run them again at one commit"
            )
    published = _read(sorted((results / "records").glob("*.jsonl")))
    newest = {record.place: record for record in sorted(published, key=_age)}
    for record in here:
        if record.status != "unavailable" and newest.get(record.place) != (public := portable(record)):
            newest[record.place] = public
            merged.added.append(public)
    write_published(results, newest.values())
    merged.known = len(newest) - len(merged.added)
    return merged


def portable(record: Record) -> Record:
    """Return a record without what means nothing on another machine."""
    per_query = {name: values for name, values in record.per_query.items() if name in PRINTED}
    return msgspec.structs.replace(record, per_query=per_query, parts={}, files=None, traceback="", published=False)


def write_published(results: Path, records: Iterable[Record]) -> None:
    """Write records as lines, a file for each data set, in the order of their places."""
    files: dict[str, list[Record]] = {}
    for record in sorted(records, key=lambda record: record.place):
        base = re.sub("[^A-Za-z0-9-]+", "-", record.data.name.partition("[")[0])[:LONGEST_NAME]
        files.setdefault(f"{base or 'records'}.jsonl", []).append(record)
    folder = results / "records"
    with storing(results):
        for name, of_file in files.items():
            text = b"".join(msgspec.json.encode(record) + b"\n" for record in of_file)
            write_atomically(folder / name, lambda file, text=text: file.write(text), durable=True)  # type: ignore[misc]
        for path in folder.glob("*.jsonl"):
            if path.name not in files:
                path.unlink()


def describe_change(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Say in words which parts of a key changed: ``gps.py changed; numpy 2.3 -> 2.4``; at most three of them."""
    changed = [name for name in sorted(before.keys() | now.keys()) if before.get(name) != now.get(name)]
    texts = [_in_words(name, before.get(name, ""), now.get(name, "")) for name in changed]
    few = list(dict.fromkeys(texts))
    return "; ".join(few[:3]) + (f"; and {len(few) - 3} more" if len(few) > 3 else "") or "the code changed"


def _in_words(name: str, before: str, now: str) -> str:
    if name.startswith(("its ", "the ")):
        return f"{name} changed"
    if re.fullmatch("[0-9a-f]{16}", now or before):  # the digest of a file
        return f"{Path(name).name} changed"
    return f"{name} {before or 'none'} -> {now or 'none'}"
