"""Validation of data sets: each anomaly is reported on one line with the file and a hint."""

from __future__ import annotations

import re
import statistics
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.base import Watched, check_retrievable
from benchmark.datasets.catalogue import CATALOGUE, check_ranked, open_dataset
from benchmark.datasets.folder import all_mesh_files, mesh_stem, sub_folders, unread_files
from benchmark.datasets.inspection import Inspection, flaws, inspect
from benchmark.datasets.official import SETS
from benchmark.datasets.settings import SETTINGS_FILE
from benchmark.errors import BenchmarkError, DatasetError, ShapeError
from benchmark.geometry.depth import FEWEST_PIXELS, FILL, SIZE, common_half_width
from benchmark.geometry.io import READABLE, mesh_suffix

Severity = Literal["error", "warning"]


@dataclass(frozen=True)
class Anomaly:
    """A problem in a data set.

    Parameters
    ----------
    severity
        ``"error"`` if the data set is unusable without a fix, otherwise ``"warning"``.
    file
        The file, relative to the folder, or the identifier of a generated shape.
    what
        Description of the problem.
    hint
        Suggested action.
    """

    severity: Severity
    file: str
    what: str
    hint: str

    def __str__(self) -> str:
        return f"{self.severity:<7}  {self.file}  {self.what}; {self.hint}"


@dataclass(frozen=True)
class Report:
    """Results of a check.

    Parameters
    ----------
    name, stand_in_for
        As in :class:`~benchmark.api.datasets.ShapeSet`.
    n_shapes
        Number of shapes.
    class_sizes
        Number of shapes per class; empty if the folder could not be opened.
    inspections
        Properties of each readable mesh, by identifier.
    anomalies
        Errors and warnings, first those of the set, then those of its shapes.
    """

    name: str
    stand_in_for: str
    n_shapes: int
    class_sizes: dict[str, int]
    inspections: dict[str, Inspection] = field(repr=False)
    anomalies: tuple[Anomaly, ...]

    @property
    def usable(self) -> bool:
        """Whether there are no errors."""
        return not any(anomaly.severity == "error" for anomaly in self.anomalies)

    def lines(self) -> list[str]:
        """Return the report as text: a summary, one line per anomaly, and their counts."""
        kind = f"stand-in for {self.stand_in_for}" if self.stand_in_for else "not a stand-in"
        cleanings = [inspection.cleaning for inspection in self.inspections.values()]
        errors = sum(anomaly.severity == "error" for anomaly in self.anomalies)
        return [
            f"{self.name}: {self.n_shapes} shapes, {len(self.class_sizes)} classes, {kind}",
            f"classes     {', '.join(f'{subject} {size}' for subject, size in self.class_sizes.items()) or 'unknown'}",
            f"vertices    {_range_and_median([report.vertices_before for report in cleanings])}",
            f"faces       {_range_and_median([report.faces_before for report in cleanings])}",
            f"components  {_range_and_median([report.components for report in cleanings])}",
            f"holes       {_range_and_median([inspection.holes for inspection in self.inspections.values()])}",
            *map(str, self.anomalies),
            f"{errors} errors, {len(self.anomalies) - errors} warnings",
        ]


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
        folder = _folder_of(name, data_root)
        if folder is None or not folder.is_dir():
            raise
        return _check_unopened(name if name in CATALOGUE else folder.resolve().name, folder, error, watched)


def check(dataset: ShapeSet, watched: Watched = iter) -> Report:
    """Check a data set: its files, its classes, and every mesh.

    Parameters
    ----------
    dataset
        An open data set; :func:`check_source` also reports why a folder cannot be opened.
    watched
        Progress wrapper; see :data:`~benchmark.datasets.base.Watched`.
    """
    anomalies = list(_of_classes(dataset))
    folder = dataset.folder
    if folder is not None:
        anomalies += _of_files(folder, dataset.shapes, numbers_known=dataset.name in SETS)
    inspections, of_shapes = _inspect_all(dataset, folder, watched)
    sizes = dict(Counter(entry.subject for entry in dataset.shapes))
    anomalies += of_shapes
    return Report(dataset.name, dataset.stand_in_for, len(dataset.shapes), sizes, inspections, tuple(anomalies))


def _folder_of(name: str, data_root: Path | None) -> Path | None:
    if name not in CATALOGUE:
        return Path(name)
    part = CATALOGUE[name].folder
    return data_root / part if data_root is not None and part else None


def _check_unopened(name: str, folder: Path, error: BenchmarkError, watched: Watched) -> Report:
    """Report why a folder is not a data set, and check its meshes anyway."""
    anomalies = [Anomaly("error", folder.name, error.problem, error.hint)]
    paths = [path for place in (folder, *sub_folders(folder)) for path in all_mesh_files(place)]
    entries = tuple(Entry(_relative(path, folder), "", "", path) for path in paths)
    anomalies += _of_files(folder, entries)
    inspections, of_shapes = _inspect_all(ShapeSet(name=name, shapes=entries, folder=folder), folder, watched)
    return Report(name, "", len(entries), {}, inspections, (*anomalies, *of_shapes))


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
    official = SETS[dataset.name].sizes if dataset.name in SETS else {}
    if not official:
        return
    for subject in dict.fromkeys([*official, *sizes]):
        if sizes[subject] != official.get(subject, 0):
            yield Anomaly(
                "error",
                dataset.name,
                f"class '{subject}' has {sizes[subject]} shapes, officially {official.get(subject, 0)}",
                f"unpack the official archive there, or name the folder, -d {dataset.folder}, where no more is meant",
            )


