"""Digests of the code that makes a result: sources, compiled extensions, versions of packages.

Nothing is imported to compute them. The code of a module is its source and that of everything that
it imports, directly or not, except installed packages, whose versions count. Imports inside
functions count. Of a user's file, all bytes count. Of the suite, what computes counts, and nothing
that checks or speaks:

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
import os
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

from benchmark.errors import ConfigurationError

#: Packages of the suite.
FIRST_PARTY = ("benchmark", "baselines", "learned", "retrieval")

#: Folder that holds the packages of the suite.
ROOT = Path(__file__).parents[1]

#: Modules that determine no result, and why.
IN_NO_KEY = {
    "benchmark.errors": "says what went wrong",
    "benchmark.text": "prints",
    "benchmark.machine": "describes the machine, and shares work among threads",
    "benchmark.files": "fetches bytes, whose digest is in the key",
    "benchmark.api.parameters": "checks parameters, whose values are in the key",
    "learned.fitting": "trains models, the digest of whose weights is in the key",
}

#: Ends of the names of variables that hold a part of a message.
_MESSAGES = ("problem", "hint")

#: Functions whose texts are parts of messages.
_SPEAKERS = ("named_errors",)

#: Ends of the paths of modules: packages, sources and compiled extensions, in Python's order.
_ENDINGS = ("/__init__.py", ".py", *EXTENSION_SUFFIXES)

#: Arguments with texts for tables and lists.
_TEXTS = ("title", "summary", "departs", "cite")


def code_digest(target: str, files: Iterable[str] = (), without: Iterable[str] = ()) -> str:
    """Return the digest of :func:`code_of`; the name of a plugin file does not count."""
    plugin = plugin_file(target)
    content = []
    for name, part in code_of(target, files, without).items():
        is_plugin = plugin is not None and name == plugin.name
        content.append(("" if is_plugin else name, part))
    return digest_of_bytes(json.dumps(sorted(content)).encode())


def code_of(target: str, files: Iterable[str] = (), without: Iterable[str] = ()) -> dict[str, str]:
    """Return the digest of each part of the code of a module, by the name of the part.

    Parameters
    ----------
    target
        Name of a module or path of a plugin file, optionally with ``:attribute``.
    files
        Other files on which its results depend, relative to its folder.
    without
        Names of modules that it imports, but that do not count, nor what they alone import.

    Returns
    -------
    dict
        Digest of each source, of each compiled extension and of each of the files, by path; version
        of each package, by the name of its distribution.

    Raises
    ------
    ConfigurationError
        If there is no such module, or none of a name in ``without``, or one of the files is missing
        or is a folder.
    """
    sources, packages = _closure(target, without)
    parts = {}
    for path, base in sources.items():
        parts[_relative(path, base).as_posix()] = _parsed(path).digest
    for package in sorted(packages):
        parts |= _versions(package)
    module = next(iter(sources))
    for name in files:
        path = module.parent / name
        if not path.is_file():
            fault = "a folder" if path.is_dir() else "missing"
            raise ConfigurationError(
                f"{module.name} depends on '{name}', which is {fault}",
                f"correct 'files': paths of files, relative to {module.parent}",
            )
        parts[name] = digest_of_bytes(_content_of(path))
    return parts


def code_of_modules(modules: Iterable[str]) -> dict[str, str]:
    """Return what the code of modules consists of."""
    parts: dict[str, str] = {}
    for module in modules:
        parts |= code_of(module)
    return parts


def definitions_of(code: Iterable[tuple[str, str]]) -> dict[str, dict[str, str]]:
    """Return the digests of the definitions in files of the suite, by the digests of the files.

    Definitions are functions, methods, classes and constants.

    Parameters
    ----------
    code
        Paths and digests, as :func:`code_of` returns them; a file that has another digest now is
        left out.
    """
    definitions: dict[str, dict[str, str]] = {}
    for name, part in code:
        path = ROOT / name
        is_of_suite = name.partition("/")[0] in FIRST_PARTY and path.suffix == ".py"
        if is_of_suite and path.is_file() and _parsed(path).digest == part:
            definitions[part] = dict(_parsed(path).definitions)
    return definitions


def plugin_file(target: str) -> Path | None:
    """Return the plugin file in a target such as ``"/path/smooth.py:Smooth"``.

    None stands for another module.
    """
    path = target if target.endswith(".py") else target.rpartition(":")[0]
    return Path(path) if path.endswith(".py") else None


def sources_of(target: str) -> list[Path]:
    """Return the source files in the code of a module, its own first."""
    sources, _ = _closure(target)
    return list(sources)


def sources_below(folder: Path) -> list[Path]:
    """Return the source files in a folder and in those below it.

    A link to nothing is none: an editor puts one beside a file that is not saved yet.
    """
    return sorted(path for path in folder.rglob("*.py") if path.is_file())


def is_installed(module: str) -> bool:
    """Return whether a module is of the suite, of Python, or of an installed package.

    No user edits such code.
    """
    top = module.partition(".")[0]
    return top in FIRST_PARTY or top in sys.stdlib_module_names or bool(_versions(top))


def modules_beside(path: Path) -> dict[str, Path]:
    """Return the modules beside a plugin file that it imports, directly or not, by name."""
    folder = path.resolve().parent
    sources, _ = _closure(str(path))
    helpers = [source.relative_to(base) for source, base in sources.items() if base == folder]
    names = {helper.parts[0].partition(".")[0] for helper in helpers}
    names.discard(path.stem)
    files = {name: _locate(path.parent, (name,)) for name in sorted(names)}
    return {name: file for name, file in files.items() if file}


def digest_of_bytes(content: bytes) -> str:
    """Return the digest of bytes: 16 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()[:16]


