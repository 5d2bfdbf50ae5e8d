"""The benchmark from Python: names, objects and functions among the methods, in this process."""

import json
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

import benchmark
from baselines.classic_mds import ClassicMDS
from baselines.gps import GPS
from benchmark.api import Shape
from benchmark.errors import ConfigurationError, InvalidMesh
from benchmark.geometry.preparation import import_pymeshlab, prepare
from tests.geometry.surfaces import sphere
from tests.toy import SMALL_SCORER, rod, write_off

EXECUTED = Path(__file__).parents[1] / "examples" / "from_python.ipynb"
NOTEBOOK = Path(__file__).parents[1] / "examples" / "first_table.ipynb"


@pytest.fixture(autouse=True)
def without_workers(request):
    if "slow" not in request.keywords:
        request.getfixturevalue("in_this_process")


def flat_shape(shape):
    return shape.mesh.vertices * [1, 1, 0.5]


def broken(shape):
    return topp  # noqa: F821


def test_dir_lists_what_there_is():
    assert dir(benchmark) == [
        "canonical_form_of_depth",
        "canonicalise",
        "compare",
        "demo",
        "describe",
        "forget",
        "listing",
        "merge",
        "open_results",
        "plan",
        "retrieve",
        "run",
        "score",
        "side_by_side",
        "tables",
        "train",
        "write_report",
    ]
    with pytest.raises(AttributeError, match="module 'benchmark' has no attribute 'rum'"):
        _ = benchmark.rum


def test_jobs_run_in_this_process_once_with_a_line_of_progress(rods, tmp_path, capfd):
    methods = ["identity", ClassicMDS(), flat_shape, broken]
    chosen: Any = {"scorer": SMALL_SCORER, "results": tmp_path / "results"}
    jobs = benchmark.run(rods, methods, **chosen)
    jobs = jobs.reset_index().set_index("method")
    assert list(jobs.index) == ["classic-mds", "identity", "flat-shape", "broken"]
    assert list(jobs["status"]) == ["ok", "ok", "ok", "failed"]
    assert re.search(
        r"test_notebook.py:\d+: NameError: name 'topp' is not defined", jobs.loc["broken", "reason"]
    )
    out, err = capfd.readouterr()
    assert not out
    # Kernels that no earlier run has compiled are named first.
    lines = [line for line in err.splitlines() if not re.match(r"(compiling )?kernels ?", line)]
    assert lines
    assert all(re.match(r"\d+/\d+ steps, .+", line) for line in lines)
    again = benchmark.run(rods, methods[:3], **chosen).reset_index().set_index("method")
    assert (again["finished"] == jobs["finished"][:3]).tolist() == [
        True,
        True,
        False,
    ]  # who knows what it depends on
    keys = again["job"]
    form = benchmark.open_results(tmp_path / "results").form(keys["flat-shape"], "thin0")
    prepared = benchmark.open_results(tmp_path / "results").form(keys["identity"], "thin0")
    np.testing.assert_allclose(form.vertices, prepared.vertices * [1, 1, 0.5], atol=1e-6)


def test_a_surface_is_prepared_as_in_a_run():
    mesh = rod(0.1, 1.0)
    form = benchmark.canonicalise(mesh.vertices, mesh.faces, "gps")
    prepared = prepare(mesh)
    expected = GPS().canonicalise(Shape(identifier="rod", mesh=prepared.mesh)).vertices
    np.testing.assert_array_equal(form.vertices, expected[prepared.numbers_of(mesh)])
    np.testing.assert_array_equal(
        benchmark.canonicalise(mesh.vertices, mesh.faces, GPS()).vertices, form.vertices
    )
    assert (
        benchmark.canonicalise(
            mesh.vertices, mesh.faces, flat_shape, n_vertices=100
        ).vertices.shape[1]
        == 3
    )
    with pytest.raises(InvalidMesh):
        benchmark.canonicalise(mesh.vertices * np.nan, mesh.faces)


def test_forms_have_the_vertices_of_the_file_in_their_order_or_a_map_to_them(tmp_path):
    ball = sphere(4)
    meshes = {f"ball{n}": ball.with_vertices(ball.vertices * [1, 1, 1 + n / 4]) for n in range(2)}
    meshes |= {f"rod{n}": rod(0.1, n / 2) for n in range(2)}
    for name, mesh in meshes.items():
        write_off(tmp_path / "data" / f"{name}.off", mesh)
    chosen: Any = {"scorer": SMALL_SCORER, "results": tmp_path / "results"}
    key = benchmark.run(tmp_path / "data", "identity", **chosen).index[0]
    results = benchmark.open_results(tmp_path / "results")
    for name, mesh in meshes.items():
        form, numbers = results.form(key, name), results.vertex_map(key, name)
        own = benchmark.canonicalise(mesh.vertices, mesh.faces, "identity")
        given = (mesh.vertices - mesh.vertices.mean(axis=0)) / mesh.area**0.5
        np.testing.assert_allclose(own.vertices, form.vertices, atol=1e-6)
        if name.startswith("rod"):
            assert own.vertex_map is None
            np.testing.assert_array_equal(numbers, np.arange(mesh.n_vertices))
            assert (
                np.sort(form.faces, axis=None).tolist() == np.sort(mesh.faces, axis=None).tolist()
            )
        else:
            np.testing.assert_array_equal(numbers, own.vertex_map)
            assert len(numbers) == form.n_vertices < mesh.n_vertices
        nearest = np.linalg.norm(form.vertices[:, None] - given, axis=2).argmin(axis=1)
        assert (numbers == nearest).mean() > 0.98  # decimation moves the centre a little
    with pytest.raises(
        ConfigurationError, match="the form of rod0 has vertices of its own, or is not in"
    ):
        views = benchmark.run(tmp_path / "data", "identity", input="view", **chosen)
        benchmark.open_results(tmp_path / "results").vertex_map(
            views[views["input"] == "view"].index[0], "rod0"
        )


@pytest.mark.slow
def test_the_cells_of_the_notebook_run_one_after_the_other(tmp_path, monkeypatch):
    mpl.use("Agg")
    monkeypatch.chdir(tmp_path)
    found: dict[str, Any] = {}
    for cell in json.loads(NOTEBOOK.read_text())["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), found)  # noqa: S102
    assert list(found["jobs"]["status"]) == ["ok"] * 3
    assert len(found["sweep"]) == 3
    assert len(found["curves"]) == 8
    assert found["form"].n_vertices > 100


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_cells_of_the_executed_notebook_run_and_its_outputs_are_committed_and_small(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    cells = [cell for cell in json.loads(EXECUTED.read_text())["cells"] if "outputs" in cell]
    found: dict[str, Any] = {"__name__": "notebook"}
    monkeypatch.setitem(sys.modules, "notebook", ModuleType("notebook"))
    for cell in cells:
        exec("".join(cell["source"]), found)  # noqa: S102
    assert list(found["jobs"]["status"]) == ["ok"] * 4
    assert found["merged"].conflicts == []
    assert "tabular" in found["table"].latex()
    assert EXECUTED.stat().st_size < 700_000
    assert all(cell["outputs"] for cell in cells[1:] if cell["source"])
    assert not any(out["output_type"] == "error" for cell in cells for out in cell["outputs"])


def test_pymeshlab_is_not_loaded_in_another_thread_first(monkeypatch):
    monkeypatch.delitem(sys.modules, "pymeshlab", raising=False)
    with (
        ThreadPoolExecutor(1) as pool,
        pytest.raises(ConfigurationError, match="write 'import pymeshlab' in the main"),
    ):
        pool.submit(import_pymeshlab).result()
