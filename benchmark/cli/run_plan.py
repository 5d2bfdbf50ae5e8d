"""Carries out a plan and tells how it goes."""

from __future__ import annotations

import importlib.util
import os
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from benchmark.cli.options import RunOptions
from benchmark.errors import ConfigurationError
from benchmark.execution.claims import Claims
from benchmark.execution.job_specs import Job
from benchmark.execution.plan import unavailable_record
from benchmark.kernel_cache import VARIABLE
from benchmark.kernels import compiled_files, drop_stale_kernels
from benchmark.pipeline.storage.environment import environment_text
from benchmark.pipeline.storage.records import Record
from benchmark.pipeline.storage.store import Store, sweep_leftovers
from benchmark.report.rounding import number
from benchmark.source_code import ROOT
from benchmark.text import brief, clean, say
from benchmark.threads import available_cores
from retrieval.measures import PRINTED

if TYPE_CHECKING:
    from benchmark.execution.pools import Pool

#: Seconds between two lines about progress where there is no terminal.
_SILENCE = 15.0

#: Seconds without a further shape after which what is waited for is named.
_LONG = 10.0

#: States of jobs that need nothing and are no failure.
_FINE = ("cached", "unsupported")


def run_plan(jobs: Sequence[Job], store: Store, options: RunOptions) -> bool:
    """Run the jobs of a plan that need it; what no job needs any more is freed at the end.

    Parameters
    ----------
    jobs
        The plan.
    store
        Where the results are.
    options
        How they are run. Where they name no method, a job whose models are not here is no failure.

    Returns
    -------
    bool
        Whether every job of the plan, run now or before, is ok.
    """
    # Two tables may hold the same job.
    jobs = list({job.key or job.name: job for job in jobs}.values())
    to_run = [job for job in jobs if job.to_run]
    say(f"{len(to_run)} of {len(jobs)} jobs to run, {sum(job.state == 'cached' for job in jobs)} finished before")
    for job in jobs:
        if job.state in ("failed", "unavailable"):
            again = "; --retry runs it again" if job.state == "failed" else ""
            say(f"{job.state:<11}  {job.name}  {brief(job.reason)}{again}")
        if job.state == "unavailable":
            made = {"environment": environment_text(), "artefacts": 0}
            store.write_record({**unavailable_record(job), "environments": [made]})
    sweep_leftovers(store)
    passed_over = _FINE if options.is_narrow else (*_FINE, "unavailable")
    fine = all(job.state in passed_over for job in jobs if not job.to_run)
    _check_executor(options)
    with Claims.of(store) as claims:
        fine &= not to_run or _carry_out(to_run, store, options, claims)
        if claims.is_last():
            store.drop_scratch()
    return fine


def _carry_out(jobs: Sequence[Job], store: Store, options: RunOptions, claims: Claims) -> bool:
    """Run jobs; returns whether every one is ok."""
    drop_stale_kernels(ROOT)
    if VARIABLE not in os.environ and next(compiled_files(ROOT), None) is None:
        _say("the first run compiles kernels, which takes minutes; 'compile' does so in advance")
    for job in jobs:
        if claims.take(job.key):
            store.remove_record(job.key)  # asked to retry: the failure of before must not stop the workers
            claims.release(job.key)
    from benchmark.execution.scheduler import Scheduler

    fine = True
    with _Display(jobs) as display, make_pool(options, jobs) as pool:
        for done, record in Scheduler(jobs, pool, claims, options.timeout, display.watch).records():
            display.ended(done, record)
            fine &= record["status"] == "ok"
    return fine


def make_pool(options: RunOptions, jobs: Sequence[Job]) -> Pool:
    """Return what does the tasks of a run: this process, others beside it, or the workers of a dask cluster.

    Parameters
    ----------
    options
        ``executor`` is ``"serial"``, ``"processes"`` or ``"dask"``; ``workers`` are tasks at a time, None for all cores
        of this machine or of the cluster; ``scheduler`` is the address of the scheduler of a dask cluster.
    jobs
        The jobs.
    """
    if options.executor == "dask":
        from benchmark.execution.dask_pool import DaskPool

        return DaskPool(options.scheduler, jobs, options.workers)
    from benchmark.execution.pools import LocalPool, PoolHere

    if options.executor == "serial":
        return PoolHere()
    pool = LocalPool(wanted := options.workers or available_cores())
    if pool.size < wanted:
        _say(f"{pool.size} processes at a time: there is no memory for {wanted}")
    return pool


def _check_executor(options: RunOptions) -> None:
    """Raise ``ConfigurationError`` where the executor is unknown, not installed, or lacks its scheduler."""
    if options.executor not in ("serial", "processes", "dask"):
        raise ConfigurationError(f"unknown executor '{options.executor}'", "choose serial, processes or dask")
    if options.executor != "dask" and options.scheduler:
        raise ConfigurationError("--scheduler needs dask", "pass --executor dask")
    if options.executor == "dask" and not options.scheduler:
        raise ConfigurationError("dask needs the address of its scheduler", "pass --scheduler URL")
    if options.executor == "dask" and importlib.util.find_spec("distributed") is None:
        raise ConfigurationError(
            "the executor dask needs the package distributed", "run `pip install 'dask[distributed]'`"
        )


class _Display:
    """A progress bar over shapes; plain lines when there is no terminal."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )  # fmt: skip

        self._bar = Progress(
            TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TextColumn("shapes"),
            TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(elapsed_when_finished=True),
            console=Console(file=sys.stderr), disable=not (jobs and sys.stderr.isatty()),
        )  # fmt: skip
        self._total = len({(job.dataset, job.input, job.package, shape) for job in jobs for shape in job.identifiers})
        self._task = self._bar.add_task("starting", total=self._total)
        self._begun = self._said = self._moved = time.monotonic()
        self._done = 0

    def __enter__(self) -> _Display:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def watch(self, names: Sequence[str], done: int) -> None:
        """Show which jobs are at work, and how many shapes are done; where that stays the same, what is waited for."""
        done = min(done, self._total)
        self._bar.update(self._task, completed=done, description=clean(", ".join(names)) or "waiting")
        now = time.monotonic()
        if done != self._done:
            self._done, self._moved = done, now
        if self._bar.disable and now - self._said >= _SILENCE:
            self._said = now
            waits = now - self._moved >= _LONG  # for one shape: an estimate by their number would be none
            left = f", about {(now - self._begun) * (self._total - done) / done:.0f} s left" if done else ""
            at = f", {names[0]}" if names and (waits or not done or done >= self._total) else ""
            _say(f"{done} of {self._total} shapes after {now - self._begun:.0f} s{'' if waits else left}{at}")

    def ended(self, job: Job, record: Record) -> None:
        """Print the line of a job that has ended."""
        if record["status"] == "ok":
            scores = " ".join(f"{name} {number(record['scores'][name])}" for name in PRINTED)
            seconds = sum(record["cost"]["seconds_per_shape"].values())
            differ = "; two runs on one shape differ, see check" if "runs_differ" in record.get("notes", {}) else ""
            said = f"{'ok':<11}  {job.name}  {scores}  ({seconds:.2f} s a shape{differ})"
        else:
            said = f"{record['status']:<11}  {job.name}  {brief(record['reason'])}"
        if self._bar.disable:
            _say(said)
        else:
            self._bar.console.print(clean(said), highlight=False, markup=False, soft_wrap=True)


def _say(text: str) -> None:
    """Tell how it goes; a run does not end because nobody listens."""
    with suppress(OSError):
        say(text, err=True)
