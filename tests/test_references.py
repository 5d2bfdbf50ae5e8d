"""References in docstrings, such as ``:func:`name```, lead to what they name."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("benchmark", "baselines", "learned", "retrieval", "tools")

REFERENCE = re.compile(r":(func|class|data|meth|attr|mod|exc):`~?([^`]+)`")
EXTERNAL = ("ast.", "numpy.", "scipy.", "pandas.")


class Reference(NamedTuple):
    """A reference in a file of the suite."""

    path: str
    target: str


def references() -> list[Reference]:
    found = []
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            for _, target in REFERENCE.findall(text):
                found.append(Reference(path.relative_to(ROOT).as_posix(), target))
    return sorted(set(found))


def names_defined_in(path: Path) -> set[str]:
    """Return the names of classes, functions, constants and attributes that a file defines.

    Members of a class count by their name, and with that of the class before it.
    """
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ClassDef):
            names |= {node.name, *members(node), *(f"{node.name}.{x}" for x in members(node))}
        elif isinstance(node, ast.FunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            names.add(node.target.id)
        elif isinstance(node, ast.ImportFrom):
            names |= {alias.asname or alias.name for alias in node.names}
    return names


def members(node: ast.ClassDef) -> set[str]:
    found = set()
    for child in node.body:
        if isinstance(child, ast.FunctionDef):
            found.add(child.name)
        elif isinstance(child, ast.AnnAssign) and isinstance(child.target, ast.Name):
            found.add(child.target.id)
    return found


def is_importable(target: str) -> bool:
    """Return whether an absolute name leads to a module or to what it holds."""
    parts = target.split(".")
    for n_parts in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:n_parts]))
        except ModuleNotFoundError:
            continue
        for name in parts[n_parts:]:
            fields = getattr(found, "__annotations__", {})
            if not hasattr(found, name):
                return name in fields and name == parts[-1]
            found = getattr(found, name)
        return True
    return False


@pytest.fixture(scope="module")
def names_of_suite() -> set[str]:
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    return set().union(*map(names_defined_in, paths))


@pytest.mark.parametrize("reference", references(), ids=str)
def test_a_reference_leads_to_what_it_names(reference: Reference, names_of_suite: set[str]) -> None:
    path, target = reference
    if target.startswith("."):  # of whatever module defines it
        assert target[1:] in names_of_suite
    else:
        assert target in names_defined_in(ROOT / path) or is_importable(target)
