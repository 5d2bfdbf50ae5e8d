"""Known copies of official sets: a file belongs to one by its content, whatever its name says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

_LISTS = Path(__file__).parent / "copies"


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownCopy:
    """A copy of an official set whose files are known.

    Parameters
    ----------
    title
        What it is, as tables and pages call it.
    files
        The list of its files in the folder ``copies``, as ``sha256sum`` writes and checks it.
    area
        Area in square metres that each of its surfaces is given, because its files hold no size; 0
        if they hold one.
    """

    title: str
    files: str
    area: float = 0.0

    @cached_property
    def digests(self) -> Mapping[str, str]:
        """SHA-256 of each file, by the name of its shape in lower case."""
        lines = (_LISTS / self.files).read_text(encoding="utf-8").splitlines()
        pairs = [line.split(maxsplit=1) for line in lines]
        return {Path(name).stem.lower(): digest for digest, name in pairs}

    def has(self, shape: str, digest: str) -> bool:
        """Return whether a file with this SHA-256 is that of the shape in this copy."""
        return self.digests.get(shape.lower()) == digest
