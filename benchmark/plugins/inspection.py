"""A look at foreign code from a safe distance: a process of its own imports it, and makes what it brings."""

from __future__ import annotations

import builtins
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import Distribution, EntryPoint, distributions
from pathlib import Path
from typing import Any, Generic, NoReturn, get_args

from benchmark.api.learning import Split
from benchmark.datasets.own import KIND, data_sets_of, open_own
from benchmark.errors import BenchmarkError, ConfigurationError, one_line
from benchmark.execution.processes.calls import BrokenCall, Guard, KilledCall, call_apart
from benchmark.execution.processes.process import is_child
from benchmark.plugins.modules import is_imported, require_file, unknown
from benchmark.plugins.specs import (
    MethodSpec,
    PluginSpec,
    S,
    ScorerSpec,
    is_name,
    plugin_methods,
    plugins_of,
    problems_of,
)

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


# Installed packages --------------------------------------------------------------------------------------------------

_HINT = "correct the package, or uninstall it"


@dataclass(frozen=True)
class Installed(Generic[S]):
    """Methods, or scorers, that installed packages bring.

    Parameters
    ----------
    specs
        Those that can be used.
    faults
        Why others cannot be, by their names.
    news
        One line for each package of which something cannot be used.
    """

    specs: tuple[S, ...]
    faults: Mapping[str, ConfigurationError]
    news: tuple[str, ...]


class KnownPlugins(dict[str, S]):
    """Plugins of one kind by name, in the order of the tables; to look up another name raises what is wrong with it.

    Parameters
    ----------
    kind
        Methods or scorers.
    built_in
        Where each of the suite is defined, by its name.
    of_files
        Those of the plugin files that were passed.

    Raises
    ------
    ConfigurationError
        If two have one name.
    """

    def __init__(self, kind: type[S], built_in: Mapping[str, str], of_files: Iterable[S]) -> None:
        super().__init__({name: kind(name, target) for name, target in built_in.items()})
        self._kind, self._installed = kind.kind, installed(kind, frozenset(built_in))  # type: ignore[arg-type]
        self.update({spec.name: spec for spec in self._installed.specs})
        for spec in of_files:
            if spec.name in self:
                raise ConfigurationError(
                    f"two {kind.kind}s are called '{spec.name}': {self[spec.name].target} and {spec.target}",
                    "rename one",
                )
            self[spec.name] = spec

    def __missing__(self, name: str) -> NoReturn:
        raise self._installed.faults.get(name) or unknown(self._kind, name, self)


def entry_points_of(kind: type[S]) -> str:
    """Return the group of the entry points by which packages bring plugins of a kind."""
    return f"canonical_forms.{kind.kind}s"


@cache
def installed(kind: type[S], taken: frozenset[str]) -> Installed[S]:
    """Look for packages with plugins of a kind, in the order of their names.

    A package that breaks when it is imported, or whose plugins break when they are made, costs its own plugins alone.

    Parameters
    ----------
    kind
        Methods or scorers.
    taken
        Names that no package can have.
    """
    targets: dict[str, str] = {}
    faults: dict[str, ConfigurationError] = {}
    news = []
    for package, distribution in _packages(entry_points_of(kind)):
        points: list[EntryPoint] = []
        try:
            points = list(distribution.entry_points.select(group=entry_points_of(kind)))
            found, refused = _targets(kind.kind, points, taken | targets.keys())
            if not is_child():  # others were started to be apart
                refused |= inspect_package(package, kind, found)
        except BenchmarkError as error:
            found, refused = {}, {point.name: error for point in points}
        except Exception as error:  # what is written about the package is damaged
            unreadable = ConfigurationError(f"its entry points cannot be read: {one_line(error)}", _HINT)
            found, refused = {}, {"": unreadable}
        targets |= {name: target for name, target in found.items() if name not in refused}
        faults |= {
            name: _told(package, kind.kind, {name: error}) for name, error in refused.items() if name not in targets
        }
        news += [str(_told(package, kind.kind, refused))] if refused else []
    return Installed(tuple(kind(*pair) for pair in targets.items()), faults, tuple(news))


def _told(package: str, kind: str, refused: Mapping[str, BenchmarkError]) -> ConfigurationError:
    """Return what of a package cannot be used, with the reason of the first."""
    first = next(iter(refused.values()))
    return ConfigurationError(
        f"installed package {package}, {', '.join(refused) or f'all {kind}s'}: {first.problem}", first.hint or _HINT
    )


def _packages(group: str) -> Iterator[tuple[str, Distribution]]:
    """Packages with entry points of a group, by name; of several of one name, the first on the path counts."""
    named: dict[str, Distribution] = {}
    for distribution in distributions():
        try:
            if group in (distribution.read_text("entry_points.txt") or ""):
                named.setdefault(str(distribution.metadata["Name"]), distribution)
        except (OSError, ValueError):  # no text at all, so no plugin is named there
            continue
    yield from sorted(named.items(), key=lambda pair: pair[0])


def _targets(
    kind: str, points: Iterable[EntryPoint], taken: Iterable[str]
) -> tuple[dict[str, str], dict[str, BenchmarkError]]:
    """Return where each plugin of a package is defined, and what is wrong with the entry points of others."""
    targets: dict[str, str] = {}
    refused: dict[str, BenchmarkError] = {}
    for point in points:
        match = point.pattern.match(point.value)
        if not match or not match["attr"]:
            refused[point.name] = ConfigurationError(f"{point.value!r:.80} is not 'module:class'", _HINT)
        elif not is_name(point.name):
            refused[point.name] = ConfigurationError("that is not lower-case words joined by hyphens", _HINT)
        elif point.name in taken:
            refused[point.name] = ConfigurationError(f"another {kind} has this name", _HINT)
        else:
            targets[point.name] = f"{match['module']}:{match['attr']}"
    return targets, refused
