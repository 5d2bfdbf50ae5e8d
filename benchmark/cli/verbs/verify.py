"""``verify``: what of a bundle can be shown to be so."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from benchmark.cli.options import (
    NOT_OK,
    OK,
    USAGE,
    NameOrFolder,
    PathOption,
    add_options,
    timeout_option,
)
from benchmark.errors import ConfigurationError
from benchmark.text import clean, say

if TYPE_CHECKING:
    from benchmark.bundles.known import Known
    from benchmark.bundles.outcome import Outcome, RowOutcome

#: Exit code by what a bundle is.
EXIT = {"verified": OK, "claimed": NOT_OK, "false": NOT_OK, "unreadable": USAGE}


def _known_here(folders: tuple[str, ...], results: Path, data_root: Path | None) -> Known:
    """Return what bundles are compared with; raises ``ConfigurationError`` for what is no folder of meshes."""
    from benchmark.bundles.known import Known
    from benchmark.datasets.catalogue import is_known, open_dataset

    for folder in folders:
        if is_known(folder):
            raise ConfigurationError(f"'{folder}' is a known set", "leave -d out: it is found by itself")
    return Known(results, data_root, {open_dataset(folder, None).name: Path(folder).resolve() for folder in folders})


# fmt: off
@click.command()
@click.argument("bundle", type=PathOption(), metavar="BUNDLE.zip")
@click.option("-d", "--dataset", "folders", multiple=True, type=NameOrFolder(), metavar="FOLDER",
              help="Folder of the meshes that it was run on.")
@add_options("results", "data_root")
@click.option("--run", is_flag=True, help="Run the author's plugin with your rights, to make forms again.")
@click.option("--again", type=click.IntRange(min=3), default=3, show_default=True, metavar="N",
              help="Number of forms per record to make again.")
@timeout_option("each step")
@click.option("--into", type=PathOption(), metavar="DIR", help="Results folder whose reports show its rows.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def verify(
    bundle: Path, folders: tuple[str, ...], results: Path, data_root: Path | None, run: bool, again: int,
    timeout: float, into: Path | None, as_json: bool,
) -> None:
    # fmt: on
    """Compute the scores of a bundle again; none of its code runs without --run.

    Exit 0 if everything is verified, 1 if something is claimed or false, 2 if it cannot be read.
    """
    from benchmark.bundles.board import keep
    from benchmark.bundles.checking import Request, verify

    request = Request(bundle, _known_here(folders, results, data_root), run, again, timeout)
    outcome = verify(request, lambda line: say(line, err=True))
    if as_json:
        say(json.dumps(outcome.to_plain(), sort_keys=True))
    else:
        for line in lines(outcome):
            say(line)
        say(f"{bundle}: {outcome.status} (SHA-256 {outcome.digest[:16]}...)")
    if into is not None:
        keep(outcome, into)
    sys.exit(EXIT[outcome.status])


def lines(outcome: Outcome) -> list[str]:
    """Return a line for each record of a bundle, and one for each fault."""
    from benchmark.bundles.outcome import worst
    from benchmark.report.rounding import number

    found = [f"{fault.status:<10}  [{fault.name}] {clean(fault.problem)}; {fault.hint}" for fault in outcome.faults]
    for row in outcome.rows:
        scores = " ".join(f"{name} {number(value)}" for name, value in row.scores.items())
        status = worst((row.status, *(fault.status for fault in outcome.faults)))
        found.append(f"{status:<10}  {row.gallery} {row.input} {outcome.method}  {scores}  ({_told(row, outcome)})")
        found += [f"{'':<10}  [{fault.name}] {clean(fault.problem)}; {fault.hint}" for fault in row.faults]
    return found


def _told(row: RowOutcome, outcome: Outcome) -> str:
    again = f"; {len(row.again)} made again, {row.apart:.1g} apart at most" if row.again else ""
    if outcome.with_run and row.status == "verified" and not row.again:
        again = "; none made again: no plug-in, or its data is not here"
    compared = {"data": "gallery compared with the data", "records": "gallery compared with records"}
    return f"from {row.holds}; {compared.get(row.compared, 'gallery as it is told')}{again}"
