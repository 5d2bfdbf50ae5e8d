"""Digests of the code that makes a result: sources, compiled extensions and versions of packages; nothing is imported.

The code of a module is its source and that of everything that it imports, directly or not, except
installed packages, whose versions count. Imports inside functions count. Of a user's file, all bytes
count. Of the suite, what computes counts, and nothing that checks or speaks:

- neither the modules in :data:`IN_NO_KEY`, nor the ``__init__`` of a package that only passes on a
  name;
- neither docstrings nor what type checkers alone import;
- no messages: texts of ``raise`` statements and of ``named_errors``, and those that are called
  ``problem`` or ``hint``;
- no bounds of parameters: of ``Annotated[int, Interval(1)]``, only the type;
- no texts for tables and lists: the arguments ``title``, ``summary``, ``departs`` and ``cite``.

Of a package without a version, as one that is installed to be edited, all modules count.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.metadata
import importlib.util
import json
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cache, partial
from importlib.machinery import EXTENSION_SUFFIXES
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

from benchmark.errors import ConfigurationError

FIRST_PARTY = ("benchmark", "baselines", "learned", "retrieval")

#: Folder that holds the packages of the suite.
ROOT = Path(__file__).parents[1]

#: Modules that determine no result, and why.
IN_NO_KEY = {
    "benchmark.errors": "says what went wrong",
    "benchmark.text": "prints",
    "benchmark.machine": "describes the machine",
    "benchmark.files": "fetches bytes, whose digest is in the key",
    "benchmark.api.parameters": "checks parameters, whose values are in the key",
    "learned.fitting": "trains models, the digest of whose weights is in the key",
}

#: Ends of the names of variables that hold a part of a message.
_MESSAGES = ("problem", "hint")

#: Functions whose texts are parts of messages.
_SPEAKERS = ("named_errors",)

#: Arguments with texts for tables and lists.
_TEXTS = ("title", "summary", "departs", "cite")


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
        Digest of each source, of each compiled extension and of each of the files, by path; version
        of each package, by the name of its distribution.

    Raises
    ------
    ConfigurationError
        If there is no such module, or one of the files is missing or is a folder.
    """
    sources, packages = _closure(target)
    parts = {
        _relative(path, base).as_posix(): _parsed(path).digest for path, base in sources.items()
    }
    for top in sorted(packages):
        parts |= _versions(top)
    start = next(iter(sources))
    for name in files:
        path = start.parent / name
        if not path.is_file():
            problem = f"{start.name} depends on '{name}', which is {'a folder' if path.is_dir() else 'missing'}"
            raise ConfigurationError(
                problem, f"correct 'files': paths of files, relative to {start.parent}"
            )
        parts[name] = digest_of_bytes(_content_of(path))
    return parts


def code_of_modules(modules: Iterable[str]) -> dict[str, str]:
    """Return what the code of modules consists of."""
    return {name: part for module in modules for name, part in code_of(module).items()}


def definitions_of(code: Iterable[tuple[str, str]]) -> dict[str, dict[str, str]]:
    """Return the digests of functions, methods, classes and constants of the suite, by the digests of their files.

    Parameters
    ----------
    code
        Paths and digests, as :func:`code_of` returns them; a file that has another digest now is
        left out.
    """
    found: dict[str, dict[str, str]] = {}
    for name, part in code:
        path = ROOT / name
        is_of_suite = name.partition("/")[0] in FIRST_PARTY and path.suffix == ".py"
        if is_of_suite and path.is_file() and _parsed(path).digest == part:
            found[part] = dict(_parsed(path).definitions)
    return found


def plugin_file(target: str) -> Path | None:
    """Return the path of the plugin file in a target such as ``"/path/smooth.py:Smooth"``; None for another module."""
    path = target if target.endswith(".py") else target.rpartition(":")[0]
    return Path(path) if path.endswith(".py") else None


def sources_of(target: str) -> list[Path]:
    """Return the source files in the code of a module."""
    return list(_closure(target)[0])


