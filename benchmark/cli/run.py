"""``run``: run the jobs of a plan, show progress, and print the tables."""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from benchmark.cli.options import Selection, name_skipped
from benchmark.cli.plan import planned_jobs, scorer_spec, scores_in_words
from benchmark.cli.selection import results_of
from benchmark.cli.terminal import counting, print_tables
from benchmark.datasets.catalogue import CATALOGUE, is_known, is_present, sources
from benchmark.datasets.folder import unread_files
from benchmark.errors import ConfigurationError
from benchmark.execution.claims import Claims
from benchmark.execution.job_specs import Job
from benchmark.execution.plan import unavailable_record
from benchmark.execution.pools import LocalPool, Pool, PoolHere
from benchmark.execution.processes.calls import call_apart
from benchmark.execution.processes.opened_files import changed_files
from benchmark.execution.scheduler import Scheduler
from benchmark.external.records import score_forms
from benchmark.kernels import compiled_kernels, drop_stale_kernels, suite_sources
from benchmark.machine import available_cores
from benchmark.pipeline.storage.environment import environment_text
from benchmark.pipeline.storage.records import Record, by_place
from benchmark.pipeline.storage.store import Store, sweep_leftovers
from benchmark.protocols.galleries import galleries
from benchmark.report.content import contents
from benchmark.report.results import Result
from benchmark.report.robustness import markdown as robustness_markdown
from benchmark.report.robustness import robustness
from benchmark.results import frame_of
from benchmark.text import brief, clean, say, say_lines

#: Seconds between lines of progress without a terminal.
_SILENCE = 15.0

#: Seconds without a finished shape after which progress says what the run waits for.
_LONG = 10.0

#: States of jobs that need no run and are not failures.
_FINE = ("cached", "unsupported")

#: Notes below a table.
_MOST_NOTES = 8


@dataclass(frozen=True)
class Settings:
    """How jobs are run: processes (0: in this one), scheduler of a cluster, time limit in seconds, failures again."""

    jobs: int | None = None
    dask: str = ""
    timeout: float = 7200.0
    retry: bool = False


def run(options: Selection, settings: Settings, forms: Sequence[str] = (), frame: Path | None = None) -> bool:
    """Run the selected jobs and print their tables."""
    selected = (options.tables, options.methods, options.datasets, options.plugins)
    if not (forms or options.everything or options.paper or any(selected)):
        raise ConfigurationError("nothing is selected", "pass --all, or choose with -t, -d or -m")
    store, ok = Store.open(options.results), True
    if forms:
        results, tables = _score_forms(options, forms, settings.timeout, store)
    else:
        jobs = planned_jobs(options, store, ("all",) if settings.retry else ())
        _announce(jobs, options.data_root)
        ok = run_plan(jobs, store, settings, is_narrow=options.is_narrow)
        results, tables = _results(jobs, options, store), {job.table for job in jobs}
    if frame is not None:
        frame_of(results).to_json(frame, orient="table")
    else:
        narrow = bool(forms) or options.is_narrow
        print_tables(contents(results, tables, blanks=not narrow, named=options.is_narrow), _MOST_NOTES)
        for perturbed in robustness(results):
            say_lines("\n" + robustness_markdown(perturbed))
    return ok


def _results(jobs: Sequence[Job], options: Selection, store: Store) -> list[Result]:
    """Return the results of a plan, including those of the same shapes in a folder with another name."""
    known, keys, shown = results_of(options, store), {job.key for job in jobs}, {job.gallery for job in jobs}
    places = by_place(record for record in store.all_records() if record["gallery"] in shown or record["key"] in keys)
    results: dict[object, Result] = {}
    for result in known.all(options.seed, scorer=scorer_spec(options).name, places=places):
        record = result.record
        results[record["key"]] = results[record["gallery"], record["input"], record["method"]] = result
    name_skipped(store)
    pairs = [(job, results.get(job.key) or results.get((job.gallery, job.input, job.method.name))) for job in jobs]
    return [replace(result, record={**result.record, **job.facts}) for job, result in pairs if result]


def _announce(jobs: Sequence[Job], data_root: Path | None) -> None:
    """Announce stand-ins and skipped files."""
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


def run_plan(jobs: Sequence[Job], store: Store, settings: Settings, *, is_narrow: bool = False) -> bool:
    """Run the jobs of a plan that need it, then delete artefacts that no job needs.

    Parameters
    ----------
    jobs
        The plan.
    store
        The results folder.
    settings
        How to run them.
    is_narrow
        Whether methods are named; otherwise a job with a missing model does not count as a failure.

    Returns
    -------
    bool
        Whether all jobs of the plan are ok, whether run now or before.
    """
    jobs = list({job.key or job.name: job for job in jobs}.values())  # two tables may share a job
    to_run = [job for job in jobs if job.to_run]
    say(f"{len(to_run)} of {len(jobs)} jobs to run, {sum(job.state == 'cached' for job in jobs)} finished before")
    for job in jobs:
        if job.state in ("failed", "unavailable"):
            remedy = "; --retry runs it again" if job.state == "failed" else ""
            say(f"{job.state:<11}  {job.name}  {brief(job.reason)}{remedy}")
        if job.state == "unavailable":
            environment = {"environment": environment_text(), "artefacts": 0}
            store.write_record({**unavailable_record(job), "environments": [environment]})
    passed_over = _FINE if is_narrow else (*_FINE, "unavailable")
    fine = all(job.state in passed_over for job in jobs if not job.to_run)
    _check_executor(settings)
    with Claims(store.root) as claims:
        fine &= not to_run or _carry_out(to_run, store, settings, claims)
        if claims.is_last():
            store.drop_scratch()
            sweep_leftovers(store)  # of workers that a killed run left alive for a moment
    return fine


