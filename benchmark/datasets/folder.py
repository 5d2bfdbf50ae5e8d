"""Any folder of meshes: classes from sub-folders, from a PSB ``.cla`` file, or from the file names."""

from __future__ import annotations

import re
from pathlib import Path

from benchmark.datasets.base import Entry, FileDataset, natural_key
from benchmark.errors import DatasetError

#: Extensions in order of preference when one shape is there in several formats.
EXTENSIONS = (".off", ".obj", ".ply", ".stl", ".mat", ".vert")


def folder_dataset(folder: Path) -> FileDataset:
    """Read the list of shapes of a folder.

    The class of a shape is, in this order: what a ``.cla`` file in the folder says; the sub-folder that it lies in; the
    file name without its trailing number (``cat10.off`` is of class ``cat``).

    Parameters
    ----------
    folder
        The folder; its name becomes the name of the data set.

    Raises
    ------
    DatasetError
        If the folder cannot be read, holds no meshes, or its ``.cla`` file is wrong.
    """
    cla = sorted(folder.glob("*.cla")) if folder.is_dir() else []
    if len(cla) > 1:
        raise DatasetError(f"{folder} holds {len(cla)} .cla files", "keep the one that classifies these meshes")
    files = mesh_files(folder)
    if cla:
        entries = _from_cla(cla[0], files)
    elif files:
        entries = [_from_stem(path) for path in files]
    else:
        entries = [
            Entry(f"{sub.name}/{path.stem}", sub.name, path.stem, path)
            for sub in sorted(folder.iterdir(), key=lambda path: natural_key(path.name))
            if sub.is_dir() and not sub.name.startswith(".")
            for path in mesh_files(sub)
        ]
    if not entries:
        raise DatasetError(
            f"no meshes in {folder}", f"expected files ending in {', '.join(EXTENSIONS)}, or sub-folders of such files"
        )
    return FileDataset(name=folder.resolve().name, title=folder.resolve().name, entries=tuple(entries))


def mesh_files(folder: Path) -> list[Path]:
    """Mesh files of one folder in natural order, one per stem.

    Raises
    ------
    DatasetError
        If the folder does not exist or cannot be listed.
    """
    try:
        found = [path for path in folder.iterdir() if path.suffix.lower() in EXTENSIONS and path.is_file()]
    except OSError as error:
        raise DatasetError(f"cannot list {folder}: {error.strerror}", "check the path and its rights") from error
    by_stem: dict[str, Path] = {}
    for path in sorted(found, key=lambda path: EXTENSIONS.index(path.suffix.lower())):
        by_stem.setdefault(path.stem, path)
    return sorted(by_stem.values(), key=lambda path: natural_key(path.stem))


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
        If the header, a count or a number is wrong, naming the file.
    """
    try:
        words = path.read_text(encoding="utf-8").split()
    except (OSError, UnicodeDecodeError) as error:
        raise DatasetError(f"cannot read {path}: {error}", "check the file and its rights") from error
    if words[:2] != ["PSB", "1"]:
        raise DatasetError(
            f"{path} does not start with 'PSB 1'", "use the classification format of the Princeton Shape Benchmark"
        )
    try:
        n_classes, n_models = int(words[2]), int(words[3])
        subjects: dict[int, str] = {}
        position, classes = 4, 0
        while position < len(words):
            name, count = words[position], int(words[position + 2])
            numbers = [int(word) for word in words[position + 3 : position + 3 + count]]
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


def _from_cla(cla: Path, files: list[Path]) -> list[Entry]:
    by_number = {}
    for path in files:
        match = re.search(r"\d+$", path.stem)
        if match:
            by_number[int(match.group())] = path
    entries = []
    for number, subject in read_cla(cla).items():
        if number not in by_number:
            raise DatasetError(
                f"{cla} lists model {number}, but {cla.parent} has no mesh with that number",
                "add the mesh or correct the list",
            )
        path = by_number[number]
        entries.append(Entry(path.stem, subject, path.stem, path))
    return entries


def _from_stem(path: Path) -> Entry:
    subject = re.sub(r"[-_ ]*\d+$", "", path.stem)
    return Entry(path.stem, subject or path.stem, path.stem[len(subject) :].lstrip("-_ "), path)
