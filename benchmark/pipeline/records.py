"""Records of finished jobs: one JSON object a job, checked when it is read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
from benchmark.files import read_file, write_atomically
from benchmark.geometry.mesh import Mesh
from benchmark.pipeline.cache import RUNS, Cache, Stage, storing
from benchmark.text import LONGEST_MESSAGE, brief, clean, say
from retrieval.measures import Targets

Share = Annotated[float, Meta(ge=0, le=1 + 1e-9)]  # rounding may push a mean slightly above 1
Seconds = Annotated[float, Meta(ge=0, le=1e9)]
Name = Annotated[str, Meta(pattern=r"^[^\x00-\x1f\x7f]*$", max_length=30_000)]
Key = Annotated[str, Meta(pattern="^([0-9a-f]{32})?$")]

#: ``"unavailable"`` is the state of a job in a plan; no record says it.
Status = Literal[
    "ok", "failed", "crashed", "timeout", "memory", "incomplete", "unavailable", "unsupported"
]

#: Results folder of the suite, with its published records: in an installed package, or in the
#: checkout.
SUITE_RESULTS = next(filter(Path.is_dir, [ROOT / "benchmark" / "results"]), ROOT / "results")

#: Scorer of the tables.
DEFAULT_SCORER = "cm-bof"

#: Largest size of a file of records in bytes.
LARGEST_FILE = 2**28

#: Family of rows whose distances or forms come from other programs.
EXTERNAL = "external"


class Data(msgspec.Struct, frozen=True, omit_defaults=True):
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

    name: Name
    title: Name
    source: Name
    stand_in_for: Name = ""
    quick: bool = False
    n_shapes: int = 0
    path: Name = ""


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


class RankedShapes(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True
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

    gallery: Name
    gallery_digest: str
    input: Input
    data: Data
    shapes: list[Name]
    labels: list[Name]
    unsupported: list[tuple[Name, str]] = []
    unprepared: list[Name] = []
    files: dict[Stage, list[Key]] = {}
    views: Annotated[int, Meta(ge=1)] = 1

    @property
    def file_names(self) -> list[str]:
        """Names of the shapes, or of their views, in the order of the files."""
        return [
            name_view(name, k) if self.views > 1 else name
            for name in self.shapes
            for k in range(self.views)
        ]

    @property
    def answered(self) -> list[int]:
        """Indices of the shapes with a result, in the order of the distances."""
        refused = {name for name, _ in self.unsupported}
        return [number for number, name in enumerate(self.shapes) if name not in refused]

    @property
    def keys(self) -> list[dict[Stage, str]]:
        """Keys of the cached files of each shape, in the order in which they are made."""
        rows = zip(*self.files.values(), strict=True)
        return [
            {stage: key for stage, key in zip(self.files, row, strict=True) if key} for row in rows
        ]


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
    published
        Whether it was read from the published records; never stored.
    checksum
        Digest of all other fields in a file, in which a damaged digit would be another figure; ""
        in memory.
    """

    key: Annotated[str, Meta(pattern="^[0-9a-f]{32}$")]
    status: Status
    method: Name
    title: Name
    family: Name
    gallery_of_queries: RankedShapes | None = msgspec.field(default=None, name="against")
    keeps_same_names: bool = False
    reason: str = ""
    traceback: str = ""
    result_key: str = ""
    cite: str = ""
    parameters: dict[str, Any] = {}
    defaults: dict[str, Any] = {}
    seed: int = 0
    scorer: Name = DEFAULT_SCORER
    scorer_title: Name = "CM-BOF"
    scores: dict[str, Share] = {}
    per_query: dict[str, list[Share | None]] = {}
    draw_errors: dict[str, Share] = {}
    distances: Annotated[str, Meta(pattern="^([0-9a-f]{16})?$")] = ""
    tied_queries: int = 0
    lone_queries: int = 0
    models: list[Model] = []
    seen: list[Name] = []
    notes: dict[str, Note] = {}
    seconds: dict[str, Seconds] = {}
    processor_seconds: dict[str, Seconds] = {}
    machines: list[Name] = []
    finished: str = ""
    commit: str = ""
    packages: dict[str, str] = {}
    parts: dict[str, str] = {}
    published: bool = False
    checksum: str = ""

    @property
    def row(self) -> Row:
        """What the record is the result of; there is one for each row."""
        paths = tuple(side.data.path for side in self.sides)
        return Row(self.gallery, self.input, self.method, self.seed, self.scorer, paths)

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
        places = (
            {}
            if self.keeps_same_names
            else {name: place for place, name in enumerate(gallery.shapes)}
        )
        return Targets(gallery.labels, [places.get(name, -1) for name in self.shapes])

    def without_files(self) -> Record:
        """Return the record for a folder that does not keep its files."""
        gallery = self.gallery_of_queries and msgspec.structs.replace(
            self.gallery_of_queries, files={}
        )
        return msgspec.structs.replace(self, files={}, gallery_of_queries=gallery)

    @property
    def are_queries(self) -> list[bool]:
        """Whether each query has something to find; those that have not count nowhere."""
        gallery = self.gallery_of_queries or self
        own = (
            set() if self.keeps_same_names else {*zip(gallery.shapes, gallery.labels, strict=True)}
        )
        members, queries = Counter(gallery.labels), zip(self.shapes, self.labels, strict=True)
        return [members[label] > ((name, label) in own) for name, label in queries]

    @property
    def coverage(self) -> float:
        """Share of the shapes with a result; 0 without scores."""
        return len(self.answered) / len(self.shapes) if self.scores and self.shapes else 0.0

    @property
    def refusals(self) -> str:
        """How many shapes were refused, and why the first one; "" if none was."""
        return "".join(
            f"{len(self.unsupported)} refused, {shape}: {why}"
            for shape, why in self.unsupported[:1]
        )


