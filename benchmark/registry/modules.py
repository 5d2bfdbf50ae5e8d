"""Import modules and plugin files; modules beside a plugin file can be imported, too."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
from collections.abc import Iterable
from contextlib import redirect_stdout
from pathlib import Path
from types import ModuleType
from typing import Any

from benchmark.code_digest import modules_beside, plugin_file, sources_of
from benchmark.errors import BenchmarkError, ConfigurationError, locate
from benchmark.files import file_digest
from benchmark.kernels import drop_stale_kernels
from benchmark.text import Printed

#: Contents of the sources of each plugin module when it was imported.
_imported: dict[str, list[str]] = {}


def load_module(target: str) -> ModuleType:
    """Import the module of a target such as ``"baselines.gps:GPS"`` or ``"/path/smooth.py:Smooth"``.

    A plugin file gets a name of its own, so that ``random.py`` does not replace the standard module. If it, or a module
    beside it, was edited since it was imported, it is imported again. What it prints goes to stderr.

    Raises
    ------
    ConfigurationError
        If there is no such module, it cannot be imported, or a module beside it has the name of another one.
    """
    path = plugin_file(target)
    name = target.partition(":")[0] if path is None else _unique_name(path)
    if name in sys.modules and (path is None or _imported.get(name) == _contents(target)):
        return sys.modules[name]
    if path is not None:
        for helper in _check_helpers(path):
            _forget(helper)
        _imported[name] = _contents(target)
    try:
        with redirect_stdout(Printed()):
            return importlib.import_module(name) if path is None else _execute(name, path.resolve())
    except (Exception, SystemExit) as error:
        sys.modules.pop(name, None)
        hint = "" if isinstance(error, BenchmarkError) else "correct it"  # which has a hint of its own
        if isinstance(error, ModuleNotFoundError) and error.name:
            hint = f"install '{error.name}', or put {error.name.partition('.')[0]}.py beside the file"
        raise ConfigurationError(f"{path or name} cannot be imported: {locate(error)}", hint) from error


def _unique_name(path: Path) -> str:
    return f"plugin_{path.stem}_{hashlib.sha256(os.fsencode(path.resolve())).hexdigest()[:8]}"


def _contents(target: str) -> list[str]:
    return [file_digest(path) for path in sources_of(target)]


def _forget(name: str) -> None:
    """Let a module and what it contains be imported again."""
    for known in [known for known in sys.modules if known == name or known.startswith(f"{name}.")]:
        del sys.modules[known]


def _check_helpers(path: Path) -> Iterable[str]:
    """Return the modules beside a plugin file; raise ``ConfigurationError`` if one has the name of another module."""
    helpers = modules_beside(path)
    for helper, file in helpers.items():
        spec = importlib.util.find_spec(helper)
        if spec is not None and Path(spec.origin or "").resolve() != file.resolve():
            other = spec.origin or "another package"
            raise ConfigurationError(f"{path} imports {file}, but '{helper}' is also the name of {other}", "rename one")
    return helpers


def _execute(name: str, path: Path) -> ModuleType:
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    drop_stale_kernels(sources_of(str(path)))
    spec: Any = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
