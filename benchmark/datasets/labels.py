"""Labels: one axis of plain values that say the class of each shape, and lists of them in text."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set, ValuesView
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.delimited import (
    TextRows,
    ambiguous,
    cells_of,
    holds_separator,
    lines_of,
    separators_of,
    usual_separator,
)
from benchmark.errors import ConfigurationError, one_line
from benchmark.files import LARGEST_LIST, named_errors, read_file
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

#: Titles of the column of values that pandas and R give, where that of the names has none.
_UNNAMED = ("0", "x", *_LABELS)

#: A plain value; None where there is none.
Scalar = bool | int | float | str | None

#: First float whose neighbour is more than 1 away: it may stand for several whole numbers.
_FIRST_INEXACT = 2.0**53

#: Characters that no screen shows, by which labels would differ unseen. Joiners are none: they
#: change how words of some languages look.
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\xad\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f\ufeff]")

#: The minus sign of typesetters, which word processors write for a hyphen.
_MINUS = "\N{MINUS SIGN}"

_ONE_AXIS = "pass one axis of plain values: text, whole numbers, or both"
_ON_EACH_LINE = "write 'label' or 'name label' on each line"
_QUOTES = "put labels that hold a separator in quotes"


# Plain values
# --------------------------------------------------------------------------------------------


def scalars_of(values: Any, what: str) -> list[Scalar]:
    """Convert labels of any library to a list of plain Python values.

    Parameters
    ----------
    values
        A list, an iterator, a column of a table, or anything that numpy reads as an array of shape
        (n,), (n, 1) or (1, n).
    what
        What an error calls a value, which takes an "s" in the plural: ``"label"``.

    Returns
    -------
    list
        Text without blanks around it, numbers and truth values of Python; None for what says that
        there is no value: None, NaN, ``pandas.NA``, masked values, and empty cells of MATLAB.

    Raises
    ------
    ConfigurationError
        If they are no single axis, or one of them is no plain value.
    """
    axis = _one_axis(values, what)
    scalars = [_scalar(value, row, what) for row, value in enumerate(axis.tolist(), 1)]
    are_truth_values = [isinstance(value, bool) for value in scalars if value is not None]
    if any(are_truth_values) and not all(are_truth_values):
        problem = f"truth values stand beside other {what}s"
        raise ConfigurationError(problem, "write all as text or as whole numbers")
    return scalars


def _one_axis(values: Any, what: str) -> Any:
    """Return values of any kind as a numpy array of shape (n,).

    Parameters
    ----------
    values
        A list, an array, a tensor or a column of a table; shapes (n, 1) and (1, n) are accepted.
    what
        What an error calls one of the values: ``"label"``.

    Raises
    ------
    ConfigurationError
        If the values have several fields or axes, are a single value, or are times.
    """
    array = _as_array(values, what)
    if array.dtype.names is not None:
        problem = f"the {what}s are records with the fields {', '.join(array.dtype.names)}"
        raise ConfigurationError(problem, "pass one of the fields")
    if array.ndim == 2 and 1 in array.shape:
        array = array.reshape(-1)
    if array.ndim == 0:
        problem = f"the {what}s are one value of type {_type_name(values)}, not one axis"
        raise ConfigurationError(problem, _ONE_AXIS)
    if array.ndim > 1:
        problem = f"the {what}s are an array of shape {array.shape}, not one axis"
        raise ConfigurationError(problem, _ONE_AXIS)
    if array.dtype.kind in "mM":
        raise ConfigurationError(f"the {what}s are times ({array.dtype})", _ONE_AXIS)
    return array


def _as_array(values: Any, what: str) -> Any:
    """Return values of any kind as a numpy array.

    Parameters
    ----------
    values
        A list, an array, a tensor, a column of a table, or an iterator.
    what
        What an error calls one of the values: ``"label"``.

    Raises
    ------
    ConfigurationError
        If the values are a single text, have no order, as a set, or cannot be converted.
    """
    if isinstance(values, Set | str | bytes | Mapping):
        problem = f"the {what}s are one value of type {_type_name(values)}"
        raise ConfigurationError(problem, _ONE_AXIS)
    if isinstance(values, Iterator | ValuesView):
        values = list(values)
    if isinstance(values, np.ma.MaskedArray):
        return values
    try:
        if isinstance(values, list | tuple):
            # As objects: else numpy would turn numbers beside texts into texts.
            return np.asarray(values, dtype=object)
        return np.asarray(values)
    except Exception as error:  # conversions of other libraries raise errors of any type
        problem = f"the {what}s are no array: {one_line(error)}"
        raise ConfigurationError(problem, _ONE_AXIS) from error


def _scalar(value: Any, row: int, what: str) -> Scalar:
    """Convert a value of a table to a plain text, number or truth value of Python.

    Parameters
    ----------
    value
        A text, bytes, a number or a truth value, also of numpy, or an array of one of them.
    row
        Place of the value among all values, from 1, for an error.
    what
        What an error calls the values: ``"label"``.

    Returns
    -------
    bool, int, float, str or None
        The value; None if it is missing: an empty or masked cell, None or NaN.

    Raises
    ------
    ConfigurationError
        If the value has another type, is infinite, or is a float too large to be exact.
    """
    if hasattr(value, "__array__") or isinstance(value, np.generic):
        value = _only_item(value, row, what)
    if value is None or _is_nan(value):
        return None
    if isinstance(value, bytes):
        try:
            value = value.decode("utf-8")
        except UnicodeDecodeError as error:
            raise ConfigurationError(f"{what} {row} is no text in UTF-8", _ONE_AXIS) from error
    if isinstance(value, bool):
        return value
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        return _exact_float(value, f"{what} {row}")
    if isinstance(value, str):
        return _bare_text(value, f"{what} {row}")
    raise ConfigurationError(f"{what} {row} is of type {_type_name(value)}", _ONE_AXIS)


def _exact_float(value: float, name: str) -> float:
    """Return a float of Python; raise ``ConfigurationError`` if it is infinite or too large.

    From 2^53 on, a float may stand for several whole numbers.

    Parameters
    ----------
    value
        A float, also of numpy; not NaN.
    name
        What an error calls it: ``"label 3"``.
    """
    if not np.isfinite(value):
        raise ConfigurationError(f"{name} is infinite", _ONE_AXIS)
    if abs(value) >= _FIRST_INEXACT:
        problem = f"{name} is {value:.17g}, a float that may stand for several whole numbers"
        raise ConfigurationError(problem, "pass whole numbers or text")
    return float(value)


def _bare_text(value: str, name: str) -> str:
    """Return text without the blanks around it, if it holds no control character.

    Parameters
    ----------
    value
        Text, also of an enumeration, or of fixed width, which ends in NULs.
    name
        What an error calls it: ``"label 3"``.

    Raises
    ------
    ConfigurationError
        If it holds one.
    """
    text = str.__str__(value).strip().rstrip("\0").strip()
    if _CONTROL.search(text):
        problem = f"{name} holds a control character: {text!r:.40}"
        raise ConfigurationError(problem, "remove the character, which no screen shows")
    return text


def _only_item(value: Any, row: int, what: str) -> Any:
    """Return the only item of an array, such as a cell of MATLAB; None if it is empty or masked.

    Parameters
    ----------
    value
        An array with at most one item, or what numpy converts to one.
    row
        Place of the array among all values, from 1, for an error.
    what
        What an error calls the values: ``"label"``.

    Raises
    ------
    ConfigurationError
        If the array holds several items, records or times.
    """
    try:
        array = value if isinstance(value, np.ma.MaskedArray) else np.asarray(value)
    except Exception as error:  # conversions of other libraries raise errors of any type
        raise ConfigurationError(f"{what} {row}: {one_line(error)}", _ONE_AXIS) from error
    if array.size == 0:
        return None
    if array.size > 1 or array.dtype.names is not None or array.dtype.kind in "mM":
        problem = f"{what} {row} is an array of shape {array.shape}, {array.dtype}"
        raise ConfigurationError(problem, _ONE_AXIS)
    return array.reshape(-1).tolist()[0]


def _is_nan(value: Any) -> bool:
    """Return whether a value is NaN, NaT or NA: it is not equal to itself."""
    if type(value).__name__ in ("NAType", "NaTType"):  # pandas, which need not be imported
        return True
    return isinstance(value, float) and value != value


def _type_name(value: Any) -> str:
    """Return the name of the type of a value."""
    return type(value).__name__


# Names and classes
# --------------------------------------------------------------------------------------------


def text_of(value: bool | int | float | str) -> str:
    """Return a plain value as text, in which 1 and 1.0 are the same."""
    if isinstance(value, str):
        return value
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    return repr(value)


def names_of(values: Any) -> list[str]:
    """Return the names of shapes, as labels and distances give them.

    Raises
    ------
    ConfigurationError
        If a name is missing, or no plain value.
    """
    names = []
    for number, name in enumerate(scalars_of(values, "name"), 1):
        if name is None or name == "":
            raise ConfigurationError(f"name {number} is missing", "name each shape")
        names.append(nfc(text_of(name)))
    return names


def class_name(label: bool | int | float | str, shape: object) -> str:
    """Return the class that a label means: 1 and 1.0 are one.

    Each shape of class -1 is a class of its own.
    """
    text = printable(text_of(label))
    if _FLOAT.fullmatch(text) and float(text).is_integer():
        text = str(int(float(text)))
    return f"{text} {shape}" if text == MISCELLANEOUS else text


def classes_of(labels: Any) -> dict[str, str] | list[str]:
    """Return the class of each shape as text, from labels in any of several forms.

    Parameters
    ----------
    labels
        A mapping from names of shapes to labels; a pandas series or frame of one column, whose
        index names the shapes; or a list or array of labels in the order of the shapes.

    Returns
    -------
    dict of str to str, or list of str
        Class of each shape, by its name if the labels have names, else in order.

    Raises
    ------
    ConfigurationError
        If the labels or names are no plain values, some shapes have no label, or two have one name.
    """
    has_names = hasattr(labels, "items")
    if not has_names:
        values = scalars_of(labels, "label")
        return _classes(values, [f"row {row}" for row in range(1, len(values) + 1)])
    is_frame = hasattr(labels, "columns")
    if is_frame:
        n_columns = len(labels.columns)
        if n_columns != 1:
            problem = f"the labels are a frame of {n_columns} columns"
            raise ConfigurationError(problem, "pass the column of the labels: frame['label']")
        labels = labels[labels.columns[0]]
    pairs = list(labels.items())
    names = names_of([name for name, _ in pairs])
    check_names(names)
    values = scalars_of([label for _, label in pairs], "label")
    return dict(zip(names, _classes(values, names), strict=True))


def check_names(names: Sequence[str], hint: str = "name each shape once") -> None:
    """Raise ``ConfigurationError`` at the first name that stands there twice."""
    seen = set[str]()
    for name in names:
        if name in seen:
            raise ConfigurationError(f"it names a shape twice, '{name}'", hint)
        seen.add(name)


def _classes(labels: Sequence[Scalar], names: Sequence[str]) -> list[str]:
    """Return the class of each shape as text.

    Parameters
    ----------
    labels
        Label of each shape; None if it has none. The label -1 means a class of its own.
    names
        Name of each shape.

    Raises
    ------
    ConfigurationError
        If shapes have no label, or two labels differ in spelling alone.
    """
    classes = []
    missing = []
    for label, name in zip(labels, names, strict=True):
        if label is None or _says_none(label):
            missing.append(name)
        else:
            classes.append(class_name(label, name))
    if missing:
        problem = f"shapes without a label: {len(missing)}, the first is '{missing[0]}'"
        raise ConfigurationError(problem, "label them, or with -1 if they are of no class")
    _check_spellings(classes)
    return classes


def _check_spellings(classes: Iterable[str]) -> None:
    """Raise ``ConfigurationError`` if two classes are one number in two spellings.

    Such are 7.5 and 7.50, or 1 and 01: nobody can know whether they mean one class. The same holds
    for -01, which may mean that there is no class.
    """
    first_spelling = {float(MISCELLANEOUS): MISCELLANEOUS}
    for name in dict.fromkeys(classes):
        try:
            # For Python, 1_0 is the number 10; as a label, it is a text.
            number = float(name.replace("_", "?").replace(_MINUS, "-"))
        except ValueError:
            continue
        other = first_spelling.setdefault(number, name)
        if other != name:
            problem = f"'{other}' and '{name}' may be one class or two"
            raise ConfigurationError(problem, "write one number in one way")


def spelled_alike(classes: Iterable[str]) -> list[str]:
    """Return the pairs of classes whose names differ in case, blanks, hyphens or underscores alone.

    Each pair is a text: "'Cat' and 'cat'". Shapes of class -1 have no class whose name may be
    wrong.
    """
    first_spelling: dict[str, str] = {}
    pairs = []
    for name in dict.fromkeys(classes):
        if name.startswith(f"{MISCELLANEOUS} "):
            continue
        plain = re.sub(r"[\s_-]+", " ", name).strip().casefold()
        first = first_spelling.setdefault(plain, name)
        if first != name:
            pairs.append(f"'{first}' and '{name}'")
    return pairs


def _says_none(label: bool | int | float | str) -> bool:
    """Return whether a text says that there is no label."""
    text = text_of(label)
    return text.lower() in _MISSING or not any(character.isalnum() for character in text)


# Text
# --------------------------------------------------------------------------------------------


def read_labels(path: Path) -> dict[str, str] | list[str]:
    """Read text with lines ``label`` or ``name label``: the classes in order, or by name.

    A first line such as ``name,label``, as pandas writes, names the columns.

    Raises
    ------
    ConfigurationError
        If it is no such text, several separators divide it, it names a shape twice, or gives one no
        label.
    """
    with named_errors(path, "list of labels", ConfigurationError, _ON_EACH_LINE):
        lines = lines_of(read_file(path, LARGEST_LIST))
        _check_title(lines[0])
        rows = _without_header(_rows_of(lines))
        if len(rows[0]) == 1:
            return classes_of([label for (label,) in rows])
        names = names_of([name for name, _ in rows])
        check_names(names, f"name each shape once; if these are labels alone, {_QUOTES}")
        return classes_of(dict(zip(names, (label for _, label in rows), strict=True)))


def _rows_of(lines: Sequence[str]) -> TextRows:
    """Split the lines of a table into cells, one or two per line.

    The separator is the one that divides all lines into the same number of cells.

    Parameters
    ----------
    lines
        The lines, at least one.

    Raises
    ------
    ConfigurationError
        If several separators fit and give different cells, or a line has another number of cells.
    """
    rows_by_separator = {
        separator: cells_of(lines, separator) for separator in separators_of(lines)
    }
    # Several separators may fit, but they must give the same cells.
    different = {str(rows): separator for separator, rows in rows_by_separator.items()}
    if len(different) > 1:
        raise ambiguous(list(different.values()))
    if rows_by_separator:
        rows, *_ = rows_by_separator.values()
        n_cells = len(rows[0])
        if n_cells <= 2:
            return rows
        hint = _ON_EACH_LINE
        if rows[0][0] == "":
            hint = f"{hint}, without row numbers (index=False in pandas)"
        raise ConfigurationError(f"it has lines of {n_cells} words", hint)
    # No separator fits: each line is one label, unless some lines hold a separator.
    if not any(map(holds_separator, lines)):
        return cells_of(lines, ";")
    widths = {len(row) for row in cells_of(lines, usual_separator(lines))}
    problem = f"it has lines of {' and '.join(map(str, sorted(widths)))} words"
    raise ConfigurationError(problem, f"{_ON_EACH_LINE}, and {_QUOTES}")


def _check_title(line: str) -> None:
    """Raise ``ConfigurationError`` if the first line is one word that may be a title or a class."""
    word = line.rstrip(' \t;,"').lstrip(' "')  # a separator before it would begin a second column
    if word.lower() in _LABELS:
        problem = f"its first line, '{line.strip()}', may name the columns"
        raise ConfigurationError(problem, "delete it, or let it begin with '#'")


def _without_header(rows: TextRows) -> TextRows:
    """Return the rows of a table without the first one, if that names its columns.

    Parameters
    ----------
    rows
        Cells of each row: one, the label, or two, the name of a shape and its label.

    Raises
    ------
    ConfigurationError
        If the header says that labels come first, or there is nothing but a header.
    """
    has_names = len(rows[0]) == 2
    if not has_names:
        return rows
    first, second = (cell.lower() for cell in rows[0])
    if first in _LABELS and second in _NAMES:
        problem = f"its first line is '{','.join(rows[0])}', labels first"
        raise ConfigurationError(problem, "write the name before the label")
    is_header = first in _NAMES and second in _LABELS
    is_header_of_pandas = not first and second in _UNNAMED
    if not (is_header or is_header_of_pandas):
        return rows
    if len(rows) == 1:
        raise ConfigurationError("it has no line but its header", _ON_EACH_LINE)
    return rows[1:]
