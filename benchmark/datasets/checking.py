"""Validation of data sets: a row for each shape, and each problem on one line with the file and a hint."""

from __future__ import annotations

import hashlib
import statistics
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.base import Watched, check_retrievable
from benchmark.datasets.catalogue import CATALOGUE, check_ranked, open_dataset
from benchmark.datasets.folder import all_mesh_files, mesh_stem, skipped_files, sub_folders
from benchmark.datasets.official import SETS
from benchmark.datasets.settings import SETTINGS_FILE
from benchmark.errors import BenchmarkError, DatasetError, ShapeError
from benchmark.geometry.camera import Camera
from benchmark.geometry.cleaning import CleaningReport, clean
from benchmark.geometry.depth import FEWEST_PIXELS, FILL, SIZE, camera_coordinates, common_half_width
from benchmark.geometry.io import READABLE
from benchmark.geometry.mesh import Faces, Mesh, edges_of

Severity = Literal["error", "warning"]


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

    severity: Severity
    file: str
    what: str
    hint: str

    def __str__(self) -> str:
        return f"{self.severity:<7}  {self.file}  {self.what}; {self.hint}"


@dataclass(frozen=True)
class Row:
    """A readable shape: counts of its unprocessed mesh; holes and components are counted after cleaning.

    Parameters
    ----------
    file, subject, pose
        Names of the shape.
    vertices, faces, components, holes
        Counts; boundary loops that share a vertex are one hole.
    extent
        Half the longest side of the bounding box in the camera's frame, in file units.
    digest
        Digest of vertices and faces, independent of the file format.
    cleaning
        Counts from :func:`benchmark.geometry.cleaning.clean`.
    """

    file: str
    subject: str
    pose: str
    vertices: int
    faces: int
    components: int
    holes: int
    extent: float
    digest: str = field(repr=False)
    cleaning: CleaningReport = field(repr=False)


@dataclass(frozen=True)
class Report:
    """Results of a check.

    Parameters
    ----------
    name, stand_in_for
        As in :class:`~benchmark.api.datasets.ShapeSet`.
    n_shapes
        Number of shapes; those without a row are unreadable.
    class_sizes
        Number of shapes per class; empty if the folder could not be opened.
    rows
        Readable shapes.
    anomalies
        Errors and warnings, first those of the set, then those of its shapes.
    """

    name: str
    stand_in_for: str
    n_shapes: int
    class_sizes: dict[str, int]
    rows: tuple[Row, ...] = field(repr=False)
    anomalies: tuple[Anomaly, ...]

    @property
    def usable(self) -> bool:
        """Whether there are no errors."""
        return not any(anomaly.severity == "error" for anomaly in self.anomalies)

    @property
    def coverage(self) -> float:
        """Share of the shapes that can be read; the others count as 0 for every method."""
        return len(self.rows) / self.n_shapes if self.n_shapes else 0.0

    def lines(self) -> list[str]:
        """Return the report as text: a summary, one line per anomaly, and their counts."""
        kind = f"stand-in for {self.stand_in_for}" if self.stand_in_for else "not a stand-in"
        errors = sum(anomaly.severity == "error" for anomaly in self.anomalies)
        unread = "" if self.coverage == 1 else f", {self.n_shapes - len(self.rows)} unreadable, which count as 0"
        return [
            f"{self.name}: {self.n_shapes} shapes, {len(self.class_sizes)} classes, {kind}{unread}",
            f"classes     {', '.join(f'{subject} {size}' for subject, size in self.class_sizes.items()) or 'unknown'}",
            *(f"{name:<11} {self._range(name)}" for name in ("vertices", "faces", "components", "holes")),
            *map(str, self.anomalies),
            f"{errors} errors, {len(self.anomalies) - errors} warnings",
        ]

    def _range(self, name: str) -> str:
        values = [getattr(row, name) for row in self.rows]
        if not values:
            return "none could be read"
        return f"{min(values)} to {max(values)}, median {statistics.median(values):g}"


