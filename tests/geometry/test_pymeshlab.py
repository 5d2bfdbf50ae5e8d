"""pymeshlab remembers parameters from call to call: what is not named is what somebody else named last."""

import ast
from pathlib import Path

import numpy as np
import pymeshlab
import pytest
from trimesh.creation import box

PACKAGE = Path(__file__).parents[2] / "benchmark"
BOX = box()
FILTERS = set(pymeshlab.filter_list())


def calls():
    """Filters that the suite calls, by place, each with the parameters that are named there."""
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.Call):
                continue
            texts = [argument.value for argument in node.args if isinstance(argument, ast.Constant)]
            names = [*texts, node.func.attr] if isinstance(node.func, ast.Attribute) else texts
            for name in FILTERS.intersection(each for each in names if isinstance(each, str)):
                place = f"{path.relative_to(PACKAGE)}:{node.lineno}"
                yield pytest.param(name, {word.arg for word in node.keywords}, id=place)


def test_the_calls_are_found():
    assert len(list(calls())) >= 6


@pytest.mark.parametrize(("name", "named"), list(calls()))
def test_every_parameter_of_a_filter_is_named(name, named):
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(np.asarray(BOX.vertices), np.asarray(BOX.faces)))
    assert named == set(meshes.filter_parameter_values(name))
