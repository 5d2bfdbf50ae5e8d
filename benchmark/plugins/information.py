"""Checks of what a method, or a scorer, says about itself."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, get_args, get_type_hints

from benchmark.api.contracts import Input, MethodInfo
from benchmark.api.scoring import ScorerInfo
from benchmark.text import LONGEST_NAME, RESERVED, is_name

#: Random draws of a scorer, each of which ranks the whole gallery.
_MOST_DRAWS = 100


def problems_of(info: MethodInfo | ScorerInfo) -> Iterator[tuple[str, str]]:
    """Return what is wrong with what a method, or a scorer, says about itself: each problem with its hint."""
    yield from (_problems_of_method(info) if isinstance(info, MethodInfo) else _problems_of_scorer(info))


def _problems_of_method(info: MethodInfo) -> Iterator[tuple[str, str]]:
    if isinstance(info.name, str) and info.name in RESERVED:
        yield f"name '{info.name}' stands for several methods on the command line", "choose another name"
    yield from _problems_of_texts(info, ("title", "summary", "departs", "cite"))
    if not _are_words(info.inputs) or not info.inputs or not set(info.inputs) <= set(get_args(Input)):
        yield f"inputs are {info.inputs!r}", "name 'mesh', 'view' or both in a tuple"
    choices = get_type_hints(MethodInfo)
    for field, proposal in (("scale", "'equivariant' or 'invariant'"), ("family", "'extended'")):
        if getattr(info, field) not in get_args(choices[field]):
            yield f"{field} is {getattr(info, field)!r}", f"write {proposal}"
    deterministic: Any = info.deterministic
    if not isinstance(deterministic, bool):
        yield f"deterministic is {deterministic!r}", "write True or False"


def _problems_of_scorer(info: ScorerInfo) -> Iterator[tuple[str, str]]:
    yield from _problems_of_texts(info)
    draws: Any = info.draws
    if type(draws) is not int or not 1 <= draws <= _MOST_DRAWS:
        yield f"draws is {draws!r:.80}", f"write a whole number from 1 to {_MOST_DRAWS}"
    invariant: Any = info.invariant
    if not isinstance(invariant, bool):
        yield f"invariant is {invariant!r:.80}", "write True or False"


def _problems_of_texts(
    info: MethodInfo | ScorerInfo, fields: Iterable[str] = ("title", "summary", "cite")
) -> Iterator[tuple[str, str]]:
    """Return what is wrong with what both say."""
    if not is_name(info.name):
        said = f"name {info.name!r:.80} is not lower-case words joined by hyphens"
        yield said, f"write it so, with {LONGEST_NAME} characters at most"
    for field in fields:
        value = getattr(info, field)
        if not isinstance(value, str) or "\n" in value:
            yield f"{field} {value!r:.80} is not a text of one line", "write a text"
    if isinstance(info.title, str) and not info.title.strip():
        yield "title is empty", "say what the tables shall print"
    if not _are_words(info.requires):
        yield f"requires is {info.requires!r}", "write a tuple of the import names of packages"
    if not _are_words(info.files):
        yield f"files is {info.files!r}", "write a tuple of paths"


def _are_words(values: Any) -> bool:
    return isinstance(values, tuple | list) and all(isinstance(value, str) for value in values)
