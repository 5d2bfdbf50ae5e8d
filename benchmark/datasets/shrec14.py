"""SHREC'14 non-rigid humans (Pickup et al. 2014), synthetic and real, in the official layout."""

from __future__ import annotations

from collections.abc import Set
from pathlib import Path

from benchmark.datasets.base import Entry
from benchmark.datasets.files import FolderDataset
from benchmark.datasets.folder import mesh_files, read_cla
from benchmark.datasets.settings import with_settings
from benchmark.errors import DatasetError

#: Poses per subject, and shapes in all.
SIZES = {"synthetic": (20, 300), "real": (10, 400)}


def shrec14(data_root: Path, part: str) -> FolderDataset:
    """Read the list of shapes under ``DATA_ROOT/shrec14/PART``.

    Files are numbered from 0; shape i shows subject i // poses in pose i % poses. A ``dataset.toml`` may set canonical
    poses and cameras.

    Parameters
    ----------
    data_root
        The folder that holds ``shrec14/``.
    part
        ``"synthetic"`` (15 subjects x 20 poses) or ``"real"`` (40 x 10).

    Raises
    ------
    DatasetError
        If the folder is missing or does not hold the complete set, or a ``.cla`` file in it contradicts the numbers.
    ConfigurationError
        If ``dataset.toml`` has an unknown key, class or pose.
    """
    poses, count = SIZES[part]
    folder = data_root / "shrec14" / part
    files = _numbered(folder)
    _check_complete(files.keys(), count, folder)
    for cla in sorted(folder.glob("*.cla")):
        _check_classes(cla, poses, count)
    entries = tuple(Entry(str(i), str(i // poses), str(i % poses), files[i]) for i in range(count))
    return with_settings(
        FolderDataset(name=f"shrec14-{part}", title=f"SHREC'14 {part}", entries=entries, folder=folder)
    )


def _numbered(folder: Path) -> dict[int, Path]:
    files: dict[int, Path] = {}
    for path in mesh_files(folder):
        if not (path.stem.isascii() and path.stem.isdecimal()):
            continue
        number = int(path.stem)
        if number in files:
            raise DatasetError(f"{folder} holds number {number} as {files[number].name} and {path.name}", "keep one")
        files[number] = path
    return files


def _check_complete(numbers: Set[int], count: int, folder: Path) -> None:
    expected = set(range(count))
    if numbers == expected:
        return
    missing, surplus = sorted(expected - numbers), sorted(numbers - expected)
    details = f", number {missing[0]} is missing" if missing else f", number {surplus[0]} is one too many"
    from_one = numbers == {number + 1 for number in expected}
    raise DatasetError(
        f"{folder} holds {len(numbers)} numbered meshes, not 0 to {count - 1}{details}",
        "the files are numbered from 1: subtract 1 from each" if from_one else "unpack the official archive there",
    )


def _check_classes(cla: Path, poses: int, count: int) -> None:
    """Raise ``DatasetError`` unless the classification groups the models as their numbers do."""
    classes = read_cla(cla)
    if classes.keys() == set(range(1, count + 1)):
        raise DatasetError(f"{cla} numbers the models from 1 to {count}", "subtract 1 from each number")
    if classes.keys() != set(range(count)):
        raise DatasetError(f"{cla} does not list models 0 to {count - 1}", "fetch the official .cla file or remove it")
    first_of_class: dict[str, int] = {}
    for number in range(count):
        expected = number // poses * poses
        first = first_of_class.setdefault(classes[number], number)
        if first != expected:
            raise DatasetError(
                f"{cla} puts model {number} into class '{classes[number]}', which begins with model {first}, "
                f"but models {expected} to {expected + poses - 1} are one subject",
                "fetch the official .cla file or remove it",
            )
