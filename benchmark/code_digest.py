"""Digests of the code that makes a result: sources, compiled extensions and versions of packages; nothing is imported.

The code of a module is its source and that of everything that it imports from the suite, from its own package, or from
the folder of a plugin file, directly or not: imports inside functions count, and so do lazy attributes of packages.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.metadata
import importlib.util
import json
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

from benchmark.errors import ConfigurationError

FIRST_PARTY = ("benchmark", "baselines", "learned", "retrieval")

#: Folder that holds the packages of the suite.
ROOT = Path(__file__).parents[1]

_DIGITS = 16


def code_digest(target: str, files: Iterable[str] = ()) -> str:
    """Return the digest of :func:`code_of`; the name of a plugin file does not count."""
    path = plugin_file(target)
    parts = code_of(target, files).items()
    content = sorted(("" if path and name == path.name else name, part) for name, part in parts)
    return digest_of_bytes(json.dumps(content).encode())


def code_of(target: str, files: Iterable[str] = ()) -> dict[str, str]:
    """Return what the code of a module consists of.

    Parameters
    ----------
    target
        Name of a module or path of a plugin file, optionally with ``:attribute``.
    files
        Other files on which its results depend, relative to its folder.

    Returns
    -------
    dict
        Digest of each source without docstrings, of each compiled extension and of each of the files, by path; version
        of each package, by the name of its distribution.

    Raises
    ------
    ConfigurationError
        If there is no such module, or one of the files is missing or is a folder.
    """
    closure = _closure_of(target)
    parts = {path.relative_to(base).as_posix(): _parsed(path).digest for path, base in closure.sources.items()}
    for top in sorted(closure.packages):
        parts |= _versions(top)
    for name in files:
        path = closure.start.parent / name
        if not path.is_file():
            problem = f"{closure.start.name} depends on '{name}', which is {'a folder' if path.is_dir() else 'missing'}"
            raise ConfigurationError(problem, f"correct 'files': paths of files, relative to {closure.start.parent}")
        parts[name] = digest_of_bytes(path.read_bytes())
    return parts


def plugin_file(target: str) -> Path | None:
    """Return the path of the plugin file in a target such as ``"/path/smooth.py:Smooth"``; None for another module."""
    path = target if target.endswith(".py") else target.rpartition(":")[0]
    return Path(path) if path.endswith(".py") else None


def sources_of(target: str) -> list[Path]:
    """Return the source files in the code of a module."""
    return list(_closure_of(target).sources)


def modules_beside(path: Path) -> dict[str, Path]:
    """Return the modules and packages beside a plugin file that it imports, directly or not, by name."""
    helpers = (source.relative_to(base) for source, base in _closure_of(str(path)).sources.items() if base != ROOT)
    names = {helper.parts[0].partition(".")[0] for helper in helpers} - {path.stem}
    return {name: found for name in sorted(names) if (found := _locate(path.parent, (name,)))}


def digest_of_bytes(content: bytes) -> str:
    """Return the digest of bytes: 16 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()[:_DIGITS]


# Imports -------------------------------------------------------------------------------------------------------------


@dataclass
class _Closure:
    """A module with all that it imports: the folder of top-level modules by source file, and foreign packages."""

    start: Path
    sources: dict[Path, Path] = field(default_factory=dict)
    packages: set[str] = field(default_factory=set)


def _closure_of(target: str) -> _Closure:
    path = plugin_file(target)
    name = path.stem if path else target.partition(":")[0]
    base = path.resolve().parent if path else _base_of(name)
    own = {name.partition(".")[0], *FIRST_PARTY} if path is None else None  # beside a plugin file, any module counts
    start = path.resolve() if path else _locate(base, tuple(name.split(".")))
    if start is None or not start.is_file():
        raise ConfigurationError(f"there is no module {path or name}", "correct the name")
    closure = _Closure(start, {start: base})
    pending = [(start, "" if path else name)]
    while pending:
        source, importer = pending.pop()
        names = list(_absolute(_parsed(source), importer, source.stem == "__init__"))
        for imported in names:
            top, *_ = parts = tuple(imported.split("."))
            where = ROOT if top in FIRST_PARTY else base
            is_local = top in own if own else top not in sys.stdlib_module_names
            found = _locate(where, parts) if is_local else None
            if found and found not in closure.sources:
                closure.sources[found] = where
                pending.append((found, imported))
            elif found is None and is_local and len(parts) > 1:
                names += [name for name in _lazy(where, imported) if name not in names]
            if top not in sys.stdlib_module_names and not (is_local and _locate(where, (top,))):
                closure.packages.add(top)
    return closure


def _base_of(name: str) -> Path:
    """Return the folder that holds a top-level package."""
    top = name.partition(".")[0]
    if top in FIRST_PARTY:
        return ROOT
    spec = importlib.util.find_spec(top)
    if spec is None or spec.origin is None:
        raise ConfigurationError(f"there is no module {name}", "install its package")
    return Path(spec.origin).parents[1 if spec.submodule_search_locations else 0]


