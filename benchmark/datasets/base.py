"""Interface of data sets for the harness, and parts of a data set."""

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
    """A collection of shapes; the order of entries is the order of matrix rows.

    Attributes
    ----------
    name
        Name on the command line.
    title
        Name in captions.
    stand_in_for
        Name of the official set that this generated set replaces, or "" for real data.
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
        """Return the unprocessed mesh, or raise ``UnreadableMesh`` / ``InvalidMesh``."""
        ...

    def recipe(self, entry: Entry) -> str:
        """Return the inputs that determine the mesh: a digest of the file, or the parameters of the generator.

        Code and package versions are not included.
        """
        ...

    def camera(self, entry: Entry) -> Camera:
        """Return the depth camera for this shape."""
        ...


Watched = Callable[[Sequence[Entry]], Iterable[Entry]]
"""Wrapper that yields shapes one at a time, on demand, so that the caller can track progress."""


def check_retrievable(dataset: Dataset, entries: Iterable[Entry] | None = None) -> None:
    """Raise ``DatasetError`` unless there are at least two classes and a class with two shapes.

    Parameters
    ----------
    dataset
        The data set.
    entries
        The ranked part of the data set; None for all shapes.
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
    r"""Return a name suitable for records: unprintable characters are escaped as in Python, such as ``\x00``."""
    if name.isprintable():
        return name
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in name)


def natural_key(text: str) -> tuple[tuple[int, int, str], ...]:
    """Return a sort key that puts ``cat2`` before ``cat10``."""
    parts = re.findall(r"[0-9]+|[^0-9]+", text)
    return tuple((0, int(part), "") if part[0] in "0123456789" else (1, 0, part) for part in parts)


@dataclass(frozen=True)
class Part:
    """A subset of the subjects and poses of a data set.

    Parameters
    ----------
    subjects
        Subjects by name or index in the data set; empty for all.
    poses
        Poses by index among the shapes of the subject; empty for all.
    """

    subjects: tuple[int | str, ...] = ()
    poses: tuple[int, ...] = ()

    def of(self, dataset: Dataset) -> tuple[Entry, ...]:
        """Return the shapes of this part, in the order of the data set."""
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
    """Return at most ``most`` evenly spaced poses of each subject, including the first."""
    by_subject: dict[str, list[Entry]] = {}
    for entry in entries:
        by_subject.setdefault(entry.subject, []).append(entry)
    kept: set[str] = set()
    for members in by_subject.values():
        step = -(-len(members) // most)
        kept.update(entry.identifier for entry in members[::step])
    return tuple(entry for entry in entries if entry.identifier in kept)
