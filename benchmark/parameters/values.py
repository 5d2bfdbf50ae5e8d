"""The parameters of a method: which values each may have, how they are read from text, checked and written.

A parameter is a field of a dataclass that its maker takes. Its type says what kind of value it is, ``Literal`` which
ones there are, and a constraint (:mod:`benchmark.parameters.constraints`) beside the type what else must hold::

    iterations: Annotated[int, Interval(1)] = 20
    start: Literal["mesh", "classic"] = "mesh"

A field that declares nothing but its type takes every value of that type.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import math
import sys
import types
import typing
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal

import numpy as np

from benchmark.errors import ConfigurationError, did_you_mean
from benchmark.parameters.constraints import Constraint, Interval, OneOf

__all__ = [
    "CheckedParameters",
    "assignments",
    "checked",
    "declared_parameters",
    "format_value",
    "non_default_values",
    "parameter_values",
]

#: Types of one value that can be written as a word.
_WORDS: Mapping[Any, str] = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}

_TRUTH = {"true": True, "false": False}


class _Unfit(Exception):
    """A value does not fit; tells what would, and the choices where there are some."""

    def __init__(self, words: str, choices: Iterable[str] = ()) -> None:
        super().__init__(words)
        self.choices = tuple(choices)


class CheckedParameters:
    """A base of a frozen dataclass that checks its parameters, and normalises them, whenever one is made."""

    def __post_init__(self) -> None:
        given = {name: getattr(self, name) for name in declared_parameters(type(self))}
        for name, value in checked(type(self), given).items():
            object.__setattr__(self, name, value)


def checked(cls: type[Any], given: Mapping[str, Any], owner: str = "") -> dict[str, Any]:
    """Read, check and normalise parameters.

    Parameters
    ----------
    cls
        The dataclass that they are for.
    given
        Values by name, as text or as they are; text is read according to the type of the field.
    owner
        What to call the class in messages: by default the name of the method.

    Returns
    -------
    dict
        The same parameters, each with the one value that all ways to write it stand for.

    Raises
    ------
    ConfigurationError
        If there is no such parameter, or a value does not fit.
    """
    owner = owner or getattr(getattr(cls, "info", None), "name", cls.__name__)
    fields = declared_parameters(cls)
    found = {}
    for name, value in given.items():
        if name not in fields:
            if fields:
                raise did_you_mean(f"parameter of {owner}", name, fields)
            raise ConfigurationError(
                f"unknown parameter of {owner} '{name}'", f"leave it out: {owner} has no parameters"
            )
        annotation, default = fields[name]
        try:
            found[name] = _fit(annotation, value, default)
        except _Unfit as unfit:
            if unfit.choices and isinstance(value, str):
                raise did_you_mean(f"{name} of {owner}", value, unfit.choices) from None
            raise ConfigurationError(f"'{value}' does not fit {name} of {owner}", f"write {unfit}") from None
    return found


def non_default_values(cls: type[Any], given: Mapping[str, Any], owner: str = "") -> dict[str, Any]:
    """Those of some parameters that differ from their defaults, checked, in the order of the fields.

    See :func:`checked`.
    """
    values = checked(cls, given, owner)
    return {
        name: values[name]
        for name, (annotation, default) in declared_parameters(cls).items()
        if name in values and values[name] != _normalised(annotation, default)
    }


def parameter_values(made: Any) -> dict[str, Any]:
    """All parameters of an object that was made of a dataclass, normalised; none of an object of another class."""
    fields = declared_parameters(type(made))
    return {name: _normalised(annotation, getattr(made, name)) for name, (annotation, _) in fields.items()}


def format_value(value: Any) -> str:
    """Text that is read as the value."""
    if isinstance(value, tuple | list):
        return f"({','.join(map(format_value, value))})"
    if value is None or isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else str(value)


def assignments(texts: str | Iterable[str]) -> dict[str, str]:
    """Values by name from several ``name=value``: a list of them, or one text with commas between them.

    Raises
    ------
    ConfigurationError
        If one has no name or no value, or two have one name.
    """
    found: dict[str, str] = {}
    for text in _split(texts) if isinstance(texts, str) else texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals):
            raise ConfigurationError(f"'{text.strip()}' has no {'value' if name else 'name'}", "write NAME=VALUE")
        if name in found:
            raise ConfigurationError(f"'{name}' is given twice", "leave one of them out")
        found[name] = value
    return found


def _split(text: str) -> list[str]:
    """Parts of a text between commas, but not between those in parentheses; none of an empty text."""
    parts, depth = [""], 0
    for character in text:
        depth += {"(": 1, ")": -1}.get(character, 0)
        if character == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return parts if text.strip() else []


def declared_parameters(cls: type[Any]) -> dict[str, tuple[Any, Any]]:
    """Annotation and default of each parameter of a class, in the order of its fields."""
    if not dataclasses.is_dataclass(cls):
        return {}
    found: dict[str, tuple[Any, Any]] = {}
    for field in dataclasses.fields(cls):
        if field.init:
            default = field.default
            if field.default_factory is not dataclasses.MISSING:
                default = field.default_factory()
            found[field.name] = (_annotation(cls, field), default)
    return found


@functools.cache
def _annotation(cls: type[Any], field: dataclasses.Field[Any]) -> Any:
    """Type of a field with its constraints; where a name in it is not known at run time, its text."""
    if not isinstance(field.type, str):
        return field.type
    home = next((base for base in cls.__mro__ if field.name in inspect.get_annotations(base)), cls)
    holder = types.SimpleNamespace(__annotations__={field.name: field.type})
    names = vars(sys.modules[home.__module__]) if home.__module__ in sys.modules else {}
    try:
        return typing.get_type_hints(holder, names, dict(vars(home)), include_extras=True)[field.name]
    except Exception:
        return field.type


def _normalised(annotation: Any, value: Any) -> Any:
    """Return what a value stands for; one that its author gave is not otherwise doubted."""
    try:
        return _fit(annotation, value, value)
    except _Unfit:
        return value


def _fit(annotation: Any, value: Any, default: Any) -> Any:
    """The value as its type and constraints want it, or ``_Unfit``; a default helps where the type says too little."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        for constraint in arguments[1:]:
            if isinstance(constraint, Constraint):
                value = _fit_constrained(arguments[0], constraint, value, default)
        return _fit(arguments[0], value, default)
    if origin is Literal:
        known = {format_value(choice): choice for choice in arguments}
        if value not in arguments and str(value) not in known:
            raise _Unfit(" or ".join(known), known)
        return value if value in arguments else known[str(value)]
    if origin in (typing.Union, types.UnionType):
        return _fit_any(arguments, value, default)
    if origin is tuple or annotation is tuple:
        return _fit_tuple(arguments, value, default)
    if annotation in _WORDS:
        return _fit_one(annotation, value)
    if default is None or default is dataclasses.MISSING:
        return value
    return _fit_tuple((), value, default) if isinstance(default, tuple) else _fit_one(type(default), value)


