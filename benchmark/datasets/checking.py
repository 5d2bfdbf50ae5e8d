"""Validation of data sets: each kind of problem on one line with its files and a hint."""

from __future__ import annotations

import hashlib
import math
import os
import re
import statistics
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.anomalies import Anomaly, by_kind
from benchmark.datasets.base import Watched, check_retrievable
from benchmark.datasets.catalogue import CATALOGUE, check_ranked, open_dataset
from benchmark.datasets.folder import (
    all_mesh_files,
    is_hidden,
    pictures,
    skipped_files,
    sub_folders,
)
from benchmark.datasets.labels import spelled_alike
from benchmark.datasets.mesh_files import (
    POINTS,
    faces_without_corners,
    lacks_last_break,
    mesh_file_set,
    mesh_stem,
)
from benchmark.datasets.official import SETS, folders_of_set
from benchmark.datasets.settings import SETTINGS_FILE
from benchmark.depth.reading import MASK_FOLDERS, is_depth_file, is_grey_picture
from benchmark.errors import (
    BenchmarkError,
    DatasetError,
    ShapeError,
    UnreadableMesh,
    surface_command,
)
from benchmark.files import file_digest
from benchmark.geometry.cleaning import compact, topology
from benchmark.geometry.depth import (
    FEWEST_PIXELS,
    FILL,
    SIZE,
    camera_coordinates,
    common_half_width,
    depth_surface,
)
from benchmark.geometry.mesh import Mesh
from benchmark.geometry.preparation import Prepared, prepare
from benchmark.text import counted, listed

#: Factors between units of length: inches and centimetres, centimetres and millimetres, inches and
#: feet, inches and millimetres, metres and centimetres, feet and millimetres, metres and
#: millimetres.
_UNITS = (2.54, 10, 12, 25.4, 100, 304.8, 1000)
#: Largest relative difference of a factor from that of two units, because sizes of a subject differ
#: between poses.
_NEAR_UNIT = 0.05

#: What the report of a preparation counts: its name there, the counted thing in singular and
#: plural, and what happens to it.
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

#: What is said of a mesh or depth image in the folder of a data set that is no shape, and what to
#: do.
_NO_SHAPE = (
    "none of the shapes of this data set",
    "remove it, or move it to the shapes, and list it if these are listed",
)

#: Lines of a report on the meshes, and the count of a shape whose range each gives.
_COUNTS = {
    "vertices": "vertices_before",
    "faces": "faces_before",
    "components": "components",
    "holes": "holes",
}


@dataclass(frozen=True)
class CheckedShape:
    """A readable shape, as a check of its data set sees it.

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
    capture
        How a depth image was taken: ``unit``, ``camera``, ``mask``, and the range of its ``depths``
        and the ``distance`` and ``size`` of its object in metres; empty for a mesh.
    """

    file: str
    subject: str
    counts: Mapping[str, float]
    changes: Sequence[tuple[str, str]]
    extent: float
    size: float
    digest: str
    capture: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Report:
    """Results of a check: the readable shapes, and the problems by kind, errors first."""

    dataset: ShapeSet
    shapes: tuple[CheckedShape, ...]
    anomalies: tuple[Anomaly, ...]

    @property
    def usable(self) -> bool:
        """Whether there are no errors."""
        return not any(anomaly.severity == "error" for anomaly in self.anomalies)

    def lines(self) -> list[str]:
        """Return the report as text: a summary, one line per kind of problem, and their counts."""
        return [
            self._title(),
            f"classes     {self._classes()}",
            *(f"{name:<11} {text}" for name, text in self._ranges().items()),
            *map(str, self.anomalies),
            self._totals(),
        ]

    def _ranges(self) -> dict[str, str]:
        """Return the range of each count of meshes, and of each fact about depth images."""
        ranges = {}
        for name, key in _COUNTS.items():
            ranges[name] = _range([shape.counts[key] for shape in self.shapes])
        if self.shapes:
            for name in self.shapes[0].capture:
                ranges[name] = _summary([shape.capture[name] for shape in self.shapes])
        return ranges

    @cached_property
    def _sizes(self) -> Mapping[str, int]:
        """Number of shapes of each class."""
        return Counter(entry.subject for entry in self.dataset.shapes if entry.subject)

    def _title(self) -> str:
        """Return the line that says how much there is, and what the set is by its content."""
        n_shapes = len(self.dataset.shapes)
        n_unread = n_shapes - len(self.shapes)
        title = (
            f"{self.dataset.name}: {n_shapes} shapes, {len(self._sizes)} classes, "
            f"{describe_content(self.dataset)}"
        )
        return f"{title}, {n_unread} unreadable, which count as 0" if n_unread else title

    def _classes(self) -> str:
        """Return the classes with their sizes."""
        return ", ".join(f"{name} {size}" for name, size in self._sizes.items()) or "unknown"

    def _totals(self) -> str:
        """Return how many files have an error, and how many a warning."""
        counts = Counter[str]()
        for anomaly in self.anomalies:
            counts[anomaly.severity] += len(anomaly.files)
        return ", ".join(counted(counts[severity], severity) for severity in ("error", "warning"))


