"""A look at foreign code from a safe distance: a process of its own imports it, and makes what it brings."""

from __future__ import annotations

import builtins
import os
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, get_args

from benchmark.api.learning import Split
from benchmark.datasets.own import KIND, data_sets_of, open_own
from benchmark.errors import BenchmarkError, ConfigurationError, one_line
from benchmark.execution.processes.calls import BrokenCall, Guard, KilledCall, call_apart
from benchmark.plugins.information import problems_of
from benchmark.plugins.modules import is_imported, require_file
from benchmark.plugins.specs import MethodSpec, PluginSpec, S, ScorerSpec, plugin_methods, plugins_of

__all__ = ["LIMIT", "inspect", "inspect_package"]

#: Seconds that importing a file, making its methods and listing the shapes of its data sets may take.
LIMIT = 30.0

#: What plugins have told: of each file, and of each method and scorer by kind, target and name.
_files: dict[str, list[dict[str, Any]]] = {}
told: dict[tuple[str, str, str], dict[str, Any]] = {}

#: Deaths by somebody else's hand after which a file is blamed for them.
_MAX_RETRIES = 3


#: Modules that the whole suite relies on: a plugin may use them, but not change them.
_RELIED_ON = frozenset(
    {"builtins", "io", "json", "os", "pathlib", "posix", "shutil", "signal", "subprocess", "sys", "threading", "time"}
    | {"click", "matplotlib", "numpy", "pandas", "scipy"}
    | {"baselines", "benchmark", "learned", "retrieval"}
)


def inspect(paths: Iterable[Path], *, made: bool = True) -> None:
    """Make sure that plugin files can be imported, and their methods made, without harm to this process.

    A file that this process has imported before is not looked at again.

    Parameters
    ----------
    paths
        The files.
    made
        Whether to make and describe the methods; otherwise the files are imported and no more.

    Raises
    ------
    ConfigurationError
        If a file is not there, cannot be imported, defines no method, or one that cannot be made or described; also if
        it crashes, exits or hangs on the way, or changes what is not its own.
    """
    for path in paths:
        file = str(path.resolve())
        if is_imported(file) or file in _files:
            continue
        require_file(file)
        hint = "correct the file: importing it and making its methods must end at once"
        facts = look(describe, file, made, guard=Guard(f"plugin {path}", hint, LIMIT, quiet=True))
        if made:
            _files[file] = facts
            told.update({(each["kind"], each["target"], each["name"]): each for each in facts})


def is_passed(path: str) -> bool:
    """Return whether this process knows a plugin file, given by its absolute path."""
    return is_imported(path) or path in _files


def facts_of_file(path: str) -> list[dict[str, Any]]:
    """What each plugin of a file has told, see :func:`describe`."""
    inspect([Path(path)])
    return _files[path]


def inspect_package(package: str, kind: type[S], targets: Mapping[str, str]) -> dict[str, BenchmarkError]:
    """Find out which plugins of an installed package cannot be imported, made or described.

    Parameters
    ----------
    package
        Its name.
    kind
        Methods or scorers.
    targets
        Where each is defined, ``"module:attribute"``, by its name.

    Returns
    -------
    dict
        What is wrong with each that cannot be used, by its name.

    Raises
    ------
    ConfigurationError
        If the package crashes, exits or hangs on the way, or changes what is not its own.
    """
    if not targets:
        return {}
    hint = f"correct the package, or uninstall it: importing it and making its {kind.kind}s must end at once"
    guard = Guard(f"package {package}", hint, LIMIT, quiet=True)
    faults, facts = look(look_into_package, package, kind, dict(targets), guard=guard)
    told.update({(each["kind"], each["target"], each["name"]): each for each in facts})
    return {name: ConfigurationError(problem, hint) for name, (problem, hint) in faults.items()}


def look(function: Callable[..., Any], *arguments: Any, guard: Guard) -> Any:
    """Call a function apart, again if somebody else may have ended its process."""
    retries = _MAX_RETRIES
    while True:
        retries -= 1
        try:
            return call_apart(function, *arguments, guard=guard)
        except BrokenCall as error:
            if not (retries and isinstance(error, KilledCall)):
                raise ConfigurationError(error.problem, error.hint) from error


