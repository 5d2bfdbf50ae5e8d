"""Data sets by name."""

from __future__ import annotations

import difflib
import os
import re
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from benchmark.api.datasets import ShapeSet
from benchmark.datasets.changes import split_changes, with_change
from benchmark.datasets.folder import folder_set
from benchmark.datasets.official import SETS, OfficialSet
from benchmark.errors import ConfigurationError, DatasetError, check_known, did_you_mean
from benchmark.text import printable


@dataclass(frozen=True)
class GeneratedSet:
    """A generated data set, without a folder: what a function of this package makes.

    Parameters
    ----------
    summary
        What it is, for lists.
    module, function, arguments
        What makes it: a module of this package, and a function of it with its arguments.
    n_shapes, n_classes
        Number of its shapes and classes.
    """

    summary: str
    module: str
    function: str
    n_shapes: int
    n_classes: int
    arguments: tuple[int, ...] = ()

    #: What official sets have.
    folder = ""
    origin = ""
    url = ""
    terms = ""
    other_use = ""

    def open(self, _name: str, _folder: Path) -> ShapeSet:
        """Return the data set."""
        module = import_module(f"benchmark.datasets.{self.module}")
        shapes: ShapeSet = getattr(module, self.function)(*self.arguments)
        return shapes


#: Official sets with a table in the paper.
_PAPER = ("shrec14-synthetic", "shrec14-real", "tosca")

_RANDOM = "generated humans drawn at random, 15 subjects x 20 poses"

#: What makes ``people``, and the number of its shapes and classes.
_PEOPLE = ("people", "people", 300, 15)


def _generated_people() -> dict[str, GeneratedSet]:
    """Return the sets of people drawn at random, by name."""
    sets = {"people": GeneratedSet(f"{_RANDOM}: the first draw of three", *_PEOPLE)}
    for draw in range(3):
        sets[f"people[draw={draw}]"] = GeneratedSet(f"{_RANDOM}, draw {draw}", *_PEOPLE, (draw,))
    return sets


#: Data sets by name, those of the paper first.
CATALOGUE: dict[str, OfficialSet | GeneratedSet] = {
    **{name: SETS[name] for name in _PAPER},
    "humans-scanlike": GeneratedSet(
        "generated scans of adults, 40 subjects x 10 poses; stand-in for SHREC'14 real",
        module="people",
        function="humans_scanlike",
        n_shapes=400,
        n_classes=40,
    ),
    **_generated_people(),
    "animals": GeneratedSet(
        "generated animals and people, 80 shapes in 9 classes; stand-in for TOSCA",
        module="animals",
        function="animals",
        n_shapes=80,
        n_classes=9,
    ),
    "animals-few": GeneratedSet(
        "generated animals and people, 6 classes x 3 poses of the set animals, "
        "for the table of robustness",
        module="animals",
        function="animals_few",
        n_shapes=18,
        n_classes=6,
    ),
    **SETS,
}

_MANY = re.compile(r"people\[n=0*([0-9]{1,9})\]")

#: Poses of each body of ``people[n=500]``.
_POSES = 20


def open_dataset(name: str, data_root: Path | None = None) -> ShapeSet:
    """Open a data set by name or folder path, with its changes.

    Parameters
    ----------
    name
        A key of :data:`CATALOGUE`, ``people[n=500]``, or the path of a folder of meshes; followed
        by any number of changes, such as ``[noise=3][jitter=1]``.
    data_root
        The folder of the official sets; None if there is none.

    Raises
    ------
    ConfigurationError
        If the name is neither a data set nor a folder, or the set stands in for one that is no
        official set.
    DatasetError
        If the set is missing or unreadable.
    """
    base, changes = split_changes(name)
    shapes = _open(base, data_root)
    if shapes.stand_in_for:
        check_known(f"official set under stand_in_for of {name}", [shapes.stand_in_for], SETS)
    for change, level in changes:
        shapes = with_change(shapes, change, level)
    return shapes


