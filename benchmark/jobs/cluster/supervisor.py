"""Does one task beside a dask worker: ``python -m benchmark.jobs.cluster.supervisor``, run by :mod:`.dask_worker`.

It reads lines of JSON from its standard input and answers in lines of JSON. The first line that it reads is the task,
or a question. When the input ends, whoever asked is gone, and so goes the work. A process of its own for each task,
guarded like those of a run on one machine, lets a method crash without the dask worker, which other people may share.
"""

from __future__ import annotations

import json
import os
import select
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmark.errors import BenchmarkError, one_line
from benchmark.threads import pin_threads

#: Seconds between two looks at the work, and between two signs of life.
_INTERVAL, HEARTBEAT = 0.1, 2.0

#: What may be read at once.
_CHUNK = 2**16

Answer = Callable[[Mapping[str, Any]], None]


def do(message: Mapping[str, Any], commands: Iterator[str | None], answer: Answer) -> None:
    """Do a task, telling how far it is and how it ended.

    Parameters
    ----------
    message
        ``task`` as :func:`benchmark.jobs.cluster.task_messages.written` makes it, and ``workers``, the
        number of tasks that share the memory of this machine.
    commands
        Lines that have come in since, None where there is none just now; ``"stop"`` ends the work with a traceback, the
        end of the lines ends it without a word.
    answer
        Told ``{"status": ...}`` on the way and ``{"exit_code": ..., "status": ..., "trace": ...}`` at the end.
    """
    from benchmark.jobs.cluster.task_messages import TaskMessage
    from benchmark.jobs.execution.worker import TaskWorker
    from benchmark.system.workers import memory_per_worker

    with tempfile.TemporaryDirectory(prefix="canonical-forms-") as folder:
        memory = memory_per_worker(message["workers"])
        worker = TaskWorker(TaskMessage(json.dumps(message["task"])), 0, Path(folder), memory)
        told, when = None, 0.0
        try:
            for command in commands:
                if worker.exit_code is not None:
                    break
                if command == "stop":
                    worker.stop()
                    break
                status, now = worker.status, time.monotonic()
                if status != told or now - when >= HEARTBEAT:
                    told, when = status, now
                    answer({"status": asdict(status)})
        finally:
            worker.end()
        answer({"exit_code": worker.exit_code, "status": asdict(worker.status_at_end), "trace": worker.trace})


def inspect(message: Mapping[str, Any]) -> dict[str, Any]:
    """Look at what is here: the folder of results, and why this machine would do other work than was planned.

    Parameters
    ----------
    message
        ``jobs``, each with one shape at most; ``proof``, a file in the results folder, and what is ``written`` in it.

    Returns
    -------
    dict
        ``shares_folder``: whether the file is there. ``problems``: differences in words; none if this machine will do.
    """
    from benchmark.api.learning import card_digest, read_card
    from benchmark.datasets.catalogue import open_dataset
    from benchmark.jobs import recipes
    from benchmark.jobs.cluster.task_messages import model_folder, read_method, read_scorer
    from benchmark.jobs.plan import difference

    problems: dict[str, None] = {}
    for job in message["jobs"]:
        try:
            planned, input_ = job["recipe"]["code"], job["input"]
            module = job["facts"]["data"]["module"]
            found = recipes.job_code(module, input_, read_method(job["method"]), read_scorer(job["scorer"]))
            if {"code": planned} != {"code": found}:
                problems[difference({"code": planned}, {"code": found})] = None
            open_dataset(job["dataset"], None if job["data_root"] is None else Path(job["data_root"]))
            for digest, model in job["models"].items():
                kind = model["place"][0]
                if kind == "results":
                    continue  # it comes along where it is not here
                if card_digest(read_card(model_folder(model["place"], Path()))) != card_digest(model["card"]):
                    problems[f"another model {model['training']} ({digest})"] = None
        except BenchmarkError as error:
            problems[str(error)] = None
        except Exception as error:  # a plugin may raise anything
            problems[one_line(error)] = None
    try:
        shares_folder = Path(message["proof"]).read_text(encoding="utf-8") == message["written"]
    except (OSError, ValueError):
        shares_folder = False
    return {"shares_folder": shares_folder, "problems": list(problems)}


def _lines() -> Iterator[str | None]:
    """Lines of standard input, and None whenever there is none for a while; ends with the input."""
    rest = b""
    while True:
        ready, _, _ = select.select([0], [], [], _INTERVAL)
        if not ready:
            yield None
            continue
        chunk = os.read(0, _CHUNK)
        if not chunk:
            return
        *whole, rest = (rest + chunk).split(b"\n")
        for line in whole:
            yield line.decode("utf-8")


def main() -> None:
    """Do what the first line says."""
    pin_threads()
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as channel:
        os.dup2(2, 1)  # what methods print goes to the log of the dask worker, not among the answers

        def answer(content: Mapping[str, Any]) -> None:
            with suppress(OSError):  # nobody listens any more: the end of the input says so, too
                channel.write(json.dumps(content) + "\n")
                channel.flush()

        lines = _lines()
        first = next((line for line in lines if line is not None), None)
        if first is None:
            return
        message = json.loads(first)
        if "proof" in message:
            answer(inspect(message))
        else:
            do(message, lines, answer)


if __name__ == "__main__":
    main()
    sys.exit(0)
