"""Parts of a data set: some subjects in some poses."""

from __future__ import annotations

from dataclasses import dataclass

from benchmark.datasets.base import Dataset, Entry

__all__ = ["Part", "thinned"]


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
