"""Records of finished jobs: one JSON object per job, checked when it is read."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from benchmark.api.contracts import Input
from benchmark.api.datasets import name_view
from benchmark.code_digest import ROOT, digest, digest_of_bytes
from benchmark.defaults import DEFAULT_SCORER, RESULTS
from benchmark.files import read_file, write_atomically
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.cache import RUNS, Cache, Stage, StorageError, storing
from benchmark.pipeline.code_store import definitions_file
from benchmark.pipeline.record_layout import (
    LAYOUT,
    LAYOUT_FIELD,
    NewerRecord,
    RecordError,
    check_layout,
    content_of,
    convert_older,
    gather_unknown,
    is_newer,
)
from benchmark.reference.paper import PRINTED_MEASURES
from benchmark.text import LONGEST_MESSAGE, brief, clean_text, counted, say
from retrieval.measures import Targets

#: A number between 0 and 1; rounding may push a mean slightly above 1.
Share = Annotated[float, Meta(ge=0, le=1 + 1e-9)]

#: A duration.
Seconds = Annotated[float, Meta(ge=0, le=1e9)]

#: Text without control characters.
PrintableText = Annotated[str, Meta(pattern=r"^[^\x00-\x1f\x7f]*$", max_length=30_000)]

#: Key of a file of the cache; "" where there is none.
Key = Annotated[str, Meta(pattern=r"^([0-9a-f]{32})?\Z")]

#: A number of things.
Count = Annotated[int, Meta(ge=0)]

#: Name of a measure: it has a capital letter, so that no fact of a job has its name.
MeasureName = Annotated[str, Meta(pattern=r"^[a-z]{0,9}[A-Z][A-Za-z0-9@-]{0,19}\Z")]

#: ``"unavailable"`` is the state of a job in a plan; no record says it.
Status = Literal[
    "ok", "failed", "crashed", "timeout", "memory", "incomplete", "unavailable", "unsupported"
]

#: Results in an installed package.
_INSTALLED_RESULTS = ROOT / "benchmark" / "results"

#: Results folder of the suite, with its published records.
SUITE_RESULTS = _INSTALLED_RESULTS if _INSTALLED_RESULTS.is_dir() else ROOT / "results"

#: Largest size of a file of records, in bytes.
LARGEST_RECORDS_FILE = 2**28

#: Family of rows whose distances or forms come from other programs.
EXTERNAL = "external"


class RecordPart(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A part of a record.

    Parameters
    ----------
    unknown
        Its fields that this release does not know; in a file they stand among the others.
    """

    unknown: dict[str, Any] = {}


