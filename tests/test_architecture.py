"""Data flows downwards: a package imports only from below."""

import ast
import re
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

#: Layers, lowest first, as the page on architecture shows them: a package may import from itself
#: and from any layer below, never from its neighbours on the same layer. A module belongs to the
#: longest name that fits.
SHOWN = (
    (ROOT / "docs" / "architecture.md").read_text().partition("```layers\n")[2].partition("```")[0]
)
LAYERS = [re.match(r"((?:\S+ {1,2})+)", line)[1].split() for line in reversed(SHOWN.splitlines())]
PACKAGES = {package: number for number, layer in enumerate(LAYERS) for package in layer}


def package(module: str) -> str:
    parts = module.split(".")
    while parts and ".".join(parts) not in PACKAGES:
        parts.pop()
    return ".".join(parts)


def modules():
    for top in ("benchmark", "baselines", "learned", "retrieval"):
        for path in sorted((ROOT / top).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            if not name.endswith("__main__"):  # programs may import anything
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


def may_import(name: str, target: str) -> bool:
    here, there = package(name), package(target)
    return here == there or PACKAGES[there] < PACKAGES[here]


@pytest.mark.parametrize(
    ("name", "path"), list(modules()), ids=lambda value: value if isinstance(value, str) else ""
)
def test_a_module_imports_only_from_layers_below_and_the_harness_no_method_by_name(name, path):
    ours = [target for target in imports(path) if known(target)]
    if name == "benchmark":
        assert not ours
        return
    assert package(name), "a module without a layer"
    assert [target for target in ours if package(target) and not may_import(name, target)] == []
    if name.startswith("benchmark"):
        assert [
            target for target in imports(path) if target.startswith(("baselines", "learned"))
        ] == []
    if name.startswith("baselines"):  # a method imports no harness
        allowed = ("benchmark.api.contracts", "benchmark.errors", "benchmark.geometry", "baselines")
        of_suite = [
            target
            for target in imports(path)
            if target.startswith(("benchmark.", "retrieval", "learned"))
        ]
        assert [target for target in of_suite if not target.startswith(allowed)] == []


def test_no_modules_import_each_other_in_a_circle():
    graph = {
        name: {target for target in imports(path) if known(target)} - {name}
        for name, path in modules()
    }
    TopologicalSorter(graph).prepare()


def test_one_module_of_the_harness_knows_the_formats_of_mesh_files():
    users = {
        name
        for name, path in modules()
        if any(target.startswith("benchmark.formats") for target in imports(path))
    }
    assert {name for name in users if not name.startswith("benchmark.formats")} == {
        "benchmark.datasets.mesh_files"
    }
