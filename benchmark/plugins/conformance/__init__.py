"""Check that a plugin satisfies its contract: for authors of methods, scorers and data sets, one line per finding."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any, Literal

from benchmark.datasets.catalogue import sources
from benchmark.datasets.own import data_sets_of
from benchmark.errors import ConfigurationError
from benchmark.execution.processes.calls import BrokenCall, call_apart
from benchmark.execution.processes.process import is_child
from benchmark.plugins.conformance import checks
from benchmark.plugins.conformance.cases import DatasetCase, ScorerCase, Skipped, Warned, explain, figure
from benchmark.plugins.inspection import inspect, plugins_in
from benchmark.plugins.registry import methods, plugin_methods, variants
from benchmark.plugins.scorers import scorer_of, scorers
from benchmark.plugins.specs import DatasetSpec, MethodSpec, PluginSpec

__all__ = ["Finding", "Report", "Target", "check", "check_apart", "check_target", "figure"]

Outcome = Literal["ok", "warning", "failed", "skipped"]


@dataclass(frozen=True)
class Target:
    """Target of a check.

    Parameters
    ----------
    name
        A method, a scorer, or a data set of a plugin file, optionally with parameters in brackets; or a plugin file, to
        check everything that it defines.
    methods
        Methods of the file to check, optionally with parameters; empty for all methods, scorers and data sets.
    plugins
        Files that define the named method or data set.
    options
        Training options for checking a learner; by default, its own schedule. A learner that names its model is checked
        with that model.
    """

    name: str
    methods: tuple[str, ...] = ()
    plugins: tuple[Path, ...] = ()
    options: tuple[tuple[str, str], ...] = ()

    @property
    def file(self) -> Path | None:
        """The plugin file, if it is one."""
        match = re.fullmatch(r"(.*\.py)\s*(\[[^\[\]]*\])?", self.name.strip())
        return Path(match[1]) if match else None

    def specs(self) -> list[PluginSpec[Any, Any]]:
        """Return the methods, scorers and data sets.

        Raises
        ------
        ConfigurationError
            If there is no such method, a parameter is invalid, or the file cannot be imported.
        """
        return self._named() if self.file is None else self._of_file(self.file)

    def _named(self) -> list[PluginSpec[Any, Any]]:
        known, known_scorers, data_sets = methods(self.plugins), scorers(self.plugins), data_sets_of(self.plugins)
        base = self.name.partition("[")[0].strip()
        others: list[PluginSpec[Any, Any]] = []
        if base in known_scorers and base not in known:
            others.append(scorer_of(self.name, known_scorers))
        if self.name in data_sets:
            others.append(DatasetSpec(self.name, data_sets[self.name]))
        names = self.methods if others else (self.name, *self.methods)
        return [*(spec for name in names for spec in variants(name, known)), *others]

    def _of_file(self, path: Path) -> list[PluginSpec[Any, Any]]:
        known = methods({path, *self.plugins})
        names = [spec.name for spec in plugin_methods(path)]
        brackets = self.name.strip().removeprefix(str(path)).strip()
        if brackets and self.methods:
            raise ConfigurationError("parameters were passed with the file and with -m", "pass them with -m")
        if brackets and not names:
            raise ConfigurationError(f"plugin {path} has no method that takes parameters", "leave them out")
        chosen = [spec for name in self.methods or names for spec in variants(name + brackets, known)]
        for spec in chosen:
            if spec.base_name not in names:
                raise ConfigurationError(f"{path} has no method '{spec.name}'", f"choose from {', '.join(names)}")
        if brackets or self.methods:
            return list(chosen)
        sources(data_sets_of([path]), [path])  # refuses names that are taken
        return [*chosen, *(spec for spec in plugins_in(path) if not isinstance(spec, MethodSpec))]


@dataclass(frozen=True)
class Finding:
    """Result of one check.

    Parameters
    ----------
    name
        Name of the check.
    outcome
        ``"skipped"`` if the method declares that the check does not apply; ``"warning"`` if no contract is broken but
        scores may differ between runs or machines.
    explanation
        One line: the observation, and a hint if the check failed.
    """

    name: str
    outcome: Outcome
    explanation: str

    def __str__(self) -> str:
        return f"{self.outcome:<7}  {self.name:<15}  {self.explanation}"


@dataclass(frozen=True)
class Report:
    """Findings by method; true if none failed; as text, one line per finding."""

    findings: Mapping[str, Sequence[Finding]]

    def __bool__(self) -> bool:
        return all(finding.outcome != "failed" for findings in self.findings.values() for finding in findings)

    def __str__(self) -> str:
        width = max(map(len, self.findings))
        return "\n".join(
            f"{name:<{width}}  {finding}" for name, findings in self.findings.items() for finding in findings
        )


def check_target(name: str) -> Report:
    """Check a method by name, or everything that a plugin file defines; see :class:`Target`.

    Raises
    ------
    ConfigurationError
        If there is no such method, or the file cannot be imported or reuses the name of another method.
    """
    return Report({_title(spec): check(spec) for spec in Target(name).specs()})


def check_apart(target: Target, limit: float | None = None) -> Report:
    """Check a target in a separate process.

    A method that crashes, hangs or ends the process fails the current check and is not checked further.

    Parameters
    ----------
    target
        The plugins to check.
    limit
        Time limit of one check in seconds; None for no limit.

    Raises
    ------
    ConfigurationError
        If there is no such method, or the file cannot be imported.
    """
    findings: dict[str, list[Finding]] = {}
    at: list[str] = []

    def hear(line: str) -> None:
        name, check_name, *result = json.loads(line)
        at[:] = () if result else (name, check_name)
        if result:
            findings.setdefault(name, []).append(Finding(check_name, *result))

    inspect([path for path in (target.file,) if path], made=False)
    what, hint = f"checking {target.name}", "correct the file: it must refuse what it cannot process"
    with tempfile.TemporaryDirectory(prefix="canonical-forms-") as folder:
        while True:
            try:
                call_apart(_check_apart, target, list(findings), folder, what=what, hint=hint, limit=limit, say=hear)
            except BrokenCall as error:
                if not at:
                    raise
                findings.setdefault(at[0], []).append(Finding(at[1], "failed", str(error)))
                at.clear()
            else:
                return Report(findings)


def _check_apart(target: Target, without: Sequence[str], folder: str, say: Callable[[str], None]) -> None:
    """Check a target except for some plugins; report the name of each check before it and its findings after it."""
    for spec in target.specs():
        title = _title(spec)
        for event in _checks(spec, Path(folder), target.options) if title not in without else ():
            say(json.dumps([title, *([event] if isinstance(event, str) else astuple(event))]))


def _title(spec: PluginSpec[Any, Any]) -> str:
    """Return the name of a plugin, with its kind if it is a scorer or a data set, since kinds may share names."""
    return spec.name if isinstance(spec, MethodSpec) else f"{spec.name} ({spec.kind})"


def check(spec: PluginSpec[Any, Any]) -> list[Finding]:
    """Check one method, descriptor, scorer or data set with its parameters.

    A check that raises an error has failed. If the answer for the reference figure is missing or differs between runs,
    there is nothing to compare, and the remaining checks are skipped. A method whose packages are not installed does
    not run at all. A learner without a model is trained on a few images of the figure.
    """
    with tempfile.TemporaryDirectory(prefix="canonical-forms-") as folder:
        return [event for event in _checks(spec, Path(folder)) if isinstance(event, Finding)]


def _checks(spec: PluginSpec[Any, Any], folder: Path, options: Any = ()) -> Iterator[str | Finding]:
    """Check a plugin: yield the name of each check before it runs, then its result; models go to a folder."""
    case, gate = checks.case_of(spec, models=folder, options=options), None
    table = checks.OF_DATA_SETS if isinstance(case, DatasetCase) else checks.OF_METHODS_AND_SCORERS
    names = checks.NAMES_OF_SCORERS if isinstance(case, ScorerCase) else {}
    for known_name, check in table.items():
        name = names.get(known_name, known_name)
        if gate == "" or not check.applies(case):
            continue
        if gate is None:
            yield name
        finding = _find(name, check, case) if gate is None else Finding(name, "skipped", gate)
        yield finding
        if gate is None and finding.outcome != "ok":
            gate = check.gate


def _find(name: str, check: checks.Check, case: Any) -> Finding:
    outcome: Outcome
    try:
        for reason in filter(None, (rule(case) for rule in check.unless)):
            raise Skipped(reason)
        outcome, explanation = "ok", check.run(case)
    except Skipped as reason:
        outcome, explanation = "skipped", str(reason)
    except Warned as warning:
        outcome, explanation = "warning", str(warning)
    except (Exception, SystemExit, GeneratorExit, KeyboardInterrupt) as error:
        if isinstance(error, KeyboardInterrupt) and not is_child():
            raise  # the user interrupts the checks
        outcome, explanation = "failed", explain(error)
    return Finding(name, outcome, " ".join(explanation.split()))
