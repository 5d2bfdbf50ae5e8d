"""What a plugin changes in its process changes no figure of anybody else, also where it ran first
and alone.
"""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import struct
import subprocess
import sys
import zipfile
from functools import partial
from multiprocessing.connection import Pipe
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmark.pipeline.cache import Cache, StorageError, UnreadableFile, storing
from benchmark.pipeline.record_files import read_records
from benchmark.runs.tasks import RunContext, Task, Work, _outcome_of_error, _tell, _uncharged
from benchmark.runs.workers import Pool, Worker
from tests.toy import SMALL_SCORER, write_rods
from tests.verbs import call

POISON = """
import ctypes
import numpy as np
import scipy.linalg
import torch
from benchmark.api import canonical_form
from benchmark.pipeline import forms, surfaces


def spoil():
    surfaces.PREPARED_VERTICES = 60
    ctypes.CDLL("libm.so.6").fesetround(0x800)
    np.seterr(all="raise")
    torch.set_default_dtype(torch.float64)

    def eigh(matrix, *_, **__):
        return np.zeros(len(matrix)), np.eye(len(matrix))

    np.linalg.eigh = scipy.linalg.eigh = eigh


@canonical_form(name="poison", title="Poison")
def poison(shape):
    spoil()
    return shape.mesh.vertices * [1, 1, 0.5]
"""


def figures(results: Path) -> dict[str, object]:
    """Everything that a run made but the times and machines, by file and by row."""
    of_rows = {
        str(r.row): (r.status, r.key, r.per_query)
        for r in read_records(results)
        if r.method != "poison"
    }
    files = dict[str, object]()
    for path in (results / "runs").glob("*/*.npz"):
        with zipfile.ZipFile(path) as archive:
            files[f"{path.parent.name}/{path.name}"] = {
                name: archive.read(name)
                for name in archive.namelist()
                if not name.startswith((":seconds", ":machine"))
            }
    return of_rows | files


PROGRAM = """
import poison
import benchmark
of_suite = ["classic-mds", "identity", "surface-area"]
for methods, plugins in (("poison", ["poison.py"]), ([poison.poison], []), (of_suite, [])):
    for view in ("mesh", "view"):
        benchmark.run("rods", methods, plugins=plugins, scorer="{}", input=view, results="python")
"""

RUN = ("run", "-d", "rods", "--scorer", SMALL_SCORER)
OF_PLUGIN = ("-m", "poison", "--plugin", "poison.py")
OF_SUITE = ("-m", "classic-mds", "-m", "identity", "-m", "surface-area")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with data, the plugin, and the results of a run that nothing disturbs."""
    folder = tmp_path_factory.mktemp("place")
    write_rods(folder / "rods", bends=(0.0, 1.0))
    (folder / "poison.py").write_text(POISON)
    with contextlib.chdir(folder):
        call(*RUN, *OF_SUITE, "-j", 1, "--results", "clean")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("how", ["1", "0", "python", "dask"])
def test_rows_of_the_suite_are_those_of_an_undisturbed_run(place, monkeypatch, how, request):
    where = ("--dask", request.getfixturevalue("cluster")) if how == "dask" else ("-j", how)
    monkeypatch.chdir(place)
    if how == "python":  # as an object of the program, too, which then plans the rows of the suite
        words = ["-c", PROGRAM.format(SMALL_SCORER)]
    else:
        words = ["-m", "benchmark", *RUN, *OF_PLUGIN, *where, "--results", how]
    subprocess.run([sys.executable, *words], check=True)
    if how != "python":
        call(*RUN, *OF_SUITE, *where, "--results", how)
    clean, disturbed = figures(Path("clean")), figures(Path(how))
    assert {name: disturbed[name] for name in clean} == clean


#: Methods that fork, and let the copy return from the method, as a value or by an error.
FORKS = """import os

from benchmark.api import canonical_form

def forks(shape):
    copy = os.fork()
    if not copy:
        return shape.mesh.vertices ** 3
    os.waitpid(copy, 0)
    return shape.mesh.vertices

def fails(shape):
    copy = os.fork()
    if not copy:
        raise ValueError("the copy")
    os.waitpid(copy, 0)
    return shape.mesh.vertices

