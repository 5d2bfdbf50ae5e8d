"""Join the records of several results folders."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import get_args

from benchmark.commands.selection import RESULTS, as_paths, as_texts
from benchmark.errors import ConfigurationError, check_known
from benchmark.pipeline.cache import writing
from benchmark.pipeline.merging import Choice, Merged, merge_records


def merge(
    folders: str | Path | Iterable[str | Path],
    results: str | Path = RESULTS,
    *,
    take: Choice | None = None,
    records: str | Iterable[str] = (),
) -> Merged:
    """Add the records of other results folders to one.

    See :func:`benchmark.pipeline.merging.merge_records`.

    Parameters
    ----------
    folders
        The other results folders.
    results
        The folder to which their records are added.
    take
        Which of two results of a row that differ is kept: ``"ours"`` or ``"theirs"``; by default
        they are a conflict, and ours stays.
    records
        The conflicts that ``take`` resolves, each by its row or the key of a record; empty for all.

    Raises
    ------
    ConfigurationError
        If a folder holds no records, or a record is in no conflict.
    """
    if take is not None:
        check_known("result to take", [take], get_args(Choice))
    others = as_paths(folders)
    conflicts = as_texts(records)
    if conflicts and not take:
        raise ConfigurationError(
            "--record names a conflict to resolve", "pass --take theirs or ours, too"
        )
    target = Path(results)
    others = [folder for folder in others if folder.resolve() != target.resolve()]
    with writing(target):
        return merge_records(others, target, take, conflicts)
