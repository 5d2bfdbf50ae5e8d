"""``run`` and ``plan``: what of a selection is missing, and making it."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import click

from benchmark.cli.options import NOT_OK, OK, RunOptions, name_skipped, plan_options, run_options
from benchmark.errors import ConfigurationError
from benchmark.system.text import brief, clean, say, say_lines

#: What tells the place of a record.
_PLACE = ("gallery", "input", "method")


@click.command()
@run_options
def run(**given: Any) -> None:
    """Run what is missing of a selection, then print its tables."""
    from benchmark.storage.store import Store

    options = RunOptions.of(given)
    chosen_by = (options.tables, options.methods, options.datasets, options.plugins)
    if not (options.everything or options.paper or any(chosen_by)):
        raise ConfigurationError("nothing is selected", "pass --all, or choose with -t, -d or -m")
    store = Store.open(options.results)
    plan = options.jobs(store)

    # What runs need takes a second to import: a name that is not known is told before.
    from benchmark.cli.run_plan import run_plan
    from benchmark.cli.terminal import draw
    from benchmark.report.content import contents
    from benchmark.report.formats import markdown
    from benchmark.report.robustness import markdown as robustness_markdown
    from benchmark.report.robustness import robustness
    from benchmark.storage.records import by_place

    ok = run_plan(plan, store, options)
    known = options.results_of(store)
    places = by_place(known.records())
    results = known.all(options.seed, scorer=options.scorer_spec().name, places=places)
    name_skipped(store)
    found = {key: r for r in results for key in (r.record["key"], tuple(r.record[part] for part in _PLACE))}
    # A finished job of the same shapes, in a folder of another name, is that of the plan.
    shown = [
        replace(result, record={**result.record, **job.facts})
        for job in plan
        if (result := found.get(job.key) or found.get((job.gallery, job.input, job.method.name)))
    ]
    chosen = {job.table for job in plan}
    made = contents(shown, chosen, blanks=not options.is_narrow, named=options.is_by_name)
    if sys.stdout.isatty():
        draw(made)
    else:
        for table in made:
            say_lines("\n" + markdown(table))
    for perturbed in robustness(shown):
        say_lines("\n" + robustness_markdown(perturbed))
    sys.exit(OK if ok else NOT_OK)


@click.command()
@plan_options
def plan(**given: Any) -> None:
    """Show what a run would do, why, and what it would take."""
    from benchmark.jobs.estimates import estimate
    from benchmark.storage.store import Store
    from benchmark.threads import available_cores

    options = RunOptions.of(given)
    store = Store.open(options.results)
    jobs = options.jobs(store)
    width = max((len(clean(job.name)) for job in jobs), default=0)
    for job in jobs:
        say(f"{job.state:<11}  {clean(job.name):<{width}}  {brief(job.reason)}")
    n_to_run = sum(job.to_run for job in jobs)
    for line in estimate(jobs, store).lines(n_to_run, available_cores()):
        say(line)
    say(f"{n_to_run} of {len(jobs)} jobs to run")
