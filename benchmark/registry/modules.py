"""Import modules and plugin files; modules beside a plugin file can be imported, too."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
import threading
from collections.abc import Iterable
from contextlib import chdir, redirect_stdout, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

from benchmark.code_digest import is_installed, modules_beside, plugin_file, sources_of
from benchmark.errors import BenchmarkError, ConfigurationError, locate
from benchmark.files import file_digest
from benchmark.kernel_cache import remove_kernels, suite_sources
from benchmark.reads import UndeclaredFile, watching
from benchmark.text import Printed

#: Contents of the sources of each plugin module when it was imported, and of the files that its
#: methods name.
_imported: dict[str, list[str]] = {}

#: Environment variables that plugin files changed when they were imported, as they were before;
#: None for new ones.
_changed: dict[str, str | None] = {}

#: Held while a plugin file is imported: standard output belongs to all threads.
_importing = threading.RLock()


def load_module(target: str) -> ModuleType:
    """Import the module of a target such as ``"baselines.gps:GPS"`` or ``"/path/smooth.py:Smooth"``.

    A plugin file gets a name of its own, so that ``random.py`` does not replace the standard
    module. If its code, or a file that its methods name, was edited since it was imported, it is
    imported again. What it prints goes to stderr.

    Raises
    ------
    ConfigurationError
        If there is no such module, it cannot be imported, a module beside it has the name of
        another one, or it imports a module that is not in its code.
    """
    path = plugin_file(target)
    name = target.partition(":")[0] if path is None else _unique_name(path)
    try:
        if path is None:
            return importlib.import_module(name)
        with _importing:
            known = sys.modules.get(name)
            if known and _imported.get(name) == _contents(target, named_files(known)):
                return known
            with redirect_stdout(Printed()):
                return _import_anew(target, name, path.resolve())
    except UndeclaredFile:
        raise
    except (Exception, SystemExit) as error:
        hint = (
            "" if isinstance(error, BenchmarkError) else "correct it"
        )  # which has a hint of its own
        if isinstance(error, ModuleNotFoundError) and error.name:
            hint = (
                f"install '{error.name}', or put {error.name.partition('.')[0]}.py beside the file"
            )
        if "relative import" in str(error):
            hint = (
                "a plugin is one file and no part of a package: write 'from core import X' for "
                "'from .core import X', with core.py beside the file"
            )
        raise ConfigurationError(
            f"{path or name} cannot be imported: {locate(error)}", hint
        ) from error


def environment() -> dict[str, str]:
    """Return the environment of other processes: what a plugin changes in it is for its own, which imports it anew."""
    return {
        variable: value for variable, value in (os.environ | _changed).items() if value is not None
    }


def import_plugins_anew() -> None:
    """Let each plugin file be imported again, with its helpers, when it is needed next."""
    _imported.clear()


def _import_anew(target: str, name: str, path: Path) -> ModuleType:
    """Import a plugin file, and what belongs to its code, from their sources of today."""
    _imported.pop(name, None)  # until this ends well
    _check_helpers(path)
    importlib.invalidate_caches()
    sources = {*sources_of(target)}.difference(suite_sources())
    for source in sources:  # compiled code of the same second and size may be of an earlier edit
        with suppress(OSError):
            Path(importlib.util.cache_from_source(source)).unlink(missing_ok=True)
    remove_kernels(sources)
    names, files = {source.name for source in sources}, {source.resolve() for source in sources}
    for known in [
        known for known, module in sys.modules.items() if _file_of(module, names) in files
    ]:
        if not is_installed(known):
            del sys.modules[known]
    contents, before = _contents(target), dict(os.environ)
    with chdir("."), watching(target) as declared:  # which it may change
        module = _execute(name, path)
        declared += [path.parent / file for file in named_files(module)]
    for variable in {*before, *os.environ}:
        if os.environ.get(variable) != before.get(variable):
            _changed.setdefault(variable, before.get(variable))
    _imported[name] = contents + _contents(target, named_files(module))[len(contents) :]
    return module


def _file_of(module: ModuleType, names: set[str]) -> Path | None:
    """Return the file of a module that has one of some names."""
    file = getattr(module, "__file__", None) or ""
    return Path(os.path.realpath(file)) if os.path.basename(file) in names else None  # noqa: PTH119  # of thousands


def _unique_name(path: Path) -> str:
    return f"plugin_{path.stem}_{hashlib.sha256(os.fsencode(path.resolve())).hexdigest()[:8]}"


def _contents(target: str, files: Iterable[str] = ()) -> list[str]:
    """Return the digests of the sources of a plugin, itself first, and of files that it declares."""
    sources = sources_of(target)
    paths = *sources, *(sources[0].parent / file for file in files)
    return [file_digest(path, None) for path in paths if path.is_file()]


def named_files(module: ModuleType) -> tuple[str, ...]:
    """Return the files that the methods and scorers of a plugin name, relative to its folder."""
    own = (
        value
        for value in vars(module).values()
        if getattr(value, "__module__", "") == module.__name__
    )
    return tuple(
        {name: None for value in own for name in getattr(getattr(value, "info", None), "files", ())}
    )


def _check_helpers(path: Path) -> None:
    """Raise ``ConfigurationError`` if a module beside a plugin file has the name of another module."""
    for helper, file in modules_beside(path).items():
        spec = importlib.util.find_spec(helper)
        if spec is not None and Path(spec.origin or "").resolve() != file.resolve():
            other = spec.origin or "another package"
            raise ConfigurationError(
                f"{path} imports {file}, but '{helper}' is also the name of {other}", "rename one"
            )


def _execute(name: str, path: Path) -> ModuleType:
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    spec: Any = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
