"""The verbs that look after results: ``merge``, ``compare``, ``prune`` and ``why``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from benchmark.cli import completion
from benchmark.cli.options import (
    NOT_OK,
    OK,
    SELECTION,
    PathOption,
    RunOptions,
    add_options,
    name_skipped,
)
from benchmark.errors import ConfigurationError
from benchmark.text import brief, clean, say, say_lines

if TYPE_CHECKING:
    from benchmark.execution.job_specs import Job
    from benchmark.pipeline.storage.records import Record
    from benchmark.plugins.scorers import ScorerSpec

#: Characters of a key that name a job, and those more that tell apart some that begin alike.
_SHORTEST_KEY, _FURTHER = 6, 6


@click.command()
@click.argument("folders", nargs=-1, required=True, type=PathOption(), metavar="DIR...")
@click.option("--published", is_flag=True, help="Merge into RESULTS/records, without quick runs and own data.")
@add_options("results")
def merge(folders: tuple[Path, ...], published: bool, results: Path) -> None:
    """Join the records of several results folders; exit 1 if they contradict each other.

    Writes one file per data set and one line per record, unless a run is writing records there.
    """
    from benchmark.execution.claims import Claims
    from benchmark.pipeline.storage.merging import merge_records, publish, records_under, told
    from benchmark.pipeline.storage.store import Store, sweep_leftovers

    store = Store.open(results)
    is_target = results.resolve().__eq__
    stores = [store if is_target(folder.resolve()) else Store(folder / "runs") for folder in folders]
    try:
        found = [record for source in stores for record in records_under(source)]
    finally:
        name_skipped(*stores)
    sweep_leftovers(store)
    with Claims.of(store) as claims:
        merged = publish(found, store.published) if published else merge_records(found, store.records)
        if not published and claims.is_last():
            store.records.gather()
    name_skipped(store)
    for there, other in merged.conflicts:
        say(f"conflict: {told(there)} ({there['key'][:12]}): {_scores(there)} here, {_scores(other)} there")
    say(f"{len(merged.added)} records added, {merged.known} known, {len(merged.conflicts)} conflicts")
    sys.exit(NOT_OK if merged.conflicts else OK)


@click.command()
@click.argument("first", metavar="A")
@click.argument("second", metavar="B")
@add_options("datasets", "inputs", "scorer")
@click.option("--all", "everything", is_flag=True, help="Compare every pair, with perturbed sets, intervals and tests.")
@add_options("plugins", "published", "results")
def compare(first: str, second: str, everything: bool, **given: Any) -> None:
    """Compare two methods, two results folders, or two scorers.

    For two scorers, print Kendall's tau between their orders of the methods, for each table and measure.
    """
    from benchmark.pipeline.storage.merging import records_under
    from benchmark.pipeline.storage.store import Store
    from benchmark.plugins.registry import methods, variant
    from benchmark.plugins.scorers import scorer_of, scorers
    from benchmark.report.comparison import compare_folders, compare_methods, lines

    options = RunOptions.of(given)
    known_scorers = scorers(options.plugins)
    are_scorers = {first.partition("[")[0], second.partition("[")[0]} <= known_scorers.keys()
    if are_scorers:
        _compare_scorers(scorer_of(first, known_scorers), scorer_of(second, known_scorers), options)
        return
    are_folders = Path(first).is_dir() and Path(second).is_dir()
    folders = (Path(first), Path(second)) if are_folders else (options.results,)
    stores = [Store(folder / "runs", published_only=options.published) for folder in folders]
    try:
        records = [records_under(store) for store in stores]
    finally:
        name_skipped(*stores)
    records = [[record for record in found if options.allows(record)] for found in records]
    if are_folders:
        found = compare_folders(*records)
    else:
        known = methods(options.plugins)
        recorded = {record["method"] for record in records[0]}
        one, other = (name if name in recorded else variant(name, known).name for name in (first, second))
        found = compare_methods(records[0], one, other, scorer_of(options.scorer, known_scorers).name)
        if not found.differences:
            raise ConfigurationError(f"no gallery has scores of both {first} and {second}", "run both on one data set")
    for line in lines(found, first, second, everything=everything):
        say(line)


def _compare_scorers(first: ScorerSpec, second: ScorerSpec, options: RunOptions) -> None:
    from benchmark.pipeline.storage.store import Store
    from benchmark.report.statistics.agreement import agreements, markdown

    store = Store.open(options.results, published_only=options.published)
    found = options.results_of(store)
    rows = agreements(
        *(
            [each for each in found.all(scorer=name) if options.allows(each.record)]
            for name in (first.name, second.name)
        )
    )
    name_skipped(store)
    if not rows:
        raise ConfigurationError(
            f"no table has scores of three methods by both {first.name} and {second.name}",
            f"run them: run -t TABLE --scorer {second.name}",
        )
    say_lines(markdown(rows, first.name, second.name))


@click.command()
@click.option("--dry-run", is_flag=True, help="Only say what would be deleted.")
@add_options("results")
def prune(dry_run: bool, results: Path) -> None:
    """Delete data that no record needs, and remains of killed processes."""
    from benchmark.execution.claims import Claims
    from benchmark.pipeline.storage.store import Store, remove, unneeded

    store = Store.open(results)
    with Claims.of(store) as claims:
        if not (dry_run or claims.is_last()):
            raise ConfigurationError(f"a run in {results} is using these files", "wait until it has ended")
        paths = list(unneeded(store))
        size = sum(path.stat().st_size for path in paths) if dry_run else remove(paths)
    name_skipped(store)
    say(f"{'would free' if dry_run else 'freed'} {size / 2**20:.1f} MiB in {len(paths)} files")


@click.command()
@click.argument("target", metavar="METHOD|KEY", shell_complete=completion.methods)
@add_options(*SELECTION)
@click.option("--all", "everything", is_flag=True, help="Explain each job in full.")
def why(target: str, everything: bool, **options: Any) -> None:
    """Explain a job: state, reason, versions, cost, failure.

    Several jobs get one line each, unless --all is given.
    """
    from benchmark.pipeline.storage.keys import bare_key
    from benchmark.pipeline.storage.store import Store

    selection = RunOptions.of(options)
    store = Store.open(selection.results)
    is_key = len(target) >= _SHORTEST_KEY and set(target) <= set("0123456789abcdef")
    if is_key:
        found = {
            record["key"]: record
            for records in (store.published, store.records)
            for record in records
            if bare_key(record["key"]).startswith(target)
        }
        name_skipped(store)
        if len(found) > 1:
            keys = ", ".join(bare_key(key)[: len(target) + _FURTHER] for key in found)
            raise ConfigurationError(
                f"{len(found)} jobs have keys that begin with {target}: {keys}", "write more of it"
            )
        if found:
            _explain_record(*found.values())
            return
    jobs = RunOptions.of(options | {"methods": (target,)}).jobs(store)
    made = [store.records.read(job.key) or store.published.read(job.key) for job in jobs]
    if everything or len(jobs) == 1:
        for job, record in zip(jobs, made, strict=True):
            _explain_job(job, record)
        return
    width = max(len(clean(job.name)) for job in jobs)
    for job, record in zip(jobs, made, strict=True):
        scores = _scores(record) if record is not None else ""
        short = bare_key(job.key)[:12]
        say(f"{short or 'none':<12}  {job.state:<11}  {clean(job.name):<{width}}  {scores or brief(job.reason)}")
    say(f"{len(jobs)} jobs: 'why KEY' explains one; select with -t, -d and --input, or explain all with --all")


def _explain_job(job: Job, record: Record | None) -> None:
    say(f"{job.state:<11}  {job.name}  {job.reason}")
    say(f"  key         {job.key or 'none'}")
    if record is not None:
        _explain_record(record, title=False)


def _explain_record(record: Record, *, title: bool = True) -> None:
    from benchmark.pipeline.storage.environment import in_words
    from benchmark.pipeline.storage.merging import told

    facts: list[tuple[str, str]] = [("status", f"{record['status']} {_scores(record)}".strip())]
    if reason := record.get("reason"):
        facts.append(("reason", reason))
    facts += [("finished", str(record.get("finished", ""))), ("parameters", _plain(record["recipe"].get("parameters")))]
    if scorer := record.get("scorer"):
        facts.append(("scorer", scorer))
    if cost := record.get("cost"):
        phases = ", ".join(f"{name} {seconds:.3f}" for name, seconds in cost["seconds_per_shape"].items())
        facts.append(("seconds", f"{phases} (median of a shape)"))
        if record.get("peak_mib") is not None:
            facts.append(("memory", f"{record['peak_mib']} MiB above the process at rest"))
    for made in record.get("environments", ()):
        count = f"{made['artefacts']} artefacts: " if "artefacts" in made else ""
        facts.append(("made with", count + in_words(made.get("environment", made))))
    if digests := record.get("digests"):
        facts.append(("digests", _plain(digests)))
    for shape, said in record.get("unsupported", ())[:10]:
        facts.append(("unsupported", f"{shape}: {said}"))
    for part in ("models", "versions", "plugin"):
        if part in record["recipe"]:
            facts.append((part, _plain(record["recipe"][part])))
    if title:
        say(told(record))
        say(f"  key         {record['key']}")
    for name, text in facts:
        say(f"  {name:<10}  {text}")
    if trace := record.get("traceback"):
        say_lines("  " + trace.rstrip().replace("\n", "\n  "))


def _scores(record: Record) -> str:
    from benchmark.report.rounding import number
    from retrieval.measures import PRINTED

    scores = record.get("scores")
    return " ".join(f"{name} {number(scores[name], 3)}" for name in PRINTED) if scores else ""


def _plain(values: dict[str, Any] | None) -> str:
    return ", ".join(f"{name} {value}" for name, value in (values or {}).items()) or "none"
