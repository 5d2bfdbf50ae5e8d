"""Results in Python."""

import numpy as np
import pytest

from benchmark.depth_forms import canonical_form_of_depth
from benchmark.errors import BenchmarkError
from benchmark.report.results import open_results
from tests.behaviour.suite import MEASURES

RODS = ["thick0", "thick1", "thick2", "thin0", "thin1", "thin2"]


@pytest.fixture(scope="module")
def today(ran):
    return open_results(ran / "results", plugins=[ran / "own.py"])


def key_of(results, method, input_="mesh", gallery="rods"):
    records = results.records()
    wanted = records[(records.method == method) & (records.input == input_) & (records.gallery == gallery)]
    return wanted.index.item()


def test_queries_of_today(today):
    queries = today.queries(key_of(today, "flat"))
    assert list(queries["shape"]) == RODS
    assert list(queries["subject"]) == ["thick"] * 3 + ["thin"] * 3
    assert queries["NN"].mean().round(6) == 0.888889
    broken = today.records().loc[key_of(today, "broken")]
    assert "a fault of a test" in broken.reason
    assert np.isnan(broken.NN)
    picky = today.records().loc[key_of(today, "picky")]
    assert (picky.unsupported, round(picky.coverage, 6)) == (1, 0.833333)


def test_results_of_today(today):
    records = today.records()
    assert all(not text or text.startswith("edited") for text in records.outdated)
    key = key_of(today, "gps")
    assert tuple(records.loc[key, list(MEASURES)].round(6)) == (1.0, 0.958333, 0.986111, 0.980022)


def test_arrays_of_today(today, place):
    key = key_of(today, "gps")
    if changed := today.records().outdated[key]:
        pytest.skip(changed)  # code was edited, and golden results were not yet compared
    distances = today.distances(key)
    assert list(distances.index) == list(distances.columns) == RODS
    assert np.array_equal(distances, distances.T)
    assert not np.diag(distances).any()
    matrices = today.distance_matrices(key)
    assert matrices.shape == (3, 6, 6)
    assert np.allclose(matrices.mean(axis=0), distances)
    forms = today.forms(key)
    assert list(forms) == RODS
    assert {form.vertices.shape for form in forms.values()} == {(130, 3)}
    descriptors = today.descriptors(key_of(today, "surface-area"))
    assert descriptors.shape == (6, 1)
    with pytest.raises(BenchmarkError, match="descriptors"):
        today.forms(key_of(today, "surface-area"))


def test_the_form_of_a_depth_image(material):
    depth = np.load(material / "frames" / "lean0.npy")
    camera = (262.5, 262.5, 159.5, 119.5)
    matrix = np.array([[262.5, 0, 159.5], [0, 262.5, 119.5], [0, 0, 1]])
    form = canonical_form_of_depth(depth, camera, method="gps")
    assert form.vertices.shape == (1523, 3)
    assert form.faces.shape[1] == 3
    again = canonical_form_of_depth((1000 * depth).astype(np.uint16), matrix, depth < 2.5, "gps", seed=1)
    assert abs(len(again.vertices) - len(form.vertices)) < 50
    with pytest.raises(BenchmarkError):
        canonical_form_of_depth(np.zeros_like(depth), camera, method="gps")


def test_no_results(tmp_path):
    with pytest.raises(BenchmarkError, match="nowhere"):
        open_results(tmp_path / "nowhere")
