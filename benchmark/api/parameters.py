"""Parameters of methods: accepted values, conversion from and to text, and checks.

A parameter is a field of a dataclass. Its type determines the kind of value, ``Literal`` lists the
accepted values, and ``Annotated`` adds a constraint to the type::

    iterations: Annotated[int, Interval(1)] = 20
    weights: Literal["uniform", "cotangent"] = "cotangent"
"""

from __future__ import annotations

import dataclasses
import inspect
import itertools
import math
import re
import typing
from collections.abc import Iterable, Mapping
from contextlib import suppress
from enum import Enum
from functools import cache
from types import MemberDescriptorType, NoneType, UnionType
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from benchmark.errors import ConfigurationError, check_known, did_you_mean
from benchmark.text import NAME

#: Characters that enclose a text.
_QUOTES = "'\""

#: Characters with a meaning between brackets; a text that contains one of them is quoted.
_SPECIAL = frozenset("|,()'\" ")

#: Types of parameters in words, by the names that messages of msgspec give them.
_KINDS = {
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "str": "text",
    "array": "a list in parentheses",
    "array | null": "a list in parentheses, or none",
    "bool | null": "true, false or none",
    "int | null": "a whole number, or none",
    "float | null": "a number, or none",
    "str | null": "text, or none",
}

#: Bounds of numbers in words.
_BOUNDS = {">=": "of at least", "<=": "of at most", ">": "above", "<": "below"}


def Interval(  # noqa: N802  # it stands in types
    low: float = -math.inf,
    high: float = math.inf,
    closed: Literal["both", "left", "right", "neither"] = "both",
) -> Meta:
    """Return the constraint to finite numbers between two bounds.

    Parameters
    ----------
    low, high
        Bounds; infinite for no bound.
    closed
        Bounds that belong to the interval: ``"both"``, ``"left"``, ``"right"`` or ``"neither"``.
    """
    lower = "ge" if closed in ("both", "left") else "gt"
    upper = "le" if closed in ("both", "right") else "lt"
    bounds: dict[str, Any] = {}
    if math.isfinite(low):
        bounds[lower] = low
    if math.isfinite(high):
        bounds[upper] = high
    return Meta(**bounds)


def Matches(pattern: str, words: str) -> Meta:  # noqa: N802
    """Return the constraint to text that matches a pattern.

    Parameters
    ----------
    pattern
        Regular expression for the whole text.
    words
        Description of such text.
    """
    return Meta(pattern=rf"^(?:{pattern})\Z", description=words)


Name = Annotated[str, Matches(NAME, "lower-case words joined by hyphens")]
"""Name on the command line."""

Title = Annotated[str, Matches(r"\S.{0,199}", "a text of one line")]
"""Name in the tables."""


class CheckedParameters:
    """Base class of frozen dataclasses that checks and normalises their parameters."""

    def __post_init__(self) -> None:
        for name, value in checked(type(self), parameter_values(self)).items():
            object.__setattr__(self, name, value)


def checked(cls: type[Any], given: Mapping[str, Any], owner: str = "") -> dict[str, Any]:
    """Convert the values of parameters to the types that a class declares.

    Parameters
    ----------
    cls
        Dataclass whose fields are the parameters.
    given
        Values by name, as text or as objects; text is converted to the type of the field.
    owner
        Name of the class in messages; by default, the name of the method.

    Returns
    -------
    dict
        The converted values by name. All spellings of a value, such as 1 and "1.0", become equal.

    Raises
    ------
    ConfigurationError
        If a parameter is unknown, or a value does not fit.
    """
    owner = owner or getattr(getattr(cls, "info", None), "name", cls.__name__)
    fields = declared_parameters(cls)
    check_known(f"parameter of {owner}", given, fields)
    values = {}
    for name, value in given.items():
        annotation, _ = fields[name]
        parameter = f"{name} of {owner}"
        try:
            values[name] = _fit(annotation, value)
        except msgspec.ValidationError as error:
            raise _misfit(annotation, value, parameter, str(error)) from None
        except TypeError as error:
            problem = f"the type of {parameter} is none of a parameter: {error}"
            hint = "declare it as docs/reference/plugins.md does"
            raise ConfigurationError(problem, hint) from None
    return values


