"""Validation of data sets: each problem on one line with the file and a hint."""

from __future__ import annotations

import hashlib
import math
import statistics
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.base import Watched, check_retrievable
from benchmark.datasets.catalogue import CATALOGUE, check_ranked, open_dataset
from benchmark.datasets.folder import all_mesh_files, mesh_stem, skipped_files, sub_folders
from benchmark.datasets.official import SETS
from benchmark.datasets.settings import SETTINGS_FILE
from benchmark.errors import BenchmarkError, DatasetError, ShapeError
from benchmark.geometry.cleaning import compact, topology
from benchmark.geometry.depth import FEWEST_PIXELS, FILL, SIZE, camera_coordinates, common_half_width
from benchmark.geometry.io import SURFACE
from benchmark.geometry.preparation import prepare

#: Factors between units of length: inches, centimetres, millimetres, feet, metres.
_UNITS = (2.54, 10, 12, 25.4, 100, 304.8, 1000)
#: Largest relative difference of a factor, and of the sizes of a subject in several poses.
_NEAR_UNIT = 0.05


@dataclass(frozen=True)
class Anomaly:
    """A problem in a data set.

    Parameters
    ----------
    severity
        ``"error"`` if the data set or the shape is unusable without a fix, otherwise ``"warning"``.
    file
        The file, relative to the folder, or the identifier of a generated shape.
    what, hint
        The problem, and a suggested action.
    """

    severity: str
    file: str
    what: str
    hint: str

    def __str__(self) -> str:
        return f"{self.severity:<7}  {self.file}  {self.what}; {self.hint}"


@dataclass(frozen=True)
class Row:
    """A readable shape.

    Parameters
    ----------
    file, subject
        Names of the shape.
    counts
        Report of preparation without decimation, and ``holes``; boundary loops that share a vertex are one.
    changes
        What preparation changes, and what to do; see :attr:`benchmark.geometry.preparation.Prepared.changes`.
    extent, size
        Half the longest side of the bounding box in the camera's frame, and the root of the area, in file units.
    digest
        Digest of vertices and faces, independent of the file format.
    """

    file: str
    subject: str
    counts: Mapping[str, float]
    changes: Sequence[tuple[str, str]]
    extent: float
    size: float
    digest: str


@dataclass(frozen=True)
class Report:
    """Results of a check: the readable shapes, and the problems, first those of the set, then those of its shapes."""

    dataset: ShapeSet
    rows: tuple[Row, ...]
    anomalies: tuple[Anomaly, ...]

    @property
    def usable(self) -> bool:
        """Whether there are no errors."""
        return not any(anomaly.severity == "error" for anomaly in self.anomalies)

    def lines(self) -> list[str]:
        """Return the report as text: a summary, one line per anomaly, and their counts."""
        stand_in, n_shapes = self.dataset.stand_in_for, len(self.dataset.shapes)
        sizes = Counter(entry.subject for entry in self.dataset.shapes if entry.subject)
        unread = n_shapes - len(self.rows)
        keys = {"vertices": "vertices_before", "faces": "faces_before", "components": "components", "holes": "holes"}
        counts = Counter(anomaly.severity for anomaly in self.anomalies)
        return [
            f"{self.dataset.name}: {n_shapes} shapes, {len(sizes)} classes, "
            f"{f'stand-in for {stand_in}' if stand_in else 'not a stand-in'}"
            f"{f', {unread} unreadable, which count as 0' if unread else ''}",
            f"classes     {', '.join(f'{subject} {size}' for subject, size in sizes.items()) or 'unknown'}",
            *(f"{name:<11} {_range([row.counts[key] for row in self.rows])}" for name, key in keys.items()),
            *map(str, self.anomalies),
            ", ".join(f"{counts[kind]} {kind}{'s' * (counts[kind] != 1)}" for kind in ("error", "warning")),
        ]


def _range(values: list[float]) -> str:
    if not values:
        return "none could be read"
    return f"{min(values):.10g} to {max(values):.10g}, median {statistics.median(values):.10g}"


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
        folder = (data_root / part if data_root and part else None) if name in CATALOGUE else Path(name)
        if folder is None or not folder.is_dir():
            raise
        paths = [path for place in (folder, *sub_folders(folder)) for path in all_mesh_files(place)]
        entries = tuple(Entry(_relative(path, folder), "", "", path) for path in paths)
        unopened = ShapeSet(name=name if part else folder.resolve().name, shapes=entries, folder=folder)
        rows, of_shapes = _inspect_all(unopened, watched)
        anomalies = [Anomaly("error", folder.name, error.problem, error.hint), *unread_files(unopened), *of_shapes]
        return Report(unopened, rows, tuple(anomalies))


def check(dataset: ShapeSet, watched: Watched = iter) -> Report:
    """Check a data set: its files, its classes, and every mesh; see :func:`check_source`."""
    rows, of_shapes = _inspect_all(dataset, watched)
    return Report(dataset, rows, (*_of_classes(dataset), *unread_files(dataset), *of_shapes))


def _of_classes(dataset: ShapeSet) -> Iterator[Anomaly]:
    try:
        check_ranked(dataset)
    except DatasetError as error:
        yield Anomaly("warning", dataset.name, error.problem, error.hint)
        return
    try:
        check_retrievable(dataset)
    except DatasetError as error:
        yield Anomaly("error", dataset.name, error.problem, error.hint)
    sizes = Counter(entry.subject for entry in dataset.shapes)
    if lone := [*sizes.values()].count(1):
        what = f"ranked, but no queries: {lone} of {len(dataset.shapes)} shapes (alone in their class, or of class -1)"
        yield Anomaly("warning", dataset.name, what, "add a shape to their classes if they should count")
    for subject, size in (SETS[dataset.name].sizes if dataset.name in SETS else {}).items():
        if sizes[subject] != size:
            what = f"class '{subject}' has {sizes[subject]} shapes, officially {size}"
            hint = f"unpack the official archive there, or name the folder, -d {dataset.folder}, where no more is meant"
            yield Anomaly("error", dataset.name, what, hint)


