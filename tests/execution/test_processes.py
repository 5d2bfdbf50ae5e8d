"""A process beside this one: what it answers and asks, what ends it, and what it takes along when it ends."""

import _thread
import atexit
import builtins
import ctypes
import faulthandler
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections import UserDict
from functools import partial

import numpy as np
import pytest

from benchmark.errors import BenchmarkError, UnsupportedShape
from benchmark.execution.processes import process as processes
from benchmark.execution.processes.calls import BrokenCall, call_apart
from benchmark.execution.processes.channel import Channel
from benchmark.execution.processes.process import ForeignError, Process, ProcessEnded
from benchmark.plugins import close_process
from benchmark.plugins.modules import import_module
from benchmark.text import DATA_VARIABLE
from tests.processes import is_alive, wait_until

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks for processes as Linux keeps them")


class _TooThin(UnsupportedShape):
    """An error that only the other process knows."""


def serve(facts, arrays, tell):
    match facts.get("work"):
        case "double":
            return {"said": "doubled"}, {name: 2 * array for name, array in arrays.items()}
        case "tell":
            tell(["half"])
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
        case "hang":
            time.sleep(600)
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
        case "claim":
            raise ProcessEnded(256)
        case "return objects":
            return {}, {"numbers": np.array([UserDict()], dtype=object)}
    return {}, {}


def ask_another(work, facts, arrays, tell):
    Process(serve).request({"work": work})


@pytest.fixture(scope="module")
def process():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(DATA_VARIABLE, "somewhere")
        made = Process(serve, is_plugin=True)
        made.request({"work": "environment"})  # it has begun, with its own environment
    yield made
    made.end()


@pytest.fixture
def own_process():
    made = Process(serve)
    yield made
    made.end()


# Requests ------------------------------------------------------------------------------------------------------------


def test_arrays_come_back_bit_for_bit_in_their_order(process):
    sent = {
        "c": np.arange(6.0).reshape(2, 3), "f": np.asfortranarray(np.arange(6).reshape(2, 3)), "none": np.zeros((0, 3)),
        "scalar": np.array(3.5), "strided": np.arange(10)[::3],
    }  # fmt: skip
    told, found = process.request({"work": "double"}, sent)
    assert told == {"said": "doubled"}
    for name, array in sent.items():
        assert np.array_equal(found[name], 2 * array)
        assert found[name].dtype == array.dtype
        assert found[name].flags.writeable
    assert found["f"].flags.f_contiguous


def test_it_tells_how_far_it_is(process):
    told = []
    process.request({"work": "tell"}, progress=told.append)
    assert told == [["half"]]


def test_a_plugin_is_not_told_where_the_data_lies(process):
    assert process.request({"work": "environment"})[0] == {"data": ""}


def test_what_it_raises_is_raised_here(process):
    with pytest.raises(UnsupportedShape, match="too thin; feed it"):
        process.request({"work": "refuse"})
    with pytest.raises(ForeignError, match="ZeroDivisionError: by hand") as found:
        process.request({"work": "fail"})
    assert "in serve" in found.value.trace
    with pytest.raises(ForeignError, match="SystemExit: 3"):
        process.request({"work": "leave"})
    with pytest.raises(MemoryError):
        process.request({"work": "run out"})
    with pytest.raises(ForeignError, match="an array of objects cannot be sent"):
        process.request({"work": "return objects"})


def test_timers_and_handlers_of_one_work_are_gone_before_the_next(process):
    process.request({"work": "set an alarm"})
    told, _ = process.request({"work": "wait"})
    assert told == {"defaults": [True, True]}


@pytest.mark.parametrize("work", ["start a thread", "start a child"])
def test_it_says_what_has_left_threads_or_processes(work, process):
    process.request({"work": "wait"})
    assert not process.is_occupied
    process.request({"work": work})
    assert process.is_occupied
    process.request({"work": "double"})
    assert not process.is_occupied  # they are those of the work before