def _misfit(annotation: Any, value: Any, parameter: str, message: str) -> ConfigurationError:
    """Return the error for a value that does not fit a parameter.

    Parameters
    ----------
    annotation
        Type of the parameter.
    value
        The value.
    parameter
        The parameter, as the error calls it: ``"rtol of least-squares-mds"``.
    message
        Message of msgspec.
    """
    choices = _choices(annotation)
    if choices and isinstance(value, str):
        return did_you_mean(parameter, value, map(format_value, choices))
    expected = _in_words(message)
    for kind in (annotation, *typing.get_args(annotation)):  # it may be one of a union
        for constraint in getattr(kind, "__metadata__", ()):
            if isinstance(constraint, Meta) and constraint.description:
                expected = constraint.description
    return ConfigurationError(f"'{value}' does not fit {parameter}", f"write {expected}")


def _choices(annotation: Any) -> list[Any]:
    """Return the only values that a type allows; none if it allows others, too."""
    choices: list[Any] = []
    for kind in _alternatives(annotation):
        members = _members(kind)
        if not members:
            return []
        choices += members
    return choices


def _members(kind: Any) -> list[Any]:
    """Return the values that a type lists; none if it lists none."""
    if kind is NoneType:
        return [None]
    if typing.get_origin(kind) is Literal:
        return list(typing.get_args(kind))
    if isinstance(kind, type) and issubclass(kind, Enum):
        return [member.value for member in kind]
    return []


def _in_words(message: str) -> str:
    """Return what a message of msgspec expects, in words: ``a number of at least 0``."""
    expected = re.sub("^Expected |, got .*| - at .*", "", message)
    expected = re.sub("^Invalid enum value .*", "one of its choices", expected)
    for kind, words in _KINDS.items():
        expected = expected.replace(f"`{kind}`", words)
    for sign, words in _BOUNDS.items():
        expected = re.sub(rf" {sign} (-?[\d.]+?)(?:\.0)?$", rf" {words} \1", expected)
    return expected


def non_default_values(cls: type[Any], given: Mapping[str, Any], owner: str = "") -> dict[str, Any]:
    """Return the parameters that differ from their defaults, in the order of the fields.

    Parameters
    ----------
    cls
        Dataclass whose fields are the parameters.
    given
        Values by name, as text or as objects.
    owner
        Name of the class in messages; by default, the name of the method.

    Returns
    -------
    dict
        The values by name, as :func:`plain_value` returns them.

    Raises
    ------
    ConfigurationError
        If a parameter is unknown, or a value does not fit.
    """
    values = _plain_values(checked(cls, given, owner))
    fields = declared_parameters(cls)
    defaults = {}
    for name in values:
        _, default = fields[name]
        if default is not dataclasses.MISSING:
            defaults[name] = default
    defaults = _plain_values(checked(cls, defaults, owner))
    chosen = {}
    for name in fields:
        if name not in values:
            continue
        # Values are compared as text, because 1, 1.0 and True are equal as objects.
        is_default = name in defaults and repr(values[name]) == repr(defaults[name])
        if not is_default:
            chosen[name] = values[name]
    return chosen


