"""A process does several tasks of the suite's own in turn; what may have harmed it does one."""

import os
import signal
import time

import psutil
import pytest

from benchmark.execution.job_specs import Job, Task
from benchmark.execution.pools import LocalPool
from benchmark.pipeline.storage.store import Store
from tests.execution.test_executors import orders
from tests.processes import is_alive, wait_until


class ForeignJob(Job):
    """A job that code of somebody else makes a part of."""

    is_foreign = True


@pytest.fixture
def pool(tmp_path):
    Store.open(tmp_path)
    with LocalPool(1) as made:
        yield made


@pytest.fixture
def do(pool, tmp_path):
    """Let the pool rank a method, which leaves a record in any case; returns the number of the process."""

    def done(name, kind=Job):
        (job,) = orders(tmp_path, (name,))
        running = pool.begin(Task((kind(**vars(job)),)))
        deadline = time.monotonic() + 60
        while not running.has_ended:
            assert time.monotonic() < deadline, "waited in vain"
            pool.wait([running], lambda: None)
        assert running.is_finished
        assert (tmp_path / "runs" / "records" / f"{job.key}.json").is_file()
        return running.worker._process.pid

    return done


def test_a_process_does_the_tasks_of_its_package_in_turn_and_ends_with_the_pool(pool, do):
    first = do("identity")
    assert do("fast-mds") == first
    assert is_alive(first)
    other = do("learned")
    assert other != first, "another package"
    assert not is_alive(first), "and there are never more of them than workers"
    pool.close()
    assert not is_alive(other)


def test_processes_that_are_over_hold_no_file_open(do):
    for _ in range(2):
        do("identity", ForeignJob)
    before = psutil.Process().num_fds()
    for _ in range(3):
        do("identity", ForeignJob)
    assert psutil.Process().num_fds() == before


def test_a_process_that_died_while_it_waited_is_replaced(do):
    first = do("identity")
    os.kill(first, signal.SIGKILL)
    wait_until(lambda: not is_alive(first))
    assert do("fast-mds") != first
