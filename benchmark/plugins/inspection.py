"""Inspect plugin files and installed packages in separate processes, which import them."""

from __future__ import annotations

import builtins
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from importlib.metadata import Distribution, EntryPoint, distributions
from pathlib import Path
from typing import Any, TypeVar

from benchmark.errors import BenchmarkError, ConfigurationError, DatasetError, one_line
from benchmark.execution.processes.process import is_child
from benchmark.plugins import is_closed
from benchmark.plugins.modules import classes_of, is_imported, require_file
from benchmark.plugins.output_checks import problems_of
from benchmark.plugins.remote import Facts, look, remember
from benchmark.plugins.specs import KINDS, DatasetSpec, PluginSpec
from benchmark.text import is_name

S = TypeVar("S", bound=PluginSpec[Any, Any])

#: Facts about the plugins of each file, by its absolute path.
_files: dict[str, list[Facts]] = {}

#: Modules on which the suite relies; a plugin may use them but not change them.
_RELIED_ON = frozenset(
    {"builtins", "io", "json", "os", "pathlib", "posix", "shutil", "signal", "subprocess", "sys", "threading", "time"}
    | {"click", "matplotlib", "numpy", "pandas", "scipy"}
    | {"baselines", "benchmark", "learned", "retrieval"}
)


def inspect(paths: Iterable[Path], *, made: bool = True) -> None:
    """Check in a separate process that plugin files can be imported and their methods created.

    A file that this process has already imported or inspected is not checked again.

    Parameters
    ----------
    paths
        The files.
    made
        Whether to create and describe the methods; otherwise the files are only imported.

    Raises
    ------
    ConfigurationError
        If a file does not exist, cannot be imported, defines no method or one that cannot be created or described,
        crashes, exits or hangs, or changes modules on which the suite relies.
    """
    for path in paths:
        file = str(path.resolve())
        if is_passed(file):
            continue
        require_file(file)
        hint = "correct the file: importing it and creating its methods must not take long"
        plugins = look(describe, file, made, what=f"plugin {path}", hint=hint)
        if made:
            _files[file] = plugins
            remember(*plugins)


def is_passed(path: str) -> bool:
    """Return whether a plugin file, given by its absolute path, has been inspected."""
    return is_imported(path) or path in _files


def describe(path: str, made: bool = True) -> list[Facts]:
    """Import a file here and return the facts of its plugins; see :attr:`benchmark.plugins.specs.PluginSpec.facts`.

    Raises
    ------
    ConfigurationError
        If a method cannot be created with its defaults or described in plain values, or if the file changes a module on
        which the suite relies.
    DatasetError
        If a data set does not list its shapes correctly.
    """
    with _unchanged(f"plugin {path}"):
        specs = plugins_in(Path(path))
        return [spec.facts for spec in specs] if made else []


def plugins_in(path: Path) -> list[PluginSpec[Any, Any]]:
    """Return the plugins in a file: methods, scorers and data sets, each in the order of the file.

    Raises
    ------
    ConfigurationError
        If the file cannot be imported, defines no plugin, or one with an invalid description.
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
    """Return the plugins of one kind; see :func:`plugins_in`."""
    return [spec for spec in plugins_in(path) if isinstance(spec, kind)]


@contextmanager
def _unchanged(whose: str) -> Iterator[None]:
    """Raise an error if the ``with`` block changes the standard streams or modules on which the suite relies."""
    before, streams = _relied_on(), _streams()
    yield
    if _streams() != streams:
        raise ConfigurationError(f"{whose} closes or replaces a standard stream", "keep input and output open")
    for (name, attribute), value in before.items():
        if vars(sys.modules.get(name, builtins)).get(attribute) is not value:
            raise ConfigurationError(
                f"{whose} changes {name}.{attribute}, on which the suite relies", "do not modify other modules"
            )


def _streams() -> list[object]:
    """Return the targets of the standard streams; None for a closed one."""
    places: list[object] = [sys.stdout is None, sys.stderr is None, None, None, None]
    for number in range(3):
        with suppress(OSError):
            status = os.fstat(number)
            places[2 + number] = (status.st_dev, status.st_ino)
    return places


def _relied_on() -> dict[tuple[str, str], Any]:
    """Return the functions and classes of the modules on which the suite relies, if they are imported."""
    return {
        (name, attribute): value
        for name, module in list(sys.modules.items())
        if name.partition(".")[0] in _RELIED_ON
        for attribute, value in list(vars(module).items())
        if callable(value)
    }


# Installed packages --------------------------------------------------------------------------------------------------

_HINT = "correct the package, or uninstall it"

#: Problem and hint of each unusable plugin of a package, by name; "" stands for all plugins.
Faults = dict[str, tuple[str, str]]


def entry_points_of(kind: type[S]) -> str:
    """Return the group of entry points for plugins of a kind."""
    return f"canonical_forms.{kind.kind}s"


@cache
def installed(kind: type[S], taken: frozenset[str]) -> tuple[list[S], dict[str, ConfigurationError], list[str]]:
    """Find the plugins of a kind in installed packages, ordered by the name of the package.

    A package that fails on import, or whose plugins cannot be created, loses only its own plugins.

    Parameters
    ----------
    kind
        Methods or scorers.
    taken
        Names that packages cannot use.

    Returns
    -------
    tuple
        The usable plugins, the errors of unusable ones by name, and one line for each package with an unusable one.
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
    return [kind(*pair) for pair in usable.items()], errors, news


