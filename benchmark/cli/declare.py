"""Declare options and arguments as dataclass fields."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import click

from benchmark.errors import ConfigurationError

#: Values of ``--method`` that select all methods, and those of all finished jobs, variants included.
EVERY, FINISHED = "all", "finished"

#: Fewest vertices of a prepared mesh.
FEWEST_VERTICES = 4

_UNITS = {"": 1, "s": 1, "m": 60, "h": 3600}


def option(usage: str, help: str | None = None, default: object = None, **attributes: Any) -> Any:
    """Declare an option as a dataclass field, whose type gives that of the option.

    Parameters
    ----------
    usage
        Names and metavar: ``"-o --output DIR"``.
    help
        Text of ``--help``, which shows the default, too, unless it is empty.
    default
        Value without the option; ``()`` for one that may be repeated.
    **attributes
        Further attributes for click.
    """
    words = [word for word in usage.split() if word.startswith("-")]
    attributes = {"metavar": usage.removeprefix(" ".join(words)).strip() or None, "help": help, **attributes}
    if default not in ((), None):
        attributes = {"default": default, "show_default": default != "", **attributes}
    return _declared(lambda name, kind: click.Option([*words, name], **_of_type(kind) | attributes), default)


def flag(usage: str, help: str) -> Any:
    """Declare a flag as a dataclass field."""
    return option(usage, help, False, is_flag=True, show_default=False)


def argument(metavar: str | None = None, **attributes: Any) -> Any:
    """Declare an argument as a dataclass field, whose type gives that of the argument; a tuple takes one or more."""

    def make(name: str, kind: Any) -> click.Argument:
        given = _of_type(kind)
        if given.pop("multiple", False):
            given |= {"nargs": -1, "required": True}
        return click.Argument([name], metavar=metavar, **given, **attributes)

    return _declared(make, None)


def _declared(make: Callable[[str, Any], click.Parameter], default: object) -> Any:
    return field(default=default, metadata={"parameter": make})


def _of_type(kind: Any) -> dict[str, Any]:
    """Return the attributes of a click parameter for the type of a field; ``Annotated`` lists its own."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is tuple:
        return {"multiple": True, **_of_type(parts[0])}
    if origin is Annotated:
        return dict(parts[1:])
    if origin is Literal:
        return {"type": click.Choice(parts)}
    return _of_type(parts[0]) if parts else {"type": PATH if kind is Path else kind}  # the first of TYPE | None


def timeout_option(what: str, default: str = "10m") -> Any:
    """Declare the time limit of foreign code."""
    shown: dict[str, Any] = {"metavar": "TIME", "show_default": True, "help": f"Time limit for {what}: 90s, 10m, 2h."}
    return _declared(
        lambda name, _: click.Option(["--timeout", name], type=duration, default=default, **shown), duration(default)
    )


# Types ---------------------------------------------------------------------------------------------------------------


class PathType(click.ParamType[Any]):
    """A valid path, whether or not it exists."""

    name = "path"

    def __init__(self, result: type) -> None:
        self.result = result

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Refuse empty paths and those that are too long for the system."""
        text, option = str(value), param.opts[-1] if param else self.name
        if not text:
            raise ConfigurationError(f"{option} is empty", "name a file or a folder; the current one is '.'")
        try:
            os.lstat(text)
        except (FileNotFoundError, NotADirectoryError, PermissionError):
            pass
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            raise ConfigurationError(
                f"{option} '{text[:40]}...' cannot be a path: {reason}", "shorten or correct it"
            ) from error
        return self.result(text)


PATH = PathType(Path)


def duration(text: str) -> float:
    """Parse a duration such as ``90``, ``90s``, ``10m`` or ``2h``; return seconds."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([smh]?)", text.strip())
    if not match or float(match[1]) == 0:
        raise ValueError(f"'{text}' is not a duration; write 90s, 10m or 2h")
    return float(match[1]) * _UNITS[match[2]]


def vertex_count(text: str) -> int | str:
    """Parse a number of vertices or ``all``."""
    if text == "all":
        return text
    if not text.isdecimal() or int(text) < FEWEST_VERTICES:
        raise ValueError(f"'{text}' is not a number of vertices; write {FEWEST_VERTICES} or more, or all")
    return int(text)


NameOrFolder = Annotated[str, ("type", PathType(str))]
DataSet = Annotated[str, ("type", PathType(str))]
MethodName = str
ScorerName = str
TableName = str
Count = Annotated[int, ("type", click.IntRange(min=1))]
