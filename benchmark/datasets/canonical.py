"""Choice of the shape of a subject that shows the canonical pose, the target of methods that learn."""

from __future__ import annotations

from benchmark.datasets.base import Dataset, Entry
from benchmark.datasets.files import FolderDataset
from benchmark.errors import did_you_mean


def canonical_entry(dataset: Dataset, subject: str) -> Entry:
    """Return the shape that shows a subject in the canonical pose.

    That is the pose that the folder's ``dataset.toml`` names, else the null pose of the official set, else the first
    pose in the order of the data set.

    Parameters
    ----------
    dataset
        The data set.
    subject
        One of its subjects.

    Raises
    ------
    ConfigurationError
        If the data set has no such subject.
    """
    shapes = [entry for entry in dataset.entries if entry.subject == subject]
    if not shapes:
        raise did_you_mean(f"subject of data set '{dataset.name}'", subject, {e.subject for e in dataset.entries})
    pose = dataset.canonical_poses.get(subject) if isinstance(dataset, FolderDataset) else None
    return next((entry for entry in shapes if entry.pose == pose), shapes[0])
