"""Say which kernels are compiled on their first use, so that no command is silent for long."""

from __future__ import annotations

from functools import cache

from numba.core import event

from benchmark.text import say


class _Announcer(event.Listener):  # type: ignore[misc]  # numba has no types
    """Says the name of each kernel of the suite when it begins to be compiled.

    What numba compiles inside of a kernel, such as parts of NumPy, is not named.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._count = 0

    def on_start(self, event: event.Event) -> None:
        if self._depth == 0:
            self._count += 1
            kernel = event.data["dispatcher"].py_func
            module = kernel.__module__.rpartition(".")[2]
            name = kernel.__name__.lstrip("_")
            say(f"compiling kernel {self._count}, {name} of {module}, once", err=True)
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        self._depth -= 1


@cache
def announce_compilation() -> None:
    """Say the name of each kernel that this process compiles from now on."""
    event.register("numba:compile", _Announcer())
