"""From where a class is defined to what it makes: the same guard for methods and for scorers."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, cast

from benchmark.errors import BenchmarkError, ConfigurationError, one_line
from benchmark.system import fingerprints, process_reaper
from benchmark.system.forks import one_of_us
from benchmark.system.plugins import import_plugin, require_open_process


def module_of(target: str) -> str:
    """Module name or plugin path of ``"module:attribute"``."""
    return target.rpartition(":")[0]


def is_foreign(module: str) -> bool:
    """Return whether a module, or a plugin file by its path, is none of this suite."""
    return module.partition(".")[0] not in fingerprints.FIRST_PARTY


def load_class(kind: str, name: str, target: str, info: type[Any], hint: str) -> type[Any]:
    """Import a class that says what it is.

    Parameters
    ----------
    kind, name
        What it is called in messages.
    target
        ``"module:attribute"``, or ``"/path/to/file.py:attribute"`` for a plugin file.
    info
        Type of its class attribute ``info``.
    hint
        What to do about a class without one.

    Raises
    ------
    ConfigurationError
        If it cannot be imported or has no such ``info``.
    """
    place, attribute = module_of(target), target.rpartition(":")[2]
    if is_foreign(place):
        require_open_process(place)
        process_reaper.adopt()
    try:
        with one_of_us():
            module = import_plugin(place) if place.endswith(".py") else importlib.import_module(place)
            found = getattr(module, attribute)
    except ImportError as error:
        raise ConfigurationError(
            f"{kind} '{name}' cannot be imported: {error}", f"install what {place} needs"
        ) from error
    except AttributeError as error:
        raise ConfigurationError(f"{place} has no '{attribute}'", "correct the entry point") from error
    except BenchmarkError:
        raise
    except (Exception, SystemExit) as error:
        raise ConfigurationError(f"{kind} '{name}' cannot be imported: {one_line(error)}", f"hint {place}") from error
    if not isinstance(getattr(found, "info", None), info):
        raise ConfigurationError(f"{target} has no 'info: ClassVar[{info.__name__}]'", hint)
    return cast(type[Any], found)


def make(found: type[Any], name: str, parameters: Mapping[str, Any]) -> Any:
    """Make an object of a class; raises ``ConfigurationError`` if the class refuses the parameters."""
    try:
        with one_of_us():
            return found(**parameters)
    except BenchmarkError:
        raise
    except (Exception, SystemExit) as error:
        raise ConfigurationError(
            f"{name} cannot be made: {one_line(error)}",
            "choose other parameters" if parameters else "give every parameter a default that fits",
        ) from error


def classes_of(
    path: Path, info: type[Any], problems: Callable[[Any], Iterator[tuple[str, str]]]
) -> Iterator[tuple[str, str]]:
    """Name and target of each class of a plugin file with such an ``info``, in the order of the file.

    Raises
    ------
    ConfigurationError
        If the file cannot be imported, or a class says of itself what cannot be.
    """
    module = import_plugin(str(path.resolve()))
    for attribute, value in vars(module).items():
        if isinstance(value, type) and value.__module__ == module.__name__:
            told = getattr(value, "info", None)
            if isinstance(told, info):
                for problem, hint in problems(told):
                    raise ConfigurationError(f"plugin {path}, {attribute}: {problem}", hint)
                yield told.name, f"{path.resolve()}:{attribute}"
