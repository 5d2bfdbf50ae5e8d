"""Records of finished jobs: each is written to its own JSON file, and later gathered as a line of a text file."""

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
from benchmark.pipeline.storage.keys import digest, is_edited
from benchmark.pipeline.storage.lock import EDITED
from benchmark.pipeline.storage.record_schema import SharedParts
from benchmark.text import LONGEST_NAME

Record = dict[str, Any]

#: Maximum size of a record file in bytes: 500 times a record of 300 shapes.
LARGEST_FILE = 2**25

#: Maximum size of a file of gathered records in bytes; a record takes a few thousand.
LARGEST_GATHERED = 2**31

#: Position of the key in the line of a record.
_KEY_AT = slice(8, 40)

#: Folder of the parts that gathered records share.
_PARTS = "parts"

#: Parts that describe when and where a job ran, not its outcome.
CIRCUMSTANCES = frozenset(
    {"finished", "wall_seconds", "environments", "cost", "peak_mib", "artefacts"}
    | {"digests", "commit", "rekeyed", "files"}
)

#: Parts that are meaningless on another machine.
LOCAL = frozenset({"artefacts", "files"})


#: Scorer of a record that names none, and the entry that replaces it in the record of a descriptor.
DEFAULT_SCORER, NO_SCORER = "cm-bof", "none"

#: Family of rows whose distances or forms come from other programs.
EXTERNAL = "external"

#: Reason why a result is outdated if a newer one of its gallery is on other shapes, as after changes of a folder.
OTHER_SHAPES = "other shapes"

#: Maximum number of skipped files to name for a folder.
MOST_NAMED = 10

_HINT = "remove it or move it elsewhere"


