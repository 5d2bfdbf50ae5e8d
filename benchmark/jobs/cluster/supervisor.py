"""Does tasks beside a dask worker: ``python -m benchmark.jobs.cluster.supervisor``, run by :mod:`.dask_worker`.

It reads a line of JSON from its standard input, a task or a question, and prints the answer as JSON; with ``--stay``,
line after line. When the input ends, whoever asked is gone, and so goes the work. Processes guarded like those of a run
on one machine let a method crash without the dask worker, which other people may share.
"""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import threading
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmark.errors import BenchmarkError, one_line
from benchmark.jobs.cluster.dask_worker import SAME_SUITE
from benchmark.storage.environment import PACKAGES, environment
from benchmark.system.code import suite_texts
from benchmark.system.kernel_cache import choose_kernel_cache
from benchmark.threads import pin_threads

if TYPE_CHECKING:
    from benchmark.jobs.execution.worker import TaskWorker

#: Seconds between two looks at the work.
_INTERVAL = 0.1


def do(message: Mapping[str, Any], kept: list[TaskWorker]) -> dict[str, Any]:
    """Do a task until it ends, the input ends, or a signal says that it has taken too long.

    Parameters
    ----------
    message
        ``task`` as :func:`benchmark.jobs.job_specs.to_json` writes it, and the ``keys`` of its jobs; ``results``, the
        folder; ``status_file``, where under its progress to say how far it is; ``workers``, the number of tasks that
        share the memory of this machine; ``package``, as :func:`.worker_pool.package_of` names it.
    kept
        The worker that did the task before, if there is one; it does this one where it may, and is replaced where not.

    Returns
    -------
    dict
        ``exit_code``, ``status``, ``trace`` and ``records``, those of its jobs that there are.
    """
    from benchmark.jobs.execution.worker import TaskWorker
    from benchmark.storage.store import Store
    from benchmark.system.workers import memory_per_worker

    is_stopped = threading.Event()
    signal.signal(signal.SIGUSR1, lambda number, frame: is_stopped.set())
    store = Store.open(Path(message["results"]))
    task, status_file, package = message["task"], store.progress / message["status_file"], message["package"]
    if not (kept and kept[0].package == package and kept[0].do_next(task, status_file)):
        close(kept)
        kept[:] = [TaskWorker(task, status_file, memory_per_worker(message["workers"]), package)]
    (worker,) = kept
    try:
        while worker.exit_code is None and not select.select([0], [], [], _INTERVAL)[0]:
            if is_stopped.is_set():
                worker.stop()
    finally:
        worker.end()
    return {
        "exit_code": worker.exit_code,
        "status": asdict(worker.status_at_end),
        "trace": worker.trace,
        "records": [record for key in message["keys"] if (record := store.records.read(key))],
    }


def close(kept: Sequence[TaskWorker]) -> None:
    """End a worker that waits for another task."""
    for worker in kept:
        worker.kill()


def inspect(message: Mapping[str, Any]) -> dict[str, Any]:
    """Look why this machine would do other work than was planned.

    Parameters
    ----------
    message
        ``jobs`` as :func:`benchmark.jobs.job_specs.to_json` writes them; ``results``, the folder; ``marker``, a file in
        it, and what is ``written`` there.

    Returns
    -------
    dict
        ``problem`` and ``hint``, both empty if this machine will do; and ``suite``, as :func:`suite` gives it.
    """
    from benchmark.api.learning import card_digest, read_card
    from benchmark.datasets.catalogue import open_dataset
    from benchmark.jobs import recipes
    from benchmark.jobs.foreign.remote import close_to_plugins
    from benchmark.jobs.job_specs import job_of
    from benchmark.jobs.plan import difference

    if not _is_shared(Path(message["marker"]), message["written"]):
        return {
            "problem": f"it does not see the results folder {message['results']}, or may not write there",
            "hint": "mount the folder there under the same path, or run parts with --shard and merge them",
        }
    close_to_plugins()
    problems: dict[str, None] = {}
    for description in message["jobs"]:
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
    try:
        return marker.read_text(encoding="utf-8") == written and os.access(marker.parent, os.W_OK)
    except (OSError, ValueError):
        return False


def main() -> None:
    """Do what the input says."""
    pin_threads()
    choose_kernel_cache()
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as channel:
        os.dup2(2, 1)  # what methods print goes to the log of the dask worker, not into the answer
        kept: list[TaskWorker] = []
        for line in iter(sys.stdin.readline, ""):
            message = json.loads(line)
            answer = inspect(message) if "marker" in message else do(message, kept)
            print(json.dumps(answer), file=channel, flush=True)
            if "--stay" not in sys.argv:
                break
        close(kept)


if __name__ == "__main__":
    main()
