"""Import plugin files as modules, with the modules next to them."""

from __future__ import annotations

import ast
import difflib
import hashlib
import importlib
import importlib.metadata
import importlib.util
import os
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import redirect_stdout, suppress
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import TypeVar

from benchmark.errors import ConfigurationError, did_you_mean, one_line
from benchmark.execution.processes.opened_files import NOT_OF_PLUGINS, digest_of_file, leave_out
from benchmark.execution.processes.process import adopt, one_of_us
from benchmark.plugins import is_closed
from benchmark.source_code import FIRST_PARTY, digest_of_source

Info = TypeVar("Info")


class _PluginFolders:
    """Finder of modules next to plugin files; it is searched last, so that no installed module is hidden."""

    folders: list[str] = []  # noqa: RUF012

    @classmethod
    def find_spec(
        cls, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find a top-level module in one of the folders."""
        return PathFinder.find_spec(name, cls.folders, target) if path is None else None

    @classmethod
    def add(cls, folder: Path) -> None:
        """Add a folder to search."""
        if cls not in sys.meta_path:
            sys.meta_path.append(cls)
        if str(folder) not in cls.folders:
            cls.folders.append(str(folder))
        importlib.invalidate_caches()  # Python may have cached an older listing of the folder


def import_module(place: str, what: str = "") -> ModuleType:
    """Import a module, or a plugin file under a name derived from its path; its output goes to stderr.

    Modules next to a plugin file can then be imported.

    Parameters
    ----------
    place
        Name of the module, or absolute path of the file.
    what
        Content of the module, for messages.

    Raises
    ------
    ConfigurationError
        If there is no such file, it cannot be imported, or a module next to it has the name of another module.
    """
    name, is_file = _module_name(place), Path(place).is_absolute()
    if name in sys.modules:
        return sys.modules[name]
    if place.partition(".")[0] not in FIRST_PARTY:
        if is_closed():
            raise AssertionError(f"{place} must not be imported into this process")
        adopt()
    if is_file:
        require_file(place)
        sys.dont_write_bytecode = True  # on a full disk, Python leaves a truncated .pyc and never replaces it
        _PluginFolders.add(Path(place).parent)
        _check_helpers(Path(place))
    try:
        with one_of_us(), redirect_stdout(sys.stderr):
            return _execute(name, place) if is_file else importlib.import_module(place)
    except (Exception, SystemExit) as error:
        sys.modules.pop(name, None)
        hint = "correct the file" if is_file else f"repair {place}"
        if isinstance(error, ModuleNotFoundError) and error.name:
            beside = f", or put {error.name.partition('.')[0]}.py beside the file" if is_file else ""
            hint = f"install '{error.name}'{beside}"
        what = f"plugin {place}" if is_file else what
        raise ConfigurationError(f"{what} cannot be imported: {one_line(error)}", hint) from error


def _execute(name: str, path: str) -> ModuleType:
    loader = SourceFileLoader(name, path)
    module = importlib.util.module_from_spec(ModuleSpec(name, loader, origin=path))
    module.__file__ = path
    sys.modules[name] = module
    loader.exec_module(module)
    return module


def classes_of(path: Path, info_type: type[Info]) -> Iterator[tuple[str, Info]]:
    """Yield name and ``info`` of each class in a plugin file whose ``info`` is of the given type, in order.

    Raises
    ------
    ConfigurationError
        If the file cannot be imported.
    """
    module = import_module(str(path.resolve()))
    for attribute, value in vars(module).items():
        info = getattr(value, "info", None)
        if isinstance(value, type) and value.__module__ == module.__name__ and isinstance(info, info_type):
            yield attribute, info


def require_file(path: str) -> None:
    """Raise ``ConfigurationError`` with the most similar path, unless a path is a Python file."""
    if path.endswith(".py") and Path(path).is_file():
        return
    hint = "pass the path of a .py file"
    if near := difflib.get_close_matches(Path(path).stem, [file.stem for file in Path(path).parent.glob("*.py")], 1):
        hint = f"did you mean {near[0]}.py?"
    what = "is not a Python file" if Path(path).exists() else "is not there"
    raise ConfigurationError(f"plugin {path} {what}", hint)


def unknown(kind: str, name: str, known: Iterable[str]) -> ConfigurationError:
    """Return the error for an unknown name; if a plugin file in this folder defines it, the hint names the file.

    Parameters
    ----------
    kind, name, known
        See :func:`benchmark.errors.did_you_mean`.
    """
    if name.startswith("external-"):
        return ConfigurationError(
            f"'{name}' is scored from files and cannot run", "create it with 'score --results' or 'run --forms'"
        )
    error = did_you_mean(kind, name, known)
    defines = re.compile(rf"""\bname\b[^=\n]*=\s*['"]{re.escape(name)}['"]""")
    for path in (*sorted(Path().glob("*.py")), *sorted(Path().glob("*/*.py"))):
        with suppress(OSError, ValueError):
            if path.parts[0] not in (*FIRST_PARTY, "tests", "tools") and defines.search(
                path.read_text(encoding="utf-8")
            ):
                return ConfigurationError(error.problem, f"pass --plugin {path}, which defines it")
    return error


def is_imported(path: str) -> bool:
    """Return whether this process has imported a plugin file, given by its absolute path."""
    return _module_name(path) in sys.modules


def _module_name(place: str) -> str:
    path = Path(place)
    return f"plugin_{path.stem}_{hashlib.sha256(os.fsencode(place)).hexdigest()[:8]}" if path.is_absolute() else place


def helpers_of(path: Path) -> dict[str, Path]:
    """Return the modules next to a plugin file that it imports, directly or through one of them, by name.

    Parameters
    ----------
    path
        The plugin file.

    Returns
    -------
    dict
        File of each module; for a package, its ``__init__.py``.
    """
    helpers: dict[str, Path] = {}
    pending = [path]
    while pending:
        for name in dict.fromkeys(_imports_of(pending.pop())):
            if not name or "." in name or name in helpers or name in FIRST_PARTY:
                continue
            spec = PathFinder.find_spec(name, [str(path.parent)])
            if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
                continue
            helpers[name] = Path(spec.origin)
            pending += helpers[name].parent.rglob("*.py") if spec.submodule_search_locations else [helpers[name]]
    return helpers


def sources_of(module: str, files: Iterable[str] = ()) -> dict[str, str]:
    """Return the sources of a plugin: digests of its local modules, and versions of the distributions it uses.

    Parameters
    ----------
    module
        Path of a plugin file, or name of a module of an installed package, already imported.
    files
        Other files that it names, relative to its folder.

    Returns
    -------
    dict
        Digest of the code of each imported module outside installed distributions, by its path relative to the plugin,
        otherwise by its name; version of each distribution, by name; digest of each of the other files, "" if missing.
    """
    first = sys.modules[_module_name(module)]
    folder = Path(first.__file__ or "").resolve().parent
    sources: dict[str, str] = {}
    pending, seen = [first], {first.__name__}
    while pending:
        importer = pending.pop()
        if _is_local(importer):
            path = Path(importer.__file__ or "").resolve()
            leave_out(path)
            source = path.relative_to(folder).as_posix() if path.is_relative_to(folder) else path.name
            sources[source] = digest_of_source(path.read_bytes())
            names = dict.fromkeys(_imports_of(path, importer.__package__ or ""))
            pending += [sys.modules[name] for name in names if name in sys.modules and name not in seen]
            seen.update(names)
        elif (top := importer.__name__.partition(".")[0]) not in sys.stdlib_module_names | set(FIRST_PARTY):
            sources |= _versions(top)
    return dict(sorted(sources.items())) | {name: digest_of_file(str(folder / name)) for name in files}


def _imports_of(path: Path, package: str = "") -> Iterator[str]:
    """Return the names of the modules that a file imports, with their packages; none if it cannot be read."""
    try:
        tree = ast.parse(path.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and (package or not node.level):
            around = package.split(".")[: 1 - node.level or None] if node.level else []
            base = ".".join([*around, *([node.module] if node.module else [])])
            names = [base, *(f"{base}.{alias.name}" for alias in node.names)]
        for name in names:
            parts = name.split(".")
            yield from (".".join(parts[:count]) for count in range(1, len(parts) + 1))


def _is_local(module: ModuleType) -> bool:
    """Return whether a module is code from outside Python, installed distributions and the suite."""
    path, top = str(getattr(module, "__file__", None)), module.__name__.partition(".")[0]
    if not path.endswith(".py") or top in FIRST_PARTY or not Path(path).is_file():
        return False
    return not str(Path(path).resolve()).startswith(NOT_OF_PLUGINS)


def _versions(top: str) -> dict[str, str]:
    """Return the version of the distribution of a package, without its build tag."""
    try:
        names = [top] if importlib.metadata.version(top) else []
    except importlib.metadata.PackageNotFoundError:
        names = sorted(set(importlib.metadata.packages_distributions().get(top, ())))
    return {name.lower(): importlib.metadata.version(name).partition("+")[0] for name in names}


def _check_helpers(path: Path) -> None:
    """Raise ``ConfigurationError`` if an import would not find the module next to the plugin."""
    for name, file in helpers_of(path).items():
        spec = importlib.util.find_spec(name)
        other = Path(spec.origin if spec is not None and spec.origin else "Python itself")
        if other.suffix == ".py" and (other.resolve() == file.resolve() or _are_copies(other, file)):
            continue
        raise ConfigurationError(
            f"plugin {path} brings a module '{name}' ({file}), but that name is used by {other}", "rename one of them"
        )


def _are_copies(one: Path, other: Path) -> bool:
    """Return whether two modules have the same source; other files of packages may differ."""
    return "__init__.py" not in (one.name, other.name) and one.is_file() and one.read_bytes() == other.read_bytes()
