"""Export of data sets to mesh files that reproduce the same shapes when read."""

from __future__ import annotations

import json
import re
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.base import Watched, canonical_shapes
from benchmark.datasets.settings import SETTINGS_FILE, VIEWS
from benchmark.errors import ConfigurationError, DatasetError
from benchmark.geometry.camera import Camera
from benchmark.geometry.io import write_mesh


def export(dataset: ShapeSet, folder: Path, *, force: bool = False, watched: Watched = iter) -> tuple[str, ...]:
    """Write all shapes of a data set as ``CLASS/POSE.off``, with cameras and canonical poses in ``dataset.toml``.

    Coordinates are exact. Files are written to a temporary sibling folder and moved at the end, so a failure while
    writing leaves the folder unchanged.

    Parameters
    ----------
    dataset
        The data set.
    folder
        Target folder, created if necessary.
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
        If the folder is nonempty or contains the data set itself, or a class or pose cannot be the name of a file.
    DatasetError
        If the shapes of a class have different cameras.
    ShapeError
        If a mesh is unreadable.
    """
    names = _file_names(dataset.shapes)
    settings = _settings(dataset)
    _check_target(dataset, folder, force)
    written = (*names, SETTINGS_FILE)
    with _filled(folder, written) as target:
        for entry, file in zip(watched(dataset.shapes), names, strict=True):
            (target / file).parent.mkdir(exist_ok=True)
            write_mesh(target / file, dataset.load(entry))
        (target / SETTINGS_FILE).write_bytes(settings.encode())
    return written


def _file_names(entries: Sequence[Entry]) -> list[str]:
    """Return the file of each shape; a pose that several shapes of a class have is numbered."""
    counts = Counter((entry.subject, entry.pose.casefold()) for entry in entries)
    names = []
    for number, entry in enumerate(entries):
        is_single = entry.pose and counts[entry.subject, entry.pose.casefold()] == 1
        pose = entry.pose if is_single else f"{entry.pose or 'pose'}-{number}"
        for word in (entry.subject, pose):
            if not re.fullmatch(r"\w[\w .+-]*", word):
                raise ConfigurationError(f"{word!r} of '{entry.identifier}' cannot be the name of a file", "rename it")
        names.append(f"{entry.subject}/{pose}.off")
    return names


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


def _check_target(dataset: ShapeSet, folder: Path, force: bool) -> None:
    sources = {entry.path.resolve().parent for entry in dataset.shapes if entry.path}
    if dataset.folder:
        sources.add(dataset.folder.resolve())
    if folder.resolve() in sources:
        raise ConfigurationError(f"{folder} holds the data set itself", "choose another folder")
    if folder.exists() and not folder.is_dir():
        raise ConfigurationError(f"{folder} is not a folder", "choose another one")
    if folder.exists() and any(folder.iterdir()) and not force:
        raise ConfigurationError(f"{folder} is not empty", "choose another folder, or pass --force to write into it")


def _settings(dataset: ShapeSet) -> str:
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
    for entry in dataset.shapes:
        first.setdefault(entry.subject, entry.pose)
    canonical = {subject: entry.pose for subject, entry in canonical_shapes(dataset).items()}
    poses = {subject: _quoted(pose) for subject, pose in canonical.items() if pose != first[subject]}
    return "\n".join(lines) + "\n" + _table("camera", views) + _table("canonical_pose", poses)


def _cameras(dataset: ShapeSet) -> dict[str, Camera]:
    cameras: dict[str, Camera] = {}
    for entry in dataset.shapes:
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
