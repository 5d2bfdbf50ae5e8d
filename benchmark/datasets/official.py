"""Official sets, as listed in ``official.toml``: their shapes, and the subject of each.

A set is read from its folder and folders up to three levels below, as unpacked from the archives.
Detected differences from the published set raise a ``DatasetError`` that names the file.
"""

from __future__ import annotations

import hashlib
import re
import tomllib
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.datasets.base import natural_key
from benchmark.datasets.copies import KnownCopy
from benchmark.datasets.folder import class_list, mesh_files, read_cla, sub_folders
from benchmark.datasets.mesh_files import digest_of_entry, mesh_file_set, mesh_stem
from benchmark.datasets.settings import with_settings
from benchmark.datasets.sizes import key_with_area, scaled_to_area
from benchmark.errors import DatasetError
from benchmark.geometry.camera import FRONT, SIDE, Camera
from benchmark.geometry.mesh import Mesh
from benchmark.text import counted

#: File names of class lists in the format of the Princeton Shape Benchmark.
LISTS = re.compile(r".*\.cla|categories\.txt", re.IGNORECASE)

#: Levels of sub-folders below that of a set in which its files may lie.
_DEPTH = 3

_UNPACK = (
    "unpack the official archive there, or name the folder, -d FOLDER, "
    "where no official set is meant"
)
_Y_UP = Camera((0.0, 0.0, -1.0), (0.0, 1.0, 0.0))


