"""The workers of a dask cluster as the pool of a run."""

from __future__ import annotations

import json
import logging
import os
import secrets
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from types import TracebackType
from typing import Any, Self

from distributed import Client

from benchmark.errors import BenchmarkError, ConfigurationError, one_line
from benchmark.jobs.cluster import dask_worker
from benchmark.jobs.cluster.remote_task import LAST_WORDS, RemoteTask, aside, wait_for
from benchmark.jobs.cluster.task_messages import written, written_job
from benchmark.jobs.cluster.worker_node import WorkerNode
from benchmark.jobs.execution.worker import Status
from benchmark.jobs.execution.worker_pool import INTERVAL, LocalWorkerPool, PoolWorker
from benchmark.jobs.job_specs import JobSpec, ScoringTask, Task
from benchmark.storage.store import Store
from benchmark.system.files import write_atomically
from benchmark.system.text import brief, say
from benchmark.threads import available_cores

#: Seconds for the scheduler to answer at first, and to be back once it was lost.
_CONNECTING, _GONE = 10.0, 10.0

#: Seconds that a worker may take to say what is installed there.
_INSPECTION = 180.0

#: Seconds to wait for the first worker, or for another one when all are lost.
_NOBODY = 600.0


class DaskWorkerPool:
    """The workers of a dask cluster.

    Each is asked before it gets work what code and packages it has, and is left out if it would do other work than was
    planned. Tasks are given to one worker by name, for a run wants to know whose death costs what; dask itself tries
    nothing again.

    Parameters
    ----------
    url
        Address of the scheduler.
    jobs
        The jobs; they name what the workers must have.
    most
        Tasks at a time; None for all threads of all workers.

    Raises
    ------
    ConfigurationError
        If no scheduler answers.
    """

    def __init__(self, url: str, jobs: Sequence[JobSpec], most: int | None = None) -> None:
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what goes wrong is said here, in one line
        self.url = url
        self.run = f"canonical-forms-{secrets.token_hex(8)}"
        self.store = Store.open(jobs[0].results)
        self._most = most
        self._nodes: dict[str, WorkerNode] = {}
        self._info: dict[str, Any] = {}
        self._heard: dict[str, tuple[float, Status]] = {}
        self._running: list[RemoteTask] = []
        self._local = LocalWorkerPool(available_cores(), self.store.progress)
        self._ranking: list[PoolWorker] = []
        self._proof = self.store.progress / f"{os.getpid()}-{self.run}"
        self._proof.write_text(self.run, encoding="utf-8")
        self._message = json.dumps(
            {
                "jobs": [written_job(job) | {"identifiers": [], "model_of": {}} for job in jobs],
                "proof": str(self._proof.resolve()),
                "written": self.run,
            }
        )
        try:
            self._client = Client(url, timeout=_CONNECTING, set_as_default=False, name=self.run)
        except Exception as error:  # what is raised depends on the kind of address
            self._proof.unlink(missing_ok=True)
            raise ConfigurationError(
                f"no dask scheduler answers at {url} ({brief(one_line(error))})", "start one or correct --scheduler"
            ) from error
        self._client.subscribe_topic(self.run, self._hear)
        self._reached = self._useful = time.monotonic()
        self._over = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._proof.unlink(missing_ok=True)
        away = [node.address for node in self._nodes.values() if not node.shares_folder]
        if self._client.status == "running" and away:
            wait_for(
                lambda: self._client.run(dask_worker.forget, self.run, workers=away, on_error="ignore"), LAST_WORDS
            )
        wait_for(lambda: self._client.close(timeout=1), LAST_WORDS)

    # What a run asks ---------------------------------------------------------------------------------------------

    @property
    def size(self) -> int:
        """Tasks that the workers can do at a time."""
        slots = sum(node.threads for node in self._nodes.values() if node.is_ready)
        return slots if self._most is None else min(slots, self._most)

    @property
    def waits_for(self) -> str:
        """Return what the run waits for where no worker can be used."""
        if any(node.is_ready for node in self._nodes.values()):
            return ""
        asked = sum(node.answer is None for node in self._nodes.values())
        return f"{asked} workers of {self.url} say what they have" if asked else f"no worker at {self.url} yet"

    def begin(self, task: Task, number: int) -> PoolWorker:
        """Give a task to the worker that is least at work.

        What only few machines can do, ranking without a common folder, is done here.
        """
        free = {
            node.address: node.threads - sum(remote.node is node for remote in self._running)
            for node in self._nodes.values()
            if node.is_ready and (node.shares_folder or not isinstance(task, ScoringTask))
        }
        address = max(free, key=lambda name: free[name], default=None)
        if address is not None and free[address] > 0:
            return self._send(task, number, self._nodes[address])
        if address is None and isinstance(task, ScoringTask):
            self._ranking = [worker for worker in self._ranking if worker.exit_code is None]
            if len(self._ranking) < self._local.size:
                self._ranking.append(self._local.begin(task, number))
                return self._ranking[-1]
        raise OSError(0, f"all workers of {self.url} are at work")

    def wait(self, running: Sequence[PoolWorker]) -> None:
        """Wait a moment, then look who has come and who has gone.

        Raises
        ------
        BenchmarkError
            If the scheduler is gone, or no worker comes for long.
        ConfigurationError
            If no worker would do what was planned.
        """
        time.sleep(INTERVAL)
        now = time.monotonic()
        if now - self._reached > _GONE:
            raise BenchmarkError(
                f"the dask scheduler at {self.url} is gone", "start it again and run again; finished jobs are kept"
            )
        self._look_round()
        if running or any(node.is_ready for node in self._nodes.values()):
            self._useful = now
        elif (refused := [m for m in self._nodes.values() if m.problems]) and len(refused) == len(self._nodes):
            raise ConfigurationError(
                f"no worker at {self.url} would do what this machine does: {refused[0].told}",
                "install there the suite and the packages that are here",
            )
        elif now - self._useful > _NOBODY:
            raise BenchmarkError(
                f"no worker came to {self.url} in {_NOBODY:g} s", "start workers and run again; finished jobs are kept"
            )

    # What goes on in the cluster ---------------------------------------------------------------------------------

    def _watch(self) -> None:
        """Ask the scheduler for its workers, again and again; in a thread, for it may never answer."""
        while not self._over.wait(INTERVAL * 5):
            with suppress(Exception):
                if self._client.status == "running":
                    self._info = dict(self._client.scheduler_info()["workers"])
                    self._reached = time.monotonic()

    def _look_round(self) -> None:
        info = self._info
        for address, known in info.items():
            node = self._nodes.get(address)
            if node is None:
                node = WorkerNode(address, known["host"], int(known["nthreads"]), time.monotonic())
                self._nodes[address] = node
                threading.Thread(target=self._inspect, args=(node,), daemon=True).start()
            node.seen = float(known.get("last_seen", 0.0))
            if node.given_up is not None and node.seen > node.given_up:
                node.given_up, node.anew = None, True
        for address in [address for address in self._nodes if address not in info]:
            del self._nodes[address]
        for node in self._nodes.values():
            if node.answer is None and time.monotonic() - node.asked > _INSPECTION:
                self._refuse(node, ["it did not say what is installed there"])

    def _inspect(self, node: WorkerNode) -> None:
        """Ask a worker what it has."""
        try:
            found = self._client.run(dask_worker.inspect, self._message, workers=[node.address], on_error="return")
            answer = found[node.address]
            if isinstance(answer, str):
                answer = json.loads(answer)
                node.answer = {"shares_folder": bool(answer.get("shares_folder")), "problems": answer["problems"]}
            else:
                node.answer = {"shares_folder": False, "problems": [one_line(answer)]}
        except Exception as error:  # it has gone, or says what nobody understands
            node.answer = {"shares_folder": False, "problems": [one_line(error)]}
        if node.problems and not self._over.is_set():
            self._refuse(node, node.problems)

    def _refuse(self, node: WorkerNode, problems: list[str]) -> None:
        node.answer = {"shares_folder": False, "problems": problems}
        say(f"left out: {node.told}", err=True)

    def _hear(self, event: Any) -> None:
        """Return what a task says on the way; called by the client in a thread of its own."""
        with suppress(Exception):  # anybody may write to a topic
            content = event[1]
            said = json.loads(content["said"])
            self._heard[content["token"]] = (time.monotonic(), Status(**said["status"]))

    # Tasks -------------------------------------------------------------------------------------------------------

    def _send(self, task: Task, number: int, node: WorkerNode) -> RemoteTask:
        on_machine = sum(m.threads for m in self._nodes.values() if m.host == node.host)
        content = written(task)
        message = json.dumps({"task": content, "workers": on_machine})
        files = {} if node.shares_folder else self._models(content, node)
        token = f"{self.run}-{secrets.token_hex(8)}"
        future = self._client.submit(
            dask_worker.do, token, self.run, message, shares_folder=node.shares_folder, files=files, anew=node.anew,
            key=token, workers=[node.address], allow_other_workers=False, retries=0, pure=False,
        )  # fmt: skip
        node.anew = False
        remote = RemoteTask(task, number, node, future, self)
        self._running.append(remote)
        return remote

    def _models(self, content: Mapping[str, Any], node: WorkerNode) -> dict[str, bytes]:
        """Files of the models that a worker with another disk needs and has not got."""
        files: dict[str, bytes] = {}
        for job in content["jobs"]:
            for digest, model in job["models"].items():
                kind, name = model["place"]
                if kind == "results" and digest not in node.models:
                    node.models.add(digest)
                    root = self.store.root.parent
                    paths = [path for path in (root / name).rglob("*") if path.is_file()]
                    files |= {str(path.relative_to(root)): path.read_bytes() for path in paths}
        return files

    def heard(self, token: str) -> tuple[float, Status] | None:
        """Return when a task was heard of last, and how far it was."""
        return self._heard.get(token)

    def is_here(self, node: WorkerNode) -> bool:
        """Return whether a worker is still there, as far as the scheduler knows."""
        return self._nodes.get(node.address) is node

    def tell_to_stop(self, node: WorkerNode, token: str) -> None:
        """Let a task write down where it is, and end."""
        aside(lambda: self._client.run(dask_worker.stop, token, workers=[node.address], on_error="ignore"))

    def dismissed(self, remote: RemoteTask) -> None:
        """Nobody waits for this task any more."""
        if remote in self._running:
            self._running.remove(remote)
        self._heard.pop(remote.token, None)

    def keep(self, files: Mapping[str, bytes]) -> None:
        """Take what a task has sent into the results folder; an array that is damaged is noticed when it is read.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        for name, content in files.items():
            path = self.store.root.parent / name
            if dask_worker.FILE.fullmatch(name) and not name.startswith("models") and not path.exists():
                write_atomically(path, lambda file, content=content: file.write(content))  # type: ignore[misc]
