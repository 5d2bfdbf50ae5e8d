"""A run makes the form of one shape of each method of a plugin again, and notes where it comes out otherwise."""

import pytest

from benchmark.datasets.catalogue import open_dataset
from benchmark.pipeline.method_run import RUNS_DIFFER, MethodRun, Preparation
from benchmark.pipeline.storage.store import Store
from benchmark.plugins.registry import plugin_methods
from tests.toy import write_rods

PLUGIN = """
import itertools
from benchmark.api import canonical_form

COUNT = itertools.count()

@canonical_form(name="steady", title="Steady")
def steady(shape):
    return shape.mesh.vertices

@canonical_form(name="moody", title="Moody")
def moody(shape):
    return shape.mesh.vertices * (-1) ** next(COUNT)
"""


@pytest.mark.parametrize(("method", "noted"), [("steady", None), ("moody", 2.0)])
def test_a_method_of_a_plugin_whose_runs_differ_is_noted_at_one_shape(method, noted, tmp_path):
    (tmp_path / "moods.py").write_text(PLUGIN)
    write_rods(tmp_path / "rods", bends=(0.0, 1.0))
    dataset, store = open_dataset(str(tmp_path / "rods"), None), Store.open(tmp_path / "results")
    (spec,) = (spec for spec in plugin_methods(tmp_path / "moods.py") if spec.name == method)
    method_run = MethodRun(Preparation(dataset, "mesh", store), store, spec)
    first, second = (method_run.answer(entry).arrays for entry in dataset.shapes[:2])
    assert RUNS_DIFFER not in second
    assert (first[RUNS_DIFFER].item() if RUNS_DIFFER in first else None) == noted
