"""Read files of users within bounds, and write files atomically.

A file is written under a temporary name, and then replaces the old one.
"""

from __future__ import annotations

import codecs
import contextlib
import errno
import functools
import hashlib
import io
import json
import os
import re
import secrets
import stat
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np

from benchmark.errors import BenchmarkError, UnreadableMesh, without_file
from benchmark.text import nfc

#: Largest file of a user that is read, in bytes.
LARGEST_FILE = 2**30

#: Largest list or file of settings, in bytes.
LARGEST_LIST = 2**24

#: Bytes that are read at a time.
_CHUNK = 2**20

#: First bytes of a file in which :data:`_STAND_INS` are looked for.
_BEGINNING = 200

#: Digests of files that a process keeps.
_KEPT_DIGESTS = 2**16

#: First bytes of an array of NumPy, and of an archive of arrays, which may be empty.
_NUMPY = (b"\x93NUMPY", b"PK\x03\x04", b"PK\x05\x06")

#: Length of the header of a MATLAB file, where in it the order of bytes stands, and the mark of
#: big-endian machines.
_MAT_HEADER = 128
_MAT_BYTE_ORDER = slice(126, 128)
_MAT_BIG_ENDIAN = b"MI"

#: Length of the tag before each element of a MATLAB file, and the type of compressed elements.
_MAT_TAG = 8
_MAT_COMPRESSED = 15

#: First bytes of files that stand for others, and what these are.
_STAND_INS = {
    b"version https://git-lfs": "it is a pointer of Git LFS, which 'git lfs pull' replaces",
    b"<!doctype html": "it is a web page, not the file that it links to",
    b"<html": "it is a web page, not the file that it links to",
    b"\0\5\26\7": (
        "it holds what macOS knows of a file (AppleDouble), which has the name without '._'"
    ),
}

#: First bytes of formats that hold no text, and how they are called.
_BINARY = {
    b"\x93NUMPY": "a NumPy array (.npy)",
    b"MATLAB 5.0": "a MATLAB file (.mat)",
    b"MATLAB 7.3": "a MATLAB file of -v7.3 (.mat)",
    b"\x89HDF": "an HDF5 file (.h5)",
    b"\x1f\x8b": "a file compressed by gzip (.gz), which 'gunzip' unpacks",
    b"BZh": "a file compressed by bzip2 (.bz2)",
    b"\xfd7zXZ": "a file compressed by xz (.xz)",
    b"\x28\xb5\x2f\xfd": "a file compressed by zstd (.zst)",
    b"\xd0\xcf\x11\xe0": "a workbook of Excel (.xls)",
    b"PAR1": "a Parquet table",
    b"ARROW1": "an Arrow table (.feather)",
    b"\x80\2": "a pickle of Python",
    b"\x80\3": "a pickle of Python",
    b"\x80\4": "a pickle of Python",
    b"\x80\5": "a pickle of Python",
}

#: Names within ZIP archives of formats, and how these are called.
_IN_ZIP = {
    b"xl/workbook": "a workbook of Excel (.xlsx)",
    b"data.pkl": "a file of PyTorch (.pt)",
    b"opendocument.spreadsheet": "a spreadsheet (.ods)",
    b".npy": "an archive of NumPy (.npz)",
}

#: Byte-order marks and their encodings. UTF-32 comes first: its mark begins with that of UTF-16.
_BYTE_ORDER_MARKS = {
    codecs.BOM_UTF8: "UTF-8",
    codecs.BOM_UTF32_LE: "UTF-32-LE",
    codecs.BOM_UTF32_BE: "UTF-32-BE",
    codecs.BOM_UTF16_LE: "UTF-16-LE",
    codecs.BOM_UTF16_BE: "UTF-16-BE",
}

#: Ending of the names of temporary files.
_SUFFIX = ".tmp"


