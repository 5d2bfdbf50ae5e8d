"""Store of results: arrays under the digests of their recipes, and one immutable record per finished job."""

from __future__ import annotations

import contextlib
import json
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.arrays import Arrays, digest_of, load_arrays, save_arrays
from benchmark.errors import BenchmarkError
from benchmark.execution.processes.opened_files import FILES, changed_files, files_among
from benchmark.files import is_alive, leftovers, write_atomically
from benchmark.pipeline.storage.costs import Cost, Meter
from benchmark.pipeline.storage.environment import environment_text
from benchmark.pipeline.storage.keys import bare_key, is_edited, plain
from benchmark.pipeline.storage.lock import CODE_FILE, EDITED, RECIPE, adopt_edited, edited, key_of
from benchmark.pipeline.storage.records import Record, Records

_COST, _ENVIRONMENT, _DIGEST = "__cost__", "__environment__", "__digest__"


class StorageError(BenchmarkError):
    """The results folder cannot be read or written."""


@dataclass(frozen=True)
class Artefact:
    """Arrays of one stage, with the cost and environment of their computation.

    Parameters
    ----------
    key
        Digest of the recipe.
    arrays
        Arrays by name.
    cost, environment
        Cost and environment of the original computation.
    was_cached
        Whether they were read from the store.
    digest
        Digest of all arrays of the stage, even if only some were read.
    files
        Digests of the files that a plugin read to compute them, by path.
    """

    key: str
    arrays: Arrays
    cost: Cost
    environment: str
    was_cached: bool
    digest: str = ""
    files: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Store:
    """The folder of results.

    ``DIR/runs/artefacts`` holds arrays by the digest of their recipe, ``DIR/runs/scratch`` large arrays that are fast
    to recompute, ``DIR/runs/records`` the records of jobs that ran here, and ``DIR/records`` the published ones.
    Results of edited code go to ``DIR/runs/edited/EDIT``, named after the edit, until ``make golden`` passes; then
    :mod:`benchmark.pipeline.storage.lock` merges them into the others.

    Two processes may compute the same artefact at the same time. Since writes are atomic, the second merely replaces
    the first.

    Parameters
    ----------
    root
        ``DIR/runs``.
    meter
        Meter for the costs of computations.
    published_only
        Whether to ignore local records and models, so that the result is the same in every clone.
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
        adopt_edited(store.root)
        return replace(store, published_only=published_only)

    @property
    def models(self) -> Path:
        """Folder of locally trained models; a nonexistent folder if ``published_only``."""
        return self.root.parent / ("no-models" if self.published_only else "models")

    @property
    def artefacts(self) -> Path:
        """Folder of permanent arrays."""
        return self.root / "artefacts"

    @property
    def scratch(self) -> Path:
        """Folder of arrays that a run needs until its jobs have their records."""
        return self.root / "scratch"

    @property
    def progress(self) -> Path:
        """Folder for progress files of workers."""
        return self.root / "progress"

    @cached_property
    def records(self) -> Records:
        """Records of jobs that ran here; none if ``published_only``."""
        return Records(self.root / ("no-records" if self.published_only else "records"))

    @cached_property
    def published(self) -> Records:
        """Published records."""
        return Records(self.root.parent / "records")

    def all_records(self) -> list[Record]:
        """Return all records except those of undone edits; local records replace published ones of the same job."""
        records = {record["key"]: record for folder in (self.published, self.records) for record in folder}
        return [record for record in records.values() if not _is_undone(record)]

    # Artefacts ---------------------------------------------------------------------------------------------------

    def get_or_compute(
        self, recipe: Mapping[str, Any], compute: Callable[[], Arrays], *, work: str = "", scratch: bool = False
    ) -> Artefact:
        """Return the arrays of a recipe; compute and store them if they are missing or damaged.

        Parameters
        ----------
        recipe
            Everything that determines the result; see :mod:`benchmark.pipeline.storage.keys`.
        compute
            Function that computes the arrays; called only if necessary.
        work
            Name of the work; its first use in a process is marked in the cost.
        scratch
            Whether the arrays can be deleted as soon as no job needs them.
        """
        key = key_of(recipe)
        if (artefact := self.under(key)) is not None:
            return artefact
        with self.meter.measured(work) as cost:
            arrays = dict(compute())
        about = {_COST: cost().to_json(), _ENVIRONMENT: environment_text(), _DIGEST: digest_of(arrays)}
        if is_edited(key):  # its key changes when its golden results are accepted
            self._say_which_code(key, recipe)
            about[RECIPE] = json.dumps(plain(recipe))
        texts = {name: np.array(text) for name, text in about.items()}
        path = self._path(key, scratch=scratch)
        self._write(path, lambda file: save_arrays(file, bare_key(key), {**arrays, **texts}, compressed=not scratch))
        files = files_among(arrays)
        return Artefact(key, arrays, cost(), environment_text(), was_cached=False, digest=about[_DIGEST], files=files)

    def find(self, recipe: Mapping[str, Any], *, wanted: Callable[[str], bool] | None = None) -> Artefact | None:
        """Return the arrays of a recipe if they are stored; see :meth:`under`."""
        return self.under(key_of(recipe), wanted)

    def under(self, key: str, wanted: Callable[[str], bool] | None = None) -> Artefact | None:
        """Return the arrays under a key, all or those with given names; None if their file is missing or damaged."""
        artefacts = (_load(self._path(key, scratch=scratch), key, wanted) for scratch in (False, True))
        return next(filter(None, artefacts), None)

    def has(self, key: str) -> bool:
        """Return whether there is a file of permanent arrays under a key, intact or not."""
        return self._path(key).is_file()

    def digest_under(self, key: str) -> str:
        """Return the digest of the arrays under a key; "" if it is not available."""
        artefact = self.under(key, lambda name: False)
        return artefact.digest if artefact else ""

    def discard(self, key: str) -> None:
        """Remove the arrays under a key."""
        for scratch in (False, True):
            self._path(key, scratch=scratch).unlink(missing_ok=True)

    def artefact_files(self) -> Iterator[Path]:
        """Yield the files of all permanent arrays."""
        return self.artefacts.glob("*/*.npz")

    def drop_scratch(self) -> None:
        """Delete the scratch arrays that no job needs any more."""
        with contextlib.suppress(OSError):
            shutil.rmtree(self.scratch)
            self.scratch.mkdir()

    def _path(self, key: str, *, scratch: bool = False) -> Path:
        root, bare = self.root / EDITED / key.partition("-")[0] if is_edited(key) else self.root, bare_key(key)
        return root / ("scratch" if scratch else "artefacts") / bare[:2] / f"{bare}.npz"

    def _say_which_code(self, key: str, recipe: Mapping[str, Any]) -> None:
        """Record which edited code the folder of a key belongs to."""
        path = self.root / EDITED / key.partition("-")[0] / CODE_FILE
        if not path.is_file():
            self._write(path, lambda file: file.write(json.dumps(edited(recipe["versions"])).encode()))

    # Records -----------------------------------------------------------------------------------------------------

    def write_record(self, record: Record) -> None:
        """Write the record of a job; raise ``StorageError`` if that fails."""
        with self._writing(f"{record['key']}.json"):
            self.records.write(record)

    def remove_record(self, key: str) -> None:
        """Remove the record of a job; raise ``StorageError`` if that fails."""
        with self._writing(f"{key}.json"):
            self.records.remove(key)

    def _write(self, path: Path, write: Callable[[Any], object]) -> None:
        """Write an artefact, without flushing it to disk: damage is detected by its checksum and repaired."""
        with self._writing(path.name):
            write_atomically(path, write)

    @contextlib.contextmanager
    def _writing(self, name: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise StorageError(
                f"cannot write {name} under {self.root}: {error.strerror}",
                "free some space or choose another --results DIR; finished jobs are kept",
            ) from error


def _load(path: Path, key: str, wanted: Callable[[str], bool] | None = None) -> Artefact | None:
    """Read an artefact; None if it is missing or damaged in any way, since it can be recomputed."""

    def is_read(name: str) -> bool:
        return wanted is None or name in (_COST, _ENVIRONMENT, _DIGEST, FILES) or wanted(name)

    try:
        arrays = load_arrays(path, bare_key(key), is_read)
        cost, environment = Cost.from_json(str(arrays.pop(_COST))), str(arrays.pop(_ENVIRONMENT))
        digest = str(arrays.pop(_DIGEST))
        arrays.pop(RECIPE, None)
        files = files_among(arrays)
    except Exception:
        return None
    if changed_files(files) or (wanted is None and digest != digest_of(arrays)):
        return None
    return Artefact(key, arrays, cost, environment, was_cached=True, digest=digest, files=files)


def _is_undone(record: Record) -> bool:
    """Return whether a record was made by edited code that is no longer there."""
    return is_edited(record["key"]) and key_of(record["recipe"]) != record["key"]


def sweep_leftovers(store: Store) -> None:
    """Remove files left by killed processes: incomplete files, and progress files without a reader."""
    remove(list(_leftovers(store)))


def remove(paths: Iterable[Path]) -> int:
    """Remove files and return the number of bytes freed."""
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
    """Return whether the run that reads a progress file is alive."""
    harness = path.name.partition("-")[0]
    return harness.isdecimal() and is_alive(int(harness))
