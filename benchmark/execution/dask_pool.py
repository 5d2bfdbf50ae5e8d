"""Run jobs on a dask cluster whose workers see the results folder and the data under the same paths."""

from __future__ import annotations

import asyncio
import itertools
import json
import logging
import os
import secrets
import threading
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent import futures
from contextlib import suppress
from dataclasses import astuple, dataclass, field, replace
from functools import partial
from importlib.metadata import version
from math import inf
from pathlib import Path
from typing import Any, Self, TypeVar

from distributed import Client, get_worker

from benchmark.datasets.catalogue import open_dataset
from benchmark.errors import BenchmarkError, ConfigurationError, one_line
from benchmark.execution.job_specs import Job, Status, Task, task_of, to_json
from benchmark.execution.plan import changed_names
from benchmark.execution.pools import LOST, LocalPool, Running
from benchmark.execution.processes.calls import call_apart
from benchmark.execution.processes.process import INTERVAL
from benchmark.kernels import choose_kernel_cache
from benchmark.machine import pin_threads
from benchmark.pipeline import recipes
from benchmark.pipeline.storage.environment import PACKAGES, environment
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.remote import close_to_plugins
from benchmark.source_code import suite_texts
from benchmark.text import brief, say

T = TypeVar("T")

#: Seconds to wait for the first answer of the scheduler, and for a lost scheduler to return.
_CONNECTING, _GONE = 10.0, 10.0

#: Seconds to wait for a worker when there is none.
_NOBODY = 600.0

#: Seconds without a heartbeat, or without the result of a finished task, after which a worker counts as lost.
SILENCE = 60.0

#: Seconds for a worker to write the traceback of a stopped task.
_LAST_WORDS = 10.0


@dataclass
class WorkerNode:
    """A dask worker with its inventory, once known, and its number of running tasks."""

    address: str
    host: str
    threads: int
    inventory: futures.Future[Any]
    is_ready: bool = False
    refusal: ConfigurationError | None = None
    heartbeat: float = 0.0
    #: Local time of the last heartbeat.
    heard: float = field(default_factory=time.monotonic)
    running: int = 0

    @property
    def is_lost(self) -> bool:
        """Whether it is gone or silent; it is used again after its next heartbeat."""
        return time.monotonic() - self.heard > SILENCE

    @property
    def free(self) -> int:
        """Number of further tasks that it can take."""
        return self.threads - self.running if self.is_ready and not self.is_lost else 0


