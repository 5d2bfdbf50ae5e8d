"""A plugin of methods of which most go wrong; ``FAULTS`` is a folder where they say which processes
they are.
"""

import ctypes
import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

from benchmark.api import UnsupportedShape, canonical_form

NOTES = Path(os.environ.get("FAULTS", "/dev/null"))


def note(name, *processes):
    if NOTES.is_dir():
        with (NOTES / name).open("a") as file:
            file.write("".join(f"{process}\n" for process in processes))


@canonical_form(name="fine", title="Fine")
def fine(shape):
    return shape.mesh.vertices


@canonical_form(name="bug", title="Bug")
def bug(shape):
    return 1 / 0


@canonical_form(name="exits", title="Exits")
def exits(shape):
    sys.exit(3)


@canonical_form(name="os-exit", title="Exits at once")
def os_exit(shape):
    if shape.identifier == "thick0":
        os._exit(3)
    return shape.mesh.vertices


@canonical_form(name="segfault", title="Segfault")
def segfault(shape):
    ctypes.string_at(0)


@canonical_form(name="hang", title="Hang")
def hang(shape):
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(3600)"])
    note("hang", os.getpid(), child.pid)
    time.sleep(3600)


@canonical_form(name="memory", title="Memory")
def memory(shape):
    eaten = [np.empty(2**26) for _ in range(10**6)]
    return eaten[0]


@canonical_form(name="nan", title="NaN")
def nan(shape):
    return shape.mesh.vertices * np.nan


@canonical_form(name="picky", title="Picky")
def picky(shape):
    if shape.identifier == "thick1":
        raise UnsupportedShape("too bent", "straighten it")
    return shape.mesh.vertices


@canonical_form(name="refuses", title="Refuses")
def refuses(shape):
    raise UnsupportedShape("not today")


@canonical_form(name="first-three", title="Refuses the first three")
def first_three(shape):
    if shape.identifier != "thin1":
        raise UnsupportedShape("too early")
    return shape.mesh.vertices


@canonical_form(name="last-three", title="Refuses the last three")
def last_three(shape):
    if shape.identifier != "thick0":
        raise UnsupportedShape("too late")
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
    time.sleep(0.5)
    return shape.mesh.vertices


@canonical_form(name="alters", title="Alters geodesics")
def alters(shape):
    for key in ("geodesic-graph", "heat", "geodesics", "seconds"):
        shape.compute_once(key, lambda: np.zeros((len(shape.mesh.vertices),) * 2))
    time.sleep(0.1)
    return shape.mesh.vertices


@canonical_form(name="needs-geodesics", title="Needs geodesics")
def needs_geodesics(shape):
    return shape.mesh.vertices * shape.geodesics().max()


@canonical_form(name="misreads", title="Misreads a file of its own")
def misreads(shape):
    raise UnsupportedShape("no table", "fetch it") from OSError(5, "Input/output error")


@canonical_form(name="interrupts", title="Interrupts")
def interrupts(shape):
    raise KeyboardInterrupt


@canonical_form(name="debugged", title="Debugged")
def debugged(shape):
    breakpoint()
    return shape.mesh.vertices


@canonical_form(name="flat", title="Flattened", inputs=("mesh",))
def flat(shape):
    """Halve the height."""
    return shape.mesh.vertices * [1.0, 1.0, 0.5]


@canonical_form(name="noisy", title="Writes into everything that is open")
def noisy(shape):
    for number in range(3, 30):
        with suppress(OSError):
            os.write(number, b"noise")
    time.sleep(3600)
