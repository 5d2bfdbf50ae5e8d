"""Records of finished jobs: one small JSON file each, those of this machine and those that travel with the suite."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmark.files import write_text
from benchmark.storage.keys import digest

Record = dict[str, Any]

#: What every record has; anything else among the files is not a record.
REQUIRED: Mapping[str, type] = {
    "key": str, "gallery": str, "input": str, "method": str, "status": str, "recipe": dict,
}  # fmt: skip

#: Parts that say when and where a job was done, not what came out.
CIRCUMSTANCES = frozenset({"finished", "wall_seconds", "environments", "cost", "peak_mib", "from_cache", "artefacts"})

#: Parts that have no meaning on another machine.
LOCAL = frozenset({"artefacts", "from_cache"})


@dataclass(frozen=True)
class Records:
    """A folder of records.

    Parameters
    ----------
    folder
        Holds ``KEY.json`` for each job.
    skipped
        Files that are no records, as found so far.
    """

    folder: Path
    skipped: set[str] = field(default_factory=set, compare=False)

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
        """Forget a job."""
        (self.folder / f"{key}.json").unlink(missing_ok=True)

    def __contains__(self, key: str) -> bool:
        return (self.folder / f"{key}.json").is_file()

    def __iter__(self) -> Iterator[Record]:
        """All records, oldest first; the same order wherever the files lie."""
        found = [record for path in self.folder.glob("*.json") if (record := self._read(path))]
        return iter(sorted(found, key=lambda record: (str(record.get("finished", "")), record["key"])))

    def _read(self, path: Path) -> Record | None:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, RecursionError):
            self.skipped.add(path.name)
            return None
        if not is_record(content) or content["key"] != path.stem:
            self.skipped.add(path.name)
            return None
        return content  # type: ignore[no-any-return]


def is_record(content: Any) -> bool:
    """Whether something read from a file is the record of a job."""
    if not isinstance(content, dict) or not all(isinstance(content.get(k), kind) for k, kind in REQUIRED.items()):
        return False
    if content["status"] != "ok":
        return True
    scores = content.get("scores")
    if not isinstance(scores, dict) or not isinstance(content.get("per_query"), dict):
        return False
    return all(isinstance(value, (int, float)) and 0 <= value <= 1 for value in scores.values())


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


def place(record: Mapping[str, Any]) -> tuple[str, str, str, int]:
    """Where a record belongs: gallery, input, method and seed."""
    return record["gallery"], record["input"], record["method"], int(record["recipe"].get("seed", 0))


def by_place(records: Iterable[Record]) -> dict[tuple[str, str, str, int], list[Record]]:
    """Records by the place where they belong, in their order."""
    places: dict[tuple[str, str, str, int], list[Record]] = {}
    for record in records:
        places.setdefault(place(record), []).append(record)
    return places
