"""Results folders and bundles: ``merge``, ``prune``, ``submit`` and ``verify``."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import click

from benchmark.bundles.outcomes import Outcome, RowOutcome, keep, worst
from benchmark.bundles.packing import write_bundle
from benchmark.bundles.rows import Request
from benchmark.bundles.verification import verify as verify_bundle
from benchmark.cli.declare import METHOD, NAME_OR_FOLDER, PATH, argument, flag, option, timeout_option
from benchmark.cli.options import NOT_OK, OK, USAGE, RunOptions, explained, name_skipped, shared, verb
from benchmark.cli.plan import scores_in_words
from benchmark.cli.selection import recorded
from benchmark.datasets.catalogue import is_known, open_dataset
from benchmark.errors import ConfigurationError
from benchmark.execution.claims import Claims
from benchmark.pipeline.storage.merging import merge_records, publish, records_under, told
from benchmark.pipeline.storage.store import Store, remove, sweep_leftovers, unneeded
from benchmark.plugins.registry import methods, variant
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.rounding import number
from benchmark.text import clean, say

#: Exit code by what a bundle is.
EXIT = {"verified": OK, "claimed": NOT_OK, "false": NOT_OK, "unreadable": USAGE}


@verb
def merge(
    folders: tuple[Path, ...] = argument("DIR...", nargs=-1, required=True, type=PATH),
    published: bool = flag("--published", help="Merge into RESULTS/records, without quick runs and own data."),
    results: Path = shared("results"),
) -> bool:
    """Join the records of several results folders; exit 1 if they contradict each other.

    Writes one file per data set and one line per record, unless a run is writing records there.
    """
    store = Store.open(results)
    is_target = results.resolve().__eq__
    stores = [store if is_target(folder.resolve()) else Store(folder / "runs") for folder in folders]
    try:
        records = [record for source in stores for record in records_under(source)]
    finally:
        name_skipped(*stores)
    sweep_leftovers(store)
    with Claims.of(store) as claims:
        merged = publish(records, store.published) if published else merge_records(records, store.records)
        if not published and claims.is_last():
            store.records.gather()
    name_skipped(store)
    for there, other in merged.conflicts:
        scores = f"{scores_in_words(there)} here, {scores_in_words(other)} there"
        say(f"conflict: {told(there)} ({there['key'][:12]}): {scores}")
    say(f"{len(merged.added)} records added, {merged.known} known, {len(merged.conflicts)} conflicts")
    return not merged.conflicts


@verb
def prune(
    dry_run: bool = flag("--dry-run", help="Only say what would be deleted."), results: Path = shared("results")
) -> None:
    """Delete data that no record needs, and remains of killed processes."""
    store = Store.open(results)
    with Claims.of(store) as claims:
        if not (dry_run or claims.is_last()):
            raise ConfigurationError(f"a run in {results} is using these files", "wait for it to end")
        paths = list(unneeded(store))
        size = sum(path.stat().st_size for path in paths) if dry_run else remove(paths)
    name_skipped(store)
    say(f"{'would free' if dry_run else 'freed'} {size / 2**20:.1f} MiB in {len(paths)} files")


@verb
def submit(
    method: str = METHOD,
    path: Path = option("-o", "--output", required=True, type=PATH, metavar="BUNDLE.zip", help="File to write."),
    options: RunOptions = shared("datasets", "inputs", "scorer", "plugins", "results", "data_root"),
    seed: int = option("--seed", type=int, default=0, help="Base seed of the runs."),
    quick: bool = flag("--quick", help="Take the results of --quick."),
    author: str = option("--author", default="", metavar="NAME", help="Author of the row."),
    licence: str = option(
        "--licence", default="", metavar="NAME", help="Licence, such as MIT. [the source's SPDX line]"
    ),
    with_forms: bool = flag("--forms", help="Include the forms of your own data."),
) -> None:
    """Write the finished jobs of a method into a bundle that anyone can verify."""
    known = methods(options.plugins)
    with explained(method, "method"):
        spec = variant(method, known)
    store = Store.open(options.results)
    records = [result.record for result in recorded(replace(options, methods=(spec.name,)), store)]
    artefacts = ArtefactReader(store, known, options.data_root)
    packed = write_bundle(
        path, records, spec, artefacts, author=author, licence=licence, with_forms=with_forms,
        say=lambda line: say(line, err=True),
    )  # fmt: skip
    for line in packed.omitted:
        say(f"omitted {line}", err=True)
    for name, entry in packed.entries.items():
        say(f"{name}: {entry.holds}{f' and distances alone; {entry.withheld}' if entry.withheld else ''}")
    if any("nobody has said" in entry.withheld for entry in packed.entries.values()):
        say("pass --forms if results of your own data may be shared", err=True)
    if not packed.licence:
        say("without a licence nobody else may use the source; pass --licence", err=True)
    say(f"{path}: {path.stat().st_size / 2**20:.1f} MiB; 'verify {path}' shows what it proves")


@verb
def verify(
    bundle: Path = argument("BUNDLE.zip", type=PATH),
    folders: tuple[str, ...] = option(
        "-d", "--dataset", multiple=True, type=NAME_OR_FOLDER, metavar="FOLDER",
        help="Folder of the meshes that it was run on.",
    ),
    results: Path = shared("results"),
    data_root: Path | None = shared("data_root"),
    run: bool = flag("--run", help="Run the author's plugin with your rights, to make forms again."),
    again: int = option(
        "--again", type=click.IntRange(min=3), default=3, metavar="N", help="Number of forms per record to make again."
    ),
    timeout: float = timeout_option("each step"),
    into: Path | None = option("--into", type=PATH, metavar="DIR", help="Results folder whose reports show its rows."),
    as_json: bool = flag("--json", help="Print JSON."),
) -> None:  # fmt: skip
    """Compute the scores of a bundle again; none of its code runs without --run.

    Exit 0 if everything is verified, 1 if something is claimed or false, 2 if it cannot be read.
    """
    if known := next(filter(is_known, folders), None):
        raise ConfigurationError(f"'{known}' is a set of the suite, which is found by itself", "omit -d")
    own_data = {open_dataset(folder, None).name: Path(folder).resolve() for folder in folders}
    request = Request(bundle, results, data_root, own_data, run, again, timeout)
    outcome = verify_bundle(request, lambda line: say(line, err=True))
    if as_json:
        say(json.dumps(outcome.to_plain(), sort_keys=True))
    else:
        for line in _outcome_lines(outcome):
            say(line)
        say(f"{bundle}: {outcome.status} (SHA-256 {outcome.digest[:16]}...)")
    if into is not None:
        keep(outcome, into)
    sys.exit(EXIT[outcome.status])


def _outcome_lines(outcome: Outcome) -> list[str]:
    """Return a line for each record of a bundle, and one for each fault."""
    lines = [f"{fault.status:<10}  [{fault.name}] {clean(fault.problem)}; {fault.hint}" for fault in outcome.faults]
    for row in outcome.rows:
        scores = " ".join(f"{name} {number(value)}" for name, value in row.scores.items())
        status = worst((row.status, *(fault.status for fault in outcome.faults)))
        lines.append(f"{status:<10}  {row.gallery} {row.input} {outcome.method}  {scores}  ({_basis(row, outcome)})")
        lines += [f"{'':<10}  [{fault.name}] {clean(fault.problem)}; {fault.hint}" for fault in row.faults]
    return lines


def _basis(row: RowOutcome, outcome: Outcome) -> str:
    again = f"; {len(row.again)} made again, {row.apart:.1g} apart at most" if row.again else ""
    if outcome.with_run and row.status == "verified" and not row.again:
        again = "; none made again: no plugin, or its data is not here"
    compared = {"data": "gallery compared with the data", "records": "gallery compared with records"}
    return f"from {row.holds}; {compared.get(row.compared, 'gallery not compared with anything')}{again}"
