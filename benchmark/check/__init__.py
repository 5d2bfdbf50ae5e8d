"""Check that a method or scorer keeps its contract: one line for each check, as it ends."""

from __future__ import annotations

import faulthandler
import traceback
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass
from typing import Any, Literal

from benchmark.check.case import Case, FailedCheck, SkippedCheck, explained, fresh_process
from benchmark.check.checks import NECESSARY, checks_of
from benchmark.errors import InvalidForm, InvalidSignature
from benchmark.places import temporary_folder
from benchmark.registry import Component, component_of
from benchmark.registry.components import watching_component
from benchmark.text import Printed, clean_lines

__all__ = ["Finding", "check", "failures"]

#: Seconds that a check may take.
LIMIT = 600.0


@dataclass(frozen=True)
class Finding:
    """Result of one check.

    Parameters
    ----------
    name
        Name of the check.
    outcome
        How it ended.
    explanation
        One line on what was seen, with a hint if it failed.
    traceback
        Where an error was raised.
    """

    name: str
    outcome: Literal["ok", "failed", "skipped"]
    explanation: str
    traceback: str = ""

    def __str__(self) -> str:
        return f"{self.outcome:<7}  {self.name:<15}  {self.explanation}"


def check(component: Component, limit: float = LIMIT) -> Iterator[Finding]:
    """Check whether a method or scorer keeps its contract, and yield each finding at once.

    If it gives no answer, or different ones for the same shape, the remaining checks are left out.

    Parameters
    ----------
    component
        The method or scorer.
    limit
        Seconds that a check may take. After them, this process ends, and prints the line of code at
        which the check was.
    """
    missing = component.missing_packages()
    if missing:
        yield Finding("packages", "skipped", f"install {', '.join(missing)}, then check again")
        return
    with temporary_folder() as folder:
        case = Case(component, folder)
        with fresh_process(case, limit):
            for name, run in checks_of(component).items():
                finding = _find(name, run, case, limit)
                yield finding
                if finding.outcome == "failed" and run in NECESSARY:
                    return


def failures(value: Any) -> list[str]:
    """Check a method or scorer, or its class, for tests; return the failed checks.

    Examples
    --------
    >>> from baselines.identity import Identity
    >>> failures(Identity)
    []
    """
    return [str(finding) for finding in check(component_of(value)) if finding.outcome == "failed"]


def _find(name: str, run: Callable[[Case], str], case: Case, limit: float) -> Finding:
    """Run one check, and return what it found; an error is a finding.

    Parameters
    ----------
    name
        Name of the check.
    run
        Runs it on a case, and returns in words what it found, or raises why it failed or was
        skipped.
    case
        The method or scorer, with shapes to try it on.
    limit
        Seconds that the check may take. After them, this process ends, and prints the line of code
        at which the check was.
    """
    faulthandler.dump_traceback_later(limit, exit=True, file=2)
    try:
        # What a plugin prints must not stand among the findings.
        with redirect_stdout(Printed()), watching_component(case.component, [case.folder]):
            return Finding(name, "ok", run(case))
    except SkippedCheck as reason:
        return Finding(name, "skipped", str(reason))
    except (Exception, SystemExit) as error:
        # The message of an error that a check raises itself says everything.
        says_all = isinstance(error, FailedCheck | InvalidForm | InvalidSignature)
        trace = "" if says_all else clean_lines("".join(traceback.format_exception(error)))
        return Finding(name, "failed", " ".join(explained(error).split()), trace)
    finally:
        faulthandler.cancel_dump_traceback_later()
