"""Parts of data sets, and names of their shapes."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.errors import DatasetError

Watched = Callable[[Sequence[Entry]], Iterable[Entry]]
"""Wrapper that yields shapes one at a time, on demand, so that the caller can track progress."""


def by_subject(entries: Iterable[Entry]) -> dict[str, list[Entry]]:
    """Return the shapes of each subject, in order."""
    members: dict[str, list[Entry]] = {}
    for entry in entries:
        members.setdefault(entry.subject, []).append(entry)
    return members


def check_retrievable(dataset: ShapeSet, entries: Iterable[Entry] | None = None) -> None:
    """Raise ``DatasetError`` unless shapes can be retrieved from a data set.

    That takes at least two classes, and two shapes in at least one of them.

    Parameters
    ----------
    dataset
        The data set.
    entries
        The part of the data set that is ranked; None for all shapes.
    """
    what = f"data set '{dataset.name}'"
    if entries is None:
        entries = dataset.shapes
    else:
        what = f"what this table ranks of {what}"
    members = by_subject(entries)
    if not members:
        hint = "point to a folder of meshes, such as .off, .obj or .ply files"
        raise DatasetError(f"{what} has no meshes", hint)
    if len(members) < 2:
        problem = f"{what} has one class ('{next(iter(members))}'), so every ranking is perfect"
        hint = (
            "sort the meshes into one sub-folder per class, list them in labels.txt, "
            "or name them CLASS + number"
        )
        raise DatasetError(problem, hint)
    if max(map(len, members.values())) < 2:
        problem = f"each class of {what} has one shape, so nothing can be retrieved"
        hint = (
            "add a second shape to at least one class; or if file names are taken for classes, "
            "sort the meshes into sub-folders, or list them in labels.txt"
        )
        raise DatasetError(problem, hint)


def canonical_shapes(dataset: ShapeSet) -> Mapping[str, Entry]:
    """Return the shape of each subject in the canonical pose; the first if none is set for it."""
    canonical = {}
    for subject, members in by_subject(dataset.shapes).items():
        pose = dataset.canonical_poses.get(subject)
        in_pose = [entry for entry in members if entry.pose == pose]
        canonical[subject] = in_pose[0] if in_pose else members[0]
    return canonical


def natural_key(text: str) -> tuple[tuple[int, int, str], ...]:
    """Return a sort key that puts ``cat2`` before ``cat10``."""
    return tuple(map(_part_key, re.findall(r"[0-9]+|[^0-9]+", text)))


def _part_key(part: str) -> tuple[int, int, str]:
    """Return the sort key of digits, by their number, or of other text, behind all digits."""
    if part[0] in "0123456789":
        return 0, int(part), ""
    return 1, 0, part


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

    def of(self, dataset: ShapeSet) -> tuple[Entry, ...]:
        """Return the shapes of this part, in the order of the data set."""
        chosen = set[str]()
        for number, (subject, shapes) in enumerate(by_subject(dataset.shapes).items()):
            if not self.subjects or subject in self.subjects or number in self.subjects:
                for pose, entry in enumerate(shapes):
                    if not self.poses or pose in self.poses:
                        chosen.add(entry.identifier)
        return tuple(entry for entry in dataset.shapes if entry.identifier in chosen)


def thinned(entries: tuple[Entry, ...], most: int) -> tuple[Entry, ...]:
    """Return at most ``most`` evenly spaced poses of each subject, including the first."""
    kept = set[str]()
    for members in by_subject(entries).values():
        step = math.ceil(len(members) / most)
        kept.update(entry.identifier for entry in members[::step])
    return tuple(entry for entry in entries if entry.identifier in kept)