class Row(NamedTuple):
    """What a record is the result of; the paths are those of the data of its queries and of another gallery."""

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
    """Return the key of a record of data at some paths: a folder at another path is another data set."""
    return digest([result_key, *paths]) if any(paths) else result_key


# Reading
# ------------------------------------------------------------------------------------------------


def read_records(results: Path, *, local: bool = True, published: bool = True) -> list[Record]:
    """Read the records of a results folder, one for each row, oldest first.

    Those of jobs that ran here come with published ones for other rows, if no record of other
    shapes of their gallery was made here. Damaged files and lines are named on stderr and passed
    over.
    """
    here = (
        sorted(read_files((results / RUNS / "records").glob("*.json")), key=_age) if local else []
    )
    elsewhere = read_files((results / "records").glob("*.jsonl")) if published else []
    digests = {record.gallery: record.gallery_digest for record in here}
    fitting = [
        msgspec.structs.replace(record, published=True)
        for record in elsewhere
        if digests.get(record.gallery, record.gallery_digest) == record.gallery_digest
    ]
    newest = {record.row: record for record in (*sorted(fitting, key=_age), *here)}
    return sorted(newest.values(), key=_age)


def _age(record: Record) -> tuple[str, str]:
    return record.finished, record.key


_decoder = msgspec.json.Decoder(Record)


def read_files(paths: Iterable[Path]) -> list[Record]:
    """Return the records in files; damaged files and lines are named on stderr and passed over."""
    records = []
    for path in sorted(paths):
        try:
            text = read_file(path, LARGEST_FILE)
        except OSError as error:
            _skip(f"{path}: {error.strerror}")
            continue
        for number, line in enumerate([text] if path.suffix == ".json" else text.splitlines(), 1):
            try:
                record, content = _decoder.decode(line), msgspec.json.decode(line)
                if content.pop("checksum", "") != _checksum(content):
                    raise msgspec.DecodeError(
                        "it was changed after it was written, or written by hand"
                    )
                records.append(msgspec.structs.replace(record, checksum=""))
            except (
                msgspec.DecodeError,
                UnicodeError,
                RecursionError,
            ) as error:  # ValidationError is one
                where = f"{path}:{number}" if path.suffix == ".jsonl" else path
                _skip(f"{where}: it is not a record: {error}; remove it")
    return records


def encode(record: Record) -> bytes:
    """Return a record as JSON, with its checksum."""
    return msgspec.json.encode(msgspec.structs.replace(record, checksum=_checksum(record)))


def _checksum(record: Record | Mapping[str, Any]) -> str:
    return digest_of_bytes(msgspec.json.encode(record, order="sorted"))


@cache
def _skip(what: str) -> None:
    """Name a file or line that is no record, once however often it is read."""
    say(f"skipped {what}", err=True)


def record_of(content: Mapping[str, Any]) -> Record:
    """Return the record of a content, in which text that no record may hold is escaped."""
    try:
        return msgspec.convert(content, Record)
    except msgspec.ValidationError:
        return msgspec.convert(_escaped(content), Record)


