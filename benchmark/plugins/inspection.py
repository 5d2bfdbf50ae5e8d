"""What plugin files and installed packages bring, looked at from a process of its own, which imports them."""

from __future__ import annotations

import builtins
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import Distribution, EntryPoint, distributions
from pathlib import Path
from typing import Any, Generic, TypeVar

from benchmark.errors import BenchmarkError, ConfigurationError, DatasetError, one_line
from benchmark.execution.processes.process import is_child
from benchmark.plugins import is_closed
from benchmark.plugins.modules import classes_of, is_imported, require_file
from benchmark.plugins.output_checks import problems_of
from benchmark.plugins.remote import Facts, look, remember
from benchmark.plugins.specs import KINDS, DatasetSpec, PluginSpec
from benchmark.text import is_name

S = TypeVar("S", bound=PluginSpec[Any, Any])

#: What the plugins of each file have told, by its absolute path.
_files: dict[str, list[Facts]] = {}

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
        if is_passed(file):
            continue
        require_file(file)
        hint = "correct the file: importing it and making its methods must end at once"
        plugins = look(describe, file, made, what=f"plugin {path}", hint=hint)
        if made:
            _files[file] = plugins
            remember(*plugins)


def is_passed(path: str) -> bool:
    """Return whether this process knows a plugin file, given by its absolute path."""
    return is_imported(path) or path in _files


def describe(path: str, made: bool = True) -> list[Facts]:
    """Facts about each plugin of a file, which is imported here; see :attr:`benchmark.plugins.specs.PluginSpec.facts`.

    Raises
    ------
    ConfigurationError
        If a method cannot be made with its defaults, or cannot be described in plain values, or if the file changes a
        module that the suite relies on.
    DatasetError
        If a data set lists no shapes as it should.
    """
    with _unchanged(f"plugin {path}"):
        specs = plugins_in(Path(path))
        return [spec.facts for spec in specs] if made else []


def plugins_in(path: Path) -> list[PluginSpec[Any, Any]]:
    """Plugins that a file defines: methods, scorers and data sets, each in the order of the file.

    Raises
    ------
    ConfigurationError
        If the file cannot be imported, defines nothing, or a plugin says of itself what cannot be.
    """
    if is_closed():
        inspect([path])
        return [KINDS[facts["kind"]](facts["info"]["name"], facts["target"]) for facts in _files[str(path.resolve())]]
    specs = []
    for kind in KINDS.values():
        for attribute, info in classes_of(path, kind.info_type):
            for problem, hint in problems_of(info):
                error = DatasetError if kind is DatasetSpec else ConfigurationError
                raise error(f"plugin {path}, {attribute}: {problem}", hint)
            specs.append(kind(info.name, f"{path.resolve()}:{attribute}"))
    if not specs:
        raise ConfigurationError(
            f"plugin {path} defines no method, no scorer and no data set",
            "give a class an 'info' that is a MethodInfo, a ScorerInfo or a DatasetInfo, or use @canonical_form",
        )
    return specs


def plugins_of(kind: type[S], path: Path) -> list[S]:
    """Those of one kind; see :func:`plugins_in`."""
    return [spec for spec in plugins_in(path) if isinstance(spec, kind)]


@contextmanager
def _unchanged(whose: str) -> Iterator[None]:
    """Raise unless the modules that the suite relies on, and the standard streams, stay as they are in the body."""
    before, streams = _relied_on(), _streams()
    yield
    if _streams() != streams:
        raise ConfigurationError(f"{whose} closes or replaces a standard stream", "leave input and output open")
    for (name, attribute), value in before.items():
        if vars(sys.modules.get(name, builtins)).get(attribute) is not value:
            raise ConfigurationError(
                f"{whose} changes {name}.{attribute}, which the suite relies on", "leave other modules as they are"
            )


def _streams() -> list[object]:
    """Return what the standard streams lead to; None for one that is closed."""
    places: list[object] = [sys.stdout is None, sys.stderr is None, None, None, None]
    for number in range(3):
        with suppress(OSError):
            status = os.fstat(number)
            places[2 + number] = (status.st_dev, status.st_ino)
    return places


