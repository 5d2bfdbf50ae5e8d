"""A process for one task: it ends with its task, whatever that leaves, and takes along what it has started."""

import _thread
import atexit
import builtins
import ctypes
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from multiprocessing.connection import wait

import psutil
import pytest

from benchmark.system.calls import BrokenCall, Guard, call_apart
from benchmark.system.workers import Worker

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks for processes as Linux keeps them")


def leaves_a_thread():
    threading.Thread(target=time.sleep, args=(600,)).start()


def leaves_a_handler_that_hangs():
    atexit.register(time.sleep, 600)


def leaves_a_handler_that_crashes():
    atexit.register(ctypes.string_at, 0)


def ends_in_the_middle():
    os._exit(0)


def breaks_what_all_rely_on():
    builtins.isinstance = None
    raise ValueError("by hand")


def fills_a_limit():
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
    return "x" * 5000


def nothing():
    return None


def starts_others(notes):
    """In a session of their own, before and after a process of its own has come and gone."""
    before = subprocess.Popen(["sleep", "600"], start_new_session=True).pid
    call_apart(nothing, guard=Guard("this", "correct it"))
    after = subprocess.Popen(["sleep", "600"], start_new_session=True).pid
    notes.write_text(f"{before} {after}")


@pytest.mark.parametrize(
    "task", [leaves_a_thread, leaves_a_handler_that_hangs, leaves_a_handler_that_crashes, ends_in_the_middle]
)
def test_its_end_is_noticed_at_once(task):
    worker = Worker(task)
    try:
        assert wait([worker.sentinel], timeout=30)
        wait_until(lambda: worker.exit_code is not None)
        assert worker.exit_code == 0
    finally:
        worker.end()


def test_what_it_started_ends_with_it(tmp_path):
    worker = Worker(starts_others, tmp_path / "notes")
    assert wait([worker.sentinel], timeout=30)
    children = [int(word) for word in (tmp_path / "notes").read_text().split()]
    assert all(map(is_alive, children))
    worker.end()
    wait_until(lambda: not any(map(is_alive, children)))
    assert [child for child in children if is_alive(child)] == []


def test_an_interrupt_before_it_starts_is_one(monkeypatch):
    monkeypatch.setattr("multiprocessing.process.BaseProcess.start", lambda _: signal.raise_signal(signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        Worker(time.sleep, 600)


# Sent to this thread, which blocks it, or heard by another one, which does not: never to the process, of whose threads
# any may hear of it, even after the test.
@pytest.mark.parametrize("interrupt", [signal.raise_signal, _thread.interrupt_main])
def test_an_interrupt_while_it_starts_leaves_no_process(monkeypatch, interrupt):
    started = []
    original = multiprocessing.get_context("spawn").Process.start

    def start(process):
        original(process)
        started.append(process.pid)
        interrupt(signal.SIGINT)

    monkeypatch.setattr("multiprocessing.process.BaseProcess.start", start)
    with pytest.raises(KeyboardInterrupt):
        Worker(time.sleep, 600)
    wait_until(lambda: not is_alive(started[0]))
    assert not is_alive(started[0])


def test_one_that_can_say_nothing_ends_without_a_traceback(capfd):
    worker = Worker(breaks_what_all_rely_on)
    assert wait([worker.sentinel], timeout=30)
    wait_until(lambda: worker.exit_code is not None)
    assert worker.exit_code == 1
    assert capfd.readouterr().err == ""


def test_an_answer_that_cannot_be_written_is_no_fault_of_the_function():
    with pytest.raises(BrokenCall, match=r"the answer of this could not be written to .*; make room there, raise the"):
        call_apart(fills_a_limit, guard=Guard("this", "correct it"))


def test_a_program_that_is_watched_ends_without_a_warning():
    program = "from benchmark.system import process_reaper; process_reaper.token()"
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, check=True)
    assert done.stderr == ""


def wait_until(condition):
    """Wait for what comes at once, or not at all."""
    deadline = time.monotonic() + 10
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.02)


def is_alive(process):
    return psutil.pid_exists(process) and psutil.Process(process).status() != psutil.STATUS_ZOMBIE