def unread_files(dataset: ShapeSet) -> Iterator[Anomaly]:
    """Yield files of a folder that are no shapes of the data set."""
    folder, used = dataset.folder, {entry.path for entry in dataset.shapes}
    if folder is None:
        return
    for path in skipped_files(folder):
        hint = f"make a surface of them: {SURFACE.format(name=path.name)}"
        yield Anomaly("warning", _relative(path, folder), "is skipped: it holds points, not a surface", hint)
    for place in dict.fromkeys([folder, *(path.parent for path in used if path), *sub_folders(folder)]):
        first: dict[str, Path] = {}
        for path in all_mesh_files(place):
            same = first.setdefault(mesh_stem(path), path)
            if same != path:
                what = f"the same name as {same.name} in another format"
                yield Anomaly("warning", _relative(path, folder), what, "keep one of the two; this one is not read")
            elif path not in used:
                what = "is none of the shapes of this data set"
                yield Anomaly("warning", _relative(path, folder), what, "remove it, or list it if it belongs here")


def _inspect_all(dataset: ShapeSet, watched: Watched) -> tuple[tuple[Row, ...], list[Anomaly]]:
    rows: list[Row] = []
    anomalies: list[Anomaly] = []
    first_with: dict[str, Row] = {}
    for entry in watched(dataset.shapes):
        file = _relative(entry.path, dataset.folder) if entry.path and dataset.folder else entry.identifier
        try:
            row = _inspect(dataset, entry, file)
        except ShapeError as error:
            anomalies.append(Anomaly("error", file, error.problem.removeprefix(f"{entry.path}: "), error.hint))
            continue
        rows.append(row)
        anomalies += [Anomaly("warning", file, what, hint) for what, hint in row.changes]
        twin = first_with.setdefault(row.digest, row)
        if twin is not row:
            where = "" if twin.subject == row.subject else f" of another class, '{twin.subject}'"
            severity = "error" if where else "warning"
            anomalies.append(Anomaly(severity, file, f"the same geometry as {twin.file}{where}", "keep one of the two"))
    units = _of_units(rows) if dataset.observe is None else ()
    return tuple(rows), [*anomalies, *units, *_of_frame(dataset, {row.file: row.extent for row in rows})]


def _inspect(dataset: ShapeSet, entry: Entry, file: str) -> Row:
    mesh = dataset.load(entry)
    surface = compact(mesh.vertices, mesh.faces)
    changes: list[tuple[str, str]] = []
    if dataset.observe is None:
        prepared = prepare(mesh, mesh.n_vertices)
        counts, changes = prepared.report, prepared.changes
    else:  # views are open and possibly disconnected
        counts = {"vertices_before": mesh.n_vertices, "faces_before": mesh.n_faces, **topology(surface)}
    extent = float(np.abs(camera_coordinates(surface, dataset.camera(entry))).max())
    digest = hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes()).hexdigest()
    return Row(file, entry.subject, counts, changes, extent, float(np.sqrt(mesh.area)), digest)


def _of_units(rows: Sequence[Row]) -> Iterator[Anomaly]:
    """Yield shapes that differ by the factor of a unit from their class, or from the set if a class has one shape."""
    of_set = statistics.median(row.size for row in rows) if rows else 1.0
    for row in rows:
        others = [other.size for other in rows if other is not row and other.subject == row.subject]
        usual = statistics.median(others) if others else of_set
        ratio = max(row.size / usual, usual / row.size)
        is_odd = len(others) > 1 or abs(math.log(row.size / of_set)) >= abs(math.log(usual / of_set))
        for unit in _UNITS:
            if is_odd and abs(ratio / unit - 1) < _NEAR_UNIT:
                what = f"is {unit:g} times as {'large' if row.size > usual else 'small'} as others, a unit's factor"
                yield Anomaly("warning", row.file, what, "write all shapes in one unit, or ignore surface-area")


def _of_frame(dataset: ShapeSet, extents: Mapping[str, float]) -> Iterator[Anomaly]:
    """Yield shapes that exceed the camera's frame or cover too few pixels."""
    if not extents:
        return
    declared = dataset.half_width
    widest = max(extents, key=extents.__getitem__)
    if declared is not None and extents[widest] >= declared:
        what = f"extends to {extents[widest]:.6g}, beyond the camera's half width of {declared:.6g}"
        hint = f"set half_width = {extents[widest] / FILL:.6g} in {SETTINGS_FILE}, or remove it"
        yield Anomaly("error", widest, what, hint)
    fitted = common_half_width(list(extents.values())) / FILL
    for file, extent in extents.items():
        if declared is None and extent >= fitted:
            where = f"half_width = {extent / FILL:.6g} in {SETTINGS_FILE}"
            what = f"extends to {extent:.6g}, out of scale with the others, whose frame has half width {fitted:.6g}"
            hint = f"check its unit and look for stray vertices, or set {where}; the view input leaves it out"
            yield Anomaly("warning", file, what, hint)
        elif (extent / (declared or fitted) * SIZE) ** 2 < FEWEST_PIXELS:
            what = f"extends to {extent:.6g}, almost nothing in a frame of half width {declared or fitted:.6g}"
            yield Anomaly("warning", file, what, "check its unit; the view input leaves it out")


def _relative(path: Path, folder: Path) -> str:
    return folder.resolve().name if path == folder else path.relative_to(folder).as_posix()
