"""Records as lines of text: what many of them share is named by its digest, and kept once."""

from __future__ import annotations

import hashlib
import json
import string
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

#: Digits of the digest by which a line names what it shares with others.
_DIGITS = 16

#: Parts of a record that are shared as a whole, by the file that keeps them.
_WHOLE = {"data": "galleries", "shapes": "galleries", "labels": "galleries", "chance": "galleries", "notes": "notes"}

#: Files of what is shared.
KINDS = ("code", "environments", "galleries", "notes")

#: A character for each of the values that a measure takes, where these are so few.
_CHARACTERS = string.digits + string.ascii_letters

#: Part of the records of version 0.2 that says how they got their keys.
_MOVES = "rekeyed"

_BEFORE_DIGEST, _BEFORE_CONTENT = b'{"digest":"', b'","content":'

#: Where a line of a record has its key.
_KEY_AT = slice(8, 40)


class SharedParts:
    """Contents that records share, by kind and digest; a content whose digest is another one is as good as none."""

    def __init__(self) -> None:
        self._texts: dict[str, dict[str, bytes]] = {kind: {} for kind in KINDS}
        self._contents: dict[tuple[str, str], Any] = {}
        self._damaged: dict[str, dict[bytes, None]] = {kind: {} for kind in KINDS}

    def add(self, kind: str, content: Any) -> str:
        """Keep a content; returns its digest."""
        text = _compact(content).encode()
        digest = _digest(text)
        self._texts[kind][digest] = text
        return digest

    def content(self, kind: str, digest: str) -> Any:
        """Return what has a digest; raises ``KeyError`` where there is no such content."""
        if (kind, digest) not in self._contents:
            self._contents[kind, digest] = msgspec.json.decode(self._texts[kind][digest])
        return self._contents[kind, digest]

    def read(self, kind: str, text: bytes) -> None:
        """Take over the lines of a file."""
        start = len(_BEFORE_DIGEST)
        for line in text.splitlines():
            digest = line[start : start + _DIGITS].decode("ascii", "replace")
            content = line[start + _DIGITS + len(_BEFORE_CONTENT) : -1]
            if _digest(content) == digest:
                self._texts[kind][digest] = content
            else:
                self._damaged[kind][line] = None

    def update(self, other: SharedParts) -> None:
        """Take over what another one holds."""
        for kind in KINDS:
            self._texts[kind].update(other._texts[kind])
            self._damaged[kind].update(other._damaged[kind])

    def files(self) -> Iterator[tuple[str, bytes]]:
        """Kind and lines of each file, sorted by their digests."""
        for kind, texts in self._texts.items():
            lines = (b"".join((_BEFORE_DIGEST, d.encode(), _BEFORE_CONTENT, texts[d], b"}\n")) for d in sorted(texts))
            yield kind, b"".join([*lines, *(line + b"\n" for line in self._damaged[kind])])


def packed(record: Mapping[str, Any], parts: SharedParts) -> dict[str, Any]:
    """Return a record with digests in the place of what it shares with others, which is added to the parts."""
    line = dict(record)
    line |= {name: parts.add(kind, line[name]) for name, kind in _WHOLE.items() if name in line}
    if "code" in line["recipe"]:
        code = {stage: parts.add("code", each) for stage, each in line["recipe"]["code"].items()}
        line["recipe"] = line["recipe"] | {"code": code}
    if "environments" in line:
        line["environments"] = [
            each | {"environment": parts.add("environments", each["environment"])} if "environment" in each else each
            for each in line["environments"]
        ]
    if "per_query" in line:
        line["per_query"] = {name: _packed_values(values) for name, values in line["per_query"].items()}
    return line


def unpacked(line: Mapping[str, Any], parts: SharedParts) -> dict[str, Any]:
    """Return the record of a line; raises ``LookupError``, ``TypeError`` or ``AttributeError`` if it is none."""
    record = {name: part for name, part in line.items() if name != _MOVES}
    record |= {name: parts.content(kind, line[name]) for name, kind in _WHOLE.items() if name in line}
    if "code" in line["recipe"]:
        code = {stage: parts.content("code", each) for stage, each in line["recipe"]["code"].items()}
        record["recipe"] = line["recipe"] | {"code": code}
    if "environments" in line:
        record["environments"] = [
            each | {"environment": parts.content("environments", each["environment"])}
            if "environment" in each
            else each
            for each in line["environments"]
        ]
    if "per_query" in line:
        record["per_query"] = {name: _unpacked_values(values) for name, values in line["per_query"].items()}
    return record


def as_line(record: Mapping[str, Any], parts: SharedParts) -> bytes:
    """Return a record as a line, the key first; raises ``ValueError`` for a number that JSON does not have."""
    rest = packed(record, parts)
    return f'{{"key":{_compact(rest.pop("key"))},{_compact(rest)[1:]}'.encode()


def key_of(line: bytes) -> str:
    """Return the key that a line says it has."""
    return line[_KEY_AT].decode("ascii", "replace")


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
    return hashlib.sha256(text).hexdigest()[:_DIGITS]


def _compact(content: Any) -> str:
    return json.dumps(content, sort_keys=True, allow_nan=False, separators=(",", ":"))