def check_source(name: str, data_root: Path | None, watched: Watched = iter) -> Report:
    """Check a data set by name or folder; if it cannot be opened, report that and check its meshes anyway.

    Parameters
    ----------
    name, data_root
        See :func:`~benchmark.datasets.catalogue.open_dataset`.
    watched
        See :func:`check`.

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
        anomalies = [Anomaly("error", folder.name, error.problem, error.hint), *_of_files(unopened), *of_shapes]
        return Report(unopened.name, "", len(entries), {}, rows, tuple(anomalies))


def check(dataset: ShapeSet, watched: Watched = iter) -> Report:
    """Check a data set: its files, its classes, and every mesh.

    Parameters
    ----------
    dataset
        An open data set; :func:`check_source` also reports why a folder cannot be opened.
    watched
        Progress wrapper; see :data:`~benchmark.datasets.base.Watched`.
    """
    rows, of_shapes = _inspect_all(dataset, watched)
    anomalies = (*_of_classes(dataset), *_of_files(dataset), *of_shapes)
    sizes = dict(Counter(entry.subject for entry in dataset.shapes))
    return Report(dataset.name, dataset.stand_in_for, len(dataset.shapes), sizes, rows, anomalies)


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
    for subject, size in (SETS[dataset.name].sizes if dataset.name in SETS else {}).items():
        if sizes[subject] != size:
            what = f"class '{subject}' has {sizes[subject]} shapes, officially {size}"
            hint = f"unpack the official archive there, or name the folder, -d {dataset.folder}, where no more is meant"
            yield Anomaly("error", dataset.name, what, hint)


def _of_files(dataset: ShapeSet) -> Iterator[Anomaly]:
    """Yield files of a folder that are no shapes of the data set."""
    folder, used = dataset.folder, {entry.path for entry in dataset.shapes}
    if folder is None:
        return
    for path in skipped_files(folder):
        hint = f"convert it to one of {', '.join(READABLE)}"
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
            row = inspect(dataset.load(entry), dataset.camera(entry), entry, file)
        except ShapeError as error:
            anomalies.append(Anomaly("error", file, error.problem.removeprefix(f"{entry.path}: "), error.hint))
            continue
        rows.append(row)
        if not row.extent:
            anomalies.append(Anomaly("error", file, "no face has an area", "export the mesh again"))
        if dataset.observe is None:  # views are open and possibly disconnected
            anomalies += [Anomaly("warning", file, what, hint) for what, hint in _flaws(row)]
        twin = first_with.setdefault(row.digest, row)
        if twin is not row:
            where = "" if twin.subject == row.subject else f" of another class, '{twin.subject}'"
            severity: Severity = "error" if where else "warning"
            anomalies.append(Anomaly(severity, file, f"the same geometry as {twin.file}{where}", "keep one of the two"))
    return tuple(rows), [*anomalies, *_of_frame(dataset, {row.file: row.extent for row in rows if row.extent})]


def inspect(mesh: Mesh, camera: Camera, entry: Entry, file: str) -> Row:
    """Inspect an unprocessed mesh."""
    cleaned, report = clean(mesh)
    return Row(
        file=file,
        subject=entry.subject,
        pose=entry.pose,
        vertices=report.vertices_before,
        faces=report.faces_before,
        components=report.components,
        holes=count_holes(cleaned.faces) if report.boundary_edges else 0,
        extent=float(np.abs(camera_coordinates(cleaned, camera)).max()) if cleaned.n_faces else 0.0,
        digest=hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes()).hexdigest(),
        cleaning=report,
    )


def count_holes(faces: Faces) -> int:
    """Return the number of connected components of the boundary edges."""
    vertices, ends = np.unique(edges_of(faces).boundary, return_inverse=True)
    ends = ends.reshape(-1, 2)
    shape = (len(vertices), len(vertices))
    graph = coo_array((np.ones(len(ends), dtype=np.int8), (ends[:, 0], ends[:, 1])), shape=shape)
    return int(connected_components(graph.tocsr(), directed=False)[0])


def _flaws(row: Row) -> Iterator[tuple[str, str]]:
    """Yield the defects that prevent a mesh from being a connected closed manifold, each with its effect or a fix."""
    cleaning = row.cleaning
    merged = "nothing to do: preparation merges equal positions"
    dropped = "nothing to do: preparation drops what carries no surface"
    known = (
        (cleaning.merged, "duplicate vertex", "duplicate vertices", merged),
        (cleaning.unreferenced, "vertex without a face", "vertices without a face", dropped),
        (cleaning.degenerate_faces, "degenerate face", "degenerate faces", dropped),
        (cleaning.duplicate_faces, "duplicate face", "duplicate faces", dropped),
        (row.components * (row.components > 1), "", "components", "join them if the surface should be in one piece"),
        (
            *(cleaning.boundary_edges, f"boundary edge around {_holes(row)}", f"boundary edges around {_holes(row)}"),
            "close the surface for methods that need it closed",
        ),
        (
            *(cleaning.non_manifold_edges, "non-manifold edge", "non-manifold edges"),
            "remove faces until each edge has two",
        ),
        (
            *(cleaning.non_manifold_vertices, "non-manifold vertex", "non-manifold vertices"),
            "split each into one vertex per fan of faces",
        ),
    )
    for count, one, several, hint in known:
        if count:
            yield f"{count} {one if count == 1 else several}", hint


def _holes(row: Row) -> str:
    return f"{row.holes} hole{'' if row.holes == 1 else 's'}"


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
