"""``merge`` and ``forget``: join results folders, and delete what is in one."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from benchmark.cli.options import Selection
from benchmark.commands.forget import forget
from benchmark.commands.merge import merge
from benchmark.commands.selection import outcome
from benchmark.errors import ConfigurationError
from benchmark.pipeline.records import Record
from benchmark.text import say


def print_merge(
    folders: Sequence[Path],
    results: Path,
    take: Literal["ours", "theirs"] | None,
    rows: Sequence[str],
) -> bool:
    """Add results folders to another one, and print which records were not simply added.

    Parameters
    ----------
    folders
        The folders that are added.
    results
        The folder to which they are added.
    take
        Which of two results that differ is kept; by default they are a conflict, and ours stays.
    rows
        Rows, or keys of records, whose conflicts ``take`` resolves; empty for all.

    Returns
    -------
    bool
        Whether there was no conflict, and every record was taken.
    """
    merged = merge(folders, results, take=take, records=rows)
    for existing, other in merged.conflicts:
        say(f"conflict: {existing.row}: {outcome(existing)} here, {outcome(other)} there")
        command = _command_that_takes(existing, other, results)
        say(f"the one here stays; to take the other: python -m benchmark {command}")
    for refused in merged.refused:
        say(f"not taken: {refused.record.row}: {refused.reason}")
    n_lost = len(merged.refused) + merged.n_skipped  # skipped: files that cannot be read
    counts = [
        f"{len(merged.added)} added",
        f"{merged.known} known",
        f"{len(merged.conflicts)} in conflict",
    ]
    if n_lost:
        counts.append(f"{n_lost} not taken")
    say(f"records: {', '.join(counts)}")
    return not (merged.conflicts or n_lost)


def _command_that_takes(existing: Record, other: Record, results: Path) -> str:
    """Return the words that resolve a conflict in favour of the other record."""
    folder = other.merged_from.folder if other.merged_from else "DIR"
    words = ["merge", folder, "--take", "theirs", "--record", str(existing.row)]
    if results != Selection().results:
        words += ["--results", str(results)]
    return shlex.join(words)


def delete_results(
    selection: Selection, records: Sequence[str], *, unused: bool, is_confirmed: bool
) -> None:
    """Delete stored results, and print which; without confirmation, only print which.

    Parameters
    ----------
    selection
        Methods and data sets whose results are deleted, and the results folder.
    records
        Rows or keys of single records that are deleted.
    unused
        Whether only files are deleted that no record names.
    is_confirmed
        Whether the user has confirmed the command.

    Raises
    ------
    ConfigurationError
        If the user has not: a command that deletes nothing has to end with an error.
    """
    forgotten = forget(
        selection.methods,
        selection.data,
        records=records,
        unused=unused,
        results=selection.results,
        yes=is_confirmed,
    )
    for record in forgotten.records:
        say(f"{record.row}  {outcome(record)}")
    if not is_confirmed:
        raise ConfigurationError(f"this deletes {forgotten}", "pass --yes")
    say(f"deleted {forgotten}")
