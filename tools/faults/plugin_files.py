"""Plugin files that do what no method should, and one that does what it should with little work."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

#: Two descriptors that need no more than numpy; the second one runs programs, and leaves some behind in sessions of
#: their own.
LIGHT = """\
import subprocess
import time
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from benchmark.api.contracts import MethodInfo


@dataclass(frozen=True, kw_only=True)
class Size:
    info: ClassVar[MethodInfo] = MethodInfo(name="light-size", title="Size")

    def describe(self, shape):
        time.sleep(0.05)
        return np.ptp(shape.mesh.vertices, axis=0)

    def distances(self, descriptors):
        found = np.array(descriptors)
        return np.linalg.norm(found[:, None] - found[None], axis=2)


@dataclass(frozen=True, kw_only=True)
class Children(Size):
    info: ClassVar[MethodInfo] = MethodInfo(name="light-children", title="Children")

    def describe(self, shape):
        subprocess.Popen(["sleep", "600"], start_new_session=True)
        subprocess.run(["sleep", "0.2"], check=False)
        return shape.mesh.vertices.std(axis=0)
"""

_METHOD = """\
import os, sys, time, signal, threading, subprocess, ctypes, atexit, builtins, warnings
import numpy as np
from benchmark.api.contracts import CanonicalForm, canonical_form


@canonical_form(name="bad", title="Bad")
def bad(shape):
    vertices = shape.mesh.vertices
{body}
    return vertices
"""

_CLASS = """\
import os, sys, time
from dataclasses import dataclass
from typing import ClassVar
import numpy as np
from benchmark.api.contracts import MethodInfo


{body}
"""

_DESCRIPTOR = """\
import os, sys, time
from dataclasses import dataclass
from typing import ClassVar
import numpy as np
from benchmark.api.contracts import MethodInfo


@dataclass(frozen=True, kw_only=True)
class Bad:
    info: ClassVar[MethodInfo] = MethodInfo(name="bad", title="Bad")

    def describe(self, shape):
        return shape.mesh.vertices.std(axis=0)

    def distances(self, descriptors):
        n = len(descriptors)
{body}
"""

_INFO = """\
from benchmark.api.contracts import canonical_form


@canonical_form({info})
def bad(shape):
    return 1 / 0
"""

_IMPORT = """\
import os, sys, time, signal, threading, subprocess, ctypes
from benchmark.api.contracts import canonical_form


@canonical_form(name="bad", title="Bad")
def bad(shape):
    return shape.mesh.vertices


