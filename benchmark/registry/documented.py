"""Parameters in plain words, from the docstring of a component."""

from __future__ import annotations

import re
from inspect import cleandoc

#: A heading of a numpydoc section, and what stands below it until the next one.
_SECTION = re.compile(
    r"^(\w[\w ]*)\n-{3,}\n(.*?)(?=^\w[\w ]*\n-{3,}\n|\Z)", re.MULTILINE | re.DOTALL
)

#: A line that names parameters, such as ``first_pull, last_pull``, and lines that describe them.
_ENTRY = re.compile(r"^(\w+(?:, \w+)*)[^\n]*\n((?:[ ]+[^\n]*\n?|\n)+)", re.MULTILINE)

#: A role, such as ``:class:`~pathlib.Path```, and text in double backquotes.
_ROLE = re.compile(r":\w+:`~?([^`]*)`")
_LITERAL = re.compile(r"``([^`]*)``")

#: A command of LaTeX that is the name of a letter.
_LETTER = re.compile(r"\\(?=[a-z]+\b)")


def describe_parameters(documented: type) -> dict[str, str]:
    """Return the description of each parameter of a class, on one line, by its name.

    Parameters
    ----------
    documented
        The class, whose docstring follows numpydoc. Parameters that it does not describe are taken
        from the docstrings of its base classes.
    """
    found: dict[str, str] = {}
    for base in documented.__mro__:
        text = cleandoc(base.__doc__ or "")
        for heading, section in _SECTION.findall(text):
            if heading != "Parameters":
                continue
            for names, description in _ENTRY.findall(section + "\n"):
                for name in names.split(", "):
                    found.setdefault(name, plain(description))
    return found


def plain(text: str) -> str:
    """Return a text of a docstring on one line, without its markup."""
    without_roles = _ROLE.sub(lambda role: role[1].rpartition(".")[2].strip(), text)
    return " ".join(_LETTER.sub("", _LITERAL.sub(r"\1", without_roles)).split())
