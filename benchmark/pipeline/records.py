"""Records of finished jobs: what a record says, one JSON object per job."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
from msgspec import Meta

from benchmark.api.contracts import Input
from benchmark.api.datasets import name_view
from benchmark.code_digest import digest
from benchmark.defaults import DEFAULT_SCORER
from benchmark.pipeline.cache import Stage
from benchmark.pipeline.record_layout import (
    LAYOUT,
)
from benchmark.text import LONGEST_MESSAGE, brief, clean_text
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
        Whether it is of a quick run, and the number of shapes of a full one; 0 if unknown.
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
        """Whether each shape has another shape of its class to find, and so counts as a query."""
        gallery = self.gallery_of_queries or self  # by default, the shapes rank each other
        n_of_class = Counter(gallery.labels)
        # The query itself is no result of its own, nor a shape of the same name and class.
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


def record_of(content: Mapping[str, Any]) -> Record:
    """Return the record of a content, in which text that no record may hold is escaped."""
    try:
        return msgspec.convert(content, Record)
    except msgspec.ValidationError:
        return msgspec.convert(make_printable(content), Record)


def make_printable(value: Any) -> Any:
    """Return a content whose texts are printable and short, but for tracebacks."""
    if isinstance(value, Mapping):
        printable = {clean_text(name): make_printable(each) for name, each in value.items()}
        if "traceback" in value:
            printable["traceback"] = value["traceback"]
        return printable
    if isinstance(value, list | tuple):
        return [make_printable(each) for each in value]
    return brief(value, LONGEST_MESSAGE) if isinstance(value, str) else value
