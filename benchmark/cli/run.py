"""``plan`` and ``run``: list the jobs of a selection, run those that are missing, and print their tables."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Sequence
from dataclasses import replace
from datetime import timedelta
from functools import partial
from pathlib import Path

from benchmark.cli.options import Selection
from benchmark.cli.progress import Bar, counting
from benchmark.cli.results import outcome, print_tables
from benchmark.datasets.catalogue import CATALOGUE, is_known, is_present, sources
from benchmark.datasets.folder import skipped_files
from benchmark.errors import ConfigurationError
from benchmark.kernels import compiled_kernels, suite_sources
from benchmark.machine import available_cores
from benchmark.pipeline.records import Record, read_records
from benchmark.protocols.galleries import Gallery, galleries
from benchmark.protocols.tables import INPUTS
from benchmark.registry import by_name, select, select_one
from benchmark.report.frames import changed, chosen_records
from benchmark.report.robustness import robustness_markdown
from benchmark.report.tables import table_views
from benchmark.runs.planning import Planned, estimate
from benchmark.runs.planning import plan as make_plan
from benchmark.runs.runner import run as run_jobs
from benchmark.scoring.rows import score_forms as score_folder
from benchmark.text import aligned, brief, say, say_lines

#: Most jobs that ``plan`` lists one by one, and most reasons in its summary of more.
_SCREEN, _REASONS = 18, 5


def _galleries(selection: Selection) -> list[Gallery]:
    """Return the selected galleries; without tables and data sets, those of the plugin files."""
    root = selection.require_data_root()
    named = bool(selection.datasets or selection.tables or selection.everything)
    own = tuple(name for name, component in by_name("data set", selection.plugins).items() if component.plugin)
    names = sources(selection.datasets if named else own, selection.plugins)
    chosen = galleries(selection.tables, names, root, selection.quick)
    if selection.subjects:
        subjects = selection.subjects.split(",")
        # Some tables show a part of a data set: those that have the subjects are meant.
        fitting = [gallery for gallery in chosen if {entry.subject for entry in gallery.entries}.issuperset(subjects)]
        chosen = [gallery.of_subjects(subjects) for gallery in fitting or chosen]
    if not selection.input:
        return chosen
    fitting = [replace(gallery, inputs=(selection.input,)) for gallery in chosen if selection.input in gallery.inputs]
    if not fitting and selection.input not in (dataset := chosen[0].dataset).inputs:
        problem = f"data set '{dataset.name}' has no complete surfaces, only views of one side of each shape"
        raise ConfigurationError(problem, f"drop --input {selection.input}")
    return fitting


def planned_jobs(selection: Selection, again: Collection[str] = ()) -> list[Planned]:
    """Plan a selection; raise ``ConfigurationError`` if it has no job."""
    jobs = make_plan(
        _galleries(selection), [selection.input] if selection.input else INPUTS,
        select(selection.methods, selection.plugins), selection.results,
        scorer=select_one(selection.scorer, selection.plugins, "scorer"), seed=selection.seed, again=again,
        named=selection.is_narrow,
    )  # fmt: skip
    if not jobs:
        raise ConfigurationError("no selected method belongs to a selected table", "drop -m, -t or --input")
    return jobs


def plan(selection: Selection, *, traceback: bool = False) -> None:
    """Print the jobs, the reasons to run them, and an estimate of the time."""
    jobs = planned_jobs(selection)
    to_run, cores = [job for job in jobs if job.to_run], available_cores()
    each = [(job.state, str(job.record.row), brief(job.reason)) for job in jobs]
    for line in aligned(each) if len(jobs) <= _SCREEN else _summary(jobs):
        say(line)
    say(f"{len(to_run)} of {len(jobs)} jobs to run")
    expected = estimate(to_run, selection.results)
    if expected.seconds:
        work, wall = (timedelta(seconds=round(expected.seconds / share)) for share in (1, cores))
        say(f"at most about {work} of work, {wall} with {cores} processes")
    if expected.unknown:
        say(f"{expected.unknown} of them cannot be estimated: no job of their method has finished")
    for record in _records_of(jobs, selection.results) if traceback else ():
        if record.traceback:
            say(f"{record.row}: {record.reason}")
            say_lines("  " + record.traceback.rstrip().replace("\n", "\n  "))


def run(
    selection: Selection,
    *,
    size: int | None = None,
    dask: str = "",
    timeout: float = 7200.0,
    again: Collection[str] = (),
) -> bool:
    """Run the selected jobs and print their tables; return whether all of them are ok."""
    if not (selection.everything or selection.tables or selection.methods or selection.datasets or selection.plugins):
        raise ConfigurationError("nothing is selected", "pass --all, or choose with -t, -d or -m")
    jobs = planned_jobs(selection, again)
    _announce(jobs, selection.data_root)
    to_run = [job for job in jobs if job.to_run]
    say(f"{len(to_run)} of {len(jobs)} jobs to run, {sum(job.state == 'finished' for job in jobs)} finished before")
    supported = {job.record.method for job in jobs if job.state != "unsupported"}
    for job in jobs:
        is_useless = selection.is_narrow and job.record.method not in supported
        if (job.state in ("failed", "unavailable") or is_useless) and not job.to_run:
            remedy = "; --retry runs it again" if job.state == "failed" else ""
            say(f"{job.state:<11}  {job.record.row}  {brief(job.reason)}{remedy}")
    if to_run and not any(map(compiled_kernels, suite_sources())):
        say("the first run compiles kernels, which takes minutes; 'python -m benchmark.kernels' does so in advance")
    if size == 0:
        say("-j 0: in this process, by one thread, without time limits", err=True)
    size = available_cores() if size is None else size
    passed_over = ("unsupported",) if selection.is_narrow else ("unsupported", "unavailable")
    fine, traced = all(job.to_run or job.state in ("finished", *passed_over) for job in jobs), False
    with Bar(len(to_run), estimate(to_run, selection.results).seconds / max(1, size)) as bar:
        ended = run_jobs(jobs, selection.results, size=size, timeout=timeout, dask=dask, watch=bar.watch)
        for job, record in ended:
            bar.ended(f"{record.status:<11}  {job.record.row}  {outcome(record)}")
            fine &= record.status == "ok"
            traced |= bool(record.traceback)
    if traced:
        say("'plan --traceback', with the same selection, prints errors in full", err=True)
    if selection.subjects:  # tables show whole galleries
        for record in _records_of(jobs, selection.results):
            say(f"{record.row}  {outcome(record)}")
        return fine
    methods = [job.record.method for job in jobs] if selection.is_narrow else ()
    _print_tables_of([job.gallery for job in jobs], selection, methods)
    if any("|" in name for name in selection.methods):
        say("- The best of several values is tuned on these shapes; choose it on others: --subjects A,B.")
    return fine


def _records_of(jobs: Sequence[Planned], results: Path) -> list[Record]:
    keys = {job.record.key for job in jobs}
    return [record for record in read_records(results, published=False) if record.key in keys]


def score_forms(selection: Selection, forms: Sequence[str]) -> bool:
    """Score forms of other programs, ``NAME=DIR`` each, beside the rows of a data set, and print its tables."""
    folders = {title: folder for title, _, folder in (form.partition("=") for form in forms)}
    are_named = len(folders) == len(forms) and all(folders) and all(folders.values())
    if not are_named or not selection.datasets or selection.methods:
        problem = "--forms scores the meshes of folders as forms of a data set"
        raise ConfigurationError(problem, "pass -d FOLDER --forms NAME=DIR, without -m")
    scorer = select_one(selection.scorer, selection.plugins, "scorer")
    chosen = _galleries(selection)
    for gallery in chosen:
        for input_ in gallery.inputs:
            for title, folder in folders.items():
                watched = partial(counting, f"scoring {title}")
                score_folder(gallery, input_, title, Path(folder), scorer, selection.results, watched)
    _print_tables_of(chosen, selection)
    return True


def _print_tables_of(shown: Sequence[Gallery], selection: Selection, methods: Sequence[str] = ()) -> None:
    """Print the tables of galleries, with all rows or those of some methods."""
    pairs = {(gallery.name, input_) for gallery in shown for input_ in gallery.inputs}
    every = read_records(selection.results)
    chosen = chosen_records(every, quick=selection.quick, scorer=selection.scorer, seed=selection.seed)
    records = [record for record in chosen if (record.gallery, record.input) in pairs]
    tables = {gallery.table.identifier for gallery in shown}
    sets = {gallery.dataset.name for gallery in shown if not gallery.table.is_robustness}
    print_tables(view for view in table_views(records, tables, methods, sets) if view.table.identifier in tables)
    if any(changed(gallery.dataset.name) for gallery in shown):
        say_lines("\n" + robustness_markdown(records))


def _announce(jobs: Sequence[Planned], data_root: Path | None) -> None:
    """Announce stand-ins and skipped files."""
    for name, official in {job.record.data.name: job.record.data.stand_in_for for job in jobs}.items():
        if official in CATALOGUE and name in CATALOGUE:
            where = f"{data_root or 'DATA_ROOT'}/{CATALOGUE[official].folder}"
            absent = "" if is_present(official, data_root) else f", which is not at {where}; see --data-root"
            say(f"{name}: generated stand-in for {official}{absent}", err=True)
    for folder in dict.fromkeys(job.gallery.source for job in jobs if not is_known(job.gallery.source)):
        if Path(folder).is_dir() and (unread := skipped_files(Path(folder))):
            say(f"{folder}: skipped {len(unread)} point clouds, such as {unread[0].name}; see 'data check'", err=True)


def _summary(jobs: Sequence[Planned]) -> list[str]:
    """Count the jobs of each table and input by state, and the most frequent reasons."""
    states = defaultdict[str, Counter[str]](Counter)
    for job in jobs:
        states[f"{job.gallery.table.identifier} {job.record.input}"][job.state] += 1
    rows = [(name, ", ".join(f"{n} {state}" for state, n in counts.most_common())) for name, counts in states.items()]
    reasons = Counter(f"{job.state}: {brief(job.reason)}" for job in jobs if job.state != "finished")
    frequent = [f"{count} {reason}" for reason, count in reasons.most_common(_REASONS)]
    return [*aligned(rows), *frequent, "select fewer with -t, -d, -m and --input to see each job"]