def test_one_that_crashes_says_where_also_to_whoever_asked_the_one_that_asked_it(own_process):
    with pytest.raises(ProcessEnded) as found:
        own_process.request({"work": "crash"})
    assert found.value.code == -signal.SIGSEGV
    assert "in serve" in own_process.trace
    for work, code in (("crash", -signal.SIGSEGV), ("exit", 3)):
        with pytest.raises(ProcessEnded) as found:
            Process(partial(ask_another, work), quiet=True).request({})
        assert found.value.code == code


def test_no_process_can_claim_an_end_that_it_cannot_have(own_process):
    """Codes from 256 on belong to the suite, for such as a full disk."""
    with pytest.raises(ProcessEnded) as found:
        own_process.request({"work": "claim"})
    assert found.value.code == 1


def test_one_that_hangs_is_stopped_and_says_where_it_was(own_process):
    own_process.request({})
    with pytest.raises(TimeoutError):
        own_process.request({"work": "hang"}, limit=0.2)
    own_process.stop()
    assert own_process.exit_code == -signal.SIGKILL
    assert "in serve" in own_process.trace


def test_one_without_a_request_leaves_after_a_while():
    made = Process(serve, idle=0.1)
    wait_until(lambda: made.exit_code is not None)
    assert made.exit_code == 0
    made.end()


def test_a_program_that_ends_waits_for_no_process():
    program = "from tests.execution.test_processes import Process, serve; print(Process(serve).request({}))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "({}, {})\n"


def import_into_closed(path, facts, arrays, tell):
    close_process()
    try:
        import_module(path)
    except AssertionError:
        os._exit(7)


