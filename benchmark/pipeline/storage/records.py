"""Records of finished jobs: a small JSON file each when they are written, gathered into text files of a line each."""

from __future__ import annotations

import hashlib
import json
import os
import re
import stat
import string
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from benchmark.files import locked, write_atomically, write_text
from benchmark.pipeline.storage.keys import digest
from benchmark.pipeline.storage.lock import EDITED
from benchmark.pipeline.storage.record_schema import chance_of_labels, fault_of, read_json
from benchmark.text import LONGEST_NAME

Record = dict[str, Any]

#: Bytes beyond which a file is no record; that of 300 shapes has a five-hundredth of it.
LARGEST_FILE = 2**25

#: Bytes beyond which a file of gathered records is none; each of them has some thousand.
LARGEST_GATHERED = 2**31

#: Folder, in that of gathered records, of what they share.
_PARTS = "parts"

#: Parts that say when and where a job was done, not what came out.
CIRCUMSTANCES = frozenset(
    {
        "finished",
        "wall_seconds",
        "environments",
        "cost",
        "peak_mib",
        "artefacts",
        "digests",
        "commit",
        "rekeyed",
        "files",
    }
)

#: Parts that have no meaning on another machine.
LOCAL = frozenset({"artefacts", "files"})


#: Scorer of a record that names none, and what the record of a descriptor says in its place.
DEFAULT_SCORER, NO_SCORER = "cm-bof", "none"

#: Family of rows of which other programs computed the distances or the forms.
EXTERNAL = "external"

#: Skipped files of a folder that are named one by one.
MOST_TOLD = 10

_HINT = "remove it or move it elsewhere"


class _Source(NamedTuple):
    """Text of a record, whose ``key`` its place tells, and the name of that place in messages."""

    key: str
    name: str
    text: bytes
    parts: SharedParts | None = None


# Lines: what many records share is named by its digest, and kept once ------------------------------------------------

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


