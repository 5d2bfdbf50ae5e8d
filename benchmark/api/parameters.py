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
from collections.abc import Callable, Iterable, Mapping
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
        on_bound = (value == low and self.closed in ("both", "left")) or (
            value == high and self.closed in ("both", "right")
        )
        if not (math.isfinite(value) and (low < value < high or on_bound)):
            raise ValueError
        return value

    def __str__(self) -> str:
        low = (
            "" if self.low is None else f"{'of at least' if self.closed in ('both', 'left') else 'above'} {self.low:g}"
        )
        high = (
            ""
            if self.high is None
            else f"{'of at most' if self.closed in ('both', 'right') else 'below'} {self.high:g}"
        )
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
        """Return the name for a spelling, or raise ``KeyError``."""
        return self.known[value]

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


_CONSTRAINTS = (Interval, OneOf, Matches)
_WORDS: Mapping[Any, str] = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}
_UNIONS = (typing.Union, types.UnionType)
_QUOTES = "'\""

#: Errors raised by a value that does not fit its type.
_UNFIT = (ValueError, TypeError, OverflowError, KeyError, msgspec.ValidationError)


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
            if isinstance(value, str) and (choices := _choices(annotation)):
                raise did_you_mean(f"{name} of {owner}", value, choices) from None
            raise ConfigurationError(
                f"'{value}' does not fit {name} of {owner}", f"write {values_in_words(annotation)}"
            ) from None
    return values


def non_default_values(cls: type[Any], given: Mapping[str, Any], owner: str = "") -> dict[str, Any]:
    """Return the parameters that differ from their defaults, in the order of the fields; see :func:`checked`."""
    values, fields = checked(cls, given, owner), declared_parameters(cls)
    defaults = {name: default for name, (_, default) in fields.items() if default is not dataclasses.MISSING}
    defaults = checked(cls, {name: defaults[name] for name in values if name in defaults}, owner)
    return {name: values[name] for name in fields if name in values and values[name] != defaults.get(name)}


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


def values_in_words(annotation: Any) -> str:
    """Describe the values that a type with constraints accepts."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        base = values_in_words(arguments[0])
        limits = [limit for limit in arguments[1:] if isinstance(limit, _CONSTRAINTS)]
        return " and ".join(f"{base} {part}" if isinstance(part, Interval) else str(part) for part in limits) or base
    if origin is Literal:
        return " or ".join(map(format_value, arguments))
    if origin in _UNIONS:
        return " or ".join("none" if kind is NoneType else values_in_words(kind) for kind in arguments)
    if origin is tuple:
        count = "values" if Ellipsis in arguments else f"{len(arguments)} values"
        kinds = set(arguments) - {Ellipsis}
        return f"{count} in parentheses" + (f", each {values_in_words(*kinds)}" if len(kinds) == 1 else "")
    return _WORDS.get(annotation) or f"a {getattr(annotation, '__name__', annotation)}"


def _choices(annotation: Any) -> Iterable[str]:
    """Return the names that a type or its constraints list; empty if there are none."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        return next((limit.known for limit in arguments if isinstance(limit, OneOf)), _choices(arguments[0]))
    return list(map(format_value, arguments)) if origin is Literal else ()


def _fit(annotation: Any, value: Any) -> Any:
    """Convert a value to a type with constraints; raise an error of ``_UNFIT`` if it does not fit."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        fitted = _fit(arguments[0], value)
        for limit in arguments[1:]:
            fitted = limit.admit(fitted) if isinstance(limit, _CONSTRAINTS) else fitted
        return fitted
    if origin is Literal:
        return value if value in arguments else {format_value(choice): choice for choice in arguments}[str(value)]
    if origin in _UNIONS:
        if NoneType in arguments and (value is None or str(value).lower() == "none"):
            return None
        for kind in arguments:
            with suppress(*_UNFIT):
                return _fit(kind, value)
        raise ValueError
    return _fit_tuple(arguments, value) if origin is tuple else _convert(annotation, value)


def _fit_tuple(kinds: tuple[Any, ...], value: Any) -> tuple[Any, ...]:
    """Convert a tuple, a list, or text: values with commas between them, with or without parentheses."""
    if isinstance(value, str):
        text = value.strip()
        inner = text[1:-1] if text.startswith("(") and text.endswith(")") else text
        value = tuple(part.strip() for part in split(inner.removesuffix(",")))
    if not isinstance(value, tuple | list):
        raise TypeError
    kinds = kinds[:1] * len(value) if kinds[-1:] == (Ellipsis,) else kinds
    return tuple(_fit(kind, part) for kind, part in zip(kinds, value, strict=True))


def _convert(kind: Any, value: Any) -> Any:
    """Convert text or an object to a type; NaN is rejected, and an integer may be written as 2.0 or 1e3."""
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, str) and kind in (int, float):  # Python reads more than JSON: .5, +7, 012
        value = int(value) if kind is int and value.strip(" +-").isdecimal() else float(value)
    is_text = isinstance(value, str) and kind is not str
    converted = msgspec.convert(
        value, kind, strict=kind is bool and not is_text, dec_hook=lambda kind, text: kind(text)
    )
    if converted != converted:
        raise ValueError
    return converted + 0.0 if kind is float else converted  # so that -0.0 is 0.0
