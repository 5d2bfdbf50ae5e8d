"""The published models: their files by SHA-256, of which an installed suite has a few."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import PurePosixPath

from benchmark.api.learning import CARD
from benchmark.code_digest import ROOT

#: Folder of the models that come with the suite.
SHIPPED = ROOT / "learned" / "models"

#: Digits of the digest of a card that records name.
_DIGITS = 16

#: List of the files of all published models, as ``sha256sum`` writes and checks it.
LIST = SHIPPED / "published.sha256"


@cache
def published_files() -> Mapping[str, str]:
    """Return the SHA-256 of each published file by its path ``TRAINING/MODEL/FILE``."""
    lines = LIST.read_text(encoding="utf-8").splitlines()
    pairs = [line.split(maxsplit=1) for line in lines]
    return {path: digest for digest, path in pairs}


@cache
def _published_cards() -> frozenset[str]:
    """Return the first digits of the SHA-256 of the cards of all published models."""
    return frozenset(
        digest[:_DIGITS]
        for path, digest in published_files().items()
        if PurePosixPath(path).name == CARD
    )


def is_published(digest: str) -> bool:
    """Return whether a model is published, by the first digits of the digest of its card."""
    return digest[:_DIGITS] in _published_cards()


def published_models() -> list[str]:
    """Return the names of the published models: ``TRAINING/MODEL``."""
    names = [str(PurePosixPath(path).parent) for path in published_files()]
    return list(dict.fromkeys(names))
