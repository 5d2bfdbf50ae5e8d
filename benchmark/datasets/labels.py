"""Lists of labels, and the cells of other tables in text."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmark.errors import ConfigurationError
from benchmark.files import LARGEST_LIST, decode, named_errors, read_file
from benchmark.text import nfc, printable

#: Class of the Princeton Shape Benchmark for models without a class.
MISCELLANEOUS = "-1"

#: Labels that say that there is none, as Python, pandas, R and spreadsheets write them.
_MISSING = ("nan", "none", "null", "nil", "na", "<na>", "n/a", "nat")

#: Numbers as programs write floats: 1.0, or 1.000e+00 of ``numpy.savetxt``.
_FLOAT = re.compile(r"-?(0|[1-9][0-9]{0,14})\.[0-9]*(e[+-]?[0-9]{1,2})?", re.IGNORECASE | re.ASCII)

#: Titles of the columns of a table of labels.
_NAMES = ("", "name", "shape", "mesh", "model", "file", "filename", "id", "identifier", "index")
_LABELS = ("label", "labels", "class", "category", "subject", "target")


def class_name(label: object, shape: object) -> str:
    """Return the class that a label means: 1 and 1.0 are one, and each shape of class -1 is its own."""
    text = printable(str(label))
    text = f"{float(text):.0f}" if _FLOAT.fullmatch(text) and float(text).is_integer() else text
    return f"{text} {shape}" if text == MISCELLANEOUS else text


def classes_of(labels: Mapping[str, object] | Sequence[object]) -> dict[str, str] | list[str]:
    """Return the classes of shapes by name, or in order; raise ``ConfigurationError`` if some have no label."""
    named = (
        labels
        if isinstance(labels, Mapping)
        else {f"row {row}": label for row, label in enumerate(labels, 1)}
    )
    classes = {nfc(name): class_name(str(label).strip(), name) for name, label in named.items()}
    if missing := [
        name
        for name, of in classes.items()
        if of.lower() in _MISSING or not any(map(str.isalnum, of))
    ]:
        problem = f"shapes without a label: {len(missing)}, the first is '{missing[0]}'"
        raise ConfigurationError(problem, "label them, or with -1 if they are of no class")
    return classes if isinstance(labels, Mapping) else [*classes.values()]


def read_labels(path: Path) -> dict[str, str] | list[str]:
    """Read text with lines ``label`` or ``name label``: the classes in order, or by name.

    Raises
    ------
    ConfigurationError
        If it is no such text, names a shape twice, or gives one no label.
    """
    hint = "write 'label' or 'name label' on each line"
    with named_errors(path, "list of labels", ConfigurationError, hint):
        rows = cells_of(lines_of(read_file(path, LARGEST_LIST)))
        *names, label = (cell.lower() for cell in rows[0])
        if label in _LABELS and all(name in _NAMES for name in names):
            problem = f"its first line, '{' '.join(rows[0]).strip()}', may name the columns"
            raise ConfigurationError(problem, "delete it, or let it begin with '#'")
        widths = {len(row) for row in rows}
        if widths == {1}:
            return classes_of([row[0] for row in rows])
        if widths != {2}:
            raise ConfigurationError(
                f"it has lines of {' and '.join(map(str, sorted(widths)))} words", hint
            )
        labels = dict(rows)
        if len(labels) < len(rows):
            raise ConfigurationError("it names a shape twice", "name each shape once")
        return classes_of(labels)


def separator_of(lines: Sequence[str]) -> str | None:
    """Return what separates cells: semicolons, else tabs, else commas; None for blanks."""
    return next((mark for mark in ";\t," if any(mark in line for line in lines)), None)


def cells_of(lines: Sequence[str]) -> list[list[str]]:
    """Split lines at semicolons, else tabs, else commas, else blanks; cells may be in quotes."""
    separator = separator_of(lines)
    if separator is None:
        lines = [" ".join(line.split()) for line in lines]
    read = csv.reader(lines, delimiter=separator or " ", skipinitialspace=True, strict=True)
    rows = [[cell.strip() for cell in row] for row in read]
    return [row[:-1] for row in rows] if all(row[-1] == "" for row in rows) else rows


def lines_of(content: bytes) -> list[str]:
    """Return the lines of a text that are not blank, without comments."""
    lines = [
        line
        for line in decode(content).splitlines()
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise ConfigurationError("it is empty", "name another file")
    return (
        [line.rstrip(" ;") for line in lines]
        if all(line.rstrip().endswith(";") for line in lines)
        else lines
    )