class Data(RecordPart, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The data set of a job.

    Parameters
    ----------
    name, title, source
        Its name, also in tables, and what the command line calls it.
    stand_in_for
        The official set that it replaces.
    quick, n_shapes
        Whether poses were omitted, and the number of shapes without that; 0 if unknown.
    path
        Where a folder lies; "" for a set of the suite.
    """

    name: PrintableText
    title: PrintableText
    source: PrintableText
    stand_in_for: PrintableText = ""
    quick: bool = False
    n_shapes: Count = 0
    path: PrintableText = ""


class RecordedModel(RecordPart, frozen=True, forbid_unknown_fields=True):
    """A trained model that a job used."""

    training: PrintableText
    data: str
    digest: str
    schedule: str = ""
    extra_data: bool = False


class Note(RecordPart, frozen=True, forbid_unknown_fields=True):
    """A number that preparation or method reported, over all shapes."""

    mean: float
    max: float


class Origin(RecordPart, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Where a merged record came from.

    Parameters
    ----------
    folder
        The results folder, as it was named.
    plugins
        Digests of the files of its plugins by name: the first 16 digits of their SHA-256. Empty for
        methods of the suite.
    """

    folder: PrintableText
    plugins: dict[PrintableText, str] = {}


class ShapeView(NamedTuple):
    """What a job takes of a shape: its complete surface, or one depth image of it.

    Parameters
    ----------
    name
        Name of the shape, or of the view where each shape has several.
    shape
        Name of the shape.
    keys
        Keys of its cached files by stage, in the order in which they are made.
    """

    name: str
    shape: str
    keys: dict[Stage, str]


class RankedShapes(
    RecordPart, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True
):
    """Shapes that a job ranks.

    Parameters
    ----------
    gallery, gallery_digest
        Name of the gallery, and the digest of its shapes, classes and data.
    input
        ``"mesh"`` or ``"view"``.
    data, shapes, labels
        Data set, shapes and their classes, in the order of the distance matrix.
    unsupported, unprepared
        Shapes without a result, with the reason, and those of them that could not be prepared for
        any method.
    files
        Keys of the cached files of each shape, or of each of its views; in local records only.
    views
        Number of views of each shape; its distance from a query is the least of theirs.
    """

    gallery: PrintableText
    gallery_digest: str
    input: Input
    data: Data
    shapes: list[PrintableText]
    labels: list[PrintableText]
    unsupported: list[tuple[PrintableText, str]] = []
    unprepared: list[PrintableText] = []
    files: dict[Stage, list[Key]] = {}
    views: Annotated[int, Meta(ge=1)] = 1

    @property
    def views_of_shapes(self) -> list[ShapeView]:
        """All views of all shapes, in the order of the files."""
        views = []
        for number in range(len(self.shapes) * self.views):
            shape = self.shapes[number // self.views]
            name = name_view(shape, number % self.views) if self.views > 1 else shape
            keys = {stage: keys[number] for stage, keys in self.files.items() if keys[number]}
            views.append(ShapeView(name, shape, keys))
        return views

    @property
    def answered(self) -> list[int]:
        """Indices of the shapes with a result, in the order of the distances."""
        refused = {name for name, _ in self.unsupported}
        return [index for index, name in enumerate(self.shapes) if name not in refused]


class Record(
    RankedShapes, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True
):
    """What a finished job leaves: its scores, or why it has none; its shapes are the queries.

    Parameters
    ----------
    key, result_key
        Digests of everything that determines the scores, with and without the paths of the data.
    status, reason, traceback
        Outcome of the job; what went wrong unless it is ``"ok"``.
    gallery_of_queries, keeps_same_names
        The gallery, unless it is the queries, and whether a query leaves out no shape of its own
        name.
    method, title, family, cite, parameters, defaults, seed
        What ran; ``parameters`` are those that differ from their defaults, ``defaults`` all others.
    summary
        What the method does, in a sentence, if it is a plugin; since layout 1.1.
    scorer, scorer_title
        What compared the forms; "" for a descriptor.
    scores, per_query
        Each measure: its mean, and its values; None without another shape of the class. Published
        records have values of the printed measures only.
    draw_errors
        Standard error of each mean over the draws of the scorer; empty for a single draw.
    distances
        Digest of its published distances; "" if there are none.
    tied_queries, lone_queries
        Numbers of queries with ties that matter, and of queries without a relevant shape.
    models, seen
        Trained models, and shapes that they were trained on.
    notes
        Mean and maximum of each number that preparation or method reported.
    seconds, processor_seconds
        Median seconds per shape by stage: of the wall, and of the processor, which old records
        lack.
    machines
        The machines that made the forms, none if they are unknown.
    finished, commit, packages
        When it ended, and by which code and packages.
    parts
        Digests of the parts of the key by name; in local records only.
    merged_from
        The results folder that it was merged from; None if its job ran here.
    layout
        Major and minor version of its layout.
    published
        Whether it was read from the published records; never stored.
    checksum
        Digest of all other fields in a file, in which a damaged digit would be another figure; ""
        in memory.
    """

    key: Annotated[str, Meta(pattern=r"^[0-9a-f]{32}\Z")]
    status: Status
    method: PrintableText
    title: PrintableText
    family: PrintableText
    gallery_of_queries: RankedShapes | None = msgspec.field(default=None, name="against")
    keeps_same_names: bool = False
    reason: str = ""
    traceback: str = ""
    result_key: str = ""
    cite: str = ""
    summary: str = ""
    parameters: dict[str, Any] = {}
    defaults: dict[str, Any] = {}
    seed: int = 0
    scorer: PrintableText = DEFAULT_SCORER
    scorer_title: PrintableText = "CM-BOF"
    scores: dict[MeasureName, Share] = {}
    per_query: dict[MeasureName, list[Share | None]] = {}
    draw_errors: dict[MeasureName, Share] = {}
    distances: Annotated[str, Meta(pattern=r"^([0-9a-f]{16})?\Z")] = ""
    tied_queries: Count = 0
    lone_queries: Count = 0
    models: list[RecordedModel] = []
    seen: list[PrintableText] = []
    notes: dict[str, Note] = {}
    seconds: dict[str, Seconds] = {}
    processor_seconds: dict[str, Seconds] = {}
    machines: list[PrintableText] = []
    finished: str = ""
    commit: str = ""
    packages: dict[str, str] = {}
    parts: dict[str, str] = {}
    merged_from: Origin | None = None
    layout: tuple[int, int] = LAYOUT
    published: bool = False
    checksum: str = ""

    @property
    def row(self) -> RowId:
        """What the record is the result of; there is one for each row."""
        paths = tuple(side.data.path for side in self.sides)
        return RowId(self.gallery, self.input, self.method, self.seed, self.scorer, paths)

    @property
    def base_name(self) -> str:
        """Name of the method without parameters."""
        return self.method.partition("[")[0]

    @property
    def sides(self) -> tuple[RankedShapes, ...]:
        """The queries, and the gallery if it is another one."""
        return (self, self.gallery_of_queries) if self.gallery_of_queries else (self,)

    @property
    def targets(self) -> Targets | None:
        """The gallery for measures; None if it is the queries."""
        gallery = self.gallery_of_queries
        if gallery is None:
            return None
        index_of_shape: dict[str, int] = {}
        if not self.keeps_same_names:
            index_of_shape = {name: index for index, name in enumerate(gallery.shapes)}
        left_out = [index_of_shape.get(name, -1) for name in self.shapes]
        return Targets(gallery.labels, left_out)

    def without_files(self) -> Record:
        """Return the record for a folder that does not keep its files."""
        gallery = self.gallery_of_queries
        if gallery:
            gallery = msgspec.structs.replace(gallery, files={})
        return msgspec.structs.replace(self, files={}, gallery_of_queries=gallery)

    @property
    def are_queries(self) -> list[bool]:
        """Whether each query has something to find: another shape of its class in the gallery.

        Those that have not count nowhere.
        """
        gallery = self.gallery_of_queries or self
        n_of_class = Counter(gallery.labels)
        # A query is left out of its own results, as is a shape of its name in another gallery.
        left_out: set[tuple[str, str]] = set()
        if not self.keeps_same_names:
            left_out = set(zip(gallery.shapes, gallery.labels, strict=True))
        are_queries = []
        for name, label in zip(self.shapes, self.labels, strict=True):
            n_itself = 1 if (name, label) in left_out else 0
            are_queries.append(n_of_class[label] > n_itself)
        return are_queries

    @property
    def coverage(self) -> float:
        """Share of the shapes with a result; 0 without scores."""
        if not self.scores or not self.shapes:
            return 0.0
        return len(self.answered) / len(self.shapes)

    @property
    def refusals(self) -> str:
        """How many shapes were refused, and why the first one; "" if none was."""
        if not self.unsupported:
            return ""
        shape, reason = self.unsupported[0]
        return f"{len(self.unsupported)} refused, {shape}: {reason}"


class RowId(NamedTuple):
    """What a record is the result of: a row of a table on one gallery.

    Parameters
    ----------
    gallery, input, method, seed, scorer
        As in the record.
    paths
        Paths of the data of the queries, and of another gallery.
    """

    gallery: str
    input: Input
    method: str
    seed: int = 0
    scorer: str = DEFAULT_SCORER
    paths: tuple[str, ...] = ("",)

    def __str__(self) -> str:
        seed = f" seed {self.seed}" if self.seed else ""
        by = f" by {self.scorer}" if self.scorer not in ("", DEFAULT_SCORER) else ""
        return f"{self.gallery} {self.input} {self.method}{seed}{by}"


def key_at(result_key: str, paths: Sequence[str]) -> str:
    """Return the key of a record: a folder at another path is another data set."""
    return digest([result_key, *paths]) if any(paths) else result_key


# Checks
# ------------------------------------------------------------------------------------------------

#: Most shapes of a gallery: a matrix of their distances has 20 GB.
MOST_SHAPES = 50_000

#: Most views of a shape.
MOST_VIEWS = 1000

#: Largest difference between a score and the mean of its values per query, which are rounded.
LARGEST_DIFFERENCE = 1e-6


def find_contradiction(record: Record) -> str:
    """Say which fields of a record contradict each other, or cannot be true; "" if none do.

    A record that was edited by hand, or put together wrongly, is told in this way.
    """
    for side in record.sides:
        fault = _fault_of_shapes(side)
        if fault:
            return fault
    fault = _fault_of_queries(record)
    if fault:
        return fault
    if record.status == "ok":
        return _fault_of_scores(record)
    if record.scores or record.per_query or record.draw_errors:
        return f"its status is '{record.status}', and it has scores"
    return ""


def _fault_of_queries(record: Record) -> str:
    """Say what is wrong with the queries of a record, and with its key; "" if nothing is."""
    if record.views != 1:
        return f"its queries have {record.views} views each"
    if record.result_key and record.key != key_at(record.result_key, record.row.paths):
        return "its key is not that of its result at its paths"
    strangers = {*record.seen} - {*record.shapes}
    if strangers:
        return f"a shape seen in training, '{min(strangers)}', is none of its shapes"
    if len({*record.sides[-1].labels}) == 1:
        return "its gallery has one class, so that every ranking is perfect"
    if not any(record.are_queries):
        return "no query has another shape of its class to find"
    return ""


def _fault_of_shapes(side: RankedShapes) -> str:
    """Say what is wrong with the lists of shapes, classes and files of queries or gallery.

    They must be of one length and within bounds. "" if nothing is wrong.
    """
    n_shapes = len(side.shapes)
    if not n_shapes:
        return "it has no shapes"
    if n_shapes > MOST_SHAPES:
        return f"it has {n_shapes:,} shapes, more than {MOST_SHAPES:,}"
    if side.views > MOST_VIEWS:
        return f"its shapes have {side.views:,} views each, more than {MOST_VIEWS:,}"
    if len(side.labels) != n_shapes:
        return f"it has {counted(n_shapes, 'shape')} and {counted(len(side.labels), 'label')}"
    fault = _fault_of_names(side)
    if fault:
        return fault
    for stage, keys in side.files.items():
        if len(keys) != n_shapes * side.views:
            return f"it has {counted(len(keys), 'file')} of {stage} for {n_shapes} shapes"
    if not side.gallery.startswith(side.data.name):
        return f"its gallery, '{side.gallery}', is not of its data set, '{side.data.name}'"
    return ""


def _fault_of_names(side: RankedShapes) -> str:
    """Say which name of a shape stands twice in a list, or in a list where it must not be.

    "" if none does.
    """
    refused = [name for name, _ in side.unsupported]
    lists = {"shape": side.shapes, "refused shape": refused, "unprepared shape": side.unprepared}
    for what, names in lists.items():
        repeated = _first_repeated(names)
        if repeated:
            return f"{what} '{repeated}' stands there twice"
    strangers = {*refused} - {*side.shapes}
    if strangers:
        return f"a refused shape, '{min(strangers)}', is none of its shapes"
    strangers = {*side.unprepared} - {*refused}
    if strangers:
        return f"an unprepared shape, '{min(strangers)}', is not refused"
    return ""


def _first_repeated(names: Sequence[str]) -> str | None:
    """Return the first name that occurs in a sequence twice; None if all differ."""
    counts = Counter(names)
    for name in names:
        if counts[name] > 1:
            return name
    return None


def _fault_of_scores(record: Record) -> str:
    """Say which scores of a record contradict its values per query; "" if none do."""
    are_queries = record.are_queries
    n_lone = are_queries.count(False)
    n_queries = are_queries.count(True)
    if record.lone_queries != n_lone:
        return f"it has {record.lone_queries} queries without a relevant shape, not {n_lone}"
    if record.tied_queries > n_queries:
        return f"it has {record.tied_queries} queries with ties among {n_queries}"
    for measure in PRINTED_MEASURES:
        if measure not in record.scores or measure not in record.per_query:
            return f"it has no {measure}"
    for measure in (*record.per_query, *record.draw_errors):
        if measure not in record.scores:
            return f"it has values of {measure}, and no score"
    for measure in record.per_query:
        fault = _fault_of_measure(record, measure, are_queries)
        if fault:
            return fault
    return ""


def _fault_of_measure(record: Record, measure: str, are_queries: Sequence[bool]) -> str:
    """Say what is wrong with the values of one measure per query; "" if nothing is.

    Parameters
    ----------
    record
        The record.
    measure
        Name of the measure.
    are_queries
        Whether each shape has something to find; the others have no value.
    """
    values = record.per_query[measure]
    if len(values) != len(are_queries):
        return f"it has {len(are_queries)} queries and {counted(len(values), 'value')} of {measure}"
    if [value is not None for value in values] != list(are_queries):
        return f"{measure} is missing for a query, or there for a shape that is none"
    refused = {name for name, _ in record.unsupported}
    for shape, value in zip(record.shapes, values, strict=True):
        if value and shape in refused:
            return f"{measure} of a refused shape is not 0"
    values_of_queries = [value for value in values if value is not None]
    mean = sum(values_of_queries) / len(values_of_queries)
    score = record.scores[measure]
    if abs(mean - score) > LARGEST_DIFFERENCE:
        return f"{measure} is {score:.6f}, and the mean of its queries {mean:.6f}"
    return ""


# Reading
# ------------------------------------------------------------------------------------------------


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

    Published records stand for rows that did not run here, unless a record from here is of other
    shapes of the same gallery. Damaged files and lines are named on stderr and passed over.

    Parameters
    ----------
    results
        The results folder.
    local, published
        Whether to read records of jobs that ran here, and published ones.
    """
    here: list[Record] = []
    if local:
        here = sorted(read_files(local_files(results)), key=age_of)
    digests = {record.gallery: record.gallery_digest for record in here}
    fitting: list[Record] = []
    if published:
        folder = published_folder(results) / "records"
        for record in read_files(folder.glob("*.jsonl")):
            digest_here = digests.get(record.gallery, record.gallery_digest)
            if record.gallery_digest == digest_here:
                fitting.append(msgspec.structs.replace(record, published=True))
    return last_of_rows([*sorted(fitting, key=age_of), *here])


def local_files(results: Path) -> list[Path]:
    """Return the files of the records of jobs that ran here."""
    return sorted((results / RUNS / "records").glob("*.json"))


def last_of_rows(records: Sequence[Record]) -> list[Record]:
    """Return the last record of each row, oldest first.

    Those of other shapes than the rest of their gallery are named on stderr and left out.
    """
    last = {record.row: record for record in _of_same_shapes(records)}
    return sorted(last.values(), key=age_of)


def _of_same_shapes(records: Sequence[Record]) -> list[Record]:
    """Leave out records that name other shapes or classes than most records of their gallery do.

    The digest of a gallery is that of its shapes and classes, so one of these records is false. It
    is named on stderr. Of two lists that are equally frequent, that of the oldest record counts.
    """
    lists_of_shapes = [facts_of_shapes(record) for record in records]
    counts: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for record, shapes in zip(records, lists_of_shapes, strict=True):
        counts[record.gallery_digest][shapes] += 1

    most_frequent = {}
    for gallery, count in counts.items():
        most_frequent[gallery] = max(count, key=count.__getitem__)
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
    """Read the records in files, and note the files and lines that are none.

    Parameters
    ----------
    paths
        Files. A ``.json`` file holds one record and is named by its key; a ``.jsonl`` file holds
        one per line.
    """
    records: list[Record] = []
    skipped: list[SkippedRecord] = []
    for path in sorted(paths):
        try:
            text = read_file(path, LARGEST_RECORDS_FILE)
        except OSError as error:
            skipped.append(SkippedRecord(str(path), RecordError(str(error.strerror))))
            continue
        if path.suffix == ".json":
            texts = {str(path): text}
            key = path.stem
        else:
            texts = {f"{path}:{number}": line for number, line in enumerate(text.splitlines(), 1)}
            key = ""
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


def parse_record(text: bytes) -> Record:
    """Return the record that a JSON text holds, after all checks.

    Raises
    ------
    NewerRecord
        If its layout is of a newer major version.
    RecordError
        If it is none, was changed after it was written, or contradicts itself.
    """
    content, is_whole = _parse_content(text)
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


def record_of(content: Mapping[str, Any]) -> Record:
    """Return the record of a content, in which text that no record may hold is escaped."""
    try:
        return msgspec.convert(content, Record)
    except msgspec.ValidationError:
        return msgspec.convert(_escaped(content), Record)


def _escaped(value: Any) -> Any:
    """Return a content whose texts are printable and short, but for tracebacks."""
    if isinstance(value, Mapping):
        escaped = {clean_text(name): _escaped(each) for name, each in value.items()}
        if "traceback" in value:
            escaped["traceback"] = value["traceback"]
        return escaped
    if isinstance(value, list | tuple):
        return [_escaped(each) for each in value]
    return brief(value, LONGEST_MESSAGE) if isinstance(value, str) else value


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
        If it cannot be written, or its file holds a record in a newer layout.
    """
    folder = results / RUNS / "records"
    newer_record = newer_record_at(results, record.key)
    if newer_record:
        raise StorageError(newer_record, "update the suite, or choose another --results DIR")
    try:
        text = encode_record(record)
    except UnicodeEncodeError:  # from names of files that are not UTF-8
        text = encode_record(msgspec.convert(_escaped(msgspec.to_builtins(record)), Record))
    text = msgspec.json.format(text, indent=1)
    with storing(results):
        write_atomically(folder / f"{record.key}.json", lambda file: file.write(text), durable=True)
        if replaces not in ("", record.key):
            (folder / f"{replaces}.json").unlink(missing_ok=True)
            (folder / f"{replaces}.npz").unlink(missing_ok=True)


def newer_record_at(results: Path, key: str) -> str:
    """Return why the record under a key may not be replaced: its layout is newer; "" if it may."""
    path = results / RUNS / "records" / f"{key}.json"
    if not path.exists():
        return ""
    for skipped in scan_files([path]).skipped:
        if isinstance(skipped.error, NewerRecord):
            return f"{path}: {skipped.error.problem}"
    return ""


def unneeded(
    results: Path, is_unwanted: Callable[[Record], bool], named: Collection[str] = ()
) -> tuple[list[Record], list[Path]]:
    """Return the records to delete, and all files that nothing else needs.

    Only records count that were made here.

    Parameters
    ----------
    results
        The results folder.
    is_unwanted
        Returns whether a record is one to delete.
    named
        Rows or keys of further records to delete. A key is the name of a file, which may be one
        that is not used as a record; such files are kept otherwise, with all files whose keys they
        hold.
    """
    runs = results / RUNS
    paths = local_files(results)
    records = sorted(read_files(paths), key=age_of)
    unwanted = []
    needed_files: set[str] = set()
    for record in records:
        if is_unwanted(record) or record.key in named or str(record.row) in named:
            unwanted.append(record)
        else:
            needed_files.update(_files_of(record))

    # Files that are not used as records are kept, unless they are named.
    files = [runs / "records" / f"{record.key}.json" for record in unwanted]
    kept_keys: set[str] = set()
    keys_of_records = {record.key for record in records}
    for path in paths:
        if path.stem in keys_of_records:
            continue
        if path.stem in named:
            files.append(path)
        else:
            kept_keys |= _keys_in(path)

    # Arrays go that no record that stays, and no unread file, names.
    for stage in get_args(Stage):
        for path in sorted((runs / stage).glob("*.npz")):
            is_needed = f"{stage}/{path.name}" in needed_files or path.stem in kept_keys
            if not is_needed:
                files.append(path)

    is_all_unwanted = len(unwanted) == len(records) and not kept_keys
    if is_all_unwanted and definitions_file(results).is_file():
        files.append(definitions_file(results))
    return unwanted, files


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


# Files of a record
# ------------------------------------------------------------------------------------------------


#: Arrays of prepared shapes and forms that pages and figures read.
_READ = ("vertices", "faces", "vertex_map", "note:vertices_before")


def read_distances(results: Path, record: Record) -> NDArray[np.float64] | None:
    """Return the distances that a record was scored by, of queries and shapes with a result.

    They are means over the draws of the scorer, shape (queries, shapes of the gallery). Published
    ones have single precision.

    Parameters
    ----------
    results
        The results folder.
    record
        The record.

    Returns
    -------
    numpy.ndarray or None
        None if they are not here, or their file is damaged, which is said on stderr.
    """
    shape = len(record.answered), len(record.sides[-1].answered)
    arrays = Cache(results).read("records", record.key) or {}
    distances = arrays.get("distances")
    if distances is not None and distances.shape == shape:
        return distances
    if not record.distances:
        return None
    path = published_distances(results, record.distances)
    try:
        distances = _read_published(path, record.distances)
    except (OSError, ValueError) as error:
        _say_skipped(f"{path}: {getattr(error, 'strerror', error)}")
        return None
    return distances if distances.shape == shape else None


def _read_published(path: Path, digest: str) -> NDArray[np.float64]:
    """Return the matrix of published distances; raise ``ValueError`` if they were changed."""
    from scipy.spatial.distance import squareform  # lazy: tables need no distances

    content = read_file(path)
    above_diagonal = np.frombuffer(content, "<f4")
    if digest_of_bytes(content) != digest or not np.isfinite(above_diagonal).all():
        raise ValueError("it was changed after it was published")
    return np.asarray(squareform(above_diagonal.astype(np.float64)))


def published_distances(results: Path, digest: str) -> Path:
    """Return the file of published distances.

    It holds those above the diagonal, by row, as numbers of four bytes.
    """
    return published_folder(results) / "records" / "distances" / f"{digest}.f4"


def read_prepared(results: Path, record: RankedShapes, shape: str) -> Mesh | None:
    """Return the prepared surface of a shape of a record.

    None means that it is not kept here, or could not be prepared.
    """
    arrays = _read_arrays(results, record, "prepared", shape)
    return Mesh(arrays["vertices"], arrays["faces"]) if "vertices" in arrays else None


def read_form(results: Path, record: RankedShapes, shape: str) -> Mesh | None:
    """Return the canonical form of a shape of a record; None if it is not kept here, or none is."""
    form = _read_arrays(results, record, "forms", shape)
    # A form that keeps the faces of its shape is stored without them.
    faces = form.get("faces")
    if faces is None:
        faces = _read_arrays(results, record, "prepared", shape).get("faces")
    if "vertices" not in form or faces is None:
        return None
    return Mesh(form["vertices"], faces)


def read_vertex_map(
    results: Path, record: Record, shape: str
) -> tuple[NDArray[np.int64], bool] | None:
    """Return which vertices of its file a form has.

    Returns
    -------
    numpy.ndarray
        Index of the nearest vertex of the file at each vertex of the form.
    bool
        Whether the form has each vertex of the file once.

    None means that the form has vertices of its own, as those of views have, or is not kept here.
    """
    form = _read_arrays(results, record, "forms", shape)
    prepared = _read_arrays(results, record, "prepared", shape)
    if "vertex_map" not in prepared or "vertices" not in form or "faces" in form:
        return None
    indices = prepared["vertex_map"].astype(np.int64)
    n_vertices = int(prepared["note:vertices_before"])
    has_all = np.array_equal(np.sort(indices), np.arange(n_vertices))
    return indices, has_all


def _read_arrays(
    results: Path, record: RankedShapes, stage: Stage, shape: str
) -> dict[str, NDArray[Any]]:
    """Return arrays of the first view of a shape; none if they are not kept here."""
    keys_of_first_views = record.files.get(stage, [])[:: record.views]
    key_of_shape = dict(zip(record.shapes, keys_of_first_views, strict=False))
    return Cache(results).read(stage, key_of_shape.get(shape, ""), only=_READ) or {}
