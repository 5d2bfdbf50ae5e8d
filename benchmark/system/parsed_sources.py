"""Parsed sources of fingerprints, kept from one process to the next: to parse them takes a second."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from benchmark.system import fingerprints
from benchmark.system.files import write_text

#: Entries, of which each version of a module is one, beyond which the file is begun anew.
_MOST = 4000


@contextmanager
def kept_parses(folder: Path | None = None) -> Iterator[None]:
    """Begin with what earlier processes have parsed, and keep what the body adds to it.

    An entry is known by the digest of its source, so that it is never out of date; a file that is damaged or cannot be
    written is as good as none.

    Parameters
    ----------
    folder
        Where it is kept; None for that of Python's compiled modules beside the code.
    """
    source = Path(fingerprints.__file__)
    version = hashlib.sha256(source.read_bytes()).hexdigest()[:8]
    path = (folder or source.parent / "__pycache__") / f"parsed-sources-{version}.json"
    before = _read(path)
    fingerprints.import_cache(fingerprints.ImportCache(before, {}))
    try:
        yield
    finally:
        parsed = fingerprints.export_cache().parsed
        if new := {known_as: module for known_as, module in parsed.items() if known_as not in before}:
            kept = {**before, **new} if len(before) < _MOST else new
            entries = [[*known_as, module.digest, module.names] for known_as, module in kept.items()]
            with suppress(OSError):
                write_text(path, json.dumps(entries))


def _read(path: Path) -> dict[tuple[str, str, str, tuple[str, ...]], fingerprints._Module]:
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))
        return {
            (text, name, package, tuple(without)): fingerprints._Module(digest, tuple(names))
            for text, name, package, without, digest, names in entries
        }
    except (OSError, ValueError, TypeError):
        return {}
