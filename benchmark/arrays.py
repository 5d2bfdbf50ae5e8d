"""Archives of arrays that describe their own content, so that reading detects damaged and missing arrays."""

from __future__ import annotations

import hashlib
import io
import json
import math
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

Arrays = Mapping[str, NDArray[Any]]

#: Entry with the key of the file, and the type and shape of each array.
_CONTENTS = "__contents__"

#: Prefix of the names of arrays that are metadata, not results.
ABOUT = "about:"

#: Largest total size of the arrays of a file, unpacked, in bytes.
LARGEST = 2**31

#: Follows type and shape if only the upper triangle of a symmetric matrix is stored.
_UPPER = "upper triangle"

#: Compression methods that unpack in little memory.
PACKED = frozenset({zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED})

_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


class UnsafeArrays(ValueError):
    """A file of arrays could run code or fill the memory; ``name`` identifies the problem."""

    def __init__(self, name: str, problem: str) -> None:
        super().__init__(problem)
        self.name = name


def save_arrays(file: Any, key: str, arrays: Arrays, *, compressed: bool) -> None:
    """Write arrays to an ``.npz`` archive with a description of its content.

    Compression stores only half of a symmetric matrix: the distances of large galleries dominate a results folder.

    Parameters
    ----------
    file
        Open binary file.
    key
        Key that the archive is stored under.
    arrays
        Arrays by name; none may hold objects.
    compressed
        Whether to compress.
    """
    whole = {name: np.asanyarray(array) for name, array in arrays.items()}
    halved = {name for name, array in whole.items() if compressed and _is_symmetric(array)}
    kinds = {name: [*_kind(array), *([_UPPER] if name in halved else [])] for name, array in whole.items()}
    kept = {name: array[_upper(len(array))] if name in halved else array for name, array in whole.items()}
    contents = np.array(json.dumps({"key": key, "arrays": kinds}))
    # numpy.savez does not accept arrays with the names of its own arguments.
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED) as archive:
        for name, array in {**kept, _CONTENTS: contents}.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as part:
                np.lib.format.write_array(part, array, allow_pickle=False)


def digest_of(arrays: Arrays) -> str:
    """Return a digest of the bits, names, types and shapes of arrays: 16 hexadecimal digits.

    Metadata, whose names begin with :data:`ABOUT`, are left out.
    """
    hasher = hashlib.sha256()
    for name in sorted(name for name in arrays if not name.startswith(ABOUT)):
        array = np.asanyarray(arrays[name])
        hasher.update(json.dumps([name, *_kind(array)]).encode())
        hasher.update(np.ascontiguousarray(array).data)
    return hasher.hexdigest()[:16]


def load_arrays(
    source: Path | IO[bytes], key: str, wanted: Callable[[str], bool] | None = None, *, largest: int | None = None
) -> dict[str, NDArray[Any]]:
    """Read an archive of :func:`save_arrays`.

    Each array is read to its last byte, so that its checksum is verified, and compared with the description: a damaged
    header that makes an array smaller would otherwise go unnoticed.

    Parameters
    ----------
    source
        Open file or path.
    key
        Key that the archive is stored under.
    wanted
        Predicate on names that selects the arrays to read; all by default.
    largest
        Largest total size in bytes; None for :data:`LARGEST`.

    Raises
    ------
    FileNotFoundError
        If there is no file.
    UnsafeArrays
        If it is too large, or an array holds Python objects.
    Exception
        Of various types, if the file is damaged or not such an archive.
    """
    with zipfile.ZipFile(source) as archive:
        parts = {part.filename.removesuffix(".npy"): part for part in archive.infolist()}
        _require_size(sum(part.file_size for part in parts.values()), largest)
        if any(part.compress_type not in PACKED for part in parts.values()):
            raise ValueError("the arrays are packed in an unusual way")
        described = json.loads(str(read_array(archive, parts.pop(_CONTENTS))))
        kinds = described["arrays"]
        if described["key"] != key or kinds.keys() != parts.keys():
            raise ValueError("the file holds something else than its name says")
        _require_size(
            sum(part.file_size * (2 if _is_half(kinds[name]) else 1) for name, part in parts.items()), largest
        )
        return {
            name: _unfolded(read_array(archive, part), kinds[name])
            for name, part in parts.items()
            if wanted is None or wanted(name)
        }


def _require_size(size: int, largest: int | None) -> None:
    if size > (largest or LARGEST):
        raise UnsafeArrays("too-large", f"unpacks to more than {largest or LARGEST:,} bytes")


def _kind(array: NDArray[Any]) -> list[Any]:
    return [array.dtype.str, list(array.shape)]


def _unfolded(array: NDArray[Any], kind: list[Any]) -> NDArray[Any]:
    """Return the array that the file describes, completed if only half of it was stored."""
    if not _is_half(kind):
        if _kind(array) == kind:
            return array
    else:
        dtype, (count, width), _ = kind
        if count == width and _kind(array) == [dtype, [count * (count + 1) // 2]]:
            matrix = np.empty((count, count), array.dtype)
            matrix[_upper(count)] = matrix.T[_upper(count)] = array
            return matrix
    raise ValueError("an array is not what the file says of it")


def _is_half(kind: list[Any]) -> bool:
    return len(kind) == 3 and kind[2] == _UPPER


def _is_symmetric(array: NDArray[Any]) -> bool:
    """Return whether a matrix of floats equals its transpose bit by bit, including signs of zeros and NaN payloads."""
    is_square = array.ndim == 2 and 0 < array.shape[0] == array.shape[1]
    if not is_square or array.dtype.kind != "f" or array.itemsize > 8 or not array.flags.c_contiguous:
        return False
    bits = array.view(f"u{array.itemsize}")
    return np.array_equal(bits, bits.T)


def _upper(count: int) -> NDArray[np.bool_]:
    """Return the mask of the upper triangle with the diagonal."""
    return np.tri(count, dtype=bool).T


def read_array(archive: zipfile.ZipFile, part: zipfile.ZipInfo) -> NDArray[Any]:
    """Read one array of an archive; raise ``ValueError`` if its size differs from the declared one."""
    with archive.open(part) as file:
        content = file.read(part.file_size)  # at most the declared size, whatever the data unpack to
        if len(content) != part.file_size or file.read(1):
            raise ValueError("an array has another size than the file says")
    stream = io.BytesIO(content)
    shape, is_fortran, dtype = _HEADERS[np.lib.format.read_magic(stream)](stream)
    if dtype.hasobject:
        raise UnsafeArrays("pickle", "holds Python objects, which may be programs")
    if stream.tell() + math.prod(shape) * dtype.itemsize != len(content):
        raise ValueError("an array has another size than its header says")
    array: NDArray[Any] = np.ndarray(shape, dtype, content, stream.tell(), order="F" if is_fortran else "C")
    return array.copy(order="K")
