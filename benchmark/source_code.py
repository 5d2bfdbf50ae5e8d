"""Source code of the suite by folder: digests of its text, and of what it does. Nothing is imported."""

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
    """Return the digest of a content: 16 hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()[:_DIGITS]


@cache
def text_of(folder: str) -> str:
    """Return the digest of the modules that lie in a folder of the suite, byte for byte."""
    return digest_of_bytes(b"".join(path.name.encode() + path.read_bytes() for path in _modules(folder)))


def digest_of_source(source: bytes) -> str:
    """Return the digest of the code of one module; raises ``SyntaxError`` if it is none."""
    tree = _skeleton(_without_docstrings(ast.parse(source)))
    return digest_of_bytes(json.dumps(tree, separators=(",", ":")).encode())


def suite_texts() -> dict[str, str]:
    """Return the digest of the modules of each folder of the suite."""
    folders = {path.parent.relative_to(ROOT).as_posix() for name in FIRST_PARTY for path in (ROOT / name).rglob("*.py")}
    return {folder: text_of(folder) for folder in sorted(folders)}


@cache
def code_of(folder: str) -> str:
    """Return the digest of the code of the modules in a folder: docstrings, comments and layout do not count."""
    trees = [(path.name, _skeleton(_without_docstrings(ast.parse(path.read_bytes())))) for path in _modules(folder)]
    return digest_of_bytes(json.dumps(trees, separators=(",", ":")).encode())


def forget_sources() -> None:
    """Read all sources again at the next call: they may have changed since."""
    text_of.cache_clear()
    code_of.cache_clear()


def _modules(folder: str) -> list[Path]:
    return sorted((ROOT / folder).glob("*.py"))


def _without_docstrings(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and (
            ast.get_docstring(node, clean=False) is not None
        ):
            node.body = node.body[1:]
    return tree


def _skeleton(node: Any) -> Any:
    """A syntax tree as lists, without what is empty: versions of Python differ in the empty fields that they have."""
    if isinstance(node, ast.AST):
        fields = ((name, value) for name, value in ast.iter_fields(node) if name not in ("kind", "type_comment"))
        return [type(node).__name__, *([n, _skeleton(v)] for n, v in fields if v is not None and v != [])]
    if isinstance(node, list):
        return [_skeleton(part) for part in node]
    return [type(node).__name__, repr(node)]
