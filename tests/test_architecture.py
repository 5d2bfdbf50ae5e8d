"""Data flows downwards: a room imports only from below."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

#: Floors, lowest first. A module belongs to the longest prefix that fits.
FLOORS = {
    "benchmark.errors": 0,
    "benchmark.threads": 0,
    "benchmark.geometry.mesh": 1,
    "benchmark.geometry": 2,
    "benchmark.contracts": 3,
    "benchmark.learning": 3,
    "baselines": 4,
    "retrieval": 4,
    "learned": 4,
    "benchmark.datasets": 5,
    "benchmark.reference": 5,
    "benchmark": 6,
    "benchmark.report": 7,
    "benchmark.listing": 7,
    "benchmark.single": 7,
    "benchmark.progress": 7,
    "benchmark.conformance": 7,
    "benchmark.scaffold": 7,
    "benchmark.cli": 8,
    "benchmark.cli_data": 8,
    "benchmark.cli_train": 8,
    "benchmark.__main__": 9,
}


def floor(module: str) -> int:
    parts = module.split(".")
    while ".".join(parts) not in FLOORS:
        parts.pop()
    return FLOORS[".".join(parts)]


def modules():
    for package in ("benchmark", "baselines", "learned", "retrieval"):
        for path in sorted((ROOT / package).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            yield name.removesuffix(".__init__"), path


def imports(path: Path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def known(name: str) -> bool:
    base = ROOT.joinpath(*name.split("."))
    return base.with_suffix(".py").is_file() or (base / "__init__.py").is_file()


@pytest.mark.parametrize(("name", "path"), list(modules()), ids=lambda value: value if isinstance(value, str) else "")
def test_a_room_imports_only_from_its_floor_or_below(name, path):
    ours = [
        target for target in imports(path) if target.split(".")[0] in ("benchmark", "baselines", "learned", "retrieval")
    ]
    above = sorted(target for target in ours if known(target) and target != "benchmark" and floor(target) > floor(name))
    assert above == []


@pytest.mark.parametrize(("name", "path"), [(n, p) for n, p in modules() if n.startswith("benchmark")])
def test_the_harness_imports_no_method_by_name(name, path):
    assert [target for target in imports(path) if target.startswith(("baselines", "learned"))] == []


@pytest.mark.parametrize(("name", "path"), [(n, p) for n, p in modules() if n.startswith("baselines")])
def test_a_method_imports_no_harness(name, path):
    allowed = ("benchmark.contracts", "benchmark.errors", "benchmark.geometry", "baselines")
    ours = [target for target in imports(path) if target.startswith(("benchmark.", "retrieval", "learned"))]
    assert [target for target in ours if not target.startswith(allowed)] == []