class DaskPool:
    """Workers of a dask cluster; see :mod:`benchmark.execution.pools`.

    A worker must report its inventory before it gets tasks, and is left out if it would compute something other than
    planned. Tasks are assigned to workers by address, without retries by dask, so that the suite knows what a lost
    worker was doing.

    Parameters
    ----------
    url
        Address of the scheduler.
    jobs
        Jobs of the run; they determine what workers need.
    most
        Maximum number of concurrent tasks; None for all threads of all workers.

    Raises
    ------
    ConfigurationError
        If no scheduler answers.
    """

    def __init__(self, url: str, jobs: Sequence[Job], most: int | None = None) -> None:
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # this module reports errors itself, in one line
        self.url = url
        self._most = most
        self._name = f"canonical-forms-{secrets.token_hex(8)}"
        self._numbers = itertools.count()
        self._nodes: dict[str, WorkerNode] = {}
        self._info: dict[str, Any] = {}
        self._store = Store.open(jobs[0].results)
        self._running: dict[str, Running] = {}
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # about versions, which are reported for each worker
                self._client = Client(url, timeout=_CONNECTING, set_as_default=False, name=self._name)
        except Exception as error:  # the type depends on the kind of address
            raise ConfigurationError(
                f"no dask scheduler answers at {url} ({brief(one_line(error))})", "start one or correct --dask"
            ) from error
        self._client.subscribe_topic(self._name, self._hear)
        self._marker = self._store.progress / f"{os.getpid()}-{self._name}"
        self._marker.write_text(self._name, encoding="utf-8")
        #: What determines results.
        self._inventory = suite() | {
            "plugin": {name: source for job in jobs for name, source in job.recipe.get("plugin", {}).items()},
            "models": {str(model.folder): model.digest for job in jobs for model in job.models.values()},
        }
        task = to_json(Task(tuple(replace(job, identifiers=(), trainings={}) for job in jobs)))
        self._question = json.dumps({"task": task, "marker": str(self._marker), "written": self._name})
        self._reached = self._useful = time.monotonic()
        self._over = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._marker.unlink(missing_ok=True)
        futures.wait([_aside(partial(self._client.close, timeout=1))], _LAST_WORDS)

    @property
    def size(self) -> int:
        """Number of tasks that can run at a time."""
        slots = sum(node.running + node.free for node in self._nodes.values())
        return slots if self._most is None else min(slots, self._most)

    @property
    def waits_for(self) -> str:
        """Reason for waiting if no worker is usable; "" otherwise."""
        if self.size:
            return ""
        waiting = sum(not node.inventory.done() for node in self._nodes.values())
        return f"{waiting} workers of {self.url} are being inspected" if waiting else f"no worker at {self.url} yet"

    def begin(self, task: Task) -> Running:
        """Give a task to the worker with the most free threads."""
        node = max(self._nodes.values(), key=lambda node: node.free, default=None)
        if node is None or not node.free:
            raise OSError(0, f"all workers of {self.url} are busy")
        name = f"{self._name}-{next(self._numbers)}"
        share = sum(other.threads for other in self._nodes.values() if other.host == node.host)
        answer = self._client.submit(
            do, to_json(task), self._name, name, share, key=name, workers=[node.address], allow_other_workers=False,
            retries=0, pure=False,
        )  # fmt: skip
        node.running += 1
        self._running[name] = Running(task, (node, answer))
        return self._running[name]

    def wait(self, tasks: Sequence[Running], look: Callable[[], object]) -> None:
        """Wait a moment, then update workers and tasks.

        Raises
        ------
        BenchmarkError
            If the scheduler is gone, or no worker is available for too long.
        ConfigurationError
            If all workers were left out.
        """
        time.sleep(INTERVAL)
        now = time.monotonic()
        if now - self._reached > _GONE:
            raise BenchmarkError(
                f"the dask scheduler at {self.url} is gone", "start it again and run again; finished jobs are kept"
            )
        self._look_round()
        for running in tasks:
            self._update(running)
        refused = [node.refusal for node in self._nodes.values() if node.refusal]
        if tasks or self.size:
            self._useful = now
        elif refused and len(refused) == len(self._nodes):
            raise ConfigurationError(
                f"no worker at {self.url} matches this machine: {refused[0].problem}", refused[0].hint
            )
        elif now - self._useful > _NOBODY:
            raise BenchmarkError(
                f"no worker joined {self.url} in {_NOBODY:g} s",
                f"start some, of distributed {version('distributed')}, and run again; finished jobs are kept",
            )

    def stop(self, running: Running) -> None:
        """End a task after it has written its traceback."""
        node, answer = running.worker
        _aside(partial(self._client.run, stop, answer.key, workers=[node.address], on_error="ignore"))
        until = time.monotonic() + _LAST_WORDS
        while not running.has_ended and time.monotonic() < until:
            time.sleep(INTERVAL)
            self._update(running)
        self.end(running)

    def end(self, running: Running) -> None:
        """Cancel a task, if it still runs."""
        node, answer = running.worker
        if self._running.pop(answer.key, None):
            _aside(partial(answer.cancel, force=True))
            node.running -= 1

    def _hear(self, event: tuple[float, Any]) -> None:
        """Store the progress that a worker reports."""
        name, *status = event[1]
        if name in self._running:
            self._running[name].status = Status(*status)

    def _update(self, running: Running) -> None:
        """Check whether a task has ended."""
        node, answer = running.worker
        if answer.done():
            try:
                running.is_finished, running.exit_code, status, running.trace, records = answer.result(timeout=SILENCE)
            except Exception:  # cancelled, killed, or no result
                running.exit_code = LOST
            else:
                running.status = Status(*status)
                for record in records:  # they may appear late on a network file system
                    if record["key"] not in self._store.records:
                        self._store.write_record(record)
        elif node.is_lost:
            running.exit_code = LOST
        if running.has_ended:
            self.end(running)

    def _watch(self) -> None:
        """Poll the scheduler for its workers, in a thread because the call may never return."""
        while not self._over.wait(INTERVAL * 5):
            with suppress(Exception):
                if self._client.status == "running":
                    self._info = dict(self._client.scheduler_info()["workers"])
                    self._reached = time.monotonic()

    def _look_round(self) -> None:
        info = self._info
        for address, known in info.items():
            if address not in self._nodes:
                # Not as a task, which would end a worker without the suite.
                ask = partial(self._client.run, asyncio.to_thread, inspect, self._question, workers=[address])
                self._nodes[address] = WorkerNode(address, known["host"], int(known["nthreads"]), _aside(ask))
            node = self._nodes[address]
            if node.heartbeat != known.get("last_seen"):
                node.heartbeat, node.heard = known.get("last_seen", 0.0), time.monotonic()
            if node.inventory.done() and not node.is_ready and not node.refusal:
                self._admit(node)
        for address in self._nodes.keys() - info.keys():
            self._nodes.pop(address).heard = -inf

    def _admit(self, node: WorkerNode) -> None:
        """Accept or refuse a worker by its inventory."""
        hint = "install the same versions of the suite and its packages there"
        try:
            inventory = json.loads(node.inventory.result()[node.address])
            hint, problem = inventory.get("hint", hint), inventory.get("problem", "")
            if not problem:
                parts = ((part, own, inventory[part]) for part, own in self._inventory.items())
                problem = "; ".join(changed_names(part, own, other) for part, own, other in parts if own != other)
        except KeyError:
            problem = "another version of this suite"
        except Exception as error:  # the suite is not installed, or the worker is gone
            problem = one_line(error)
        node.is_ready = not problem
        if problem:
            node.refusal = ConfigurationError(f"worker {node.address}: {brief(problem)}", hint)
            say(f"left out: {node.refusal}", err=True)


