"""``plan``: list the jobs of a run."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence

from benchmark.cli.options import EVERY, Selection, name_skipped, name_unusable
from benchmark.datasets.catalogue import sources
from benchmark.datasets.own import own_sets
from benchmark.errors import ConfigurationError
from benchmark.execution.estimates import estimate
from benchmark.execution.job_specs import Job
from benchmark.execution.plan import make_plan
from benchmark.machine import available_cores
from benchmark.pipeline.storage.records import Record
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import methods, select
from benchmark.plugins.scorers import scorer_of, scorers
from benchmark.plugins.specs import ScorerSpec
from benchmark.protocols.galleries import galleries
from benchmark.protocols.tables import INPUTS, TABLES
from benchmark.reference import paper
from benchmark.report.escaping import number
from benchmark.text import brief, clean, say, say_lines
from retrieval.measures import PRINTED

#: Most jobs that are listed one by one.
_SCREEN = 40

#: Number of reasons in a summary.
_REASONS = 5


def scorer_spec(options: Selection) -> ScorerSpec:
    """Return the scorer with a name; raise ``ConfigurationError`` if there is none."""
    return scorer_of(options.scorer, scorers(options.plugins))


def planned_jobs(options: Selection, store: Store, retry: tuple[str, ...] = ()) -> list[Job]:
    """Plan a run; without tables and data sets, plan those of the plugin files."""
    specs = select(options.methods, methods(options.plugins), options.plugins)
    if not options.methods or EVERY in options.methods:
        name_unusable()
    data_root = options.require_data_root()
    named = bool(options.datasets or options.tables or options.everything)
    datasets = sources(options.datasets if named else tuple(own_sets(options.plugins)), options.plugins)
    chosen = galleries(options.tables, datasets, data_root, options.quick)
    for gallery in chosen:
        if options.input:
            gallery.check_input(options.input)
    inputs = (options.input,) if options.input else INPUTS
    scorer = scorer_spec(options)
    jobs = make_plan(chosen, inputs, specs, store, seed=options.seed, retry=retry, scorer=scorer)
    name_skipped(store)
    if not jobs:
        raise ConfigurationError("no selected method belongs to a selected table", "drop -m, -t or --input")
    if options.paper:
        jobs = _of_paper(jobs)
    return jobs


def _of_paper(jobs: list[Job]) -> list[Job]:
    from benchmark.report.content import row_of

    tables = {table.identifier: table for table in TABLES}
    printed = [
        job for job in jobs if job.table in tables and row_of(tables[job.table], job.facts) in paper.rows(job.table)
    ]
    if not printed:
        raise ConfigurationError(
            "no row of the paper is selected", "drop --paper, or choose from Tables I to IV and their methods"
        )
    return printed


def plan(options: Selection, *, traceback: bool = False) -> None:
    """Print the jobs and an estimate of the run time."""
    store = Store.open(options.results)
    jobs = planned_jobs(options, store)
    n_to_run = sum(job.to_run for job in jobs)
    lines = _job_lines(jobs) if len(jobs) <= _SCREEN else _gallery_lines(jobs)
    for line in [*lines, *estimate(jobs, store).lines(n_to_run, available_cores())]:
        say(line)
    say(f"{n_to_run} of {len(jobs)} jobs to run")
    if traceback:
        _print_tracebacks(jobs, store)


def _job_lines(jobs: Sequence[Job]) -> list[str]:
    width = max((len(clean(job.name)) for job in jobs), default=0)
    return [f"{job.state:<11}  {clean(job.name):<{width}}  {brief(job.reason)}" for job in jobs]


def _gallery_lines(jobs: Sequence[Job]) -> list[str]:
    """Count the jobs of each table and input by state."""
    states: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for job in jobs:
        states[clean(f"{job.table} {job.input}")][job.state] += 1
    width = max(map(len, states))
    lines = [
        f"{name:<{width}}  {', '.join(f'{count} {state}' for state, count in counts.most_common())}"
        for name, counts in states.items()
    ]
    reasons = Counter(f"{job.state}: {brief(job.reason)}" for job in jobs if job.to_run or job.state == "failed")
    lines += [f"{count} {reason}" for reason, count in reasons.most_common(_REASONS)]
    return [*lines, "select fewer with -t, -d, -m and --input to see each job with its reason"]


def _print_tracebacks(jobs: Sequence[Job], store: Store) -> None:
    for job in jobs:
        record = store.records.read(job.key) or store.published.read(job.key) or {}
        if trace := record.get("traceback"):
            say(f"{job.name}: {job.reason}")
            say_lines("  " + trace.rstrip().replace("\n", "\n  "))


def scores_in_words(record: Record, decimals: int = 3) -> str:
    """Return the scores of a record on one line, or ""."""
    scores = record.get("scores")
    return " ".join(f"{name} {number(scores[name], decimals)}" for name in PRINTED) if scores else ""
