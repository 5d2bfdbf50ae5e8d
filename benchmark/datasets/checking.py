"""Validation of data sets: each kind of problem on one line with its files and a hint."""

from __future__ import annotations

import hashlib
import math
import re
import statistics
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.base import Watched, check_retrievable
from benchmark.datasets.catalogue import CATALOGUE, check_ranked, open_dataset
from benchmark.datasets.folder import all_mesh_files, is_hidden, skipped_files, sub_folders
from benchmark.datasets.mesh_files import POINTS, lacks_last_break, mesh_file_set, mesh_stem
from benchmark.datasets.official import SETS
from benchmark.datasets.settings import SETTINGS_FILE
from benchmark.errors import BenchmarkError, DatasetError, ShapeError, surface_command
from benchmark.geometry.cleaning import compact, topology
from benchmark.geometry.depth import (
    FEWEST_PIXELS,
    FILL,
    SIZE,
    camera_coordinates,
    common_half_width,
)
from benchmark.geometry.preparation import Prepared, prepare
from benchmark.text import counted, listed

#: Factors between units of length: inches, centimetres, millimetres, feet, metres.
_UNITS = (2.54, 10, 12, 25.4, 100, 304.8, 1000)
#: Largest relative difference of a factor, and of the sizes of a subject in several poses.
_NEAR_UNIT = 0.05

#: What preparation changes or leaves by its name in the report: how it is counted, and what
#: happens.
_CHANGES: dict[str, tuple[tuple[str, ...], str]] = {
    "merged": (("copy of a vertex", "copies of vertices"), "preparation merges them"),
    "unreferenced": (
        ("vertex without a face", "vertices without a face"),
        "preparation drops them",
    ),
    "degenerate_faces": (
        ("face without area", "faces without area"),
        "preparation removes them and opens no border",
    ),
    "duplicate_faces": (("duplicate face",), "preparation keeps one of each"),
    "turned_faces": (
        ("face the other way round", "faces the other way round"),
        "preparation turns them",
    ),
    "one_sided_components": (
        ("one-sided piece",),
        "preparation leaves it, like a Moebius strip, as it is",
    ),
    "non_manifold_edges": (
        ("non-manifold edge",),
        "preparation keeps the two largest faces of each",
    ),
    "non_manifold_vertices": (
        ("non-manifold vertex", "non-manifold vertices"),
        "preparation splits them",
    ),
    "boundary_edges": (("boundary edge",), "close the surface for methods that need it closed"),
    "opened_edges": (
        ("boundary edge opened by preparation", "boundary edges opened by preparation"),
        "see above",
    ),
    "dropped_components": (("small piece",), "preparation drops the smallest pieces"),
    "bridges": (
        ("bridge between pieces", "bridges between pieces"),
        "preparation adds them where pieces are closest",
    ),
}

_NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Anomaly:
    """A problem in a data set.

    Parameters
    ----------
    severity
        ``"error"`` if the data set or the shape is unusable without a fix, otherwise ``"warning"``.
    files
        The files, relative to the folder, or the identifiers of generated shapes.
    what, hint
        The problem, and a suggested action.
    """

    severity: str
    files: tuple[str, ...]
    what: str
    hint: str

    def __str__(self) -> str:
        count = f"{len(self.files)} files: " if len(self.files) > 1 else ""
        return f"{self.severity:<7}  {count}{listed(self.files)}  {self.what}; {self.hint}"


def by_kind(anomalies: Iterable[Anomaly]) -> tuple[Anomaly, ...]:
    """Join problems that differ in files and numbers alone: of several numbers, the least and the largest are said.

    The file with the largest number is named first.
    """
    kinds = defaultdict[tuple[str, ...], list[Anomaly]](list)
    for one in anomalies:
        what = one.what if one.severity == "error" else ""  # warnings of one kind have one hint
        kinds[one.severity, _NUMBER.sub("", what), _NUMBER.sub("", one.hint)].append(one)
    ranked = [sorted(members, key=_numbers, reverse=True) for members in kinds.values()]
    joined = [
        replace(
            members[0],
            files=tuple(file for one in members for file in one.files),
            what=_with_ranges([one.what for one in members]),
            hint=_with_ranges([one.hint for one in members]),
        )
        for members in ranked
    ]
    return tuple(sorted(joined, key=lambda one: one.severity))


