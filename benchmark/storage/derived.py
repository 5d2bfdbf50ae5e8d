"""Files that can be made again from others: they count while they are whole and made by what is there now."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

from benchmark.system.files import write_text


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


def _checksum(text: str, made_by: str) -> str:
    return hashlib.sha256(f"{made_by} {text}".encode()).hexdigest()
