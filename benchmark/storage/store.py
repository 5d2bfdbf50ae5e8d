"""Where results are kept: content-addressed arrays, and one immutable record per finished job."""

from __future__ import annotations

import json
import os
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import BenchmarkError
from benchmark.storage.keys import digest

Arrays = Mapping[str, NDArray[Any]]
_SECONDS = "__seconds__"


class StorageError(BenchmarkError):
    """The results folder cannot be read or written."""


@dataclass(frozen=True)
class Artefact:
    """Arrays of one stage, with the time that they originally took."""

    arrays: Arrays
    seconds: float
    was_cached: bool


@dataclass(frozen=True)
class Store:
    """The folder ``DIR/runs``: ``artefacts/`` by recipe digest and ``records/`` by job key.

    Two processes may compute the same artefact at once: both write the same recipe, each write is atomic, so the
    second one merely replaces the first.
    """

    root: Path
    # Seconds spent in inner stages, for each stage that is being computed, outermost first.
    _inner: list[float] = field(default_factory=list, repr=False, compare=False)

    @classmethod
    def open(cls, results: Path) -> Store:
        """Open or create the store under a results folder.

        Raises
        ------
        StorageError
            If the folder cannot be created or written.
        """
        store = cls(results / "runs")
        try:
            for folder in (store._artefacts, store._records, store._progress):
                folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StorageError(
                f"cannot write to {results}: {error.strerror}", "choose another --results DIR"
            ) from error
        return store

    @property
    def models(self) -> Path:
        """Folder of the models that were trained here, beside the runs."""
        return self.root.parent / "models"

    @property
    def _artefacts(self) -> Path:
        return self.root / "artefacts"

    @property
    def _records(self) -> Path:
        return self.root / "records"

    @property
    def _progress(self) -> Path:
        return self.root / "progress"

    # Artefacts ---------------------------------------------------------------------------------------------------

    def get_or_compute(self, recipe: Mapping[str, Any], compute: Callable[[], Arrays]) -> Artefact:
        """Return the arrays that a recipe stands for, computing and keeping them when missing or damaged.

        The time kept with them is the stage's own: what a stage that it called took is booked there alone.

        Parameters
        ----------
        recipe
            Everything that determines the result; see :mod:`benchmark.storage.keys`.
        compute
            Makes the arrays; called only on a miss.
        """
        path = self._artefact_path(digest(recipe))
        found = _load(path)
        if found is not None:
            return found
        start = time.perf_counter()
        self._inner.append(0.0)
        try:
            arrays = compute()
        finally:
            elapsed = time.perf_counter() - start
            seconds = elapsed - self._inner.pop()
            if self._inner:
                self._inner[-1] += elapsed
        self._write(path, lambda file: np.savez(file, allow_pickle=False, **arrays, **{_SECONDS: np.float64(seconds)}))
        return Artefact(arrays, seconds, was_cached=False)

    def find(self, recipe: Mapping[str, Any]) -> Artefact | None:
        """Return the arrays of a recipe if they are there."""
        return _load(self._artefact_path(digest(recipe)))

    def _artefact_path(self, key: str) -> Path:
        return self._artefacts / key[:2] / f"{key}.npz"

    # Records -----------------------------------------------------------------------------------------------------

    def write_record(self, key: str, record: Mapping[str, Any]) -> None:
        """Keep the record of a job; a later record under the same key replaces it as a whole."""
        text = json.dumps(record, indent=1, sort_keys=True, allow_nan=False)
        self._write(self._records / f"{key}.json", lambda file: file.write(text.encode()), durable=True)

    def read_record(self, key: str) -> dict[str, Any] | None:
        """Return the record of a job, or None when there is none that can be read."""
        return _read_json(self._records / f"{key}.json")

    def records(self) -> Iterator[dict[str, Any]]:
        """Iterate over all records, oldest first."""
        for path in sorted(self._records.glob("*.json"), key=lambda path: (path.stat().st_mtime_ns, path.name)):
            record = _read_json(path)
            if record is not None:
                yield record

    # Progress ----------------------------------------------------------------------------------------------------

    def report_progress(self, key: str, done: int, total: int) -> None:
        """Tell whoever watches how far a job is. Lost updates do no harm, so nothing is synchronised."""
        (self._progress / key).write_text(f"{done} {total}")

    def progress(self, key: str) -> tuple[int, int]:
        """How far a job is: shapes done and shapes in all."""
        try:
            done, total = (self._progress / key).read_text().split()
            return int(done), int(total)
        except (OSError, ValueError):
            return 0, 0

    def forget_progress(self, key: str) -> None:
        """Remove the progress of a job that has ended."""
        (self._progress / key).unlink(missing_ok=True)

    def _write(self, path: Path, write: Callable[[Any], object], *, durable: bool = False) -> None:
        """Write atomically: temporary file in the same folder, then rename.

        Only records are flushed to the disk before the rename: a damaged artefact is noticed by its checksum and made
        again, a damaged record would lose a finished job.
        """
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".tmp")
            try:
                with os.fdopen(descriptor, "wb") as file:
                    write(file)
                    if durable:
                        file.flush()
                        os.fsync(file.fileno())
                Path(name).replace(path)
            except BaseException:
                Path(name).unlink(missing_ok=True)
                raise
        except OSError as error:
            raise StorageError(
                f"cannot write {path.name} under {self.root}: {error.strerror}",
                "free some space or choose another --results DIR; finished jobs are kept",
            ) from error


def _load(path: Path) -> Artefact | None:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        return Artefact(arrays, float(arrays.pop(_SECONDS)), was_cached=True)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _read_json(path: Path) -> dict[str, Any] | None:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return content if isinstance(content, dict) else None