def _with_ranges(texts: Sequence[str]) -> str:
    """Return the first of some texts, with the least and the largest of each number that differs between them."""
    numbers = [_NUMBER.findall(text) for text in texts]
    if len({len(of_text) for of_text in numbers}) > 1:
        return texts[0]
    ranges: list[str] = []
    for found in zip(*numbers, strict=True):
        least, largest = min(found, key=float), max(found, key=float)
        ranges.append(largest if least == largest else f"{least} to {largest}")
    each = iter(ranges)
    return _NUMBER.sub(lambda _: next(each), texts[0])


def _numbers(anomaly: Anomaly) -> list[float]:
    return [float(number) for number in _NUMBER.findall(f"{anomaly.hint} {anomaly.what}")]


@dataclass(frozen=True)
class Row:
    """A readable shape.

    Parameters
    ----------
    file, subject
        Names of the shape.
    counts
        Report of preparation without decimation, and ``holes``; boundary loops that share a vertex
        are one.
    changes
        What preparation changes, and what to do; see
        :func:`changes_of`.
    extent, size
        Half the longest side of the bounding box in the camera's frame, and the root of the area,
        in file units.
    digest
        Digest of vertices and faces, independent of the file format.
    taken
        As what a depth image was taken: ``unit``, ``camera``, ``mask``, and the range of its
        ``depths`` and the ``distance`` and ``size`` of its object in metres.
    """

    file: str
    subject: str
    counts: Mapping[str, float]
    changes: Sequence[tuple[str, str]]
    extent: float
    size: float
    digest: str
    taken: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Report:
    """Results of a check: the readable shapes, and the problems by kind, errors first."""

    dataset: ShapeSet
    rows: tuple[Row, ...]
    anomalies: tuple[Anomaly, ...]

    @property
    def usable(self) -> bool:
        """Whether there are no errors."""
        return not any(anomaly.severity == "error" for anomaly in self.anomalies)

    def lines(self) -> list[str]:
        """Return the report as text: a summary, one line per kind of problem, and their counts."""
        n_shapes = len(self.dataset.shapes)
        sizes = Counter(entry.subject for entry in self.dataset.shapes if entry.subject)
        unread = n_shapes - len(self.rows)
        keys = {
            "vertices": "vertices_before",
            "faces": "faces_before",
            "components": "components",
            "holes": "holes",
        }
        counts = Counter(anomaly.severity for anomaly in self.anomalies for _ in anomaly.files)
        return [
            f"{self.dataset.name}: {n_shapes} shapes, {len(sizes)} classes, "
            f"{describe_content(self.dataset)}"
            f"{f', {unread} unreadable, which count as 0' if unread else ''}",
            f"classes     {', '.join(f'{subject} {size}' for subject, size in sizes.items()) or 'unknown'}",
            *(
                f"{name:<11} {_range([row.counts[key] for row in self.rows])}"
                for name, key in keys.items()
            ),
            *(
                f"{name:<11} {_summary([row.taken[name] for row in self.rows])}"
                for name in (self.rows[0].taken if self.rows else ())
            ),
            *map(str, self.anomalies),
            ", ".join(
                f"{counts[kind]} {kind}{'s' * (counts[kind] != 1)}" for kind in ("error", "warning")
            ),
        ]


def _range(values: list[float]) -> str:
    if not values:
        return "none could be read"
    return f"{min(values):.10g} to {max(values):.10g}, median {statistics.median(values):.10g}"


def _summary(values: Sequence[Any]) -> str:
    """Return the range of numbers, or texts with their counts."""
    if isinstance(values[0], str):
        return listed(f"{text} ({count})" for text, count in Counter(values).most_common())
    return f"{np.min(values):.4g} to {np.max(values):.4g} m"


def describe_content(dataset: ShapeSet) -> str:
    """Say what a data set is by its content: a stand-in, a known copy of an official set, or neither."""
    if dataset.stand_in_for:
        return f"stand-in for {dataset.stand_in_for}"
    official = SETS.get(dataset.name)
    if official is None:
        return "not a stand-in"
    copies = [official.copy_of(entry) for entry in dataset.shapes]
    first = copies[0] if copies else None
    if first is None or any(copy is not first for copy in copies):
        return f"files named like {official.title}, unverified"
    n_files = len(first.digests)
    count = f"all {n_files}" if len(copies) == n_files else f"{len(copies)} of its {n_files}"
    return f"{first.title} (SHA-256 of {count} files)"