def _range(values: list[float]) -> str:
    """Return the least, the largest and the median of numbers as text."""
    if not values:
        return "none could be read"
    return f"{min(values):.10g} to {max(values):.10g}, median {statistics.median(values):.10g}"


def _summary(values: Sequence[Any]) -> str:
    """Return the range of numbers, or texts with their counts."""
    if isinstance(values[0], str):
        return listed(f"{text} ({count})" for text, count in Counter(values).most_common())
    return f"{np.min(values):.4g} to {np.max(values):.4g} m"


def describe_content(dataset: ShapeSet) -> str:
    """Return in words what a data set holds, whatever it is called.

    - "stand-in for X": generated shapes in place of the official set X;
    - "X (SHA-256 of all 80 files)": a published copy of an official set;
    - "files named like X, unverified": an official set by the names of its files only;
    - "not a stand-in": anything else.
    """
    if dataset.stand_in_for:
        return f"stand-in for {dataset.stand_in_for}"
    official = SETS.get(dataset.name)
    if official is None:
        return "not a stand-in"
    # The published copy to which each file belongs by its digest.
    copies = [official.copy_of(entry) for entry in dataset.shapes]
    first = copies[0] if copies else None
    are_of_one_copy = all(copy is first for copy in copies)
    if first is None or not are_of_one_copy:
        return f"files named like {official.title}, unverified"
    n_files = len(first.digests)
    is_complete = len(copies) == n_files
    count = f"all {n_files}" if is_complete else f"{len(copies)} of its {n_files}"
    return f"{first.title} (SHA-256 of {count} files)"


def _problems_of_copies(dataset: ShapeSet) -> Iterator[Anomaly]:
    """Yield a warning for each file of an official set that is not the published one.

    The published copy to which most files belong counts. If no file belongs to any copy, a single
    warning is about the whole set.
    """
    official = SETS.get(dataset.name)
    if official is None or dataset.stand_in_for:
        return
    unverified = f"'files named like {official.title}, unverified'"
    # The published copy to which each file belongs by its digest.
    copy_of = {entry: official.copy_of(entry) for entry in dataset.shapes}
    known_copies = [copy for copy in copy_of.values() if copy is not None]
    if not known_copies:
        what = f"no file has the SHA-256 of a known copy: tables say {unverified}"
        hint = "say beside the scores where the files are from"
        yield Anomaly("warning", (dataset.name,), what, hint)
        return
    most_frequent, _ = Counter(known_copies).most_common(1)[0]
    what = f"its SHA-256 is not that of the file in '{most_frequent.title}'"
    hint = f"restore it, or tables say {unverified}"
    for entry, copy in copy_of.items():
        if copy is not most_frequent:
            yield Anomaly("warning", (_file_of(dataset, entry),), what, hint)


