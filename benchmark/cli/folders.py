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
    """Join results folders; return whether there was no conflict, and every record was taken."""
    merged = merge(folders, results, take=take, records=rows)
    for existing, other in merged.conflicts:
        say(f"conflict: {existing.row}: {outcome(existing)} here, {outcome(other)} there")
        command = _command_that_takes(existing, other, results)
        say(f"the one here stays; to take the other: python -m benchmark {command}")
    for refused in merged.refused:
        say(f"not taken: {refused.record.row}: {refused.reason}")
    n_lost = len(merged.refused) + merged.n_skipped
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


def print_forgotten(selection: Selection, named: Sequence[str], *, unused: bool, yes: bool) -> None:
    """Delete results and unused files, or only name them."""
    forgotten = forget(
        selection.methods,
        selection.data,
        records=named,
        unused=unused,
        results=selection.results,
        yes=yes,
    )
    for record in forgotten.records:
        say(f"{record.row}  {outcome(record)}")
    if not yes:
        raise ConfigurationError(f"this deletes {forgotten}", "pass --yes")
    say(f"deleted {forgotten}")
