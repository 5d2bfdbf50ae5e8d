"""What a method may say about itself."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, get_args, get_type_hints

from benchmark.contracts import Input, MethodInfo

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")

#: Characters of the longest name, which becomes part of the names of files.
LONGEST_NAME = 60


def is_name(name: object) -> bool:
    """Whether a method can be called like this: lower-case words joined by hyphens, not too long."""
    return isinstance(name, str) and len(name) <= LONGEST_NAME and _NAME.fullmatch(name) is not None


def problems_of(info: MethodInfo) -> Iterator[tuple[str, str]]:
    """What is wrong with the information of a method: each problem with its mend."""
    if not is_name(info.name):
        said = f"name {info.name!r:.80} is not lower-case words joined by hyphens"
        yield said, f"write it so, with {LONGEST_NAME} characters at most"
    for field in ("title", "summary", "cite"):
        value = getattr(info, field)
        if not isinstance(value, str) or "\n" in value:
            yield f"{field} {value!r:.80} is not a text of one line", "write a text"
    if isinstance(info.title, str) and not info.title.strip():
        yield "title is empty", "say what the tables shall print"
    if not _are_words(info.inputs) or not info.inputs or not set(info.inputs) <= set(get_args(Input)):
        yield f"inputs are {info.inputs!r}", "name 'mesh', 'view' or both in a tuple"
    if not _are_words(info.requires):
        yield f"requires is {info.requires!r}", "write a tuple of the import names of packages"
    choices = get_type_hints(MethodInfo)
    for field, proposal in (("scale", "'equivariant' or 'invariant'"), ("family", "'extended'")):
        if getattr(info, field) not in get_args(choices[field]):
            yield f"{field} is {getattr(info, field)!r}", f"write {proposal}"
    deterministic: Any = info.deterministic
    if not isinstance(deterministic, bool):
        yield f"deterministic is {deterministic!r}", "write True or False"


def _are_words(values: Any) -> bool:
    return isinstance(values, tuple | list) and all(isinstance(value, str) for value in values)
