"""Names that a shell completes: methods, tables, data sets; nothing of a plugin is imported for it."""

from __future__ import annotations

import os
from collections.abc import Iterable

import click
from click.shell_completion import CompletionItem, get_completion_class, shell_complete

__all__ = [
    *("EVERY", "FINISHED", "PROGRAM", "SHELLS"),
    *("answer", "datasets", "methods", "methods_or_files", "scorers", "script", "tables"),
]

#: The installed program: a shell completes the words behind this one alone.
PROGRAM = "canonical-forms"

SHELLS = ("bash", "zsh", "fish")

#: Stands for all methods, and for those of all finished jobs, variants included, whatever else is named.
EVERY, FINISHED = "all", "finished"

#: By it, a shell asks the program for words.
_VARIABLE = "_CANONICAL_FORMS_COMPLETE"


def script(group: click.Group, shell: str) -> str:
    """Return what a shell has to read once to complete words of the program; ``shell`` is one of :data:`SHELLS`."""
    made = get_completion_class(shell)
    if made is None:
        raise ValueError(shell)
    return made(group, {}, PROGRAM, _VARIABLE).source()


def answer(group: click.Group) -> int | None:
    """Answer a shell that asks for words, and return the exit code; None if none asks."""
    asked = os.environ.get(_VARIABLE)
    return shell_complete(group, {}, PROGRAM, _VARIABLE, asked) if asked else None


def methods(_: click.Context, __: click.Parameter, begun: str) -> list[CompletionItem]:
    """Methods, and the words for several; behind a bracket, the parameters of the method."""
    from importlib.metadata import entry_points

    from benchmark.plugins.inspection import entry_points_of
    from benchmark.plugins.registry import BUILT_IN, MethodSpec

    name, bracket, rest = begun.partition("[")
    if bracket and name in BUILT_IN:
        return _items(_parameters(name, rest), begun)
    return _items(
        [*BUILT_IN, *(point.name for point in entry_points(group=entry_points_of(MethodSpec))), EVERY, FINISHED], begun
    )


def methods_or_files(context: click.Context, parameter: click.Parameter, begun: str) -> list[CompletionItem]:
    """Methods, and files."""
    return [*methods(context, parameter, begun), CompletionItem(begun, type="file")]


def tables(_: click.Context, __: click.Parameter, begun: str) -> list[CompletionItem]:
    """Identifiers of tables."""
    from benchmark.protocols.tables import TABLES

    return _items([table.identifier for table in TABLES], begun)


def scorers(_: click.Context, __: click.Parameter, begun: str) -> list[CompletionItem]:
    """Scorers."""
    from benchmark.plugins.scorers import BUILT_IN

    return _items(BUILT_IN, begun)


def datasets(_: click.Context, __: click.Parameter, begun: str) -> list[CompletionItem]:
    """Data sets, and folders."""
    from benchmark.datasets.catalogue import CATALOGUE

    return [*_items(CATALOGUE, begun), CompletionItem(begun, type="dir")]


def _parameters(name: str, rest: str) -> list[str]:
    """A method with one more parameter, behind those that are written."""
    from benchmark.plugins.parameters import described
    from benchmark.plugins.registry import BUILT_IN, MethodSpec

    before, comma, _ = rest.rpartition(",")
    return [f"{name}[{before}{comma}{each.name}=" for each in described(MethodSpec(name, BUILT_IN[name]).load())]


def _items(names: Iterable[str], begun: str) -> list[CompletionItem]:
    return [CompletionItem(name) for name in names if name.startswith(begun)]
