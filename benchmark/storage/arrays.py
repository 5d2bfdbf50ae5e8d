"""Files of arrays that know what they hold: whatever is damaged or missing in them is noticed when they are read."""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = Mapping[str, NDArray[Any]]

#: Entry that tells the key of the file, and kind and shape of each array.
_CONTENTS = "__contents__"

#: Bytes of all arrays together beyond which a file is not read, however small it is itself.
LARGEST = 2**31

_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def save_arrays(file: Any, key: str, arrays: Arrays, *, compressed: bool) -> None:
    """Write arrays as ``.npz``, with what they are.

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
    contents = {"key": key, "arrays": {name: _kind(np.asanyarray(array)) for name, array in arrays.items()}}
    save = np.savez_compressed if compressed else np.savez
    save(file, allow_pickle=False, **arrays, **{_CONTENTS: np.array(json.dumps(contents))})


def load_arrays(path: Path, key: str, wanted: Callable[[str], bool] | None = None) -> dict[str, NDArray[Any]]:
    """Read what :func:`save_arrays` wrote.

    Each array is read to its last byte, which is when its checksum is compared, and is compared with what the file says
    of it: a shape that a damaged header makes smaller would pass for whole otherwise.

    Parameters
    ----------
    path
        The file.
    key
        What it is kept under.
    wanted
        Chooses the arrays to read by name; all by default.

    Raises
    ------
    FileNotFoundError
        If there is no file.
    Exception
        Of many kinds, if it is damaged or something else.
    """
    with zipfile.ZipFile(path) as archive:
        parts = {part.filename.removesuffix(".npy"): part for part in archive.infolist()}
        if sum(part.file_size for part in parts.values()) > LARGEST:
            raise ValueError("the arrays are too large")
        told = json.loads(str(_read(archive, parts.pop(_CONTENTS))))
        if told["key"] != key or told["arrays"].keys() != parts.keys():
            raise ValueError("the file holds something else than its name says")
        arrays = {name: _read(archive, part) for name, part in parts.items() if wanted is None or wanted(name)}
    if any(_kind(array) != told["arrays"][name] for name, array in arrays.items()):
        raise ValueError("an array is not what the file says of it")
    return arrays


def _kind(array: NDArray[Any]) -> list[Any]:
    return [array.dtype.str, list(array.shape)]


def _read(archive: zipfile.ZipFile, part: zipfile.ZipInfo) -> NDArray[Any]:
    with archive.open(part) as file:
        content = file.read(part.file_size)  # no more than was announced, whatever unfolds
        if len(content) != part.file_size or file.read(1):
            raise ValueError("an array has another size than the file says")
    stream = io.BytesIO(content)
    shape, is_fortran, dtype = _HEADERS[np.lib.format.read_magic(stream)](stream)
    if dtype.hasobject or stream.tell() + math.prod(shape) * dtype.itemsize != len(content):
        raise ValueError("an array has another size than its header says")
    found: NDArray[Any] = np.ndarray(shape, dtype, content, stream.tell(), order="F" if is_fortran else "C")
    return found.copy(order="K")