def _aside(call: Callable[[], T]) -> futures.Future[T]:
    """Call a function that may never return in a separate thread."""
    future: futures.Future[T] = futures.Future()

    def run() -> None:
        try:
            future.set_result(call())
        except Exception as error:
            future.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return future


# Inside a dask worker ------------------------------------------------------------------------------------------------

# Arguments and results are plain values, never objects. A worker that has older code in memory than on disk is left
# out.

#: Digests of the code that this process has loaded.
_IN_MEMORY = suite_texts()

#: Names of tasks to stop after they have written a traceback.
_stopped: set[str] = set()

#: Pool of each thread of this worker, with its run: the code of another run may differ.
_pools: dict[int, tuple[str, LocalPool]] = {}


def do(description: str, run: str, name: str, share: int) -> tuple[bool, int | None, Any, str, list[Any]]:
    """Run a task in a child process of this dask worker.

    The process ends when the worker is killed, or when the task is cancelled because its run is gone or has given it to
    another worker.

    Parameters
    ----------
    description
        The task, written by :func:`benchmark.execution.job_specs.to_json`.
    run, name
        Names of the run and of the task in the cluster.
    share
        Number of tasks that share the memory of this machine.

    Returns
    -------
    tuple
        The fields of :class:`benchmark.execution.pools.Running` at its end, and the records of its finished jobs.
    """
    task, worker, pool = task_of(description), get_worker(), _pool(run, share)
    running = pool.begin(task)
    latest = running.status
    try:
        while not running.has_ended and name not in _stopped and _is_wanted(worker, name):
            pool.wait([running], lambda: None)
            if running.status != latest:
                latest = running.status
                worker.log_event(run, [name, *astuple(latest)])
        if name in _stopped:
            pool.stop(running)
    finally:
        if not running.has_ended:
            pool.end(running)
        _stopped.discard(name)
    code = running.exit_code if running.has_ended else LOST
    records = (Store.open(task.jobs[0].results).records.read(job.key) for job in task.jobs)
    return running.is_finished, code, astuple(running.status), running.trace, list(filter(None, records))


def _pool(run: str, share: int) -> LocalPool:
    """Return the pool of this thread."""
    known, pool = _pools.get(threading.get_ident(), ("", None))
    if pool is None or known != run:
        if pool is not None:
            pool.close()
        pin_threads()
        choose_kernel_cache()
        pool = LocalPool(1, share)
        _pools[threading.get_ident()] = run, pool
    return pool


def stop(name: str) -> None:
    """Stop a task after it has written its traceback, which is part of its result."""
    _stopped.add(name)


def _is_wanted(worker: Any, name: str) -> bool:
    """Return whether a task has not been cancelled."""
    task = worker.state.tasks.get(name)
    return task is not None and task.state in ("executing", "long-running")


def inspect(question: str) -> str:
    """Return the inventory of this machine for jobs as JSON, or ``problem`` and ``hint``.

    Parameters
    ----------
    question
        JSON with a ``task`` of these jobs, written by :func:`benchmark.execution.job_specs.to_json`, and the path
        ``marker`` of a file in the results folder with the text ``written``.
    """
    what, hint = "the inspection of this machine", "look at the log of the worker"
    try:
        inventory = call_apart(_inventory, json.loads(question), what=what, hint=hint)
        if inventory["code"] != _IN_MEMORY:
            raise ConfigurationError("its code has changed since it started", "start the worker again")
    except BenchmarkError as error:
        inventory = {"problem": error.problem, "hint": error.hint}
    return json.dumps(inventory)


def _inventory(question: Mapping[str, Any]) -> dict[str, Any]:
    marker = Path(question["marker"])
    if not _is_shared(marker, question["written"]):
        raise ConfigurationError(
            f"it does not see the results folder {marker.parents[2]}, or may not write there",
            "mount the folder there under the same path",
        )
    close_to_plugins()
    inventory = suite() | {"plugin": {}, "models": {}}
    for job in task_of(question["task"]).jobs:
        dataset = open_dataset(job.dataset, job.data_root)
        inventory["plugin"] |= recipes.job_plugins(dataset, job.method, job.scorer).get("plugin", {})
        inventory["models"] |= {str(model.folder): model.digest for model in job.models.values()}
    return inventory


def suite() -> dict[str, Any]:
    """Return digests of the ``code`` of this machine and versions of its ``packages``."""
    known = environment()
    return {"code": suite_texts(), "packages": {name: known[name] for name in PACKAGES if name in known}}


def _is_shared(marker: Path, written: str) -> bool:
    """Return whether this machine sees a file written by another machine and may write to its folder."""
    with suppress(OSError, ValueError):
        return marker.read_text(encoding="utf-8") == written and os.access(marker.parent, os.W_OK)
    return False
