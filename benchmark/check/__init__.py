"""Check that a method, scorer or data set keeps its contract: one line for each check, as it ends."""

from __future__ import annotations

import multiprocessing
import signal
import sys
from collections.abc import Iterator, Mapping
from multiprocessing.connection import Connection
from typing import Any

from benchmark.check.checks import Finding, run_checks
from benchmark.errors import BenchmarkError
from benchmark.registry import Component, component_of

__all__ = ["Finding", "check", "failures", "run_checks"]

#: Seconds that one shape may take.
LIMIT = 60.0

_SPAWN = multiprocessing.get_context("spawn")


def check(component: Component, options: Mapping[str, str] | None = None, limit: float = LIMIT) -> Iterator[Finding]:
    """Check a component in a process of its own, and yield each finding as soon as there is one.

    A crash or a shape that takes too long fails the current check and ends the others.

    Parameters
    ----------
    component
        What to check.
    options
        Changes to the schedule of a learner, which is trained on three images.
    limit
        Seconds that one shape may take.
    """
    ours, theirs = _SPAWN.Pipe(duplex=False)
    process = _SPAWN.Process(target=_serve, args=(theirs, component, dict(options or {})), daemon=True)
    process.start()
    theirs.close()
    name = "import"
    try:
        patience = max(limit, LIMIT)  # until its packages are imported
        while ours.poll(patience):
            message, patience = ours.recv(), limit
            if message is None:
                return
            if isinstance(message, Finding):
                yield message
            else:
                name = message or name
        explanation = f"no answer after {limit:g} s on one shape; find the endless loop or the slow step"
        yield Finding(name, "failed", explanation)
    except EOFError:
        process.join()
        code = process.exitcode or 0
        ending = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        yield Finding(name, "failed", f"ended its process with {ending}; a method must not end its process")
    finally:
        process.kill()
        process.join()


def failures(value: Any, options: Mapping[str, str] | None = None) -> list[str]:
    """Check a method, scorer or data set, or its class, in this process, for tests; return the failed checks.

    Examples
    --------
    >>> from baselines.identity import Identity
    >>> failures(Identity)
    []
    """
    events = run_checks(component_of(value), options)
    return [str(event) for event in events if isinstance(event, Finding) and event.outcome == "failed"]


def _serve(connection: Connection, component: Component, options: Mapping[str, str]) -> None:
    """Send the name of each check, "" before each shape, the findings, and None at the end."""
    sys.stdout = sys.stderr  # what a plugin prints must not stand among the findings
    try:
        for event in run_checks(component, options, lambda: connection.send("")):
            connection.send(event)
    except BenchmarkError as error:
        connection.send(Finding("import", "failed", str(error)))
    connection.send(None)