def _of_copies(dataset: ShapeSet) -> Iterator[Anomaly]:
    """Yield the files that a known copy lacks, if others belong to it, and that no copy is known, if none does."""
    official = SETS.get(dataset.name)
    if official is None or dataset.stand_in_for:
        return
    copies = {entry: official.copy_of(entry) for entry in dataset.shapes}
    known = [copy for copy in copies.values() if copy is not None]
    if not known:
        what = f"no file has a known SHA-256, so tables call them files named like {official.title}"
        yield Anomaly("warning", (dataset.name,), what, "say beside scores which copy they are of")
        return
    copy, _ = Counter(known).most_common(1)[0]
    for entry in (entry for entry, of in copies.items() if of is not copy):
        file = _relative(entry.path, dataset.folder) if entry.path and dataset.folder else ""
        what = f"not the file of '{copy.title}': another SHA-256"
        hint = f"restore it, or tables call the set files named like {official.title}, unverified"
        yield Anomaly("warning", (file or entry.identifier,), what, hint)


def check_source(name: str, data_root: Path | None, watched: Watched = iter) -> Report:
    """Check a data set by name or folder; if it cannot be opened, report that and check its meshes anyway.

    Parameters
    ----------
    name, data_root
        See :func:`~benchmark.datasets.catalogue.open_dataset`.
    watched
        Progress wrapper; see :data:`~benchmark.datasets.base.Watched`.

    Raises
    ------
    ConfigurationError
        If the name is neither a data set nor a folder.
    DatasetError
        If the set is missing.
    """
    try:
        return check(open_dataset(name, data_root), watched)
    except BenchmarkError as error:
        part = CATALOGUE[name].folder if name in CATALOGUE else ""
        folder = (
            (data_root / part if data_root and part else None) if name in CATALOGUE else Path(name)
        )
        if folder is None or not folder.is_dir():
            raise
        paths = [path for place in (folder, *sub_folders(folder)) for path in all_mesh_files(place)]
        entries = tuple(Entry(_relative(path, folder), "", "", path) for path in paths)
        unopened = mesh_file_set(
            name=name if part else folder.resolve().name, shapes=entries, folder=folder
        )
        return _report(
            unopened, [Anomaly("error", (folder.name,), error.located, error.hint)], watched
        )


def check(dataset: ShapeSet, watched: Watched = iter) -> Report:
    """Check a data set: its files, its classes, and every mesh; see :func:`check_source`."""
    return _report(dataset, [*_of_copies(dataset), *_of_classes(dataset)], watched)


def _of_classes(dataset: ShapeSet) -> Iterator[Anomaly]:
    try:
        check_ranked(dataset)
    except DatasetError as error:
        yield Anomaly("warning", (dataset.name,), error.located, error.hint)
        return
    try:
        check_retrievable(dataset)
    except DatasetError as error:
        yield Anomaly("error", (dataset.name,), error.located, error.hint)
    sizes = Counter(entry.subject for entry in dataset.shapes)
    if lone := [*sizes.values()].count(1):
        what = f"ranked, but no queries: {lone} of {len(dataset.shapes)} shapes (alone in their class, or of class -1)"
        yield Anomaly(
            "warning", (dataset.name,), what, "add a shape to their classes if they should count"
        )
    for subject, size in (SETS[dataset.name].sizes if dataset.name in SETS else {}).items():
        if sizes[subject] != size:
            what = f"class '{subject}' has {sizes[subject]} shapes, officially {size}"
            hint = f"unpack the official archive there, or name the folder, -d {dataset.folder}, where no more is meant"
            yield Anomaly("error", (dataset.name,), what, hint)