def _of_files(folder: Path, entries: Sequence[Entry], *, numbers_known: bool = False) -> Iterator[Anomaly]:
    used = {entry.path for entry in entries}
    for path in unread_files(folder):
        hint = f"convert it to one of {', '.join(READABLE)}"
        yield Anomaly("warning", _relative(path, folder), "is skipped: this format is not read", hint)
    places = dict.fromkeys([folder, *(path.parent for path in used if path), *sub_folders(folder)])
    for place in places:
        files = all_mesh_files(place)
        by_stem: dict[str, list[Path]] = {}
        for path in files:
            by_stem.setdefault(mesh_stem(path), []).append(path)
        for path, *others in by_stem.values():
            for other in others:
                what = f"the same name as {path.name} in another format"
                yield Anomaly("warning", _relative(other, folder), what, "keep one of the two; this one is not read")
        extensions = Counter(mesh_suffix(files_of_stem[0]) for files_of_stem in by_stem.values())
        if len(extensions) > 1:
            what = "mixes " + ", ".join(f"{count} {suffix}" for suffix, count in extensions.most_common())
            yield Anomaly("warning", _relative(place, folder), what, "check that no mesh is left from another copy")
        for path in (files_of_stem[0] for files_of_stem in by_stem.values()):
            if path not in used:
                what = "is none of the shapes of this data set"
                yield Anomaly("warning", _relative(path, folder), what, "remove it, or list it if it belongs here")
        if not numbers_known:
            yield from _of_numbers(place, by_stem, folder)


def _of_numbers(place: Path, stems: Iterable[str], folder: Path) -> Iterator[Anomaly]:
    """Yield gaps in the numbering of purely numeric file names, as in SHREC."""
    names = list(stems)
    if not names or not all(re.fullmatch("[0-9]+", name) for name in names):
        return
    numbers = {int(name) for name in names}
    where = _relative(place, folder)
    if min(numbers) == 1:
        what = f"numbered from 1 to {max(numbers)}"
        yield Anomaly("warning", where, what, "subtract 1 from each if the classes count from 0, as those of SHREC do")
    missing = sorted(set(range(min(numbers), max(numbers))) - numbers)
    if missing:
        listed = ", ".join(map(str, missing[:10])) + (" ..." if len(missing) > 10 else "")
        what = f"numbers {min(numbers)} to {max(numbers)} lack {listed}"
        yield Anomaly("warning", where, what, "fetch the missing meshes or renumber the others")


def _inspect_all(
    dataset: ShapeSet, folder: Path | None, watched: Watched
) -> tuple[dict[str, Inspection], list[Anomaly]]:
    inspections: dict[str, Inspection] = {}
    anomalies: list[Anomaly] = []
    first_with: dict[str, str] = {}
    extents: dict[str, float] = {}
    for entry in watched(dataset.shapes):
        file = _relative(entry.path, folder) if entry.path and folder else entry.identifier
        try:
            inspection = inspect(dataset.load(entry), dataset.camera(entry))
        except ShapeError as error:
            anomalies.append(Anomaly("error", file, error.problem.removeprefix(f"{entry.path}: "), error.hint))
            continue
        inspections[entry.identifier] = inspection
        if not inspection.faces_left:
            anomalies.append(Anomaly("error", file, "no face has an area", "export the mesh again"))
        if dataset.observe is None:  # views are open and possibly disconnected
            anomalies += [Anomaly("warning", file, what, hint) for what, hint in flaws(inspection)]
        twin = first_with.setdefault(inspection.digest, file)
        if twin != file:
            anomalies.append(Anomaly("warning", file, f"the same geometry as {twin}", "keep one of the two"))
        if inspection.extent:
            extents[file] = inspection.extent
    return inspections, [*anomalies, *_of_frame(dataset, extents)]


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
        where = f"half_width = {extent / FILL:.6g} in {SETTINGS_FILE}"
        if declared is None and extent >= fitted:
            what = f"extends to {extent:.6g}, out of scale with the others, whose frame has half width {fitted:.6g}"
            hint = f"check its unit and look for stray vertices, or set {where}; the view input leaves it out"
            yield Anomaly("warning", file, what, hint)
        elif (extent / (declared or fitted) * SIZE) ** 2 < FEWEST_PIXELS:
            what = f"extends to {extent:.6g}, almost nothing in a frame of half width {declared or fitted:.6g}"
            yield Anomaly("warning", file, what, "check its unit; the view input leaves it out")


def _range_and_median(values: Sequence[int]) -> str:
    if not values:
        return "none could be read"
    return f"{min(values)} to {max(values)}, median {statistics.median(values):g}"


def _relative(path: Path | None, folder: Path) -> str:
    if path is None or path == folder:
        return folder.resolve().name
    return path.relative_to(folder).as_posix()