def test_a_closed_process_imports_no_plugin(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text("x = 1\n")
    with pytest.raises(ProcessEnded) as found:
        Process(partial(import_into_closed, str(path))).request({})
    assert found.value.code == 7


def test_an_error_of_another_kind_is_plain():
    from benchmark.errors import from_facts

    assert type(from_facts({"kind": "one_line", "problem": "x", "hint": ""})) is BenchmarkError


# Messages ------------------------------------------------------------------------------------------------------------


def head(text):
    return struct.pack(">Q", len(text)) + text


@pytest.mark.parametrize(
    "content",
    [
        struct.pack(">Q", 10**10),
        head(json.dumps([{}, [["a", "<f8", [10**10], "C"]]]).encode()),
        head(json.dumps([{}, [["a", "|O", [1], "C"]]]).encode()),
        head(json.dumps([{}, [["a", "<f8", [-1], "C"]]]).encode()),
        head(json.dumps([{}, [["a", "|S0", [10**10], "C"]]]).encode()),
        head(json.dumps([[], []]).encode()),
        head(b"\x80\x04\x95 a pickled object"),
    ],
    ids=["10 GB", "an array of 80 GB", "objects", "a negative size", "no width", "no facts", "a pickle"],
)
def test_what_is_no_message_is_refused_before_it_is_read(content):
    ours, theirs = socket.socketpair()
    channel = Channel(ours)
    theirs.sendall(content)
    with pytest.raises((ValueError, TypeError)):
        channel.receive(1.0)
    channel.close()
    theirs.close()


def test_half_a_message_holds_nobody():
    ours, theirs = socket.socketpair()
    channel, other = Channel(ours), head(json.dumps([{"a": 1}, []]).encode())
    theirs.sendall(other[:12])
    start = time.monotonic()
    assert channel.receive(0.1) is None
    assert time.monotonic() - start < 5
    theirs.sendall(other[12:])
    assert channel.receive(1.0) == ({"a": 1}, {})
    theirs.close()
    with pytest.raises(EOFError):
        channel.receive(1.0)
    channel.close()


def send_what_is_no_message(facts, arrays, tell):
    tell.args[0]._socket.send(b"\xff" * 8)
    time.sleep(600)


def test_a_process_that_sends_what_is_no_message_is_ended(monkeypatch):
    monkeypatch.setattr(processes, "GRACE", 0.2)
    made = Process(send_what_is_no_message)
    with pytest.raises(ProcessEnded) as found:
        made.request({})
    assert found.value.code == 1
    wait_until(lambda: made.exit_code is not None)


# Ends ----------------------------------------------------------------------------------------------------------------


def leaves_a_thread():
    threading.Thread(target=time.sleep, args=(600,)).start()


def leaves_a_handler_that_hangs():
    atexit.register(time.sleep, 600)


def leaves_a_handler_that_crashes():
    atexit.register(ctypes.string_at, 0)


def breaks_what_all_rely_on():
    builtins.isinstance = None
    raise ValueError("by hand")


def nothing():
    return None


def starts_others(notes):
    """In a session of their own, before and after a process of its own has come and gone."""
    before = subprocess.Popen(["sleep", "600"], start_new_session=True).pid
    call_apart(nothing, what="this", hint="correct it")
    after = subprocess.Popen(["sleep", "600"], start_new_session=True).pid
    copy = os.fork()
    if not copy:
        os.setsid()
        time.sleep(600)
    notes.write_text(f"{before} {after} {copy}")


def holds_the_pipe_open():
    if not os.fork():
        time.sleep(600)
    os._exit(5)


@pytest.mark.parametrize("task", [leaves_a_thread, leaves_a_handler_that_hangs, leaves_a_handler_that_crashes])
def test_whatever_a_call_leaves_is_over_at_once(task):
    start = time.monotonic()
    assert call_apart(task, what="this", hint="correct it") is None
    assert time.monotonic() - start < 30


def test_its_end_is_noticed_though_a_copy_of_it_holds_the_pipe_open():
    with pytest.raises(BrokenCall, match=r"this ended its process \(exit code 5\); correct it"):
        call_apart(holds_the_pipe_open, what="this", hint="correct it")


def test_what_it_started_ends_with_it(tmp_path):
    call_apart(starts_others, tmp_path / "notes", what="this", hint="correct it")
    children = [int(word) for word in (tmp_path / "notes").read_text().split()]
    wait_until(lambda: not any(map(is_alive, children)))


def test_what_a_killed_program_and_its_copies_started_ends_with_it(tmp_path):
    lines = (
        "import os, subprocess, sys, time", "from benchmark.execution.processes.process import adopt", "adopt()",
        "child = subprocess.Popen(['sleep', '600'], start_new_session=True).pid", "copy = os.fork()",
        "if not copy: os.setsid(); time.sleep(600)", "print(child, copy, flush=True)", "time.sleep(600)",
    )  # fmt: skip
    with subprocess.Popen([sys.executable, "-c", "\n".join(lines)], stdout=subprocess.PIPE, text=True) as program:
        started = [int(word) for word in program.stdout.readline().split()]
        assert all(map(is_alive, started))
        program.kill()
    wait_until(lambda: not any(map(is_alive, started)))


def interrupt_at_once(*_):
    raise KeyboardInterrupt


def test_an_interrupt_before_it_starts_is_one(monkeypatch):
    monkeypatch.setattr(processes, "_start", interrupt_at_once)
    with pytest.raises(KeyboardInterrupt):
        Process(serve)


# Sent to this thread, which blocks it, or heard by another one, which does not: never to the process, of whose threads
# any may hear of it, even after the test.
@pytest.mark.parametrize("interrupt", [signal.raise_signal, _thread.interrupt_main])
def test_an_interrupt_while_it_starts_leaves_no_process(monkeypatch, interrupt):
    started = []
    original = processes._start

    def start(*arguments):
        started.append(original(*arguments))
        interrupt(signal.SIGINT)
        return started[0]

    monkeypatch.setattr(processes, "_start", start)
    with pytest.raises(KeyboardInterrupt):
        Process(serve)
    wait_until(lambda: not is_alive(started[0].pid))


def test_one_that_can_say_nothing_ends_without_a_traceback(capfd):
    with pytest.raises(BrokenCall, match="this ended its process|this raises ValueError: by hand"):
        call_apart(breaks_what_all_rely_on, what="this", hint="correct it")
    assert capfd.readouterr().err == ""