def _escaped(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {
            clean(name): each if name == "traceback" else _escaped(each)
            for name, each in value.items()
        }
    if isinstance(value, list | tuple):
        return [_escaped(each) for each in value]
    return brief(value, LONGEST_MESSAGE) if isinstance(value, str) else value


# Writing
# ------------------------------------------------------------------------------------------------


def write_record(results: Path, record: Record, replaces: str = "") -> None:
    """Write the record of a job that ran here, in place of the one with the key ``replaces``.

    Raises
    ------
    StorageError
        If it cannot be written.
    """
    folder = results / RUNS / "records"
    try:
        text = encode(record)
    except UnicodeEncodeError:  # a surrogate, as in names of files that are not UTF-8
        text = encode(msgspec.convert(_escaped(msgspec.to_builtins(record)), Record))
    text = msgspec.json.format(text, indent=1)
    with storing(results):
        write_atomically(folder / f"{record.key}.json", lambda file: file.write(text), durable=True)
        for suffix in (".json", ".npz") if replaces not in ("", record.key) else ():
            (folder / f"{replaces}{suffix}").unlink(missing_ok=True)


def unneeded(
    results: Path, is_unwanted: Callable[[Record], bool]
) -> tuple[list[Record], list[Path]]:
    """Return the records made here for which ``is_unwanted`` holds, and all files that no other record names."""
    runs = results / RUNS
    records = sorted(read_files((runs / "records").glob("*.json")), key=_age)
    unwanted = [record for record in records if is_unwanted(record)]
    needed = {path for record in records if not is_unwanted(record) for path in _files_of(record)}
    files = [runs / "records" / f"{record.key}.json" for record in unwanted]
    files += [path for stage in get_args(Stage) for path in sorted((runs / stage).glob("*.npz"))]
    return unwanted, [path for path in files if path.relative_to(runs).as_posix() not in needed]


def _files_of(record: Record) -> Iterator[str]:
    """Yield the files of a record; the frame of the camera is kept beside prepared shapes."""
    yield from (f"records/{record.key}.npz", f"prepared/{record.parts.get('the camera')}.npz")
    for side in record.sides:
        for stage, keys in side.files.items():
            yield from (f"{stage}/{key}.npz" for key in keys)


# Files of a record
# ------------------------------------------------------------------------------------------------


#: Arrays of prepared shapes and forms that pages and figures read.
_READ = ("vertices", "faces", "vertex_map", "note:vertices_before")


def read_distances(results: Path, record: Record) -> NDArray[np.float64] | None:
    """Return the distances of queries and shapes with a result, means over draws; None if not here.

    Published ones have single precision.
    """
    shape = len(record.answered), len(record.sides[-1].answered)
    distances = (Cache(results).read("records", record.key) or {}).get("distances", np.empty(0))
    if distances.shape != shape and record.distances:
        from scipy.spatial.distance import squareform  # lazy: tables need no distances

        path = published_distances(results, record.distances)
        try:
            content = read_file(path)
            above = np.frombuffer(content, "<f4")
            if digest_of_bytes(content) != record.distances or not np.isfinite(above).all():
                raise ValueError("it was changed after it was published")
            distances = squareform(above.astype(np.float64))
        except (OSError, ValueError) as error:
            _skip(f"{path}: {getattr(error, 'strerror', error)}")
    return distances if distances.shape == shape else None


def published_distances(results: Path, digest: str) -> Path:
    """Return the file of published distances: those above the diagonal, by row, as numbers of four bytes."""
    return results / "records" / "distances" / f"{digest}.f4"


def read_prepared(results: Path, record: RankedShapes, shape: str) -> Mesh | None:
    """Return the prepared surface of a shape of a record; None if it is not kept here, or could not be prepared."""
    arrays = _read_arrays(results, record, "prepared", shape)
    return Mesh(arrays["vertices"], arrays["faces"]) if "vertices" in arrays else None


def read_form(results: Path, record: RankedShapes, shape: str) -> Mesh | None:
    """Return the canonical form of a shape of a record; None if it is not kept here, or there is none."""
    form, prepared = (
        _read_arrays(results, record, stage, shape) for stage in ("forms", "prepared")
    )
    arrays = prepared | form
    return (
        Mesh(arrays["vertices"], arrays["faces"])
        if "vertices" in form and "faces" in arrays
        else None
    )


def read_vertex_map(
    results: Path, record: Record, shape: str
) -> tuple[NDArray[np.int64], bool] | None:
    """Return the nearest vertex of the file at each vertex of a form, and whether each of the file is that of one.

    None means that the form has vertices of its own, as those of views have, or is not kept here.
    """
    form, prepared = (
        _read_arrays(results, record, stage, shape) for stage in ("forms", "prepared")
    )
    if "vertex_map" not in prepared or "vertices" not in form or "faces" in form:
        return None
    numbers = prepared["vertex_map"].astype(np.int64)
    return numbers, np.array_equal(
        np.sort(numbers), np.arange(int(prepared["note:vertices_before"]))
    )


def _read_arrays(
    results: Path, record: RankedShapes, stage: Stage, shape: str
) -> dict[str, NDArray[Any]]:
    keys = dict(zip(record.shapes, record.files.get(stage, [])[:: record.views], strict=False))
    return Cache(results).read(stage, keys.get(shape, ""), only=_READ) or {}
