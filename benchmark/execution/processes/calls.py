"""A function called in a process of its own: whatever it does, the caller hears of it in one line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from benchmark.arrays import Arrays
from benchmark.errors import BenchmarkError
from benchmark.execution.processes.channel import Facts
from benchmark.execution.processes.process import BY_HAND, ForeignError, Process, ProcessEnded, Requester
from benchmark.machine import memory_per_process


class BrokenCall(BenchmarkError):
    """Code that was called in a process of its own crashed, hung, ended its process, or raised what it should not."""


class KilledCall(BrokenCall):
    """Somebody else may have ended the process."""


@dataclass(frozen=True)
class Guard:
    """Terms of a call of somebody else's code.

    Parameters
    ----------
    what
        Whose code it is, to begin messages with.
    hint
        What to do if it breaks.
    limit
        Seconds that it may take, from one line that it says to the next; None for no limit.
    all_memory
        Whether it may take more than most of the machine's memory.
    quiet
        Whether nothing that it prints is seen.
    """

    what: str
    hint: str
    limit: float | None = None
    all_memory: bool = False
    quiet: bool = False


def call_apart(
    function: Callable[..., Any], *arguments: Any, guard: Guard, say: Callable[[str], None] | None = None
) -> Any:
    """Call a function in a process of its own and return what it returns, which travels as JSON.

    Parameters
    ----------
    function
        A function of a module.
    *arguments
        What it is called with.
    guard
        On what terms.
    say
        Told what the function says while it is at work; with it, the function is given one more argument, to say a line
        to.

    Raises
    ------
    BenchmarkError
        What the function raised of this kind, with its own class where that is one of :mod:`benchmark.errors`.
    BrokenCall
        If it raises anything else, ends the process, crashes it or takes too long.
    """
    memory = None if guard.all_memory else memory_per_process()
    try:
        process = Process(partial(_call, function, arguments, say is not None), memory=memory, quiet=guard.quiet)
    except OSError as error:
        raise BrokenCall(
            f"{guard.what}: no process could be started ({error.strerror})", "end others, then try again"
        ) from error
    kind = BrokenCall
    try:
        return process.request({}, progress=say or (lambda line: None), limit=guard.limit)[0]["returned"]
    except TimeoutError:
        problem = f"does not end: stopped after {guard.limit:g} s"
    except ProcessEnded as error:
        kind = KilledCall if -error.code in BY_HAND else BrokenCall
        problem = f"ended its process ({error})"
    except MemoryError:
        problem = "raises MemoryError: out of memory"
    except ForeignError as error:
        problem = f"raises {error}"
    finally:
        process.end()
    raise kind(f"{guard.what} {problem}", guard.hint)


def _call(
    function: Callable[..., Any],
    arguments: tuple[Any, ...],
    speaks: bool,
    facts: Facts,
    arrays: Arrays,
    requester: Requester,
) -> tuple[Facts, Arrays]:
    """Call the function, in its process."""
    return {"returned": function(*arguments, *((requester.tell,) if speaks else ()))}, {}