def open_file(path: Path, largest: int | None = None) -> BufferedReader:
    """Open a regular file of at most so many bytes.

    Raises
    ------
    OSError
        If it is larger, or something else such as a pipe or a device; it is raised at once.
    """
    # Opening a device may move it, and a socket cannot be opened.
    _check_regular(path.stat(), largest)
    file = open(path, "rb", opener=_open_without_waiting)  # noqa: SIM115  # the caller closes it
    try:
        _check_regular(os.fstat(file.fileno()), largest)
    except OSError:
        file.close()
        raise
    return file


def _open_without_waiting(name: str, flags: int) -> int:
    """Open a file; one that was replaced by a pipe or a terminal meanwhile keeps nobody waiting."""
    return os.open(name, flags | os.O_NONBLOCK | os.O_NOCTTY)


def _check_regular(status: os.stat_result, largest: int | None) -> None:
    """Raise ``OSError`` unless a path is a regular file of at most so many bytes."""
    if stat.S_ISDIR(status.st_mode):
        raise OSError(errno.EISDIR, "it is a folder, not a file")
    if not stat.S_ISREG(status.st_mode):
        raise OSError(None, "it is a pipe or a device, not a file")
    if largest is not None and status.st_size > largest:
        raise OSError(None, f"it holds more than {largest:,} bytes")


def chunks_of(path: Path, largest: int | None = None, size: int = _CHUNK) -> Iterator[bytes]:
    """Yield the content of a file of a user, in pieces.

    At most one byte more is read than the size that the file announces, because a file of ``/proc``
    may have no end.

    Parameters
    ----------
    path
        The file.
    largest
        Largest size that is allowed, in bytes; None for no limit.
    size
        Largest size of a piece, in bytes.

    Raises
    ------
    OSError
        If the file cannot be read, is no regular file, is larger than allowed, or holds another
        number of bytes than it announces.
    """
    with open_file(path, largest) as file:
        announced = os.fstat(file.fileno()).st_size
        n_read = 0
        while n_read <= announced:
            # One byte more would show that the file is longer than it announces.
            content: bytes | None = file.read(min(size, announced + 1 - n_read))
            if content is None:
                raise OSError(errno.EAGAIN, "reading it would wait: it is no file of a disk")
            if not content:
                break
            n_read += len(content)
            yield content
    if n_read != announced:
        problem = (
            "it does not have the size that it announces: it is being written, or lies in /proc"
        )
        raise OSError(errno.EAGAIN, problem)


def read_file(path: Path, largest: int = LARGEST_FILE) -> bytes:
    """Return the content of a file of a user, which is opened and read once.

    Raises
    ------
    OSError
        As :func:`chunks_of`, and if the file only stands for another; ``errno`` is None if reading
        it again would not help.
    """
    content = b"".join(chunks_of(path, largest, largest + 1))
    beginning = content[:_BEGINNING].lstrip().lower()
    for mark, problem in _STAND_INS.items():
        if beginning.startswith(mark):
            raise OSError(None, problem)
    return content


def names_in(folder: Path) -> list[str]:
    """Return the sorted names of all files and folders in a folder; none if it cannot be listed.

    Of thousands, that takes a fraction of the time of ``Path.glob``.
    """
    try:
        return sorted(path.name for path in folder.iterdir())
    except OSError:
        return []


def parse_json(text: str | bytes) -> Any:
    """Return the content of JSON.

    Raises
    ------
    ValueError
        If it is none, or has a key twice.
    RecursionError
        If it is nested too deeply.
    """
    return json.loads(text, object_pairs_hook=_with_different_keys)