class _Source(NamedTuple):
    """Text of a record, the ``key`` under which it is stored, and its location for messages."""

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
        Folder with each job as ``KEY.json`` or as a line of ``DATASET.jsonl``, with the shared parts of lines in
        ``parts``. A file takes precedence over a line.
    skipped
        Reasons why files or lines are not records, by name, for those read so far.
    """

    folder: Path
    skipped: dict[str, str] = field(default_factory=dict)
    _reported: set[str] = field(default_factory=set, repr=False)
    _checked: dict[bytes, Record] = field(default_factory=dict, repr=False)
    _gathered: dict[str, list[_Source]] | None = field(default=None, repr=False)

    def write(self, record: Mapping[str, Any]) -> None:
        """Write a record to its own file, replacing any earlier record with the same key.

        Raises
        ------
        OSError
            If it cannot be written.
        ValueError
            If it holds a number that JSON cannot represent.
        """
        write_text(self._path(record["key"]), as_text(record), durable=True)

    def read(self, key: str) -> Record | None:
        """Return the record of a job; None if there is no readable one."""
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
        """Move the records that have their own files into one file of lines for each data set.

        No other process may write records meanwhile.

        Returns
        -------
        int
            Number of moved files.

        Raises
        ------
        OSError
            If the folder cannot be written; each record then is still in its file or in a line.
        """
        with locked(self.folder, alone=True):
            files = [source for source in self._all_files() if not is_edited(source.key) and self._record(source)]
            if files:
                self._rewrite(files)
            for source in files:
                (self.folder / source.name).unlink()
        return len(files)

    def __contains__(self, key: str) -> bool:
        return self.read(key) is not None  # a damaged one must not keep a run from replacing it

    def __iter__(self) -> Iterator[Record]:
        """Yield all records, oldest first; the order does not depend on where they are stored."""
        if self.folder.is_dir() and not os.access(self.folder, os.R_OK | os.X_OK):
            self.skipped["."] = "this user may not read it"
        records: dict[str, Record] = {}
        with locked(self.folder):
            sources = list(self._all_files())  # files before lines, in case one is gathered meanwhile
            self._gathered = None
            for source in (*sources, *self._all_lines()):
                if record := self._record(source):  # reports damage even if another one takes precedence
                    records.setdefault(source.key, record)
        return iter(sorted(records.values(), key=lambda record: (str(record.get("finished", "")), record["key"])))

    @property
    def has_files(self) -> bool:
        """Whether there are files of records, valid or not."""
        return any(path.suffix in (".json", ".jsonl") for path in self.folder.glob("*.json*"))

    def news(self) -> list[str]:
        """Return a line for each skipped file that has not been reported yet."""
        names = sorted(self.skipped.keys() - self._reported)
        self._reported.update(names)
        lines = [
            f"skipped {self.folder / name}: {self.skipped[name]}; {'change its rights' if name == '.' else _HINT}"
            for name in names[:MOST_NAMED]
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
        """Lines of gathered records by key, last ones first, as they were when first read."""
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
        """Rewrite the files of lines; the first record of a key is kept, and invalid lines stay unchanged."""
        self._gathered = None
        lines = self._all_lines()
        if unread := sorted(name for name in self.skipped if name.endswith(".jsonl")):
            raise OSError(f"{self.folder / unread[0]} cannot be rewritten: {self.skipped[unread[0]]}")
        parts, before = SharedParts(), (lines[0].parts if lines else None) or SharedParts()
        tables: dict[str, dict[tuple[Any, ...], bytes]] = {path.name: {} for path in self.folder.glob("*.jsonl")}
        done = set(without)
        for source in (*files, *lines):
            record = self._record(source)
            if record is None:
                parts.update(before)  # a repair needs them
                tables[source.name.partition(":")[0]]["", "", "", 0, "", source.key, source.text] = source.text
            elif source.key not in done:
                done.add(source.key)
                tables.setdefault(_table_of(record), {})[*place(record), source.key] = schema.as_line(record, parts)
        before.update(parts)  # until the last line is written, old and new parts are both needed
        self._write_parts(before)
        for name in sorted(tables):
            self._write(self.folder / name, tables[name])
        self._write_parts(parts)
        self._gathered = None

    def _write_parts(self, parts: SharedParts) -> None:
        for kind, lines in parts.lines.items():
            self._write(self.folder / _PARTS / f"{kind}.jsonl", lines)

    def _write(self, path: Path, lines: Mapping[Any, bytes]) -> None:
        """Write a file if its content changes; remove it if it is empty."""
        text = b"".join(lines[where] + b"\n" for where in sorted(lines))
        if not text:
            path.unlink(missing_ok=True)
        elif not path.is_file() or path.read_bytes() != text:
            write_atomically(path, lambda file: file.write(text), durable=True)

    def _bytes(self, path: Path, most: int) -> bytes | None:
        """Return the content of a file, or None; unless the file is missing, ``skipped`` then has the reason."""
        try:
            status = path.stat()
            if stat.S_ISREG(status.st_mode) and status.st_size <= most:
                return path.read_bytes()
            self.skipped[path.name] = "it is too large" if stat.S_ISREG(status.st_mode) else "it is not a file"
        except FileNotFoundError:
            if path.is_symlink():
                self.skipped[path.name] = "the link is broken"
        except OSError as error:
            self.skipped[path.name] = f"it cannot be read: {error.strerror}"
        return None

    def _record(self, source: _Source) -> Record | None:
        """Return the record in a text; None if there is none, with the reason in ``skipped``."""
        if source.text not in self._checked:
            record, fault = _parsed(source)
            if fault:
                self.skipped[source.name] = fault
                return None
            self._checked[source.text] = record
        return dict(self._checked[source.text])


def _parsed(source: _Source) -> tuple[Any, str]:
    """Return the record in a text, or the reason why there is none."""
    try:
        content = schema.read_json(source.text)
    except (ValueError, RecursionError):
        return None, "it is not JSON"
    try:
        record = content if source.parts is None else schema.unpacked(content, source.parts)
    except (LookupError, TypeError, AttributeError, ValueError):
        return None, f"it refers to missing parts in {_PARTS}"
    fault = schema.fault_of(record)
    return record, fault or ("" if record["key"] == source.key else "it has the name of another job")


def _table_of(record: Mapping[str, Any]) -> str:
    """Return the name of the file for the gathered records of a data set, without its parameters."""
    base = str(record["data"]["name"]).partition("[")[0]
    return f"{re.sub('[^A-Za-z0-9-]+', '-', base)[:LONGEST_NAME] or 'records'}.jsonl"


def as_text(record: Mapping[str, Any]) -> str:
    """Return a record as JSON with one part per line, so that versions can be compared."""
    parts = (
        f"{json.dumps(name)}: {json.dumps(record[name], sort_keys=True, allow_nan=False, separators=(',', ':'))}"
        for name in sorted(record)
    )
    return "{\n" + ",\n".join(parts) + "\n}\n"


def outcome(record: Mapping[str, Any]) -> str:
    """Return the digest of the outcome of a job, whenever and wherever it ran."""
    return digest({name: value for name, value in record.items() if name not in CIRCUMSTANCES})


def portable(record: Mapping[str, Any]) -> Record:
    """Return a record without the parts that are meaningless on another machine."""
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
    """Return the fraction of the available shapes with a result; 0 for a record without scores."""
    if not record.get("scores"):
        return 0.0
    if "coverage" in record:
        return float(record["coverage"])
    refused = len(record.get("unsupported", ()))  # older records do not count refused shapes
    return 1 - refused / (len(record["shapes"]) + refused) if refused else 1.0


def chance_of(record: Mapping[str, Any]) -> dict[str, float]:
    """Return the chance level of the gallery of a record, by measure."""
    return dict(schema.chance_of_labels(tuple(record["labels"])))


class Place(NamedTuple):
    """Place of a record; each place holds one result, however often it was computed."""

    gallery: str
    input: str
    method: str
    seed: int = 0
    scorer: str = DEFAULT_SCORER


def place(record: Mapping[str, Any]) -> Place:
    """Return the place of a record."""
    seed = int(record["recipe"].get("seed", 0))
    return Place(record["gallery"], record["input"], record["method"], seed, scorer_name(record) or DEFAULT_SCORER)


def scorer_name(record: Mapping[str, Any]) -> str:
    """Return the name of the scorer of a record; "" for a descriptor, which has none."""
    name = str(record.get("scorer", DEFAULT_SCORER))
    return "" if name == NO_SCORER else name


def by_place(records: Iterable[Record]) -> dict[Place, list[Record]]:
    """Group records by place, in their order."""
    places: dict[Place, list[Record]] = {}
    for record in records:
        places.setdefault(place(record), []).append(record)
    return places
