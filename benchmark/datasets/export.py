"""Export of data sets to files that reproduce the same shapes when read."""

from __future__ import annotations

import json
import re
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from benchmark.datasets.base import Dataset, Entry, Watched
from benchmark.datasets.catalogue import canonical_entry
from benchmark.datasets.files import FolderDataset, file_digest
from benchmark.datasets.folder import subject_of_stem
from benchmark.datasets.manifest import MANIFEST_FILE, ManifestRow, write_manifest
from benchmark.datasets.settings import SETTINGS_FILE, VIEWS
from benchmark.errors import ConfigurationError, DatasetError, did_you_mean
from benchmark.geometry.camera import Camera
from benchmark.geometry.io import write_mesh

LAYOUTS = ("shrec14", "tosca")

CLA_FILE = "classes.cla"


def export(
    dataset: Dataset, folder: Path, layout: str, *, force: bool = False, watched: Watched = iter
) -> tuple[str, ...]:
    """Write all shapes of a data set with classes, cameras and canonical poses into a folder.

    Coordinates are exact, and the order of the shapes is preserved. Files are written to a temporary sibling folder and
    moved at the end, so a failure while writing leaves the folder unchanged.

    Parameters
    ----------
    dataset
        The data set.
    folder
        Target folder, created if necessary.
    layout
        ``"shrec14"``: ``0.obj``, ``1.obj`` ... with a PSB ``.cla`` file [Shilane et al. 2004]. ``"tosca"``:
        ``cat0.off``, ``cat1.off`` ..., the class and a number: the pose if all poses of the class are distinct numbers,
        otherwise the index in the class.
    force
        Write into a nonempty folder; files of the same name are replaced, others stay.
    watched
        Progress wrapper; see :data:`~benchmark.datasets.base.Watched`.

    Returns
    -------
    tuple of str
        Names of the files, meshes first.

    Raises
    ------
    ConfigurationError
        If the layout is unknown, the folder is nonempty or contains the data set itself, or the layout does not support
        a class name.
    DatasetError
        If the shapes of a class have different cameras.
    ShapeError
        If a mesh is unreadable.
    """
    if layout not in LAYOUTS:
        raise did_you_mean("layout", layout, LAYOUTS)
    _check_words(dataset.entries)
    numbered = [f"{number}.obj" for number in range(len(dataset.entries))]
    names = numbered if layout == "shrec14" else _class_names(dataset.entries)
    cla = {CLA_FILE: _classification(dataset.entries)} if layout == "shrec14" else {}
    texts = {**cla, SETTINGS_FILE: _settings(dataset)}
    _check_target(dataset, folder, {*names, *texts}, force)
    written = (*names, *texts, MANIFEST_FILE)
    with _filled(folder, written) as target:
        shapes = zip(watched(dataset.entries), names, strict=True)
        rows = [_write(dataset, entry, target / file) for entry, file in shapes]
        for file, text in texts.items():
            (target / file).write_bytes(text.encode())
        write_manifest(target, rows)
    return written