def _with_different_keys(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of JSON; raise ``ValueError`` if it has a key twice."""
    check_different([key for key, _ in pairs])
    return dict(pairs)


def check_different(keys: Sequence[str]) -> None:
    """Raise ``ValueError`` if a key of a mapping stands there twice."""
    known: set[str] = set()
    for key in keys:
        if key in known:
            raise ValueError(f"key '{key}' stands there twice")
        known.add(key)


def write_atomically(path: Path, write: Callable[[Any], object], *, durable: bool = False) -> None:
    """Write a file that has the old or the new content at any moment, even if the process dies.

    The content is written to a temporary file beside it, which then takes its name.

    Parameters
    ----------
    path
        The file; its folder is created if necessary, and its mode follows the umask. Devices and
        pipes are written directly.
    write
        Called with the binary file to write to.
    durable
        Whether to flush the content to disk before the file is renamed, so that it survives a power
        failure.

    Raises
    ------
    OSError
        If the file cannot be written; then no temporary file remains. An error of the system names
        the file.
    """
    with _naming(path):
        if path.is_char_device() or path.is_fifo():
            with path.open("wb") as file:
                write(file)
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = _temporary_beside(path)
        try:
            with temporary.open("xb") as file:
                write(file)
                if durable:
                    file.flush()
                    os.fsync(file.fileno())
            temporary.replace(path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


def write_together(contents: Mapping[Path, bytes]) -> None:
    """Write files together: where the disk is full, all old ones stay as they are.

    All contents are first written to temporary files beside them, which then take their names.

    Raises
    ------
    OSError
        If a file cannot be written, which it names.
    """
    temporaries: dict[Path, Path] = {}
    try:
        for path, content in contents.items():
            with _naming(path):
                path.parent.mkdir(parents=True, exist_ok=True)
                temporaries[path] = _temporary_beside(path)
                temporaries[path].write_bytes(content)
        for path, temporary in temporaries.items():
            with _naming(path):
                temporary.replace(path)
    except BaseException:
        for temporary in temporaries.values():
            temporary.unlink(missing_ok=True)
        raise


def _temporary_beside(path: Path) -> Path:
    """Return a new name for a temporary file in the folder of a file."""
    return path.parent / f".{os.getpid()}-{secrets.token_hex(4)}{_SUFFIX}"


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Let errors of the file system name a file, and not the temporary one that is written."""
    try:
        yield
    except OSError as error:
        if error.errno is None:  # of a library, and with a text of its own
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


def write_text(path: Path, text: str) -> None:
    """Write text in UTF-8 with :func:`write_atomically`."""
    write_atomically(path, lambda file: file.write(text.encode("utf-8")))


def sweep(folder: Path) -> None:
    """Remove the temporary files of killed writers in a folder, which nobody else writes to."""
    for path in folder.rglob(f".*-*{_SUFFIX}"):
        with contextlib.suppress(OSError):
            path.unlink()


def decode(content: bytes) -> str:
    """Decode text in UTF-8, or in the encoding that its byte-order mark names.

    Characters are composed (Unicode normal form C), so that equal words are equal texts.

    Raises
    ------
    UnicodeError
        If the content is binary, or in another encoding.
    """
    kind = binary_format(content)
    if kind:
        raise UnicodeError(f"it is {kind}, not text")
    encoding = "UTF-8"
    start = 0
    for mark, marked_encoding in _BYTE_ORDER_MARKS.items():
        if content.startswith(mark):
            encoding = marked_encoding
            start = len(mark)
            break
    try:
        text = content[start:].decode(encoding)
    except UnicodeDecodeError as error:
        place = start + error.start + 1
        problem = f"byte {place} is no text in {encoding}: it is binary, or in another encoding"
        raise UnicodeError(problem) from error
    if "\0" in text:
        raise UnicodeError("it is binary, or in UTF-16 without a byte-order mark")
    return nfc(text)


def binary_format(content: bytes) -> str:
    """Return how a well-known format without text is called; "" for any other content."""
    if content.startswith(b"PK\3\4"):
        for mark, name in _IN_ZIP.items():
            if mark in content:
                return name
        return "a ZIP archive"
    for mark, name in _BINARY.items():
        if content.startswith(mark):
            return name
    return ""


def file_digest(path: Path, largest: int | None = LARGEST_FILE) -> str:
    """Return the SHA-256 of a file in hexadecimal, cached per process while the file is unchanged.

    Raises
    ------
    UnreadableMesh
        If the file is unreadable, or holds more than ``largest`` bytes.
    """
    try:
        status = path.stat()
        version = status.st_size, status.st_mtime_ns, status.st_ctime_ns
        return _digest(path.absolute(), largest, *version)
    except OSError as error:
        problem = f"it cannot be read: {error.strerror}"
        raise UnreadableMesh(problem, "check the file and its rights", path) from error


@functools.lru_cache(maxsize=_KEPT_DIGESTS)
def _digest(path: Path, largest: int | None, *_: int) -> str:
    """Compute a file digest; size and times distinguish versions of a file in the cache."""
    digest = hashlib.sha256()
    for content in chunks_of(path, largest):
        digest.update(content)
    return digest.hexdigest()


# Reading with named errors
# --------------------------------------------------------------------------------------------


@contextmanager
def named_errors(path: Path, what: str, kind: type[BenchmarkError], hint: str) -> Iterator[None]:
    """Convert errors in a ``with`` block that reads a file to errors that name the file.

    Their messages have one line. They hold the file as an attribute and not in the text, which may
    be stored for any file with the same content.

    Parameters
    ----------
    path
        The file.
    what
        What the file should be, such as "mesh".
    kind, hint
        Class and hint for errors that are no ``BenchmarkError``; those keep their own.
    """
    try:
        yield
    except BenchmarkError as error:
        if error.file:  # another file, which this one refers to
            raise
        problem = without_file(error.problem, path)
        raise type(error)(problem, without_file(error.hint, path), path) from error
    except Exception as error:  # libraries raise errors of all types for a damaged file
        if isinstance(error, OSError) and error.strerror:
            raise kind(error.strerror, _advice(error, hint), path) from error
        problem = f"not a readable {what}: {without_file(_reason_of(error), path):.300}"
        raise kind(problem, hint, path) from error


def _advice(error: OSError, hint: str) -> str:
    """Return what to do about a file that the system does not read; a hint if it does."""
    if error.errno is None:
        return hint
    if error.errno == errno.EAGAIN:
        return "wait until it is written, or copy it to a disk"
    return "check the path and its permissions"


def _reason_of(error: Exception) -> str:
    """Return what an error says, on one line, and its type unless that is a usual one."""
    if isinstance(error, RecursionError):
        return "nested too deeply"
    if "allow_pickle" in str(error):  # numpy advises to run what a file holds
        return "it holds objects of Python, not numbers or text"
    text = re.sub(r" <[^<>]* at 0x[0-9a-f]+>", "", str(error))  # an address differs in each run
    text = " ".join(text.split())
    if isinstance(error, ValueError | OSError):
        return text
    return f"{type(error).__name__} {text}"


def load_arrays(content: bytes) -> Any:
    """Return the array of a ``.npy`` file, or the archive of an ``.npz`` file.

    Raises
    ------
    ValueError
        If it is neither, or bytes follow an array.
    """
    if not content.startswith(_NUMPY):
        raise ValueError("it is no array of NumPy (.npy), and no archive of arrays (.npz)")
    stream = io.BytesIO(content)
    loaded = np.load(stream, allow_pickle=False)
    if isinstance(loaded, np.ndarray) and stream.read(1):
        raise ValueError("bytes follow the array that its header announces")
    return loaded


def check_expansion(data: bytes) -> None:
    """Raise ``ValueError`` if the variables of a MATLAB file would fill too much memory.

    The variables are compressed: a few kilobytes can hold terabytes.

    Parameters
    ----------
    data
        Content of the file. A header is followed by elements, each with a tag (two integers, its
        kind and its size) before its content.
    """
    is_big_endian = data[_MAT_BYTE_ORDER] == _MAT_BIG_ENDIAN
    tag = ">II" if is_big_endian else "<II"
    n_left = LARGEST_FILE  # bytes that the variables may still fill
    start = _MAT_HEADER
    while start + _MAT_TAG <= len(data):
        kind, size = struct.unpack_from(tag, data, start)
        start += _MAT_TAG
        if kind == _MAT_COMPRESSED:
            # One byte beyond the limit is enough to exceed it.
            content = data[start : start + size]
            n_left -= len(zlib.decompressobj().decompress(content, n_left + 1))
        if n_left < 0:
            raise ValueError(f"its variables expand to more than {LARGEST_FILE / 2**30:g} GiB")
        start += size
