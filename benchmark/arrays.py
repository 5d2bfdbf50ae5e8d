"""Files of arrays that know what they hold: whatever is damaged or missing in them is noticed when they are read."""

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

#: Entry that tells the key of the file, and kind and shape of each array.
_CONTENTS = "__contents__"

#: Begins the names of arrays that tell of others, and are no result themselves.
ABOUT = "about:"

#: Bytes of all arrays together beyond which a file is not read, however small it is itself.
LARGEST = 2**31

#: Marks, behind kind and shape, a symmetric matrix of which the rows of the upper triangle are kept.
_UPPER = "upper triangle"

#: Ways to pack a file that unfold in little memory.
PACKED = frozenset({zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED})

_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


class UnsafeArrays(ValueError):
    """A file of arrays that may run a program or fill the memory, by the name of its fault."""

    def __init__(self, name: str, problem: str) -> None:
        super().__init__(problem)
        self.name = name


def save_arrays(file: Any, key: str, arrays: Arrays, *, compressed: bool) -> None:
    """Write arrays as ``.npz``, with what they are.

    Where room is to be saved, half of a symmetric matrix is written: distances of a large gallery are most of a results
    folder.

    Parameters
    ----------
    file
        Open binary file.
    key
        What they are kept under.
    arrays
        By name; none may hold objects.
    compressed
        Whether to take time to save room.
    """
    whole = {name: np.asanyarray(array) for name, array in arrays.items()}
    halved = {name for name, array in whole.items() if compressed and _is_symmetric(array)}
    kinds = {name: [*_kind(array), *([_UPPER] if name in halved else [])] for name, array in whole.items()}
    kept = {name: array[_upper(len(array))] if name in halved else array for name, array in whole.items()}
    contents = np.array(json.dumps({"key": key, "arrays": kinds}))
    # Not by numpy.savez, whose own arguments are names that no array can have.
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED) as archive:
        for name, array in {**kept, _CONTENTS: contents}.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as part:
                np.lib.format.write_array(part, array, allow_pickle=False)


def digest_of(arrays: Arrays) -> str:
    """Return the digest of arrays, their names, types and shapes: 16 hexadecimal digits, the same for the same bits.

    What begins with :data:`ABOUT` is left out.
    """
    found = hashlib.sha256()
    for name in sorted(name for name in arrays if not name.startswith(ABOUT)):
        array = np.asanyarray(arrays[name])
        found.update(json.dumps([name, *_kind(array)]).encode())
        found.update(np.ascontiguousarray(array).data)
    return found.hexdigest()[:16]


def load_arrays(
    source: Path | IO[bytes], key: str, wanted: Callable[[str], bool] | None = None, *, largest: int | None = None
) -> dict[str, NDArray[Any]]:
    """Read what :func:`save_arrays` wrote.

    Each array is read to its last byte, which is when its checksum is compared, and is compared with what the file says
    of it: a shape that a damaged header makes smaller would pass for whole otherwise.

    Parameters
    ----------
    source
        The file, or its path.
    key
        What it is kept under.
    wanted
        Chooses the arrays to read by name; all by default.
    largest
        Bytes of all arrays together beyond which none is read; None for :data:`LARGEST`.

    Raises
    ------
    FileNotFoundError
        If there is no file.
    UnsafeArrays
        If it is too large, or an array holds Python objects.
    Exception
        Of many kinds, if it is damaged or something else.
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
    """The array that a file says it holds, unfolded where half of it was kept."""
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
    """Return whether a matrix of floats equals its transpose to the last bit, signs of zeros and kinds of NaN too."""
    is_square = array.ndim == 2 and 0 < array.shape[0] == array.shape[1]
    if not is_square or array.dtype.kind != "f" or array.itemsize > 8 or not array.flags.c_contiguous:
        return False
    bits = array.view(f"u{array.itemsize}")
    return np.array_equal(bits, bits.T)


def _upper(count: int) -> NDArray[np.bool_]:
    """Mask of the upper triangle with the diagonal."""
    return np.tri(count, dtype=bool).T


def read_array(archive: zipfile.ZipFile, part: zipfile.ZipInfo) -> NDArray[Any]:
    """Return the array of an archive; raises ``ValueError`` where it is not as large as is said of it."""
    with archive.open(part) as file:
        content = file.read(part.file_size)  # no more than was announced, whatever unfolds
        if len(content) != part.file_size or file.read(1):
            raise ValueError("an array has another size than the file says")
    stream = io.BytesIO(content)
    shape, is_fortran, dtype = _HEADERS[np.lib.format.read_magic(stream)](stream)
    if dtype.hasobject:
        raise UnsafeArrays("pickle", "holds Python objects, which may be programs")
    if stream.tell() + math.prod(shape) * dtype.itemsize != len(content):
        raise ValueError("an array has another size than its header says")
    found: NDArray[Any] = np.ndarray(shape, dtype, content, stream.tell(), order="F" if is_fortran else "C")
    return found.copy(order="K")
