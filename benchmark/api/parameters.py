"""Parameters of methods: accepted values, conversion from and to text, and checks.

A parameter is a field of a dataclass. Its type determines the kind of value, ``Literal`` lists the accepted values, and
``Annotated`` adds a constraint to the type::

    iterations: Annotated[int, Interval(1)] = 20
    start: Literal["mesh", "classic"] = "mesh"

A field that declares only its type accepts every value of that type except NaN.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import math
import re
import sys
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from types import NoneType
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from benchmark.errors import ConfigurationError, did_you_mean

_WITH_LOW, _WITH_HIGH = ("both", "left"), ("both", "right")


@dataclass(frozen=True)
class Interval:
    """Finite numbers between two bounds.

    Parameters
    ----------
    low, high
        Bounds; None for no bound.
    closed
        Bounds that belong to the interval: ``"both"``, ``"left"``, ``"right"`` or ``"neither"``.
    """

    low: float | None = None
    high: float | None = None
    closed: Literal["both", "left", "right", "neither"] = "both"

    def admit(self, value: Any) -> Any:
        """Return the value if it lies inside, or raise ``ValueError``."""
        low, high = (-math.inf if self.low is None else self.low), (math.inf if self.high is None else self.high)
        on_bound = (value == low and self.closed in _WITH_LOW) or (value == high and self.closed in _WITH_HIGH)
        if not (math.isfinite(value) and (low < value < high or on_bound)):
            raise ValueError
        return value

    def __str__(self) -> str:
        low = "" if self.low is None else f"{'of at least' if self.closed in _WITH_LOW else 'above'} {self.low:g}"
        high = "" if self.high is None else f"{'of at most' if self.closed in _WITH_HIGH else 'below'} {self.high:g}"
        return " and ".join(filter(None, (low, high))) or "that is finite"


Names = Iterable[str] | Mapping[str, str]


@dataclass(frozen=True)
class OneOf:
    """One of the names known when the parameter is checked.

    Parameters
    ----------
    names
        The names, a mapping from accepted spellings to names, or a function that returns either, to defer expensive
        imports.
    """

    names: Names | Callable[[], Names]

    @property
    def known(self) -> Mapping[str, str]:
        """Names by accepted spelling."""
        names = self.names() if callable(self.names) else self.names
        return names if isinstance(names, Mapping) else {name: name for name in names}

    def admit(self, value: Any) -> Any:
        """Return the name for a spelling, or raise ``ValueError``."""
        if value not in (known := self.known):
            raise ValueError
        return known[value]

    def __str__(self) -> str:
        return " or ".join(self.known)


@dataclass(frozen=True)
class Matches:
    """Text that matches a pattern.

    Parameters
    ----------
    pattern
        Regular expression for the whole text.
    words
        Description of such text.
    """

    pattern: str
    words: str

    def admit(self, value: Any) -> Any:
        """Return the value if it matches, or raise ``ValueError``."""
        if not re.fullmatch(self.pattern, value):
            raise ValueError
        return value

    def __str__(self) -> str:
        return self.words


#: Constraints on a value in addition to its type. Each has ``admit``; as text, it describes the accepted values.
_CONSTRAINTS = (Interval, OneOf, Matches)

#: Descriptions of the types of single values.
_WORDS: Mapping[Any, str] = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}

#: Errors raised by a value that does not fit its type.
_UNFIT = (ValueError, TypeError, OverflowError, KeyError)

_QUOTES = "'\""
_UNIONS = (typing.Union, types.UnionType)


class CheckedParameters:
    """Base class of frozen dataclasses that checks and normalises the parameters of each instance."""

    def __post_init__(self) -> None:
        values = {name: getattr(self, name) for name in declared_parameters(type(self))}
        for name, value in checked(type(self), values).items():
            object.__setattr__(self, name, value)


def checked(cls: type[Any], given: Mapping[str, Any], owner: str = "") -> dict[str, Any]:
    """Read, check and normalise parameters.

    Parameters
    ----------
    cls
        Dataclass with the parameters.
    given
        Values by name, as text or as objects; text is converted to the type of the field.
    owner
        Name of the class in messages; by default, the name of the method.

    Returns
    -------
    dict
        The parameters with normalised values: all spellings of a value give the same one.

    Raises
    ------
    ConfigurationError
        If a parameter is unknown, or a value does not fit.
    """
    owner = owner or getattr(getattr(cls, "info", None), "name", cls.__name__)
    fields = declared_parameters(cls)
    values = {}
    for name, value in given.items():
        if not fields:
            hint = f"leave it out: {owner} has no parameters"
            raise ConfigurationError(f"unknown parameter of {owner} '{name}'", hint)
        if name not in fields:
            raise did_you_mean(f"parameter of {owner}", name, fields)
        annotation, default = fields[name]
        try:
            values[name] = _fit(annotation, value, default)
        except _UNFIT:
            if isinstance(value, str) and (choices := _choices(annotation)):
                raise did_you_mean(f"{name} of {owner}", value, choices) from None
            words = values_in_words(annotation, default)
            raise ConfigurationError(f"'{value}' does not fit {name} of {owner}", f"write {words}") from None
    return values


def non_default_values(cls: type[Any], given: Mapping[str, Any], owner: str = "") -> dict[str, Any]:
    """Return the parameters that differ from their defaults, checked, in the order of the fields.

    See :func:`checked`.
    """
    values = checked(cls, given, owner)
    return {
        name: values[name]
        for name, (annotation, default) in declared_parameters(cls).items()
        if name in values and values[name] != _normalised(annotation, default)
    }


def parameter_values(instance: Any) -> dict[str, Any]:
    """Return all parameters of an instance of a dataclass, normalised; empty for any other object."""
    fields = declared_parameters(type(instance))
    return {name: _normalised(annotation, getattr(instance, name)) for name, (annotation, _) in fields.items()}


def format_value(value: Any) -> str:
    """Return the text from which the value is read."""
    if isinstance(value, tuple | list):
        return f"({','.join(map(format_value, value))})"
    if value is None or isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else str(value)


def assignments(texts: str | Iterable[str]) -> dict[str, str]:
    """Return values by name from several ``name=value``: a list, or one text with commas between them.

    Raises
    ------
    ConfigurationError
        If a name or a value is missing, or a name appears twice.
    """
    values: dict[str, str] = {}
    for text in split(texts) if isinstance(texts, str) else texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals):
            raise ConfigurationError(f"'{text.strip()}' has no {'value' if name else 'name'}", "write NAME=VALUE")
        if name in values:
            raise ConfigurationError(f"'{name}' is given twice", "leave one of them out")
        values[name] = value
    return values


def split(text: str, separator: str = ",") -> list[str]:
    """Split text at the separators outside quotes and parentheses; blank text has no parts.

    Raises
    ------
    ConfigurationError
        If quotes or parentheses are not balanced.
    """
    parts, quote, depth = [""], "", 0
    for place, character in enumerate(text):
        if quote:
            quote = "" if character == quote else quote
        elif character in _QUOTES and text[:place].rstrip()[-1:] in ("", "=", "|", ",", "("):
            quote = character  # elsewhere, it is an apostrophe
        else:
            depth += {"(": 1, ")": -1}.get(character, 0)
        if character == separator and not quote and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    if quote or depth:
        raise ConfigurationError(
            f"'{text}' has {'a quote' if quote else 'a parenthesis'} without its other half", "close what is opened"
        )
    return parts if text.strip() else []


def declared_parameters(cls: type[Any]) -> dict[str, tuple[Any, Any]]:
    """Return annotation and default of each parameter of a class, in the order of its fields."""
    if not dataclasses.is_dataclass(cls):
        return {}
    return {
        field.name: (
            _annotation(cls, field),
            field.default if field.default_factory is dataclasses.MISSING else field.default_factory(),
        )
        for field in dataclasses.fields(cls)
        if field.init
    }


@functools.cache
def _annotation(cls: type[Any], field: dataclasses.Field[Any]) -> Any:
    """Return the type of a field with its constraints, or its text if a name in it is unknown at run time."""
    if not isinstance(field.type, str):
        return field.type
    home = next((base for base in cls.__mro__ if field.name in inspect.get_annotations(base)), cls)
    holder = types.SimpleNamespace(__annotations__={field.name: field.type})
    names = vars(sys.modules[home.__module__]) if home.__module__ in sys.modules else {}
    try:
        return typing.get_type_hints(holder, names, dict(vars(home)), include_extras=True)[field.name]
    except Exception:
        return field.type


def values_in_words(annotation: Any, default: Any = None) -> str:
    """Describe the values that a type with constraints accepts; a default helps if the type is not specific."""
    annotation = _kind(annotation, default)
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        base = values_in_words(arguments[0], default)
        limits = [limit for limit in arguments[1:] if isinstance(limit, _CONSTRAINTS)]
        return " and ".join(f"{base} {part}" if isinstance(part, Interval) else str(part) for part in limits) or base
    if origin is Literal:
        return " or ".join(map(format_value, arguments))
    if origin in _UNIONS:
        return " or ".join("none" if kind is NoneType else values_in_words(kind) for kind in arguments)
    if origin is tuple:
        inner = [kind for kind in arguments if kind is not Ellipsis]
        count = "values" if Ellipsis in arguments else f"{len(inner)} values"
        kind = f", each {values_in_words(inner[0])}" if len(set(inner)) == 1 and inner[0] is not Any else ""
        return f"{count} in parentheses{kind}"
    name = getattr(annotation, "__name__", str(annotation))
    return _WORDS.get(annotation) or f"a {name}{'' if origin is None else ' in Python: no text stands for one'}"


def _kind(annotation: Any, default: Any) -> Any:
    """Return the type, or that of the default if the type is not specific."""
    if isinstance(annotation, str) or annotation in (Any, object):
        annotation = Any if default is None or default is dataclasses.MISSING else type(default)
    if annotation is tuple:
        return tuple[type(default[0]) if isinstance(default, tuple) and default else Any, ...]  # type: ignore[misc]
    return annotation


def _choices(annotation: Any) -> Iterable[str]:
    """Return the names that a type or its constraints list; empty if there are none."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        return next((limit.known for limit in arguments if isinstance(limit, OneOf)), _choices(arguments[0]))
    return list(map(format_value, arguments)) if origin is Literal else ()


