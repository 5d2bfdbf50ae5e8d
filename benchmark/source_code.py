"""Digests of the source text and of the code in each folder of the suite, without importing anything."""

from __future__ import annotations

import ast
import hashlib
import json
from functools import cache
from pathlib import Path
from typing import Any

FIRST_PARTY = ("benchmark", "baselines", "learned", "retrieval")

#: Folder that holds the packages of the suite.
ROOT = Path(__file__).parents[1]

_DIGITS = 16


def digest_of_bytes(content: bytes) -> str:
    """Return the digest of bytes: 16 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()[:_DIGITS]


@cache
def text_of(folder: str) -> str:
    """Return the digest of the text of the modules in a folder."""
    return digest_of_bytes(b"".join(path.name.encode() + path.read_bytes() for path in _modules(folder)))


def digest_of_source(source: bytes) -> str:
    """Return the digest of the code of a module; raise ``SyntaxError`` if it is not Python."""
    tree = _skeleton(ast.parse(source))
    return digest_of_bytes(json.dumps(tree, separators=(",", ":")).encode())


def suite_texts() -> dict[str, str]:
    """Return the digest of the text of each folder of the suite."""
    folders = {path.parent.relative_to(ROOT).as_posix() for name in FIRST_PARTY for path in (ROOT / name).rglob("*.py")}
    return {folder: text_of(folder) for folder in sorted(folders)}


@cache
def code_of(folder: str) -> str:
    """Return the digest of the code in a folder, without docstrings, comments and layout."""
    trees = [(path.name, _skeleton(ast.parse(path.read_bytes()))) for path in _modules(folder)]
    return digest_of_bytes(json.dumps(trees, separators=(",", ":")).encode())


def forget_sources() -> None:
    """Clear the caches, because sources may have changed."""
    text_of.cache_clear()
    code_of.cache_clear()


def _modules(folder: str) -> list[Path]:
    return sorted((ROOT / folder).glob("*.py"))


def _skeleton(node: Any) -> Any:
    """Return a syntax tree as lists, without docstrings, and without empty fields, which depend on Python's version."""
    if isinstance(node, ast.AST):
        fields = ((name, value) for name, value in ast.iter_fields(node) if name not in ("kind", "type_comment"))
        parts = ((name, _skeleton(value)) for name, value in fields if value is not None)
        return [type(node).__name__, *([name, part] for name, part in parts if part != [])]
    if isinstance(node, list):
        return [_skeleton(part) for part in node if not _is_docstring(part)]
    return [type(node).__name__, repr(node)]


def _is_docstring(node: Any) -> bool:
    """Return whether a node is a text alone: the docstring of a module, class, function or attribute."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
