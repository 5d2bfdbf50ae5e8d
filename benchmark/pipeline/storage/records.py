"""Records of finished jobs: a small JSON file each when they are written, gathered into text files of a line each."""

from __future__ import annotations

import json
import os
import re
import stat
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from benchmark.files import locked, write_atomically, write_text
from benchmark.pipeline.storage import record_schema as schema
from benchmark.pipeline.storage.keys import digest
from benchmark.pipeline.storage.lock import EDITED
from benchmark.pipeline.storage.record_schema import SharedParts
from benchmark.text import LONGEST_NAME

Record = dict[str, Any]

#: Bytes beyond which a file is no record; that of 300 shapes has a five-hundredth of it.
LARGEST_FILE = 2**25

#: Bytes beyond which a file of gathered records is none; each of them has some thousand.
LARGEST_GATHERED = 2**31

#: Where a line of a record has its key.
_KEY_AT = slice(8, 40)

#: Folder, in that of gathered records, of what they share.
_PARTS = "parts"

#: Parts that say when and where a job was done, not what came out.
CIRCUMSTANCES = frozenset(
    {"finished", "wall_seconds", "environments", "cost", "peak_mib", "artefacts"}
    | {"digests", "commit", "rekeyed", "files"}
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


@dataclass(eq=False)
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
    skipped: dict[str, str] = field(default_factory=dict)
    _reported: set[str] = field(default_factory=set, repr=False)
    _checked: dict[bytes, Record] = field(default_factory=dict, repr=False)
    _gathered: dict[str, list[_Source]] | None = field(default=None, repr=False)

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
        sources = (*self._files(self._path(key)), *self._lines.get(key, ()))
        return next((record for source in sources if (record := self._record(source))), None)

    def remove(self, *keys: str) -> None:
        """Remove the records of jobs."""
        for key in keys:
            self._path(key).unlink(missing_ok=True)
        if not self._lines.keys().isdisjoint(keys):
            with locked(self.folder, alone=True):
                self._rewrite((), without=keys)

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
            files = [source for source in self._all_files() if "-" not in source.key and self._record(source)]
            if files:
                self._rewrite(files)
            for source in files:
                (self.folder / source.name).unlink()
        return len(files)

    def __contains__(self, key: str) -> bool:
        return self._path(key).is_file() or key in self._lines

    def __iter__(self) -> Iterator[Record]:
        """All records, oldest first; the same order wherever the files lie."""
        if self.folder.is_dir() and not os.access(self.folder, os.R_OK | os.X_OK):
            self.skipped["."] = "this user may not read it"
        records: dict[str, Record] = {}
        with locked(self.folder):
            sources = list(self._all_files())  # before the lines: what is gathered meanwhile has a line
            self._gathered = None
            for source in (*sources, *self._all_lines()):
                if record := self._record(source):  # what is no record is named also where another one counts
                    records.setdefault(source.key, record)
        return iter(sorted(records.values(), key=lambda record: (str(record.get("finished", "")), record["key"])))

    @property
    def has_files(self) -> bool:
        """Return whether there are files where records lie, good ones or not."""
        return any(path.suffix in (".json", ".jsonl") for path in self.folder.glob("*.json*"))

    def news(self) -> list[str]:
        """A line for each file that was skipped and has not been named before."""
        names = sorted(self.skipped.keys() - self._reported)
        self._reported.update(names)
        lines = [
            f"skipped {self.folder / name}: {self.skipped[name]}; {'change its rights' if name == '.' else _HINT}"
            for name in names[:MOST_TOLD]
        ]
        further = len(names) - len(lines)
        return lines + ([f"skipped {further} further files in {self.folder}; {_HINT}"] if further else [])

    # ------------------------------------------------------------------------------------------------------------------

    def _path(self, key: str) -> Path:
        edit, hyphen, _ = key.partition("-")
        return (self.folder.parent / EDITED / edit / "records" if hyphen else self.folder) / f"{key}.json"

    def _files(self, *paths: Path) -> Iterator[_Source]:
        for path in paths:
            if (text := self._bytes(path, LARGEST_FILE)) is not None:
                yield _Source(path.stem, path.name, text)

    def _all_files(self) -> Iterator[_Source]:
        return self._files(*self.folder.glob("*.json"), *self.folder.parent.glob(f"{EDITED}/*/records/*.json"))

    @property
    def _lines(self) -> dict[str, list[_Source]]:
        """Lines of gathered records by the keys that they say, the last ones first; as they were at the first look."""
        if self._gathered is None:
            parts, self._gathered = SharedParts(), {}
            tables = {path.name: self._bytes(path, LARGEST_GATHERED) for path in sorted(self.folder.glob("*.jsonl"))}
            for kind in schema.KINDS if tables else ():
                parts.read(kind, self._bytes(self.folder / _PARTS / f"{kind}.jsonl", LARGEST_GATHERED) or b"")
            for name, text in tables.items():
                for number, line in enumerate((text or b"").splitlines(), 1):
                    key = line[_KEY_AT].decode("ascii", "replace")
                    self._gathered.setdefault(key, []).insert(0, _Source(key, f"{name}:{number}", line, parts))
        return self._gathered

    def _all_lines(self) -> list[_Source]:
        return [line for lines in self._lines.values() for line in lines]

    def _rewrite(self, files: Iterable[_Source], without: Collection[str] = ()) -> None:
        """Write lines anew; of several records of one key the first counts, and a line that is none stays as it is."""
        self._gathered = None
        lines = self._all_lines()
        if unread := sorted(name for name in self.skipped if name.endswith(".jsonl")):
            raise OSError(f"{self.folder / unread[0]} cannot be written anew: {self.skipped[unread[0]]}")
        parts, before = SharedParts(), (lines[0].parts if lines else None) or SharedParts()
        tables: dict[str, dict[tuple[Any, ...], bytes]] = {path.name: {} for path in self.folder.glob("*.jsonl")}
        done = set(without)
        for source in (*files, *lines):
            record = self._record(source)
            if record is None:
                parts.update(before)  # whoever can read it needs them
                tables[source.name.partition(":")[0]]["", "", "", 0, "", source.key, source.text] = source.text
            elif source.key not in done:
                done.add(source.key)
                tables.setdefault(_table_of(record), {})[*place(record), source.key] = schema.as_line(record, parts)
        before.update(parts)  # until the last line is written, both those of before and those of now are needed
        self._write_parts(before)
        for name in sorted(tables):
            self._write(self.folder / name, tables[name])
        self._write_parts(parts)
        self._gathered = None

    def _write_parts(self, parts: SharedParts) -> None:
        for kind, lines in parts.lines.items():
            self._write(self.folder / _PARTS / f"{kind}.jsonl", lines)

    def _write(self, path: Path, lines: Mapping[Any, bytes]) -> None:
        """Write a file whose content changes; an empty one goes."""
        text = b"".join(lines[where] + b"\n" for where in sorted(lines))
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
        if source.text not in self._checked:
            record, fault = _parsed(source)
            if fault:
                self.skipped[source.name] = fault
                return None
            self._checked[source.text] = record
        return dict(self._checked[source.text])


def _parsed(source: _Source) -> tuple[Any, str]:
    """Return the record that a text holds, or why it holds none."""
    try:
        content = schema.read_json(source.text)
    except (ValueError, RecursionError):
        return None, "it is not JSON"
    try:
        record = content if source.parts is None else schema.unpacked(content, source.parts)
    except (LookupError, TypeError, AttributeError, ValueError):
        return None, f"it names what is not in {_PARTS}"
    fault = schema.fault_of(record)
    return record, fault or ("" if record["key"] == source.key else "it has the name of another job")


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
    return dict(schema.chance_of_labels(tuple(record["labels"])))


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
    name = str(record.get("scorer", DEFAULT_SCORER))
    return "" if name == NO_SCORER else name


def by_place(records: Iterable[Record]) -> dict[Place, list[Record]]:
    """Records by the place where they belong, in their order."""
    places: dict[Place, list[Record]] = {}
    for record in records:
        places.setdefault(place(record), []).append(record)
    return places
