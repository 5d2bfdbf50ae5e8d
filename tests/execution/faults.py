"""A plugin file of methods that go wrong, and tell which processes they are; ``tools/faults`` has many more."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np

from benchmark.api.contracts import UnsupportedShape, canonical_form
from benchmark.execution.processes.process import is_child

#: Where methods say which processes they are and have started.
NOTES = Path(os.environ["FAULTS_NOTES"])


def note(name, *processes):
    with (NOTES / name).open("a") as file:
        file.write("".join(f"{process}\n" for process in processes))


@canonical_form(name="hang", title="Hang")
def hang(shape):
    if is_child():  # where nobody watches over a method, nothing is to be left behind
        child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(3600)"], start_new_session=True)
        note("children-of-hang", child.pid)
    note("hang", os.getpid())
    time.sleep(3600)


@canonical_form(name="segfault", title="Segfault")
def segfault(shape):
    os.kill(os.getpid(), signal.SIGSEGV)


@canonical_form(name="exit-three", title="Exit 3")
def exit_three(shape):
    os._exit(3)


@canonical_form(name="bug", title="Bug")
def bug(shape):
    return 1 / 0


@canonical_form(name="picky", title="Picky")
def picky(shape):
    width, depth, height = np.ptp(shape.mesh.vertices, axis=0)
    if height > width and height > 2 * depth:  # the thin rod that is bent the most
        raise UnsupportedShape("too thin", "feed it")
    return shape.mesh.vertices


@canonical_form(name="leaves-an-alarm", title="Leaves an alarm")
def leaves_an_alarm(shape):
    signal.setitimer(signal.ITIMER_REAL, 0.01)
    return shape.mesh.vertices


@canonical_form(name="leaves-a-thread", title="Leaves a thread")
def leaves_a_thread(shape):
    note("leaves-a-thread", os.getpid())
    threading.Thread(target=time.sleep, args=(600,)).start()
    return shape.mesh.vertices


@canonical_form(name="waits-once", title="Waits once")
def waits_once(shape):
    if not (NOTES / "waits-once").exists():
        note("waits-once", os.getpid())
        time.sleep(3600)
    return shape.mesh.vertices


@canonical_form(name="slow", title="Slow")
def slow(shape):
    note("slow", os.getpid())
    time.sleep(0.2)
    return shape.mesh.vertices


@canonical_form(name="edits-itself", title="Edits itself")
def edits_itself(shape):
    path = Path(__file__)
    if not path.read_text().endswith("# edited\n"):
        path.write_text(path.read_text() + "\n\nCONSTANT = 1  # edited\n")
    return shape.mesh.vertices
