"""The file of a bundle, read as what it is: data from strangers, of which nothing is unpacked onto the disk."""

from __future__ import annotations

import io
import stat
import zipfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.arrays import load_arrays
from benchmark.bundles.manifest import MANIFEST, NAMES, BundleError
from benchmark.pipeline.storage.record_schema import read_json

#: Bytes of the largest bundle, of all its files together, of one of them, and of the arrays that one unfolds to.
LARGEST_BUNDLE, LARGEST_TOTAL, LARGEST_FILE, LARGEST_ARRAYS = 2**30, 2**31, 2**29, 2**30

#: Bytes of the largest file of JSON.
LARGEST_JSON = 2**25

#: Files of a bundle, and arrays of one of its files, at most.
MOST_FILES, MOST_ARRAYS = 2000, 200_000

#: Ways to pack a file that unfold in little memory.
_PACKED = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}

_HINT = "ask its author for the file that 'submit' wrote"


@dataclass(frozen=True)
class Archive:
    """The files of a bundle, held in memory.

    Parameters
    ----------
    content
        The bundle.
    parts
        Its files by name.
    """

    content: bytes
    parts: dict[str, zipfile.ZipInfo]

    @classmethod
    def open(cls, path: Path) -> Archive:
        """Read a file and look at the names in it.

        Raises
        ------
        BundleError
            If it is no zip file; or one with a name that no bundle has, a name twice, a link, or more in it than any
            bundle has.
        OSError
            If it cannot be read.
        """
        with path.open("rb") as file:
            content = file.read(LARGEST_BUNDLE + 1)
        if len(content) > LARGEST_BUNDLE:
            raise BundleError("too-large", f"{path.name} has more than {LARGEST_BUNDLE:,} bytes", _HINT)
        try:
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                parts = archive.infolist()
        except Exception as error:
            raise BundleError("no-zip", f"{path.name} is not a zip file, or is damaged", _HINT) from error
        for part in parts:
            _check(part)
        twice = [name for name, count in Counter(part.filename.casefold() for part in parts).items() if count > 1]
        if twice:
            raise BundleError("name-twice", f"two files in it are called '{twice[0]}'", _HINT)
        if len(parts) > MOST_FILES or sum(part.file_size for part in parts) > LARGEST_TOTAL:
            raise BundleError("too-large", f"it unpacks to more than {LARGEST_TOTAL:,} bytes, or many files", _HINT)
        return cls(content, {part.filename: part for part in parts})

    def read(self, name: str) -> bytes:
        """Return a file; raises :class:`BundleError` if it is not there, or not as the bundle announces it."""
        if name not in self.parts:
            raise BundleError("file-missing", f"'{name}' is not in it", _HINT)
        part = self.parts[name]
        try:
            with zipfile.ZipFile(io.BytesIO(self.content)) as archive, archive.open(part) as file:
                found = file.read(part.file_size)  # no more than was announced, whatever unfolds
                is_whole = len(found) == part.file_size and not file.read(1)
        except Exception as error:
            raise BundleError("damaged", f"'{name}' in it cannot be read", _HINT) from error
        if not is_whole:
            raise BundleError("too-large", f"'{name}' in it has another size than it announces", _HINT)
        return found

    def json(self, name: str) -> Any:
        """Return a file of JSON; raises :class:`BundleError` as :meth:`read` does, and for what is none."""
        if name in self.parts and self.parts[name].file_size > LARGEST_JSON:
            raise BundleError("too-large", f"'{name}' in it unpacks to more than {LARGEST_JSON:,} bytes", _HINT)
        try:
            return read_json(self.read(name))
        except (ValueError, RecursionError) as error:
            raise BundleError("no-json", f"'{name}' in it is not JSON, or contains NaN or Infinity", _HINT) from error

    def arrays(self, name: str, key: str) -> dict[str, Any]:
        """Return the arrays of a file, of plain numbers alone; raises :class:`BundleError` for any other file."""
        content = self.read(name)
        try:
            with zipfile.ZipFile(io.BytesIO(content)) as inner:
                parts = inner.infolist()
                if {part.compress_type for part in parts} - _PACKED:
                    raise BundleError("no-arrays", f"'{name}' is packed in an unusual way", _HINT)
                is_large = len(parts) > MOST_ARRAYS or sum(part.file_size for part in parts) > LARGEST_ARRAYS
                if not is_large and any(map(_has_objects, (inner.open(part) for part in parts))):
                    raise BundleError("pickle", f"'{name}' holds Python objects, which may be programs", _HINT)
            if is_large:
                raise BundleError("too-large", f"'{name}' unpacks to more than {LARGEST_ARRAYS:,} bytes", _HINT)
            return load_arrays(io.BytesIO(content), key)
        except BundleError:
            raise
        except Exception as error:
            raise BundleError("no-arrays", f"'{name}' holds no arrays, or those of another record", _HINT) from error


def _check(part: zipfile.ZipInfo) -> None:
    """Raise :class:`BundleError` for a file that no bundle has."""
    name, kind = part.orig_filename, part.external_attr >> 16
    shown = ascii(name)[1:-1][:80]
    if stat.S_IFMT(kind) not in (0, stat.S_IFREG):
        raise BundleError("link", f"'{shown}' in it is a link or a device", _HINT)
    if name.startswith("/") or "\\" in name or ":" in name or ".." in name.split("/"):
        raise BundleError("path-outside", f"'{shown}' points outside the bundle", _HINT)
    if not NAMES.fullmatch(name) or name != part.filename:
        raise BundleError("unknown-file", f"'{shown}' does not belong in a bundle", f"a bundle has {MANIFEST}; {_HINT}")
    if part.flag_bits & 1 or part.compress_type not in _PACKED:
        raise BundleError("no-zip", f"'{shown}' in it is encrypted, or packed in an unusual way", _HINT)
    if part.file_size > LARGEST_FILE:
        raise BundleError("too-large", f"'{shown}' unpacks to {part.file_size:,} bytes", _HINT)


def _has_objects(file: Any) -> bool:
    """Return whether an array in a file is one of Python objects, by its header alone."""
    with file:
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        return bool(read(file)[2].hasobject)