@cache
def _locate(base: Path, parts: tuple[str, ...]) -> Path | None:
    """Return the file of a module below a folder: a source, a package or a compiled extension."""
    stem = base.joinpath(*parts)
    candidates = (stem / "__init__.py", *(Path(f"{stem}{suffix}") for suffix in (".py", *EXTENSION_SUFFIXES)))
    return next((path for path in candidates if path.is_file()), None)


def _absolute(module: _Module, name: str, is_package: bool) -> Iterator[str]:
    """Yield the full names of all modules that a module may import, packages around them included."""
    package = name if is_package else name.rpartition(".")[0]
    for level, imported, attribute in module.imports:
        around = package.split(".")[: len(package.split(".")) - level + 1] if level else []
        full = [*around, *(imported.split(".") if imported else [])]
        yield from (".".join(full[:count]) for count in range(1, len(full) + 1))
        if attribute:
            yield ".".join([*full, attribute])


def _lazy(base: Path, name: str) -> Iterator[str]:
    """Yield the module of a lazy attribute of a package, or all modules of the package if it does not list them."""
    *package, attribute = name.split(".")
    path = _locate(base, tuple(package)) if package else None
    modules = None if path is None or path.name != "__init__.py" else _parsed(path).lazy
    if modules is None or attribute.startswith("_"):
        return
    if attribute in modules:
        yield modules[attribute]
    elif path and not modules:
        inside = (part.relative_to(base).with_suffix("").parts for part in sorted(path.parent.rglob("*.py")))
        yield from (".".join(parts) for parts in inside if parts[-1] != "__init__")


@dataclass(frozen=True)
class _Module:
    """Digest of a source file, its imports (level, module, attribute) and the modules of its lazy attributes."""

    digest: str
    imports: tuple[tuple[int, str, str], ...] = ()
    lazy: dict[str, str] | None = None


def _parsed(path: Path) -> _Module:
    status = path.stat()
    return _parsed_once(path, status.st_mtime_ns, status.st_size)


@cache
def _parsed_once(path: Path, _: int, __: int) -> _Module:
    content = path.read_bytes()
    if path.suffix != ".py":
        return _Module(digest_of_bytes(content))
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError):  # found and named when it is imported
        return _Module(digest_of_bytes(content))
    imports, lazy = tuple(dict.fromkeys(_imports(tree))), _lazy_attributes(tree)
    for node in ast.walk(tree):
        for body in (getattr(node, name, None) for name in ("body", "orelse", "finalbody")):
            if isinstance(body, list):  # docstrings of attributes included
                body[:] = [part for part in body if not (isinstance(part, ast.Expr) and _text(part.value) is not None)]
    return _Module(digest_of_bytes(ast.dump(tree).encode()), imports, lazy)


def _lazy_attributes(tree: ast.Module) -> dict[str, str] | None:
    """Return the texts that a module with ``__getattr__`` maps to texts: modules by attribute, by convention."""
    if not any(isinstance(node, ast.FunctionDef) and node.name == "__getattr__" for node in tree.body):
        return None
    tables = [node for node in ast.walk(tree) if isinstance(node, ast.Dict)]
    pairs = (
        (_text(key), _text(value)) for table in tables for key, value in zip(table.keys, table.values, strict=True)
    )
    return {key: value for key, value in pairs if key and value}


def _imports(node: ast.AST) -> Iterator[tuple[int, str, str]]:
    """Yield level, module and attribute of each import, those for type checkers alone left out."""
    if isinstance(node, ast.If) and _name(node.test) == "TYPE_CHECKING":
        node = ast.Module(node.orelse, [])
    if isinstance(node, ast.Import):
        yield from ((0, alias.name, "") for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        yield from ((node.level, node.module or "", alias.name) for alias in node.names)
    elif isinstance(node, ast.Call) and _name(node.func) == "import_module" and node.args:
        yield from [(0, name, "")] if (name := _text(node.args[0])) else []
    for child in ast.iter_child_nodes(node):
        yield from _imports(child)


def _name(node: ast.AST) -> str:
    return str(getattr(node, "attr", getattr(node, "id", "")))


def _text(node: ast.AST | None) -> str | None:
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


@cache
def _versions(top: str) -> dict[str, str]:
    """Return the version of the distribution of a package, without its build tag; empty if it is not installed."""
    try:
        names = [top] if importlib.metadata.version(top) else []
    except importlib.metadata.PackageNotFoundError:
        names = sorted(set(_distributions().get(top, ())))
    return {name.lower(): importlib.metadata.version(name).partition("+")[0] for name in names}


@cache
def _distributions() -> dict[str, list[str]]:
    return dict(importlib.metadata.packages_distributions())
