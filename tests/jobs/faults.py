"""A plugin file of methods that go wrong in every way that the tests of the executors know."""

import atexit
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np

from benchmark.contracts import UnsupportedShape, canonical_form

#: Where methods say which processes they are and have started.
NOTES = Path(os.environ["FAULTS_NOTES"])


def note(name, *processes):
    with (NOTES / name).open("a") as file:
        file.write("".join(f"{process}\n" for process in processes))


@canonical_form(name="hang", title="Hang")
def hang(shape):
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(3600)"], start_new_session=True)
    note("children-of-hang", child.pid)
    note("hang", os.getpid())
    time.sleep(3600)


@canonical_form(name="segfault", title="Segfault")
def segfault(shape):
    os.kill(os.getpid(), signal.SIGSEGV)


@canonical_form(name="exit-zero", title="Exit 0")
def exit_zero(shape):
    os._exit(0)


@canonical_form(name="exit-three", title="Exit 3")
def exit_three(shape):
    os._exit(3)


@canonical_form(name="system-exit", title="System exit")
def system_exit(shape):
    sys.exit(0)


@canonical_form(name="interrupt", title="Interrupt")
def interrupt(shape):
    raise KeyboardInterrupt


@canonical_form(name="generator-exit", title="Generator exit")
def generator_exit(shape):
    raise GeneratorExit


@canonical_form(name="glutton", title="Glutton")
def glutton(shape):
    eaten = [np.empty(2**27) for _ in range(1000)]
    return eaten[0]


@canonical_form(name="bug", title="Bug")
def bug(shape):
    return 1 / 0


@canonical_form(name="nan", title="NaN")
def nan(shape):
    return shape.mesh.vertices * np.nan


@canonical_form(name="picky", title="Picky")
def picky(shape):
    if shape.identifier == "thin2":
        raise UnsupportedShape("too thin", "feed it")
    return shape.mesh.vertices


@canonical_form(name="bad-farewell", title="Bad farewell")
def bad_farewell(shape):
    atexit.register(lambda: 1 / 0)
    return shape.mesh.vertices


@canonical_form(name="long-farewell", title="Long farewell")
def long_farewell(shape):
    atexit.register(time.sleep, 3600)
    return shape.mesh.vertices


@canonical_form(name="thread", title="Thread")
def thread(shape):
    threading.Thread(target=time.sleep, args=(3600,)).start()
    return shape.mesh.vertices


@canonical_form(name="orphans", title="Orphans")
def orphans(shape):
    command = [sys.executable, "-c", "import time; time.sleep(3600)"]
    children = [subprocess.Popen(command), subprocess.Popen(command, start_new_session=True)]
    note("orphans", *(child.pid for child in children))
    if os.fork() == 0:  # a daemon as it is written in books: forked twice, in a session of its own
        os.setsid()
        if os.fork() == 0:
            note("orphans", os.getpid())
            time.sleep(3600)
        os._exit(0)
    return shape.mesh.vertices


@canonical_form(name="orphans-of-a-crash", title="Orphans of a crash")
def orphans_of_a_crash(shape):
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(3600)"], start_new_session=True)
    note("orphans", child.pid)
    os.kill(os.getpid(), signal.SIGSEGV)


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
