"""Store of results: content-addressed arrays, and one immutable record per finished job."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.errors import BenchmarkError
from benchmark.storage.costs import Cost, Meter
from benchmark.storage.environment import environment_text
from benchmark.storage.keys import digest
from benchmark.storage.records import Record, Records, by_place
from benchmark.system.arrays import Arrays, digest_of, load_arrays, save_arrays
from benchmark.system.files import is_alive, leftovers, write_atomically

_COST, _ENVIRONMENT, _DIGEST = "__cost__", "__environment__", "__digest__"


class StorageError(BenchmarkError):
    """The results folder cannot be read or written."""


@dataclass(frozen=True)
class Artefact:
    """Arrays of one stage, with what they originally cost and where they were made.

    Parameters
    ----------
    key
        Digest of the recipe.
    arrays
        By name.
    cost, environment
        As when they were made.
    was_cached
        Whether they were read.
    digest
        Digest of all arrays of the stage, also where some were read alone; "" for a file that does not tell.
    """

    key: str
    arrays: Arrays
    cost: Cost
    environment: str
    was_cached: bool
    digest: str = ""


@dataclass(frozen=True)
class Store:
    """The folder of results.

    ``DIR/runs/artefacts`` keeps arrays by the digest of their recipe, ``DIR/runs/scratch`` those that are large and
    made again quickly, ``DIR/runs/records`` the records of the jobs done here, and ``DIR/records`` those that travel
    with the suite.

    Two processes may compute the same artefact at once: both write the same recipe, each write is atomic, so the
    second one merely replaces the first.

    Parameters
    ----------
    root
        ``DIR/runs``.
    meter
        Measures what is computed.
    published_only
        Whether records and models made here are passed over, so that what is read is the same in every clone.
    """

    root: Path
    meter: Meter = field(default_factory=Meter, repr=False, compare=False)
    published_only: bool = False

    @classmethod
    def open(cls, results: Path, *, published_only: bool = False) -> Store:
        """Open or create the store under a results folder.

        Raises
        ------
        StorageError
            If the folder cannot be created or written.
        """
        store = cls(results / "runs")
        try:
            for folder in (store.artefacts, store.scratch, store.records.folder, store.progress):
                folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StorageError(
                f"cannot write to {results}: {error.strerror}", "choose another --results DIR"
            ) from error
        return replace(store, published_only=published_only)

    @property
    def models(self) -> Path:
        """Folder of the models that were trained here, beside the runs; one that is not there if they do not count."""
        return self.root.parent / ("no-models" if self.published_only else "models")

    @property
    def artefacts(self) -> Path:
        """Folder of the arrays that stay."""
        return self.root / "artefacts"

    @property
    def scratch(self) -> Path:
        """Folder of the arrays that a run needs until its jobs have their records."""
        return self.root / "scratch"

    @property
    def progress(self) -> Path:
        """Folder where workers tell how far they are."""
        return self.root / "progress"

    @cached_property
    def records(self) -> Records:
        """Records of the jobs done here; none if they do not count."""
        return Records(self.root / ("no-records" if self.published_only else "records"))

    @cached_property
    def published(self) -> Records:
        """Records that travel with the suite."""
        return Records(self.root.parent / "records")

    # Artefacts ---------------------------------------------------------------------------------------------------

    def get_or_compute(
        self, recipe: Mapping[str, Any], compute: Callable[[], Arrays], *, work: str = "", scratch: bool = False
    ) -> Artefact:
        """Return the arrays that a recipe stands for, computing and keeping them when missing or damaged.

        Parameters
        ----------
        recipe
            Everything that determines the result; see :mod:`benchmark.storage.keys`.
        compute
            Makes the arrays; called only on a miss.
        work
            What is done; its first time in a process is marked in the cost.
        scratch
            Whether the arrays may go as soon as no job needs them.
        """
        key = digest(recipe)
        path = self._path(key, scratch=scratch)
        found = _load(path, key)
        if found is not None:
            return found
        with self.meter.measured(work) as cost:
            arrays = compute()
        told = {_COST: cost().to_json(), _ENVIRONMENT: environment_text(), _DIGEST: digest_of(arrays)}
        extra = {name: np.array(text) for name, text in told.items()}
        self._write(path, lambda file: save_arrays(file, key, {**arrays, **extra}, compressed=not scratch))
        return Artefact(key, arrays, cost(), environment_text(), was_cached=False, digest=told[_DIGEST])

    def find(
        self, recipe: Mapping[str, Any], *, scratch: bool = False, wanted: Callable[[str], bool] | None = None
    ) -> Artefact | None:
        """Return the arrays of a recipe if they are there.

        Parameters
        ----------
        recipe, scratch
            As in :meth:`get_or_compute`.
        wanted
            Chooses the arrays to read by name; all by default.
        """
        key = digest(recipe)
        return _load(self._path(key, scratch=scratch), key, wanted)

    def find_anywhere(self, recipe: Mapping[str, Any]) -> Artefact | None:
        """Return the arrays of a recipe if they are there, among those that may go or those that stay."""
        return self.find(recipe, scratch=True) or self.find(recipe)

    def has(self, key: str) -> bool:
        """Return whether there is a file of arrays that stay under a key, whole or not."""
        return self._path(key).is_file()

    def digest_under(self, key: str) -> str:
        """Return the digest of the arrays under a key; "" where there are none, or their file does not tell."""
        found = _load(self._path(key), key, lambda name: False)
        return found.digest if found else ""

    def discard(self, key: str) -> None:
        """Remove the arrays under a key."""
        for scratch in (False, True):
            self._path(key, scratch=scratch).unlink(missing_ok=True)

    def artefact_files(self) -> Iterator[Path]:
        """Files of all arrays that stay."""
        return self.artefacts.glob("*/*.npz")

    def drop_scratch(self) -> None:
        """Free what no job needs any more."""
        with contextlib.suppress(OSError):
            shutil.rmtree(self.scratch)
            self.scratch.mkdir()

    def _path(self, key: str, *, scratch: bool = False) -> Path:
        return (self.scratch if scratch else self.artefacts) / key[:2] / f"{key}.npz"

    # Records -----------------------------------------------------------------------------------------------------

    def write_record(self, record: Record) -> None:
        """Keep the record of a job; raises ``StorageError`` if it cannot be written."""
        try:
            self.records.write(record)
        except OSError as error:
            raise self._cannot_write(f"{record['key']}.json", error) from error

    def remove_record(self, key: str) -> None:
        """Remove the record of a job; raises ``StorageError`` if that cannot be done."""
        try:
            self.records.remove(key)
        except OSError as error:
            raise self._cannot_write(f"{key}.json", error) from error

    def _write(self, path: Path, write: Callable[[Any], object]) -> None:
        """Write an artefact. It is not flushed to the disk: a damaged one is noticed by its checksum and made again."""
        try:
            write_atomically(path, write)
        except OSError as error:
            raise self._cannot_write(path.name, error) from error

    def _cannot_write(self, name: str, error: OSError) -> StorageError:
        return StorageError(
            f"cannot write {name} under {self.root}: {error.strerror}",
            "free some space or choose another --results DIR; finished jobs are kept",
        )


def _load(path: Path, key: str, wanted: Callable[[str], bool] | None = None) -> Artefact | None:
    """Read an artefact; None if it is missing or damaged, in whatever way: it can be made again."""

    def is_read(name: str) -> bool:
        return wanted is None or name in (_COST, _ENVIRONMENT, _DIGEST) or wanted(name)

    try:
        arrays = load_arrays(path, key, is_read)
        cost, environment = Cost.from_json(str(arrays.pop(_COST))), str(arrays.pop(_ENVIRONMENT))
        digest = str(arrays.pop(_DIGEST, ""))
    except Exception:
        return None
    return Artefact(key, arrays, cost, environment, was_cached=True, digest=digest)


def unneeded(store: Store) -> Iterator[Path]:
    """Files that can be removed: the newest record of each place keeps what it was made from, all else may go.

    The artefacts of a job that was stopped are among them; it would begin anew.
    """
    newest = (records[-1] for records in by_place(store.records).values())
    needed = {key for record in newest for key in record.get("artefacts", ())}
    yield from (path for path in store.artefact_files() if path.stem not in needed)
    yield from store.scratch.glob("*/*.npz")
    yield from (path for path in (store.root / "rekey").rglob("*") if path.is_file())
    yield from _leftovers(store)


def sweep_leftovers(store: Store) -> None:
    """Remove what killed processes left behind: half-written files, and notes on progress that nobody reads."""
    remove(list(_leftovers(store)))


def remove(paths: Iterable[Path]) -> int:
    """Remove files; returns the bytes that were freed."""
    freed = 0
    for path in paths:
        with contextlib.suppress(OSError):
            size = path.stat().st_size
            path.unlink()
            freed += size
    return freed


def _leftovers(store: Store) -> Iterator[Path]:
    yield from leftovers(store.root)
    yield from leftovers(store.published.folder)
    yield from (path for path in store.progress.iterdir() if not _is_watched(path))


def _is_watched(path: Path) -> bool:
    """Return whether the harness that looks at a progress file is alive."""
    harness = path.name.partition("-")[0]
    return harness.isdecimal() and is_alive(int(harness))