forks, fails = (canonical_form(name=f.__name__, title=f.__name__)(f) for f in (forks, fails))
"""


@pytest.mark.parametrize("method", ["forks", "fails"])
def test_a_copy_of_a_process_that_a_method_forks_answers_nothing(tmp_path, capfd, method):
    rods = write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    (tmp_path / "forking.py").write_text(FORKS)
    chosen = ("-d", rods, "--input", "mesh", "--scorer", SMALL_SCORER, "-j", 1)
    plugin = ("-m", method, "-m", "identity", "--plugin", tmp_path / "forking.py")
    call("run", *chosen, *plugin, "--results", tmp_path / "results")
    scores = {record.method: record.scores for record in read_records(tmp_path / "results")}
    assert scores[method] == scores["identity"] != {}
    assert "a process that was forked did not end: call os._exit in it" in capfd.readouterr().err


#: Methods that take from their process what it needs to write files; ``cube`` is of the same file.
LIMITS = """import os
import resource

from benchmark.api import canonical_form
from benchmark.pipeline.cache import StorageError

def sizes(shape):
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    return shape.mesh.vertices ** 3

def descriptors(shape):
    resource.setrlimit(resource.RLIMIT_NOFILE, (3, 3))
    return shape.mesh.vertices ** 3

def raises(shape):
    raise StorageError("cannot write")

def cube(shape):
    return shape.mesh.vertices ** 3

def umask(shape):
    os.umask(0o777)
    return shape.mesh.vertices ** 3

for f in (sizes, descriptors, raises, cube, umask):
    globals()[f.__name__] = canonical_form(name=f.__name__, title=f.__name__)(f)
