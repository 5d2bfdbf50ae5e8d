"""Methods that installed packages bring: each package is looked at from a safe distance before it is imported here."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import Distribution, EntryPoint, distributions

from benchmark.errors import BenchmarkError, ConfigurationError, one_line
from benchmark.methods.information import is_name
from benchmark.methods.inspection import inspect_package
from benchmark.methods.specs import MethodSpec

__all__ = ["ENTRY_POINTS", "Installed", "installed"]

ENTRY_POINTS = "canonical_forms.methods"

_HINT = "correct the package, or uninstall it"


@dataclass(frozen=True)
class Installed:
    """Methods, scorers and data sets that installed packages bring.

    Parameters
    ----------
    specs
        Methods that can be used.
    faults
        Why others cannot be, by their names.
    news
        One line for each package of which something cannot be used.
    """

    specs: tuple[MethodSpec, ...]
    faults: Mapping[str, ConfigurationError]
    news: tuple[str, ...]


@cache
def installed(taken: frozenset[str]) -> Installed:
    """Look for packages with methods, in the order of their names.

    A package that breaks when it is imported, or whose methods break when they are made, costs its own methods alone.

    Parameters
    ----------
    taken
        Names that no package can have.
    """
    targets: dict[str, str] = {}
    faults: dict[str, ConfigurationError] = {}
    news = []
    for package, distribution in _packages():
        points: list[EntryPoint] = []
        try:
            points = list(distribution.entry_points.select(group=ENTRY_POINTS))
            found, refused = _targets(points, taken | targets.keys())
            if multiprocessing.parent_process() is None:  # others were started to be apart
                refused |= inspect_package(package, found)
        except BenchmarkError as error:
            found, refused = {}, {point.name: error for point in points}
        except Exception as error:  # what is written about the package is damaged
            unreadable = ConfigurationError(f"its entry points cannot be read: {one_line(error)}", _HINT)
            found, refused = {}, {"": unreadable}
        targets |= {name: target for name, target in found.items() if name not in refused}
        faults |= {name: _told(package, {name: error}) for name, error in refused.items() if name not in targets}
        news += [str(_told(package, refused))] if refused else []
    return Installed(tuple(MethodSpec(*pair) for pair in targets.items()), faults, tuple(news))


def _told(package: str, refused: Mapping[str, BenchmarkError]) -> ConfigurationError:
    """Return what of a package cannot be used, with the reason of the first."""
    first = next(iter(refused.values()))
    return ConfigurationError(
        f"installed package {package}, {', '.join(refused) or 'all methods'}: {first.problem}", first.hint or _HINT
    )


def _packages() -> Iterator[tuple[str, Distribution]]:
    """Packages with methods, by name; of several of one name, the first on the path counts."""
    named: dict[str, Distribution] = {}
    for distribution in distributions():
        try:
            if ENTRY_POINTS in (distribution.read_text("entry_points.txt") or ""):
                named.setdefault(str(distribution.metadata["Name"]), distribution)
        except (OSError, ValueError):  # no text at all, so no method is named there
            continue
    yield from sorted(named.items(), key=lambda pair: pair[0])


def _targets(points: Iterable[EntryPoint], taken: Iterable[str]) -> tuple[dict[str, str], dict[str, BenchmarkError]]:
    """Return where each method of a package is defined, and what is wrong with the entry points of others."""
    targets: dict[str, str] = {}
    refused: dict[str, BenchmarkError] = {}
    for point in points:
        match = point.pattern.match(point.value)
        if not match or not match["attr"]:
            refused[point.name] = ConfigurationError(f"{point.value!r:.80} is not 'module:class'", _HINT)
        elif not is_name(point.name):
            refused[point.name] = ConfigurationError("that is not lower-case words joined by hyphens", _HINT)
        elif point.name in taken:
            refused[point.name] = ConfigurationError("another method has this name", _HINT)
        else:
            targets[point.name] = f"{match['module']}:{match['attr']}"
    return targets, refused
