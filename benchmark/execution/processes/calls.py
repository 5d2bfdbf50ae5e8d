"""Call a function in a separate process; any failure becomes a one-line error."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from benchmark.arrays import Arrays
from benchmark.errors import BenchmarkError
from benchmark.execution.processes.channel import Facts
from benchmark.execution.processes.process import BY_HAND, ForeignError, Process, ProcessEnded, Tell
from benchmark.machine import memory_per_process


class BrokenCall(BenchmarkError):
    """A crash, timeout, exit or unexpected error of code called in a separate process."""


class KilledCall(BrokenCall):
    """The process was killed, possibly by a user or by the system."""


def call_apart(
    function: Callable[..., Any],
    *arguments: Any,
    what: str,
    hint: str,
    limit: float | None = None,
    all_memory: bool = False,
    quiet: bool = False,
    say: Callable[[str], None] | None = None,
) -> Any:
    """Call a function in a separate process and return its result, which must fit into JSON.

    Parameters
    ----------
    function
        A module-level function.
    *arguments
        Its arguments.
    what
        Name of the code; messages begin with it.
    hint
        What the user can do if it fails.
    limit
        Timeout between messages in seconds; None for no limit.
    all_memory
        Whether it may use all memory of the machine.
    quiet
        Whether to discard what it prints.
    say
        Callback for progress. If given, the function gets one more argument: a function that reports a line.

    Raises
    ------
    BenchmarkError
        If the function raised one; its class is preserved if it is one of :mod:`benchmark.errors`.
    BrokenCall
        If it raises anything else, ends or crashes the process, or takes too long.
    """
    memory = None if all_memory else memory_per_process()
    try:
        process = Process(partial(_call, partial(function, *arguments), say is not None), memory=memory, quiet=quiet)
    except OSError as error:
        raise BrokenCall(
            f"{what}: no process could be started ({error.strerror})", "end other processes, then try again"
        ) from error
    kind = BrokenCall
    try:
        return process.request({}, progress=say, limit=limit)[0]["returned"]
    except KeyError:
        problem = "returned nothing"  # it forged its answer
    except TimeoutError:
        problem = f"does not end: stopped after {limit:g} s"
    except ProcessEnded as error:
        kind = KilledCall if -error.code in BY_HAND else BrokenCall
        problem = f"ended its process ({error})"
    except MemoryError:
        problem = "raises MemoryError: out of memory"
    except ForeignError as error:
        problem = f"raises {error}"
    finally:
        process.end()
    raise kind(f"{what} {problem}", hint)


def _call(call: Callable[..., Any], speaks: bool, facts: Facts, arrays: Arrays, tell: Tell) -> tuple[Facts, Arrays]:
    """Call the function in the child process."""
    return {"returned": call(tell) if speaks else call()}, {}
