"""A look at plugin files from a safe distance: each is imported, and its methods are made, in a process of its own."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, get_args

from benchmark.errors import ConfigurationError
from benchmark.learning import Split
from benchmark.methods.plugins import is_imported, require_file
from benchmark.methods.registry import MethodSpec, plugin_methods
from benchmark.storage import keys
from benchmark.system.calls import BrokenCall, call_apart
from benchmark.system.workers import memory_per_worker

__all__ = ["LIMIT", "inspect"]

#: Seconds that importing a file and making its methods may take.
LIMIT = 30.0

_MEMORY_SHARE = 0.85


def inspect(paths: Iterable[Path]) -> None:
    """Make sure that plugin files can be imported, and their methods made, without harm to this process.

    A file that this process has imported before is not looked at again.

    Parameters
    ----------
    paths
        The files.

    Raises
    ------
    ConfigurationError
        If a file is not there, cannot be imported, defines no method, or one that cannot be made or described; also if
        it crashes, exits or hangs on the way.
    """
    for path in paths:
        found = str(path.resolve())
        if is_imported(found):
            continue
        require_file(found)
        what, mend = f"plugin {path}", "mend the file: importing it and making its methods must end at once"
        try:
            call_apart(
                describe,
                found,
                what=what,
                mend=mend,
                limit=LIMIT,
                memory=memory_per_worker(1, _MEMORY_SHARE),
                quiet=True,
            )
        except BrokenCall as error:
            raise ConfigurationError(error.problem, error.mend) from error


def describe(path: str) -> list[dict[str, Any]]:
    """Name, title, inputs and parameters of each method of a plugin file, which is imported here.

    Raises
    ------
    ConfigurationError
        If a method cannot be made with its defaults, or cannot be described in plain values.
    """
    return [_described(spec) for spec in plugin_methods(Path(path))]


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
