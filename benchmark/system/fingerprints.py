"""Fingerprints of the code of a piece of work: of a module and of all local modules that it imports.

The code of a module is itself with every local module that it imports, directly or not: those of this suite, and of a
plugin its helpers. Each is named by a fingerprint of its syntax tree without docstrings and positions, so that a
comment changes nothing and an edit in a helper does. The packages that this code imports are named with their versions.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.metadata
import importlib.util
import json
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from benchmark.system.files import write_text

FIRST_PARTY = ("benchmark", "baselines", "learned", "retrieval")

#: Modules that cannot change a result: the version of the suite, the names under which authors import its parts, the
#: wording of errors, the way files are written, and this one, by which a data set made from another tells of its code.
IGNORED = frozenset(
    {"benchmark", "benchmark.api", "benchmark.errors", "benchmark.system.files", "benchmark.system.fingerprints"}
)


@dataclass(frozen=True)
class Fingerprint:
    """Code and packages that can move the result of a stage.

    Parameters
    ----------
    code
        Fingerprint of each local module, by name; a plugin goes by its file name, for where it lies changes nothing.
    packages
        Version of each package that the code imports.
    """

    code: Mapping[str, str]
    packages: Mapping[str, str]

    @property
    def digest(self) -> str:
        """One digest over both: 32 hexadecimal digits."""
        text = json.dumps(self.plain(), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    def plain(self) -> dict[str, dict[str, str]]:
        """As part of a recipe."""
        return {"code": dict(self.code), "packages": dict(self.packages)}


def fingerprint(*modules: str, without: Iterable[str] = ()) -> Fingerprint:
    """Fingerprint of modules with all that they import.

    Parameters
    ----------
    *modules
        Dotted names of modules, or paths of plugin files.
    without
        Functions that the stage never calls, by name: they are left out, and what is imported in their bodies.
    """
    return _fingerprint(modules, tuple(without))


@dataclass(frozen=True)
class ImportCache:
    """Facts about sources and packages that one process hands to another.

    Parameters
    ----------
    parsed
        What was made of sources, by their contents; the other process reads the sources itself.
    distributions
        Names of the distributions that bring each package; the other process looks for their versions itself.
    """

    parsed: Mapping[Any, Any]
    distributions: Mapping[str, Sequence[str]]


def export_cache() -> ImportCache:
    """Return what this process has found out so far."""
    return ImportCache(dict(_PARSED), dict(_BRINGERS))


def import_cache(known: ImportCache) -> None:
    """Take over what another process has found out."""
    _PARSED.update(known.parsed)
    _BRINGERS.update(known.distributions)


def clear_cache() -> None:
    """Read all sources again at the next call: they may have changed since."""
    for cached in (_fingerprint, _known_as, _source, _read):
        cached.cache_clear()
    _KEPT.clear()


#: Entries of the parse cache, of which each version of a module is one, beyond which its file is begun anew.
_MOST_PARSED = 4000


@contextmanager
def parse_cache(folder: Path | None = None) -> Iterator[None]:
    """Begin with what earlier processes have parsed, which takes a second, and write down what the body adds to it.

    A source is known by its digest, and who brings a package by the list of all that is installed, so that nothing is
    out of date; a file that is damaged or cannot be written is as good as none.

    Parameters
    ----------
    folder
        Where the file lies; None for that of Python's compiled modules beside the code.
    """
    path = (folder or Path(__file__).parent / "__pycache__") / f"parsed-sources-{_version_of_this()}.json"
    if path not in _KEPT:
        _KEPT[path] = _read_cache(path)
        import_cache(_KEPT[path])
    before = _KEPT[path]
    try:
        yield
    finally:
        new = {known_as: module for known_as, module in _PARSED.items() if known_as not in before.parsed}
        if new or not _BRINGERS.items() <= before.distributions.items():
            all_parsed = {**before.parsed, **new} if len(before.parsed) < _MOST_PARSED else new
            _KEPT[path] = ImportCache(all_parsed, dict(_BRINGERS))
            entries = [[*known_as, module.digest, module.names] for known_as, module in all_parsed.items()]
            with suppress(OSError):
                write_text(path, json.dumps([entries, installed_names(), _BRINGERS]))


#: What the files of the parse cache hold, by their paths, as far as this process has read or written them.
_KEPT: dict[Path, ImportCache] = {}


@cache
def _version_of_this() -> str:
    return hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:8]


def _read_cache(path: Path) -> ImportCache:
    try:
        entries, names, bringers = json.loads(path.read_text(encoding="utf-8"))
        parsed = {
            (text, name, package, tuple(without)): _Module(digest, tuple(names))
            for text, name, package, without, digest, names in entries
        }
        distributions = {str(name): list(map(str, brought_by)) for name, brought_by in bringers.items()}
        return ImportCache(parsed, distributions if names == installed_names() else {})
    except (OSError, ValueError, TypeError, AttributeError):
        return ImportCache({}, {})


@cache
def installed_names() -> str:
    """Digest of the names and versions of all distributions on the search path."""
    found = [
        str(entry)
        for folder in map(Path, sys.path)
        if folder.is_dir()
        for entry in folder.iterdir()
        if entry.name.endswith(("-info", ".egg"))
    ]
    return hashlib.sha256(json.dumps(sorted(found)).encode()).hexdigest()[:16]


@cache
def _fingerprint(modules: tuple[str, ...], without: tuple[str, ...]) -> Fingerprint:
    code: dict[str, str] = {}
    packages: set[str] = set()
    done: set[str] = set()
    for root in modules:
        pending = [root]
        while pending:
            name = pending.pop()
            if name in done:
                continue
            done.add(name)
            path = _source(name, _folder(root))
            if path is None:
                continue
            imported = _read(path, name, without)
            if name not in IGNORED:
                code[path.name if name.endswith(".py") else name] = imported.digest
                for target in imported.names:
                    found = _known_as(target, root if root.endswith(".py") else root.partition(".")[0])
                    pending.extend(found)
                    if not found and (top := target.partition(".")[0]) not in sys.stdlib_module_names:
                        packages.add(top)
    versions = (pair for name in packages if not _is_local(name, "") for pair in _versions(name))
    return Fingerprint(dict(sorted(code.items())), dict(sorted(versions)))


@cache
def _known_as(name: str, root: str) -> tuple[str, ...]:
    """The local modules that an imported name stands for, with the packages around them; none for a foreign one."""
    if not _is_local(name, root):
        return ()
    parts = name.split(".")
    names = [".".join(parts[: k + 1]) for k in range(len(parts))]
    return tuple(module for module in names if _source(module, _folder(root)) is not None)


def _is_local(name: str, root: str) -> bool:
    """Return whether a module belongs to the suite, to the package of the root, or to no distribution at all."""
    top = name.partition(".")[0]
    if top in FIRST_PARTY or (root and not root.endswith(".py") and top == root.partition(".")[0]):
        return True
    if top in sys.stdlib_module_names:
        return False
    path = _source(top, _folder(root))
    if path is None or any(path.is_relative_to(folder) for folder in _installed()):
        return False
    place = path.parents[path.name == "__init__.py"]
    return top not in _brought_into(place) and not any(path.is_relative_to(folder) for folder in _edited_in_place())


@cache
def _brought_into(folder: Path) -> frozenset[str]:
    """Top-level names that distributions have put into a folder of the search path, wherever it is."""
    found = importlib.metadata.distributions(path=[str(folder)])
    return frozenset(Path(file.parts[0]).stem for each in found for file in each.files or ())


@cache
def _edited_in_place() -> tuple[Path, ...]:
    """Folders of distributions that were installed so that their sources may be edited where they lie."""
    told = (each.read_text("direct_url.json") for each in importlib.metadata.distributions())
    places = (json.loads(text) for text in told if text)
    urls = (place["url"] for place in places if place.get("dir_info", {}).get("editable"))
    suite = Path(__file__).resolve().parents[2]
    return tuple(folder for url in urls if (folder := Path(unquote(urlsplit(url).path)).resolve()) != suite)


def _folder(root: str) -> str:
    """Return where the helpers of a plugin file lie."""
    return str(Path(root).parent) if root.endswith(".py") else ""


@cache
def _installed() -> tuple[Path, ...]:
    names = ("stdlib", "platstdlib", "purelib", "platlib")
    return tuple({Path(sysconfig.get_path(name)).resolve() for name in names} | {Path(json.__file__).parents[1]})


@cache
def _source(name: str, folder: str = "") -> Path | None:
    """The file of a module, without importing anything; a helper is looked for beside the plugin if nothing else is."""
    if name.endswith(".py"):
        return Path(name)
    top, *rest = name.split(".")
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, AttributeError, ValueError):
        spec = None
    if spec is None:
        places = [Path(folder) / top] if folder else []
    elif spec.submodule_search_locations is not None:
        places = [Path(place) for place in spec.submodule_search_locations]
    else:
        places = [Path(spec.origin).with_suffix("")] if (spec.origin or "").endswith(".py") and spec.origin else []
    for place in places:
        module = place.joinpath(*rest)
        for path in (module.with_suffix(".py"), module / "__init__.py"):
            if path.is_file():
                return path.resolve()
    return None


#: Distributions of the packages that have been asked for and are not called like their own.
_BRINGERS: dict[str, Sequence[str]] = {}


@cache
def _versions(name: str) -> tuple[tuple[str, str], ...]:
    """Name and version of the distribution that brings a package; none for one that is not installed."""
    try:
        return ((name, _version(name)),)
    except importlib.metadata.PackageNotFoundError:
        if name not in _BRINGERS:
            _BRINGERS[name] = sorted(set(_distributions().get(name, ())))
        return tuple((each.lower(), _version(each)) for each in _BRINGERS[name])


def _version(distribution: str) -> str:
    """Version without the tag of the build (``+cpu``), which says where it runs, not what it computes."""
    return importlib.metadata.version(distribution).partition("+")[0]


@cache
def _distributions() -> Mapping[str, list[str]]:
    return importlib.metadata.packages_distributions()


@dataclass(frozen=True)
class _Module:
    digest: str
    names: tuple[str, ...]


@cache
def _read(path: Path, name: str, without: tuple[str, ...]) -> _Module:
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    return _parsed(path.read_bytes(), name, package, without)


#: What was made of sources, by their contents: that need not be forgotten, and to parse is most of the work.
_PARSED: dict[tuple[str, str, str, tuple[str, ...]], _Module] = {}


def _parsed(source: bytes, name: str, package: str, without: tuple[str, ...]) -> _Module:
    known_as = (hashlib.sha256(source).hexdigest(), name, package, without)
    if known_as not in _PARSED:
        _PARSED[known_as] = _parse(source, name, package, without)
    return _PARSED[known_as]


def _parse(source: bytes, name: str, package: str, without: tuple[str, ...]) -> _Module:
    tree = ast.parse(source)
    names = tuple(sorted(set(_imports(tree, "" if name.endswith(".py") else package, frozenset(without)))))
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef)):
            node.body = [part for part in node.body if not _is_one_of(part, without)]
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)) and ast.get_docstring(
            node
        ):
            node.body = node.body[1:]
    text = json.dumps(_skeleton(tree), separators=(",", ":"))
    return _Module(hashlib.sha256(text.encode()).hexdigest()[:16], names)


def _is_one_of(node: ast.AST, functions: Iterable[str]) -> bool:
    return isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) and node.name in functions


def _skeleton(node: Any) -> Any:
    """A syntax tree as lists, without what is empty: versions of Python differ in the empty fields that they have."""
    if isinstance(node, ast.AST):
        fields = ((name, value) for name, value in ast.iter_fields(node) if name not in ("kind", "type_comment"))
        return [type(node).__name__, *([n, _skeleton(v)] for n, v in fields if v is not None and v != [])]
    if isinstance(node, list):
        return [_skeleton(part) for part in node]
    return [type(node).__name__, repr(node)]


def _imports(tree: ast.AST, package: str, without: frozenset[str]) -> Iterator[str]:
    """Names of modules imported anywhere, but for type checking alone and in functions that are left out."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING"):
            yield from _imports(ast.Module(node.orelse, []), package, without)
            continue
        if _is_one_of(node, without):
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = package.split(".")
                base = ".".join([*parts[: len(parts) - node.level + 1], *([node.module] if node.module else [])])
            if base:
                yield base
                # ``from package import module`` names a module only if there is one; the caller looks.
                yield from (f"{base}.{alias.name}" for alias in node.names if alias.name != "*")
        else:
            yield from _imports(node, package, without)