def _plain_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by name, as :func:`plain_value` returns them."""
    return {name: plain_value(value) for name, value in values.items()}


def plain_value(value: Any) -> Any:
    """Return a value as names, records and other processes hold it.

    That is a number, a text, None, or a tuple or list of these; of any other object, its text.
    """
    if isinstance(value, Enum):
        return plain_value(value.value)
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, tuple):
        return tuple(map(plain_value, value))
    if isinstance(value, list):
        return list(map(plain_value, value))
    return value if value is None or isinstance(value, int | float | str) else str(value)


def read_back(cls: type[Any], given: Mapping[str, Any], owner: str) -> dict[str, Any]:
    """Return the values of parameters that are read from their plain values.

    Parameters
    ----------
    cls
        Dataclass whose fields are the parameters.
    given
        Values by name, as text or as objects.
    owner
        Name of the class in messages.

    Raises
    ------
    ConfigurationError
        If a parameter is unknown, a value does not fit, or another value is read from its text, so
        that a name with this text would not say which value it is.
    """
    values = checked(cls, given, owner)
    again: dict[str, Any] = {}
    for name, value in values.items():
        with suppress(ConfigurationError):
            again |= checked(cls, {name: plain_value(value)}, owner)
        if name not in again or value != again[name]:
            problem = f"{name} of {owner} cannot be written as text: {format_value(value)!r:.80}"
            hint = "declare its type as docs/reference/plugins.md does"
            raise ConfigurationError(problem, hint)
    return again


def parameter_values(instance: Any) -> dict[str, Any]:
    """Return all parameters of an instance of a dataclass; empty for any other object."""
    return {name: getattr(instance, name) for name in declared_parameters(type(instance))}


def declared_parameters(cls: type[Any]) -> dict[str, tuple[Any, Any]]:
    """Return the type and the default of each parameter of a class, in the order of its fields.

    Parameters
    ----------
    cls
        A dataclass, whose fields are the parameters; any other class has none.

    Returns
    -------
    dict
        For each name, the type with its constraints, and the default, which is
        ``dataclasses.MISSING`` if there is none.

    Raises
    ------
    ConfigurationError
        If a type is unknown, or the class sets a parameter that it does not declare.
    """
    if not dataclasses.is_dataclass(cls):
        return {}
    hints = _type_hints(cls)
    parameters = {}
    for field in dataclasses.fields(cls):
        if not field.init:
            continue
        _check_declared(cls, field)
        default = field.default
        if field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        parameters[field.name] = (hints[field.name], default)
    return parameters


def _check_declared(cls: type[Any], field: dataclasses.Field[Any]) -> None:
    """Raise ``ConfigurationError`` if a class sets an inherited parameter without declaring it.

    Its objects would have the default of the class that declares the parameter.
    """
    value = inspect.getattr_static(cls, field.name, field.default)
    is_slot = isinstance(value, MemberDescriptorType)
    if value is field.default or is_slot:
        return
    problem = f"{cls.__name__} sets {field.name}, but does not declare it as a parameter"
    hint = f"write '{field.name}: TYPE = VALUE' in it, and @dataclass(frozen=True) above it"
    raise ConfigurationError(problem, hint)


@cache
def _type_hints(cls: type[Any]) -> dict[str, Any]:
    """Return the types of the fields of a class, with their constraints."""
    try:
        return typing.get_type_hints(cls, include_extras=True)
    except Exception as error:  # a type is an expression of a user, which may raise anything
        problem = f"a type of {cls.__name__} is unknown: {error}"
        hint = "correct it"
        if isinstance(error, NameError):
            hint = "import it outside of 'if TYPE_CHECKING'"
        raise ConfigurationError(problem, hint) from error


# Text
# ------------------------------------------------------------------------------------------------


def format_value(value: Any) -> str:
    """Return the text from which the value is read."""
    plain = plain_value(value)
    if isinstance(plain, tuple | list):
        items = [quoted(item) if isinstance(item, str) else format_value(item) for item in plain]
        return f"({','.join(items)})"
    if plain is None or isinstance(plain, bool):
        return str(plain).lower()
    return repr(plain) if isinstance(plain, float) else str(plain)


def quoted(text: str) -> str:
    """Return a text as written between brackets, quoted if it could be read as several values."""
    if text and not _SPECIAL & set(text):
        return text
    quote = '"' if "'" in text else "'"
    return f"{quote}{text}{quote}"


def unquoted(text: str) -> str:
    """Return a text without the quotes around it, if there are any."""
    is_quoted = len(text) > 1 and text[0] in _QUOTES and text[0] == text[-1]
    return text[1:-1] if is_quoted else text


def option_words(options: Mapping[str, Any]) -> list[str]:
    """Return the words of a command, ``-o NAME=VALUE``, from which options are read."""
    words: list[str] = []
    for name, value in options.items():
        words += ["-o", f"{name}={format_value(value)}"]
    return words


def assignments(texts: str | Iterable[str]) -> dict[str, str]:
    """Parse assignments such as ``"sweeps=5, start=classic"`` to values by name.

    Parameters
    ----------
    texts
        Texts of the form ``name=value``, or one text that holds several between commas.

    Raises
    ------
    ConfigurationError
        If a name or a value is missing, or a name appears twice.
    """
    values: dict[str, str] = {}
    if isinstance(texts, str):
        texts = split(texts)
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals):
            missing = "value" if name else "name"
            raise ConfigurationError(f"'{text.strip()}' has no {missing}", "write NAME=VALUE")
        if name in values:
            raise ConfigurationError(f"'{name}' is given twice", "leave one of them out")
        values[name] = value
    return values


def split(text: str, separator: str = ",") -> list[str]:
    """Split text at the separators that stand outside quotes and parentheses.

    Parameters
    ----------
    text
        Such as ``"name=(1, 2), words='a, b'"``, which has two parts; blank text has none.
    separator
        A single character.

    Raises
    ------
    ConfigurationError
        If quotes or parentheses are not balanced.
    """
    parts = [""]
    quote = ""  # the quotation mark that is open
    depth = 0  # the number of parentheses that are open
    for position, character in enumerate(text):
        if quote:
            if character == quote:
                quote = ""
        elif character in _QUOTES and _begins_quote(text[:position]):
            quote = character
        elif character == "(":
            depth += 1
        elif character == ")":
            depth -= 1
        if depth < 0:
            break
        if character == separator and not quote and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    if quote or depth:
        half = "a quote" if quote else "a parenthesis"
        problem = f"'{text}' has {half} without its other half"
        raise ConfigurationError(problem, "close what is opened")
    return parts if text.strip() else []


def _begins_quote(before: str) -> bool:
    """Return whether a quote behind a text encloses one; elsewhere, it is an apostrophe."""
    return before.rstrip()[-1:] in ("", "=", "|", ",", "(")


def _fit(annotation: Any, value: Any) -> Any:
    """Convert a value to the type of a parameter.

    Parameters
    ----------
    annotation
        The type, with constraints.
    value
        Text, such as "(1, 2)" or "none", or an object.

    Raises
    ------
    msgspec.ValidationError
        If it does not fit; the message says what was expected.
    """
    given: Any = value
    if isinstance(value, Enum | np.generic | tuple | list):
        given = plain_value(value)
    if isinstance(given, str):
        if not given.isprintable():  # it becomes part of names
            raise msgspec.ValidationError("printable text")
        given = _parse(annotation, given)

    try:
        fitted = _convert(annotation, given)
    except msgspec.ValidationError:
        # A text that is no integer, such as "1e3", may be a number that is one.
        fitted = _convert(annotation, _numbers(given))
    _check_finite(fitted)
    if isinstance(fitted, float):
        return fitted + 0.0  # so that -0.0 is 0.0
    return fitted


def _parse(annotation: Any, text: str) -> Any:
    """Return what a text stands for, as far as the type of a parameter tells.

    That is None, a value that the type lists, a number where the type allows numbers and texts, a
    list of what its parts stand for, or the text itself.
    """
    kinds = _alternatives(annotation)
    if NoneType in kinds and text.strip().lower() == "none":
        return None
    for kind in kinds:
        for member in _members(kind):
            if text == format_value(member):
                return member
    if str in kinds:
        for kind in kinds:
            if kind in (bool, int, float):
                with suppress(msgspec.ValidationError):
                    return _fit(kind, text)
        return text
    for kind in kinds:
        if (typing.get_origin(kind) or kind) in (tuple, list, set, frozenset):
            return _parse_items(typing.get_args(kind), text)
    return text


def _parse_items(types: tuple[Any, ...], text: str) -> list[Any]:
    """Return what the parts of a text stand for, with commas between them.

    Parameters
    ----------
    types
        Types of the items, of which the last one goes on: those of ``tuple[int, ...]`` are ``int``
        and an ellipsis. Without any, each part is a number or a text.
    text
        With or without parentheses.
    """
    text = text.strip()
    inner = text[1:-1] if text.startswith("(") and text.endswith(")") else text
    parts = [part.strip() for part in split(inner.removesuffix(","))]
    known = [item for item in types if item is not Ellipsis] or [int | float | str]
    return [
        _parse(known[min(place, len(known) - 1)], unquoted(part))
        for place, part in enumerate(parts)
    ]


def _alternatives(annotation: Any) -> list[Any]:
    """Return the types of which a value may have one, without their constraints."""
    origin = typing.get_origin(annotation)
    if origin is Annotated:
        return _alternatives(annotation.__origin__)
    if origin in (typing.Union, UnionType):
        return list(itertools.chain.from_iterable(map(_alternatives, typing.get_args(annotation))))
    if origin is Literal and None in typing.get_args(annotation):
        return [NoneType, annotation]
    return [annotation]


def _check_finite(value: Any) -> None:
    """Raise ``msgspec.ValidationError`` if a number, or one in a list, is infinite or NaN."""
    if isinstance(value, tuple | list):
        for item in value:
            _check_finite(item)
    if isinstance(value, float) and not math.isfinite(value):
        raise msgspec.ValidationError("a finite number")


def _convert(annotation: Any, given: Any) -> Any:
    """Convert a value by msgspec; texts of other types by calling the type."""
    return msgspec.convert(given, annotation, strict=False, dec_hook=_call_type)


def _call_type(kind: Any, given: Any) -> Any:
    """Return what a type, such as ``Path``, makes of a value."""
    try:
        return kind(given)
    except (TypeError, ValueError) as error:
        raise msgspec.ValidationError(f"what {kind.__name__} accepts") from error


def _numbers(given: Any) -> Any:
    """Return the number in a text, also as JSON does not write it: .5, +7, 012.

    In a list, those of its texts are converted. Anything else is returned as it is.
    """
    if isinstance(given, list):
        return [_numbers(part) for part in given]
    if not isinstance(given, str):
        return given
    with suppress(ValueError):
        return float(given)
    return given
