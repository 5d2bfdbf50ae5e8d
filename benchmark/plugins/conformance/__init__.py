"""Does a plugin keep its contract? Checks for authors of methods, learners and data sets, one line per finding."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any, Literal

from benchmark.datasets.catalogue import sources
from benchmark.datasets.own import data_sets_of
from benchmark.errors import ConfigurationError
from benchmark.execution.processes.calls import BrokenCall, Guard, call_apart
from benchmark.execution.processes.process import is_child
from benchmark.plugins.conformance.cases import MethodCase, Skipped, Warned, case_of, explain
from benchmark.plugins.conformance.checks import (
    OF_METHODS_ALONE,
    OF_SCORERS,
    OF_THE_ANSWER,
    OF_THE_CLASS,
    Check,
    check_answer,
    check_learner,
    check_requirements,
)
from benchmark.plugins.conformance.datasets import OF_DATA_SETS, DatasetCase
from benchmark.plugins.conformance.learners import NAME, trained
from benchmark.plugins.conformance.shapes import figure
from benchmark.plugins.inspection import inspect
from benchmark.plugins.registry import MethodSpec, methods, variants
from benchmark.plugins.scorers import ScorerSpec, plugin_scorers, scorer_of, scorers

__all__ = ["Finding", "Report", "Target", "check", "check_apart", "check_target", "figure"]

#: Checks without which there are no further ones, and why these are skipped; "" where they are not even named.
_GATES = {
    "requirements": "",
    "training": "there is no model",
    "answer": "there is no answer to compare",
    "repeatable": "two runs differ, so nothing can be compared",
}

Outcome = Literal["ok", "warning", "failed", "skipped"]


@dataclass(frozen=True)
class Target:
    """Target of a check.

    Parameters
    ----------
    name
        A method, a scorer, or a data set of a plugin file, or such a file for all that it brings; with parameters in
        brackets if need be.
    methods
        Of a file, the methods to check, with parameters if need be; empty for all, its scorers and its data sets.
    plugins
        Files that bring the named method or data set.
    options
        Of a learner: how to train the model that it is checked with; without any, its own schedule says so, and one
        that says where its model lies is checked with that.
    """

    name: str
    methods: tuple[str, ...] = ()
    plugins: tuple[str, ...] = ()
    options: tuple[tuple[str, str], ...] = ()

    @property
    def file(self) -> Path | None:
        """The plugin file, if it is one."""
        found = re.fullmatch(r"(.*\.py)\s*(\[[^\[\]]*\])?", self.name.strip())
        return Path(found[1]) if found else None

    def specs(self) -> list[MethodSpec]:
        """The methods.

        Raises
        ------
        ConfigurationError
            If there is no such method, a parameter does not fit, or the file cannot be imported.
        """
        path = self.file
        if path is None:
            known = methods(map(Path, self.plugins))
            others = data_sets_of(map(Path, self.plugins)) | self.scorers_named()
            named = [name for name in (self.name, *self.methods) if name not in others]
            return [spec for name in named for spec in variants(name, known)]
        known = methods({path, *map(Path, self.plugins)})
        of_file = [spec.name for spec in known.values() if spec.module == str(path.resolve())]
        brackets = self.name.strip()[len(str(path)) :].strip() if self.name.strip().endswith("]") else ""
        if brackets and self.methods:
            raise ConfigurationError("parameters are given with the file and with -m", "give them with -m")
        if brackets and not of_file:
            raise ConfigurationError(f"plugin {path} has no method that takes parameters", "leave them out")
        found = [spec for name in self.methods or of_file for spec in variants(name + brackets, known)]
        for spec in found:
            if spec.module != str(path.resolve()):
                raise ConfigurationError(f"{path} has no method '{spec.name}'", f"choose from {', '.join(of_file)}")
        return found

    def scorers(self) -> list[ScorerSpec]:
        """The scorers."""
        if self.file is not None:
            return [] if self.methods or self.name.strip().endswith("]") else plugin_scorers(self.file)
        return list(self.scorers_named().values())

    def scorers_named(self) -> dict[str, ScorerSpec]:
        """The scorer of this name, with its parameters, where there is one and no method has it."""
        known, base = scorers(map(Path, self.plugins)), self.name.partition("[")[0].strip()
        is_scorer = base in known and base not in methods(map(Path, self.plugins))
        return {self.name: scorer_of(self.name, known)} if is_scorer else {}

    def data_sets(self) -> dict[str, str]:
        """The data sets, each as :func:`benchmark.datasets.own.open_own` takes it, by name."""
        if self.file is not None:
            own = {} if self.methods or self.name.strip().endswith("]") else data_sets_of([self.file])
            sources(own, [self.file])
            return own
        own = data_sets_of(map(Path, self.plugins))
        return {self.name: own[self.name]} if self.name in own else {}


@dataclass(frozen=True)
class Finding:
    """Result of one check.

    Parameters
    ----------
    name
        Name of the check.
    outcome
        ``"skipped"`` where the method declares that the check does not apply; ``"warning"`` for what breaks no contract
        but makes scores that differ from run to run or from machine to machine.
    explanation
        One line: what was seen, and the hint if it failed.
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