def describe(path: str, made: bool = True) -> list[dict[str, Any]]:
    """Facts about each method of a plugin file, and each data set, which is imported here.

    Returns
    -------
    list of dict
        See :attr:`benchmark.plugins.specs.PluginSpec.facts`; name, title and number of shapes of each data set.

    Raises
    ------
    ConfigurationError
        If a method cannot be made with its defaults, or cannot be described in plain values, or if the file changes a
        module that the suite relies on.
    DatasetError
        If a data set lists no shapes as it should.
    """
    before, streams = _relied_on(), _streams()
    specs: list[PluginSpec[Any, Any]] = [*plugin_methods(Path(path)), *plugins_of(ScorerSpec, Path(path))]
    data_sets = data_sets_of([Path(path)])
    facts = [_described(spec) for spec in specs] if made else []
    for source in data_sets.values() if made else ():
        opened = open_own(source)
        facts.append(
            {
                "kind": KIND,
                "target": source,
                "name": opened.name,
                "title": opened.title,
                "shapes": len(opened.entries),
                "sources": opened.sources,
            }
        )
    _require_unchanged(before, streams, f"plugin {path}")
    return facts


def look_into_package(
    package: str, kind: type[S], targets: Mapping[str, str]
) -> tuple[dict[str, tuple[str, str]], list[dict[str, Any]]]:
    """Problem and hint of each plugin of an installed package that cannot be used, and what the others tell.

    Raises
    ------
    ConfigurationError
        If the package, which is imported here, changes a module that the suite relies on.
    """
    before, streams = _relied_on(), _streams()
    faults: dict[str, tuple[str, str]] = {}
    facts = []
    for name, target in targets.items():
        spec = kind(name, target)
        try:
            for problem, hint in problems_of(spec.info):
                raise ConfigurationError(problem, hint)
            facts.append(_described(spec))
        except BenchmarkError as error:
            faults[name] = (error.problem, error.hint)
        except (Exception, SystemExit) as error:
            faults[name] = (one_line(error), "correct the package, or uninstall it")
    _require_unchanged(before, streams, f"package {package}")
    return faults, facts


def _require_unchanged(before: Mapping[tuple[str, str], Any], streams: list[object], whose: str) -> None:
    """Raise unless the modules that the suite relies on, and the standard streams, are as they were."""
    if _streams() != streams:
        raise ConfigurationError(f"{whose} closes or replaces a standard stream", "leave input and output open")
    for (name, attribute), value in before.items():
        if vars(sys.modules.get(name, builtins)).get(attribute) is not value:
            raise ConfigurationError(
                f"{whose} changes {name}.{attribute}, which the suite relies on", "leave other modules as they are"
            )


def _streams() -> list[object]:
    """Return what the standard streams lead to; None for one that is closed."""
    found: list[object] = [stream is None for stream in (sys.stdout, sys.stderr)]
    for number in range(3):
        try:
            status = os.fstat(number)
        except OSError:
            found.append(None)
        else:
            found.append((status.st_dev, status.st_ino))
    return found


def _relied_on() -> dict[tuple[str, str], Any]:
    """Functions and classes of the modules that the suite relies on, as far as they are imported."""
    return {
        (name, attribute): value
        for name, module in list(sys.modules.items())
        if name.partition(".")[0] in _RELIED_ON
        for attribute, value in list(vars(module).items())
        if callable(value)
    }


def _described(spec: PluginSpec[Any, Any]) -> dict[str, Any]:
    if not spec.missing_packages() and isinstance(spec, MethodSpec) and spec.learns:
        learner: Any = spec.create()
        if not isinstance(learner.model_name, str) or learner.split not in get_args(Split):
            raise ConfigurationError(
                f"{spec.module}, {spec.name}: model_name is {learner.model_name!r}, split is {learner.split!r}",
                f"let model_name be a text, and split one of {', '.join(get_args(Split))}",
            )
    try:
        return spec.facts
    except (TypeError, ValueError) as error:
        raise ConfigurationError(
            f"parameters of {spec.module}, {spec.name} do not fit into JSON ({error})",
            "use numbers, strings and tuples of them",
        ) from error
