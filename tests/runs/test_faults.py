"""Methods that crash, hang or run out of memory lose one job, never the run."""

from __future__ import annotations

import os
import shutil
import signal
import sys
import time
from contextlib import suppress
from itertools import chain, repeat
from pkgutil import resolve_name
from types import SimpleNamespace
from unittest.mock import DEFAULT, Mock

import numpy as np
import psutil
import pytest

from benchmark.errors import BenchmarkError
from benchmark.pipeline.record_arrays import read_distances
from benchmark.pipeline.record_files import read_records
from benchmark.registry.modules import load_module
from benchmark.runs.runner import run_jobs
from benchmark.runs.workers import Worker
from tests.registry.plugin import write_plugin
from tests.runs.toy import FAULTS, done, noted, planned, run_toy
from tests.toy import PATIENCE, wait_for
from tests.verbs import call

FAULTY = (
    "fine",
    "bug",
    "exits",
    "os-exit",
    "segfault",
    "hang",
    "memory",
    "nan",
    "picky",
    "refuses",
    "first-three",
    "last-three",
    "noisy",
)


def line_of(code: str) -> int:
    """Return the number of the line of the plugin that has this code alone."""
    lines = [line.strip() for line in FAULTS.read_text().splitlines()]
    return lines.index(code) + 1


#: Status and reason of each.
ENDINGS = {
    "bug": (
        "failed",
        f"thick0: faults.py:{line_of('return 1 / 0')}: ZeroDivisionError: division by zero",
    ),
    "exits": ("failed", f"thick0: faults.py:{line_of('sys.exit(3)')}: SystemExit: 3"),
    "os-exit": ("crashed", "thick0: the process ended with exit code 3"),
    "segfault": ("crashed", "thick0: the process ended with SIGSEGV"),
    "hang": ("timeout", "thick0: stopped after 20 s; pass a longer --timeout"),
    "memory": (
        "memory",
        "thick0: out of memory; run with fewer jobs (-j 1) or on a larger machine",
    ),
    "nan": ("failed", "thick0: faults.py: method 'nan' returned no canonical form"),
}


NAMED = """
from dataclasses import dataclass
from typing import ClassVar
import numpy as np
from benchmark.api import ScorerInfo


@dataclass(frozen=True, kw_only=True)
class Named:
    info: ClassVar[ScorerInfo] = ScorerInfo(name="named", title="Named")

    def signature(self, form):
        return {"seconds": np.ones(1), "refused": np.array([form.area]), "machine": np.zeros(1)}

    def compare(self, signatures, draw):
        areas = np.array([one["refused"][0] * one["seconds"][0] for one in signatures])
        return abs(areas[:, None] - areas)
"""


SHARING = """
from benchmark.api import canonical_form
SCALE = [1, 1, 1]

@canonical_form(name="first", title="First")
def first(shape):
    SCALE[2] = 9
    return shape.mesh.vertices

@canonical_form(name="second", title="Second")
def second(shape):
    return shape.mesh.vertices * SCALE
"""


@pytest.fixture(scope="module")
def faulty(rods, tmp_path_factory):
    """The records of a run of all faults, and the notes of the methods."""
    folder = tmp_path_factory.mktemp("faults")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FAULTS", str(folder))
        patch.setattr("benchmark.runs.runner.memory_per_process", lambda processes=1: 3 * 2**29)
        records = run_toy(
            rods, folder / "results", *FAULTY, size=2, timeout=20.0, plugins=(FAULTS,)
        )
    return records, folder


@pytest.mark.slow
@pytest.mark.parametrize("name", ENDINGS)
def test_a_fault_ends_its_job_and_says_where(faulty, name):
    record, (status, reason) = faulty[0][name], ENDINGS[name]
    first = {"thick0", "thin0", "thick1", "thin1"}  # which shape is first depends on the workers
    shape, _, rest = record.reason.partition(": ")
    assert (record.status, rest.startswith(reason.partition(": ")[2]), shape in first) == (
        status,
        True,
        True,
    ), record


