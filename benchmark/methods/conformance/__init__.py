"""Does a method keep its contract? Checks for authors of methods and descriptors, one line per finding."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from benchmark.methods.conformance.checks import OF_THE_ANSWER, OF_THE_CLASS, Check, check_answer, check_requirements
from benchmark.methods.conformance.shapes import figure
from benchmark.methods.conformance.trial import Skipped, Trial, Warned, explain
from benchmark.methods.inspection import inspect
from benchmark.methods.registry import MethodSpec, methods, variant
from benchmark.system.calls import BrokenCall, call_apart

__all__ = ["Finding", "Outcome", "Report", "check", "check_apart", "check_target", "figure"]

Outcome = Literal["ok", "warning", "failed", "skipped"]


@dataclass(frozen=True)
class Finding:
    """What one check found.

    Parameters
    ----------
    name
        Name of the check.
    outcome
        ``"skipped"`` where the method declares that the check does not apply; ``"warning"`` for what breaks no contract
        but makes scores that differ from run to run or from machine to machine.
    explanation
        One line: what was seen, and the mend if it failed.
    """

    name: str
    outcome: Outcome
    explanation: str

    def __str__(self) -> str:
        return f"{self.outcome:<7}  {self.name:<15}  {self.explanation}"


@dataclass(frozen=True)
class Report:
    """Findings by method; true if none failed, and as text one line per finding."""

    findings: Mapping[str, tuple[Finding, ...]]

    def __bool__(self) -> bool:
        return all(finding.outcome != "failed" for found in self.findings.values() for finding in found)

    def __str__(self) -> str:
        width = max(map(len, self.findings))
        return "\n".join(f"{name:<{width}}  {finding}" for name, found in self.findings.items() for finding in found)


def check_target(target: str) -> Report:
    """Check a method by name, or all methods of a plugin file.

    Parameters
    ----------
    target
        Name of a method, or path of a ``.py`` file.

    Raises
    ------
    ConfigurationError
        If there is no such method, or the file cannot be imported or takes the name of another method.
    """
    return Report({spec.name: tuple(check(spec)) for spec in _targets(target)})


def check_apart(target: str, limit: float | None = None) -> Report:
    """The same as :func:`check_target`, in a process of its own.

    A method that crashes, hangs or ends the process fails the check that it was at, and is not checked further.

    Parameters
    ----------
    target
        Name of a method, or path of a ``.py`` file.
    limit
        Seconds that one check may take; None for no limit.

    Raises
    ------
    ConfigurationError
        If there is no such method, or the file cannot be imported.
    """
    findings: dict[str, list[Finding]] = {}
    at: list[str] = []

    def hear(line: str) -> None:
        name, check_name, *found = json.loads(line)
        at[:] = () if found else (name, check_name)
        if found:
            findings.setdefault(name, []).append(Finding(check_name, *found))

    if target.endswith(".py"):
        inspect([Path(target)], made=False)
    what, mend = f"checking {target}", "mend the method: a shape that it cannot treat raises UnsupportedShape"
    while True:
        try:
            call_apart(_check_apart, target, list(findings), what=what, mend=mend, limit=limit, say=hear)
        except BrokenCall as error:
            if not at:
                raise
            findings.setdefault(at[0], []).append(Finding(at[1], "failed", str(error)))
            at.clear()
        else:
            return Report({name: tuple(found) for name, found in findings.items()})


def _check_apart(target: str, without: list[str], say: Callable[[str], None]) -> None:
    """Check the methods of a target but some, saying before each check which one begins and after it what it found."""
    for spec in _targets(target):
        if spec.name in without:
            continue
        for finding in _findings(spec, partial(_say_begun, say, spec.name)):
            say(json.dumps([spec.name, finding.name, finding.outcome, finding.explanation]))


def _say_begun(say: Callable[[str], None], method: str, check_name: str) -> None:
    say(json.dumps([method, check_name]))


def _targets(target: str) -> list[MethodSpec]:
    if not target.endswith(".py"):
        return [variant(target, methods())]
    path = Path(target)
    return [spec for spec in methods([path]).values() if spec.module == str(path.resolve())]


def check(spec: MethodSpec) -> list[Finding]:
    """Check one method or descriptor with its parameters.

    A check that raises is a failed finding. Without an answer on the reference figure there is nothing to compare, and
    the checks that would compare are skipped; a method whose packages are not installed is not run at all.
    """
    return list(_findings(spec, lambda _: None))


def _findings(spec: MethodSpec, begins: Callable[[str], None]) -> Iterator[Finding]:
    """Check a method; ``begins`` is told the name of each check before it is made."""
    trial = Trial(spec)

    def found(checks: Mapping[str, Check]) -> Iterator[Finding]:
        for name, function in checks.items():
            begins(name)
            yield _find(name, function, trial)

    for finding in found({"requirements": check_requirements}):
        yield finding
        if finding.outcome != "ok":
            return
    yield from found(OF_THE_CLASS)
    for finding in found({"answer": check_answer}):
        yield finding
        if finding.outcome != "ok":
            yield from (Finding(name, "skipped", "there is no answer to compare") for name in OF_THE_ANSWER)
            return
    yield from found(OF_THE_ANSWER)


def _find(name: str, function: Check, trial: Trial) -> Finding:
    outcome: Outcome
    try:
        outcome, explanation = "ok", function(trial)
    except Skipped as reason:
        outcome, explanation = "skipped", str(reason)
    except Warned as warning:
        outcome, explanation = "warning", str(warning)
    except KeyboardInterrupt as error:
        if multiprocessing.parent_process() is None:
            raise  # somebody interrupts the checks
        outcome, explanation = "failed", explain(error)
    except (Exception, SystemExit, GeneratorExit) as error:
        outcome, explanation = "failed", explain(error)
    return Finding(name, outcome, " ".join(explanation.split()))
