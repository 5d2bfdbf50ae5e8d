"""``check``: print what the checks of a contract find."""

from __future__ import annotations

import faulthandler
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from benchmark.check import check
from benchmark.registry import components_named
from benchmark.text import say, say_lines

#: Columns behind the name of a component in which a finding begins its further lines.
_INDENT = 28


def print_check(target: str, plugins: Sequence[Path], timeout: float, *, traceback: bool) -> bool:
    """Check whether methods or scorers keep their contract, and print what each check finds.

    Parameters
    ----------
    target
        Path of a plugin file, all of whose methods and scorers are checked, or name of one.
    plugins
        Plugin files that may define it.
    timeout
        Seconds that a check may take.
    traceback
        Whether to print errors in full.

    Returns
    -------
    bool
        Whether no check failed.
    """
    faulthandler.enable(2)  # prints to stderr at which line the process crashed
    outcomes = Counter[str]()
    for component in components_named(target, plugins):
        for finding in check(component, timeout):
            say(f"{component.name}  {finding}", indent=len(component.name) + _INDENT)
            outcomes[finding.outcome] += 1
            if traceback:
                say_lines(finding.traceback)
            elif finding.traceback:
                say("'check --traceback' prints the error in full", err=True)
    counts = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items())
    verdict = "the contract is broken" if outcomes["failed"] else "no fault was found"
    say(f"{verdict}: {counts}")
    return not outcomes["failed"]