@pytest.mark.slow
def test_a_method_that_writes_into_the_connection_of_its_process_does_not_hang_the_run(faulty):
    record = faulty[0]["noisy"]
    assert record.status == "crashed"
    assert "closed the connection to the run, or sent what is no outcome" in record.reason


@pytest.mark.slow
def test_the_others_are_scored_and_a_refused_shape_counts_as_zero(faulty):
    records = faulty[0]
    assert records["fine"].status == records["picky"].status == "ok"
    assert records["picky"].unsupported == [("thick1", "too bent; straighten it")]
    assert records["picky"].coverage == 0.75
    index = records["picky"].shapes.index("thick1")
    assert {
        name: values[index] for name, values in records["picky"].per_query.items()
    } == dict.fromkeys(records["picky"].scores, 0.0)
    assert {record.method for record in read_records(faulty[1] / "results")} == set(FAULTY)
    assert "in bug\n    return 1 / 0" in records["bug"].traceback


@pytest.mark.slow
def test_a_method_that_refuses_all_shapes_has_no_scores_and_one_that_refuses_most_has(
    faulty,
):
    assert (faulty[0]["refuses"].status, len(faulty[0]["refuses"].shapes)) == ("unsupported", 4)
    assert faulty[0]["refuses"].reason == "none of 4 shapes could be processed; thick0: not today"
    assert faulty[0]["first-three"].scores == faulty[0]["last-three"].scores
    assert faulty[0]["first-three"].coverage == faulty[0]["last-three"].coverage == 0.25


@pytest.mark.slow
def test_children_of_a_stopped_method_end(faulty):
    processes = [int(line) for line in (faulty[1] / "hang").read_text().split()]
    assert processes
    wait_for(lambda: not any(map(psutil.pid_exists, processes)))


@pytest.mark.slow
def test_failed_jobs_run_again_only_when_asked(rods, faulty):
    results = faulty[1] / "results"
    for rerun, runs in (
        ((), False),
        (("failed",), True),
        (("finished", "failed"), True),
        (("finished",), False),
    ):
        (job,) = planned(rods, results, "bug", plugins=(FAULTS,), rerun=rerun)
        assert (job.is_pending, job.state) == (runs, "failed")


def test_a_worker_killed_from_outside_is_replaced_busy_or_idle(pair, tmp_path, monkeypatch):
    monkeypatch.setenv("FAULTS", str(tmp_path))
    killed = []

    def kill(progress):
        if not killed and (tmp_path / "waits-once").is_file():
            killed.extend(noted(tmp_path / "waits-once"))
            os.kill(killed[0], 9)

    jobs = planned(pair, tmp_path / "results", "waits-once", "slow", plugins=(FAULTS,))
    records = {}
    for record in run_jobs(jobs, tmp_path / "results", size=1, timeout=60, watch=kill):
        records[record.method] = record
        for child in psutil.Process().children():
            with suppress(psutil.ZombieProcess):  # it was killed before
                if "benchmark.runs.tasks" in " ".join(child.cmdline()):
                    child.kill()  # it is idle, or begins to rank
    assert killed
    assert {record.status for record in records.values()} == {"ok"}
    assert len(records) == 2


def test_an_interruption_of_all_processes_and_a_pause_of_the_machine_fail_no_method(
    pair, tmp_path, monkeypatch
):
    monkeypatch.setenv("FAULTS", str(tmp_path))
    pauses = []
    clock = SimpleNamespace(monotonic=lambda: time.monotonic() + sum(pauses))
    monkeypatch.setattr("benchmark.runs.workers.time", clock)

    def disturb(progress):
        if not pauses and (tmp_path / "slow").is_file():
            os.kill(noted(tmp_path / "slow")[0], signal.SIGINT)
            pauses.append(10 * PATIENCE)  # the clock goes on while the machine is paused

    jobs = planned(pair, tmp_path / "results", "slow", plugins=(FAULTS,))
    (record,) = run_jobs(jobs, tmp_path / "results", size=1, timeout=PATIENCE, watch=disturb)
    assert pauses
    assert (record.status, record.reason) == ("ok", "")
    assert len(noted(tmp_path / "slow")) == 3


