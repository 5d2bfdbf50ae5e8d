"""Lines of records: what many of them share is named by its digest, and kept once."""

from __future__ import annotations

import hashlib
import json
import re
import string
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import msgspec

#: Parts of a record that are shared as a whole, by the file that keeps them.
_WHOLE = {"data": "galleries", "shapes": "galleries", "labels": "galleries", "chance": "galleries", "notes": "notes"}

#: Files of what is shared.
KINDS = ("code", "environments", "galleries", "notes")

_SHARED = re.compile(rb'\{"digest":"([0-9a-f]{16})","content":(.*)\}')

#: A character for each of the values that a measure takes, where these are so few.
_CHARACTERS = string.digits + string.ascii_letters

#: Part of the records of version 0.2 that says how they got their keys.
_MOVES = "rekeyed"


class SharedParts:
    """Contents that records share, by kind and digest; a content whose digest is another one is as good as none."""

    def __init__(self) -> None:
        self.lines: dict[str, dict[bytes, bytes]] = {kind: {} for kind in KINDS}

    def add(self, kind: str, content: Any) -> str:
        """Keep a content; returns its digest."""
        text = _compact(content)
        digest = _digest(text)
        self.lines[kind][digest.encode()] = b'{"digest":"%s","content":%s}' % (digest.encode(), text)
        return digest

    def content(self, kind: str, digest: str) -> Any:
        """Return what has a digest; raises ``KeyError`` where there is no such content."""
        return _decoded(self.lines[kind][digest.encode()])["content"]

    def read(self, kind: str, text: bytes) -> None:
        """Take over the lines of a file; a damaged one, too, for whoever can repair it."""
        for line in text.splitlines():
            match = _SHARED.fullmatch(line)
            is_whole = match is not None and _digest(match[2]).encode() == match[1]
            self.lines[kind][match[1] if match and is_whole else b"~" + line] = line

    def update(self, other: SharedParts) -> None:
        """Take over what another one holds."""
        for kind, lines in other.lines.items():
            self.lines[kind].update(lines)


@lru_cache(maxsize=2**14)
def _decoded(line: bytes) -> Any:
    return msgspec.json.decode(line)


def as_line(record: Mapping[str, Any], parts: SharedParts) -> bytes:
    """Return a record as a line, the key first, with digests in the place of what it shares with others.

    Raises
    ------
    ValueError
        If it holds a number that JSON does not have.
    """
    line = _with_parts(record, parts.add)
    if "per_query" in line:
        line["per_query"] = {name: _packed_values(values) for name, values in line["per_query"].items()}
    return b'{"key":%s,%s' % (_compact(line.pop("key")), _compact(line)[1:])


def unpacked(line: Mapping[str, Any], parts: SharedParts) -> dict[str, Any]:
    """Return the record of a line; raises ``LookupError``, ``TypeError`` or ``AttributeError`` if it is none."""
    record = _with_parts(line, parts.content)
    record.pop(_MOVES, None)
    if "per_query" in line:
        record["per_query"] = {name: _unpacked_values(values) for name, values in line["per_query"].items()}
    return record


def _with_parts(record: Mapping[str, Any], other: Callable[[str, Any], Any]) -> dict[str, Any]:
    """Return a record with something else in the place of each part that others share."""
    changed = dict(record)
    changed |= {name: other(kind, record[name]) for name, kind in _WHOLE.items() if name in record}
    if "code" in record["recipe"]:
        code = {stage: other("code", part) for stage, part in record["recipe"]["code"].items()}
        changed["recipe"] = {**record["recipe"], "code": code}
    if "environments" in record:
        changed["environments"] = [
            {name: other("environments", part) if name == "environment" else part for name, part in origin.items()}
            for origin in record["environments"]
        ]
    return changed


def _packed_values(values: list[float | None]) -> Any:
    """Values and a character for each query, where there are few different ones; else the list itself."""
    texts = list(map(repr, values))
    distinct = dict(zip(texts, values, strict=True))  # by their texts, for 1 is not written like 1.0
    if len(distinct) > len(_CHARACTERS):
        return values
    ranked = sorted(distinct, key=lambda text: (distinct[text] is None, distinct[text] or 0, text))
    character = dict(zip(ranked, _CHARACTERS, strict=False))
    return {"values": [distinct[text] for text in ranked], "queries": "".join(map(character.__getitem__, texts))}


def _unpacked_values(values: Any) -> Any:
    if not isinstance(values, dict):
        return values
    value_of = dict(zip(_CHARACTERS, values["values"], strict=False))
    return [value_of[character] for character in values["queries"]]


def _digest(text: bytes) -> str:
    return hashlib.sha256(text).hexdigest()[:16]


def _compact(content: Any) -> bytes:
    return json.dumps(content, sort_keys=True, allow_nan=False, separators=(",", ":")).encode()
