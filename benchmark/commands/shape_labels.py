"""Classes of shapes as users have them, and the orders that rows without names may have."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmark.datasets.labels import classes_of, read_labels

#: Numbers with which rows without names may begin.
_FIRST_NUMBERS = (0, 1)


@dataclass(frozen=True)
class ShapeLabels:
    """Classes of shapes.

    Parameters
    ----------
    classes
        Class of each shape: by name, or in the order of the rows if the shapes have no names.
    orders
        Names of the shapes in the orders that rows without names may have, by the word for the
        order: ``"list"`` and ``"number"`` of a ``.cla`` file, ``"listing"`` and ``"natural"`` of a
        folder. It is empty if the order of the classes is that of the rows.
    """

    classes: dict[str, str] | list[str]
    orders: Mapping[str, Sequence[str]] = field(default_factory=dict)

    @property
    def are_named(self) -> bool:
        """Whether the shapes have names."""
        return isinstance(self.classes, dict)


def as_labels(labels: Any) -> ShapeLabels:
    """Return the class of each shape, by name if the shapes have names.

    Parameters
    ----------
    labels
        A mapping by name, a pandas series or frame of one column, one axis of values, or the path
        of a ``.cla`` file, of text with lines ``label`` or ``name label``, or of a folder of
        shapes.

    Raises
    ------
    ConfigurationError
        If there are no labels, a name appears twice, or a shape has no label.
    DatasetError
        If the folder or the ``.cla`` file cannot be read.
    """
    if isinstance(labels, str | Path):
        return _read_labels(Path(labels))
    return _with_orders_of_numbers(classes_of(labels))


def _read_labels(path: Path) -> ShapeLabels:
    """Return the labels in a file, or those of the shapes of a folder."""
    if path.is_dir():
        return _folder_labels(path)
    if path.suffix.lower() != ".cla":
        return _with_orders_of_numbers(read_labels(path))
    from benchmark.datasets.folder import read_cla  # lazy: most labels are in no folder

    classes = {str(number): label for number, label in read_cla(path).items()}
    return ShapeLabels(classes, {"list": list(classes), "number": sorted(classes, key=int)})


def _with_orders_of_numbers(classes: dict[str, str] | list[str]) -> ShapeLabels:
    """Return labels whose names, if they number the rows, may have two orders."""
    if isinstance(classes, dict):
        from benchmark.datasets.base import natural_key  # lazy, as above

        numbers = sorted(classes, key=natural_key)
        if are_row_numbers(numbers):
            return ShapeLabels(classes, {"list": list(classes), "number": numbers})
    return ShapeLabels(classes)


def _folder_labels(folder: Path) -> ShapeLabels:
    """Return the classes of the shapes in a folder, and the orders in which programs list them.

    Returns
    -------
    ShapeLabels
        Class of each shape by name. Its orders are ``"listing"``, in which Python sorts paths;
        ``"natural"``, with cat2 before cat10; and, if the folder has a ``.cla`` file of the
        Princeton Shape Benchmark, ``"list"``, as it lists them, and ``"number"``, as it numbers
        them.
    """
    from benchmark.datasets.base import natural_key
    from benchmark.datasets.folder import class_list, folder_set, read_cla

    shapes = folder_set(folder).shapes
    classes = {entry.identifier: entry.subject for entry in shapes}
    by_path = sorted(shapes, key=lambda entry: entry.path.parts if entry.path else ())
    orders = {
        "listing": [entry.identifier for entry in by_path],
        "natural": list(classes),
    }
    cla_file = class_list([folder])
    if cla_file:
        # The shapes of such a folder are sorted by their numbers.
        numbers = list(read_cla(cla_file))  # in the order of the list
        by_number = dict(zip(sorted(numbers), classes, strict=True))
        orders["natural"] = sorted(classes, key=natural_key)
        orders["list"] = [by_number[number] for number in numbers]
        orders["number"] = list(classes)
    return ShapeLabels(classes, orders)


def are_row_numbers(names: Iterable[str]) -> bool:
    """Return whether names merely count from 0 or 1, as pandas and R write without names."""
    every = [*names]
    return any(every == _counted_from(first, len(every)) for first in _FIRST_NUMBERS)


def _counted_from(first: int, count: int) -> list[str]:
    """Return numbers from a first one as text."""
    return [str(number) for number in range(first, first + count)]
