"""The parameters of a method in words: what each takes, its default, and what its docstring says of it."""

from __future__ import annotations

import dataclasses
import inspect
import re
from dataclasses import dataclass
from typing import Any

from benchmark.plugins.parameters.values import declared_parameters, format_value, values_in_words

__all__ = ["ParameterText", "described", "explained"]


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
        written = "" if default is dataclasses.MISSING else format_value(default)
        found.append(ParameterText(name, values_in_words(annotation, default), written, meanings.get(name, "")))
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