def unread_files(dataset: ShapeSet) -> Iterator[Anomaly]:
    """Yield files of a folder that are no shapes of the data set."""
    folder, used = dataset.folder, {entry.path for entry in dataset.shapes}
    if folder is None:
        return
    for path in skipped_files(folder) if dataset.name not in SETS else ():
        what, hint = (
            "points, not a surface",
            f"make a surface of them: {surface_command('FILE')}",
        )
        if is_hidden(path):
            what, hint = "hidden", "remove what macOS writes beside each file, or rename a shape"
        elif path.suffix.lower() not in POINTS:
            what, hint = (
                "no shape, labels or settings",
                f"labels.txt and {SETTINGS_FILE} are read, in {folder.name}",
            )
        yield Anomaly("warning", (_relative(path, folder),), f"skipped: {what}", hint)
    for place in dict.fromkeys(
        [folder, *(path.parent for path in used if path), *sub_folders(folder)]
    ):
        first: dict[str, Path] = {}
        for path in all_mesh_files(place):
            name, same = _relative(path, folder), first.setdefault(mesh_stem(path), path)
            if same != path:
                what = "the name of another in another format"
                yield Anomaly(
                    "warning",
                    (f"{name} ({same.name})",),
                    what,
                    "keep one of the two; this one is not read",
                )
            elif path not in used:
                what = "none of the shapes of this data set"
                yield Anomaly("warning", (name,), what, "remove it, or list it if it belongs here")


def unfinished_files(dataset: ShapeSet, entries: Iterable[Entry]) -> Iterator[Anomaly]:
    """Yield the mesh files of shapes that are text without a last line break, which is read all the same."""
    for path in dict.fromkeys(path for entry in entries for path in dataset.files(entry)):
        if lacks_last_break(path):
            file = _relative(path, dataset.folder) if dataset.folder else path.name
            what = "text without a last line break: its last number may be cut off"
            yield Anomaly("warning", (file,), what, "compare it with its source")


def _report(dataset: ShapeSet, of_set: Iterable[Anomaly], watched: Watched) -> Report:
    rows: list[Row] = []
    read: list[Entry] = []
    anomalies: list[Anomaly] = []
    first_with: dict[str, Row] = {}
    for entry in watched(dataset.shapes):
        file = (
            _relative(entry.path, dataset.folder)
            if entry.path and dataset.folder
            else entry.identifier
        )
        try:
            row = _inspect(dataset, entry, file)
        except ShapeError as error:
            is_beside = error.file not in (None, entry.path)
            problem = error.located if is_beside else error.problem
            anomalies.append(Anomaly("error", (file,), problem, error.hint))
            continue
        rows.append(row)
        read.append(entry)
        anomalies += [Anomaly("warning", (file,), what, hint) for what, hint in row.changes]
        twin = first_with.setdefault(row.digest, row)
        if twin is not row:
            is_wrong = twin.subject != row.subject
            what = f"the same geometry as another{' of another class' * is_wrong}"
            severity = "error" if is_wrong else "warning"
            anomalies.append(
                Anomaly(severity, (f"{file} ({twin.file})",), what, "keep one of the two")
            )
    of_files = [*unread_files(dataset), *unfinished_files(dataset, read)]
    units = _of_units(rows) if dataset.observe is None else ()
    of_shapes = [*anomalies, *units, *_of_frame(dataset, {row.file: row.extent for row in rows})]
    return Report(dataset, tuple(rows), by_kind([*of_set, *of_files, *of_shapes]))


def changes_of(prepared: Prepared) -> list[tuple[str, str]]:
    """Return what is unusual about a mesh, and what preparation does about it or the user can do."""
    report = prepared.report
    found = []
    for name, (what, action) in _CHANGES.items():
        if report[name]:
            found.append((counted(int(report[name]), *what), action))
    if gap := prepared.scale * report["largest_gap"]:
        hint = "join the pieces if the surface should be in one"
        found.append((f"bridges of length up to {gap:.3g}", hint))
    if lost := report["lost_area"]:
        hint = "preparation drops it with small pieces and crowded edges"
        found.append((f"{lost:.2%} of the area", hint))
    return found