def test_what_cannot_be_prepared_is_refused_for_all_and_named_once(rods, tmp_path, capsys):
    folder = shutil.copytree(rods, tmp_path / "rods")
    (folder / "thin2.off").write_text("OFF\n3 1 0\n0 0 0\n")
    records = run_toy(folder, tmp_path / "results", "identity", "surface-area", input=None)
    for record in records.values():
        assert (record.status, record.unprepared, record.coverage) == ("ok", ["thin2"], 0.8)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("thin2: not a readable off file")
    assert line.endswith(f"({folder / 'thin2.off'})")


#: Tables of what the light scorer ranked.
TABLES = ("tables", "--scorer", "light", "--results")

DAMAGED = {
    "cut": "OFF\n3 1 0\n0 0 0\n",
    "points": "OFF\n4 0 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n",
    "nan": "OFF\n3 1 0\n0 0 nan\n1 0 0\n0 1 0\n3 0 1 2\n",
    "flat": "OFF\n3 1 0\n0 0 0\n1 0 0\n2 0 0\n3 0 1 2\n",
    "empty": "",
}


@pytest.mark.parametrize("text", DAMAGED.values(), ids=DAMAGED.keys())
def test_a_reason_that_is_kept_for_a_content_names_no_file_and_whoever_prints_it_does(
    rods, tmp_path, capsys, text
):
    results = tmp_path / "results"
    reasons = []
    for folder, name in (("one", "thin2"), ("two", "thin3")):
        data = shutil.copytree(rods, tmp_path / folder / "rods")
        (data / f"{name}.off").write_text(text)
        (record,) = run_toy(data, results, "identity").values()
        ((shape, reason),) = record.unsupported
        assert shape == name
        reasons.append(reason)
        for line in capsys.readouterr().err.splitlines():  # none where the content is known
            assert line.startswith(f"{name}: ")
            assert line.endswith(f"({data / name}.off)")
    assert reasons[0] == reasons[1]
    assert str(tmp_path) not in reasons[0]
    assert "thin" not in reasons[0]
    for format in ("markdown", "latex"):
        printed = call(*TABLES, results, "--format", format)
        assert str(tmp_path) not in printed.replace(str(tmp_path / "two" / "rods"), "")
    assert reasons[0].partition("; ")[0] in " ".join(call(*TABLES, results).split())


def test_a_method_names_no_shape_in_a_reason_that_is_kept(rods, tmp_path):
    refuses = (
        "def canonicalise(self, shape):\n"
        "        from benchmark.api import UnsupportedShape\n"
        "        raise UnsupportedShape(f'{shape.identifier}: too thin', 'feed it')"
    )
    plugin = write_plugin(tmp_path / "smooth.py", methods=refuses)
    jobs = planned(rods, tmp_path, "smooth", plugins=(plugin,))
    (record,) = done(jobs, tmp_path).values()
    assert record.reason == "none of 4 shapes could be processed; thick0: too thin; feed it"


WRITES = (
    "def describe(self, shape):\n        return [shape.source_area]\n\n"
    "    def distances(self, descriptors):\n"
    "        descriptors[0][0] = 0"
)


def test_a_descriptor_that_writes_into_its_input_fails(rods, tmp_path):
    plugin = write_plugin(tmp_path / "smooth.py", methods=WRITES)
    (record,) = run_toy(rods, tmp_path / "results", "smooth", plugins=(plugin,)).values()
    reason = "smooth.py:22: ValueError: assignment destination is read-only"
    assert (record.status, reason in record.reason) == ("failed", True), record.reason


