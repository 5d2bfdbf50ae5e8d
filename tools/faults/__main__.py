"""``python -m tools.faults``: try all faults, or some, and report; exit code 1 if a border was crossed."""

from __future__ import annotations

import signal
import sys
import time
from fnmatch import fnmatch
from typing import NoReturn

import click

from benchmark.threads import pin_threads
from tools.faults.cases import Outcome
from tools.faults.program import run
from tools.faults.report import report
from tools.faults.sections import SECTIONS, all_cases


@click.command()
@click.option("--seed", type=int, default=0, show_default=True, help="Determines all that is drawn.")
@click.option("--seconds", type=click.FloatRange(min=1), help="No further case begins after this time.")
@click.option("--kills", type=click.IntRange(min=1), default=200, show_default=True, help="Kills to try at least.")
@click.option("--only", "patterns", multiple=True, metavar="NAME", help="A case, a section, or a pattern with *.")
@click.option("--workers", type=click.IntRange(1, 2), default=1, show_default=True, help="Cases at a time.")
@click.option("--list", "names_only", is_flag=True, help="Print the names of the cases.")
def main(
    seed: int,
    seconds: float | None,
    kills: int,
    patterns: tuple[str, ...],
    workers: int,
    names_only: bool,
) -> None:
    """Try the suite with faults of every kind, and report what they cost."""
    pin_threads()
    signal.signal(signal.SIGTERM, _interrupt)
    begun = time.monotonic()
    cases = [
        case
        for case in all_cases(kills, seed, shuffled=seconds is not None)
        if not patterns or any(fnmatch(case.name, pattern) or case.section == pattern for pattern in patterns)
    ]
    if not cases:
        raise click.UsageError(f"no such case; choose from {', '.join(SECTIONS)}, or see --list")
    if names_only:
        click.echo("\n".join(case.name for case in cases))
        return

    def tell(outcome: Outcome) -> None:
        said = ", ".join(crossing.border.name.lower() for crossing in outcome.crossings) or "ok"
        click.echo(f"{outcome.seconds:6.1f} s  {outcome.name:<32}  {said}", err=True)
        for crossing in outcome.crossings:
            click.echo(f"          {crossing.said}", err=True)

    outcomes = run(cases, seed, seconds=seconds, workers=workers, tell=tell)
    click.echo(report(outcomes, seed, time.monotonic() - begun), nl=False)
    sys.exit(any(outcome.crossings for outcome in outcomes))


def _interrupt(*_: object) -> NoReturn:
    """Report what was tried, and leave nothing behind, however often it is asked."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise KeyboardInterrupt


main()
