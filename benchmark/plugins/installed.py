"""Plugins by name; a package that brings some is looked at from a safe distance before it is imported here."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import Distribution, EntryPoint, distributions
from typing import Generic, NoReturn

from benchmark.errors import BenchmarkError, ConfigurationError, one_line
from benchmark.execution.processes.process import is_child
from benchmark.plugins.information import is_name
from benchmark.plugins.inspection import inspect_package
from benchmark.plugins.modules import unknown
from benchmark.plugins.specs import S

__all__ = ["Installed", "KnownPlugins", "entry_points_of", "installed"]

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
