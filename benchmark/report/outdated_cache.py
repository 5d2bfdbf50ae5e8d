"""Answers of earlier processes to whether records are outdated, kept while all that they depend on is the same."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmark.api.learning import CARD
from benchmark.datasets.catalogue import CATALOGUE
from benchmark.storage.derived import (
    digest_of_files,
    files_below,
    read_derived,
    read_suite,
    suite_digest,
    write_derived,
)
from benchmark.storage.keys import digest
from benchmark.storage.records import place
from benchmark.storage.store import Store

#: New answers from which on it is worth to write the file.
_WORTH = 100


class OutdatedCache:
    """Answers by record: what has changed since it was made.

    An answer counts for the same code, packages, models and files of data alone.

    Parameters
    ----------
    store
        The results folder; models that were trained there count.
    data_root
        The folder that holds the official sets.
    """

    def __init__(self, store: Store, data_root: Path | None) -> None:
        self._path = Path(__file__).parent / "__pycache__" / f"outdated-{digest(str(store.root.resolve()))[:8]}.json"
        self._state = _state(store, data_root)
        self._told: dict[str, str] = read_derived(self._path, self._state) or {}
        self._n_new = 0

    def told(self, record: Mapping[str, Any]) -> str | None:
        """Return what has changed since a record was made; None if that is not known."""
        return self._told.get(_name(record))

    def add(self, record: Mapping[str, Any], told: str) -> str:
        """Take note of an answer; returns it."""
        self._told[_name(record)] = told
        self._n_new += 1
        return told

    def write(self) -> None:
        """Write down what was found out, if it is much, and by the code that lies here still."""
        if self._n_new >= _WORTH and suite_digest() == read_suite():
            write_derived(self._path, self._state, self._told)
            self._n_new = 0


def _name(record: Mapping[str, Any]) -> str:
    """Digest of what of a record such an answer depends on; the recipe is in the key."""
    data, notes = record["data"], [note.get("to") for note in record.get("rekeyed", ())]
    told = (record["status"], record.get("commit"), notes, data["name"], data["module"], data["quick"])
    return hashlib.sha256(repr((record["key"], *place(record), *told)).encode("utf-8", "replace")).hexdigest()[:16]


def _state(store: Store, data_root: Path | None) -> str:
    """Digest of the code, the packages, the models that were trained here, and the data."""
    models = digest_of_files(path for path in files_below(store.models) if path.name == CARD)
    sources = sorted({source.folder for source in CATALOGUE.values() if source.folder}) if data_root else []
    data = digest_of_files(path for name in sources for path in files_below(Path(data_root or "") / name))
    return digest([suite_digest(), models, str(data_root), data])
