"""The sources of methods and data as text: what the BibTeX file says of one."""

from __future__ import annotations

import re
import unicodedata
from functools import cache
from importlib import resources

__all__ = ["is_listed", "source_of"]

#: Accents of TeX, as characters that combine with the letter before them.
_ACCENTS = {"'": "\u0301", "`": "\u0300", "^": "\u0302", '"': "\u0308", "~": "\u0303", "u": "\u0306", "v": "\u030c",
            "c": "\u0327", "=": "\u0304", ".": "\u0307", "H": "\u030b", "r": "\u030a"}  # fmt: skip


def source_of(key: str) -> str:
    """Authors, year, title and place of an entry, as text; the key itself if there is no such entry."""
    match = re.search(rf"@\w+\{{{re.escape(key)},(.*?)\n\}}", _bibliography(), re.DOTALL) if key else None
    if match is None:
        return key
    body = re.sub(r"\n(?!\s*\w+\s*=)\s*", " ", match[1])  # one field, one line
    fields = {name: _as_text(text) for name, text in re.findall(r"^\s*(\w+)\s*=\s*\{(.*)\},?$", body, re.MULTILINE)}
    *others, last = re.split(r"\s+and\s+", fields.get("author", ""))
    named = f"{', '.join(others)} and {last}" if others else last
    if year := fields.get("year"):
        named = f"{named} ({year})".strip()
    place = next((fields[name] for name in ("journal", "booktitle", "publisher", "note") if name in fields), "")
    return ". ".join(filter(None, (named, fields.get("title", ""), place)))


def is_listed(key: str) -> bool:
    """Return whether the list of references has an entry of this name."""
    return bool(key) and f"{{{key},\n" in _bibliography()


@cache
def _bibliography() -> str:
    return resources.files("benchmark.reference").joinpath("references.bib").read_text(encoding="utf-8")


def _as_text(tex: str) -> str:
    """Text of a field: accents as characters, without braces."""
    tex = re.sub(r"""\\(['`^"~=.]|[uvcHr](?=[{\s]))\s*\{?\\?([A-Za-z])\}?""", _accented, tex)
    tex = re.sub(r"\\([&%_#$])", r"\1", tex).replace("--", "\u2013").replace("~", " ")
    return re.sub(r"[{}]", "", tex)


def _accented(found: re.Match[str]) -> str:
    return unicodedata.normalize("NFC", found[2] + _ACCENTS[found[1]])
