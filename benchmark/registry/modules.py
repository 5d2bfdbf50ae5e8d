"""Import modules and plugin files; modules beside a plugin file can be imported, too."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
import threading
from collections.abc import Container, Iterable, Set
from contextlib import chdir, redirect_stdout, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

from benchmark.code_digest import is_installed, modules_beside, plugin_file, sources_of
from benchmark.errors import BenchmarkError, ConfigurationError, locate
from benchmark.files import file_digest
from benchmark.kernel_cache import remove_kernels, suite_sources
from benchmark.machine import copies_end, same_umask
from benchmark.reads import UndeclaredFile, watching
from benchmark.text import Printed

#: Digests of the sources of each plugin module when it was imported, and of the files that its
#: methods name, by file.
_imported: dict[str, dict[Path, str]] = {}

#: Environment variables that plugin files changed when they were imported, as they were before;
#: None for new ones.
_changed: dict[str, str | None] = {}

#: Held while a plugin file is imported: standard output belongs to all threads.
_importing = threading.RLock()


def load_module(target: str) -> ModuleType:
    """Import the module of a method or scorer, which may be a plugin file.

    A plugin file is imported again if it, or a file that its methods name, was edited since. What
    it prints goes to stderr.

    Parameters
    ----------
    target
        Module or plugin file, and a class in it: ``"baselines.gps:GPS"`` or
        ``"/path/smooth.py:Smooth"``.

    Raises
    ------
    ConfigurationError
        If there is no such module, it cannot be imported, a module beside it has the name of
        another one, or it imports a module that is not in its code.
    """
    path = plugin_file(target)
    # A plugin gets a name of its own, so that a file "random.py" does not replace Python's module.
    name = target.partition(":")[0] if path is None else _unique_name(path)
    try:
        if path is None:
            return importlib.import_module(name)
        with _importing:  # a lock: threads import one plugin at a time
            imported = sys.modules.get(name)
            if imported and _imported.get(name) == _contents(target, named_files(imported)):
                return imported
            with redirect_stdout(Printed()):
                return _import_anew(target, name, path.resolve())
    except UndeclaredFile:  # says all that the user needs
        raise
    except (Exception, SystemExit) as error:  # code of a user may raise anything
        problem = f"{path or name} cannot be imported: {locate(error)}"
        raise ConfigurationError(problem, _cure_of(error)) from error


def _cure_of(error: BaseException) -> str:
    """Return what to do about an error of an import; "" for one with a hint of its own."""
    if "relative import" in str(error):
        return (
            "a plugin is one file and no part of a package: write 'from core import X' for "
            "'from .core import X', with core.py beside the file"
        )
    if isinstance(error, ModuleNotFoundError) and error.name:
        file = f"{error.name.partition('.')[0]}.py"
        return f"install '{error.name}', or put {file} beside the file"
    return "" if isinstance(error, BenchmarkError) else "correct it"


def environment() -> dict[str, str]:
    """Return the environment of other processes.

    What a plugin changes in it is for its own process, which imports it anew.
    """
    original = os.environ | _changed
    return {variable: value for variable, value in original.items() if value is not None}


def import_plugins_anew() -> None:
    """Let each plugin file be imported again, with its helpers, when it is needed next."""
    _imported.clear()


def _import_anew(target: str, name: str, path: Path) -> ModuleType:
    """Import a plugin file, and the modules beside it that it imports, from their present sources.

    Parameters
    ----------
    target
        The file, optionally with ``:attribute``.
    name
        Name that its module gets.
    path
        The file.

    Raises
    ------
    UndeclaredFile
        If the code reads a file that the plugin does not name.
    """
    # Forget the last import, also if this one fails.
    _imported.pop(name, None)
    _check_helpers(path)
    importlib.invalidate_caches()
    _forget(set(sources_of(target)).difference(suite_sources()))
    contents = _contents(target)
    variables = dict(os.environ)

    # What the code changes of this process is put back, and a copy that it forks goes no further.
    try:
        watch = watching(target, is_imported=False)
        with chdir("."), same_umask(), copies_end(), watch as declared:
            module = _execute(name, path)
            # Files that the module names may be read; they are known only after its code has run.
            declared += [path.parent / file for file in named_files(module)]
    finally:
        # Other processes get the variables as they were: see ``environment``.
        for variable in {*variables, *os.environ}:
            if os.environ.get(variable) != variables.get(variable):
                _changed.setdefault(variable, variables.get(variable))

    # Sources count as they were before the import; named files, and sources in folders that the
    # code has added to the path of modules, as they are now.
    _imported[name] = _contents(target, named_files(module)) | contents
    return module


def _forget(sources: Set[Path]) -> None:
    """Remove the compiled code, kernels and imported modules of some source files."""
    for source in sources:  # compiled code of the same second and size may be of an earlier edit
        with suppress(OSError):
            Path(importlib.util.cache_from_source(source)).unlink(missing_ok=True)
    remove_kernels(sources)
    names = {source.name for source in sources}
    files = {source.resolve() for source in sources}
    for name, module in list(sys.modules.items()):
        if _file_of(module, names) in files and not is_installed(name):
            del sys.modules[name]


def _file_of(module: ModuleType, names: Container[str]) -> Path | None:
    """Return the file of a module that has one of some names."""
    file = getattr(module, "__file__", None) or ""
    if os.path.basename(file) not in names:  # noqa: PTH119  # of thousands
        return None
    return Path(os.path.realpath(file))


def _unique_name(path: Path) -> str:
    """Return the name that the module of a plugin file gets."""
    return f"plugin_{path.stem}_{hashlib.sha256(os.fsencode(path.resolve())).hexdigest()[:8]}"


def _contents(target: str, files: Iterable[str] = ()) -> dict[Path, str]:
    """Return the digests of the sources of a plugin and of its declared files, by file."""
    sources = sources_of(target)
    declared = [sources[0].parent / file for file in files]
    return {path: file_digest(path, None) for path in (*sources, *declared) if path.is_file()}


def named_files(module: ModuleType) -> tuple[str, ...]:
    """Return the files that the methods and scorers of a plugin name, relative to its folder."""
    files: dict[str, None] = {}
    for value in vars(module).values():
        if getattr(value, "__module__", "") == module.__name__:
            files |= dict.fromkeys(getattr(getattr(value, "info", None), "files", ()))
    return tuple(files)


def _check_helpers(path: Path) -> None:
    """Raise ``ConfigurationError`` if a module beside a plugin file has the name of another one."""
    for helper, file in modules_beside(path).items():
        spec = importlib.util.find_spec(helper)
        if spec is not None and Path(spec.origin or "").resolve() != file.resolve():
            other = spec.origin or "another package"
            problem = f"{path} imports {file}, but '{helper}' is also the name of {other}"
            raise ConfigurationError(problem, "rename one")


def _execute(name: str, path: Path) -> ModuleType:
    """Execute a plugin file as a module, beside which others can be imported."""
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    spec: Any = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