def is_installed(module: str) -> bool:
    """Return whether a module is of the suite, of Python, or of an installed package: no code that a user edits."""
    top = module.partition(".")[0]
    return top in FIRST_PARTY or top in sys.stdlib_module_names or bool(_versions(top))


def modules_beside(path: Path) -> dict[str, Path]:
    """Return the modules and packages beside a plugin file that it imports, directly or not, by name."""
    folder = path.resolve().parent
    helpers = (
        source.relative_to(base)
        for source, base in _closure(str(path))[0].items()
        if base == folder
    )
    names = {helper.parts[0].partition(".")[0] for helper in helpers} - {path.stem}
    return {name: found for name in sorted(names) if (found := _locate(path.parent, (name,)))}


def digest_of_bytes(content: bytes) -> str:
    """Return the digest of bytes: 16 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()[:16]


def digest(content: Any) -> str:
    """Return the digest of a content, 32 digits: dicts, lists, texts and numbers, or type and text of anything else."""
    text = json.dumps(
        content,
        sort_keys=True,
        separators=(",", ":"),
        default=lambda it: [type(it).__name__, str(it)],
    )
    return hashlib.sha256(text.encode()).hexdigest()[:32]


# Imports
# ------------------------------------------------------------------------------------------------


def _closure(target: str) -> tuple[dict[Path, Path], set[str]]:
    """Return the sources of a module, itself first, each with the folder that holds its package; and other packages."""
    path = plugin_file(target)
    name = path.stem if path else target.partition(":")[0]
    base = path.resolve().parent if path else _folder_of(name.partition(".")[0])
    start = path.resolve() if path else base and _locate(base, tuple(name.split(".")))
    if base is None or start is None or not start.is_file():
        raise ConfigurationError(
            f"there is no module {path or name}", "correct the name, or install its package"
        )
    is_beside = cache(partial(_is_beside, base))  # asked again for each import
    sources = {start: base}
    packages = set[str]()
    pending = [start]
    while pending:
        source = pending.pop()
        for parts in _imported(_parsed(source).imports, _relative(source, sources[source])):
            top = parts[0]
            is_near = path is not None and top not in FIRST_PARTY and is_beside(top)
            has_sources = is_near or top in FIRST_PARTY or not _versions(top)
            where = base if is_near else _folder_of(top) if has_sources else None
            if where is None:
                packages.add(top)
                continue
            found = _suite_files(parts) if top in FIRST_PARTY else _files_around(where, parts)
            if where not in (ROOT, base):  # a package without a version, which imports in any way
                found += sorted((where / top).rglob("*.py"))
            for file in found:
                if file not in sources:
                    sources[file] = where
                    pending.append(file)
    return sources, packages


def _files_around(where: Path, parts: tuple[str, ...]) -> list[Path]:
    """Return the files of a module and of all packages around it."""
    found = [_locate(where, parts[:count]) for count in range(1, len(parts) + 1)]
    return [file for file in found if file]


def _suite_files(parts: tuple[str, ...]) -> list[Path]:
    """Return the file of a module of the suite, or of the one where a name that it imports is from.

    The packages around a module compute nothing, see ``tests/registry/test_keys.py``.
    """
    if ".".join(parts[:2]) in IN_NO_KEY or ".".join(parts[:3]) in IN_NO_KEY:
        return []
    if module := _locate(ROOT, parts):
        return [module]
    around = _locate(ROOT, parts[:-1])
    if around is None:  # a name of a class
        return []
    passed_on = _parsed(around).passed_on.get(parts[-1]) if around.name == "__init__.py" else None
    if passed_on is None:
        return [around]
    files = [_suite_files(name) for name in _imported((passed_on,), _relative(around, ROOT))]
    return [*chain.from_iterable(files)]


def _is_beside(base: Path, top: str) -> bool:
    """Return whether a folder holds a module, a package, or a folder of modules that no installed package hides."""
    return _locate(base, (top,)) is not None or ((base / top).is_dir() and not _versions(top))


def _folder_of(top: str) -> Path | None:
    """Return the folder that holds a top-level package; None if there is none."""
    if top in FIRST_PARTY:
        return ROOT
    with suppress(ImportError, ValueError):  # it is being imported, or is no module
        spec = importlib.util.find_spec(top)
        if (
            spec is not None and spec.submodule_search_locations
        ):  # a package, with or without __init__.py
            return Path(next(iter(spec.submodule_search_locations))).parent
        if spec is not None and spec.origin is not None:
            return Path(spec.origin).parent
    return None


@cache
def _imported(imports: tuple[Import, ...], source: Path) -> tuple[tuple[str, ...], ...]:
    """Return the full names of what a source file imports: modules, or names in modules."""
    package = source.parts[:-1]
    names = dict[tuple[str, ...], None]()
    for level, module, attribute in imports:
        around = package[: len(package) - level + 1] if level else ()
        full = (*around, *filter(None, [*module.split("."), attribute]))
        if full[0] not in sys.stdlib_module_names:
            names[full] = None
    return tuple(names)


@cache
def _relative(path: Path, base: Path) -> Path:
    return path.relative_to(base)


def _locate(base: Path, parts: tuple[str, ...]) -> Path | None:
    """Return the file of a module below a folder; that of a user may be new at any time."""
    return _locate_once(parts) if base is ROOT else _find(base, parts)


@cache
def _locate_once(parts: tuple[str, ...]) -> Path | None:
    return _find(ROOT, parts)


def _find(base: Path, parts: tuple[str, ...]) -> Path | None:
    """Return the file of a module: a source, a package or a compiled extension."""
    stem = base.joinpath(*parts)
    candidates = (
        stem / "__init__.py",
        *(Path(f"{stem}{suffix}") for suffix in (".py", *EXTENSION_SUFFIXES)),
    )
    return next((path for path in candidates if path.is_file()), None)


Import = tuple[int, str, str]
"""Level, module and attribute of an import."""


class _Module(NamedTuple):
    """A source file.

    Parameters
    ----------
    digest
        Digest of what counts in it.
    imports
        What it imports.
    definitions
        Of a file of the suite: digest of each function, method, class and constant by its name.
    passed_on
        Of a file of the suite: what it imports by the names that it gives it, outside of functions.
    """

    digest: str
    imports: tuple[Import, ...] = ()
    definitions: Mapping[str, str] = {}
    passed_on: Mapping[str, Import] = {}


def _parsed(path: Path) -> _Module:
    status = path.stat()
    return _parsed_once(path, status.st_mtime_ns, status.st_ctime_ns, status.st_size)


def _content_of(path: Path) -> bytes:
    """Return the content of a file, within its size: one of ``/proc`` may have no end."""
    with path.open("rb") as file:
        return file.read(path.stat().st_size)


@cache
def _parsed_once(path: Path, *_: int) -> _Module:
    content = _content_of(path)
    try:
        tree = ast.parse(content) if path.suffix == ".py" else None
    except (SyntaxError, ValueError):  # named when it is imported
        tree = None
    if tree is None:
        return _Module(digest_of_bytes(content))
    if not any(path.is_relative_to(ROOT / package) for package in FIRST_PARTY):
        imports = chain.from_iterable(map(_imports, ast.walk(tree)))
        return _Module(digest_of_bytes(content), tuple(imports))
    return _parsed_suite(tree)


def _parsed_suite(tree: ast.Module) -> _Module:
    """Return what counts in a file of the suite."""
    imports: dict[Import, None] = {}
    parts: list[Any] = []
    by_name = defaultdict[str, list[Any]](list)
    for name, node in _definitions(tree.body):
        of_definition = _significant(node, imports)
        parts += of_definition
        by_name[name] += of_definition
    definitions = {name: digest_of_bytes(repr(of).encode()) for name, of in by_name.items()}
    passed_on = {
        alias.asname or alias.name: (node.level, node.module or "", alias.name)
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    return _Module(digest_of_bytes(repr(parts).encode()), tuple(imports), definitions, passed_on)


def _definitions(body: Iterable[ast.stmt], within: str = "") -> Iterator[tuple[str, ast.AST]]:
    """Yield the statements of a module with the names that they define; a class is taken apart."""
    for node in body:
        if isinstance(node, ast.ClassDef):
            yield from _definitions(node.body, f"{within}{node.name}.")
            members = node.body
            node.body = []
            yield f"{within}{node.name}", node
            node.body = members
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield f"{within}{node.name}", node
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            yield f"{within}{_name(target) or 'constants'}", node
        elif isinstance(node, ast.Import | ast.ImportFrom):
            yield f"{within}imports", node
        else:
            yield f"{within}statements", node


def _significant(statement: ast.AST, imports: dict[Import, None]) -> list[Any]:
    """Return what counts in a statement of the suite, without texts that speak; adds what it imports."""
    parts: list[Any] = []
    pending: list[Any] = [[statement]]
    while pending:  # faster than ast.dump and ast.walk
        node = pending.pop()
        if isinstance(node, ast.ImportFrom) and node.module in IN_NO_KEY:
            continue
        if isinstance(node, ast.If) and _name(node.test) == "TYPE_CHECKING":
            node = node.orelse
        if isinstance(node, ast.Subscript) and _name(node.value) == "Annotated":
            node = node.slice.elts[:1] if isinstance(node.slice, ast.Tuple) else node
        if _speaks(node):
            for part in ast.walk(node):
                if _is_text(part):
                    part.value = ""
        if isinstance(node, list):
            node = [
                part for part in node if not (isinstance(part, ast.Expr) and _is_text(part.value))
            ]
            pending += node
            parts.append(len(node))
        elif isinstance(node, ast.AST):
            imports |= dict.fromkeys(_imports(node))
            pending += [getattr(node, name, None) for name in node._fields]
            parts.append(type(node).__name__)
        else:
            parts.append(node)
    return parts


def _imports(node: ast.AST) -> list[Import]:
    """Return level, module and attribute of each import of a statement or expression."""
    if isinstance(node, ast.Import):
        return [(0, alias.name, "") for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        return [(node.level, node.module or "", alias.name) for alias in node.names]
    if (
        isinstance(node, ast.Call)
        and _name(node.func) == "import_module"
        and node.args
        and _is_text(node.args[0])
    ):
        return [(0, ast.literal_eval(node.args[0]), "")]
    return []


def _name(node: ast.AST) -> str:
    return str(getattr(node, "attr", getattr(node, "id", "")))


def _is_text(node: ast.AST) -> TypeGuard[ast.Constant]:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _speaks(node: Any) -> bool:
    """Return whether the texts in a node are for users: those of an error, a part of its message, or of a table."""
    if isinstance(node, ast.Assign):
        names = [target.id.lower() for target in node.targets if isinstance(target, ast.Name)]
        return len(names) == len(node.targets) and all(name.endswith(_MESSAGES) for name in names)
    if isinstance(node, ast.Call):
        return _name(node.func) in _SPEAKERS
    if isinstance(node, ast.keyword):
        return node.arg in _TEXTS
    return isinstance(node, ast.Raise)


@cache
def _versions(top: str) -> dict[str, str]:
    """Return the versions of the distributions whose package Python imports, without build tags; empty if none has it.

    A package that is installed to be edited, or lies on the path, has sources instead.
    """
    with suppress(ImportError, ValueError):
        spec = importlib.util.find_spec(top)
        found = [*(spec.submodule_search_locations or [spec.origin or ""])] if spec else []
        folders = {Path(place).resolve().parent for place in found}
        own = [
            distribution
            for distribution, files in _distributions()
            if any(f"\n{top}{end}" in files for end in ("/", ".", "\n"))
            and Path(str(distribution.locate_file(""))).resolve() in folders
        ]
        return {
            each.name.lower(): each.version.partition("+")[0] for each in reversed(own)
        }  # Python takes the first
    return {}


@cache
def _distributions() -> list[tuple[importlib.metadata.Distribution, str]]:
    """Return the installed distributions with their lists of files."""
    every = importlib.metadata.distributions()
    return [
        (found, f"\n{found.read_text('top_level.txt')}\n{found.read_text('RECORD')}")
        for found in every
    ]
