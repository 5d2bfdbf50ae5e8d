"""Folders of meshes or depth images: classes from a PSB ``.cla`` file, sub-folders, or file names."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

from benchmark.datasets.base import Entry, natural_key, printable
from benchmark.datasets.depth_folder import DepthFolder, with_depth_settings
from benchmark.datasets.files import FolderDataset, text_of
from benchmark.datasets.settings import SETTINGS_FILE, with_settings
from benchmark.depth.reading import MASK_FOLDERS, is_depth_file
from benchmark.errors import DatasetError

#: Extensions in order of preference if a shape exists in several formats.
EXTENSIONS = (".off", ".obj", ".ply", ".stl", ".mat", ".vert")

#: Extensions of unsupported meshes and point clouds, which are reported as skipped.
UNREAD = frozenset({".3ds", ".3mf", ".dae", ".fbx", ".glb", ".gltf", ".pcd", ".pts", ".vtk", ".vtp", ".wrl", ".xyz"})


def folder_dataset(folder: Path) -> FolderDataset:
    """Read the list of shapes of a folder.

    Classes come from the first available source: a ``.cla`` file, the names
    of mesh files in the folder without trailing number (``cat10.off`` has class ``cat``), or sub-folders. A
    ``dataset.toml`` sets canonical poses and cameras, see :func:`~benchmark.datasets.settings.with_settings`. A folder
    without meshes may contain depth images, classified by sub-folder or file name, see :func:`depth_files`.

    Parameters
    ----------
    folder
        The folder; its name becomes the name of the data set.

    Raises
    ------
    DatasetError
        If the folder is unreadable or contains no shapes, or if its ``.cla`` file is invalid.
    ConfigurationError
        If ``dataset.toml`` has an unknown key.
    """
    files = mesh_files(folder)
    cla = cla_file(folder)
    if cla:
        entries = _from_cla(cla, files)
    elif files:
        entries = _from_names(files)
    else:
        entries = [entry for sub in sub_folders(folder) for entry in _from_sub_folder(sub, mesh_files(sub))]
    depth_entries = [] if entries else _from_depth_images(folder)
    if not entries and not depth_entries:
        unread = ", ".join(sorted({path.suffix for path in unread_files(folder)}))
        raise DatasetError(
            f"no meshes in {folder}{f' that can be read: {unread} cannot' if unread else ''}",
            f"expected files ending in {', '.join(EXTENSIONS)}, depth images of 16 bits, or sub-folders of such files",
        )
    entries = entries or depth_entries
    twice = [name for name, count in Counter(entry.identifier for entry in entries).items() if count > 1]
    if twice:
        raise DatasetError(f"{folder} holds two shapes that are both written '{twice[0]}'", "rename one of them")
    name = printable(folder.resolve().name)
    if depth_entries:
        images = DepthFolder(name=name, title=name, entries=tuple(entries), folder=folder)
        return with_depth_settings(images, folder / SETTINGS_FILE)
    return with_settings(FolderDataset(name=name, title=name, entries=tuple(entries), folder=folder))


def depth_files(folder: Path) -> list[Path]:
    """Return the depth images of a folder in natural order: 16 bits or more, floats or arrays; no colours or masks.

    Raises
    ------
    DatasetError
        If the folder does not exist or cannot be listed.
    """
    files = _listed(folder, lambda path: path.is_file() and is_depth_file(path))
    return sorted(files, key=lambda path: natural_key(path.name))


def _from_depth_images(folder: Path) -> list[Entry]:
    if flat := depth_files(folder):
        return _from_names(flat)
    entries: list[Entry] = []
    for sub in sub_folders(folder):
        if sub.name not in MASK_FOLDERS:
            inner = sub / "depth"
            entries += _from_sub_folder(sub, depth_files(sub) or (depth_files(inner) if inner.is_dir() else []))
    return entries


def _from_names(files: Iterable[Path]) -> list[Entry]:
    stems = [(printable(path.stem), path) for path in files]
    return [Entry(stem, subject_of_stem(stem), _pose_of_stem(stem), path) for stem, path in stems]


def _from_sub_folder(folder: Path, files: Iterable[Path]) -> list[Entry]:
    subject = printable(folder.name)
    return [Entry(printable(f"{folder.name}/{path.stem}"), subject, printable(path.stem), path) for path in files]


def _listed(folder: Path, is_wanted: Callable[[Path], bool]) -> list[Path]:
    """Return paths in a folder, sorted by name; raises ``DatasetError`` if it cannot be listed."""
    try:
        return [path for path in sorted(folder.iterdir()) if is_wanted(path)]
    except OSError as error:
        raise DatasetError(f"cannot list {folder}: {error.strerror}", "check the path and its rights") from error


def sub_folders(folder: Path) -> list[Path]:
    """Return visible sub-folders in natural order; raises ``DatasetError`` if the folder cannot be listed."""
    folders = _listed(folder, lambda path: path.is_dir() and not path.name.startswith("."))
    return sorted(folders, key=lambda path: natural_key(path.name))


def unread_files(folder: Path) -> list[Path]:
    """Return meshes and point clouds in unsupported formats in a folder and its sub-folders."""
    places = (folder, *sub_folders(folder))
    return [path for place in places for path in _listed(place, lambda path: path.suffix.lower() in UNREAD)]


def mesh_files(folder: Path) -> list[Path]:
    """Return the mesh files of a folder in natural order, one per stem.

    Raises
    ------
    DatasetError
        If the folder does not exist or cannot be listed.
    """
    by_stem: dict[str, Path] = {}
    for path in all_mesh_files(folder):
        by_stem.setdefault(path.stem, path)
    return sorted(by_stem.values(), key=lambda path: natural_key(path.stem))


def all_mesh_files(folder: Path) -> list[Path]:
    """Return all mesh files of a folder, preferred extensions first, including several per stem.

    Broken links are included, so that missing shapes are reported.

    Raises
    ------
    DatasetError
        If the folder does not exist or cannot be listed.
    """

    def is_mesh(path: Path) -> bool:
        return path.suffix.lower() in EXTENSIONS and (path.is_file() or (path.is_symlink() and not path.exists()))

    return sorted(_listed(folder, is_mesh), key=lambda path: EXTENSIONS.index(path.suffix.lower()))


def cla_file(folder: Path) -> Path | None:
    """Return the ``.cla`` file of a folder, or None; raises ``DatasetError`` if there are several."""
    files = sorted(folder.glob("*.cla"))
    if len(files) > 1:
        raise DatasetError(f"{folder} holds {len(files)} .cla files", "keep the one that classifies these meshes")
    return files[0] if files else None


def read_cla(path: Path) -> dict[int, str]:
    """Read a classification file of the Princeton Shape Benchmark.

    Parameters
    ----------
    path
        Text: ``PSB 1``; ``<classes> <models>``; per class ``<name> <parent> <count>`` and ``count`` model numbers.

    Returns
    -------
    dict
        Class name of each model number (0-based, as in the file names), in file order.

    Raises
    ------
    DatasetError
        If the header, a count or a number is wrong; the message names the file.
    """
    words = text_of(path).split()
    if words[:2] != ["PSB", "1"]:
        raise DatasetError(
            f"{path} does not start with 'PSB 1'", "use the classification format of the Princeton Shape Benchmark"
        )
    try:
        n_classes, n_models = _whole(words[2]), _whole(words[3])
        subjects: dict[int, str] = {}
        position, classes = 4, 0
        while position < len(words):
            name, count = printable(words[position]), _whole(words[position + 2])
            numbers = [_whole(word) for word in words[position + 3 : position + 3 + count]]
            if len(numbers) != count:
                raise DatasetError(
                    f"{path}: class '{name}' announces {count} models but lists {len(numbers)}", "complete the file"
                )
            for number in numbers:
                if number in subjects:
                    raise DatasetError(f"{path}: model {number} stands in two classes", "list each model once")
                subjects[number] = name
            classes += 1
            position += 3 + count
    except (IndexError, ValueError) as error:
        raise DatasetError(
            f"{path}: {error}", "expected '<name> <parent> <count>' followed by that many model numbers"
        ) from error
    if (classes, len(subjects)) != (n_classes, n_models):
        raise DatasetError(
            f"{path} announces {n_classes} classes and {n_models} models but lists {classes} and {len(subjects)}",
            "correct the second line or complete the lists",
        )
    return subjects


def _whole(word: str) -> int:
    if not re.fullmatch("[0-9]{1,18}", word):
        raise ValueError(f"{word[:80]!r} is not a whole number")
    return int(word)


def subject_of_stem(stem: str) -> str:
    """Return the class in a file name: the stem without trailing number."""
    return re.sub(r"[-_ ]*[0-9]+$", "", stem) or stem


def _pose_of_stem(stem: str) -> str:
    return stem[len(subject_of_stem(stem)) :].lstrip("-_ ")


def _from_cla(cla: Path, files: Iterable[Path]) -> list[Entry]:
    by_number: dict[int, list[Path]] = {}
    for path in files:
        match = re.search(r"[0-9]+\Z", path.stem)
        if match:
            by_number.setdefault(int(match.group()), []).append(path)
    subjects = read_cla(cla)
    missing = sorted(set(subjects) - set(by_number))
    if missing:
        from_one = {number - 1 for number in subjects} == set(by_number)
        raise DatasetError(
            f"{cla} lists model {missing[0]}, but {cla.parent} has no mesh with that number",
            "the list counts from 1, the meshes from 0: subtract 1 from each number"
            if from_one
            else "add the mesh or correct the list",
        )
    entries = []
    for number, subject in sorted(subjects.items()):
        path, *others = by_number[number]
        if others:
            raise DatasetError(
                f"{cla} lists model {number}, which may be {path.name} or {others[0].name}", "keep one of them"
            )
        _inside(cla.parent, path.name, cla)
        stem = printable(path.stem)
        entries.append(Entry(stem, subject, stem, path))
    return entries


def _inside(folder: Path, name: str, source: Path) -> Path:
    """Return the path of a listed file, which must be inside the folder after resolving links.

    Parameters
    ----------
    folder
        The folder of the data set.
    name
        Path relative to the folder.
    source
        The list, for the error message.

    Raises
    ------
    DatasetError
        If the path is invalid or outside the folder.
    """
    path = folder / name
    try:
        is_inside = path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError) as error:  # NUL, name too long, circular links
        raise DatasetError(f"{source} names {name[:80]!r}, which is no path: {error}", "correct the name") from error
    if not is_inside:
        raise DatasetError(
            f"{source} names '{name}', which lies outside its folder", "copy the mesh into the folder and name it there"
        )
    return path
