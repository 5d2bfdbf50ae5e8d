"""Files of arrays under keys: digests of everything that determines them.

A key is known before the arrays are computed.
"""

from __future__ import annotations

import errno
import io
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import IO, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import BenchmarkError
from benchmark.files import sweep, write_atomically
from benchmark.geometry.mesh import read_only
from benchmark.locks import take_lock
from benchmark.pipeline.stages import Arrays, Incomplete

#: What the files of the cache hold, in the order in which they are made.
Stage = Literal["prepared", "forms", "signatures", "records"]


class CachedFile(NamedTuple):
    """A file of the cache: what a stage makes, under its key."""

    stage: Stage
    key: str


#: First bytes of a ``.npy`` file of format 1.0, and its length up to the header.
_NPY_MAGIC = b"\x93NUMPY\x01\x00"
_NPY_PREFIX = 10

#: Headers of arrays that are kept parsed.
_KEPT_HEADERS = 1024

#: Errors of a disk, which every process meets: it is full, or can no longer be written.
_OF_A_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO)

#: Errors that are in a process or in rights, and say nothing about the file that is opened.
_SAYING_NOTHING = (errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EACCES, errno.EPERM)

#: Folder of local results in a results folder.
RUNS = "runs"


class StorageError(BenchmarkError):
    """The results folder cannot be read or written."""

    @property
    def is_of_disk(self) -> bool:
        """Whether its disk is full or fails, which no process can have done to itself."""
        return isinstance(self.__cause__, OSError) and self.__cause__.errno in _OF_A_DISK


class UnreadableFile(Incomplete):
    """A cached file cannot be read, for a reason that is not in its content."""


@contextmanager
def storing(results: Path) -> Iterator[None]:
    """Turn errors of the file system into a :class:`StorageError`."""
    try:
        yield
    except OSError as error:
        hint = "free some space, change its rights, or choose another --results DIR"
        raise StorageError(
            f"cannot write to {results}: {error.strerror or error}",
            f"{hint}; finished jobs are kept",
        ) from error


@contextmanager
def writing(results: Path) -> Iterator[None]:
    """Return a context in which no other process writes to a results folder.

    Readers need no lock. Temporary files that an earlier writer left behind are removed.

    Raises
    ------
    StorageError
        If another process is writing to the folder, or it cannot be written.
    """
    with storing(results):
        (results / RUNS / "records").mkdir(parents=True, exist_ok=True)
        lock = (results / RUNS / "lock").open("a")
    with lock:
        take_lock(lock.fileno(), refusal=taken(f"another run is writing to {results}"))
        sweep(results / RUNS)
        yield


def taken(problem: str) -> StorageError:
    """Return the error for work that another process is doing in the results folder."""
    return StorageError(problem, "wait for its end, or choose another --results DIR")


@dataclass(frozen=True)
class Cache:
    """The cached files of a results folder; a damaged one counts as missing.

    Parameters
    ----------
    results
        The results folder.
    """

    results: Path

    def has(self, stage: Stage, key: str) -> bool:
        """Return whether there is a file under a key, damaged or not."""
        return self._path(stage, key).is_file()

    def read(
        self, stage: Stage, key: str, *, without: Collection[str] = (), only: Collection[str] = ()
    ) -> dict[str, NDArray[Any]] | None:
        """Return the arrays of a cached file, which cannot be changed.

        Parameters
        ----------
        stage
            What the file holds, such as ``"forms"``.
        key
            Its name, without extension.
        without
            Names of arrays that are left out.
        only
            Names of the only arrays to read; by default all are.

        Returns
        -------
        dict or None
            Arrays by name; None if there is no such file, or it is damaged.

        Raises
        ------
        UnreadableFile
            If this process may open no file, or not this one, which may be whole.
        MemoryError
            If there is no memory for the arrays, which says nothing about the file either.
        """
        path = self._path(stage, key)
        try:
            with zipfile.ZipFile(path) as archive:
                names = {name.removesuffix(".npy") for name in archive.namelist()}
                # Each array has a checksum, but their list has none: it may have been cut. The
                # comment of the archive says how many there are.
                if archive.comment != str(len(names)).encode():
                    return None
                wanted = names.intersection(only or names).difference(without)
                files = {name: archive.read(f"{name}.npy") for name in wanted}
            return {name: read_only(_array_of(file)) for name, file in files.items()}
        except MemoryError:
            raise
        except Exception as error:  # zip, zlib and numpy raise many types
            if isinstance(error, OSError) and error.errno in _SAYING_NOTHING:
                raise UnreadableFile(f"{path}: {error.strerror}") from error
            return None

    def write(self, stage: Stage, key: str, arrays: Arrays) -> None:
        """Write the arrays under a key; raise :class:`StorageError` if that fails."""
        with storing(self.results):
            # A search for repetitions takes twice as long for signatures, and makes them larger.
            write_arrays = partial(_write_arrays, arrays, search=stage != "signatures")
            write_atomically(self._path(stage, key), write_arrays)

    def get(self, stage: Stage, key: str, compute: Callable[[], Arrays]) -> Arrays:
        """Return the arrays under a key; compute and write them if they are missing."""
        arrays: Arrays | None = self.read(stage, key)
        if arrays is None:
            arrays = compute()
            self.write(stage, key, arrays)
        return arrays

    def remove(self, stage: Stage, key: str) -> None:
        """Remove the arrays under a key; raise :class:`StorageError` if that fails."""
        with storing(self.results):
            self._path(stage, key).unlink(missing_ok=True)

    def _path(self, stage: Stage, key: str) -> Path:
        """Return the path of a file."""
        return self.results / RUNS / stage / f"{key}.npz"


def _array_of(file: bytes) -> NDArray[Any]:
    """Return the array of an ``.npy`` file.

    Many headers of small arrays are alike, and are parsed once.
    """
    end = _NPY_PREFIX + int.from_bytes(file[len(_NPY_MAGIC) : _NPY_PREFIX], "little")
    header = _parse_header(file[:end]) if file.startswith(_NPY_MAGIC) else None
    if header is None:
        return np.asarray(np.lib.format.read_array(io.BytesIO(file), allow_pickle=False))
    shape, dtype = header
    return np.frombuffer(file, dtype, offset=end).reshape(shape)


@lru_cache(_KEPT_HEADERS)
def _parse_header(header: bytes) -> tuple[tuple[int, ...], np.dtype[Any]] | None:
    """Return shape and type of an array of numbers or text, row by row; None for others."""
    file = io.BytesIO(header)
    np.lib.format.read_magic(file)
    shape, is_by_columns, dtype = np.lib.format.read_array_header_1_0(file)
    return None if is_by_columns or dtype.hasobject else (shape, dtype)


def _write_arrays(arrays: Arrays, file: IO[bytes], *, search: bool) -> None:
    """Write arrays as an ``.npz`` file; unlike with ``numpy.savez``, any name will do.

    Parameters
    ----------
    arrays, file
        The arrays, and the file to write to.
    search
        Whether to search for repetitions when compressing.
    """
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.comment = str(len(arrays)).encode()
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as part:
                if not search:
                    vars(part)["_compressor"] = _compressor_without_search()
                np.lib.format.write_array(part, np.asanyarray(array), allow_pickle=False)


def _compressor_without_search() -> Any:
    """Return a compressor that codes bytes by their frequency alone."""
    return zlib.compressobj(
        level=1,
        method=zlib.DEFLATED,
        wbits=-zlib.MAX_WBITS,  # as in ZIP files, without a header
        memLevel=zlib.DEF_MEM_LEVEL,
        strategy=zlib.Z_HUFFMAN_ONLY,
    )
