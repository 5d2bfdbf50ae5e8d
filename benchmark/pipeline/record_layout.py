"""The layout of records: its version, older records, and what newer ones hold besides.

A release reads the layouts of its own major version, and converts older ones. A later minor version
adds fields; these are kept where they stand when the record is written again.
"""

from __future__ import annotations

import types
from collections.abc import Mapping
from functools import cache
from typing import Any, Union, get_args, get_origin

import msgspec

from benchmark.errors import BenchmarkError

#: Major and minor version of the layout that this release writes.
LAYOUT = (1, 1)

#: Field of the layout in a file. Records before layout 1.0 lack it.
LAYOUT_FIELD = "layout"

#: Fields that every record of release 0.2 has, and no later one.
_FIELDS_OF_0_2 = ("recipe", "target")

#: Name of the field of each part of a record that holds its unknown fields; no file has it.
_UNKNOWN = "unknown"


class RecordError(BenchmarkError):
    """A file or line that is not used as a record."""


class NewerRecord(RecordError):
    """A record in a newer major version of the layout, which this release leaves alone."""


def layout_in_words(layout: tuple[int, int]) -> str:
    """Return a version as text."""
    return f"{layout[0]}.{layout[1]}"


def layout_of(content: Mapping[str, Any]) -> tuple[int, int] | None:
    """Return the version of the layout of a record, as major and minor number.

    Parameters
    ----------
    content
        A record as it was read from JSON.

    Returns
    -------
    tuple of int or None
        None for records from before layout 1.0, which do not say it.

    Raises
    ------
    RecordError
        If it is not a pair of numbers.
    """
    if LAYOUT_FIELD not in content:
        return None
    numbers = content[LAYOUT_FIELD]
    are_numbers = isinstance(numbers, list) and all(type(number) is int for number in numbers)
    if are_numbers and len(numbers) == 2:
        major, minor = numbers
        if major >= 1 and minor >= 0:
            return major, minor
    problem = "it is not a record: its layout is not [major, minor]"
    raise RecordError(problem, "run its job again or remove it")


def check_layout(content: Mapping[str, Any]) -> None:
    """Raise ``NewerRecord`` if this release cannot read the layout of a record."""
    layout = layout_of(content)
    if layout and layout[0] > LAYOUT[0]:
        problem = f"its layout, {layout_in_words(layout)}, is newer than that of this release"
        hint = f"update the suite, which reads up to {LAYOUT[0]}.x; the record is left as it is"
        raise NewerRecord(f"{problem}, {layout_in_words(LAYOUT)}", hint)


def is_newer(content: Mapping[str, Any]) -> bool:
    """Return whether the layout of a record is newer than that of this release."""
    return (layout_of(content) or LAYOUT) > LAYOUT


def convert_older(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a record in the layout of this release, or in a newer minor one.

    Raises
    ------
    RecordError
        If it is of release 0.2.
    """
    if layout_of(content) is not None:
        return dict(content)
    if all(name in content for name in _FIELDS_OF_0_2):
        problem = (
            "it is of release 0.2, which prepared shapes in another way and did not say which "
            "shapes it ranked, so that its scores stand beside no others"
        )
        raise RecordError(problem, "run its job again; release 0.2 reads it")
    return {LAYOUT_FIELD: [*LAYOUT], **content}


# Unknown fields
# ------------------------------------------------------------------------------------------------


def gather_unknown(content: Any, kind: type[msgspec.Struct]) -> Any:
    """Move fields that this version does not know into a field of their own, so that none is lost.

    Parameters
    ----------
    content
        A record, or a part of one, as it was read from JSON. It is not changed.
    kind
        The type that it will be converted to.

    Returns
    -------
    object
        The content with its known fields, and one more that holds the unknown ones by name. What is
        no JSON object is returned as it is.
    """
    if not isinstance(content, dict):
        return content
    known: dict[str, Any] = {}
    unknown: dict[str, Any] = {}
    types_of_fields = _types_of_fields(kind)
    for name, value in content.items():
        if name not in types_of_fields:
            unknown[name] = value
        else:
            known[name] = _gather_in_field(value, types_of_fields[name])
    return known | {_UNKNOWN: unknown}


def content_of(part: msgspec.Struct) -> dict[str, Any]:
    """Return a part as it stands in a file.

    Fields that have their default are left out, and unknown ones stand among the others.
    """
    content = {}
    for field in msgspec.structs.fields(part):
        value = getattr(part, field.name)
        if field.name != _UNKNOWN and value != _default_of(field):
            content[field.encode_name] = _content_of_field(value)
    unknown: dict[str, Any] = getattr(part, _UNKNOWN)
    return content | unknown


def _content_of_field(value: Any) -> Any:
    """Return the value of a field as it stands in a file."""
    if isinstance(value, msgspec.Struct):
        return content_of(value)
    if isinstance(value, dict):
        return {name: _content_of_field(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_content_of_field(each) for each in value]
    return value


def _default_of(field: msgspec.structs.FieldInfo) -> Any:
    """Return the default of a field."""
    if field.default_factory is not msgspec.NODEFAULT:
        return field.default_factory()
    return field.default


@cache
def _types_of_fields(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """Return the types of the fields of a part by their names in files."""
    fields = msgspec.structs.fields(kind)
    return {field.encode_name: field.type for field in fields if field.name != _UNKNOWN}


def _gather_in_field(value: Any, kind: Any) -> Any:
    """Return the value of a field, with the unknown fields of the parts in it gathered.

    Parameters
    ----------
    value
        Value of the field, as it was read from JSON.
    kind
        Type of the field: a part (a msgspec struct), ``list[Part]``, ``dict[str, Part]`` or ``Part
        | None``. Values of any other type are returned as they are.
    """
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return gather_unknown(value, kind)
    part = _part_in(kind)
    if part is None:
        return value
    if get_origin(kind) is list and isinstance(value, list):
        return [gather_unknown(each, part) for each in value]
    if get_origin(kind) is dict and isinstance(value, dict):
        return {name: gather_unknown(each, part) for name, each in value.items()}
    if get_origin(kind) in (Union, types.UnionType):
        return gather_unknown(value, part)
    return value


@cache
def _part_in(kind: Any) -> type[msgspec.Struct] | None:
    """Return the part of which a type holds one or several; None if it holds none."""
    for argument in get_args(kind):
        if isinstance(argument, type) and issubclass(argument, msgspec.Struct):
            return argument
    return None