def _fit_constrained(annotation: Any, constraint: Constraint, value: Any, default: Any) -> Any:
    """The value as its type and one constraint want it; what would fit is told in the words of both."""
    try:
        fitted = _fit(annotation, value, default)
        return fitted if fitted is None else constraint.admit(fitted)
    except (_Unfit, ValueError, TypeError, OverflowError):
        if isinstance(constraint, OneOf):
            raise _Unfit(str(constraint), constraint.known) from None
        kind = f"{_WORDS.get(annotation, 'a value')} " if isinstance(constraint, Interval) else ""
        raise _Unfit(f"{kind}{constraint}") from None


def _fit_any(annotations: Iterable[Any], value: Any, default: Any) -> Any:
    """The value as the first of several types wants it."""
    words: list[str] = []
    for annotation in annotations:
        if annotation is type(None):
            if value is None or (isinstance(value, str) and value.lower() == "none"):
                return None
            words.append("none")
            continue
        try:
            return _fit(annotation, value, default)
        except _Unfit as unfit:
            words.append(str(unfit))
    raise _Unfit(" or ".join(words))


def _fit_tuple(arguments: tuple[Any, ...], value: Any, default: Any) -> tuple[Any, ...]:
    """A tuple from one, or from text: values with commas between them, in parentheses or not."""
    if isinstance(value, str):
        text = value.strip()
        inner = text[1:-1] if text.startswith("(") and text.endswith(")") else text
        value = tuple(part.strip() for part in _split(inner.removesuffix(",")))
    if not isinstance(value, tuple | list):
        raise _Unfit("values in parentheses, with commas between them")
    first = default[0] if isinstance(default, tuple) and default else None
    if not arguments:
        arguments = (Any if first is None else type(first), ...)
    if arguments[-1] is Ellipsis:
        arguments = arguments[:1] * len(value)
    if len(value) != len(arguments):
        raise _Unfit(f"{len(arguments)} values in parentheses, with commas between them")
    try:
        return tuple(_fit(annotation, part, first) for annotation, part in zip(arguments, value, strict=True))
    except _Unfit as unfit:
        raise _Unfit(f"{unfit} for each of several values in parentheses, with commas between them") from None


def _fit_one(kind: Any, value: Any) -> Any:
    """One value of a type, from text or as it is."""
    if isinstance(value, np.generic):
        value = value.item()
    if kind is bool:
        truth = _TRUTH.get(value.lower()) if isinstance(value, str) else value
        if not isinstance(truth, bool):
            raise _Unfit(_WORDS[bool])
        return truth
    if kind in (int, float):
        return _number(kind, value)
    if isinstance(value, kind):
        return value
    if kind in (str, list, set, frozenset, dict) or not isinstance(value, str):
        raise _Unfit(_WORDS.get(kind, f"a {kind.__name__} in Python: no text stands for one"))
    try:
        return kind(value)
    except Exception:
        raise _Unfit(f"a {kind.__name__}") from None


def _number(kind: type[int] | type[float], value: Any) -> int | float:
    """A number, not NaN; a whole one may be written as 2.0 or 1e3."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise _Unfit(_WORDS[kind])
    try:
        if kind is int and (isinstance(value, int) or (isinstance(value, str) and value.strip(" +-").isdecimal())):
            return int(value)
        number = float(value)
        if math.isnan(number) or (kind is int and not number.is_integer()):
            raise _Unfit(_WORDS[kind])
        return kind(number) + 0  # so that -0.0 is 0.0
    except (ValueError, OverflowError):
        raise _Unfit(_WORDS[kind]) from None
