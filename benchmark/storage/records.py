"""Records of finished jobs: one small JSON file each, those of this machine and those that travel with the suite."""

from __future__ import annotations

import json
import stat
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from benchmark.storage.keys import digest
from benchmark.storage.record_schema import chance_of_labels, fault_of, not_a_number
from benchmark.system.files import write_text

Record = dict[str, Any]

#: Bytes beyond which a file is no record; that of 300 shapes has a five-hundredth of it.
LARGEST_FILE = 2**25

#: Parts that say when and where a job was done, not what came out.
CIRCUMSTANCES = frozenset(
    {"finished", "wall_seconds", "environments", "cost", "peak_mib", "artefacts", "digests", "commit", "rekeyed"}
)

#: Stages whose digests a record holds, in their order; descriptors have no signatures.
DIGESTS = ("shapes", "forms", "signatures", "distances")

#: Parts that have no meaning on another machine.
LOCAL = frozenset({"artefacts"})


#: Scorer of a record that names none, and what the record of a descriptor says in its place.
DEFAULT_SCORER, NO_SCORER = "cm-bof", "none"

#: Skipped files of a folder that are named one by one.
MOST_TOLD = 10

_HINT = "remove it or move it elsewhere"


@dataclass(frozen=True)
class Records:
    """A folder of records.

    Parameters
    ----------
    folder
        Holds ``KEY.json`` for each job.
    skipped
        Why a file is no record, by its name, for those found so far.
    """

    folder: Path
    skipped: dict[str, str] = field(default_factory=dict, compare=False)
    _told: set[str] = field(default_factory=set, compare=False, repr=False)

    def write(self, record: Mapping[str, Any]) -> None:
        """Keep a record; a later one under the same key replaces it as a whole.

        Raises
        ------
        OSError
            If it cannot be written.
        ValueError
            If it holds a number that JSON does not have.
        """
        write_text(self.folder / f"{record['key']}.json", as_text(record), durable=True)

    def read(self, key: str) -> Record | None:
        """Return the record of a job; None when there is none that can be read."""
        return self._read(self.folder / f"{key}.json")

    def remove(self, key: str) -> None:
        """Remove the record of a job."""
        (self.folder / f"{key}.json").unlink(missing_ok=True)

    def __contains__(self, key: str) -> bool:
        return (self.folder / f"{key}.json").is_file()

    def __iter__(self) -> Iterator[Record]:
        """All records, oldest first; the same order wherever the files lie."""
        found = [record for path in self.folder.glob("*.json") if (record := self._read(path))]
        return iter(sorted(found, key=lambda record: (str(record.get("finished", "")), record["key"])))

    def news(self) -> list[str]:
        """A line for each file that was skipped and has not been told before."""
        found = [name for name in sorted(self.skipped) if name not in self._told]
        self._told.update(found)
        lines = [f"skipped {self.folder / name}: {self.skipped[name]}; {_HINT}" for name in found[:MOST_TOLD]]
        further = len(found) - len(lines)
        return lines + ([f"skipped {further} further files in {self.folder}; {_HINT}"] if further else [])

    def _read(self, path: Path) -> Record | None:
        try:
            status = path.stat()
            if not stat.S_ISREG(status.st_mode):
                return self._skip(path, "it is no file")
            if status.st_size > LARGEST_FILE:
                return self._skip(path, "it is too large")
            content = json.loads(path.read_text(encoding="utf-8"), parse_constant=not_a_number)
        except FileNotFoundError:
            return self._skip(path, "the link leads nowhere") if path.is_symlink() else None
        except OSError as error:
            return self._skip(path, f"it cannot be read: {error.strerror}")
        except (ValueError, RecursionError):
            return self._skip(path, "it is not JSON")
        fault = fault_of(content)
        if not fault and content["key"] != path.stem:
            fault = "it has the name of another job"
        if fault:
            return self._skip(path, fault)
        return content  # type: ignore[no-any-return]

    def _skip(self, path: Path, why: str) -> Record | None:
        """Take note of a file that is no record; there is none in it."""
        self.skipped[path.name] = why
        return None


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


def first_key(record: Mapping[str, Any]) -> str:
    """Return the key under which a record was made, whatever keys it has got since."""
    notes = record.get("rekeyed") or [record]
    return str(notes[0].get("key", record["key"]))


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
