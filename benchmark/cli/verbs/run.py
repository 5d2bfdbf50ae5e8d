"""``run`` and ``plan``: what of a selection is missing, and making it."""

from __future__ import annotations

import sys
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

from benchmark.cli.options import NOT_OK, OK, PLAN, PathOption, RunOptions, add_options, name_skipped, timeout_option
from benchmark.errors import ConfigurationError
from benchmark.text import brief, clean, say, say_lines

if TYPE_CHECKING:
    from benchmark.api.contracts import Input
    from benchmark.execution.job_specs import Job
    from benchmark.pipeline.storage.store import Store
    from benchmark.plugins.scorers import ScorerSpec
    from benchmark.protocols.galleries import Gallery

#: Most jobs that have a line each, unless somebody asks for all.
_SCREEN = 100

#: Reasons that are named where jobs have no line each.
_REASONS = 5

#: What tells the place of a record.
_PLACE = ("gallery", "input", "method")


@click.command()
@add_options(*PLAN, "workers", "executor", "scheduler")
@timeout_option("one job", "2h")
@add_options("retry")
@click.option(
    "--forms",
    multiple=True,
    metavar="NAME=DIR",
    help="Instead of methods: score DIR/SHAPE.off, ..., made by another program.",
)
@click.option("--frame", type=PathOption(), hidden=True, help="Write the records as JSON, and print no tables.")
def run(forms: tuple[str, ...], frame: Path | None, **given: Any) -> None:
    """Run the missing jobs of a selection, then print its tables."""
    from benchmark.pipeline.storage.store import Store

    options = RunOptions.of(given)
    if forms:
        _score_forms(forms, options, frame)
        return
    chosen_by = (options.tables, options.methods, options.datasets, options.plugins)
    if not (options.everything or options.paper or any(chosen_by)):
        raise ConfigurationError("nothing is selected", "pass --all, or choose with -t, -d or -m")
    store = Store.open(options.results)
    plan = options.jobs(store)
    _announce(plan, options.data_root)

    # What runs need takes a second to import: a name that is not known is told before.
    from benchmark.cli.run_plan import run_plan
    from benchmark.cli.terminal import draw
    from benchmark.pipeline.storage.records import by_place
    from benchmark.report.content import contents
    from benchmark.report.formats import markdown
    from benchmark.report.robustness import markdown as robustness_markdown
    from benchmark.report.robustness import robustness
    from benchmark.results import frame_of

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
    if frame is not None:
        frame_of(shown).to_json(frame, orient="table")
        sys.exit(OK if ok else NOT_OK)
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


def _announce(jobs: Sequence[Job], data_root: Path | None) -> None:
    """Say which data sets stand in for others, and which files of a folder are skipped."""
    from benchmark.datasets.catalogue import CATALOGUE, is_known, is_present
    from benchmark.datasets.folder import unread_files

    stand_ins = {job.facts["data"]["name"]: job.facts["data"]["stand_in_for"] for job in jobs}
    for name, official in stand_ins.items():
        if official in CATALOGUE and name in CATALOGUE:
            where = f"{data_root or 'DATA_ROOT'}/{CATALOGUE[official].folder}"
            absent = "" if is_present(official, data_root) else f", which is not at {where}; see --data-root"
            say(f"{name}: generated stand-in for {official}{absent}", err=True)
    for folder in dict.fromkeys(job.dataset for job in jobs if not is_known(job.dataset)):
        if Path(folder).is_dir() and (unread := unread_files(Path(folder))):
            more = f" and {len(unread) - 1} more" if len(unread) > 1 else ""
            say(f"{folder}: skipped {unread[0].name}{more}: formats that are not read; see 'data check'", err=True)