@dataclass(frozen=True, kw_only=True)
class OfficialSet:
    """A published data set; the parameters are described in ``official.toml``."""

    title: str
    folder: str
    origin: str
    url: str
    citation: str
    names: str
    terms: str = "not stated; ask its makers, and cite"
    classes: int | list[str] = 0
    poses: int = 0
    first: int = 0
    without: tuple[int, ...] = ()
    null: str = ""
    listed: bool = False
    members: Mapping[str, str] = field(default_factory=dict)
    sizes: Mapping[str, int] = field(default_factory=dict)
    canonical_poses: Mapping[str, str] = field(default_factory=dict)
    side: tuple[str, ...] = ()
    up: str = "z"
    half_width: float | None = None
    copies: tuple[KnownCopy, ...] = ()
    pictures: bool = True
    other_use: str = ""

    @cached_property
    def subjects(self) -> list[str]:
        """Classes in the order of the set."""
        if self.sizes:
            return list(self.sizes)
        if isinstance(self.classes, list):
            return self.classes
        return [str(number) for number in range(self.classes)]

    @property
    def n_classes(self) -> int:
        """Number of classes."""
        return len(self.subjects)

    @property
    def summary(self) -> str:
        """One line for ``list datasets``."""
        shapes = f"{self.n_shapes} shapes in" if self.n_shapes else "shapes in"
        return f"{self.title}, {shapes} {counted(self.n_classes, 'class', 'classes')}"

    @property
    def n_shapes(self) -> int | None:
        """Number of shapes; None if no source states it."""
        if self.sizes:
            return sum(self.sizes.values())
        return len(self.subjects) * (self.poses - len(self.without)) or None

    @cached_property
    def shapes(self) -> dict[str, tuple[str, str]]:
        """Subject and pose of each shape by the name of its file, if the names determine them.

        The name is made from the pattern ``names``; the first pose may have a pattern of its own,
        ``null``. The poses ``without`` were not published.
        """
        shapes = {}
        for place, subject in enumerate(self.subjects):
            for pose in range(self.poses):
                if pose in self.without:
                    continue
                number = self.first + place * self.poses + pose
                is_null_pose = self.null and pose == 0
                pattern = self.null if is_null_pose else self.names
                stem = pattern.format_map({"class": subject, "pose": pose, "number": number})
                shapes[stem] = (subject, str(pose))
        return shapes

    def camera(self, entry: Entry) -> Camera:
        """Return the depth camera of a shape."""
        if self.up == "y":
            return _Y_UP
        return SIDE if entry.subject in self.side else FRONT

    def open(self, name: str, folder: Path) -> ShapeSet:
        """Open the official data set in a folder.

        Parameters
        ----------
        name
            Name of the data set.
        folder
            The folder. A ``dataset.toml`` there may set canonical poses and cameras.

        Raises
        ------
        DatasetError
            If the set differs from the published one: wrong counts, missing or duplicate files,
            changed labels. A set with ``sizes`` may be incomplete.
        ConfigurationError
            If ``dataset.toml`` has an unknown key, class or pose.
        """
        shapes = mesh_file_set(
            name=name,
            title=self.title,
            shapes=tuple(self._entries(folder)),
            camera=self.camera,
            half_width=self.half_width,
            folder=folder,
            canonical_poses=self.canonical_poses,
        )
        return with_settings(self._with_sizes(shapes))

    def _entries(self, folder: Path) -> Iterable[Entry]:
        """Return the shapes by what says their class: a list, whole names, or a part of them."""
        if self.listed:
            return self._shapes_of_list(folder)
        if self.poses:
            return self._shapes_of_names(folder)
        return self._shapes_of_classes(folder)

    def copy_of(self, entry: Entry) -> KnownCopy | None:
        """Return the known copy to which the file of a shape belongs by its content."""
        digest = digest_of_entry(entry)
        for copy in self.copies:
            if copy.has(entry.identifier, digest):
                return copy
        return None

    def _with_sizes(self, shapes: ShapeSet) -> ShapeSet:
        """Return the data set with the areas that published lists state, where files have no unit.

        Other files keep their size.
        """
        if not any(copy.area for copy in self.copies):
            return shapes
        sized = _WithAreas(shapes, self)
        return replace(shapes, load=sized.load, key=sized.key, code=sized.code)

    def _shapes_of_names(self, folder: Path) -> list[Entry]:
        """Return the shapes of a set for which all names of files are published.

        Parameters
        ----------
        folder
            Folder of the set.

        Raises
        ------
        DatasetError
            If a published file is missing, or there is one more.
        """
        # Names are compared in lower case and without leading zeros: copies differ in these.
        stems = {_key(stem): stem for stem in self.shapes}
        files = _files(folder, {_form(stem) for stem in self.shapes})
        missing = [stem for key, stem in stems.items() if key not in files]
        surplus = [path.name for key, path in files.items() if key not in stems]
        examples = []
        if missing:
            examples.append(f"shape '{missing[0]}' is missing")
        if surplus:
            examples.append(f"{surplus[0]} is one too many")
        if examples:
            problem = (
                f"{folder} holds {len(files)} shapes, not the official {len(stems)}: "
                f"{', '.join(examples)}"
            )
            raise DatasetError(problem, _UNPACK)
        entries = []
        for key, stem in stems.items():
            subject, pose = self.shapes[stem]
            entries.append(Entry(stem, subject, pose, files[key]))
        return entries

    def _shapes_of_list(self, folder: Path) -> Iterator[Entry]:
        """Yield the shapes of a set with numbered files, by number.

        The classes stand in a ``.cla`` file, or are the sub-folders.

        Parameters
        ----------
        folder
            Folder of the set.

        Raises
        ------
        DatasetError
            If the number of shapes is not the published one, or their classes differ.
        """
        files_by_key = _files(folder, {_form(self.names.format(number=0))})
        files = {_number(key): path for key, path in files_by_key.items()}
        source = class_list(list(folders_of_set(folder)), LISTS)
        if source:
            classes = read_cla(source)
            self._check_list(source, classes, files)
        else:
            classes = _folder_classes(files)
        if len(files) != self.n_shapes:
            problem = f"{folder} holds {len(files)} shapes, not the official {self.n_shapes}"
            raise DatasetError(problem, _UNPACK)
        if not source and len(set(classes.values())) == 1:
            problem = f"{folder} holds no list of classes"
            raise DatasetError(problem, "put the official .cla file there")
        official = self._official_names(classes, source or folder)
        for number in sorted(files):
            stem = mesh_stem(files[number])
            yield Entry(stem, official[classes[number]], stem, files[number])

    def _check_list(
        self, source: Path, classes: Mapping[int, str], files: Mapping[int, Path]
    ) -> None:
        """Raise ``DatasetError`` unless a list of classes names exactly the meshes of a folder.

        Parameters
        ----------
        source
            The list.
        classes
            Class of each model by its number, as the list states it.
        files
            Meshes of the folder by their numbers.
        """
        missing = classes.keys() - files.keys()
        surplus = files.keys() - classes.keys()
        if missing:
            what = f"there is no {self.names.format(number=min(missing)).upper()}"
        elif surplus:
            what = f"{files[min(surplus)].name} is extra"
        else:
            return
        problem = f"{source} lists {len(classes)} models for {len(files)} meshes: {what}"
        raise DatasetError(problem, _UNPACK)

    def _official_names(self, classes: Mapping[int, str], source: Path) -> dict[str, str]:
        """Return the published name of each class of a list, by the name that the list gives it.

        If the members of the classes are published, a class is recognised by them.

        Parameters
        ----------
        classes
            Class of each model by its number, as the list states it.
        source
            The list, for an error.

        Raises
        ------
        DatasetError
            If the number of classes is not the published one, or a class has other models.
        """
        models: dict[str, list[int]] = {}  # numbers of the models of each class
        for number, name in classes.items():
            models.setdefault(name, []).append(number)
        if len(models) != self.classes:
            problem = f"{source} has {len(models)} classes, not the official {self.classes}"
            raise DatasetError(problem, _UNPACK)
        for name, numbers in models.items():
            if len(numbers) != self.poses:
                problem = (
                    f"class '{name}' of {source} has {len(numbers)} models, "
                    f"not the official {self.poses}"
                )
                hint = "fetch the official list: a model stands in another class"
                raise DatasetError(problem, hint)
        if not self.members:
            return {name: name for name in models}
        digests = {name: members_digest(numbers) for name, numbers in models.items()}
        wrong = [f"'{name}'" for name, digest in digests.items() if digest not in self.members]
        if wrong:
            problem = f"classes {', '.join(wrong)} of {source} do not hold their official models"
            raise DatasetError(problem, "fetch the official list: some stand in another class")
        return {name: self.members[digest] for name, digest in digests.items()}

    def _shapes_of_classes(self, folder: Path) -> Iterator[Entry]:
        """Yield the shapes of a set whose names of files hold class and number, class by class.

        Parameters
        ----------
        folder
            Folder of the set, with files such as ``cat10.off``.

        Raises
        ------
        DatasetError
            If there are no such files, or a class has none and is not allowed to be incomplete.
        """
        # A name of each class, such as "cat0".
        stems = {
            subject: self.names.format_map({"class": subject, "pose": 0})
            for subject in self.subjects
        }
        files = _files(folder, {_form(stem) for stem in stems.values()})
        if not files:
            problem = f"no {self.title} meshes in {folder}"
            raise DatasetError(problem, f"expected files such as {stems['cat']}.off")
        for subject, stem in stems.items():
            keys = [key for key in files if _form(key) == _form(stem)]
            if not keys and not self.sizes:
                problem = f"{folder} holds no shape of class '{subject}', {stem[:-1]}1"
                raise DatasetError(problem, _UNPACK)
            for key in sorted(keys, key=natural_key):
                yield Entry(mesh_stem(files[key]), subject, str(_number(key)), files[key])


