"""Files of arrays under keys: digests of everything that determines them, known before they are computed."""

from __future__ import annotations

import fcntl
import io
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np
from numpy.typing import NDArray

from benchmark.errors import BenchmarkError
from benchmark.files import sweep, write_atomically
from benchmark.geometry.mesh import read_only
from benchmark.pipeline.stages import Arrays

Stage = Literal["prepared", "forms", "signatures", "records"]  # in the order in which they are made

#: Folder of local results in a results folder.
RUNS = "runs"


class StorageError(BenchmarkError):
    """The results folder cannot be read or written."""


@contextmanager
def storing(results: Path) -> Iterator[None]:
    """Turn errors of the file system into a :class:`StorageError`."""
    try:
        yield
    except OSError as error:
        raise StorageError(
            f"cannot write to {results}: {error.strerror}",
            "free some space, change its rights, or choose another --results DIR; finished jobs are kept",
        ) from error


@contextmanager
def writing(results: Path) -> Iterator[None]:
    """Hold the lock of a results folder for its only writer; readers need none.

    Raises
    ------
    StorageError
        If another process is writing to it, or it cannot be written.
    """
    with storing(results):
        (results / RUNS / "records").mkdir(parents=True, exist_ok=True)
        lock = (results / RUNS / "lock").open("a")
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StorageError(
                f"another run is writing to {results}",
                "wait for its end, or choose another --results DIR",
            ) from None
        except OSError:
            pass  # a file system without locks
        sweep(results / RUNS)
        yield


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
        """Return read-only arrays under a key, by default all; None if there are none, or their file is damaged."""
        try:
            with zipfile.ZipFile(self._path(stage, key)) as archive:
                names = {name.removesuffix(".npy") for name in archive.namelist()}
                if (
                    archive.comment != str(len(names)).encode()
                ):  # the list, which has no checksum, is not complete
                    return None
                wanted = names.intersection(only or names).difference(without)
                files = {name: archive.read(f"{name}.npy") for name in wanted}
            return {name: read_only(_array_of(file)) for name, file in files.items()}
        except Exception:  # zip, zlib and numpy raise many types
            return None

    def write(self, stage: Stage, key: str, arrays: Arrays) -> None:
        """Write the arrays under a key; raise :class:`StorageError` if that fails."""
        with storing(self.results):
            write_atomically(
                self._path(stage, key),
                lambda file: _write_arrays(file, arrays, stage != "signatures"),
            )

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
        return self.results / RUNS / stage / f"{key}.npz"


def _array_of(file: bytes) -> NDArray[Any]:
    """Return the array of an ``.npy`` file; many headers of small arrays are alike, and are parsed once."""
    end = 10 + int.from_bytes(file[8:10], "little")
    known = _header(file[:end]) if file.startswith(b"\x93NUMPY\x01\x00") else None
    if known is None:
        return np.asarray(np.lib.format.read_array(io.BytesIO(file), allow_pickle=False))
    return np.frombuffer(file, known[1], offset=end).reshape(known[0])


@lru_cache(1024)
def _header(header: bytes) -> tuple[tuple[int, ...], np.dtype[Any]] | None:
    """Return shape and type of an array of numbers or text in the order of rows; None for others."""
    file = io.BytesIO(header)
    np.lib.format.read_magic(file)
    shape, by_columns, dtype = np.lib.format.read_array_header_1_0(file)
    return None if by_columns or dtype.hasobject else (shape, dtype)


def _write_arrays(file: IO[bytes], arrays: Arrays, repetitive: bool) -> None:
    """Write arrays as an ``.npz`` file; unlike with ``numpy.savez``, any name will do."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.comment = str(len(arrays)).encode()
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as part:
                if (
                    not repetitive
                ):  # a search for repetitions would take twice as long, for larger files
                    vars(part)["_compressor"] = zlib.compressobj(
                        1, zlib.DEFLATED, -15, 8, zlib.Z_HUFFMAN_ONLY
                    )
                np.lib.format.write_array(part, np.asanyarray(array), allow_pickle=False)
