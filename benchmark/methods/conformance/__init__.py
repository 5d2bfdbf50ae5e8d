"""Does a method keep its contract? Checks for authors of methods and descriptors, one line per finding."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from benchmark.methods.conformance.checks import OF_THE_ANSWER, OF_THE_CLASS, Check, check_answer, check_requirements
from benchmark.methods.conformance.shapes import figure
from benchmark.methods.conformance.trial import Skipped, Trial, Warned, explain
from benchmark.methods.registry import MethodSpec, methods, select

__all__ = ["Finding", "Outcome", "Report", "check", "check_target", "figure"]

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
    if not target.endswith(".py"):
        return Report({target: tuple(check(*select([target], methods())))})
    path = Path(target)
    specs = [spec for spec in methods([path]).values() if spec.module == str(path.resolve())]
    return Report({spec.name: tuple(check(spec)) for spec in specs})


def check(spec: MethodSpec) -> list[Finding]:
    """Check one method or descriptor with its parameters.

    A check that raises is a failed finding. Without an answer on the reference figure there is nothing to compare, and
    the checks that would compare are skipped; a method whose packages are not installed is not run at all.
    """
    trial = Trial(spec)
    findings = [_find("requirements", check_requirements, trial)]
    if findings[0].outcome != "ok":
        return findings
    findings += [_find(name, function, trial) for name, function in OF_THE_CLASS.items()]
    findings.append(_find("answer", check_answer, trial))
    if findings[-1].outcome == "ok":
        return findings + [_find(name, function, trial) for name, function in OF_THE_ANSWER.items()]
    return findings + [Finding(name, "skipped", "there is no answer to compare") for name in OF_THE_ANSWER]


def _find(name: str, function: Check, trial: Trial) -> Finding:
    outcome: Outcome
    try:
        outcome, explanation = "ok", function(trial)
    except Skipped as reason:
        outcome, explanation = "skipped", str(reason)
    except Warned as warning:
        outcome, explanation = "warning", str(warning)
    except Exception as error:
        outcome, explanation = "failed", explain(error)
    return Finding(name, outcome, " ".join(explanation.split()))
