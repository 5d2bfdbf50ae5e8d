"""Names with parameters in brackets, and several values of a parameter in one text.

``metric=geodesic|biharmonic,power=1|2`` stands for four choices.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator

from benchmark.errors import ConfigurationError
from benchmark.plugins.parameters.values import assignments

__all__ = ["combinations", "quoted", "split_name"]

#: Characters that mean something between the brackets of a method: a text that has one of them is quoted.
_SPECIAL = frozenset("|,()'\" ")

_QUOTES = "'\""

_NAME = re.compile(r"([^\[\]]+)(?:\[([^\[\]]*)\])?")


def split_name(name: str) -> tuple[str, str] | None:
    """A name and what stands in brackets behind it, "" if nothing does; None where brackets do not close or follow.

    Examples
    --------
    >>> split_name("classic-mds[metric=biharmonic]")
    ('classic-mds', 'metric=biharmonic')
    """
    match = _NAME.fullmatch(name.strip())
    return (match[1].strip(), match[2] or "") if match else None


def combinations(text: str) -> list[dict[str, str]]:
    """Every choice of one value for each parameter, the last one varying fastest.

    Values of one parameter stand between ``|``, parameters between commas. Neither separates inside parentheses, which
    hold one value of several numbers, or inside quotes, which hold a text as it is and are taken off.

    Parameters
    ----------
    text
        What stands between the brackets of a method on the command line.

    Returns
    -------
    list of dict
        Values by name, as text; a single empty choice for an empty text.

    Raises
    ------
    ConfigurationError
        If a name or a value is missing, a name is given twice, or a quote or a parenthesis has no other half.

    Examples
    --------
    >>> combinations("metric=geodesic|biharmonic,size=3")
    [{'metric': 'geodesic', 'size': '3'}, {'metric': 'biharmonic', 'size': '3'}]
    """
    given = assignments(_parts(text, ",") if text.strip() else [])
    values = {name: _values(name, _parts(text, "|")) for name, text in given.items()}
    return [dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*values.values())]


def quoted(text: str) -> str:
    """A text as it is written between the brackets of a method: in quotes where it could be taken for several."""
    if text and not _SPECIAL & set(text):
        return text
    quote = '"' if "'" in text else "'"
    return f"{quote}{text}{quote}"


def _values(name: str, parts: list[str]) -> list[str]:
    texts = [part.strip() for part in parts]
    if len(texts) > 1 and not all(texts):
        raise ConfigurationError(f"'{name}' has an empty value", "write VALUE|VALUE, or '' for an empty text")
    return [text[1:-1] if len(text) > 1 and text[0] in _QUOTES and text[0] == text[-1] else text for text in texts]


def _parts(text: str, separator: str) -> list[str]:
    """Return what stands between separators that are neither in quotes nor in parentheses."""
    parts = [""]
    for character, is_outside in _watched(text):
        if character == separator and is_outside:
            parts.append("")
        else:
            parts[-1] += character
    return parts


def _watched(text: str) -> Iterator[tuple[str, bool]]:
    """Each character, and whether it stands outside of quotes and parentheses."""
    quote, depth = "", 0
    for place, character in enumerate(text):
        if quote:
            quote = "" if character == quote else quote
        elif character in _QUOTES and text[:place].rstrip()[-1:] in ("", "=", "|", ",", "("):
            quote = character  # elsewhere, it is an apostrophe
        else:
            depth += {"(": 1, ")": -1}.get(character, 0)
        yield character, not quote and depth == 0
    if quote or depth:
        raise ConfigurationError(
            f"'{text}' has {'a quote' if quote else 'a parenthesis'} without its other half", "close what is opened"
        )
