"""Parameters of methods: accepted values, conversion from and to text, and checks.

A parameter is a field of a dataclass. Its type determines the kind of value, ``Literal`` lists the accepted values, and
``Annotated`` adds a constraint to the type::

    iterations: Annotated[int, Interval(1)] = 20
    weights: Literal["uniform", "cotangent"] = "cotangent"
"""

from __future__ import annotations

import dataclasses
import math
import re
import types
import typing
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from types import NoneType
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from benchmark.errors import ConfigurationError, did_you_mean


@dataclass(frozen=True)
class Interval:
    """Finite numbers between two bounds.

    Parameters
    ----------
    low, high
        Bounds; infinite for no bound.
    closed
        Bounds that belong to the interval: ``"both"``, ``"left"``, ``"right"`` or ``"neither"``.
    """

    low: float = -math.inf
    high: float = math.inf
    closed: Literal["both", "left", "right", "neither"] = "both"

    def admits(self, value: float) -> bool:
        """Return whether a number lies inside."""
        on_bound = self.closed in ("both", "left" if value == self.low else "right")
        return math.isfinite(value) and (self.low < value < self.high or (value in (self.low, self.high) and on_bound))

    def __str__(self) -> str:
        low = f"{'of at least' if self.closed in ('both', 'left') else 'above'} {self.low:g}"
        high = f"{'of at most' if self.closed in ('both', 'right') else 'below'} {self.high:g}"
        return " and ".join(words for words in (low, high) if "inf" not in words) or "that is finite"


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

    def admits(self, value: str) -> bool:
        """Return whether a text matches."""
        return re.fullmatch(self.pattern, value) is not None

    def __str__(self) -> str:
        return self.words


_WORDS: Mapping[Any, str] = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}
_UNIONS = (typing.Union, types.UnionType)
_QUOTES = "'\""

#: Errors raised by a value that does not fit its type.
_UNFIT = (ValueError, TypeError, OverflowError, msgspec.ValidationError)


class CheckedParameters:
    """Base class of frozen dataclasses that checks and normalises the parameters of each instance."""

    def __post_init__(self) -> None:
        for name, value in checked(type(self), parameter_values(self)).items():
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
        if name not in fields:
            if fields:
                raise did_you_mean(f"parameter of {owner}", name, fields)
            raise ConfigurationError(f"unknown parameter of {owner} '{name}'", f"leave it out: {owner} has none")
        annotation, _ = fields[name]
        try:
            values[name] = _fit(annotation, value)
        except _UNFIT:
            if isinstance(value, str) and typing.get_origin(annotation) is Literal:
                choices = map(format_value, typing.get_args(annotation))
                raise did_you_mean(f"{name} of {owner}", value, choices) from None
            problem = f"'{value}' does not fit {name} of {owner}"
            raise ConfigurationError(problem, f"write {values_in_words(annotation)}") from None
    return values


def non_default_values(cls: type[Any], given: Mapping[str, Any], owner: str = "") -> dict[str, Any]:
    """Return the parameters that differ from their defaults, in the order of the fields; see :func:`checked`."""
    values, fields = checked(cls, given, owner), declared_parameters(cls)
    defaults = {name: default for name, (_, default) in fields.items() if default is not dataclasses.MISSING}
    defaults = checked(cls, {name: defaults[name] for name in values if name in defaults}, owner)
    return {name: values[name] for name in fields if name in values and repr(values[name]) != repr(defaults.get(name))}


def parameter_values(instance: Any) -> dict[str, Any]:
    """Return all parameters of an instance of a dataclass; empty for any other object."""
    return {name: getattr(instance, name) for name in declared_parameters(type(instance))}


def declared_parameters(cls: type[Any]) -> dict[str, tuple[Any, Any]]:
    """Return type and default of each parameter of a dataclass, in the order of its fields; none for another class."""
    if not dataclasses.is_dataclass(cls):
        return {}
    hints = _type_hints(cls)
    return {
        field.name: (
            hints[field.name],
            field.default if field.default_factory is dataclasses.MISSING else field.default_factory(),
        )
        for field in dataclasses.fields(cls)
        if field.init
    }


