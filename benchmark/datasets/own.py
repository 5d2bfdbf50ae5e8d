"""Data sets of plugin files: each :class:`~benchmark.api.datasets.ShapeSet` among the variables of the module."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from benchmark.api.datasets import Entry, ShapeSet
from benchmark.errors import BenchmarkError, DatasetError, UnreadableMesh, locate
from benchmark.geometry.mesh import Mesh
from benchmark.text import LONGEST_REASON, is_name


def is_own(source: str) -> bool:
    """Return whether a source is a data set of a plugin file."""
    return ".py:" in source or re.fullmatch(r"[\w.]+:\w+", source) is not None


def open_own(source: str) -> ShapeSet:
    """Open the data set of a plugin file.

    Parameters
    ----------
    source
        Path and name of the variable, ``"/path/to/file.py:RODS"``.

    Raises
    ------
    ConfigurationError
        If the file cannot be imported, or has no such variable.
    DatasetError
        If that is no data set, or a shape has an invalid name.
    """
    from benchmark.registry import Component  # imports numba

    found, path = Component("data set", "", source).load(), source.rpartition(":")[0]
    if not isinstance(found, ShapeSet):
        raise DatasetError(f"{source} is no data set", "make it a ShapeSet")
    for problem, hint in _problems(found):
        raise DatasetError(f"data set '{found.name}' of {path}: {problem}", hint)
    return replace(
        found,
        load=_guarded(found.load, found.name, Mesh),
        key=lambda entry: f"{found.name} {entry.identifier} {found.key(entry)}",
        code=tuple(dict.fromkeys([*found.code, path])),
    )


def _problems(shapes: ShapeSet) -> Iterator[tuple[str, str]]:
    if not is_name(shapes.name):
        yield f"name {shapes.name!r} is not lower-case words joined by hyphens", "rename it"
    if not shapes.shapes:
        yield "it lists no shapes", "list at least one Entry"
    taken: set[str] = set()
    for entry in shapes.shapes:
        if type(entry) is not Entry:
            yield f"'shapes' lists {type(entry).__name__}", "list Entry"
            return
        for field in ("identifier", "subject", "pose"):
            value = getattr(entry, field)
            is_short = isinstance(value, str) and value.isprintable() and len(value) <= LONGEST_REASON
            if not is_short or (not value and field != "pose"):
                yield f"{field} {value!r:.80} is not a text of one line", "rename the shape"
        if entry.identifier in taken:
            yield f"two shapes are called '{entry.identifier}'", "rename one of them"
        taken.add(entry.identifier)


def _guarded(call: Callable[[Entry], Any], name: str, kind: type) -> Callable[[Entry], Any]:
    """Return a function that raises ``UnreadableMesh`` where the given one fails or returns something else."""

    def guarded(entry: Entry) -> Any:
        where = f"data set '{name}', shape '{entry.identifier}'"
        try:
            result = call(entry)
        except BenchmarkError:
            raise
        except (Exception, SystemExit) as error:
            raise UnreadableMesh(f"{where}: {locate(error)}", "correct the file") from error
        if not isinstance(result, kind):
            raise UnreadableMesh(f"{where}: it returned {type(result).__name__}", f"return {kind.__name__}")
        return result

    return guarded
