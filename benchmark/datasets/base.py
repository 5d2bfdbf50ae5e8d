"""Interface of a data set to the harness, and parts of a set."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from benchmark.api.datasets import Entry
from benchmark.errors import DatasetError

if TYPE_CHECKING:
    from benchmark.geometry.camera import Camera
    from benchmark.geometry.mesh import Mesh


class Dataset(Protocol):
    """A collection of shapes; order of entries is the order of the matrix rows.

    Attributes
    ----------
    name
        Name on the command line.
    title
        Name in captions.
    stand_in_for
        Name of the official set that this generated one stands in for, or "" for real data.
    half_width
        Half the width of the depth camera's frame in file units, or None to fit it to the whole set.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def title(self) -> str: ...  # noqa: D102
    @property
    def stand_in_for(self) -> str: ...  # noqa: D102
    @property
    def half_width(self) -> float | None: ...  # noqa: D102
    @property
    def entries(self) -> tuple[Entry, ...]: ...  # noqa: D102

    def load(self, entry: Entry) -> Mesh:
        """Return the mesh as the set gives it, or raise ``UnreadableMesh`` / ``InvalidMesh``."""
        ...

    def recipe(self, entry: Entry) -> str:
        """Name what determines the mesh: a digest of the file, or the parameters of the generator.

        The code behind it and the versions of the packages that it uses are no part of it.
        """
        ...

    def camera(self, entry: Entry) -> Camera:
        """Return the depth camera for this shape."""
        ...


Watched = Callable[[Sequence[Entry]], Iterable[Entry]]
"""Hands on shapes one at a time, each when the one before it is done with, so that a caller can tell how far it is."""


def check_retrievable(dataset: Dataset, entries: Iterable[Entry] | None = None) -> None:
    """Raise ``DatasetError`` unless there are at least two classes and a class with two shapes.

    Parameters
    ----------
    dataset
        The data set.
    entries
        The part of it that is ranked; None for all of it.
    """
    subjects = [entry.subject for entry in (dataset.entries if entries is None else entries)]
    what = f"data set '{dataset.name}'" if entries is None else f"what this table ranks of data set '{dataset.name}'"
    if not subjects:
        raise DatasetError(f"{what} has no meshes", "point to a folder with .off, .obj, .ply or .stl files")
    if len(set(subjects)) < 2:
        raise DatasetError(
            f"{what} has one class ('{subjects[0]}'), so every ranking is perfect",
            "sort the meshes into one sub-folder per class, add a .cla file, or name them CLASS + number",
        )
    if len(set(subjects)) == len(subjects):
        raise DatasetError(
            f"each class of {what} has one shape, so nothing can be retrieved",
            "add a second shape to at least one class",
        )


def printable(name: str) -> str:
    r"""A name as it may stand in a record: what cannot be printed or encoded is written as in Python, ``\x00``."""
    if name.isprintable():
        return name
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in name)


def natural_key(text: str) -> tuple[tuple[int, int, str], ...]:
    """Sort key that puts ``cat2`` before ``cat10``."""
    parts = re.findall(r"[0-9]+|[^0-9]+", text)
    return tuple((0, int(part), "") if part[0] in "0123456789" else (1, 0, part) for part in parts)


@dataclass(frozen=True)
class Part:
    """Some subjects of a data set in some poses.

    Parameters
    ----------
    subjects
        Subjects by name, or by their place in the data set; empty for all.
    poses
        Poses by their place among the shapes of the subject; empty for all.
    """

    subjects: tuple[int | str, ...] = ()
    poses: tuple[int, ...] = ()

    def of(self, dataset: Dataset) -> tuple[Entry, ...]:
        """Shapes of this part, in the order of the data set."""
        members: dict[str, list[Entry]] = {}
        for entry in dataset.entries:
            members.setdefault(entry.subject, []).append(entry)
        chosen = {
            entry.identifier
            for place, (subject, shapes) in enumerate(members.items())
            if not self.subjects or subject in self.subjects or place in self.subjects
            for pose, entry in enumerate(shapes)
            if not self.poses or pose in self.poses
        }
        return tuple(entry for entry in dataset.entries if entry.identifier in chosen)


def thinned(entries: tuple[Entry, ...], most: int) -> tuple[Entry, ...]:
    """Keep evenly spaced poses of each subject, at most this many, the first one always."""
    by_subject: dict[str, list[Entry]] = {}
    for entry in entries:
        by_subject.setdefault(entry.subject, []).append(entry)
    kept: set[str] = set()
    for members in by_subject.values():
        step = -(-len(members) // most)
        kept.update(entry.identifier for entry in members[::step])
    return tuple(entry for entry in entries if entry.identifier in kept)
