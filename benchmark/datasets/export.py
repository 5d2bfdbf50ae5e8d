"""Export of data sets to mesh files that reproduce the same shapes when read."""

from __future__ import annotations

import json
import re
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.base import Watched, by_subject, canonical_shapes, natural_key
from benchmark.datasets.settings import SETTINGS_FILE, VIEWS
from benchmark.errors import ConfigurationError, DatasetError, ShapeError
from benchmark.geometry.camera import Camera
from benchmark.geometry.io import write_mesh


def export(
    dataset: ShapeSet, folder: Path, *, force: bool = False, watched: Watched = iter
) -> tuple[tuple[str, ...], list[str]]:
    """Write the readable shapes as ``CLASS/POSE.off``; cameras and canonical poses in ``dataset.toml``.

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
    tuple of str, list of str
        Names of the files, meshes first; and a line for each shape that cannot be read and is left out.

    Raises
    ------
    ConfigurationError
        If the folder is nonempty or contains the data set itself, a class or pose cannot be the name of a file, or the
        data set has depth noise.
    DatasetError
        If no mesh is readable.
    """
    names = _file_names(dataset.shapes)
    _check_target(dataset, folder, force)
    written, problems = list[str](), list[str]()
    with _filled(folder, written) as target:
        for entry in watched(dataset.shapes):
            path = target / names[entry.identifier]
            path.parent.mkdir(exist_ok=True)
            try:
                write_mesh(path, dataset.load(entry))
                written.append(names[entry.identifier])
            except ShapeError as error:
                problems.append(f"{entry.identifier}: {error}")
        if not written:
            raise DatasetError(f"no mesh of '{dataset.name}' is readable: {problems[0]}", "correct the files")
        readable = [entry for entry in dataset.shapes if names[entry.identifier] in written]
        settings = _settings(replace(dataset, shapes=tuple(readable)), names)
        (target / SETTINGS_FILE).write_bytes(settings.encode())
        written.append(SETTINGS_FILE)
    return tuple(written), problems


def _file_names(entries: Sequence[Entry]) -> dict[str, str]:
    """Return the file of each shape; a pose that several shapes of a class have is numbered."""
    counts = Counter((entry.subject, entry.pose.casefold()) for entry in entries)
    names = {}
    for number, entry in enumerate(entries):
        is_single = entry.pose and counts[entry.subject, entry.pose.casefold()] == 1
        pose = entry.pose if is_single else f"{entry.pose or 'pose'}-{number}"
        for word in (entry.subject, pose):
            if not re.fullmatch(r"\w[\w .+-]*", word):
                raise ConfigurationError(f"{word!r} of '{entry.identifier}' cannot be the name of a file", "rename it")
        names[entry.identifier] = f"{entry.subject}/{pose}.off"
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
    target = folder.resolve()
    sources = {entry.path.resolve().parent for entry in dataset.shapes if entry.path}
    sources |= {dataset.folder.resolve()} if dataset.folder else set()
    if any(target == source or target.is_relative_to(source) for source in sources):
        raise ConfigurationError(f"{folder} holds the data set itself", "choose another folder")
    if any(dataset.sensor(entry) for entry in dataset.shapes):
        raise ConfigurationError("meshes have no depth noise", "export the set without it, and name it in a run")
    if folder.exists() and not folder.is_dir():
        raise ConfigurationError(f"{folder} is not a folder", "choose another one")
    if folder.exists() and any(folder.iterdir()) and not force:
        raise ConfigurationError(f"{folder} is not empty", "choose another folder, or pass --force to write into it")


def _settings(dataset: ShapeSet, files: Mapping[str, str]) -> str:
    """Return the ``dataset.toml`` that reproduces the depth images and canonical poses of the data set."""
    names = {identifier: file.removesuffix(".off") for identifier, file in files.items()}
    lines = [f"# Written from the data set {_quoted(dataset.name)}."]
    if dataset.stand_in_for:
        lines.append(f"stand_in_for = {_quoted(dataset.stand_in_for)}")
    if dataset.half_width is not None:
        lines.append(f"half_width = {float(dataset.half_width)!r}")
    views: dict[str, str] = {}
    members_of = by_subject(dataset.shapes)
    for subject, members in members_of.items():
        of_shapes = {names[entry.identifier]: _view(dataset.camera(entry)) for entry in members}
        first = next(iter(of_shapes.values()))
        views |= {subject: first} if set(of_shapes.values()) == {first} else of_shapes
    if len(set(views.values())) == 1:
        lines.append(f"camera = {next(iter(views.values()))}")
        views = {}
    # In a folder, the first file in natural order is the canonical pose.
    poses = {
        subject: _quoted(names[entry.identifier].partition("/")[2])
        for subject, entry in canonical_shapes(dataset).items()
        if names[entry.identifier] != min((names[member.identifier] for member in members_of[subject]), key=natural_key)
    }
    return "\n".join(lines) + "\n" + _table("camera", views) + _table("canonical_pose", poses)


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
