"""Processes that answer requests: what they return and raise, and what their end does."""

import faulthandler
import os
import signal
import subprocess
import sys
import threading
import time
from collections import UserDict

import numpy as np
import pytest

from benchmark.errors import BenchmarkError, UnsupportedShape
from benchmark.system.arrays import packed, unpacked
from benchmark.system.plugins import close_process, import_plugin
from benchmark.system.services import ForeignError, Service
from benchmark.system.text import DATA_VARIABLE
from benchmark.system.workers import Worker


class _TooThin(UnsupportedShape):
    """An error that only the other process knows."""


def serve(facts, arrays):
    match facts["work"]:
        case "double":
            return {"said": "doubled"}, {"numbers": 2 * arrays["numbers"]}
        case "environment":
            return {"data": os.environ.get(DATA_VARIABLE, "")}, {}
        case "refuse":
            raise _TooThin("too thin", "feed it")
        case "set an alarm":
            signal.signal(signal.SIGALRM, lambda number, frame: os._exit(4))
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
            signal.setitimer(signal.ITIMER_REAL, 0.2)
            faulthandler.dump_traceback_later(0.2, exit=True)
        case "wait":
            time.sleep(0.5)
            return {"defaults": [signal.getsignal(n) == signal.SIG_DFL for n in (signal.SIGALRM, signal.SIGTERM)]}, {}
        case "start a thread":
            threading.Thread(target=time.sleep, args=(600,), daemon=True).start()
        case "start a child":
            subprocess.Popen(["sleep", "600"])
        case "fail":
            raise ZeroDivisionError("by hand")
        case "leave":
            raise SystemExit(3)
        case "run out":
            raise MemoryError
        case "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "exit":
            os._exit(3)
    return {}, {}


def ask_until_the_end(work):
    Service(serve).request({"work": work}, {})


@pytest.fixture(scope="module")
def service():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(DATA_VARIABLE, "somewhere")
        made = Service(serve)
        made.request({"work": "environment"}, {})  # it has begun, with its own environment
    yield made
    made.send(signal.SIGKILL)


def test_arrays_come_back(service):
    told, found = service.request({"work": "double"}, {"numbers": np.arange(3.0)})
    assert told == {"said": "doubled"}
    assert found["numbers"].tolist() == [0, 2, 4]


def test_it_is_not_told_where_the_data_lies(service):
    assert service.request({"work": "environment"}, {})[0] == {"data": ""}


def test_what_it_raises_is_raised_here(service):
    with pytest.raises(UnsupportedShape, match="too thin; feed it"):
        service.request({"work": "refuse"}, {})
    with pytest.raises(ForeignError, match="ZeroDivisionError: by hand") as found:
        service.request({"work": "fail"}, {})
    assert "in serve" in found.value.trace
    with pytest.raises(ForeignError, match="SystemExit: 3"):
        service.request({"work": "leave"}, {})
    with pytest.raises(MemoryError):
        service.request({"work": "run out"}, {})


def test_timers_and_handlers_of_one_work_are_gone_before_the_next(service):
    service.request({"work": "set an alarm"}, {})
    told, _ = service.request({"work": "wait"}, {})
    assert told == {"defaults": [True, True]}


@pytest.mark.parametrize("work", ["start a thread", "start a child"])
def test_it_says_what_has_left_threads_or_processes(work, service):
    service.request({"work": "wait"}, {})
    assert not service.is_occupied
    service.request({"work": work}, {})
    assert service.is_occupied
    service.request({"work": "wait"}, {})
    assert not service.is_occupied  # they are those of the work before


@pytest.mark.parametrize(("work", "code"), [("crash", -signal.SIGSEGV), ("exit", 3)])
def test_whoever_asks_ends_as_it_ended(work, code):
    worker = Worker(ask_until_the_end, work, quiet=True)
    deadline = time.monotonic() + 60
    while worker.exit_code is None:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert worker.exit_code == code


def test_a_program_that_ends_waits_for_no_service():
    program = "from tests.system.test_services import Service, serve; print(Service(serve).request({'work': ''}, {}))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "({}, {})\n"


def test_messages_hold_no_objects():
    with pytest.raises(ValueError, match="Object arrays"):
        packed({}, {"numbers": np.array([UserDict()], dtype=object)})
    with pytest.raises(Exception, match=r"."):
        unpacked(b"anything")


def close_and_import(path):
    close_process(lambda spec: None)
    try:
        import_plugin(path)
    except AssertionError:
        os._exit(7)


def test_a_closed_process_imports_no_plugin(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text("x = 1\n")
    worker = Worker(close_and_import, str(path))
    while worker.exit_code is None:
        time.sleep(0.05)
    assert worker.exit_code == 7


def test_an_error_of_another_kind_is_plain():
    from benchmark.errors import from_facts

    assert type(from_facts({"kind": "one_line", "problem": "x", "hint": ""})) is BenchmarkError
