"""SHREC'14 non-rigid humans (Pickup et al. 2014), synthetic and real, in the official layout."""

from __future__ import annotations

from pathlib import Path

from benchmark.datasets.base import Entry, FileDataset
from benchmark.datasets.folder import mesh_files
from benchmark.errors import DatasetError

#: Poses per subject, and shapes in all.
SIZES = {"synthetic": (20, 300), "real": (10, 400)}


def shrec14(data_root: Path, part: str) -> FileDataset:
    """Read the list of shapes under ``DATA_ROOT/shrec14/PART``.

    Files are numbered from 0; shape i shows subject i // poses in pose i % poses.

    Parameters
    ----------
    data_root
        The folder that holds ``shrec14/``.
    part
        ``"synthetic"`` (15 subjects x 20 poses) or ``"real"`` (40 x 10).

    Raises
    ------
    DatasetError
        If the folder is missing or does not hold the complete set.
    """
    poses, count = SIZES[part]
    folder = data_root / "shrec14" / part
    files = {int(path.stem): path for path in mesh_files(folder) if path.stem.isdigit()}
    missing = sorted(set(range(count)) - set(files))
    if missing or len(files) > count:
        first = f", number {missing[0]} is missing" if missing else ""
        raise DatasetError(
            f"{folder} holds {len(files)} numbered meshes, not 0 to {count - 1}{first}",
            "unpack the official archive there",
        )
    entries = tuple(Entry(str(i), str(i // poses), str(i % poses), files[i]) for i in range(count))
    return FileDataset(name=f"shrec14-{part}", title=f"SHREC'14 {part}", entries=entries)
