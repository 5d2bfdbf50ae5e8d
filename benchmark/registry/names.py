"""Parameters as text: names with parameters in brackets, and alternatives.

``start=mesh|classic,power=1|2`` stands for four choices.
"""

from __future__ import annotations

import itertools
import re

from benchmark.api.parameters import assignments, split, unquoted
from benchmark.errors import ConfigurationError

_NAME = re.compile(r"([^\[\]]+)(?:\[([^\[\]]*)\])?")


def split_parameters(name: str) -> tuple[str, str]:
    """Split a name from the text in its brackets, "" if there are none.

    Unbalanced brackets are part of the name.

    Examples
    --------
    >>> split_parameters("least-squares-mds[rtol=0.01]")
    ('least-squares-mds', 'rtol=0.01')
    """
    match = _NAME.fullmatch(name.strip())
    return (match[1].strip(), match[2] or "") if match else (name, "")


def base_name(name: str) -> str:
    """Return the name of a method, or of a data set, without what follows it in brackets.

    Examples
    --------
    >>> base_name("gps[n_eigenvalues=25]")
    'gps'
    """
    return name.partition("[")[0]


def combinations(text: str) -> list[dict[str, str]]:
    """Return all combinations of one value for each parameter, the last one varying fastest.

    ``|`` separates values of one parameter, commas separate parameters. Both are literal inside
    parentheses, which enclose a value of several numbers, and inside quotes, which enclose text and
    are removed.

    Parameters
    ----------
    text
        The text between the brackets of a method on the command line.

    Returns
    -------
    list of dict
        Values by name, as text; a single empty choice for an empty text.

    Raises
    ------
    ConfigurationError
        If a name or a value is missing, a name is given twice, or a quote or a parenthesis is not
        closed.

    Examples
    --------
    >>> combinations("start=mesh|classic,size=3")
    [{'start': 'mesh', 'size': '3'}, {'start': 'classic', 'size': '3'}]
    """
    values = {}
    for name, alternatives in assignments(text).items():
        values[name] = _values(name, split(alternatives, "|") or [""])
    choices = itertools.product(*values.values())
    return [dict(zip(values, choice, strict=True)) for choice in choices]


def _values(name: str, parts: list[str]) -> list[str]:
    """Return the values of a parameter without blanks and quotes around them."""
    texts = [part.strip() for part in parts]
    if len(texts) > 1 and not all(texts):
        hint = "write VALUE|VALUE, or '' for an empty text"
        raise ConfigurationError(f"'{name}' has an empty value", hint)
    return list(map(unquoted, texts))
