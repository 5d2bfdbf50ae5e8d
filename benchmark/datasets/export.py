"""Export of data sets to mesh files that reproduce the same shapes when read."""

from __future__ import annotations

import json
import re
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.base import Watched, canonical_shapes
from benchmark.datasets.mesh_files import write_mesh
from benchmark.datasets.settings import SETTINGS_FILE
from benchmark.errors import ConfigurationError, DatasetError, ShapeError
from benchmark.geometry.camera import Camera

#: Writes further files into the folder of a set, given the shape in each file; returns their names.
Describe = Callable[[Path, Mapping[str, Entry]], Sequence[str]]


def write_meshes(
    dataset: ShapeSet, folder: Path, *, watched: Watched = iter, describe: Describe | None = None
) -> tuple[tuple[str, ...], list[str]]:
    """Write a data set as a folder of meshes that can be opened as a data set again.

    Shapes become files ``CLASS/POSE.off`` with exact coordinates; ``dataset.toml`` holds their
    cameras and canonical poses. If writing fails, no folder remains.

    Parameters
    ----------
    dataset
        The data set.
    folder
        Target folder, new or empty.
    watched
        Progress wrapper; see :data:`~benchmark.datasets.base.Watched`.
    describe
        Writes further files, which describe the set, into the folder, and returns their names.

    Returns
    -------
    files : tuple of str
        Names of the files, meshes first, relative to the folder.
    problems : list of str
        A line for each shape that cannot be read and is left out.

    Raises
    ------
    ConfigurationError
        If the folder is nonempty or cannot be written, a class or pose cannot be the name of a
        file, or the data set has depth noise.
    DatasetError
        If no mesh is readable.
    """
    if any(dataset.sensor(entry) for entry in dataset.shapes):
        problem = "meshes have no depth noise"
        raise ConfigurationError(problem, "export the set without it, and name it in a run")
    names = _file_names(dataset.shapes)
    try:
        is_taken = folder.is_symlink() or (folder.exists() and not folder.is_dir())
        if is_taken or (folder.exists() and any(folder.iterdir())):
            raise ConfigurationError(f"{folder} is not an empty folder", "choose a new one")
        if dataset.folder and folder.resolve().is_relative_to(dataset.folder.resolve()):
            problem = f"{folder} lies in the data set, whose shapes it would join"
            raise ConfigurationError(problem, "choose a folder outside of it")
        folder.parent.mkdir(parents=True, exist_ok=True)
        # A folder beside the target takes its name when all files are written.
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}-") as name:
            target = Path(name) / "set"
            written, problems = _write_meshes(dataset, names, target, watched)
            (target / SETTINGS_FILE).write_bytes(_settings(dataset, written).encode())
            further = describe(target, written) if describe else ()
            target.replace(folder)
    except OSError as error:
        problem = f"cannot write to {folder}: {error.strerror}"
        raise ConfigurationError(problem, "choose another folder") from error
    return (*written, SETTINGS_FILE, *further), problems


def _write_meshes(
    dataset: ShapeSet, names: Mapping[str, str], target: Path, watched: Watched
) -> tuple[dict[str, Entry], list[str]]:
    """Write the meshes of a data set below a folder.

    Parameters
    ----------
    dataset
        The data set.
    names
        File of each shape by its identifier, relative to the folder.
    target
        The folder.
    watched
        Progress wrapper around the shapes.

    Returns
    -------
    written : dict of str to Entry
        The shape in each file.
    problems : list of str
        A line for each shape that cannot be read.

    Raises
    ------
    DatasetError
        If no shape can be read.
    """
    written: dict[str, Entry] = {}
    problems: list[str] = []
    for entry in watched(dataset.shapes):
        file = names[entry.identifier]
        (target / file).parent.mkdir(parents=True, exist_ok=True)
        try:
            write_mesh(target / file, dataset.load(entry))
            written[file] = entry
        except ShapeError as error:
            problems.append(f"{entry.identifier}: {error}")
    if not written:
        problem = f"no mesh of '{dataset.name}' is readable: {problems[0]}"
        raise DatasetError(problem, "correct the files")
    return written, problems


def _file_names(entries: Sequence[Entry]) -> dict[str, str]:
    """Return the name of the file of each shape, ``CLASS/POSE.off``, by its identifier.

    The number of the shape is added to a pose that has no name, or that its class has twice.

    Raises
    ------
    ConfigurationError
        If a class or pose cannot be the name of a file.
    """
    counts = Counter((entry.subject, entry.pose.casefold()) for entry in entries)
    taken = {place for place, count in counts.items() if count == 1}
    names = {}
    for number, entry in enumerate(entries):
        pose = entry.pose
        is_unique = counts[entry.subject, pose.casefold()] == 1
        if not pose or not is_unique:
            pose = f"{pose or 'pose'}-{number}"
            while (entry.subject, pose.casefold()) in taken:  # as another pose has that name
                pose = f"{pose}-{number}"
            taken.add((entry.subject, pose.casefold()))
        for word in (entry.subject, pose):
            if not re.fullmatch(r"\w[\w .+-]*", word):
                problem = f"{word!r} of '{entry.identifier}' cannot be the name of a file"
                raise ConfigurationError(problem, "rename it")
        names[entry.identifier] = f"{entry.subject}/{pose}.off"
    return names


def _settings(dataset: ShapeSet, written: Mapping[str, Entry]) -> str:
    """Return the text of a ``dataset.toml`` that reproduces the cameras and poses of a data set.

    Parameters
    ----------
    dataset
        The data set.
    written
        The shape in each file.
    """
    lines = [f"# Written from the data set {_quoted(dataset.name)}."]
    if dataset.stand_in_for:
        lines.append(f"stand_in_for = {_quoted(dataset.stand_in_for)}")
    if dataset.half_width is not None:
        lines.append(f"half_width = {float(dataset.half_width)!r}")
    lines += ["", "[canonical_pose]"]
    # Of the shapes that are written only: one that could not be read has no file.
    canonical = canonical_shapes(replace(dataset, shapes=tuple(written.values()))).values()
    for file, entry in written.items():
        if entry in canonical:
            subject, pose = file.removesuffix(".off").split("/")
            lines.append(f"{_quoted(subject)} = {_quoted(pose)}")
    lines += ["", "[camera]"]
    for file, entry in written.items():
        camera = _view(dataset.camera(entry))
        lines.append(f"{_quoted(file.removesuffix('.off'))} = {camera}")
    return "\n".join([*lines, ""])


def _view(camera: Camera) -> str:
    """Return a camera as a TOML table."""
    return f"{{ direction = {list(camera.direction)}, up = {list(camera.up)} }}"


def _quoted(text: str) -> str:
    """Return text as a TOML basic string, which a JSON string is."""
    return json.dumps(text, ensure_ascii=False)