@contextmanager
def _filled(folder: Path, files: Sequence[str]) -> Iterator[Path]:
    """Provide a temporary folder; on exit, move the given files from it into ``folder``, created if necessary."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}-") as name:
            yield Path(name)
            for file in files:
                (folder / file).parent.mkdir(parents=True, exist_ok=True)
                (Path(name) / file).replace(folder / file)
    except OSError as error:
        raise ConfigurationError(f"cannot write to {folder}: {error.strerror}", "choose another folder") from error


def _check_empty(folder: Path, force: bool) -> None:
    if folder.exists() and not folder.is_dir():
        raise ConfigurationError(f"{folder} is not a folder", "choose another one")
    if folder.exists() and any(folder.iterdir()) and not force:
        raise ConfigurationError(f"{folder} is not empty", "choose another folder, or pass --force to write into it")


def _check_target(dataset: Dataset, folder: Path, files: set[str], force: bool) -> None:
    sources = {entry.path.resolve().parent for entry in dataset.entries if entry.path}
    if isinstance(dataset, FolderDataset):
        sources.add(dataset.folder.resolve())
    if folder.resolve() in sources:
        raise ConfigurationError(f"{folder} holds the data set itself", "choose another folder")
    _check_empty(folder, force)
    other = sorted(path.name for path in folder.glob("*.cla") if path.name not in files)
    if other:
        raise ConfigurationError(
            f"{folder / other[0]} would classify the exported meshes", "remove it or choose another folder"
        )


def _write(dataset: Dataset, entry: Entry, path: Path) -> ManifestRow:
    mesh = dataset.load(entry)
    write_mesh(path, mesh)
    return ManifestRow(path.name, entry.subject, entry.pose, mesh.n_vertices, mesh.n_faces, file_digest(path))


def _class_names(entries: Sequence[Entry]) -> list[str]:
    poses: dict[str, list[str]] = {}
    for entry in entries:
        poses.setdefault(entry.subject, []).append(entry.pose)
    place: Counter[str] = Counter()
    names = []
    for entry in entries:
        of_class = poses[entry.subject]
        numbered = len(set(of_class)) == len(of_class) and all(re.fullmatch("0|[1-9][0-9]*", pose) for pose in of_class)
        number = entry.pose if numbered else str(place[entry.subject])
        place[entry.subject] += 1
        # Class 'man-1' and number 0 must not be read as class 'man' and number 10.
        stem = f"{entry.subject}{'-' if entry.subject[-1].isdecimal() else ''}{number}"
        if subject_of_stem(stem) != entry.subject or not re.fullmatch(r"[\w][\w .+-]*", stem):
            raise ConfigurationError(
                f"'{entry.subject}' cannot be the class in a file name", "rename the class, or use --layout shrec14"
            )
        names.append(f"{stem}.off")
    twice = [name for name, count in Counter(name.casefold() for name in names).items() if count > 1]
    if twice:
        raise ConfigurationError(
            f"two classes would share the file {twice[0]}", "rename one of the classes, or use --layout shrec14"
        )
    return names


def _check_words(entries: Sequence[Entry]) -> None:
    """Raise ``ConfigurationError`` for names that are invalid in a ``.cla`` file or a manifest."""
    for entry in entries:
        if not re.fullmatch(r"\S+", entry.subject):
            raise ConfigurationError(f"class '{entry.subject}' is not one word", "rename the class")
        if re.search(r"[\t\r\n]", entry.pose):
            raise ConfigurationError(f"pose {entry.pose!r} of '{entry.identifier}' is not one line", "rename the pose")


def _classification(entries: Sequence[Entry]) -> str:
    numbers: dict[str, list[int]] = {}
    for number, entry in enumerate(entries):
        numbers.setdefault(entry.subject, []).append(number)
    blocks = [
        f"\n{subject} 0 {len(members)}\n" + "".join(f"{number}\n" for number in members)
        for subject, members in numbers.items()
    ]
    return f"PSB 1\n{len(numbers)} {len(entries)}\n" + "".join(blocks)


def _settings(dataset: Dataset) -> str:
    """Return the ``dataset.toml`` that reproduces the depth images and canonical poses of the data set."""
    lines = [f"# Written from the data set {_quoted(dataset.name)}."]
    if dataset.stand_in_for:
        lines.append(f"stand_in_for = {_quoted(dataset.stand_in_for)}")
    if dataset.half_width is not None:
        lines.append(f"half_width = {float(dataset.half_width)!r}")
    cameras = _cameras(dataset)
    views = {subject: _view(camera) for subject, camera in cameras.items()}
    if len(set(views.values())) == 1:
        lines.append(f"camera = {next(iter(views.values()))}")
        views = {}
    first: dict[str, str] = {}
    for entry in dataset.entries:
        first.setdefault(entry.subject, entry.pose)
    canonical = {subject: canonical_entry(dataset, subject).pose for subject in first}
    poses = {subject: _quoted(pose) for subject, pose in canonical.items() if pose != first[subject]}
    return "\n".join(lines) + "\n" + _table("camera", views) + _table("canonical_pose", poses)


def _cameras(dataset: Dataset) -> dict[str, Camera]:
    cameras: dict[str, Camera] = {}
    for entry in dataset.entries:
        camera = dataset.camera(entry)
        if cameras.setdefault(entry.subject, camera) != camera:
            raise DatasetError(
                f"the shapes of class '{entry.subject}' have different cameras, which {SETTINGS_FILE} cannot say",
                "give every shape of a class the same camera",
            )
    return cameras


def _view(camera: Camera) -> str:
    for name, view in VIEWS.items():
        if view == camera:
            return _quoted(name)
    return f"{{ direction = {list(camera.direction)}, up = {list(camera.up)} }}"


def _table(name: str, values: Mapping[str, str]) -> str:
    if not values:
        return ""
    return f"\n[{name}]\n" + "".join(f"{_quoted(key)} = {value}\n" for key, value in values.items())


def _quoted(text: str) -> str:
    # A JSON string is a TOML basic string.
    return json.dumps(text, ensure_ascii=False)
