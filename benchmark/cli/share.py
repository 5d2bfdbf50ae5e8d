"""``merge``, ``submit``, ``verify`` and ``score``: results folders, bundles and external distances."""

from __future__ import annotations

import json
import shlex
import sys
from dataclasses import replace
from pathlib import Path

from benchmark.bundles.outcomes import Outcome, RowOutcome, keep, worst
from benchmark.bundles.packing import write_bundle
from benchmark.bundles.rows import Request
from benchmark.bundles.verification import verify as verify_bundle
from benchmark.cli.options import NOT_OK, OK, USAGE, Merge, Score, Submit, Verify, explained, name_skipped
from benchmark.cli.plan import scores_in_words
from benchmark.cli.selection import recorded
from benchmark.datasets.catalogue import is_known, open_dataset
from benchmark.errors import ConfigurationError
from benchmark.execution.claims import Claims
from benchmark.external.files import read_distances, read_labels, read_ranked
from benchmark.external.records import keep_distances
from benchmark.external.scoring import FORMATS, Task, evaluated
from benchmark.pipeline.storage.merging import job_name, merge_records, publish, records_under
from benchmark.pipeline.storage.store import Store, sweep_leftovers
from benchmark.plugins.registry import methods, variant
from benchmark.report.artefact_reader import ArtefactReader
from benchmark.report.escaping import number
from benchmark.text import clean, say, say_lines

#: Exit codes by the status of a bundle.
EXIT = {"verified": OK, "claimed": NOT_OK, "false": NOT_OK, "unreadable": USAGE}


def merge(options: Merge) -> bool:
    """Merge records, and print those that contradict each other."""
    store = Store.open(options.results)
    is_target = options.results.resolve().__eq__
    stores = [store if is_target(folder.resolve()) else Store(folder / "runs") for folder in options.folders]
    try:
        records = [record for source in stores for record in records_under(source)]
    finally:
        name_skipped(*stores)
    with Claims(store.root) as claims:
        merged = publish(records, store.published) if options.published else merge_records(records, store.records)
        if claims.is_last():
            sweep_leftovers(store)
            if not options.published:
                store.records.gather()
    name_skipped(store)
    for existing, other in merged.conflicts:
        scores = f"{scores_in_words(existing)} here, {scores_in_words(other)} there"
        say(f"conflict: {job_name(existing)} ({existing['key'][:12]}): {scores}")
    say(f"{len(merged.added)} records added, {merged.known} known, {len(merged.conflicts)} conflicts")
    return not merged.conflicts


def submit(options: Submit) -> None:
    """Write a bundle, and print its content and what it omits."""
    path, known = options.path, methods(options.plugins)
    with explained(options.method, "method"):
        spec = variant(options.method, known)
    store = Store.open(options.results)
    records = [result.record for result in recorded(replace(options, methods=(spec.name,)), store)]
    artefacts = ArtefactReader(store, known, options.data_root)
    packed = write_bundle(
        path, records, spec, artefacts, author=options.author, licence=options.licence, with_forms=options.with_forms,
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


def verify(options: Verify) -> None:
    """Print the outcome for a bundle and its records."""
    if known := next(filter(is_known, options.folders), None):
        raise ConfigurationError(f"'{known}' is a set of the suite, which is found by itself", "omit -d")
    own_data = {open_dataset(folder, None).name: Path(folder).resolve() for folder in options.folders}
    request = Request(
        options.bundle, options.results, options.data_root, own_data, options.run, options.again, options.timeout
    )
    outcome = verify_bundle(request, lambda line: say(line, err=True))
    if options.as_json:
        say(json.dumps(outcome.to_plain(), sort_keys=True))
    else:
        for line in _outcome_lines(outcome):
            say(line)
        say(f"{options.bundle}: {outcome.status} (SHA-256 {outcome.digest[:16]}...)")
    if options.into is not None and not keep(outcome, options.into):
        say(f"not stored in {options.into}: the bundle is {outcome.status}", err=True)
    sys.exit(EXIT[outcome.status])


def _outcome_lines(outcome: Outcome) -> list[str]:
    """Return one line for each record and each problem of a bundle."""
    lines = [f"{fault.status:<10}  [{fault.name}] {clean(fault.problem)}; {fault.hint}" for fault in outcome.faults]
    for row in outcome.rows:
        scores = " ".join(f"{name} {number(value)}" for name, value in row.scores.items())
        status = worst((row.status, *(fault.status for fault in outcome.faults)))
        lines.append(f"{status:<10}  {row.gallery} {row.input} {outcome.method}  {scores}  ({_basis(row, outcome)})")
        lines += [f"{'':<10}  [{fault.name}] {clean(fault.problem)}; {fault.hint}" for fault in row.faults]
    return lines


def _basis(row: RowOutcome, outcome: Outcome) -> str:
    recomputed = f"; {len(row.again)} made again, {row.apart:.1g} apart at most" if row.again else ""
    if outcome.with_run and row.status == "verified" and not row.again:
        recomputed = "; none made again: no plugin, or its data is not here"
    compared = {"data": "gallery compared with the data", "records": "gallery compared with records"}
    return f"from {row.holds}; {compared.get(row.compared, 'gallery not compared with anything')}{recomputed}"


def score(options: Score) -> None:
    """Print the measures, and store them as an external row if a folder is given."""
    if options.dataset and options.folder is None:
        raise ConfigurationError("--dataset has no effect without --results", "pass --results DIR, too")
    gallery = read_labels(options.labels)
    matrix = read_ranked(options.distances, gallery) if options.ranked else read_distances(options.distances)
    task = Task.of(matrix, gallery, read_labels(options.query_labels) if options.query_labels else None)
    title = options.title or options.distances.stem
    say_lines(FORMATS[options.format](title, evaluated(task)))
    if options.folder is not None:
        store = Store.open(options.folder)
        dataset = options.dataset or options.labels.resolve().stem
        record = keep_distances(store, task, title, dataset, options.input)
        name_skipped(store)
        chosen = shlex.join(["-d", record["data"]["name"], "--results", str(options.folder)])
        say(f"kept as {record['method']}: 'tables {chosen}' and 'report {chosen}' show it", err=True)
