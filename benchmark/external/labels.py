"""Classes of shapes from a PSB classification file, a text file, or a folder of shapes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmark.datasets.base import printable
from benchmark.datasets.files import text_of
from benchmark.datasets.folder import folder_dataset, read_cla
from benchmark.errors import ConfigurationError

#: Bytes of the largest file of labels.
LARGEST = 2**26

#: Separates several labels of one shape.
SEVERAL = ";"


@dataclass(frozen=True)
class Labels:
    """Labels of shapes in the order of a matrix.

    Parameters
    ----------
    classes
        Labels of each shape, one or several.
    names
        Names of the shapes; empty where nothing names them.
    """

    classes: tuple[tuple[str, ...], ...]
    names: tuple[str, ...] = ()

    def of(self, names: Sequence[str], what: str) -> Labels:
        """Those of some shapes; raises ``ConfigurationError`` for a shape without a label."""
        if not self.names and len(names) == len(self.classes):
            return Labels(self.classes, tuple(names))
        by_name = dict(zip(self.names, self.classes, strict=False))
        if unknown := [name for name in names if name not in by_name]:
            hint = (
                f"name the shapes as the labels do: {', '.join(self.names[:3])} ..." if by_name else "name the labels"
            )
            raise ConfigurationError(f"{what}: {len(unknown)} shapes have no label, the first is '{unknown[0]}'", hint)
        return Labels(tuple(by_name[name] for name in names), tuple(names))


def as_labels(labels: object) -> Labels:
    """Labels from a path, from a mapping of names (a pandas Series, too), or from a sequence.

    Raises
    ------
    ConfigurationError
        If there is no label, or a name stands twice.
    DatasetError
        If the file or the folder cannot be read.
    """
    if isinstance(labels, Labels):
        return labels
    if isinstance(labels, str | Path):
        return read_labels(Path(labels))
    given: Any = labels
    pairs = dict(given.items()) if hasattr(given, "items") else None
    values = list(given if pairs is None else pairs.values())
    classes = tuple(tuple(map(str, v)) if isinstance(v, list | tuple | set) else (str(v),) for v in values)
    return _checked(Labels(classes, tuple(map(str, pairs or ()))), "the labels")


def read_labels(path: Path) -> Labels:
    """Labels of a ``.cla`` file, a folder of shapes, or a text file with a line ``label`` or ``name label`` a shape."""
    if path.is_dir():
        entries = folder_dataset(path).entries
        return Labels(tuple((entry.subject,) for entry in entries), tuple(entry.identifier for entry in entries))
    if path.suffix.lower() == ".cla":
        numbers = sorted(read_cla(path).items())
        return Labels(tuple((name,) for _, name in numbers), tuple(str(number) for number, _ in numbers))
    if path.is_file() and path.stat().st_size > LARGEST:
        raise ConfigurationError(f"{path} is too large for a list of labels", "name another file")
    lines = [line.strip() for line in text_of(path).splitlines()]
    rows = [re.split(r"[,\s]+", line) for line in lines if line and not line.startswith("#")]
    widths = {len(row) for row in rows}
    if widths not in ({1}, {2}):
        problem = f"{path} has lines of {' and '.join(map(str, sorted(widths)))} words" if rows else f"{path} is empty"
        raise ConfigurationError(
            problem, f"write 'label' or 'name label' on each line; '{SEVERAL}' separates several labels of a shape"
        )
    classes = tuple(tuple(filter(None, printable(row[-1]).split(SEVERAL))) for row in rows)
    return _checked(Labels(classes, tuple(printable(row[0]) for row in rows) if widths == {2} else ()), str(path))


def _checked(labels: Labels, what: str) -> Labels:
    if not labels.classes or not all(labels.classes):
        raise ConfigurationError(f"{what}: a shape has no label", "give each shape one label or more")
    if len(set(labels.names)) != len(labels.names):
        twice = next(name for name in labels.names if labels.names.count(name) > 1)
        raise ConfigurationError(f"{what}: '{twice}' stands twice", "name each shape once")
    return labels