@cache
def _type_hints(cls: type[Any]) -> dict[str, Any]:
    try:
        return typing.get_type_hints(cls, include_extras=True)
    except NameError as error:
        problem = f"a type of {cls.__name__} is unknown: {error}"
        raise ConfigurationError(problem, "import it outside of 'if TYPE_CHECKING'") from error


# Text ----------------------------------------------------------------------------------------------------------------


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
    for position, character in enumerate(text):
        if quote:
            quote = "" if character == quote else quote
        elif character in _QUOTES and text[:position].rstrip()[-1:] in ("", "=", "|", ",", "("):
            quote = character  # elsewhere, it is an apostrophe
        else:
            depth += {"(": 1, ")": -1}.get(character, 0)
        if character == separator and not quote and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    if quote or depth:
        problem = f"'{text}' has {'a quote' if quote else 'a parenthesis'} without its other half"
        raise ConfigurationError(problem, "close what is opened")
    return parts if text.strip() else []


def values_in_words(annotation: Any) -> str:
    """Describe the values that a type with constraints accepts."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        base, *limits = values_in_words(arguments[0]), *_limits(arguments)
        return (
            " and ".join(f"{base} {limit}" if isinstance(limit, Interval) else str(limit) for limit in limits) or base
        )
    if origin is Literal:
        return " or ".join(map(format_value, arguments))
    if origin in _UNIONS:
        return " or ".join("none" if kind is NoneType else values_in_words(kind) for kind in arguments)
    if origin is tuple:
        count = "values" if Ellipsis in arguments else f"{len(arguments)} values"
        kinds = set(arguments) - {Ellipsis}
        return f"{count} in parentheses" + (f", each {values_in_words(*kinds)}" if len(kinds) == 1 else "")
    return _WORDS.get(annotation) or f"a {getattr(annotation, '__name__', annotation)}"


def _limits(arguments: Iterable[Any]) -> list[Interval | Matches]:
    return [limit for limit in arguments if isinstance(limit, Interval | Matches)]


def _fit(annotation: Any, value: Any) -> Any:
    """Convert a value to a type with constraints; raise an error of ``_UNFIT`` if it does not fit."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        fitted = _fit(arguments[0], value)
        if not all(limit.admits(fitted) for limit in _limits(arguments)):
            raise ValueError
        return fitted
    if origin in _UNIONS:
        for kind in sorted(arguments, key=lambda kind: kind is not NoneType):
            with suppress(*_UNFIT):
                return _fit(kind, value)
        raise ValueError
    if origin is tuple:
        parts = _parts(value) if isinstance(value, str) else tuple(value)
        kinds = arguments[:1] * len(parts) if arguments[-1:] == (Ellipsis,) else arguments
        return tuple(_fit(kind, part) for kind, part in zip(kinds, parts, strict=True))
    return _convert(annotation, value)


def _parts(text: str) -> list[str]:
    """Return the values of a tuple: with commas between them, with or without parentheses."""
    text = text.strip()
    inner = text[1:-1] if text.startswith("(") and text.endswith(")") else text
    return [part.strip() for part in split(inner.removesuffix(","))]


def _convert(kind: Any, value: Any) -> Any:
    """Convert text or an object to a type; NaN is rejected, and an integer may be written as 2.0 or 1e3."""
    value = value.item() if isinstance(value, np.generic) else value
    if kind in (int, float) and isinstance(value, str):  # Python reads more than JSON: .5, +7, 012
        value = int(value) if kind is int and value.strip(" +-").isdecimal() else float(value)
    if kind is NoneType and str(value).lower() == "none":
        return None
    is_strict = kind is bool and not isinstance(value, str)
    if isinstance(value, str) and not value.isprintable():  # it becomes part of names
        raise ValueError
    converted = msgspec.convert(value, kind, strict=is_strict, dec_hook=lambda kind, text: kind(text))
    if converted != converted:
        raise ValueError
    return converted + 0.0 if kind is float else converted  # so that -0.0 is 0.0