def _open(name: str, data_root: Path | None) -> ShapeSet:
    """Open a data set by its name.

    Parameters
    ----------
    name
        Name of a set of the suite, or path of a folder.
    data_root
        Folder that holds the official sets; None if there is none.

    Raises
    ------
    DatasetError
        If the data of an official set are missing, or there is no such folder.
    """
    require_known(name)
    source = _source(name)
    if source is None:  # a folder of a user
        folder = Path(name)
        if not folder.is_dir():
            raise _no_folder(folder)
        return folder_set(folder, folder_name(folder))
    if not _is_there(source, data_root):
        where = data_root / source.folder if data_root else f"DATA_ROOT/{source.folder}"
        hint = f"put it there and pass --data-root; it comes from {source.url}"
        raise DatasetError(f"data set '{name}' is not at {where}", hint)
    return source.open(name, (data_root or Path()) / source.folder)


def _source(name: str) -> OfficialSet | GeneratedSet | None:
    """Return the data set of the suite with a name; None if the suite has none.

    The name of a set of people drawn at random holds their number: ``"people[n=100]"``.
    """
    match = _MANY.fullmatch(name)
    if not match:
        return CATALOGUE.get(name)
    n = int(match[1])
    return GeneratedSet(
        f"{n} people drawn at random",
        module="people",
        function="many_people",
        n_shapes=_POSES * n,
        n_classes=n,
        arguments=(n,),
    )


def _no_folder(folder: Path) -> ConfigurationError:
    """Return the error for a path that is no folder, with the folder that may be meant."""
    hint = "name a data set or the folder that holds the meshes"
    beside = [path.name for path in folder.parent.glob("*") if path.is_dir()]
    if folder.is_file():
        hint = f"name the folder that holds it: {folder.parent}"
    elif near := difflib.get_close_matches(folder.name, beside, 1):
        hint = f"did you mean {folder.parent / near[0]}?"
    return ConfigurationError(f"{folder} is not a folder", hint)


def is_known(name: str) -> bool:
    """Return whether a name is that of a data set of the suite, with or without changes."""
    return _source(split_changes(name)[0]) is not None


def is_present(name: str, data_root: Path | None) -> bool:
    """Return whether a data set is available: a generated one always, else if its folder exists."""
    source = _source(split_changes(name)[0])
    return is_path(name) if source is None else _is_there(source, data_root)


def _is_there(source: OfficialSet | GeneratedSet, data_root: Path | None) -> bool:
    """Return whether the folder of a data set of the suite exists, if it has one."""
    return not source.folder or (data_root is not None and (data_root / source.folder).is_dir())


def is_path(name: str) -> bool:
    """Return whether a name on the command line is a path, with or without changes."""
    base = split_changes(name)[0]
    return "/" in base or base.startswith(".") or Path(base).is_dir()


def catalogued(name: str) -> str | None:
    """Return the name of a data set of the suite without its changes; None for any other set."""
    try:
        base = split_changes(name)[0]
    except ConfigurationError:
        return None
    return base if _source(base) else None


def require_known(name: str) -> None:
    """Raise ``ConfigurationError`` unless a name is a data set or path, with or without changes."""
    base, _ = split_changes(name)
    if _source(base) is not None or is_path(base):
        return
    folders = [path.name for path in Path().glob("[!.]*") if path.is_dir()]
    similar = difflib.get_close_matches(base, folders, 1)
    raise did_you_mean("data set or folder", base, [*CATALOGUE, *similar])


def table_name(source: str) -> str:
    """Return the name of the table of a data set that no table of the paper uses.

    It is the name of the set, also for a path.
    """
    base, _ = split_changes(source)
    name = base if _source(base) else folder_name(Path(base))
    return name + source[len(base) :]


def check_ranked(dataset: ShapeSet) -> None:
    """Raise ``DatasetError`` for an official set of one subject, which has another purpose."""
    source = CATALOGUE.get(dataset.name)
    if source and source.other_use:
        problem = f"data set '{dataset.name}' shows one subject, so nothing can be retrieved"
        raise DatasetError(problem, source.other_use)


def folder_name(folder: Path) -> str:
    """Return the data set name of a folder: its own, with a suffix if the catalogue has that."""
    real = os.path.realpath(folder)  # also of circular links, which are rejected later
    name = printable(Path(real).name)
    return f"{name}-folder" if name in CATALOGUE else name