_FACTS = tomllib.loads((Path(__file__).parent / "official.toml").read_text(encoding="utf-8"))


def _official_set(facts: dict[str, Any]) -> OfficialSet:
    """Return the set that a table of ``official.toml`` describes."""
    copies = tuple(KnownCopy(**copy) for copy in facts.get("copies", ()))
    return OfficialSet(**{**facts, "copies": copies})


SETS: Mapping[str, OfficialSet] = {name: _official_set(facts) for name, facts in _FACTS.items()}

#: Sets that can be ranked, but have no table in the paper.
EXTENDED = tuple(
    name
    for name, official in SETS.items()
    if not official.other_use and name != "tosca" and not name.startswith("shrec14")
)


def members_digest(numbers: Iterable[int]) -> str:
    """Return a digest of the numbers of a class: eight hexadecimal digits."""
    return hashlib.sha256(",".join(map(str, sorted(numbers))).encode()).hexdigest()[:8]


def _key(stem: str) -> str:
    """Return a name in lower case with numbers without leading zeros."""
    return re.sub(r"[0-9]+", lambda match: str(int(match[0])), stem.lower())


def _form(stem: str) -> str:
    """Return a name in lower case with ``#`` for each number."""
    return re.sub(r"[0-9]+", "#", stem.lower())