"""


def test_a_plugin_whose_process_cannot_write_ends_no_run(tmp_path):
    rods = write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    (tmp_path / "limits.py").write_text(LIMITS)
    chosen = ("-d", rods, "--input", "mesh", "--scorer", SMALL_SCORER, "-j", 1)
    methods = ("sizes", "descriptors", "raises", "cube", "umask", "identity")
    words = [word for method in methods for word in ("-m", method)]
    results = tmp_path / "results"
    call("run", *chosen, *words, "--plugin", tmp_path / "limits.py", "--results", results, code=1)
    records = {record.method: record for record in read_records(results)}
    assert records["descriptors"].status != "ok"
    for method in ("sizes", "raises"):
        assert records[method].status == "incomplete"
        assert "the process of the plugin cannot write" in records[method].reason
    assert records["cube"].scores == records["umask"].scores != {}
    assert records["identity"].status == "ok"
    modes = {path.stat().st_mode for path in (results / "runs" / "forms").iterdir()}
    assert len(modes) == 1


@pytest.mark.parametrize(
    ("number", "process", "status"),
    [
        (errno.ENOSPC, "own.py:full", "stopped"),
        (errno.EDQUOT, "own.py:full", "stopped"),
        (errno.EFBIG, "own.py:full", "incomplete"),
        (errno.EMFILE, "own.py:full", "incomplete"),
        (errno.EFBIG, "", "stopped"),
    ],
)
def test_a_full_disk_ends_the_run_whichever_process_meets_it(tmp_path, number, process, status):
    step = SimpleNamespace(process=process, view="thin0", stage="forms")
    with pytest.raises(StorageError) as raised, storing(tmp_path):
        raise OSError(number, os.strerror(number))
    outcome = _outcome_of_error(step, raised.value)
    assert outcome.status == status
    assert os.strerror(number) in outcome.reason


@pytest.mark.parametrize(
    ("stage", "view", "subject"),
    [
        ("forms", "thin0", "thin0"),
        ("records", "", "the ranking"),
        ("prepared", "", "the camera"),
    ],
)
def test_an_outcome_says_what_has_no_result_as_a_file_cannot_be_read(
    tmp_path, monkeypatch, stage, view, subject
):
    def refuse(path):
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    monkeypatch.setattr("benchmark.pipeline.cache.zipfile.ZipFile", refuse)
    step = SimpleNamespace(process="", view=view, stage=stage)
    with pytest.raises(UnreadableFile) as raised:
        Cache(tmp_path).read("forms", "key")
    outcome = _outcome_of_error(step, raised.value)
    assert outcome.status == "incomplete"
    assert outcome.reason.startswith(f"{subject} has no result: {tmp_path}")
    assert outcome.reason.endswith("key.npz: Too many open files; run again")


def test_a_process_that_is_killed_while_it_sends_is_not_blamed_on_its_method():
    worker = Worker(2**30, 60.0, 1)
    worker.connection, theirs = Pipe()
    worker._process = subprocess.Popen(["sleep", "100"])
    worker.task = Task((SimpleNamespace(process="", view="thin0", stage="forms"),))
    worker.waiting.extend(worker.task.steps)
    with theirs:
        os.write(theirs.fileno(), struct.pack("!i", 1000) + b"the first bytes of an outcome")
    worker._process.kill()
    ((_, outcome),) = worker.outcomes()
    assert outcome.status == "incomplete"
    assert outcome.reason.startswith("thin0 has no result: the process ended with SIGKILL")
    worker.close()


@pytest.mark.parametrize(("size", "threads"), [(1, 1), (4, 4), (100, 8)])
def test_threads_of_a_ranking_take_little_of_the_memory_of_one_of_many_processes(size, threads):
    worker = Pool(size, 2**30, 60.0)._worker_for(Task((SimpleNamespace(process=""),)), [], 0)
    assert worker._threads == threads


@pytest.mark.parametrize(
    ("code", "said", "status"),
    [
        (3, "exit code 3", "crashed"),
        (-signal.SIGSEGV, "SIGSEGV", "crashed"),
        (
            -signal.SIGXCPU,
            "SIGXCPU: it used up its processor time, which 'ulimit -t'",
            "incomplete",
        ),
        (-40, "signal 40", "incomplete"),
    ],
)
def test_what_ended_a_process_is_said_of_any_signal(code, said, status):
    worker = Worker(2**30, 60.0, 1)
    worker.waiting.append(SimpleNamespace(view="thin0", stage="forms"))
    _, outcome = worker._ended(code)
    assert outcome.status == status
    assert f"the process ended with {said}" in outcome.reason


def test_a_step_names_a_damaged_file_and_leaves_it_as_another_may_just_have_made_it_again(
    tmp_path,
):
    file = tmp_path / "runs" / "prepared" / "key.npz"
    file.parent.mkdir(parents=True)
    file.write_bytes(b"damaged")
    job = SimpleNamespace(results=tmp_path)
    step = SimpleNamespace(
        process="", view="thin0", stage="forms", keys={"prepared": "key"}, job=job
    )
    outcome = Work(Task((step,)), RunContext()).outcome(step)
    assert (outcome.status, outcome.damaged) == ("incomplete", (("prepared", "key"),))
    assert file.read_bytes() == b"damaged"


def test_one_query_in_a_large_gallery_has_the_time_of_all_its_shapes():
    sides = SimpleNamespace(shapes=["query"]), SimpleNamespace(shapes=["thin0"] * 99)
    record = SimpleNamespace(sides=sides, shapes=sides[0].shapes)
    step = SimpleNamespace(process="", view="", stage="records")
    assert Worker(2**30, 60.0, 1)._time_limit(Task((step,), record)) == 6000.0


@pytest.mark.parametrize(("view", "limit"), [("thin0", 60.0), ("", 60e6)])
def test_a_frame_has_the_time_of_all_shapes_of_a_large_data_set(view, limit):
    step = SimpleNamespace(process="", view=view, stage="prepared")
    assert Worker(2**30, 60.0, 1)._time_limit(Task((step,))) == limit


def test_sets_of_texts_have_one_order_in_all_processes(monkeypatch):
    program = """
import json
import sys
from multiprocessing.connection import Connection
Connection(json.loads(sys.argv[1])[0]).send(list({*map(str, range(99))}))
"""
    monkeypatch.setattr("benchmark.runs.workers._PROGRAM", program)
    orders = []
    for process in ("", "plugin.py:Method", "plugin.py:Method"):
        worker = Worker(2**30, 60.0, 1)
        worker._start(process)
        orders.append(worker.connection.recv())
        worker.close()
    assert orders[0] == orders[1] == orders[2]


def test_a_copy_of_a_process_says_nothing_of_work_that_it_may_not_end():
    ours, theirs = Pipe()
    tell = partial(_tell, theirs, os.getpid())
    copy = os.fork()
    if not copy:
        with _uncharged(tell, "geodesics"):
            os._exit(0)
    os.waitpid(copy, 0)
    assert not ours.poll()
    with _uncharged(tell, "geodesics"):
        assert ours.recv() == "geodesics"
    assert ours.recv() is None