def digest(content: Any) -> str:
    """Return the digest of a content: 32 hexadecimal digits.

    Parameters
    ----------
    content
        Dicts, lists, texts and numbers; of anything else, its type and its text count.
    """
    text = json.dumps(
        content,
        sort_keys=True,
        separators=(",", ":"),
        default=lambda value: [type(value).__name__, str(value)],
    )
    return hashlib.sha256(text.encode()).hexdigest()[:32]


# Imports
# ------------------------------------------------------------------------------------------------


def _closure(target: str, without: Iterable[str] = ()) -> tuple[dict[Path, Path], set[str]]:
    """Return all that a module imports, directly or through what it imports.

    Imports are read from the sources; nothing is executed.

    Parameters
    ----------
    target
        Name of a module or path of a plugin file, optionally with ``:attribute``.
    without
        Names of modules that do not count. They lie in the folder that holds its package, or beside
        the plugin.

    Returns
    -------
    sources : dict
        Source files, that of the module first, each with the folder that holds its package.
    packages : set
        Names of installed packages, whose version counts and not their sources.
    """
    plugin = plugin_file(target)
    start, base = _start_of(target, plugin)

    @cache  # because many modules import the same packages
    def folder_of_sources(package: str) -> Path | None:
        """Return the folder that holds a package; None for an installed one."""
        # As in Python, a module beside a plugin precedes an installed package of its name.
        if plugin and package not in FIRST_PARTY and _is_beside(base, package):
            return base
        return _folder_of_sources(package)

    left_out = {_left_out(name, base, start) for name in without}
    sources = {start: base}
    packages: set[str] = set()
    pending = [start]
    while pending:
        source = pending.pop()
        imports = _parsed(source).imports
        for import_path in _imported(imports, _relative(source, sources[source])):
            package = import_path[0]
            folder = folder_of_sources(package)
            if folder is None:
                packages.add(package)
                continue
            files = _files_of_import(import_path, folder, base)
            new_files = [file for file in files if file not in sources and file not in left_out]
            sources.update(dict.fromkeys(new_files, folder))
            pending += new_files
    return sources, packages


def _left_out(name: str, base: Path, start: Path) -> Path:
    """Return the file of a module that does not count in the code of another one.

    Parameters
    ----------
    name
        Name of the module.
    base, start
        Folder that holds the package of the other one, and its file.

    Raises
    ------
    ConfigurationError
        If there is no such module. Its code would count without a word.
    """
    file = _locate(base, tuple(name.split(".")))
    if file is None:
        raise ConfigurationError(
            f"{start.name} says that '{name}' compares, and there is no such module",
            f"correct 'comparing': names of modules, as imported from {base}",
        )
    return file


def _start_of(target: str, plugin: Path | None) -> tuple[Path, Path]:
    """Return the file of a module, and the folder that holds its package.

    Parameters
    ----------
    target
        Name of a module, optionally with ``:attribute``.
    plugin
        The plugin file that the target names instead of a module; None if it names a module.

    Returns
    -------
    start : Path
        File of the module, or of the plugin.
    base : Path
        Folder that holds the package of the module; for a plugin, the folder of its file.

    Raises
    ------
    ConfigurationError
        If there is no such module.
    """
    start: Path | None = None
    if plugin:
        name = str(plugin)
        start = plugin.resolve()
        base: Path | None = start.parent
    else:
        name = target.partition(":")[0]
        base = _folder_of(name.partition(".")[0])
        if base:
            start = _locate(base, tuple(name.split(".")))
    if base is None or start is None or not start.is_file():
        problem = f"there is no module {name}"
        raise ConfigurationError(problem, "correct the name, or install its package")
    return start, base