def _normalised(annotation: Any, value: Any) -> Any:
    """Return the normalised value; a value set by an author is returned as it is if it does not fit."""
    try:
        return _fit(annotation, value, value)
    except _UNFIT:
        return value


def _fit(annotation: Any, value: Any, default: Any) -> Any:
    """Convert a value to a type with constraints; a default helps if the type is not specific.

    Raises
    ------
    ValueError, TypeError, OverflowError, KeyError
        If it does not fit.
    """
    annotation = _kind(annotation, default)
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        fitted = _fit(arguments[0], value, default)
        for limit in arguments[1:]:
            fitted = limit.admit(fitted) if isinstance(limit, _CONSTRAINTS) and fitted is not None else fitted
        return fitted
    if origin is Literal:
        return value if value in arguments else {format_value(choice): choice for choice in arguments}[str(value)]
    if origin in _UNIONS:
        if NoneType in arguments and (value is None or (isinstance(value, str) and value.lower() == "none")):
            return None
        for kind in arguments:
            with suppress(*_UNFIT):
                return _fit(kind, value, default)
        raise ValueError
    return _fit_tuple(arguments, value) if origin is tuple else _converted(value, annotation)


def _fit_tuple(kinds: tuple[Any, ...], value: Any) -> tuple[Any, ...]:
    """Convert a tuple, a list, or text: values with commas between them, with or without parentheses."""
    if isinstance(value, str):
        text = value.strip()
        inner = text[1:-1] if text.startswith("(") and text.endswith(")") else text
        value = tuple(part.strip() for part in split(inner.removesuffix(",")))
    if not isinstance(value, tuple | list):
        raise TypeError
    kinds = kinds[:1] * len(value) if kinds[-1:] == (Ellipsis,) else kinds
    return tuple(_fit(kind, part, None) for kind, part in zip(kinds, value, strict=True))


def _converted(value: Any, kind: Any) -> Any:
    """Convert text or an object to a type; NaN is rejected, and an integer may be written as 2.0 or 1e3."""
    value = value.item() if isinstance(value, np.generic) else value
    is_text = isinstance(value, str) and kind is not str
    value = value.strip() if is_text else value
    if is_text and kind in (int, float):  # accepted by Python, but not by JSON: .5, +7, 012
        value = int(value) if kind is int and value.strip(" +-").isdecimal() else float(value)
    converted = msgspec.convert(value, kind, strict=kind is bool and not is_text, dec_hook=_of_its_kind)
    if kind is float:
        converted += 0.0  # so that -0.0 is 0.0
    if converted != converted:
        raise ValueError
    return converted


def _of_its_kind(kind: type[Any], value: Any) -> Any:
    """Convert text to a type that only its own class can parse."""
    if not isinstance(value, str):
        raise TypeError
    return kind(value)
