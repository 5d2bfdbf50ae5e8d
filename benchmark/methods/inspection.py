"""A look at plugin files from a safe distance: each is imported, and its methods are made, in a process of its own."""

from __future__ import annotations

import builtins
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, get_args

from benchmark.errors import ConfigurationError
from benchmark.learning import Split
from benchmark.methods.plugins import is_imported, require_file
from benchmark.methods.registry import MethodSpec, plugin_methods
from benchmark.storage import keys
from benchmark.system.calls import BrokenCall, KilledCall, call_apart

__all__ = ["LIMIT", "inspect"]

#: Seconds that importing a file and making its methods may take.
LIMIT = 30.0

#: Deaths by somebody else's hand after which a file is blamed for them.
_LIVES = 3


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
        found = str(path.resolve())
        if is_imported(found):
            continue
        require_file(found)
        what, mend = f"plugin {path}", "mend the file: importing it and making its methods must end at once"
        for lives in reversed(range(_LIVES)):
            try:
                call_apart(describe, found, made, what=what, mend=mend, limit=LIMIT, quiet=True)
                break
            except BrokenCall as error:
                if not (lives and isinstance(error, KilledCall)):
                    raise ConfigurationError(error.problem, error.mend) from error


def describe(path: str, made: bool = True) -> list[dict[str, Any]]:
    """Name, title, inputs and parameters of each method of a plugin file, which is imported here.

    Raises
    ------
    ConfigurationError
        If a method cannot be made with its defaults, or cannot be described in plain values, or if the file changes a
        module that the suite relies on.
    """
    before = _relied_on()
    specs = plugin_methods(Path(path))
    facts = [_described(spec) for spec in specs] if made else []
    for (name, attribute), value in before.items():
        if vars(sys.modules.get(name, builtins)).get(attribute) is not value:
            raise ConfigurationError(
                f"plugin {path} changes {name}.{attribute}, which the suite relies on",
                "leave other modules as they are",
            )
    return facts


def _relied_on() -> dict[tuple[str, str], Any]:
    """Functions and classes of the modules that the suite relies on, as far as they are imported."""
    return {
        (name, attribute): value
        for name, module in list(sys.modules.items())
        if name.partition(".")[0] in _RELIED_ON
        for attribute, value in list(vars(module).items())
        if callable(value)
    }


def _described(spec: MethodSpec) -> dict[str, Any]:
    info = spec.info
    facts = {"name": info.name, "title": info.title, "inputs": list(info.inputs), "parameters": {}}
    if spec.missing_packages():
        return facts  # it is unavailable, and need not be made
    try:
        facts["parameters"] = keys.plain(spec.resolved_parameters())
    except (TypeError, ValueError) as error:
        raise ConfigurationError(
            f"parameters of {spec.module}, {spec.name} do not fit into JSON ({error})",
            "use numbers, strings and tuples of them",
        ) from error
    if spec.learns:
        learner: Any = spec.create()
        if not isinstance(learner.model_name, str) or learner.split not in get_args(Split):
            raise ConfigurationError(
                f"{spec.module}, {spec.name}: model_name is {learner.model_name!r}, split is {learner.split!r}",
                f"let model_name be a text, and split one of {', '.join(get_args(Split))}",
            )
    return facts
