"""``rekey``: records of older code under the keys of this code; and ``sample``, by which a commit answers it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from benchmark.cli.options import (
    NOT_OK,
    OK,
    PathOption,
    data_root_option,
    name_skipped,
    plugin_option,
)
from benchmark.system.text import brief, say

#: Rows, and changes, that are named one by one.
_MOST_TOLD = 20


@click.command()
@click.option("--from", "commit", required=True, metavar="COMMIT", help="Commit whose code made the records.")
@click.option("--only", multiple=True, metavar="NAME", help="A method, gallery, data set or input; all by default.")
@click.option(
    "--sample", type=click.IntRange(min=3), default=3, show_default=True, metavar="N", help="Shapes of a row."
)
@click.option("--dry-run", is_flag=True, help="Compare, and leave the records as they are.")
@click.option("-j", "--jobs", type=click.IntRange(min=1), metavar="N", help="Processes; all cores by default.")
@click.option("--results", type=PathOption(), metavar="DIR", help="Records made in DIR; else the published ones.")
@plugin_option
@data_root_option
def rekey(
    commit: str,
    only: tuple[str, ...],
    sample: int,
    dry_run: bool,
    jobs: int | None,
    results: Path | None,
    plugins: tuple[Path, ...],
    data_root: Path | None,
) -> None:
    """Show by a sample that older code made the same, and give its records the keys of this code; exit 1 if not all."""
    from benchmark.jobs.rekey.moving import Scope
    from benchmark.jobs.rekey.moving import rekey as moved_by
    from benchmark.storage.store import Store, sweep_leftovers
    from benchmark.threads import available_cores

    store = Store.open(results or Path("results"))
    sweep_leftovers(store)
    scope = Scope(
        store=store,
        records=store.records if results else store.published,
        only=only,
        size=sample,
        data_root=data_root,
        plugins=plugins,
        jobs=jobs or available_cores(),
    )
    found = moved_by(commit, scope, lambda text: say(text, err=True), dry_run=dry_run)
    name_skipped(store)
    for change in found.unreached[:_MOST_TOLD]:
        say(f"not run by any sample: {change.told}")
    if further := len(found.unreached) - _MOST_TOLD:
        say(f"and {further} further places" if further > 0 else "", err=True)
    for candidate in found.refused[:_MOST_TOLD]:
        record = candidate.record
        say(f"stays: {record['gallery']} {record['input']} {record['method']}: {brief(candidate.problem)}")
    if len(found.refused) > _MOST_TOLD:
        say(f"and {len(found.refused) - _MOST_TOLD} further rows stay")
    to_move = len(found.candidates) - found.current - len(found.refused)
    moved = f"{to_move} rows would move" if dry_run else f"{len(found.moved)} rows moved"
    say(
        f"{moved}, {len(found.refused)} stay, {found.current} have the keys of this code; "
        f"{found.reached} functions that differ ran in the samples"
    )
    sys.exit(NOT_OK if found.refused else OK)


@click.command(hidden=True)
@click.argument("request", type=PathOption(), metavar="REQUEST")
@click.argument("answer", type=PathOption(), metavar="ANSWER")
def sample(request: Path, answer: Path) -> None:
    """Answer a request of 'rekey' by the code of this tree."""
    from benchmark.jobs.rekey.sampling import answer as answered

    answered(json.loads(request.read_text(encoding="utf-8")), answer)
