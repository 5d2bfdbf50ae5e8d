"""Carries out a plan and tells how it goes."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from threading import Event, Thread
from typing import Any, Protocol

import click
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from benchmark.jobs.executors import make_executor
from benchmark.jobs.plan import Job
from benchmark.jobs.runner import Order
from benchmark.storage.store import Store

#: Seconds between two looks at how far the jobs are.
INTERVAL = 0.5


class _Selection(Protocol):
    @property
    def results(self) -> Path: ...
    @property
    def data_root(self) -> Path | None: ...
    @property
    def seed(self) -> int: ...


def run_plan(
    jobs: Sequence[Job], store: Store, selection: _Selection, executor: str, workers: int, timeout: float | None
) -> bool:
    """Run the jobs of a plan that need it.

    Returns
    -------
    bool
        Whether every job of the plan, run now or before, is ok.
    """
    # Two tables may hold the same job.
    jobs = list({job.key or job.name: job for job in jobs}.values())
    to_run = [job for job in jobs if job.to_run]
    click.echo(
        f"{len(to_run)} of {len(jobs)} jobs to run, {sum(job.state == 'cached' for job in jobs)} finished before"
    )
    for job in jobs:
        if job.state in ("failed", "unavailable"):
            click.echo(
                f"{job.state:<11}  {job.name}  {job.reason}"
                + ("; --retry runs it again" if job.state == "failed" else "")
            )
    statuses = [job.state for job in jobs if not job.to_run]
    orders = [Order.of(job, selection.results, selection.data_root, selection.seed) for job in to_run]
    with _Watch(store, orders) as watch:
        for order, record in make_executor(executor, workers, timeout).execute(orders, watch.started):
            watch.ended(order, record)
            statuses.append("cached" if record["status"] == "ok" else "failed")
    return all(status in ("cached", "unsupported") for status in statuses)


class _Watch:
    """A progress bar over shapes, fed by what the running jobs report; plain lines when there is no terminal."""

    def __init__(self, store: Store, orders: Sequence[Order]) -> None:
        self._store = store
        self._running: dict[str, Order] = {}
        self._done = 0
        self._stop = Event()
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("shapes"),
            TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(elapsed_when_finished=True),
            console=Console(file=sys.stderr), disable=not (orders and sys.stderr.isatty()),
        )  # fmt: skip
        self._task: TaskID = self._bar.add_task("starting", total=sum(len(order.identifiers) for order in orders))
        self._thread = Thread(target=self._poll, daemon=True)

    def __enter__(self) -> _Watch:
        self._bar.start()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._bar.stop()

    def started(self, order: Order) -> None:
        """Note that a job is on its way."""
        self._running[order.key] = order

    def ended(self, order: Order, record: dict[str, Any]) -> None:
        """Note that a job has ended, and print its line."""
        self._running.pop(order.key, None)
        self._done += len(order.identifiers)
        if record["status"] == "ok":
            scores = " ".join(f"{name} {record['scores'][name]:.2f}" for name in ("NN", "FT", "ST", "DCG"))
            said = f"{'ok':<11}  {order.name}  {scores}  ({record['wall_seconds']:.0f} s, {record['peak_mib']} MiB)"
        else:
            said = f"{record['status']:<11}  {order.name}  {record['reason']}"
        if self._bar.disable:
            click.echo(said, err=True)
        else:
            self._bar.console.print(said, highlight=False, markup=False, soft_wrap=True)

    def _poll(self) -> None:
        while not self._stop.wait(INTERVAL):
            running = list(self._running.values())
            shapes = sum(self._store.progress(order.key)[0] for order in running)
            names = ", ".join(f"{order.input} {order.method.name}" for order in running)
            self._bar.update(self._task, completed=self._done + shapes, description=names or "waiting")