def check_target(name: str) -> Report:
    """Check a method by name, or all that a plugin file brings.

    Parameters
    ----------
    name
        See :class:`Target`.

    Raises
    ------
    ConfigurationError
        If there is no such method, or the file cannot be imported or takes the name of another method.
    """
    with tempfile.TemporaryDirectory(prefix="canonical-forms-") as folder:
        return Report({titled: _findings_in(events) for titled, events in _checked(Target(name), Path(folder))})


def check_apart(target: Target, limit: float | None = None) -> Report:
    """The same, in a process of its own.

    A method that crashes, hangs or ends the process fails the check that it was at, and is not checked further.

    Parameters
    ----------
    target
        What to check.
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

    inspect([path for path in (target.file,) if path], made=False)
    guard = Guard(f"checking {target.name}", "correct the file: what it cannot treat, it refuses", limit)
    with tempfile.TemporaryDirectory(prefix="canonical-forms-") as folder:
        while True:
            try:
                call_apart(_check_apart, target, list(findings), folder, guard=guard, say=hear)
            except BrokenCall as error:
                if not at:
                    raise
                findings.setdefault(at[0], []).append(Finding(at[1], "failed", str(error)))
                at.clear()
            else:
                return Report({name: tuple(found) for name, found in findings.items()})


def _check_apart(target: Target, without: Sequence[str], folder: str, say: Callable[[str], None]) -> None:
    """Check all of a target but some, saying before each check which one begins and after it what it found."""
    for titled, events in _checked(target, Path(folder)):
        for event in events if titled not in without else ():
            say(json.dumps([titled, *([event] if isinstance(event, str) else astuple(event))]))


def _checked(target: Target, folder: Path) -> Iterator[tuple[str, Iterator[str | Finding]]]:
    """All of a target by title, each with its checks; a scorer or a data set says so, for names may be shared."""
    for spec in target.specs():
        yield spec.name, _checks(spec, folder, dict(target.options))
    for scorer in target.scorers():
        yield f"{scorer.name} (scorer)", _checks(scorer, folder, {})
    for name, source in target.data_sets().items():
        yield f"{name} (data set)", _checks_of_data_set(DatasetCase(source))


def _findings_in(events: Iterable[str | Finding]) -> tuple[Finding, ...]:
    return tuple(event for event in events if isinstance(event, Finding))


def check(spec: MethodSpec | ScorerSpec) -> list[Finding]:
    """Check one method, descriptor or scorer with its parameters.

    A check that raises is a failed finding. Without an answer on the reference figure, or with one that differs from
    run to run, there is nothing to compare, and the further checks are skipped; a method whose packages are not
    installed is not run at all. A learner without a model is trained on a few images of the figure.
    """
    with tempfile.TemporaryDirectory(prefix="canonical-forms-") as folder:
        return list(_findings_in(_checks(spec, Path(folder), {})))


def _checks(spec: MethodSpec | ScorerSpec, folder: Path, options: Mapping[str, str]) -> Iterator[str | Finding]:
    """Check a method or a scorer: the name of each check before it is made, then its result; models go to a folder."""
    learns = isinstance(spec, MethodSpec) and not spec.missing_packages() and spec.learns
    models = Path(tempfile.mkdtemp(dir=folder))
    case: Any = case_of(spec, models if options and learns else None)  # it is trained below, so none need be there yet

    def train(case: MethodCase) -> str:
        trained(case.spec, models, options)
        case.model = models / NAME / getattr(case.spec.create(), "model_name")  # noqa: B009
        return "makes a model of a few images, leaves a finished one alone, and loads it"

    checks: dict[str, Check] = {"requirements": check_requirements, **OF_THE_CLASS}
    if learns:
        checks["learner"] = check_learner
        if options or not hasattr(spec.load(), "model_folder"):
            checks["training"] = train
    checks |= {"answer": check_answer, **OF_THE_ANSWER}
    names = {name: name for name in checks}
    if isinstance(spec, ScorerSpec):
        names = {name: OF_SCORERS.get(name, name) for name in checks if name not in OF_METHODS_ALONE}
    for number, (name, title) in enumerate(names.items(), 1):
        yield title
        finding = _find(title, checks[name], case)
        yield finding
        if finding.outcome != "ok" and name in _GATES:
            skipped = list(names.values())[number:] if _GATES[name] else ()
            yield from (Finding(other, "skipped", _GATES[name]) for other in skipped)
            return


def _checks_of_data_set(case: DatasetCase) -> Iterator[str | Finding]:
    for name, function in OF_DATA_SETS.items():
        yield name
        yield _find(name, function, case)


def _find(name: str, function: Callable[[Any], str], case: Any) -> Finding:
    outcome: Outcome
    try:
        outcome, explanation = "ok", function(case)
    except Skipped as reason:
        outcome, explanation = "skipped", str(reason)
    except Warned as warning:
        outcome, explanation = "warning", str(warning)
    except KeyboardInterrupt as error:
        if not is_child():
            raise  # somebody interrupts the checks
        outcome, explanation = "failed", explain(error)
    except (Exception, SystemExit, GeneratorExit) as error:
        outcome, explanation = "failed", explain(error)
    return Finding(name, outcome, " ".join(explanation.split()))