def check_source(name: str, data_root: Path | None, watched: Watched = iter) -> Report:
    """Check a data set by name or folder.

    If it cannot be opened, the report says so, and its meshes are checked anyway.

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
        return check_dataset(open_dataset(name, data_root), watched)
    except BenchmarkError as error:
        folder = _folder_of(name, data_root)
        if folder is None or not folder.is_dir():
            raise
        problem = Anomaly("error", (folder.name,), error.located, error.hint)
        return _report(_unsorted_meshes(name, folder), [problem], watched)


def _folder_of(name: str, data_root: Path | None) -> Path | None:
    """Return the folder that should hold a data set; None for one without a folder."""
    if name not in CATALOGUE:
        return Path(name)
    folder = CATALOGUE[name].folder
    return data_root / folder if data_root and folder else None


def _unsorted_meshes(name: str, folder: Path) -> ShapeSet:
    """Return all meshes of a folder that is no valid data set, without classes."""
    entries = []
    for place in (folder, *sub_folders(folder)):
        entries += [Entry(_relative(path, folder), "", "", path) for path in all_mesh_files(place)]
    if name not in CATALOGUE:
        name = folder.resolve().name
    return mesh_file_set(name=name, shapes=tuple(entries), folder=folder)


def check_dataset(dataset: ShapeSet, watched: Watched = iter) -> Report:
    """Check a data set: its files, its classes, and every mesh; see :func:`check_source`."""
    problems = [
        *_problems_of_copies(dataset),
        *_problems_of_classes(dataset),
        *classes_alike(dataset),
    ]
    return _report(dataset, problems, watched)


def _problems_of_classes(dataset: ShapeSet) -> Iterator[Anomaly]:
    """Yield what is wrong with the classes of a data set.

    - An official set with a single subject is not made for retrieval: it gets one warning.
    - Too few classes, or too few shapes in them, are an error: nothing could be retrieved.
    - Shapes that are alone in their class are a warning: they are ranked, but are no queries.
    - A class of an official set with another size than published is an error.
    """
    try:
        check_ranked(dataset)
    except DatasetError as error:
        # The set has another purpose, so the rules below do not apply to it.
        yield Anomaly("warning", (dataset.name,), error.located, error.hint)
        return
    try:
        check_retrievable(dataset)
    except DatasetError as error:
        # The checks go on, so that a user sees all problems at once.
        yield Anomaly("error", (dataset.name,), error.located, error.hint)
    sizes = Counter(entry.subject for entry in dataset.shapes)
    # A shape with the label -1 has a class of its own, so it counts here, too.
    n_lone = sum(size == 1 for size in sizes.values())
    if n_lone:
        what = (
            f"ranked, but no queries: {n_lone} of {len(dataset.shapes)} shapes "
            "(alone in their class, or of class -1)"
        )
        hint = "add a shape to their classes if they should count"
        yield Anomaly("warning", (dataset.name,), what, hint)
    yield from _unofficial_sizes(dataset, sizes)


def classes_alike(dataset: ShapeSet) -> Iterator[Anomaly]:
    """Yield a warning if names of classes differ in case, blanks, hyphens or underscores alone."""
    pairs = spelled_alike(entry.subject for entry in dataset.shapes)
    if pairs:
        what = f"classes that differ in spelling alone count as two: {listed(pairs)}"
        yield Anomaly("warning", (dataset.name,), what, "give each class one name")


def _unofficial_sizes(dataset: ShapeSet, sizes: Mapping[str, int]) -> Iterator[Anomaly]:
    """Yield an error for each class of an official set that has another size than published.

    Parameters
    ----------
    dataset
        The data set; one that is not official has no published sizes.
    sizes
        Number of shapes by class; 0 for a class without shapes.
    """
    official = SETS.get(dataset.name)
    if official is None:
        return
    for subject, size in official.sizes.items():
        if sizes[subject] != size:
            what = f"class '{subject}' has {sizes[subject]} shapes, officially {size}"
            hint = (
                "unpack the official archive there, or name the folder, "
                f"-d {dataset.folder}, where no more is meant"
            )
            yield Anomaly("error", (dataset.name,), what, hint)


def unread_files(dataset: ShapeSet) -> Iterator[Anomaly]:
    """Yield a warning for each file in the folder of a data set that is not read as a shape."""
    folder = dataset.folder
    if folder is None:
        return
    # Other kinds of files; an official archive may hold any.
    if dataset.name not in SETS:
        for path in skipped_files(folder):
            what, hint = _why_skipped(path, folder)
            yield Anomaly("warning", (_relative(path, folder),), f"skipped: {what}", hint)
    # Meshes and depth images that are no shapes of the set, also in folders that are not read.
    used = {entry.path for entry in dataset.shapes}
    folders_of_shapes = [path.parent for path in used if path]
    for place in dict.fromkeys([*folders_of_set(folder), *folders_of_shapes]):
        yield from _surplus_meshes(place, folder, used)
        are_depth_images = dataset.observe is not None
        if are_depth_images and place.name.lower() not in MASK_FOLDERS:
            yield from _surplus_images(place, folder, used)


def _why_skipped(path: Path, folder: Path) -> tuple[str, str]:
    """Return what a skipped file is, and what to do."""
    if is_hidden(path):
        return "hidden", "remove what macOS writes beside each file, or rename a shape"
    if path.suffix.lower() in POINTS:
        return "points, not a surface", f"make a surface of them: {surface_command('FILE')}"
    hint = f"labels.txt and {SETTINGS_FILE} are read, in {folder.name}"
    return "no shape, labels or settings", hint


def _surplus_meshes(place: Path, folder: Path, used: Container[Path | None]) -> Iterator[Anomaly]:
    """Yield a warning for each mesh in a folder that is not a shape of the data set.

    Parameters
    ----------
    place
        The folder to search: that of the data set, or one below it.
    folder
        Folder of the data set, relative to which files are named.
    used
        Files of the shapes of the data set.
    """
    first_of_name: dict[str, Path] = {}
    for path in all_mesh_files(place):
        name = _relative(path, folder)
        first = first_of_name.setdefault(mesh_stem(path), path)
        if first != path:
            what = "the name of another in another format"
            hint = "keep one of the two; this one is not read"
            yield Anomaly("warning", (f"{name} ({first.name})",), what, hint)
        elif path not in used:
            yield Anomaly("warning", (name,), *_NO_SHAPE)


def _surplus_images(place: Path, folder: Path, used: Container[Path | None]) -> Iterator[Anomaly]:
    """Yield a warning for each image in a folder that may be meant as a shape, but is none.

    Parameters
    ----------
    place
        The folder to search: that of the data set, or one below it.
    folder
        Folder of the data set, relative to which files are named.
    used
        Images of the shapes of the data set.
    """
    for path in pictures(place):
        if path in used:
            continue
        name = _relative(path, folder)
        if is_depth_file(path):
            yield Anomaly("warning", (name,), *_NO_SHAPE)
        elif is_grey_picture(path):
            what = "skipped: grey of 8 bits, no depth"
            yield Anomaly("warning", (name,), what, "export it with 16 bits if it shows depths")


def unreadable_files(dataset: ShapeSet) -> Iterator[Anomaly]:
    """Yield the files of shapes that are missing or do not end; their shapes are refused."""
    for path in dict.fromkeys(chain.from_iterable(map(dataset.files, dataset.shapes))):
        try:
            file_digest(path)
        except UnreadableMesh as error:
            file = _relative(path, dataset.folder) if dataset.folder else path.name
            yield Anomaly("error", (file,), error.problem, error.hint)


def unfinished_files(dataset: ShapeSet, entries: Iterable[Entry]) -> Iterator[Anomaly]:
    """Yield the mesh files of shapes that are text without a last line break.

    They are read all the same.
    """
    files = chain.from_iterable(map(dataset.files, entries))
    for path in dict.fromkeys(files):
        if lacks_last_break(path):
            file = _relative(path, dataset.folder) if dataset.folder else path.name
            what = "text without a last line break: its last number may be cut off"
            yield Anomaly("warning", (file,), what, "compare it with its source")


def _report(dataset: ShapeSet, problems: Iterable[Anomaly], watched: Watched) -> Report:
    """Inspect all shapes of a data set, and return the report on them and on the whole set.

    Parameters
    ----------
    dataset
        The data set.
    problems
        Problems of the set that were found before its shapes are read.
    watched
        Progress wrapper around the shapes.
    """
    # The shapes that can be read, their entries, and what is wrong with single shapes.
    shapes: list[CheckedShape] = []
    read: list[Entry] = []
    anomalies: list[Anomaly] = []
    for entry in watched(dataset.shapes):
        file = _file_of(dataset, entry)
        try:
            shape = _inspect(dataset, entry, file)
        except ShapeError as error:
            # The report names the file of the shape; another file is named in the message.
            is_about_another_file = error.file not in (None, entry.path)
            problem = error.located if is_about_another_file else error.problem
            anomalies.append(Anomaly("error", (file,), problem, error.hint))
            continue
        shapes.append(shape)
        read.append(entry)
        anomalies += [Anomaly("warning", (file,), what, hint) for what, hint in shape.changes]
    all_anomalies = [
        *problems,
        *unread_files(dataset),
        *unfinished_files(dataset, read),
        *anomalies,
        *_copies_of_shapes(shapes),
    ]
    are_meshes = dataset.observe is None
    if are_meshes:
        all_anomalies += _problems_of_units(shapes)
    extents = {shape.file: shape.extent for shape in shapes}
    all_anomalies += _problems_of_frame(dataset, extents)
    return Report(dataset, tuple(shapes), by_kind(all_anomalies))


def _copies_of_shapes(shapes: Iterable[CheckedShape]) -> Iterator[Anomaly]:
    """Yield an anomaly for each shape with exactly the geometry of an earlier one.

    It is a warning within a class, and an error between two classes.
    """
    first_with_digest: dict[str, CheckedShape] = {}
    for shape in shapes:
        original = first_with_digest.setdefault(shape.digest, shape)
        if original is shape:
            continue
        severity = "warning"
        what = "the same geometry as another"
        if original.subject != shape.subject:
            severity = "error"
            what = f"{what} of another class"
        yield Anomaly(severity, (f"{shape.file} ({original.file})",), what, "keep one of the two")


def changes_of(prepared: Prepared) -> list[tuple[str, str]]:
    """Return what preparation changed in a mesh.

    Parameters
    ----------
    prepared
        The prepared mesh, whose report counts the changes.

    Returns
    -------
    list of (str, str)
        For each change, what was found, such as "3 duplicate faces", and what preparation or the
        user does about it, such as "preparation keeps one of each".
    """
    report = prepared.report
    changes = []
    for name, (singular_and_plural, action) in _CHANGES.items():
        if report[name]:
            what = counted(int(report[name]), *singular_and_plural)
            changes.append((what, action))
    gap = prepared.scale * report["largest_gap"]  # in units of the file
    if gap:
        hint = "join the pieces if the surface should be in one"
        changes.append((f"bridges of length up to {gap:.3g}", hint))
    if report["lost_area"]:
        hint = "preparation drops it with small pieces and crowded edges"
        changes.append((f"{report['lost_area']:.2%} of the area", hint))
    return changes


def _inspect(dataset: ShapeSet, entry: Entry, file: str) -> CheckedShape:
    """Read a shape as a run would, and return its measurements and problems.

    Parameters
    ----------
    dataset, entry
        The data set, and one of its shapes.
    file
        What reports call the file of the shape.

    Raises
    ------
    ShapeError
        If a run could not use the shape.
    """
    if dataset.observe is None:
        mesh = dataset.load(entry)
        prepared = prepare(mesh, mesh.n_vertices)
        changes = [*changes_of(prepared), *_dropped_faces(dataset, entry)]
        return _measured(dataset, entry, file, mesh, counts=prepared.report, changes=changes)
    # The surface behind a depth image is open and possibly in pieces, so it is not prepared.
    observed = dataset.observe(entry)
    mesh = observed.surface
    counts = {
        "vertices_before": mesh.n_vertices,
        "faces_before": mesh.n_faces,
        **topology(compact(mesh.vertices, mesh.faces)),
    }
    changes = [*observed.doubts, *_joined_pieces(dataset, entry, mesh)]
    capture = _capture(observed, entry)
    return _measured(dataset, entry, file, mesh, counts=counts, changes=changes, capture=capture)


def _measured(
    dataset: ShapeSet, entry: Entry, file: str, mesh: Mesh, **findings: Any
) -> CheckedShape:
    """Return a readable shape with its extent, its size and the digest of its geometry.

    Parameters
    ----------
    dataset, entry
        The shape.
    file
        What reports call its file.
    mesh
        Its surface, before preparation.
    **findings
        Further fields of :class:`CheckedShape`: ``counts``, ``changes`` and ``capture``.
    """
    surface = compact(mesh.vertices, mesh.faces)
    return CheckedShape(
        file=file,
        subject=entry.subject,
        extent=float(np.abs(camera_coordinates(surface, dataset.camera(entry))).max()),
        size=float(np.sqrt(mesh.area)),
        digest=hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes()).hexdigest(),
        **findings,
    )


def _dropped_faces(dataset: ShapeSet, entry: Entry) -> Iterator[tuple[str, str]]:
    """Yield how many faces of the mesh file of a shape have no corners, and what is done."""
    if entry.path is None or entry.path not in dataset.files(entry):
        return
    count = faces_without_corners(entry.path)
    if count:
        yield counted(count, "face without corners", "faces without corners"), "reading drops them"


def _joined_pieces(dataset: ShapeSet, entry: Entry, surface: Mesh) -> Iterator[tuple[str, str]]:
    """Yield how many pieces of the surface in a frame of a camera a run joins, and what to do."""
    half_width = dataset.half_width or common_half_width([float(np.abs(surface.vertices).max())])
    pieces = int(depth_surface(surface, dataset.camera(entry), half_width).report["pieces"])
    if pieces > 1:
        what = f"joined_pieces {pieces}: depth jumps part the object, or pixels have no depth"
        yield what, "a run bridges them where they are closest; check the mask"


def _capture(observed: Any, entry: Entry) -> dict[str, Any]:
    """Describe how a depth image was taken; images that were taken alike get the same words.

    Parameters
    ----------
    observed
        The object that the image shows.
    entry
        The shape of the image; the name of its file is replaced by NAME.

    Returns
    -------
    dict
        Texts ``unit``, ``camera`` and ``mask``. In metres, the pair ``depths`` of the least and the
        largest depth, and the numbers ``distance`` and ``size`` of the object.
    """
    notes = observed.notes
    depths = observed.depths[observed.depths > 0]
    stem = entry.path.stem if entry.path else ""
    mask = str(notes.get("mask", "given"))
    return {
        "unit": str(notes.get("unit", "given")),
        "camera": str(notes.get("camera", "given")),
        "mask": re.sub(f"^{re.escape(stem)}", "NAME", mask),
        "depths": (depths.min(), depths.max()),
        "distance": notes["distance"],
        "size": notes["size"],
    }


def _problems_of_units(shapes: Sequence[CheckedShape]) -> Iterator[Anomaly]:
    """Yield a warning about shapes that seem to be in another unit than the others.

    Such a shape is, for example, 1000 times as large as the others of its class; one that is alone
    in its class is compared with the whole set. If a class holds two groups that differ by such a
    factor, the smaller group has the other unit; of equal groups, the one farther from the usual
    size of the set.

    Parameters
    ----------
    shapes
        The readable shapes with their files, classes and sizes (the roots of their areas).
    """
    if not shapes:
        return
    usual_size = statistics.median(shape.size for shape in shapes)
    ratios = {shape.file: _ratio_to_class(shape, shapes, usual_size) for shape in shapes}

    def rank(group: Sequence[CheckedShape]) -> tuple[int, float]:
        """Return a key that sorts few shapes first, and of equally many those far from usual."""
        distance = sum(abs(math.log(shape.size / usual_size)) for shape in group)
        n_shapes = len(group) or len(shapes)  # an empty group comes last
        return n_shapes, -distance

    for factor in _UNITS:
        large = [shape for shape in shapes if _is_near(ratios[shape.file], factor)]
        small = [shape for shape in shapes if _is_near(1 / ratios[shape.file], factor)]
        odd, others = sorted((large, small), key=rank)
        if odd:
            word = "large" if odd is large else "small"
            rest = others or [shape for shape in shapes if shape not in odd]
            yield _other_unit(odd, f"{factor:g} times as {word}", [shape.file for shape in rest])


def _is_near(factor: float, unit: float) -> bool:
    """Return whether a factor is that between two units."""
    return abs(factor / unit - 1) < _NEAR_UNIT


def _ratio_to_class(
    shape: CheckedShape, shapes: Iterable[CheckedShape], usual_size: float
) -> float:
    """Return the size of a shape as a multiple of that of its class, or of all if it is alone."""
    others = [
        other.size for other in shapes if other is not shape and other.subject == shape.subject
    ]
    return shape.size / (statistics.median(others) if others else usual_size)


def _other_unit(odd: Sequence[CheckedShape], how_large: str, others: Sequence[str]) -> Anomaly:
    """Return the warning that shapes seem to have another unit than other files."""
    verb = "are" if len(odd) > 1 else "is"
    what = f"{verb} {how_large} as {len(others)} others ({listed(others)}), a unit's factor"
    hint = f"state the unit of each in {SETTINGS_FILE}, or ignore surface-area"
    return Anomaly("warning", tuple(shape.file for shape in odd), what, hint)


def _problems_of_frame(dataset: ShapeSet, extents: Mapping[str, float]) -> Iterator[Anomaly]:
    """Yield the shapes that do not fit the frame of the camera, or hardly fill it.

    Parameters
    ----------
    dataset
        The data set.
    extents
        Extent of each readable shape in the frame, by its file: the largest coordinate from the
        centre, in units of the data set.
    """
    if not extents:
        return
    # Half the width of the frame, as the data set declares it, or else fitted to all shapes.
    declared = dataset.half_width
    widest = max(extents, key=lambda file: extents[file])
    if declared is not None and extents[widest] >= declared:
        what = f"extends to {extents[widest]:.6g}, beyond the camera's half width of {declared:.6g}"
        hint = f"set half_width = {extents[widest] / FILL:.6g} in {SETTINGS_FILE}, or remove it"
        yield Anomaly("error", (widest,), what, hint)
    fitted = common_half_width(list(extents.values())) / FILL
    for file, extent in extents.items():
        if declared is None and extent >= fitted:
            what = (
                f"extends to {extent:.6g}, out of scale with the others, "
                f"whose frame has half width {fitted:.6g}"
            )
            hint = (
                "check its unit and look for stray vertices, or set half_width = "
                f"{extent / FILL:.6g} in {SETTINGS_FILE}; the view input leaves it out"
            )
            yield Anomaly("warning", (file,), what, hint)
        elif _is_too_small(extent, declared or fitted):
            what = (
                f"extends to {extent:.6g}, almost nothing in a frame of half width "
                f"{declared or fitted:.6g}"
            )
            yield Anomaly("warning", (file,), what, "check its unit; the view input leaves it out")


def _is_too_small(extent: float, half_width: float) -> bool:
    """Return whether a shape covers too few pixels of an image, even if it fills its bounding box.

    Parameters
    ----------
    extent, half_width
        Half the sides of the bounding box of the shape and of the frame, in the same unit.
    """
    width_in_pixels = extent / half_width * SIZE
    return width_in_pixels**2 < FEWEST_PIXELS


def _file_of(dataset: ShapeSet, entry: Entry) -> str:
    """Return the file of a shape relative to the folder of its set, or the name of the shape."""
    if entry.path and dataset.folder:
        return _relative(entry.path, dataset.folder)
    return entry.identifier


def _relative(path: Path, folder: Path) -> str:
    """Return a path relative to a folder, which may lead out of it; its name for the folder."""
    return folder.resolve().name if path == folder else os.path.relpath(path, folder)
