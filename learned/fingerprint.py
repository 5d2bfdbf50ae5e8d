"""Which code trains: told by every checkpoint, so that no other code goes on with it."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from pathlib import Path

#: Modules whose part in a training every recipe tells already.
_TOLD_BY_THE_RECIPE = frozenset({"configuration"})


def training_code(folder: Path = Path(__file__).parent) -> dict[str, str]:
    """Digests of the modules that determine the weights: the training loop and what it imports of this package.

    Comments, docstrings and the layout of the text do not count.

    Parameters
    ----------
    folder
        The package.

    Returns
    -------
    dict
        Digest by name of the module inside the package.
    """
    found: dict[str, str] = {}
    pending = ["training"]
    while pending:
        name = pending.pop()
        if name in found or name in _TOLD_BY_THE_RECIPE:
            continue
        tree = ast.parse((folder / f"{name}.py").read_text(encoding="utf-8"))
        pending += _imported(tree, folder)
        found[name] = hashlib.sha256(ast.dump(_without_words(tree)).encode()).hexdigest()[:16]
    return dict(sorted(found.items()))


def _imported(tree: ast.Module, folder: Path) -> Iterator[str]:
    """Modules of this package that one imports anywhere."""
    package = Path(__file__).parent.name
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        for name in names:
            home, _, module = name.rpartition(".")
            if home == package and (folder / f"{module}.py").is_file():
                yield module


def _without_words(tree: ast.Module) -> ast.Module:
    """The tree without strings that stand alone: docstrings of modules, classes, functions and attributes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            node.body = [statement for statement in node.body if not _is_words(statement)]
    return tree


def _is_words(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )
