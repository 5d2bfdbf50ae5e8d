"""Workers that die at the wrong moment, or cannot be started: no job is blamed that did nothing, and nothing waits."""

import json
import signal
from dataclasses import replace

import pytest

from benchmark.errors import BenchmarkError
from benchmark.execution import pools, scheduler
from benchmark.execution.claims import Claims
from benchmark.execution.job_specs import Status, Task, to_json
from benchmark.execution.pools import UNWRITTEN, Running
from benchmark.execution.scheduler import Scheduler
from benchmark.pipeline.storage.store import StorageError, Store
from tests.execution.test_executors import orders
from tests.records import record

#: Key of the job that comes first.
FIRST = record(method="surface-area")["key"]

#: Ways for a task to go, each its last status and its exit code.
BORN_DEAD = (Status(), -signal.SIGKILL)
KILLED = (Status(FIRST, 1, "b"), -signal.SIGKILL)
CRASHED = (Status(FIRST, 1, "b"), -signal.SIGSEGV)
ENDED_WITH_0 = (Status(FIRST, 1, "b"), 0)
DONE = (Status(FIRST, 3), None)


class Scripted(Running):
    """A task that has gone in the way that is next in the script, its work done or not."""

    def __init__(self, task, fate):
        super().__init__(task)
        self.status, self.exit_code = fate
        self.is_finished = fate == DONE
        self.trace = "in a method"
        if self.is_finished and not task.identifiers:
            for job in task.jobs:
                Store.open(job.results).write_record(record(method=job.facts["method"]))


class ScriptedPool:
    """Does one task at a time by the script."""

    size, waits_for = 1, ""

    def __init__(self, script):
        self.script = list(script)

    def begin(self, task):
        fate = self.script.pop(0) if self.script else DONE
        if isinstance(fate, OSError):
            raise fate
        return Scripted(task, fate)

    def wait(self, running, look):
        pass

    def stop(self, running):
        assert isinstance(running, Silent | Importing)

    def end(self, running):
        pass


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run two jobs by a script; returns the status and the reason of each."""

    def run_(*script, timeout=None):
        monkeypatch.setattr(scheduler, "_PATIENCE", 0.0)
        told = ("gallery", "input", "method", "title", "family", "parameters", "data", "target")
        jobs = []
        for job in orders(tmp_path, ("surface-area", "identity")):
            made = record(method=job.method.name)
            facts = {name: made[name] for name in told}
            jobs.append(replace(job, key=made["key"], facts=facts, recipe=made["recipe"]))
        Store.open(tmp_path)
        with Claims(tmp_path) as claims:
            done = Scheduler(jobs, ScriptedPool(script), claims, timeout, lambda names, steps: None).records()
            return {job.method.name: found for job, found in done}

    return run_


def statuses(found):
    return {name: record["status"] for name, record in found.items()}


ALL_OK = {"surface-area": "ok", "identity": "ok"}


@pytest.mark.parametrize(
    "script",
    [
        (BORN_DEAD,),
        (BORN_DEAD,) * 5,
        (KILLED,),
        (KILLED, BORN_DEAD, BORN_DEAD),
        (CRASHED,),
        (DONE, (Status(FIRST), -signal.SIGSEGV)),
        ((Status(FIRST, 1, "b"), -signal.SIGTERM),),
        (OSError(11, "Resource temporarily unavailable"),) * 5,
        (DONE, BORN_DEAD, BORN_DEAD),
    ],
)
def test_a_death_that_is_nobodys_fault_costs_nobody_anything(run, script):
    assert statuses(run(*script)) == ALL_OK


def test_workers_that_never_begin_end_the_run_and_leave_no_record(run, tmp_path):
    with pytest.raises(BenchmarkError, match="6 consecutive processes did not start, the last because of SIGKILL; end"):
        run(*(BORN_DEAD,) * 6)
    assert list(Store.open(tmp_path).records.folder.iterdir()) == []


def test_a_system_that_starts_no_process_is_told_of_and_not_waited_for(run, tmp_path):
    with pytest.raises(BenchmarkError, match="the last because of Resource temporarily unavailable; end"):
        run(*(OSError(11, "Resource temporarily unavailable"),) * 6)
    assert list(Store.open(tmp_path).records.folder.iterdir()) == []


@pytest.mark.parametrize(
    ("script", "status", "reason"),
    [
        ((CRASHED, CRASHED), "crashed", "b: the process ended with SIGSEGV; run it with -j 0"),
        ((ENDED_WITH_0,) * 2, "crashed", "b: the process ended with exit code 0; run it with -j 0"),
        ((KILLED, KILLED), "killed", "b: the process was killed twice"),
    ],
)
def test_the_job_that_broke_its_worker_is_blamed_with_its_shape_and_place(run, script, status, reason):
    found = run(*script)
    assert statuses(found) == ALL_OK | {"surface-area": status}
    assert found["surface-area"]["reason"].startswith(reason)
    assert found["surface-area"]["traceback"] == "in a method"
    assert json.dumps(found)


@pytest.mark.parametrize("status", [Status(), Status(FIRST), Status(FIRST, 1, "b")])
def test_a_worker_that_could_not_write_costs_one_job_which_is_run_again(run, status):
    found = run((status, UNWRITTEN))
    assert sorted(statuses(found).values()) == ["ok", "unsaved"]
    assert not status.job or found["surface-area"]["status"] == "unsaved"
    assert all("could not be written; run again" in each["reason"] for each in found.values() if "reason" in each)


def test_a_disk_without_room_for_any_record_ends_the_run_with_its_name(run, tmp_path, monkeypatch):
    def write(self, record):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("benchmark.pipeline.storage.records.Records.write", write)
    with pytest.raises(StorageError, match=rf"under {tmp_path}.*: No space left on device; free some space"):
        run((Status(), UNWRITTEN))


@pytest.mark.parametrize(
    "error", [StorageError("cannot write a.json", "free some space"), OSError(28, "No space left")]
)
def test_a_worker_that_cannot_write_says_so_by_its_code(tmp_path, monkeypatch, error):
    def work(task, tell):
        raise error

    monkeypatch.setattr("benchmark.execution.pools.work", work)
    monkeypatch.setattr(pools, "close_to_plugins", lambda starting: None)  # this process has further tests to run
    assert pools.do_task({"task": to_json(Task(()))}, {}, None) == ({"code": UNWRITTEN}, {})


class Silent(Scripted):
    """A task that hangs before it says anything."""

    def __init__(self, task):
        super().__init__(task, (Status(), None))
        self.begun -= 1000


def test_a_process_that_hangs_before_it_says_anything_has_a_timeout(run, monkeypatch):
    begin, begun = ScriptedPool.begin, []
    monkeypatch.setattr(
        ScriptedPool, "begin", lambda pool, task: begin(pool, task) if begun else begun.append(task) or Silent(task)
    )
    assert sorted(statuses(run(timeout=10.0)).values()) == ["ok", "timeout"]


class Importing(Scripted):
    """A task whose plugin has been importing for some time."""

    def __init__(self, task, seconds):
        super().__init__(task, (Status(FIRST, is_starting=True), None))
        self.looked -= seconds


@pytest.mark.parametrize(("seconds", "stopped"), [(50, False), (75, True)])
def test_the_import_of_a_plugin_is_no_time_of_its_job_unless_it_does_not_end(run, monkeypatch, seconds, stopped):
    begin, begun = ScriptedPool.begin, []

    def begin_importing(pool, task):
        if not begun:
            begun.append(Importing(task, seconds))
            return begun[0]
        return begin(pool, task)

    def wait(pool, running, look):
        if begun[0] in running and begun[0].starting:  # somebody has looked at it: the import ends
            begun[0].status, begun[0].exit_code = DONE[0], -signal.SIGKILL

    monkeypatch.setattr(ScriptedPool, "begin", begin_importing)
    monkeypatch.setattr(ScriptedPool, "wait", wait)
    found = run(timeout=10.0)
    assert statuses(found) == ALL_OK | ({"surface-area": "timeout"} if stopped else {})
    if stopped:
        assert "importing the plugin does not end: stopped after 70 s" in found["surface-area"]["reason"]


def test_a_folder_in_which_no_worker_can_tell_how_far_it_is_is_named_before_one_is_started(run, tmp_path, monkeypatch):
    monkeypatch.setattr("os.access", lambda path, mode: path != tmp_path / "runs" / "progress")
    with pytest.raises(StorageError, match=f"cannot write to {tmp_path}/runs/progress; change its permissions"):
        run(OSError("a worker was started"))
