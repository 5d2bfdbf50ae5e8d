"""File layouts of official sets: their shapes, and the subject of each shape.

A layout is read from the folder of the set and folders up to three levels below, as unpacked from the archives. Case
and leading zeros of file names are ignored. Detected differences from the published set raise a ``DatasetError`` that
names the file.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping, Set
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from benchmark.datasets.base import Entry, natural_key
from benchmark.datasets.files import file_digest
from benchmark.datasets.folder import mesh_files, read_cla, sub_folders
from benchmark.errors import DatasetError, UnreadableMesh

#: File names of class lists in the format of the Princeton Shape Benchmark.
LISTS = ("*.cla", "categories.txt")

_DEPTH = 3
_UNPACK = "unpack the official archive there, or name the folder, -d FOLDER, where no official set is meant"


class Layout(Protocol):
    """The shapes of an official set.

    Attributes
    ----------
    n_shapes, n_classes
        Number of shapes and classes; None if no source states it.
    """

    @property
    def n_shapes(self) -> int | None: ...  # noqa: D102
    @property
    def n_classes(self) -> int: ...  # noqa: D102

    def entries(self, folder: Path) -> tuple[Entry, ...]:
        """Read the shapes in the order of the set, or raise ``DatasetError``."""
        ...


@dataclass(frozen=True)
class Named:
    """A set with known file names that determine the subject.

    Parameters
    ----------
    shapes
        Subject and pose by file name without extension, in the order of the set.
    """

    shapes: Mapping[str, tuple[str, str]]

    @property
    def n_shapes(self) -> int:
        """Number of shapes."""
        return len(self.shapes)

    @property
    def n_classes(self) -> int:
        """Number of subjects."""
        return len({subject for subject, _ in self.shapes.values()})

    def entries(self, folder: Path) -> tuple[Entry, ...]:
        """Read the shapes; a class list in the folder must agree with their names."""
        stems = {_key(stem): stem for stem in self.shapes}
        files = _files(folder, {_form(stem) for stem in self.shapes})
        missing = [stem for key, stem in stems.items() if key not in files]
        surplus = [path for key, path in files.items() if key not in stems]
        if missing or surplus:
            what = [f"shape '{stem}' is missing" for stem in missing[:1]]
            what += [f"{path.name} is one too many" for path in surplus[:1]]
            raise DatasetError(
                f"{folder} holds {len(files)} shapes, not the official {len(stems)}: {', '.join(what)}",
                _renumber(map(_number, stems), map(_number, files)) or _UNPACK,
            )
        _check_copies(files.values())
        if source := _list(folder):
            self._check_list(source)
        return tuple(Entry(stem, *self.shapes[stem], files[key]) for key, stem in stems.items())

    def _check_list(self, source: Path) -> None:
        """Raise ``DatasetError`` if the list groups the shapes differently from their names."""
        subjects = {_number(stem): subject for stem, (subject, _) in self.shapes.items()}
        classes = read_cla(source)
        if classes.keys() != subjects.keys():
            first, last = min(subjects), max(subjects)
            raise DatasetError(
                f"{source} does not list models {first} to {last}",
                _renumber(subjects, classes) or "fetch the official list or remove it",
            )
        pairs: dict[str, str] = {}
        for number, subject in subjects.items():
            known = pairs.setdefault(classes[number], subject)
            if known != subject or len(set(pairs.values())) != len(pairs):
                raise DatasetError(
                    f"{source} puts model {number} into class '{classes[number]}', but it shows subject '{subject}'",
                    "fetch the official list or remove it",
                )


@dataclass(frozen=True)
class Listed:
    """A set of numbered files, with classes from a list in the folder or from sub-folders.

    Parameters
    ----------
    n_classes, n_poses
        Number of classes, and of shapes per class.
    prefix
        Prefix of the number in file names.
    members
        Class by the digest of its numbers, see :func:`members_digest`; empty if the official list is unknown and the
        list in the folder is not verified.
    """

    n_classes: int
    n_poses: int
    prefix: str = "t"
    members: Mapping[str, str] = field(default_factory=dict)

    @property
    def n_shapes(self) -> int:
        """Number of shapes."""
        return self.n_classes * self.n_poses

    def entries(self, folder: Path) -> tuple[Entry, ...]:
        """Read the shapes in order of their numbers."""
        files = {_number(key): path for key, path in _files(folder, {f"{self.prefix}#"}).items()}
        source = _list(folder)
        classes = read_cla(source) if source else _folder_classes(files)
        if source:
            self._check_numbers(classes.keys(), files, source)
        if len(files) != self.n_shapes:
            raise DatasetError(f"{folder} holds {len(files)} shapes, not the official {self.n_shapes}", _UNPACK)
        if not source and len(set(classes.values())) == 1:
            raise DatasetError(f"{folder} holds no list of classes", "put the official .cla file there")
        named = self._official_names(classes, source or folder)
        _check_copies(files.values())
        return tuple(
            Entry(files[number].stem, named[classes[number]], files[number].stem, files[number])
            for number in sorted(files)
        )

    def _check_numbers(self, listed: Set[int], files: Mapping[int, Path], source: Path) -> None:
        """Raise ``DatasetError`` if the numbers of the list and the meshes differ."""
        missing, surplus = sorted(listed - files.keys()), sorted(files.keys() - listed)
        if missing or surplus:
            what = f"there is no {self.prefix.upper()}{missing[0]}" if missing else f"{files[surplus[0]].name} is extra"
            shifted = _renumber(listed, files)
            raise DatasetError(
                f"{source} lists {len(listed)} models for {len(files)} meshes: {what}",
                f"{shifted}, or shift the list" if shifted else _UNPACK,
            )

    def _official_names(self, classes: Mapping[int, str], source: Path) -> dict[str, str]:
        """Return the official name of each listed class; raises ``DatasetError`` if its members are not official."""
        sizes = Counter(classes.values())
        if len(sizes) != self.n_classes:
            raise DatasetError(f"{source} has {len(sizes)} classes, not the official {self.n_classes}", _UNPACK)
        for name, size in sizes.items():
            if size != self.n_poses:
                raise DatasetError(
                    f"class '{name}' of {source} has {size} models, not the official {self.n_poses}",
                    "fetch the official list: a model stands in another class",
                )
        if not self.members:
            return {name: name for name in sizes}
        digests = {name: members_digest(n for n, other in classes.items() if other == name) for name in sizes}
        if wrong := [f"'{name}'" for name, digest in digests.items() if digest not in self.members]:
            raise DatasetError(
                f"classes {', '.join(wrong)} of {source} do not hold their official models",
                "fetch the official list: some stand in another class",
            )
        return {name: self.members[digest] for name, digest in digests.items()}


@dataclass(frozen=True)
class Classed:
    """A set with file names of class and number, with unknown class sizes.

    Parameters
    ----------
    classes
        Class by prefix of the number.
    """

    classes: Mapping[str, str]

    @property
    def n_shapes(self) -> None:
        """Unknown."""
        return

    @property
    def n_classes(self) -> int:
        """Number of classes."""
        return len(self.classes)

    def entries(self, folder: Path) -> tuple[Entry, ...]:
        """Read the shapes, class by class."""
        files = _files(folder, {f"{prefix}#" for prefix in self.classes})
        keys_of = {prefix: [key for key in files if _form(key) == f"{prefix}#"] for prefix in self.classes}
        for prefix, keys in keys_of.items():
            if not keys:
                raise DatasetError(f"{folder} holds no shape of class '{self.classes[prefix]}', {prefix}1", _UNPACK)
        _check_copies(files.values())
        return tuple(
            Entry(files[key].stem, self.classes[prefix], str(_number(key)), files[key])
            for prefix, keys in keys_of.items()
            for key in sorted(keys, key=natural_key)
        )


def members_digest(numbers: Iterable[int]) -> str:
    """Return a digest of the numbers of a class: eight hexadecimal digits."""
    return hashlib.sha256(",".join(map(str, sorted(numbers))).encode()).hexdigest()[:8]


def _key(stem: str) -> str:
    return re.sub(r"[0-9]+", lambda match: str(int(match[0])), stem.lower())


def _form(stem: str) -> str:
    return re.sub(r"[0-9]+", "#", stem.lower())


def _number(stem: str) -> int:
    return int(re.findall(r"[0-9]+", stem)[-1])


def folders_of_set(folder: Path, depth: int = _DEPTH) -> Iterator[Path]:
    """Yield the folder of a set and its sub-folders, by default up to three levels deep."""
    yield folder
    if depth:
        for sub in sub_folders(folder):
            yield from folders_of_set(sub, depth - 1)


def _files(folder: Path, forms: Container[str]) -> dict[str, Path]:
    """Return the meshes with file names of the given forms, by key."""
    path_of: dict[str, Path] = {}
    for place in folders_of_set(folder):
        for path in mesh_files(place):
            if _form(path.stem) in forms and path_of.setdefault(_key(path.stem), path) != path:
                one, other = path_of[_key(path.stem)].relative_to(folder), path.relative_to(folder)
                raise DatasetError(f"{folder} holds one shape as {one} and {other}", "keep one of them")
    return path_of


def _list(folder: Path) -> Path | None:
    lists = [path for place in folders_of_set(folder) for name in LISTS for path in sorted(place.glob(name))]
    if len(lists) > 1:
        names = " and ".join(path.relative_to(folder).as_posix() for path in lists[:2])
        raise DatasetError(f"{folder} holds {names}", "keep the list that classifies these meshes")
    return lists[0] if lists else None


def _folder_classes(files: Mapping[int, Path]) -> dict[int, str]:
    """Return the class of each number from its folder, or the parent of ``train`` and ``test``."""
    above = {
        number: path.parents[1] if path.parent.name in ("train", "test") else path.parent
        for number, path in files.items()
    }
    return {number: folder.name for number, folder in above.items()}


def _check_copies(paths: Iterable[Path]) -> None:
    """Raise ``DatasetError`` if two files have the same content, except empty files, which are unreadable."""
    by_size: dict[int, list[Path]] = {}
    for path in paths:
        by_size.setdefault(path.stat().st_size, []).append(path)
    by_size.pop(0, None)
    for alike in by_size.values():
        first: dict[str, Path] = {}
        for path in alike if len(alike) > 1 else ():
            try:
                digest = file_digest(path)
            except UnreadableMesh:
                continue  # excludes this shape only
            if first.setdefault(digest, path) != path:
                raise DatasetError(f"{path} is a copy of {first[digest].name}", "fetch the official file again")


def _renumber(expected: Iterable[int], actual: Iterable[int]) -> str:
    """Return a hint if all numbers are off by one in the same direction, otherwise ""."""
    listed, numbers = sorted(expected), sorted(actual)
    for step, hint in (1, "subtract 1 from"), (-1, "add 1 to"):
        if [number + step for number in listed] == numbers and listed:
            return f"the numbers begin with {numbers[0]}: {hint} each"
    return ""