def test_no_key_of_a_method_is_that_of_a_solver_and_no_fault_of_a_method_takes_a_shape_from_others(
    rods, tmp_path
):
    methods = ("alters", "misreads", "needs-geodesics", "surface-area")
    records = run_toy(rods, tmp_path / "results", *methods, plugins=(FAULTS,))
    alone = run_toy(rods, tmp_path / "alone", "needs-geodesics", plugins=(FAULTS,))[
        "needs-geodesics"
    ]
    assert {name: record.status for name, record in records.items()} == dict.fromkeys(
        methods, "ok"
    ) | {"misreads": "incomplete"}
    assert records["needs-geodesics"].per_query == alone.per_query
    replaces = records["alters"]
    assert replaces.processor_seconds["canonicalise"] < 0.1 < replaces.seconds["canonicalise"]
    assert "geodesics" not in replaces.seconds


def test_a_method_changes_nothing_of_another_one_of_its_file(rods, tmp_path):
    plugins = (tmp_path / "own.py",)
    plugins[0].write_text(SHARING)
    alone = run_toy(rods, tmp_path / "alone", "second", plugins=plugins)["second"]
    both = run_toy(rods, tmp_path / "both", "first", "second", plugins=plugins, size=1)["second"]
    np.testing.assert_array_equal(
        read_distances(tmp_path / "alone", alone), read_distances(tmp_path / "both", both)
    )


def test_arrays_of_a_scorer_may_have_any_name(rods, tmp_path):
    (tmp_path / "named.py").write_text(NAMED)
    plugins = (tmp_path / "named.py",)
    record = run_toy(rods, tmp_path / "results", "identity", scorer="named", plugins=plugins)[
        "identity"
    ]
    assert (record.status, record.coverage) == ("ok", 1.0)


PREPARATION, GEODESICS = (
    "benchmark.pipeline.prepared:prepare_mesh",
    "benchmark.geometry.geodesics:all_pairs",
)
READING, UNREADABLE = "benchmark.formats.reading:read_unpacked", OSError(5, "Input/output error")


@pytest.fixture(scope="module")
def pair(rods, tmp_path_factory):
    """The fewest rods that can be ranked: each process that ends costs another start of one."""
    folder = tmp_path_factory.mktemp("pair") / "rods"
    return shutil.copytree(rods, folder, ignore=shutil.ignore_patterns("thin1*"))


@pytest.fixture
def failing(pair, tmp_path, monkeypatch):
    """Return a function that runs two methods while a function raises an error, or ends its
    process, so many times.
    """
    monkeypatch.setenv("FAULTS", str(tmp_path))
    (tmp_path / "sitecustomize.py").write_text("import tests.runs.injection\n")

    def run_failing(function, how, times):
        options = {
            "size": int(isinstance(how, str)),
            "timeout": 8.0 if how == "sleep" else 60.0,
            "plugins": (FAULTS,),
        }
        with monkeypatch.context() as patch:
            if options["size"]:
                patch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
                patch.setenv("FAILS", f"{function.replace(':', ' ')} {how} {times}")
            else:
                effects = chain(repeat(how, times), repeat(DEFAULT))
                failing = Mock(wraps=resolve_name(function), side_effect=effects)
                patch.setattr(function.replace(":", "."), failing)
            return run_toy(pair, tmp_path / "results", "needs-geodesics", "fine", **options)

    return run_failing


