"""Records of finished jobs: one small JSON file each, those of this machine and those that travel with the suite."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

from benchmark.contracts import Input
from benchmark.storage.keys import digest
from benchmark.system.files import write_text
from retrieval.measures import PRINTED

Record = dict[str, Any]

#: What every record has, what it tells of its data, and what it has besides if the job was ok; a file that lacks any of
#: it is not a record.
REQUIRED: Mapping[str, type] = {
    "key": str, "gallery": str, "input": str, "method": str, "title": str, "family": str, "parameters": dict,
    "target": str, "status": str, "recipe": dict, "data": dict,
}  # fmt: skip
OF_DATA: Mapping[str, type] = {
    "name": str, "title": str, "stand_in_for": str, "source": str, "module": str, "quick": bool, "n_shapes": int,
    "n_classes": int, "chance": dict,
}  # fmt: skip
OF_SCORED: Mapping[str, type] = {
    "scores": dict, "per_query": dict, "chance": dict, "shapes": list, "labels": list, "n_shapes": int,
    "n_classes": int, "unsupported": list, "cost": dict,
}  # fmt: skip

#: Parts that say when and where a job was done, not what came out.
CIRCUMSTANCES = frozenset({"finished", "wall_seconds", "environments", "cost", "peak_mib", "artefacts"})

#: Parts that have no meaning on another machine.
LOCAL = frozenset({"artefacts"})


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
    if not (_has(content, REQUIRED) and _has(content["data"], OF_DATA) and _are_scores(content["data"]["chance"])):
        return False
    if not isinstance(content["recipe"].get("seed", 0), int) or content["input"] not in get_args(Input):
        return False
    if content["status"] != "ok":
        return True
    if not (_has(content, OF_SCORED) and _has(content["cost"], {"seconds_per_shape": dict})):
        return False
    n_queries = len(content["shapes"])
    rankings = [content["per_query"].get(name) for name in PRINTED]
    return (
        _are_scores(content["scores"])
        and _are_scores(content["chance"])
        and len(content["labels"]) == n_queries
        and all(isinstance(values, list) and len(values) == n_queries for values in rankings)
    )


def _has(content: Any, parts: Mapping[str, type]) -> bool:
    return isinstance(content, dict) and all(isinstance(content.get(name), kind) for name, kind in parts.items())


def _are_scores(values: Mapping[str, Any]) -> bool:
    """Whether every measure that tables print is there, and each is a share."""
    return set(PRINTED) <= values.keys() and all(
        isinstance(value, (int, float)) and 0 <= value <= 1 for value in values.values()
    )


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
