"""Functions that run inside a dask worker: they have processes beside it do tasks, or look what is there.

They take and return texts, never objects. A dask worker that runs for weeks may have older code in its memory than is
on its disk, and is left out then.
"""

from __future__ import annotations

import asyncio
import json
import os
import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import astuple
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmark.errors import BenchmarkError, one_line
from benchmark.execution.job_specs import job_of, task_of
from benchmark.execution.pools import LOST, LocalPool
from benchmark.execution.processes.calls import Guard, call_apart
from benchmark.kernel_cache import choose_kernel_cache
from benchmark.pipeline.storage.environment import PACKAGES, environment
from benchmark.pipeline.storage.store import Store
from benchmark.source_code import suite_texts
from benchmark.threads import pin_threads

__all__ = ["SAME_SUITE", "do", "inspect", "stop"]

#: Hint where a worker would do other work.
SAME_SUITE = "install there the suite and the packages that are here"

#: Code that this process has in its memory.
_IN_MEMORY = suite_texts()

_stopped: set[str] = set()

#: Processes of each thread of this worker, with the run that they work for: the code of another one may differ.
_pools: dict[int, tuple[str, LocalPool]] = {}


def do(message: str) -> str:
    """Do a task in a process beside this dask worker, and return how it ended.

    The process ends when this worker is killed, or the cluster has cancelled the task, because its run is gone or has
    given it to another worker.

    Parameters
    ----------
    message
        JSON with the ``task`` as :func:`benchmark.execution.job_specs.to_json` writes it; ``run``, its name; ``name``
        of the task in the cluster; ``workers``, the number of tasks that share the memory of this machine.

    Returns
    -------
    str
        JSON with ``is_finished``, ``exit_code``, ``status``, ``trace`` and ``records`` of those jobs that have one.
    """
    from distributed import get_worker

    asked = json.loads(message)
    task, name, worker = task_of(asked["task"]), asked["name"], get_worker()
    pool = _pool(asked["run"], asked["workers"])
    running = pool.begin(task)
    latest = running.status
    try:
        while not running.has_ended and name not in _stopped and _is_wanted(worker, name):
            pool.wait([running], lambda: None)
            if running.status != latest:
                latest = running.status
                worker.log_event(asked["run"], [name, *astuple(latest)])
        if name in _stopped:
            running.stop()
    finally:
        if not running.has_ended:
            running.end()
        _stopped.discard(name)
    store = Store.open(task.jobs[0].results)
    answer = {
        "is_finished": running.is_finished,
        "exit_code": running.exit_code if running.has_ended else LOST,
        "status": astuple(running.status),
        "trace": running.trace,
        "records": [record for job in task.jobs if (record := store.records.read(job.key))],
    }
    return json.dumps(answer)


def _pool(run: str, workers: int) -> LocalPool:
    """Return the processes of this thread."""
    known, pool = _pools.get(threading.get_ident(), ("", None))
    if pool is None or known != run:
        if pool is not None:
            pool.close()
        pin_threads()
        choose_kernel_cache()
        pool = LocalPool(1, share=workers)
        _pools[threading.get_ident()] = run, pool
    return pool


def stop(name: str) -> None:
    """Stop a task, after it has written down where it is; its answer says so."""
    _stopped.add(name)


def _is_wanted(worker: Any, name: str) -> bool:
    """Return whether the cluster has not cancelled a task."""
    task = worker.state.tasks.get(name)
    return task is not None and task.state in ("executing", "long-running")


async def inspect(message: str) -> str:
    """Look why this machine would do other work than was planned.

    Parameters
    ----------
    message
        JSON with ``jobs`` as :func:`benchmark.execution.job_specs.to_json` writes them; ``results``, the folder;
        ``marker``, a file in it, and what is ``written`` there.

    Returns
    -------
    str
        JSON with ``problem`` and ``hint``, both empty if this machine will do; and ``suite``; see :func:`suite`.
    """
    return await asyncio.to_thread(_inspected, message)


def _inspected(message: str) -> str:
    guard = Guard("the inspection of this machine", "look at the log of the worker")
    try:
        answer = call_apart(_inspect, json.loads(message), guard=guard)
    except BenchmarkError as error:
        return json.dumps({"problem": error.problem, "hint": error.hint})
    if not answer["problem"] and answer["suite"]["code"] != _IN_MEMORY:
        answer |= {"problem": "its code has changed since it started", "hint": "start the worker again"}
    return json.dumps(answer)


def _inspect(asked: Mapping[str, Any]) -> dict[str, Any]:
    from benchmark.api.learning import card_digest, read_card
    from benchmark.datasets.catalogue import open_dataset
    from benchmark.execution.plan import difference
    from benchmark.pipeline import recipes
    from benchmark.plugins.remote import close_to_plugins

    if not _is_shared(Path(asked["marker"]), asked["written"]):
        return {
            "problem": f"it does not see the results folder {asked['results']}, or may not write there",
            "hint": "mount the folder there under the same path, or run parts with --shard and merge them",
        }
    close_to_plugins()
    problems: dict[str, None] = {}
    for description in asked["jobs"]:
        try:
            job = job_of(description)
            dataset = open_dataset(job.dataset, job.data_root)
            now = {"plugin": None, **recipes.job_plugins(dataset, job.method, job.scorer)}
            if now["plugin"] != job.recipe.get("plugin"):
                problems[difference({"plugin": job.recipe.get("plugin")}, now)] = None
            for model in job.models.values():
                if card_digest(read_card(model.folder)) != card_digest(model.card):
                    problems[f"another model {model.training} ({model.digest})"] = None
        except BenchmarkError as error:
            problems[str(error)] = None
        except Exception as error:  # a plugin may raise anything
            problems[one_line(error)] = None
    return {"problem": "; ".join(problems), "hint": SAME_SUITE if problems else "", "suite": suite()}


def suite() -> dict[str, Any]:
    """Return digests of the ``code`` of this machine, and versions of its ``packages`` and of ``distributed``."""
    known = environment()
    packages = {name: known[name] for name in PACKAGES if name in known}
    return {"code": suite_texts(), "packages": packages, "distributed": version("distributed")}


def _is_shared(marker: Path, written: str) -> bool:
    """Return whether this machine sees what another one has written into a folder, and may write there, too."""
    with suppress(OSError, ValueError):
        return marker.read_text(encoding="utf-8") == written and os.access(marker.parent, os.W_OK)
    return False