def _score_forms(forms: Sequence[str], options: RunOptions, frame: Path | None) -> None:
    """Score forms of other programs, then print the tables in which they stand."""
    from benchmark.datasets.catalogue import sources
    from benchmark.execution.processes.calls import Guard, call_apart
    from benchmark.pipeline.storage.store import Store
    from benchmark.protocols.galleries import galleries
    from benchmark.report.content import contents
    from benchmark.report.formats import markdown
    from benchmark.results import frame_of

    named = [
        (name, Path(folder)) for name, equals, folder in (text.partition("=") for text in forms) if name and equals
    ]
    if len(named) < len(forms) or not options.datasets or options.methods:
        raise ConfigurationError(
            "--forms scores the meshes of a folder as forms of a data set",
            "pass -d FOLDER --forms NAME=DIR, without -m",
        )
    store, inputs = Store.open(options.results), cast("tuple[Input, ...]", options.inputs or ("mesh",))
    chosen = galleries(options.tables, sources(options.datasets, options.plugins), options.data_root, options.quick)
    for gallery, input_, (title, folder) in product(chosen, inputs, named):
        gallery.check_input(input_)
        guard = Guard(f"scoring {title}", "simplify its meshes, or raise --timeout", options.timeout)
        call_apart(_score_folder, gallery, input_, title, folder, options.scorer_spec(), store, guard=guard)
    shown = options.results_of(store).all(options.seed, scorer=options.scorer_spec().name)
    names = {gallery.name for gallery in chosen}
    rows = [result for result in shown if result.record["gallery"] in names and result.record["input"] in inputs]
    if frame is not None:
        frame_of(rows).to_json(frame, orient="table")
        return
    for table in contents(rows, {gallery.table.identifier for gallery in chosen}, blanks=False):
        say_lines("\n" + markdown(table))


def _score_folder(
    gallery: Gallery, input_: Input, title: str, folder: Path, spec: ScorerSpec, store: Store
) -> None:  # fmt: skip
    """Score the forms of one folder, in a process of its own."""
    from benchmark.cli.counting import counting
    from benchmark.external.forms import score_forms

    with counting(f"scoring {title}") as watched:
        score_forms(gallery, input_, title, folder, spec, store, watched)


@click.command()
@add_options(*PLAN)
@click.option("--all-jobs", is_flag=True, help="A line for each job, however many there are.")
def plan(all_jobs: bool, **given: Any) -> None:
    """Show what would run, why, and how long it would take."""
    from benchmark.execution.plan import estimate
    from benchmark.pipeline.storage.store import Store
    from benchmark.threads import available_cores

    options = RunOptions.of(given)
    store = Store.open(options.results)
    jobs = options.jobs(store)
    for line in _job_lines(jobs) if all_jobs or len(jobs) <= _SCREEN else _gallery_lines(jobs):
        say(line)
    n_to_run = sum(job.to_run for job in jobs)
    for line in estimate(jobs, store).lines(n_to_run, available_cores()):
        say(line)
    say(f"{n_to_run} of {len(jobs)} jobs to run")


def _job_lines(jobs: Sequence[Job]) -> list[str]:
    width = max((len(clean(job.name)) for job in jobs), default=0)
    return [f"{job.state:<11}  {clean(job.name):<{width}}  {brief(job.reason)}" for job in jobs]


def _gallery_lines(jobs: Sequence[Job]) -> list[str]:
    """Count the jobs of each table and input by state, where a line for each would fill several screens."""
    states: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for job in jobs:
        states[f"{job.table} {job.input}"][job.state] += 1
    width = max(len(clean(name)) for name in states)
    lines = [
        f"{clean(name):<{width}}  {', '.join(f'{count} {state}' for state, count in counts.most_common())}"
        for name, counts in states.items()
    ]
    reasons = Counter(f"{job.state}: {brief(job.reason)}" for job in jobs if job.to_run or job.state == "failed")
    lines += [f"{count} {reason}" for reason, count in reasons.most_common(_REASONS)]
    return [*lines, "--all-jobs lists each job with its reason"]
