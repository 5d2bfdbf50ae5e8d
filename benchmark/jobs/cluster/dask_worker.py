"""Functions that run inside a dask worker: they hand a task to a process of its own and pass on what that says.

Functions of this module are all that a dask cluster is sent; they take and return texts and bytes, never objects.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import shutil
import subprocess
import sys
import threading
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from benchmark.jobs.cluster.task_messages import SUITE
from benchmark.storage.store import Store

__all__ = ["FILE", "do", "forget", "inspect", "stop"]

#: Files that travel: arrays and records under the folder of runs, and models beside it.
FILE = re.compile(
    r"runs/(?:artefacts|scratch)/[0-9a-f]{2}/[0-9a-f]{32}\.npz|runs/records/[0-9a-f]{32}\.json|models(?:/(?!\.)[^/\0]+)+"
)

#: Seconds between two looks whether a task is still wanted.
_INTERVAL = 1.0

_running: dict[str, subprocess.Popen[bytes]] = {}
_sent: dict[str, set[str]] = {}


async def inspect(message: str) -> str:
    """Ask a process beside this dask worker what is here; see :func:`benchmark.jobs.cluster.supervisor.inspect`."""
    process = await asyncio.create_subprocess_exec(
        *_COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=_environment()
    )
    output, error = await process.communicate(message.encode() + b"\n")
    said = error.decode("utf-8", "replace").strip().splitlines()
    return output.decode("utf-8") or json.dumps({"problems": [said[-1] if said else "the suite cannot be started"]})


def do(
    token: str, run: str, message: str, *, shares_folder: bool, files: Mapping[str, bytes], anew: bool
) -> dict[str, Any]:
    """Do a task, telling under the topic of the run how far it is.

    Parameters
    ----------
    token
        Names the task.
    run
        Names the run, and the topic.
    message
        What :func:`benchmark.jobs.cluster.supervisor.do` takes.
    shares_folder
        Whether this machine sees the results folder of the run; where not, it keeps one of its own as long as the run
        lasts.
    files
        Models to put into the folder of its own first.
    anew
        Whether what was sent before may not have arrived.

    Returns
    -------
    dict
        ``answer``: the last words of the supervisor as JSON, "" if it left none. ``files``: what was made, by name;
        where the folder is shared, the records alone.
    """
    from distributed import get_worker

    here = get_worker()
    content = json.loads(message)
    results = Path(content["task"]["jobs"][0]["results"])
    if not shares_folder:
        results = Path(here.local_directory) / f"canonical-forms-{run}"
        for job in content["task"]["jobs"]:
            job["results"] = str(results)
        for name, each in files.items():
            if FILE.fullmatch(name):
                (results / name).parent.mkdir(parents=True, exist_ok=True)
                (results / name).write_bytes(each)
    if anew:
        _sent.pop(run, None)
    last = ""
    process = subprocess.Popen(_COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=_environment())
    _running[token] = process
    done = threading.Event()
    threading.Thread(target=_end_when_unwanted, args=(here, token, process, done), daemon=True).start()
    try:
        _write(process, json.dumps(content))
        for line in process.stdout or ():
            last = line.decode("utf-8")
            here.log_event(run, {"token": token, "said": last})
    finally:
        done.set()
        _running.pop(token, None)
        _close(process)
    keys = [job["key"] for job in content["task"]["jobs"]]
    names = [f"runs/records/{key}.json" for key in keys] if shares_folder else list(_made(results, run))
    return {"answer": last if "exit_code" in last else "", "files": dict(_contents(results, names))}


def stop(token: str) -> None:
    """Stop a task; its traceback comes with its result."""
    if (process := _running.get(token)) is not None:
        _write(process, "stop")


def forget(run: str, dask_worker: Any = None) -> None:
    """Remove what a run has left on the disk of this machine."""
    _sent.pop(run, None)
    shutil.rmtree(Path(dask_worker.local_directory) / f"canonical-forms-{run}", ignore_errors=True)


_COMMAND = (sys.executable, "-m", "benchmark.jobs.cluster.supervisor")


def _environment() -> dict[str, str]:
    """That of this process, in which the suite is found wherever this process has found it."""
    path = os.pathsep.join(part for part in (str(SUITE), os.environ.get("PYTHONPATH", "")) if part)
    return os.environ | {"PYTHONPATH": path}


def _write(process: subprocess.Popen[bytes], line: str) -> None:
    with suppress(OSError, ValueError):
        if process.stdin is not None:
            process.stdin.write(line.encode() + b"\n")
            process.stdin.flush()


def _close(process: subprocess.Popen[bytes]) -> None:
    """Let the process end with its input, and take its work along."""
    with suppress(OSError, ValueError):
        if process.stdin is not None:
            process.stdin.close()
    with suppress(subprocess.TimeoutExpired):
        process.wait(timeout=10)
    process.kill()
    process.wait()
    if process.stdout is not None:
        process.stdout.close()


def _end_when_unwanted(here: Any, token: str, process: subprocess.Popen[bytes], done: threading.Event) -> None:
    """Close the input of a task that the cluster has cancelled: its run is gone, or has given it to another worker."""
    while not done.wait(_INTERVAL):
        known = here.state.tasks.get(token)
        if known is None or known.state not in ("executing", "long-running"):
            with suppress(OSError, ValueError):
                if process.stdin is not None:
                    process.stdin.close()
            return


def _made(results: Path, run: str) -> Iterator[str]:
    """Files of a folder that have not been sent yet; generated meshes are not needed elsewhere and too large."""
    sent = _sent.setdefault(run, set())
    store = Store(results / "runs")
    for folder in (store.artefacts, store.scratch, store.records.folder):
        for path in sorted(folder.rglob("*.*")):
            name = str(path.relative_to(results))
            if FILE.fullmatch(name) and name not in sent and not (folder == store.scratch and _is_mesh(path)):
                sent.add(name)
                yield name


def _is_mesh(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return "vertices.npy" in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return True


def _contents(results: Path, names: list[str]) -> Iterator[tuple[str, bytes]]:
    for name in names:
        with suppress(OSError):
            yield name, (results / name).read_bytes()
