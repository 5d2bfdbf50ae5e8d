"""One thing a line: shapes of code that a reader has to take apart are in no module."""

import ast
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

FOLDERS = ("benchmark", "baselines", "learned", "retrieval", "tools")

COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
LISTS = (ast.List, ast.Tuple, ast.JoinedStr)


def faults(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the line of each such shape, and what it is."""
    for node in ast.walk(tree):
        if isinstance(node, COMPREHENSIONS) and is_nested(node):
            yield node.lineno, "a comprehension within a comprehension, or with two loops"
        elif isinstance(node, ast.For | ast.AsyncFor | ast.While) and node.orelse:
            yield node.lineno, "an else behind a loop"
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
            if is_list_times_condition(node.left, node.right):
                yield node.lineno, "a list or text times a condition"
        elif isinstance(node, ast.Assign) and assigns_constants(node):
            yield node.lineno, "several constants in one assignment"


def is_nested(node: ast.AST) -> bool:
    inner = [each for each in ast.walk(node) if isinstance(each, COMPREHENSIONS)]
    return len(inner) > 1 or len(node.generators) > 1


def is_list_times_condition(left: ast.expr, right: ast.expr) -> bool:
    return any(
        is_list_or_text(one) and is_condition(other)
        for one, other in ((left, right), (right, left))
    )


def is_list_or_text(node: ast.expr) -> bool:
    return isinstance(node, LISTS) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)
    )


def is_condition(node: ast.expr) -> bool:
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Name) and node.func.id in ("bool", "any", "all")
    if isinstance(node, ast.Name | ast.Attribute):
        name = node.id if isinstance(node, ast.Name) else node.attr
        return name.lstrip("_").startswith(("is_", "has_"))
    is_negation = isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)
    return is_negation or isinstance(node, ast.Compare | ast.BoolOp)


def assigns_constants(node: ast.Assign) -> bool:
    if not isinstance(node.targets[0], ast.Tuple) or not isinstance(node.value, ast.Tuple):
        return False
    return all(map(is_constant, node.value.elts))


def is_constant(node: ast.expr) -> bool:
    if isinstance(node, ast.UnaryOp):
        return is_constant(node.operand)
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        return all(map(is_constant, node.elts))
    return isinstance(node, ast.Constant)


def modules() -> Iterator[str]:
    paths = chain.from_iterable(sorted((ROOT / folder).rglob("*.py")) for folder in FOLDERS)
    for path in paths:
        yield path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("module", list(modules()))
def test_a_module_says_one_thing_a_line(module):
    assert list(faults(ast.parse((ROOT / module).read_text(encoding="utf-8")))) == []


@pytest.mark.parametrize(
    "line",
    [
        "pairs = [(a, b) for a in rows for b in a]",
        "sums = [sum(x for x in row) for row in rows]",
        "ends = 's' * (n != 1)",
        "notes += [note] * bool(note)",
        "notes += is_reversed * [note]",
        "a, b = 1, (2.5, -3)",
        "for row in rows:\n    break\nelse:\n    row = 1",
        "while rows:\n    rows.pop()\nelse:\n    row = 1",
    ],
)
def test_such_a_shape_is_found(line):
    assert len(list(faults(ast.parse(line)))) == 1


@pytest.mark.parametrize(
    "line",
    [
        "rule = '-' * width",
        "x, y = points.T",
        "low, high = points.min(), points.max()",
        "names = [name for name in rows if name]",
        "for row in rows:\n    break",
    ],
)
def test_what_reads_in_one_go_is_none(line):
    assert list(faults(ast.parse(line))) == []