def _carry_out(jobs: Sequence[Job], store: Store, settings: Settings, claims: Claims) -> bool:
    """Run jobs; return whether all are ok."""
    drop_stale_kernels()
    if not any(map(compiled_kernels, suite_sources())):
        _say("the first run compiles kernels, which takes minutes; 'python -m benchmark.kernels' does so in advance")
    for job in jobs:
        if claims.take(job.key):  # workers must not find an old failure, but another run may have finished the job
            record = store.records.read(job.key)
            if record and (record["status"] != "ok" or changed_files(record.get("files", {}))):
                store.remove_record(job.key)
            claims.release(job.key)
    fine = True
    with _Display(jobs) as display, make_pool(settings, jobs) as pool:
        for done, record in Scheduler(jobs, pool, claims, settings.timeout, display.watch).records():
            display.ended(done, record)
            fine &= record["status"] == "ok"
    return fine


def make_pool(settings: Settings, jobs: Sequence[Job]) -> Pool:
    """Return the pool of a run: this process, child processes, or workers of a dask cluster."""
    if settings.dask:
        from benchmark.execution.dask_pool import DaskPool

        return DaskPool(settings.dask, jobs, settings.jobs)
    if settings.jobs == 0:
        return PoolHere()
    pool = LocalPool(wanted := settings.jobs or available_cores())
    if pool.size < wanted:
        _say(f"only {pool.size} of {wanted} processes run at a time: there is no memory for more")
    return pool


def _check_executor(settings: Settings) -> None:
    """Raise ``ConfigurationError`` if dask is asked for and not installed."""
    if settings.dask and importlib.util.find_spec("distributed") is None:
        raise ConfigurationError(
            "the executor dask needs the package distributed", "run `pip install 'dask[distributed]'`"
        )


class _Display(Progress):
    """Progress bar over shapes; plain lines without a terminal."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        super().__init__(
            TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TextColumn("shapes"),
            TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(elapsed_when_finished=True),
            console=Console(file=sys.stderr), disable=not (jobs and sys.stderr.isatty()),
        )  # fmt: skip
        processed = [job for job in jobs if not job.ranks_again]
        shapes = {(job.dataset, job.input, job.package, shape) for job in processed for shape in job.identifiers}
        self._total = len(shapes)
        self._bar = self.add_task("starting", total=self._total)
        self._start = self._shown = self._moved = time.monotonic()
        self._done = 0

    def watch(self, names: Sequence[str], done: int) -> None:
        """Show the running jobs and the number of finished shapes, and after a pause what the run waits for."""
        done = min(done, self._total)
        self.update(self._bar, completed=done, description=clean(", ".join(names)) or "waiting")
        now = time.monotonic()
        if done != self._done:
            self._done, self._moved = done, now
        if self.disable and now - self._shown >= _SILENCE:
            self._shown = now
            waits = now - self._moved >= _LONG  # one shape gives no estimate
            left = f", about {(now - self._start) * (self._total - done) / done:.0f} s left" if done else ""
            at = f", {names[0]}" if names and (waits or not done or done >= self._total) else ""
            _say(f"{done} of {self._total} shapes after {now - self._start:.0f} s{'' if waits else left}{at}")

    def ended(self, job: Job, record: Record) -> None:
        """Print the line of a finished job."""
        text = brief(record.get("reason", ""))
        if record["status"] == "ok":
            scores = scores_in_words(record, 2)
            seconds = sum(record["cost"]["seconds_per_shape"].values())
            differ = "; two runs on one shape differ, see check" if "runs_differ" in record.get("notes", {}) else ""
            text = f"{scores}  ({seconds:.2f} s a shape{differ})"
        line = f"{record['status']:<11}  {job.name}  {text}"
        if self.disable:
            _say(line)
        else:
            self.console.print(clean(line), highlight=False, markup=False, soft_wrap=True)


def _say(text: str) -> None:
    """Print progress; a closed output does not end the run."""
    with suppress(OSError):
        say(text, err=True)


def _score_forms(
    options: Selection, forms: Sequence[str], timeout: float, store: Store
) -> tuple[list[Result], set[str]]:
    """Score forms of other programs; return the rows of their galleries and the tables of these."""
    pairs = [form.split("=", 1) for form in forms if form.partition("=")[0] and "=" in form]
    folders = dict(pairs)
    if len(folders) < len(pairs):
        raise ConfigurationError("two --forms have the same name", "name each folder differently")
    if len(pairs) < len(forms) or not options.datasets or options.methods:
        raise ConfigurationError(
            "--forms scores the meshes of a folder as forms of a data set",
            "pass -d FOLDER --forms NAME=DIR, without -m",
        )
    datasets, scorer = sources(options.datasets, options.plugins), scorer_spec(options)
    chosen = galleries(options.tables, datasets, options.data_root, options.quick)
    jobs = [
        (gallery, input_) for gallery in chosen for input_ in ([options.input] if options.input else gallery.inputs[:1])
    ]
    for (gallery, input_), (title, folder) in product(jobs, folders.items()):
        gallery.check_input(input_)
        watched, hint = partial(counting, f"scoring {title}"), "simplify its meshes, or raise --timeout"
        call_apart(
            score_forms, gallery, input_, title, Path(folder), scorer, store, watched,
            what=f"scoring {title}", hint=hint, limit=timeout,
        )  # fmt: skip
    places = {(gallery.name, input_) for gallery, input_ in jobs}
    results = results_of(options, store).all(options.seed, scorer=scorer.name)
    rows = [result for result in results if (result.record["gallery"], result.record["input"]) in places]
    return rows, {gallery.table.identifier for gallery in chosen}