# Folders -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Records:
    """A folder of records.

    Parameters
    ----------
    folder
        Holds ``KEY.json`` for each job, or its line in ``DATASET.jsonl`` and what the lines share in ``parts``. A file
        counts more than a line.
    skipped
        Why a file, or a line, is no record, by its name, for those found so far.
    """

    folder: Path
    skipped: dict[str, str] = field(default_factory=dict, compare=False)
    _told: set[str] = field(default_factory=set, compare=False, repr=False)
    _checked: dict[bytes, Record] = field(default_factory=dict, compare=False, repr=False)

    def write(self, record: Mapping[str, Any]) -> None:
        """Keep a record in a file of its own; a later one under the same key replaces it as a whole.

        Raises
        ------
        OSError
            If it cannot be written.
        ValueError
            If it holds a number that JSON does not have.
        """
        write_text(self._path(record["key"]), as_text(record), durable=True)

    def read(self, key: str) -> Record | None:
        """Return the record of a job; None when there is none that can be read."""
        sources = (self._file(self._path(key)), *self._lines.get(key, ()))
        return next((record for source in sources if source and (record := self._record(source))), None)

    def remove(self, *keys: str) -> None:
        """Remove the records of jobs."""
        for key in keys:
            self._path(key).unlink(missing_ok=True)
        if not self._lines.keys().isdisjoint(keys):
            with locked(self.folder, alone=True):
                self._reread()
                self._rewrite(self._all_lines(), without=keys)

    def gather(self) -> int:
        """Bring the records that have files of their own into one file of lines for each data set.

        Nobody may write records meanwhile.

        Returns
        -------
        int
            Number of files that have become lines.

        Raises
        ------
        OSError
            If the folder cannot be written; every record is in its file or in a line still.
        """
        with locked(self.folder, alone=True):
            files = [source for source in self._files() if "-" not in source.key and self._record(source)]
            self._reread()
            if files:
                self._rewrite([*files, *self._all_lines()])
                for source in files:
                    (self.folder / source.name).unlink()
        return len(files)

    def __contains__(self, key: str) -> bool:
        return self._path(key).is_file() or key in self._lines

    def __iter__(self) -> Iterator[Record]:
        """All records, oldest first; the same order wherever the files lie."""
        found: dict[str, Record] = {}
        for source in self._sources():
            if record := self._record(source):  # one that is none is told also where another one counts
                found.setdefault(source.key, record)
        return iter(sorted(found.values(), key=lambda record: (str(record.get("finished", "")), record["key"])))

    @property
    def has_files(self) -> bool:
        """Return whether there are files where records lie, good ones or not."""
        return any(path.suffix in (".json", ".jsonl") for path in self.folder.glob("*.json*"))

    def news(self) -> list[str]:
        """A line for each file that was skipped and has not been told before."""
        found = [name for name in sorted(self.skipped) if name not in self._told]
        self._told.update(found)
        hints = {".": "change its rights"}
        lines = [
            f"skipped {self.folder / name}: {self.skipped[name]}; {hints.get(name, _HINT)}"
            for name in found[:MOST_TOLD]
        ]
        further = len(found) - len(lines)
        return lines + ([f"skipped {further} further files in {self.folder}; {_HINT}"] if further else [])

    # ------------------------------------------------------------------------------------------------------------------

    def _path(self, key: str) -> Path:
        edit, hyphen, _ = key.partition("-")
        return (self.folder.parent / EDITED / edit / "records" if hyphen else self.folder) / f"{key}.json"

    def _sources(self) -> Iterator[_Source]:
        """Texts of all records, those of files first: what is gathered meanwhile is found in its line."""
        if self.folder.is_dir() and not os.access(self.folder, os.R_OK | os.X_OK):
            self.skipped["."] = "this user may not read it"
        with locked(self.folder):
            yield from self._files()
            self._reread()
            yield from self._all_lines()

    def _files(self) -> Iterator[_Source]:
        paths = (*self.folder.glob("*.json"), *self.folder.parent.glob(f"{EDITED}/*/records/*.json"))
        return (source for path in paths if (source := self._file(path)))

    def _file(self, path: Path) -> _Source | None:
        text = self._bytes(path, LARGEST_FILE)
        return None if text is None else _Source(path.stem, path.name, text)

    def _reread(self) -> None:
        """Look at the gathered records anew: they may have changed since."""
        self.__dict__.pop("_lines", None)

    @cached_property
    def _lines(self) -> dict[str, list[_Source]]:
        """Lines of gathered records by the keys that they say, the last ones first; as they were at the first look."""
        parts, found = SharedParts(), dict[str, list[_Source]]()
        texts = {path.name: self._bytes(path, LARGEST_GATHERED) for path in sorted(self.folder.glob("*.jsonl"))}
        for kind in KINDS if texts else ():
            parts.read(kind, self._bytes(self.folder / _PARTS / f"{kind}.jsonl", LARGEST_GATHERED) or b"")
        for name, text in texts.items():
            for number, line in enumerate((text or b"").splitlines(), 1):
                found.setdefault(key_of(line), []).insert(0, _Source(key_of(line), f"{name}:{number}", line, parts))
        return found

    def _all_lines(self) -> list[_Source]:
        return [line for lines in self._lines.values() for line in lines]

    def _rewrite(self, sources: Iterable[_Source], without: Collection[str] = ()) -> None:
        """Write lines anew; of several records of one key the first counts, and a line that is none stays as it is."""
        if unread := sorted(name for name in self.skipped if name.endswith(".jsonl")):
            raise OSError(f"{self.folder / unread[0]} cannot be written anew: {self.skipped[unread[0]]}")
        parts, tables = SharedParts(), dict[str, dict[tuple[Any, ...], bytes]]()
        before = next((source.parts for source in self._all_lines() if source.parts), SharedParts())
        done = set(without)
        for source in sources:
            record = self._record(source)
            if record is None:
                parts.update(before)  # whoever can read it needs them
                damaged = ("", "", "", 0, "", source.key, source.text)
                tables.setdefault(source.name.partition(":")[0], {})[damaged] = source.text
            elif source.key not in done:
                done.add(source.key)
                tables.setdefault(_table_of(record), {})[(*place(record), source.key)] = as_line(record, parts)
        old = {path.name for path in self.folder.glob("*.jsonl")}
        before.update(parts)  # until the last line is written, both those of before and those of now are needed
        self._write_parts(before)
        for name in sorted(old | tables.keys()):
            lines = tables.get(name, {})
            self._write(self.folder / name, b"".join(lines[where] + b"\n" for where in sorted(lines)))
        self._write_parts(parts)
        self._reread()

    def _write_parts(self, parts: SharedParts) -> None:
        for kind, text in parts.files():
            self._write(self.folder / _PARTS / f"{kind}.jsonl", text)

    def _write(self, path: Path, text: bytes) -> None:
        """Write a file whose content changes; an empty one goes."""
        if not text:
            path.unlink(missing_ok=True)
        elif not path.is_file() or path.read_bytes() != text:
            write_atomically(path, lambda file: file.write(text), durable=True)

    def _bytes(self, path: Path, most: int) -> bytes | None:
        """Content of a file; None, with a note why, where it is none that can be read."""
        try:
            status = path.stat()
            if stat.S_ISREG(status.st_mode) and status.st_size <= most:
                return path.read_bytes()
            self.skipped[path.name] = "it is too large" if stat.S_ISREG(status.st_mode) else "it is no file"
        except FileNotFoundError:
            if path.is_symlink():
                self.skipped[path.name] = "the link leads nowhere"
        except OSError as error:
            self.skipped[path.name] = f"it cannot be read: {error.strerror}"
        return None

    def _record(self, source: _Source) -> Record | None:
        """Record of a text; None, with a note why, where it holds none."""
        if source.text in self._checked:
            return dict(self._checked[source.text])
        content, fault = _parsed(source)
        fault = fault or fault_of(content)
        if not fault and content["key"] != source.key:
            fault = "it has the name of another job"
        if fault:
            self.skipped[source.name] = fault
            return None
        self._checked[source.text] = content
        return dict(content)


