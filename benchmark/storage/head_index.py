"""Heads of records, by the digest of the text that they were read from: what a list of all of them needs.

A head is the record without the parts that are large. The index is derived: a head counts only for the very text that
it was made of, so that no record changes unnoticed, and a file that is damaged or cannot be written is as good as none.
"""

from __future__ import annotations

import hashlib
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from benchmark.storage import keys, lines, record_schema
from benchmark.storage.derived import read_derived, write_derived
from benchmark.storage.lines import SharedParts, packed, unpacked
from retrieval import chance, measures

#: Name of the file in a folder of records.
INDEX = ".index"

#: Parts that a head lacks.
LARGE = frozenset({"per_query", "notes"})

#: New heads from which on it is worth to write the file.
_WORTH = 100

#: Modules by which a text is a record, or none.
_READ_BY = (keys, lines, record_schema, chance, measures)


class HeadIndex:
    """The heads in a file, and those that are added.

    Parameters
    ----------
    path
        The file; it need not exist.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._before, self._parts = _read(path)
        self._seen: dict[str, dict[str, Any]] = {}
        self._n_new = 0

    def head(self, text: bytes, key: str) -> dict[str, Any] | None:
        """Return the head of the record that a text holds, if it is known and has this key."""
        digest = _digest(text)
        line = self._before.get(digest)
        if line is None or line["key"] != key:
            return None
        self._seen[digest] = line
        return unpacked(line, self._parts)

    def knows(self, text: bytes) -> bool:
        """Return whether a text was found to be a record before."""
        return _digest(text) in self._before

    def add(self, text: bytes, record: dict[str, Any]) -> dict[str, Any]:
        """Return the head of the record that was read from a text, and keep it."""
        head = {name: part for name, part in record.items() if name not in LARGE}
        self._seen[_digest(text)] = packed(head, self._parts)
        self._n_new += 1
        return head

    def write(self) -> None:
        """Write down the heads that were asked for and added, if there are many new ones."""
        if self._n_new < _WORTH:
            return
        parts = {kind: text.decode() for kind, text in self._parts.files()}
        write_derived(self._path, _version(), {"heads": self._seen, "parts": parts})


def _read(path: Path) -> tuple[dict[str, dict[str, Any]], SharedParts]:
    try:
        facts = path.stat()
    except OSError:
        return {}, SharedParts()
    return _read_once(path, (facts.st_ino, facts.st_size, facts.st_mtime_ns))


@lru_cache(maxsize=4)
def _read_once(path: Path, state: tuple[int, ...]) -> tuple[dict[str, dict[str, Any]], SharedParts]:
    parts, found = SharedParts(), read_derived(path, _version()) or {"heads": {}, "parts": {}}
    for kind, text in found["parts"].items():
        parts.read(kind, text.encode())
    return found["heads"], parts


@cache
def _version() -> str:
    """Digest of the code that reads records."""
    files = (Path(__file__), *(Path(str(module.__file__)) for module in _READ_BY))
    return _digest(b"".join(file.read_bytes() for file in files))


def _digest(text: bytes) -> str:
    return hashlib.sha256(text).hexdigest()[:32]