def _number(stem: str) -> int:
    """Return the last number in a name."""
    return int(re.findall(r"[0-9]+", stem)[-1])


def folders_of_set(folder: Path, depth: int = _DEPTH) -> Iterator[Path]:
    """Yield the folder of a set and its sub-folders, by default up to three levels deep."""
    yield folder
    if depth:
        for sub in sub_folders(folder):
            yield from folders_of_set(sub, depth - 1)


@dataclass(frozen=True)
class _WithAreas:
    """Functions of a data set whose meshes get the areas that published lists state.

    Parameters
    ----------
    shapes
        The data set.
    official
        What is published of it.
    """

    shapes: ShapeSet
    official: OfficialSet

    def area_of(self, entry: Entry) -> float:
        """Return the area that a file should have; 0 if it keeps its own."""
        copy = self.official.copy_of(entry)
        return copy.area if copy else 0.0

    def load(self, entry: Entry) -> Mesh:
        """Return the mesh in its size."""
        mesh = self.shapes.load(entry)
        area = self.area_of(entry)
        return scaled_to_area(mesh, area) if area else mesh

    def key(self, entry: Entry) -> str:
        """Return what determines the mesh: that of the file, and the area."""
        return key_with_area(self.shapes.key(entry), self.area_of(entry))

    def code(self, entry: Entry) -> Sequence[str]:
        """Return the modules that determine the mesh."""
        modules = self.shapes.code(entry)
        if not self.area_of(entry):
            return modules
        return (*modules, scaled_to_area.__module__)


def _files(folder: Path, forms: Container[str]) -> dict[str, Path]:
    """Return the meshes of a folder whose names have one of several forms.

    Parameters
    ----------
    folder
        The folder; its sub-folders may hold the meshes.
    forms
        Names in lower case with ``#`` for each number, such as ``"cat#"``.

    Returns
    -------
    dict of str to Path
        Each mesh by its name in lower case, with numbers without leading zeros: ``"cat7"``.

    Raises
    ------
    DatasetError
        If two files have the same name in this spelling.
    """
    path_of: dict[str, Path] = {}
    for place in folders_of_set(folder):
        for path in mesh_files(place):
            key = _key(mesh_stem(path))
            if _form(key) not in forms:
                continue
            first = path_of.setdefault(key, path)
            if first != path:
                names = f"{first.relative_to(folder)} and {path.relative_to(folder)}"
                problem = f"{folder} holds one shape as {names}"
                raise DatasetError(problem, "keep one of them")
    return path_of


def _folder_classes(files: Mapping[int, Path]) -> dict[int, str]:
    """Return the class of each number from its folder, or the parent of ``train`` and ``test``."""
    classes = {}
    for number, path in files.items():
        folder = path.parent
        if folder.name in ("train", "test"):
            folder = folder.parent
        classes[number] = folder.name
    return classes
