"""``run`` and ``plan``: what of a selection is missing, and making it."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from benchmark.cli.options import (
    NOT_OK,
    OK,
    Selection,
    name_skipped,
    repeat_option,
    selection_options,
    shard_option,
    timeout_option,
)
from benchmark.errors import ConfigurationError
from benchmark.system.text import brief, clean, say, say_lines

if TYPE_CHECKING:
    from benchmark.jobs.cluster.sharding import Shard
    from benchmark.jobs.plan import Job

#: What tells the place of a record.
_PLACE = ("gallery", "input", "method")

RETRY = ("failed", "timeout", "crashed", "killed", "memory", "unsupported", "all")


@click.command()
@click.option("--all", "everything", is_flag=True, help="All tables, methods and inputs.")
@selection_options
@repeat_option
@click.option("-j", "--jobs", type=click.IntRange(min=1), metavar="N", help="Jobs at a time; all cores by default.")
@click.option("--executor", type=click.Choice(["serial", "processes", "dask"]), default="processes", show_default=True)
@click.option("--scheduler", default="", metavar="URL", help="Scheduler of a dask cluster, such as tcp://HOST:8786.")
@timeout_option("one job", "2h")
@click.option("--retry", multiple=True, type=click.Choice(RETRY), help="Run failures of this kind again.")
@shard_option
def run(
    everything: bool,
    jobs: int | None,
    executor: str,
    scheduler: str,
    timeout: float,
    retry: tuple[str, ...],
    shard: Shard | None,
    **options: Any,
) -> None:
    """Run what is missing of a selection, then print its tables."""
    from benchmark.storage.store import Store

    selection = Selection.of(options | {"retry": frozenset(retry), "everything": everything})
    if not everything and not (selection.tables or selection.methods or selection.datasets or selection.plugins):
        raise ConfigurationError("nothing is selected", "pass --all, or choose with -t, -d or -m")
    store = Store.open(selection.results)
    plan = _part(selection.jobs(store), shard)

    # What runs need takes a second to import: a name that is not known is told before.
    from benchmark.cli.terminal import draw
    from benchmark.jobs.run_plan import run_plan
    from benchmark.report.content import contents
    from benchmark.report.formats import markdown
    from benchmark.report.robustness import markdown as robustness_markdown
    from benchmark.report.robustness import robustness

    unnamed = not selection.is_narrow
    ok = run_plan(plan, store, selection, executor, jobs, timeout, scheduler, as_far_as_possible=unnamed)
    results = selection.results_of(store).all(selection.seed, scorer=selection.scorer_spec().name)
    name_skipped(store)
    found = {key: r for r in results for key in (r.record["key"], tuple(r.record[part] for part in _PLACE))}
    # A finished job of the same shapes, in a folder of another name, is that of the plan.
    shown = [
        replace(result, record=result.record | job.facts)
        for job in plan
        if (result := found.get(job.key) or found.get((job.gallery.name, job.input, job.method.name)))
    ]
    chosen = {job.gallery.table.identifier for job in plan}
    made = contents(shown, chosen, blanks=not selection.is_narrow, named=selection.is_by_name)
    if sys.stdout.isatty():
        draw(made)
    else:
        for table in made:
            say_lines("\n" + markdown(table))
    for perturbed in robustness(shown):
        say_lines("\n" + robustness_markdown(perturbed))
    sys.exit(OK if ok else NOT_OK)


@click.command()
@click.option("--all", "everything", is_flag=True, help="All tables, methods and inputs (the default).")
@selection_options
@repeat_option
@shard_option
def plan(everything: bool, shard: Shard | None, **options: Any) -> None:
    """Show what a run would do, why, and what it would take."""
    from benchmark.jobs.estimates import estimate
    from benchmark.storage.store import Store
    from benchmark.threads import available_cores

    selection = Selection.of(options | {"everything": everything})
    store = Store.open(selection.results)
    jobs = _part(selection.jobs(store), shard)
    width = max((len(clean(job.name)) for job in jobs), default=0)
    for job in jobs:
        say(f"{job.state:<11}  {clean(job.name):<{width}}  {brief(job.reason)}")
    n_to_run = sum(job.to_run for job in jobs)
    for line in estimate(jobs, store).lines(n_to_run, available_cores()):
        say(line)
    say(f"{n_to_run} of {len(jobs)} jobs to run")


def _part(jobs: list[Job], shard: Shard | None) -> list[Job]:
    """The jobs of a shard, which says which part of which plan it is; all of them without one."""
    if shard is None:
        return jobs
    say(shard.told(jobs))
    return shard.of(jobs)
