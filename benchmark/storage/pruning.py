"""Removal of artefacts that no record needs, and of what killed processes left behind."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from benchmark.storage.records import by_place
from benchmark.storage.store import Store
from benchmark.system.files import is_alive, leftovers


def unneeded(store: Store) -> Iterator[Path]:
    """Files that can be removed: the newest record of each place keeps what it was made from, all else may go.

    The artefacts of a job that was stopped are among them; it would begin anew.
    """
    newest = (records[-1] for records in by_place(store.records).values())
    needed = {key for record in newest for key in record.get("artefacts", ())}
    yield from (path for path in store.artefact_files() if path.stem not in needed)
    yield from store.scratch.glob("*/*.npz")
    yield from (path for path in (store.root / "rekey").rglob("*") if path.is_file())
    yield from _leftovers(store)


def sweep_leftovers(store: Store) -> None:
    """Remove what killed processes left behind: half-written files, and notes on progress that nobody reads."""
    remove(list(_leftovers(store)))


def remove(paths: Iterable[Path]) -> int:
    """Remove files; returns the bytes that were freed."""
    freed = 0
    for path in paths:
        with suppress(OSError):
            size = path.stat().st_size
            path.unlink()
            freed += size
    return freed


def _leftovers(store: Store) -> Iterator[Path]:
    yield from leftovers(store.root)
    yield from leftovers(store.published.folder)
    yield from (path for path in store.progress.iterdir() if not _is_watched(path))


def _is_watched(path: Path) -> bool:
    """Return whether the harness that looks at a progress file is alive."""
    harness = path.name.partition("-")[0]
    return harness.isdecimal() and is_alive(int(harness))