def _parsed(source: _Source) -> tuple[Any, str]:
    """Return what a text says, or why it says nothing."""
    try:
        content = read_json(source.text)
    except (ValueError, RecursionError):
        return None, "it is not JSON"
    try:
        return (content if source.parts is None else unpacked(content, source.parts)), ""
    except (LookupError, TypeError, AttributeError, ValueError):
        return None, f"it names what is not in {_PARTS}"


def _table_of(record: Mapping[str, Any]) -> str:
    """Return the name of the file of gathered records of a data set, whatever its parameters."""
    base = str(record["data"]["name"]).partition("[")[0]
    return f"{re.sub('[^A-Za-z0-9-]+', '-', base)[:LONGEST_NAME] or 'records'}.jsonl"


def as_text(record: Mapping[str, Any]) -> str:
    """A record as JSON with one part a line: small, and differences between two versions can be read."""
    parts = (
        f"{json.dumps(name)}: {json.dumps(record[name], sort_keys=True, allow_nan=False, separators=(',', ':'))}"
        for name in sorted(record)
    )
    return "{\n" + ",\n".join(parts) + "\n}\n"


def outcome(record: Mapping[str, Any]) -> str:
    """Digest of what came out of a job, whenever and wherever it was done."""
    return digest({name: value for name, value in record.items() if name not in CIRCUMSTANCES})


def portable(record: Mapping[str, Any]) -> Record:
    """A record without what means nothing on another machine."""
    return {name: value for name, value in record.items() if name not in LOCAL}


def answered_shapes(record: Mapping[str, Any]) -> list[str]:
    """Return the shapes of a record that have a result, in the order of its distances."""
    refused = {name for name, _ in record["unsupported"]}
    return [name for name in record["shapes"] if name not in refused]


def answered_labels(record: Mapping[str, Any]) -> list[str]:
    """Return the classes of :func:`answered_shapes`."""
    labels = dict(zip(record["shapes"], record["labels"], strict=True))
    return [labels[name] for name in answered_shapes(record)]


def coverage_of(record: Mapping[str, Any]) -> float:
    """Return the share of the shapes that could be had of which a record has a result; 0 for one without scores."""
    if not record.get("scores"):
        return 0.0
    if "coverage" in record:
        return float(record["coverage"])
    refused = len(record.get("unsupported", ()))  # records of before did not count what was refused as shapes
    return 1 - refused / (len(record["shapes"]) + refused) if refused else 1.0


def chance_of(record: Mapping[str, Any]) -> dict[str, float]:
    """Return what a random ranking of the gallery of a record with scores reaches, by measure."""
    return dict(chance_of_labels(tuple(record["labels"])))


def models_proven_by(record: Mapping[str, Any]) -> frozenset[str]:
    """Return the digests of the models by which the method of a record has made scores."""
    return frozenset(record["recipe"].get("models", {}).values() if record["status"] == "ok" else ())


class Place(NamedTuple):
    """Place of a record: one place holds one result, however often it was made."""

    gallery: str
    input: str
    method: str
    seed: int = 0
    scorer: str = DEFAULT_SCORER


def place(record: Mapping[str, Any]) -> Place:
    """Return where a record belongs."""
    seed = int(record["recipe"].get("seed", 0))
    return Place(record["gallery"], record["input"], record["method"], seed, scorer_name(record) or DEFAULT_SCORER)


def scorer_name(record: Mapping[str, Any]) -> str:
    """Name of the scorer of a record; "" for a descriptor, whose record says that there is none."""
    found = str(record.get("scorer", DEFAULT_SCORER))
    return "" if found == NO_SCORER else found


def by_place(records: Iterable[Record]) -> dict[Place, list[Record]]:
    """Records by the place where they belong, in their order."""
    places: dict[Place, list[Record]] = {}
    for record in records:
        places.setdefault(place(record), []).append(record)
    return places