def _folder_of_sources(top: str) -> Path | None:
    """Return the folder of a package whose sources count; None if its version does."""
    if top not in FIRST_PARTY and _versions(top):
        return None
    return _folder_of(top)


def _files_of_import(parts: tuple[str, ...], folder: Path, base: Path) -> list[Path]:
    """Return the files of a name that is imported, from the folder that holds its package.

    Parameters
    ----------
    parts
        Full name.
    folder, base
        Folder that holds the package of the name, and that of the module whose code is asked for.
    """
    top = parts[0]
    files = _suite_files(parts) if top in FIRST_PARTY else _files_around(folder, parts)
    if folder not in (ROOT, base):  # a package without a version, which imports in any way
        files += sources_below(folder / top)
    return files


def _files_around(folder: Path, parts: tuple[str, ...]) -> list[Path]:
    """Return the files of a module and of all packages around it."""
    files = [_locate(folder, parts[:count]) for count in range(1, len(parts) + 1)]
    return [file for file in files if file]


def _suite_files(parts: tuple[str, ...]) -> list[Path]:
    """Return the source files that define a name which is imported from the suite.

    The ``__init__.py`` files of the packages around a module do not count, as they compute nothing.

    Parameters
    ----------
    parts
        The import: ``("benchmark", "api", "Shape")`` for ``from benchmark.api import Shape``.

    Returns
    -------
    list of Path
        Usually one file; none for modules that determine no result.
    """
    if _is_in_no_key(parts):
        return []
    module = _locate(ROOT, parts)
    if module:  # benchmark.text
        return [module]
    parent = _locate(ROOT, parts[:-1])
    if parent is None:  # an attribute of a name: benchmark.geometry.mesh.Mesh.area
        return []
    if parent.name != "__init__.py":  # a name of a module: benchmark.geometry.mesh.Mesh
        return [parent]
    origin = _parsed(parent).passed_on.get(parts[-1])
    if origin is None:  # a name that a package defines itself: benchmark.check.check
        return [parent]
    # A name that a package imports to pass it on: benchmark.api.Shape. No package passes on a name
    # in a circle, which Python could not import.
    files: list[Path] = []
    for imported in _imported((origin,), _relative(parent, ROOT)):
        files += _suite_files(imported)
    return files


def _is_in_no_key(parts: tuple[str, ...]) -> bool:
    """Return whether an import is of a module of :data:`IN_NO_KEY`, or of a name in it."""
    return ".".join(parts[:2]) in IN_NO_KEY or ".".join(parts[:3]) in IN_NO_KEY


def _is_beside(base: Path, top: str) -> bool:
    """Return whether a folder holds a module, a package, or a folder of modules.

    An installed package hides a folder of modules without ``__init__.py``.
    """
    if _locate(base, (top,)):
        return True
    return (base / top).is_dir() and not _versions(top)


def _folder_of(top: str) -> Path | None:
    """Return the folder that holds a top-level package or module; None if there is none.

    Parameters
    ----------
    top
        Name of the package or module, such as ``"numpy"``.
    """
    if top in FIRST_PARTY:
        return ROOT
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):  # Python is importing it now, or it is no module
        return None
    if spec is None:
        return None
    if spec.submodule_search_locations:  # a package, with or without __init__.py
        return Path(next(iter(spec.submodule_search_locations))).parent
    return Path(spec.origin).parent if spec.origin is not None else None


@cache
def _imported(imports: tuple[Import, ...], source: Path) -> tuple[tuple[str, ...], ...]:
    """Return the full names of what a source file imports: modules, or names in modules.

    Parameters
    ----------
    imports
        Its imports.
    source
        Its path from the folder that holds its package.
    """
    package = source.parts[:-1]
    names: dict[tuple[str, ...], None] = {}
    for level, module, attribute in imports:
        around = package[: len(package) - level + 1] if level else ()
        name = (*around, *filter(None, [*module.split("."), attribute]))
        if name[0] not in sys.stdlib_module_names:
            names[name] = None
    return tuple(names)


@cache
def _relative(path: Path, base: Path) -> Path:
    """Return a path relative to a folder; each is asked for often."""
    return path.relative_to(base)


def _locate(base: Path, parts: tuple[str, ...]) -> Path | None:
    """Return the file of a module below a folder; that of a user may be new at any time."""
    return _locate_once(parts) if base is ROOT else _find(base, parts)