{body}
"""

#: Statuses of what ends its worker, of what raises, and of what the harness has to stop.
_CRASHED, _FAILED, _STOPPED = ("crashed",), ("failed",), ("timeout",)


@dataclass(frozen=True)
class BadPlugin:
    """A plugin file that goes wrong.

    Parameters
    ----------
    name
        What it does.
    source
        Its text; bytes that are no text in Latin-1.
    statuses
        Statuses that the record of its method may have; empty if it is refused before the run, or has no record.
    says
        Regular expression that the reason in the record must hold, or the message that refuses the file.
    method
        Name of its method.
    hangs
        Whether it never ends.
    """

    name: str
    source: str
    statuses: tuple[str, ...] = ()
    says: str = ""
    method: str = "bad"
    hangs: bool = False


def bad_plugins() -> Iterator[BadPlugin]:
    """All of them."""
    yield from _methods()
    yield from _descriptors()
    yield from _informations()
    yield from _imports()
    yield from _classes()


def _indented(body: str, spaces: int) -> str:
    return "\n".join(" " * spaces + line for line in body.splitlines())


def _methods() -> Iterator[BadPlugin]:
    """Methods that go wrong at work."""
    found: dict[str, tuple[str, tuple[str, ...], str]] = {
        "exits": ("sys.exit(0)", _FAILED, "SystemExit"),
        "interrupts": ("raise KeyboardInterrupt", _FAILED, "KeyboardInterrupt"),
        "ends-generator": ("raise GeneratorExit", _FAILED, "GeneratorExit"),
        "ends-process-0": ("os._exit(0)", _CRASHED, "exit code 0"),
        "ends-process-1": ("os._exit(1)", _CRASHED, "exit code 1"),
        "segfault": ("ctypes.string_at(0)", _CRASHED, "SIGSEGV"),
        "abort": ("os.abort()", _CRASHED, "SIGABRT"),
        "recursion": ("def f(): f()\nf()", _FAILED, "RecursionError"),
        "stack-overflow": (
            "x = []\nfor _ in range(10**6): x = [x]\nsys.setrecursionlimit(10**9)\nrepr(x)",
            (*_CRASHED, *_FAILED), "SIGSEGV|RecursionError|MemoryError",
        ),
        "exit-handler-crash": ("atexit.register(lambda: ctypes.string_at(0))", ("ok",), ""),
        "exit-handler-raises": ("atexit.register(lambda: 1 / 0)", ("ok",), ""),
        "exit-handler-hang": ("atexit.register(time.sleep, 3600)", ("ok",), ""),
        "thread": ("threading.Thread(target=time.sleep, args=(3600,)).start()", ("ok",), ""),
        "thread-raises": ("threading.Thread(target=lambda: 1 / 0).start()", ("ok",), ""),
        "endless-loop": ("while True: pass", _STOPPED, "stopped after"),
        "sleep": ("time.sleep(3600)", _STOPPED, "stopped after"),
        "stops-itself": ("os.kill(os.getpid(), signal.SIGSTOP)", _STOPPED, "stopped after"),
        "lock": ("lock = threading.Lock(); lock.acquire(); lock.acquire()", _STOPPED, "stopped after"),
        "ignores-signals": (
            "for n in set(signal.Signals) - {signal.SIGKILL, signal.SIGSTOP}: signal.signal(n, signal.SIG_IGN)\n"
            "time.sleep(3600)",
            _STOPPED, "stopped after",
        ),
        "kills-itself": ("os.kill(os.getpid(), signal.SIGKILL)", ("killed",), "killed"),
        "terminates-itself": ("os.kill(os.getpid(), signal.SIGTERM)", ("crashed", "killed"), "SIGTERM|killed"),
        "children": (
            "for apart in (False, True): subprocess.Popen(['sleep', '3600'], start_new_session=apart)", ("ok",), "",
        ),
        "children-of-a-crash": (
            "subprocess.Popen(['sleep', '3600'], start_new_session=True); os._exit(3)", _CRASHED, "exit code 3",
        ),
        "daemon": (
            "if os.fork() == 0:\n    os.setsid()\n    if os.fork() == 0: time.sleep(3600)\n    os._exit(0)",
            ("ok",), "",
        ),
        "fork-that-returns": ("os.fork()", ("ok", "failed", "crashed"), ""),
        "many-processes": (
            "for _ in range(50): subprocess.Popen(['sleep', '3600'], start_new_session=True)", ("ok",), "",
        ),
        # Not even touched: where a machine has much memory, that alone would take minutes.
        "memory": ("eaten = [np.empty(2**27) for _ in range(10**6)]", ("memory", "killed"), "memory|killed"),
        "masses-of-text": (
            "for _ in range(2000): print('x' * 10**4); print('y' * 10**4, file=sys.stderr)", ("ok",), "",
        ),
        "huge-form": ("vertices = np.zeros((2**40, 3))", ("memory", "failed"), "memory|allocate"),
        "huge-note": (
            "return CanonicalForm(vertices, shape.mesh.faces, {'n': 'x' * 10**7})", ("ok", "failed"), "",
        ),
        "bad-note": ("return CanonicalForm(vertices, shape.mesh.faces, {1: object()})",
                     ("unsupported", "failed"), "note"),
        "nan-note": ("return CanonicalForm(vertices, shape.mesh.faces, {'n': float('nan')})", ("ok", "failed"), ""),
        "surrogate-note": (r"return CanonicalForm(vertices, shape.mesh.faces, {'\udcff': '\udcff'})",
                           ("ok", "failed"), ""),
        "nan": ("vertices = vertices * np.nan", ("unsupported", "failed"), "NaN|finite"),
        "infinite": ("vertices = vertices / 0", ("unsupported", "failed"), "infinite|finite"),
        "huge-coordinates": ("vertices = vertices * 1e308", ("ok", "unsupported", "failed"), ""),
        "point": ("vertices = vertices * 0", ("ok", "unsupported", "failed"), ""),
        "too-few-vertices": ("vertices = vertices[:3]", ("unsupported", "failed"), "vert"),
        "wrong-shape": ("vertices = vertices[:, :2]", ("unsupported", "failed"), "shape|vert"),
        "complex": ("vertices = vertices * 1j", ("unsupported", "failed"), "complex"),
        "strings": ("vertices = np.array([['a', 'b', 'c']] * len(vertices))", ("unsupported", "failed"), ""),
        "nothing": ("return None", ("unsupported", "failed"), ""),
        "objects": ("vertices = np.array([[object()] * 3] * len(vertices))", ("unsupported", "failed"), ""),
        "ragged": ("return [[1, 2, 3], [4]]", ("unsupported", "failed"), ""),
        "faces-out-of-range": ("return CanonicalForm(vertices, shape.mesh.faces + 10**6)",
                               ("unsupported", "failed"), "face"),
        "writes-input": ("vertices[:] = 0", _FAILED, "read-only"),
        "closes-streams": ("for n in (0, 1, 2): os.close(n)", ("ok", "failed", "crashed"), ""),
        "closes-everything": ("os.closerange(0, 1000)", ("ok", "failed", "crashed"), ""),
        "no-streams": ("sys.stdout = sys.stderr = None", ("ok",), ""),
        "changes-folder": ("os.chdir('/')", ("ok",), ""),
        "removed-folder": ("import tempfile; f = tempfile.mkdtemp(); os.chdir(f); os.rmdir(f)", ("ok", "failed"), ""),
        "empties-environment": ("os.environ.clear()", ("ok",), ""),
        "patches-numpy": (
            "np.random.seed = np.random.default_rng = np.linalg.eigh = np.asarray = lambda *a, **k: 1 / 0",
            ("ok", "failed"), "",
        ),
        "patches-open": ("builtins.open = os.open = None", ("ok", "failed", "crashed"), ""),
        "patches-time": ("time.monotonic = time.perf_counter = time.time = lambda: float('nan')", ("ok", "failed"), ""),
        "forgets-modules": ("sys.modules.clear()", ("ok", "failed", "crashed"), ""),
        "little-recursion": ("sys.setrecursionlimit(60)", ("ok", "failed"), ""),
        "errors-of-warnings": ("warnings.simplefilter('error'); np.seterr(all='raise')", ("ok", "failed"), ""),
        "message-raises": (
            "class E(Exception):\n    def __str__(self): raise RuntimeError('no')\n    __repr__ = __str__\nraise E",
            _FAILED, "E",
        ),
        "message-exits": ("class E(Exception):\n    def __str__(self): sys.exit(0)\nraise E", _FAILED, "E"),
        "refusal-is-no-text": (
            "from benchmark.errors import UnsupportedShape\nraise UnsupportedShape(object(), 5)",
            ("unsupported",), "object",
        ),
        "message-is-long": ("raise ValueError('x' * 10**7)", _FAILED, "ValueError"),
        "message-of-many-lines": (r"raise ValueError('a\nb\x1b[31mc|d\r<script>' + chr(0))", _FAILED, "ValueError"),
        "message-is-no-text": (r"raise ValueError('\udcff')", _FAILED, "ValueError"),
        "not-picklable": ("raise type('E', (Exception,), {'f': lambda self: lambda: 0})(lambda: 0)", _FAILED, "E"),
        "group": ("raise BaseExceptionGroup('g', [SystemExit(0), ValueError('v')])", _FAILED, "Group"),
        "chain": (
            "for _ in range(500):\n    try: raise e\n    except NameError as n: e = n\n"
            "    except Exception as n: e = ValueError(n)\nraise e",
            _FAILED, "Error",
        ),
        "file-size-limit": (
            "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))",
            ("ok", "failed", "crashed", "unsaved"), "",
        ),
        "open-file-limit": (
            "import resource; resource.setrlimit(resource.RLIMIT_NOFILE, (3, 3))",
            ("ok", "failed", "crashed", "unsaved"), "",
        ),
        "memory-limit": (
            "import resource; resource.setrlimit(resource.RLIMIT_AS, (2**20, 2**20)); np.ones(2**20)",
            ("memory", "failed", "crashed"), "",
        ),
        "processor-limit": (
            "import resource; resource.setrlimit(resource.RLIMIT_CPU, (1, 1))\nwhile True: pass",
            ("crashed", "killed"), "SIGXCPU|killed|SIGKILL",
        ),
    }  # fmt: skip
    for name, (body, statuses, says) in found.items():
        yield BadPlugin(
            f"method-{name}", _METHOD.format(body=_indented(body, 4)), statuses, says, hangs=statuses == _STOPPED
        )


def _descriptors() -> Iterator[BadPlugin]:
    """Descriptors whose distances go wrong, which is when a gallery is ranked."""
    found = {
        "raise": ("1 / 0", _FAILED, "ZeroDivisionError"),
        "exit": ("os._exit(0)", _CRASHED, "exit code 0"),
        "hang": ("time.sleep(3600)", _STOPPED, "stopped after"),
        "nan": ("return np.full((n, n), np.nan)", _FAILED, "finite|NaN"),
        "skew": ("return np.arange(n * n, dtype=float).reshape(n, n)", _FAILED, "symmetric|diagonal"),
        "flat": ("return np.zeros(n)", _FAILED, "square|shape"),
        "none": ("return None", _FAILED, ""),
        "strings": ("return np.full((n, n), 'a')", _FAILED, ""),
        "complex": ("return np.full((n, n), 1j)", (*_FAILED, "ok"), ""),
    }
    for name, (body, statuses, says) in found.items():
        source = _DESCRIPTOR.format(body=_indented(body, 8))
        yield BadPlugin(f"distances-{name}", source, statuses, says, hangs=statuses == _STOPPED)


def _informations() -> Iterator[BadPlugin]:
    """Methods that say odd things about themselves; those whose name can be used at all raise at work."""
    names = {
        "name-int": "1",
        "name-none": "None",
        "name-empty": "''",
        "name-newline": r"'ba\nd'",
        "name-colour": r"'\x1b[31mbad'",
        "name-pipe": "'b|ad'",
        "name-script": "'<script>alert(1)</script>'",
        "name-path": "'../../../bad'",
        "name-brackets": "'bad[a=1]'",
        "name-long": "'b' * 5000",
        "name-surrogate": r"'\udcff'",
        "name-taken": "'surface-area'",
    }
    for name, value in names.items():
        yield BadPlugin(f"info-{name}", _INFO.format(info=f"name={value}, title='Bad'"), method="")
    others = {
        "title-dollar": r"title='$\\frac{1}{2}$ & % _ # \\input{/etc/passwd}'",
        "title-script": "title='<script>alert(1)</script>'",
        "title-newline": r"title='a\nb\x1b[31m|c'",
        "title-int": "title=1",
        "family": "title='Bad', family='sideways'",
        "inputs": "title='Bad', inputs=('sideways',)",
        "requires-absent": "title='Bad', requires=('no_such_package',)",
        "requires-int": "title='Bad', requires=(1,)",
        "requires-odd": "title='Bad', requires=('', 'a.b.c', '../x', '-e')",
        "cite-unknown": r"title='Bad', cite='Nobody9999}\\input{x}'",
        "summary-none": "title='Bad', summary=None",
        "unknown-field": "title='Bad', colour='red'",
    }
    for name, value in others.items():
        yield BadPlugin(f"info-{name}", _INFO.format(info=f"name='bad', {value}"))


def _imports() -> Iterator[BadPlugin]:
    """Files that go wrong when they are imported."""
    found = {
        "exits": "sys.exit(0)",
        "exits-1": "sys.exit('a message')",
        "ends-process": "os._exit(0)",
        "crash": "ctypes.string_at(0)",
        "raises": "raise ValueError('a\\nb')",
        "interrupts": "raise KeyboardInterrupt",
        "message-raises": "class E(Exception):\n    def __str__(self): raise RuntimeError\nraise E",
        "prints": "print('x' * 10**6); print('y' * 10**6, file=sys.stderr)",
        "hang": "time.sleep(3600)",
        "child": "subprocess.Popen(['sleep', '3600'], start_new_session=True)",
        "fork": "os.fork()",
        "thread": "threading.Thread(target=time.sleep, args=(3600,)).start()",
        "exit-handler-hang": "import atexit; atexit.register(time.sleep, 3600)",
        "exit-handler-crash": "import atexit; atexit.register(lambda: ctypes.string_at(0))",
        "memory": "eaten = []\nwhile True: eaten.append(bytearray(2**27))",
        "recursion": "def f(): f()\nf()",
        "absent": "import no_such_package",
        "syntax": "def f(:",
        "patches": "import numpy; numpy.asarray = None; time.sleep = None",
        "removes-itself": "os.unlink(__file__)",
        "forgets-modules": "sys.modules.clear()",
        "signals": "for n in (signal.SIGINT, signal.SIGTERM): signal.signal(n, signal.SIG_IGN)",
        "closes-streams": "for n in (0, 1, 2): os.close(n)",
    }
    for name, body in found.items():
        yield BadPlugin(f"import-{name}", _IMPORT.format(body=body), hangs=name == "hang")
    yield BadPlugin("import-empty", "", method="")
    yield BadPlugin("import-zeros", "\0" * 100, method="")
    yield BadPlugin("import-no-text", "# \xff\xfe\n", method="")


def _classes() -> Iterator[BadPlugin]:
    """Classes that cannot be made, or are no methods."""
    info = 'info: ClassVar[MethodInfo] = MethodInfo(name="bad", title="Bad")'
    work = "    def canonicalise(self, shape):\n        return shape.form(shape.mesh.vertices)"
    kind = "@dataclass(frozen=True, kw_only=True)\nclass Bad:\n"
    found = {
        "raises": f"{kind}    {info}\n    def __post_init__(self):\n        1 / 0\n{work}",
        "exits": f"{kind}    {info}\n    def __post_init__(self):\n        sys.exit(0)\n{work}",
        "ends-process": f"{kind}    {info}\n    def __post_init__(self):\n        os._exit(0)\n{work}",
        "hang": f"{kind}    {info}\n    def __post_init__(self):\n        time.sleep(3600)\n{work}",
        "needs-arguments": f"{kind}    {info}\n    a: float\n{work}",
        "no-dataclass": f"class Bad:\n    {info}\n{work}",
        "odd-defaults": f"{kind}    {info}\n    a: object = print\n    b: complex = 1j\n{work}",
        "no-info": f'{kind}    info: ClassVar[dict] = {{"name": "bad"}}\n{work}',
        "no-work": f"{kind}    {info}",
        "info-hang": f"class Meta(type):\n    @property\n    def info(cls):\n        time.sleep(3600)\n\n"
        f"class Bad(metaclass=Meta):\n{work}",
        "info-raises": f"class Meta(type):\n    @property\n    def info(cls):\n        1 / 0\n\n"
        f"class Bad(metaclass=Meta):\n{work}",
        "two-of-a-name": f"{kind}    {info}\n{work}\n\n\n{kind.replace('Bad', 'Worse')}    {info}\n{work}",
    }
    for name, body in found.items():
        yield BadPlugin(f"class-{name}", _CLASS.format(body=body), hangs=name.endswith("hang"))
