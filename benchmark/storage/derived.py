"""Files that can be made again from others: they count while they are whole and made by what is there now."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from benchmark.storage.environment import ROOT
from benchmark.system.files import write_text
from benchmark.system.fingerprints import FIRST_PARTY, installed_names

#: Bytes beyond which a file is known by its size and times alone.
_SMALL = 2**20


def read_derived(path: Path, made_by: str) -> Any:
    """Return the content of such a file; None where there is none that is whole and was made by the same.

    Parameters
    ----------
    path
        The file.
    made_by
        Digest of all that the content depends on and does not name itself.
    """
    try:
        checksum, _, text = path.read_text(encoding="utf-8").partition("\n")
        return json.loads(text) if checksum == _checksum(text, made_by) else None
    except (OSError, ValueError):
        return None


def write_derived(path: Path, made_by: str, content: Any) -> None:
    """Write such a file, where that can be done."""
    text = json.dumps(content, separators=(",", ":"))
    with suppress(OSError):
        write_text(path, f"{_checksum(text, made_by)}\n{text}")


@cache
def suite_digest() -> str:
    """Digest of the code that this process runs and of what is installed, as they were when it first asked."""
    return read_suite()


def read_suite() -> str:
    """Digest of the code of the suite with all that lies beside it, of Python and of what is installed."""
    files = (path for name in FIRST_PARTY for path in files_below(ROOT / name) if path.parent.name != "__pycache__")
    return hashlib.sha256(f"{sys.version} {installed_names()} {digest_of_files(files)}".encode()).hexdigest()


def files_below(folder: Path) -> Iterator[Path]:
    """Files of a folder and of those in it, sorted."""
    return (path for path in sorted(folder.rglob("*")) if path.is_file())


def digest_of_files(files: Iterable[Path]) -> str:
    """Digest of files: of the contents of those of the suite, of large and other ones by their sizes and times."""
    found = hashlib.sha256()
    for path in files:
        facts = path.stat()
        is_read = path.is_relative_to(ROOT) and facts.st_size < _SMALL
        told = path.read_bytes() if is_read else repr((facts.st_size, facts.st_mtime_ns, facts.st_ctime_ns)).encode()
        found.update(str(path).encode("utf-8", "surrogateescape") + told)
    return found.hexdigest()


def _checksum(text: str, made_by: str) -> str:
    return hashlib.sha256(f"{made_by} {text}".encode()).hexdigest()