def _inspect(dataset: ShapeSet, entry: Entry, file: str) -> Row:
    mesh = dataset.load(entry)
    surface = compact(mesh.vertices, mesh.faces)
    changes: list[tuple[str, str]] = []
    if dataset.observe is None:
        prepared = prepare(mesh, mesh.n_vertices)
        counts, changes = prepared.report, changes_of(prepared)
    else:  # views are open and possibly disconnected
        counts = {
            "vertices_before": mesh.n_vertices,
            "faces_before": mesh.n_faces,
            **topology(surface),
        }
    extent = float(np.abs(camera_coordinates(surface, dataset.camera(entry))).max())
    digest = hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes()).hexdigest()
    taken = _taken(dataset.observe(entry), entry) if dataset.observe else {}
    return Row(
        file, entry.subject, counts, changes, extent, float(np.sqrt(mesh.area)), digest, taken
    )


def _taken(observed: Any, entry: Entry) -> dict[str, Any]:
    """Return as what a depth image was taken, in words that are the same for images that were taken alike."""
    notes, stem, seen = (
        observed.notes,
        entry.path.stem if entry.path else "",
        observed.depths[observed.depths > 0],
    )
    words = {name: str(notes.get(name, "given")) for name in ("unit", "camera", "mask")}
    words["mask"] = re.sub(f"^{re.escape(stem)}", "NAME", words["mask"])
    return {
        **words,
        "depths": (seen.min(), seen.max()),
        "distance": notes["distance"],
        "size": notes["size"],
    }


def _of_units(rows: Sequence[Row]) -> Iterator[Anomaly]:
    """Yield the shapes that differ by the factor of a unit from their class, or from the set if a class has one shape.

    If some are larger and some smaller, these are the fewer ones; of equal groups, that farther
    from the whole set.
    """
    of_set = statistics.median(row.size for row in rows) if rows else 1.0
    groups: dict[float, dict[str, list[Row]]] = {
        unit: {"large": [], "small": []} for unit in _UNITS
    }
    for row in rows:
        others = [other.size for other in rows if other is not row and other.subject == row.subject]
        ratio = row.size / (statistics.median(others) if others else of_set)
        for unit, near in groups.items():
            for word, factor in (("large", ratio), ("small", 1 / ratio)):
                near[word] += [row] * (abs(factor / unit - 1) < _NEAR_UNIT)
    for unit, near in groups.items():

        def rank(word: str, near: Mapping[str, list[Row]] = near) -> tuple[int, float]:
            return len(near[word]) or len(rows), -sum(
                abs(math.log(row.size / of_set)) for row in near[word]
            )

        odd, other = sorted(near, key=rank)
        if near[odd]:
            rest = [row.file for row in near[other] or rows if row not in near[odd]]
            verb = "are" if len(near[odd]) > 1 else "is"
            what = f"{verb} {unit:g} times as {odd} as {len(rest)} others ({listed(rest)}), a unit's factor"
            hint = f"state the unit of each in {SETTINGS_FILE}, or ignore surface-area"
            yield Anomaly("warning", tuple(row.file for row in near[odd]), what, hint)


def _of_frame(dataset: ShapeSet, extents: Mapping[str, float]) -> Iterator[Anomaly]:
    """Yield shapes that exceed the camera's frame or cover too few pixels."""
    if not extents:
        return
    declared = dataset.half_width
    widest = max(extents, key=extents.__getitem__)
    if declared is not None and extents[widest] >= declared:
        what = f"extends to {extents[widest]:.6g}, beyond the camera's half width of {declared:.6g}"
        hint = f"set half_width = {extents[widest] / FILL:.6g} in {SETTINGS_FILE}, or remove it"
        yield Anomaly("error", (widest,), what, hint)
    fitted = common_half_width(list(extents.values())) / FILL
    for file, extent in extents.items():
        if declared is None and extent >= fitted:
            where = f"half_width = {extent / FILL:.6g} in {SETTINGS_FILE}"
            what = f"extends to {extent:.6g}, out of scale with the others, whose frame has half width {fitted:.6g}"
            hint = f"check its unit and look for stray vertices, or set {where}; the view input leaves it out"
            yield Anomaly("warning", (file,), what, hint)
        elif (extent / (declared or fitted) * SIZE) ** 2 < FEWEST_PIXELS:
            what = f"extends to {extent:.6g}, almost nothing in a frame of half width {declared or fitted:.6g}"
            yield Anomaly("warning", (file,), what, "check its unit; the view input leaves it out")


def _relative(path: Path, folder: Path) -> str:
    return folder.resolve().name if path == folder else path.relative_to(folder).as_posix()