def _relied_on() -> dict[tuple[str, str], Any]:
    """Functions and classes of the modules that the suite relies on, as far as they are imported."""
    return {
        (name, attribute): value
        for name, module in list(sys.modules.items())
        if name.partition(".")[0] in _RELIED_ON
        for attribute, value in list(vars(module).items())
        if callable(value)
    }


# Installed packages --------------------------------------------------------------------------------------------------

_HINT = "correct the package, or uninstall it"

#: Problem and hint of each plugin of a package that cannot be used, by its name; "" stands for all of them.
Faults = dict[str, tuple[str, str]]


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
    usable: dict[str, str] = {}
    errors: dict[str, ConfigurationError] = {}
    news = []
    for package, distribution in _packages(entry_points_of(kind)):
        targets, faults = _look_at(package, distribution, kind, taken | usable.keys())
        if faults:
            news.append(str(_error(package, kind, faults)))
        errors |= {name: _error(package, kind, {name: fault}) for name, fault in faults.items()}
        usable |= {name: target for name, target in targets.items() if name not in faults}
    errors = {name: error for name, error in errors.items() if name not in usable}
    return Installed(tuple(kind(*pair) for pair in usable.items()), errors, tuple(news))


def _error(package: str, kind: type[S], faults: Faults) -> ConfigurationError:
    """Return what of a package cannot be used, with the reason of the first."""
    problem, hint = next(iter(faults.values()))
    names = ", ".join(filter(None, faults)) or f"all {kind.kind}s"
    return ConfigurationError(f"installed package {package}, {names}: {problem}", hint or _HINT)


def _packages(group: str) -> Iterator[tuple[str, Distribution]]:
    """Packages with entry points of a group, by name; of several of one name, the first on the path counts."""
    named: dict[str, Distribution] = {}
    for distribution in distributions():
        with suppress(OSError, ValueError):  # no text at all, so no plugin is named there
            if group in (distribution.read_text("entry_points.txt") or ""):
                named.setdefault(str(distribution.metadata["Name"]), distribution)
    yield from sorted(named.items(), key=lambda pair: pair[0])


def _look_at(
    package: str, distribution: Distribution, kind: type[S], taken: frozenset[str]
) -> tuple[dict[str, str], Faults]:
    """Return where the plugins of a package are defined, and what is wrong with those that cannot be used."""
    targets: dict[str, str] = {}
    faults: Faults = {}
    try:
        for point in distribution.entry_points.select(group=entry_points_of(kind)):
            if problem := _problem_of(point, kind, taken | targets.keys()):
                faults[point.name] = (problem, _HINT)
            else:
                targets[point.name] = f"{point.module}:{point.attr}"
    except Exception as error:  # what is written about the package is damaged
        return {}, {"": (f"its entry points cannot be read: {one_line(error)}", _HINT)}
    if targets and not is_child():  # others were started to be apart
        hint = f"{_HINT}: importing it and making its {kind.kind}s must end at once"
        try:
            found, plugins = look(describe_package, package, kind.kind, targets, what=f"package {package}", hint=hint)
        except ConfigurationError as error:
            return {}, faults | dict.fromkeys(targets, (error.problem, error.hint))
        faults |= found
        remember(*plugins)
    return targets, faults


def _problem_of(point: EntryPoint, kind: type[S], taken: Iterable[str]) -> str:
    """Return what is wrong with an entry point."""
    if not point.pattern.match(point.value) or not point.attr:
        return f"{point.value!r:.80} is not 'module:class'"
    if not is_name(point.name):
        return "that is not lower-case words joined by hyphens"
    return f"another {kind.kind} has this name" if point.name in taken else ""


def describe_package(package: str, kind: str, targets: Mapping[str, str]) -> tuple[Faults, list[Facts]]:
    """Problem and hint of each plugin of an installed package that cannot be used, and what the others tell.

    Raises
    ------
    ConfigurationError
        If the package, which is imported here, changes a module that the suite relies on.
    """
    faults: Faults = {}
    plugins = []
    with _unchanged(f"package {package}"):
        for name, target in targets.items():
            spec = KINDS[kind](name, target)
            try:
                for problem, hint in problems_of(spec.info):
                    raise ConfigurationError(problem, hint)
                plugins.append(spec.facts)
            except BenchmarkError as error:
                faults[name] = (error.problem, error.hint)
            except (Exception, SystemExit) as error:
                faults[name] = (one_line(error), _HINT)
    return faults, plugins
