"""Keys that name a recipe: inputs, code, parameters and seed; never the bytes that came out.

Output bytes change between BLAS builds and thread counts, a recipe does not. The code part of a key is a fingerprint of
a module and of every first-party module that it imports, taken from the syntax tree without docstrings and positions,
so that a comment does not invalidate anything and an edit in a helper does.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import json
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

FIRST_PARTY = ("benchmark", "baselines", "learned", "retrieval")

#: Modules that cannot change a result: the wording of errors.
IGNORED = frozenset({"benchmark.errors"})


def digest(recipe: Any) -> str:
    """Digest of a recipe made of dicts, lists, strings and numbers: 32 hexadecimal digits."""
    text = json.dumps(recipe, sort_keys=True, separators=(",", ":"), default=_plain)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def plain(recipe: Any) -> Any:
    """The recipe as it comes back from JSON: tuples become lists, numpy numbers become numbers."""
    return json.loads(json.dumps(recipe, sort_keys=True, default=_plain))


def code_of(module: str) -> dict[str, str]:
    """Fingerprints of a module and of all first-party modules that it imports, directly or not.

    Parameters
    ----------
    module
        Dotted name of an installed module, or the path of a plugin file.
    """
    seen: dict[str, str] = {}
    pending = [module]
    while pending:
        name = pending.pop()
        if name in seen or name in IGNORED:
            continue
        path = _source(name)
        if path is None:
            continue
        seen[name], imports = _read(path)
        pending.extend(imports)
    return dict(sorted(seen.items()))


def code_digest(module: str) -> str:
    """One digest over :func:`code_of`."""
    return _code_digest(module)


@cache
def _code_digest(module: str) -> str:
    # The path of a plugin says where it lies, not what it does.
    return digest(sorted(code_of(module).values()))


def _plain(value: Any) -> Any:
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "item"):
        return value.item()
    if isinstance(value, (set, frozenset)):
        return sorted(value)
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} cannot be part of a recipe")


@cache
def _source(name: str) -> Path | None:
    if name.endswith(".py"):
        return Path(name)
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, AttributeError, ValueError):
        return None
    return Path(spec.origin) if spec and spec.origin and spec.origin.endswith(".py") else None


@cache
def _read(path: Path) -> tuple[str, tuple[str, ...]]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    imports = tuple(sorted(set(_imports(tree))))
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)) and ast.get_docstring(
            node
        ):
            node.body = node.body[1:]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()[:16], imports


def _imports(tree: ast.AST) -> Iterator[str]:
    """Names of first-party modules imported anywhere except for type checking alone."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if _is_ours(alias.name))
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level and _is_ours(node.module):
            yield node.module
            # ``from package import module`` names a module only if such a module exists.
            yield from (f"{node.module}.{alias.name}" for alias in node.names if _source(f"{node.module}.{alias.name}"))
        else:
            yield from _imports(node)


def _is_ours(name: str) -> bool:
    return name.partition(".")[0] in FIRST_PARTY