@cache
def _locate_once(parts: tuple[str, ...]) -> Path | None:
    """Return the file of a module of the suite."""
    return _find(ROOT, parts)


def _find(base: Path, parts: tuple[str, ...]) -> Path | None:
    """Return the file of a module: a package, a source or a compiled extension."""
    stem = os.path.join(base, *parts)  # noqa: PTH118  # of thousands
    for ending in _ENDINGS:
        if os.path.isfile(stem + ending):  # noqa: PTH113
            return Path(stem + ending)
    return None


#: Level, module and attribute of an import.
Import = tuple[int, str, str]


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
        Of a file of the suite: what it imports by the names that it gives it, outside of functions
        or once it is asked for them.
    """

    digest: str
    imports: tuple[Import, ...] = ()
    definitions: Mapping[str, str] = {}
    passed_on: Mapping[str, Import] = {}


def _parsed(path: Path) -> _Module:
    """Return what counts in a source file as it is now."""
    status = path.stat()
    return _parsed_once(path, status.st_mtime_ns, status.st_ctime_ns, status.st_size)


def _content_of(path: Path) -> bytes:
    """Return the content of a file, within its size: one of ``/proc`` may have no end."""
    with path.open("rb") as file:
        return file.read(path.stat().st_size)


@cache
def _parsed_once(path: Path, *_: int) -> _Module:
    """Return what counts in a file; its times and its size tell versions of it apart."""
    content = _content_of(path)
    tree = _parse(content) if path.suffix == ".py" else None
    if tree is None:
        return _Module(digest_of_bytes(content))
    if any(path.is_relative_to(ROOT / package) for package in FIRST_PARTY):
        return _parsed_suite(tree)
    imports = chain.from_iterable(map(_imports, ast.walk(tree)))
    return _Module(digest_of_bytes(content), tuple(imports))


def _parse(content: bytes) -> ast.Module | None:
    """Return the syntax tree of a source; None of a wrong one, which its import will name."""
    try:
        return ast.parse(content)
    except (SyntaxError, ValueError):
        return None


def _parsed_suite(tree: ast.Module) -> _Module:
    """Return what counts in a file of the suite."""
    offered = _offered(tree)
    imports: dict[Import, None] = {}
    parts: list[Any] = []
    parts_by_name: defaultdict[str, list[Any]] = defaultdict(list)
    for name, node in _definitions(tree.body):
        of_definition = _significant(node, imports)
        parts += of_definition
        parts_by_name[name] += of_definition
    definitions = {name: _digest_of_parts(of_name) for name, of_name in parts_by_name.items()}
    imports |= dict.fromkeys(offered.values())
    passed_on = _passed_on(tree) | offered
    return _Module(_digest_of_parts(parts), tuple(imports), definitions, passed_on)


def _digest_of_parts(parts: Sequence[Any]) -> str:
    """Return the digest of what counts in code."""
    return digest_of_bytes(repr(parts).encode())


def _passed_on(tree: ast.Module) -> dict[str, Import]:
    """Return what a module imports outside of functions, by the names that it gives it."""
    passed_on: dict[str, Import] = {}
    for node in tree.body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                imported = node.level, node.module or "", alias.name
                passed_on[alias.asname or alias.name] = imported
    return passed_on


def _offered(tree: ast.Module) -> dict[str, Import]:
    """Return what a package imports once it is asked for a name: its table ``_OFFERED``."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and _defined_name(node) == "_OFFERED":
            modules = ast.literal_eval(node.value)
            return {name: (0, module, name) for name, module in modules.items()}
    return {}


def _definitions(body: Iterable[ast.stmt], within: str = "") -> Iterator[tuple[str, ast.AST]]:
    """Yield the statements of a module with the names that they define; a class is taken apart.

    Parameters
    ----------
    body
        Statements of a module, or of a class.
    within
        Name of the class, with a dot; "" for a module.
    """
    for node in body:
        if isinstance(node, ast.ClassDef):
            yield from _definitions(node.body, f"{within}{node.name}.")
            members = node.body
            node.body = []
            yield f"{within}{node.name}", node
            node.body = members
        else:
            yield f"{within}{_defined_name(node)}", node


