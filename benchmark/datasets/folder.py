"""Folders of meshes or depth images, with classes from lists, file names or sub-folders."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.base import natural_key
from benchmark.datasets.frames import depth_frame_set
from benchmark.datasets.labels import class_name, read_labels
from benchmark.datasets.mesh_files import (
    COMPANIONS,
    MESHES,
    READABLE,
    mesh_file_set,
    mesh_stem,
    mesh_suffix,
)
from benchmark.datasets.settings import SETTINGS_FILE, with_settings
from benchmark.depth.intrinsics import CAMERA_FILES
from benchmark.depth.reading import ARRAYS, EXTENSIONS, MASK_FOLDERS, is_depth_file
from benchmark.errors import DatasetError
from benchmark.files import LARGEST_LIST, decode, named_errors, read_file
from benchmark.text import listed, printable

#: Extensions of textures, settings and texts that users keep beside meshes and images.
_ACCESSORIES = (
    ".jpg",
    ".jpeg",
    ".bmp",
    ".tga",
    ".json",
    ".yaml",
    ".yml",
    ".md",
    ".pdf",
    ".html",
)

#: Extensions of all files that a data set reads, or leaves out without a word.
_KNOWN_EXTENSIONS = frozenset({*MESHES, *COMPANIONS, *EXTENSIONS, *_ACCESSORIES})

#: Names of lists of classes of the Princeton Shape Benchmark.
_CLA = re.compile(r".*\.cla", re.IGNORECASE)

#: The same, and names of files of labels, which the folder of a user may have; those that are no
#: text with lines ``name label`` are refused, as classes would come from elsewhere in silence.
_LISTS = re.compile(
    r".*\.cla|labels\.(txt|csv|tsv|json|ya?ml|xml|xlsx?|ods|npy|npz|mat|pkl)", re.IGNORECASE
)


def folder_set(folder: Path, name: str = "") -> ShapeSet:
    """Open a folder of meshes or of depth images as a data set.

    The class of a shape comes from the first of these that the folder has:

    - ``labels.txt`` or ``labels.csv``, with the label of each shape;
    - a ``.cla`` file of the Princeton Shape Benchmark;
    - names of files in the folder without their number: ``cat10.off`` has class ``cat``;
    - sub-folders, of which each is a class.

    A ``dataset.toml`` sets canonical poses, cameras and units. Depth images are looked for in a
    folder without meshes.

    Parameters
    ----------
    folder
        The folder.
    name
        Name of the data set; by default that of the folder.

    Raises
    ------
    DatasetError
        If the folder is unreadable or contains no shapes, or if a list of classes is invalid.
    ConfigurationError
        If ``dataset.toml`` has an unknown key.
    """
    name = name or printable(folder.resolve().name)
    classes = class_list([folder], _LISTS)
    is_cla = classes is not None and classes.suffix.lower() == ".cla"
    shapes = list(_from_cla(classes, mesh_files(folder))) if classes and is_cla else _meshes(folder)
    are_depth_images = not shapes
    if are_depth_images:
        shapes = _depth_images(folder)
    if not shapes:
        raise _no_shapes(folder)
    if classes and not is_cla:
        shapes = _labelled(classes, shapes)

    counts = Counter(entry.identifier for entry in shapes)
    for identifier, count in counts.items():
        if count > 1:
            problem = f"{folder} holds two shapes that are both written '{identifier}'"
            raise DatasetError(problem, "rename one of them")
    if are_depth_images:
        return depth_frame_set(name, folder, tuple(shapes))
    return with_settings(mesh_file_set(name=name, shapes=tuple(shapes), folder=folder))


def _meshes(folder: Path) -> list[Entry]:
    """Return the meshes of a folder, or those of its sub-folders if it has none itself."""
    files = mesh_files(folder)
    if files:
        return [*_from_names(files)]
    entries: list[Entry] = []
    for sub in sub_folders(folder):
        entries += _from_sub_folder(sub, mesh_files(sub))
    return entries


def _no_shapes(folder: Path) -> DatasetError:
    """Return the error for a folder without shapes."""
    problem = f"no meshes in {folder}"
    skipped = skipped_files(folder)
    hidden = [path.name for path in skipped if is_hidden(path)]
    unread = sorted({path.suffix for path in skipped if path.suffix and not is_hidden(path)})
    if hidden:
        problem = f"{problem} but hidden ones, {listed(hidden)}"
    elif unread:
        problem = f"{problem} that can be read: {', '.join(unread)} cannot"
    hint = (
        f"expected files ending in {', '.join(READABLE)}, depth images of 16 bits, "
        "or sub-folders of such files"
    )
    return DatasetError(problem, hint)


def depth_files(folder: Path) -> list[Path]:
    """Return the depth images of a folder in natural order.

    They have 16 bits or more, floats or arrays; colours and masks are none.
    """
    return _visible_paths(folder, lambda path: not path.is_dir() and is_depth_file(path))


def pictures(folder: Path) -> list[Path]:
    """Return the files of a folder with an extension of depth images, arrays excepted."""
    extensions = set(EXTENSIONS) - set(ARRAYS)
    return _visible_paths(
        folder, lambda path: path.suffix.lower() in extensions and not path.is_dir()
    )


def mesh_files(folder: Path) -> list[Path]:
    """Return the mesh files of a folder in natural order, one per stem.

    Raises
    ------
    DatasetError
        If the folder is unreadable.
    """
    by_stem: dict[str, Path] = {}
    for path in all_mesh_files(folder):
        by_stem.setdefault(mesh_stem(path), path)
    return sorted(by_stem.values(), key=lambda path: natural_key(mesh_stem(path)))


def all_mesh_files(folder: Path) -> list[Path]:
    """Return all mesh files of a folder, preferred extensions first, including several per stem.

    Unsupported formats, broken links, pipes and devices are included, so that they are reported and
    counted.
    """

    def is_mesh(path: Path) -> bool:
        return mesh_suffix(path) in MESHES and not path.is_dir()

    paths = _visible_paths(folder, is_mesh)
    return sorted(paths, key=lambda path: MESHES.index(mesh_suffix(path)))


def sub_folders(folder: Path) -> list[Path]:
    """Return visible sub-folders in natural order; raise ``DatasetError`` if there is no list."""
    return _visible_paths(folder, Path.is_dir)


def skipped_files(folder: Path) -> list[Path]:
    """Return the files of a data set that are ignored, so that a report can name them.

    The visible files of unknown kinds come first. They are followed by hidden files of known kinds,
    such as ``.cat.off``, which are probably meant as shapes. Other hidden files are left out.

    Parameters
    ----------
    folder
        Folder of the data set, whose sub-folders are searched, too.

    Raises
    ------
    DatasetError
        If a folder cannot be listed.
    """
    unknown: list[Path] = []
    hidden: list[Path] = []
    for place in (folder, *sub_folders(folder)):
        unknown += _visible_paths(place, lambda path: _is_of_unknown_kind(path, folder))
        hidden += [
            path for path in sorted(place.glob(".*")) if mesh_suffix(path) in _KNOWN_EXTENSIONS
        ]
    return unknown + hidden


def _is_of_unknown_kind(path: Path, folder: Path) -> bool:
    """Return whether a path is a file that a data set neither reads nor expects.

    Parameters
    ----------
    path
        A path in the folder of the data set or in one of its sub-folders.
    folder
        Folder of the data set.
    """
    if path.is_dir() or mesh_suffix(path) in _KNOWN_EXTENSIONS:
        return False
    if CAMERA_FILES.fullmatch(path.name):
        return False
    if path.parent != folder:
        return True  # settings and lists of classes are read from the folder itself alone
    return path.name != SETTINGS_FILE and not _LISTS.fullmatch(path.name)


def _visible_paths(folder: Path, is_wanted: Callable[[Path], bool]) -> list[Path]:
    """Return the paths in a folder that are wanted and not hidden, in natural order.

    Raises
    ------
    DatasetError
        If the folder cannot be listed.
    """
    try:
        paths = sorted(folder.iterdir(), key=lambda path: (natural_key(path.name), path.name))
        return [path for path in paths if not is_hidden(path) and is_wanted(path)]
    except OSError as error:
        problem = f"cannot list {folder}: {error.strerror}"
        raise DatasetError(problem, "check the path and its rights") from error


def is_hidden(path: Path) -> bool:
    """Return whether a system wrote a file or folder beside those of the user."""
    return path.name.startswith(".") or path.name == "__MACOSX"


def _labelled(source: Path, entries: Sequence[Entry]) -> list[Entry]:
    """Return shapes with the classes that a list of labels gives them.

    Parameters
    ----------
    source
        The list, ``labels.txt`` or ``labels.csv``, which names exactly these shapes.
    entries
        The shapes beside the list, at least one.

    Raises
    ------
    DatasetError
        If the list gives no names, or does not name exactly the shapes.
    """
    labels = read_labels(source)
    if not isinstance(labels, dict):
        raise DatasetError(f"{source} does not name the shapes", "write 'name label' on each line")
    names = {entry.identifier for entry in entries}
    unlabelled = [entry.identifier for entry in entries if entry.identifier not in labels]
    surplus = [name for name in labels if name not in names]
    if unlabelled or surplus:
        problem = f"{source} and the shapes beside it differ in {listed([*unlabelled, *surplus])}"
        raise DatasetError(problem, f"name each shape once, like {entries[0].identifier}")

    labelled = []
    for entry in entries:
        name = entry.identifier
        # The class no longer comes from the name, so the whole name tells the poses apart.
        labelled.append(replace(entry, subject=labels[name], pose=name))
    return labelled


def _depth_images(folder: Path) -> list[Entry]:
    """Return the depth images of a folder, or of its sub-folders if it holds none itself.

    Each sub-folder is a class, whose images lie in it or in a folder ``depth`` below it. Folders of
    masks are left out.
    """
    files = depth_files(folder)
    if files:
        return [*_from_names(files)]
    entries: list[Entry] = []
    for sub_folder in sub_folders(folder):
        if sub_folder.name.lower() in MASK_FOLDERS:
            continue
        files = depth_files(sub_folder)
        if not files and (sub_folder / "depth").is_dir():
            files = depth_files(sub_folder / "depth")
        entries += _from_sub_folder(sub_folder, files)
    return entries


def _from_names(files: Iterable[Path]) -> Iterator[Entry]:
    """Yield shapes whose files are named by class and number."""
    for path in files:
        stem = mesh_stem(path)
        subject = re.sub(r"[-_ \xa0]*[0-9]+\Z", "", stem) or stem
        pose = printable(stem[len(subject) :].lstrip("-_ \xa0"))
        yield Entry(printable(stem), printable(subject), pose, path)


def _from_sub_folder(folder: Path, files: Iterable[Path]) -> list[Entry]:
    """Return shapes of the class that their folder names."""
    subject = printable(folder.name)
    entries = []
    for path in files:
        pose = printable(mesh_stem(path))
        entries.append(Entry(f"{subject}/{pose}", class_name(folder.name, pose), pose, path))
    return entries


def class_list(folders: Sequence[Path], lists: re.Pattern[str] = _CLA) -> Path | None:
    """Return the list of classes in some folders, or None.

    Raises
    ------
    DatasetError
        If there are several.
    """
    files: list[Path] = []
    for folder in folders:
        files += _visible_paths(folder, lambda path: lists.fullmatch(path.name) is not None)
    if len(files) > 1:
        names = " and ".join(path.relative_to(folders[0]).as_posix() for path in files[:2])
        problem = f"{folders[0]} holds {names}"
        raise DatasetError(problem, "keep the list that classifies these meshes")
    return files[0] if files else None


def read_cla(path: Path) -> dict[int, str]:
    """Read a classification file of the Princeton Shape Benchmark.

    Parameters
    ----------
    path
        A text with the lines ``PSB 1`` and ``<classes> <models>``; then, for each class, a line
        ``<name> <parent> <count>`` and as many numbers of models.

    Returns
    -------
    dict of int to str
        Class of each model by its number, which is that in the name of its file, in the order of
        the text. A model of the class ``-1`` (miscellaneous) gets a class of its own.

    Raises
    ------
    DatasetError
        If the header, a count or a number is wrong; the message names the file.
    """
    subjects: dict[int, str] = {}
    names: set[str] = set()
    hint = "expected '<name> <parent> <count>' followed by that many model numbers"
    with named_errors(path, "classification", DatasetError, hint):
        words = decode(read_file(path, LARGEST_LIST)).split()
        if words[:2] != ["PSB", "1"]:
            hint = "use the classification format of the Princeton Shape Benchmark"
            raise DatasetError("it does not start with 'PSB 1'", hint)
        n_classes = _whole(words[2])
        n_models = _whole(words[3])
        for name, numbers in _listed_classes(words[4:]):
            if name in names:
                problem = f"class '{name}' stands there twice"
                raise DatasetError(problem, "give each class a name of its own")
            names.add(name)
            for number in numbers:
                if number in subjects:
                    problem = f"model {number} stands in two classes"
                    raise DatasetError(problem, "list each model once")
                subjects[number] = class_name(name, number)
        if (len(names), len(subjects)) != (n_classes, n_models):
            announced = f"it announces {n_classes} classes and {n_models} models"
            problem = f"{announced} but lists {len(names)} and {len(subjects)}"
            raise DatasetError(problem, "correct the second line or complete the lists")
    return subjects


def _listed_classes(words: Sequence[str]) -> Iterator[tuple[str, list[int]]]:
    """Yield the name of each class of a classification, and the numbers of its models.

    Parameters
    ----------
    words
        The words after the header. Each class has its name, its parent and the number of its
        models, followed by the numbers of the models.

    Raises
    ------
    DatasetError
        If the words end within a class.
    """
    position = 0
    while position < len(words):
        name = words[position]
        count = _whole(words[position + 2])
        start = position + 3
        position = start + count
        numbers = [_whole(word) for word in words[start:position]]
        if len(numbers) != count:
            problem = f"class '{name}' announces {count} models but lists {len(numbers)}"
            raise DatasetError(problem, "complete the file")
        yield name, numbers


def _whole(word: str) -> int:
    """Return the whole number that a word of a classification means."""
    if not re.fullmatch("[0-9]{1,18}", word):
        raise ValueError(f"{word[:80]!r} is not a whole number")
    return int(word)


def _from_cla(cla: Path, files: Iterable[Path]) -> Iterator[Entry]:
    """Yield the shapes that a classification lists.

    It lists them by numbers, which stand at the ends of the names of their files.

    Parameters
    ----------
    cla
        A ``.cla`` file of the Princeton Shape Benchmark, see :func:`read_cla`.
    files
        Meshes of the folder, such as ``m123.off``.

    Raises
    ------
    DatasetError
        If a listed number has no file or several, or the file is a link out of the folder.
    """
    by_number: dict[int, list[Path]] = {}
    for path in files:
        match = re.search(r"[0-9]+\Z", mesh_stem(path))
        if match:
            by_number.setdefault(int(match.group()), []).append(path)
    subjects = read_cla(cla)
    missing = sorted(subjects.keys() - by_number.keys())
    if missing:
        problem = f"{cla} lists model {missing[0]}, but {cla.parent} has no mesh with that number"
        hint = "add the mesh or correct the list"
        if {number - 1 for number in subjects} == set(by_number):
            hint = "the list counts from 1, the meshes from 0: subtract 1 from each number"
        raise DatasetError(problem, hint)
    for number, subject in sorted(subjects.items()):
        path, *others = by_number[number]
        if others:
            problem = f"{cla} lists model {number}, which may be {path.name} or {others[0].name}"
            raise DatasetError(problem, "keep one of them")
        if not path.resolve().is_relative_to(cla.parent.resolve()):
            problem = f"{cla} names '{path.name}', which lies outside its folder"
            raise DatasetError(problem, "copy the mesh into the folder")
        stem = printable(mesh_stem(path))
        yield Entry(stem, subject, stem, path)
