"""Docstrings open with what comes back or is done, not with a question."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
QUESTIONS = {"What", "Which", "Whether", "How", "Who", "Where", "When", "Why"}


@pytest.mark.parametrize("package", ["benchmark", "baselines", "learned", "retrieval"])
def test_docstrings_open_with_a_noun_or_a_verb(package):
    asking = [
        f"{path.relative_to(ROOT)}: {text.splitlines()[0]}"
        for path in sorted((ROOT / package).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        if (text := ast.get_docstring(node)) and text.split()[0] in QUESTIONS
    ]
    assert asking == []