def _defined_name(node: ast.stmt) -> str:
    """Return the name that a statement defines, or that of its kind."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        return node.name
    if isinstance(node, ast.Assign):
        return _name(node.targets[0]) or "constants"
    if isinstance(node, ast.AnnAssign):
        return _name(node.target) or "constants"
    if isinstance(node, ast.Import | ast.ImportFrom):
        return "imports"
    return "statements"


def _significant(statement: ast.AST, imports: dict[Import, None]) -> list[Any]:
    """Return the syntax tree of a statement as a flat list, without its messages and docstrings.

    The tree is walked with a stack, which is faster than :func:`ast.dump` or :func:`ast.walk`.

    Parameters
    ----------
    statement
        The statement; its messages are replaced by empty texts in place.
    imports
        Updated: the imports of the statement are added as keys, in their order.

    Returns
    -------
    list
        Types of nodes, values of leaves and lengths of lists, in the order of the walk.
    """
    parts: list[Any] = []
    pending: list[Any] = [[statement]]
    while pending:
        node = pending.pop()
        if isinstance(node, ast.ImportFrom) and node.module in IN_NO_KEY:
            continue
        node = _computing_part(node)
        if _speaks(node):
            _remove_texts(node)
        if isinstance(node, list):
            statements = [part for part in node if not _is_docstring(part)]
            pending += statements
            parts.append(len(statements))
        elif isinstance(node, ast.AST):
            imports |= dict.fromkeys(_imports(node))
            pending += [getattr(node, name, None) for name in node._fields]
            parts.append(type(node).__name__)
        else:
            parts.append(node)
    return parts


def _computing_part(node: Any) -> Any:
    """Return a node without what only type checkers import, and without bounds of parameters."""
    if isinstance(node, ast.If) and _name(node.test) == "TYPE_CHECKING":
        return node.orelse
    if isinstance(node, ast.Subscript) and _name(node.value) == "Annotated":
        return node.slice.elts[:1] if isinstance(node.slice, ast.Tuple) else node
    return node


def _remove_texts(node: ast.AST) -> None:
    """Empty all texts in a node."""
    for part in ast.walk(node):
        if _is_text(part):
            part.value = ""


def _imports(node: ast.AST) -> list[Import]:
    """Return level, module and attribute of each import of a statement or expression."""
    if isinstance(node, ast.Import):
        return [(0, alias.name, "") for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        return [(node.level, node.module or "", alias.name) for alias in node.names]
    if not isinstance(node, ast.Call) or _name(node.func) != "import_module":
        return []
    if not node.args or not _is_text(node.args[0]):
        return []
    return [(0, ast.literal_eval(node.args[0]), "")]


def _name(node: ast.AST) -> str:
    """Return the name in a node, without what stands before its last dot; "" if it is none."""
    return str(getattr(node, "attr", getattr(node, "id", "")))


def _is_text(node: ast.AST) -> TypeGuard[ast.Constant]:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _is_docstring(node: Any) -> bool:
    """Return whether a node is a text that stands alone."""
    return isinstance(node, ast.Expr) and _is_text(node.value)


def _speaks(node: Any) -> bool:
    """Return whether the texts in a node are for users.

    Such are those of an error, of a part of its message, and for tables.
    """
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
    """Return the versions of the distributions that provide an installed package.

    Parameters
    ----------
    top
        Name that Python imports, such as ``"sklearn"``.

    Returns
    -------
    dict
        Versions without build tags, by the name of the distribution, such as ``"scikit-learn"``.
        Empty if no distribution has the package, because it is installed to be edited or lies on
        the path.
    """
    try:
        folders = _folders_of_package(top)
        own = []
        for distribution, files in _distributions():
            root = Path(str(distribution.locate_file(""))).resolve()
            if _holds_package(files, top) and root in folders:
                own.append(distribution)
    except (ImportError, ValueError):  # Python cannot find the package
        return {}
    versions = {}
    # Of several distributions with one name, Python takes the first, which is written last here.
    for distribution in reversed(own):
        versions[distribution.name.lower()] = distribution.version.partition("+")[0]
    return versions


def _folders_of_package(top: str) -> set[Path]:
    """Return the folders from which Python imports a package."""
    spec = importlib.util.find_spec(top)
    if spec is None:
        return set()
    places = spec.submodule_search_locations or [spec.origin or ""]
    return {Path(place).resolve().parent for place in places}


def _holds_package(files: str, top: str) -> bool:
    """Return whether a package is in the list of files of a distribution."""
    return any(f"\n{top}{end}" in files for end in ("/", ".", "\n"))


@cache
def _distributions() -> list[tuple[importlib.metadata.Distribution, str]]:
    """Return the installed distributions with their lists of files."""
    distributions = []
    for distribution in importlib.metadata.distributions():
        packages = distribution.read_text("top_level.txt")
        files = distribution.read_text("RECORD")
        distributions.append((distribution, f"\n{packages}\n{files}"))
    return distributions