@pytest.mark.parametrize(
    ("function", "how"),
    [
        (PREPARATION, MemoryError()),
        (GEODESICS, MemoryError()),
        (READING, UNREADABLE),
        *(
            pytest.param(*fault, marks=pytest.mark.slow)
            for fault in [
                (PREPARATION, "sleep"),
                (PREPARATION, "kill"),
                (GEODESICS, "sleep"),
                (GEODESICS, "kill"),
                ("retrieval.measures:score_draws", "kill"),
            ]
        ),
    ],
)
def test_a_result_that_is_missing_for_a_passing_reason_is_tried_again_in_the_same_run(
    undisturbed, failing, function, how
):
    records = failing(function, how, times=1)
    assert {
        name: (record.status, record.per_query) for name, record in records.items()
    } == undisturbed


@pytest.fixture(scope="module")
def undisturbed(pair, tmp_path_factory):
    records = run_toy(
        pair, tmp_path_factory.mktemp("quiet"), "needs-geodesics", "fine", plugins=(FAULTS,)
    )
    return {name: (record.status, record.per_query) for name, record in records.items()}


@pytest.mark.parametrize(
    ("function", "how", "reason"),
    [
        pytest.param(
            *(
                PREPARATION,
                "kill",
                "thick0 has no result: its preparation: the process ended with SIGKILL",
            ),
            marks=pytest.mark.slow,
        ),
        (GEODESICS, MemoryError(), "thick0 has no geodesics: out of memory"),
        (READING, UNREADABLE, "Input/output error"),
    ],
)
def test_it_leaves_jobs_incomplete_without_scores_until_the_next_run(
    undisturbed, pair, tmp_path, failing, function, how, reason
):
    results = tmp_path / "results"
    records = failing(function, how, times=99)
    if function == GEODESICS:
        fine = records.pop("fine")  # it needs none
        assert (fine.status, fine.per_query) == undisturbed["fine"]
    assert {(record.status, bool(record.scores)) for record in records.values()} == {
        ("incomplete", False)
    }
    assert all(
        reason in record.reason and record.reason.count("run again") == 1
        for record in records.values()
    )
    jobs = planned(pair, results, "needs-geodesics", "fine", plugins=(FAULTS,))
    assert {job.record.method for job in jobs if job.is_pending} >= records.keys()
    done(jobs, results)
    records = {record.method: (record.status, record.per_query) for record in read_records(results)}
    assert records == undisturbed
    assert not any(
        job.is_pending
        for job in planned(pair, results, "needs-geodesics", "fine", plugins=(FAULTS,))
    )


def test_geodesics_without_memory_are_given_up_for_all_methods_that_declare_them(
    pair, tmp_path, monkeypatch
):
    failing = Mock(side_effect=MemoryError())
    monkeypatch.setattr("benchmark.geometry.geodesics.all_pairs", failing)
    records = run_toy(pair, tmp_path, "classic-mds", "non-metric-mds", "gps")
    assert {name: record.status for name, record in records.items()} == {
        "classic-mds": "incomplete",
        "non-metric-mds": "incomplete",
        "gps": "ok",
    }
    # Each method tries once, and the first one for the second time.
    assert failing.call_count == 3 * len(records["gps"].shapes)


def test_a_system_without_the_libraries_of_pymeshlab_ends_the_run_with_the_remedy(
    rods, tmp_path, monkeypatch
):
    monkeypatch.setitem(sys.modules, "pymeshlab", None)
    with pytest.raises(
        BenchmarkError, match=r"pymeshlab cannot be imported: .*; on Debian and Ubuntu: apt-get"
    ):
        run_toy(rods, tmp_path / "results", "identity")
    assert not read_records(tmp_path / "results")


def test_what_a_plugin_sets_in_the_environment_reaches_no_other_process(tmp_path, monkeypatch):
    monkeypatch.setenv("OF_USER", "before")
    load_module(
        str(write_plugin(tmp_path / "own.py", imports="import os\nos.environ['OF_USER'] = 'after'"))
    )
    worker = Worker(2**32, 1, 1)
    worker._start("own")
    assert worker.connection.poll(60)  # it runs: before, its environment may not be readable
    assert psutil.Process(worker._process.pid).environ()["OF_USER"] == "before"
    worker.close()
