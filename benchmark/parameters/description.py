"""The parameters of a method in words: what each takes, its default, and what its docstring says of it."""

from __future__ import annotations

import dataclasses
import inspect
import re
import types
import typing
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from benchmark.parameters.constraints import Constraint, Interval
from benchmark.parameters.values import declared_parameters, format_value

__all__ = ["ParameterText", "described", "explained"]

_WORDS: dict[Any, str] = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}


@dataclass(frozen=True)
class ParameterText:
    """One parameter.

    Parameters
    ----------
    name
        As it is written on the command line.
    values
        What it takes.
    default
        Its default, as it is written.
    meaning
        What the docstring of the class says of it; "" if that says nothing.
    """

    name: str
    values: str
    default: str
    meaning: str


def described(cls: type[Any]) -> list[ParameterText]:
    """Parameters of a dataclass in the order of its fields; none of another class."""
    meanings: dict[str, str] = {}
    for base in reversed(inspect.getmro(cls)):
        meanings |= explained(vars(base).get("__doc__") or "")
    found = []
    for name, (annotation, default) in declared_parameters(cls).items():
        values = _values(type(default) if isinstance(annotation, str) else annotation)
        written = "" if default is dataclasses.MISSING else format_value(default)
        found.append(ParameterText(name, values, written, meanings.get(name, "")))
    return found


def explained(docstring: str) -> dict[str, str]:
    """Return what the section ``Parameters`` of a numpydoc docstring says of each, each on one line."""
    lines = inspect.cleandoc(docstring).splitlines()
    rules = [place for place, line in enumerate(lines) if place and re.fullmatch("-{3,}", line.strip())]
    start = next((place for place in rules if lines[place - 1].strip() == "Parameters"), None)
    if start is None:
        return {}
    end = min((place - 1 for place in rules if place > start), default=len(lines))
    found: dict[str, list[str]] = {}
    names: list[str] = []
    for line in lines[start + 1 : end]:
        if line and not line[0].isspace():
            names = [name.strip().lstrip("*") for name in line.partition(" : ")[0].split(",")]
            found |= {name: [] for name in names}
        elif line.strip():
            for name in names:
                found[name].append(_plain(line.strip()))
    return {name: " ".join(texts) for name, texts in found.items()}


def _plain(text: str) -> str:
    """Text without the marks of reStructuredText."""
    text = re.sub(r":[a-z]+:`~?([^`]*)`", r"\1", text)
    return text.replace("``", "").replace('"', "'")


def _values(annotation: Any) -> str:
    """Return what a type and its constraints take, in words."""
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        words = [
            f"{_values(arguments[0])} {limit}" if isinstance(limit, Interval) else str(limit)
            for limit in arguments[1:]
            if isinstance(limit, Constraint)
        ]
        return " and ".join(words) or _values(arguments[0])
    if origin is Literal:
        return " or ".join(map(format_value, arguments))
    if origin in (typing.Union, types.UnionType):
        return " or ".join("none" if each is type(None) else _values(each) for each in arguments)
    if origin is tuple or annotation is tuple:
        inner = [each for each in arguments if each is not Ellipsis]
        count = "values" if Ellipsis in arguments or not inner else f"{len(inner)} values"
        each = f", each {_values(inner[0])}" if inner and len(set(inner)) == 1 else ""
        return f"{count} in parentheses{each}"
    return _WORDS.get(annotation, getattr(annotation, "__name__", str(annotation)))
