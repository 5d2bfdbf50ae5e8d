"""The published models: their files by SHA-256, of which an installed suite has a few."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import PurePosixPath

from benchmark.code_digest import ROOT

#: Folder of the models that come with the suite.
SHIPPED = ROOT / "learned" / "models"

#: List of the files of all published models, as ``sha256sum`` writes and checks it.
LIST = SHIPPED / "published.sha256"


@cache
def published_files() -> Mapping[str, str]:
    """Return the SHA-256 of each published file by its path ``TRAINING/MODEL/FILE``."""
    lines = LIST.read_text(encoding="utf-8").splitlines()
    pairs = [line.split(maxsplit=1) for line in lines]
    return {path: digest for digest, path in pairs}


def published_models() -> list[str]:
    """Return the names of the published models: ``TRAINING/MODEL``."""
    names = [str(PurePosixPath(path).parent) for path in published_files()]
    return list(dict.fromkeys(names))
