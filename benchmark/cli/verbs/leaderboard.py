"""``leaderboard``: the page of a folder of bundles."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import Any

import click

from benchmark.cli.options import NOT_OK, OK, PathOption, force_option
from benchmark.cli.verbs.verify import known_here, known_options
from benchmark.text import say


@click.command()
@click.argument("bundles", type=PathOption(), metavar="DIR")
@click.option(
    "-o", "--output", type=PathOption(), default=Path("leaderboard"), show_default=True, metavar="DIR",
    help="Folder for the page.",
)  # fmt: skip
@known_options
@force_option
def leaderboard(
    bundles: Path, output: Path, folders: tuple[str, ...], results: Path, data_root: Path | None, **given: Any
) -> None:
    """Verify the bundles of a folder, and write a page of their rows; exit 1 if some cannot be shown."""
    from benchmark.bundles.checking import Request
    from benchmark.bundles.leaderboard import write_leaderboard
    from benchmark.report.html.folder import Folder

    known = known_here(folders, results, data_root)
    request = Request(bundles, known, given["run"], given["again"], given["timeout"])
    found = write_leaderboard(bundles, Folder(output, given["force"]), request, lambda line: say(line, err=True))
    counts = Counter(bundle.outcome.status for bundle in found)
    for bundle in found:
        say(f"{bundle.outcome.status:<10}  {bundle.file}  {bundle.outcome.method}")
    told = ", ".join(f"{counts[status]} {status}" for status in ("verified", "claimed", "false", "unreadable"))
    say(f"wrote {output / 'index.html'}: {told}")
    sys.exit(NOT_OK if counts["false"] or counts["unreadable"] else OK)