def _error(package: str, kind: type[S], faults: Faults) -> ConfigurationError:
    """Return the error for the unusable plugins of a package, with the reason for the first."""
    problem, hint = next(iter(faults.values()))
    names = ", ".join(filter(None, faults)) or f"all {kind.kind}s"
    return ConfigurationError(f"installed package {package}, {names}: {problem}", hint or _HINT)


def _packages(group: str) -> Iterator[tuple[str, Distribution]]:
    """Return the packages with entry points of a group; of several with one name, the first on the path."""
    named: dict[str, Distribution] = {}
    for distribution in distributions():
        with suppress(OSError, ValueError):  # not text, so it names no plugin
            if group in (distribution.read_text("entry_points.txt") or ""):
                named.setdefault(str(distribution.metadata["Name"]), distribution)
    yield from sorted(named.items(), key=lambda pair: pair[0])


def _look_at(
    package: str, distribution: Distribution, kind: type[S], taken: frozenset[str]
) -> tuple[dict[str, str], Faults]:
    """Return the targets of the plugins of a package, and the problems of unusable ones."""
    targets: dict[str, str] = {}
    faults: Faults = {}
    try:
        for point in distribution.entry_points.select(group=entry_points_of(kind)):
            if problem := _problem_of(point, kind, taken | targets.keys()):
                faults[point.name] = (problem, _HINT)
            else:
                targets[point.name] = f"{point.module}:{point.attr}"
    except Exception as error:  # the metadata of the package are damaged
        return {}, {"": (f"its entry points cannot be read: {one_line(error)}", _HINT)}
    if targets and not is_child():  # other processes are already isolated
        hint = f"{_HINT}: importing it and creating its {kind.kind}s must not take long"
        try:
            refused, plugins = look(describe_package, package, kind.kind, targets, what=f"package {package}", hint=hint)
        except ConfigurationError as error:
            return {}, faults | dict.fromkeys(targets, (error.problem, error.hint))
        faults |= refused
        remember(*plugins)
    return targets, faults


def _problem_of(point: EntryPoint, kind: type[S], taken: Iterable[str]) -> str:
    """Return the problem of an entry point; "" if there is none."""
    if not point.pattern.match(point.value) or not point.attr:
        return f"{point.value!r:.80} is not 'module:class'"
    if not is_name(point.name):
        return "that is not lower-case words joined by hyphens"
    return f"another {kind.kind} has this name" if point.name in taken else ""


def describe_package(package: str, kind: str, targets: Mapping[str, str]) -> tuple[Faults, list[Facts]]:
    """Return problem and hint of each unusable plugin of an installed package, and the facts of the others.

    Raises
    ------
    ConfigurationError
        If the package, which is imported here, changes a module on which the suite relies.
    """
    faults: Faults = {}
    plugins: list[Facts] = []
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
