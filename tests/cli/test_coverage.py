"""A method that refuses shapes: they are failed queries."""

import json

import pytest

from benchmark.report.results import open_results
from tests.toy import write_rods
from tests.verbs import call

pytestmark = pytest.mark.usefixtures("forked_workers")

#: Returns the mesh as it is, but for shapes that are bent.
REFUSING = """
from benchmark.api.contracts import UnsupportedShape, canonical_form


@canonical_form(name="refusing", title="Refusing", inputs=("mesh",))
def refusing(shape):
    low, high = shape.mesh.vertices.min(axis=0), shape.mesh.vertices.max(axis=0)
    if (high - low)[2] > 0.8 * (high - low)[0]:
        raise UnsupportedShape("too bent", "straighten it")
    return shape.mesh.vertices
"""


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    folder = tmp_path_factory.mktemp("coverage")
    write_rods(folder / "rods", bends=(0.0, 0.3, 2.4))
    (folder / "refusing.py").write_text(REFUSING)
    selection = ("-d", folder / "rods", "--plugin", folder / "refusing.py", "--results", folder / "results")
    call("run", *selection, "-m", "identity", "-m", "refusing", "--input", "mesh", "-j", "0")
    return folder, selection


def rows(ran):
    _, selection = ran
    return {row["method"]: row for row in json.loads(call("tables", *selection, "--format", "json"))}


def test_a_refused_shape_is_a_failed_query(ran):
    found = rows(ran)
    refusing, identity = found["refusing"], found["identity"]
    assert (refusing["unsupported"], refusing["n_shapes"]) == (2, 6)
    assert refusing["coverage"] == pytest.approx(4 / 6)
    assert identity["coverage"] == 1
    assert refusing["chance"] == identity["chance"]
    for measure in ("NN", "FT", "ST", "DCG"):
        assert refusing[measure] <= 4 / 6 + 1e-6
    assert refusing["NN_supported"] >= refusing["NN"]
    assert "NN_supported" not in identity
    queries = open_results(ran[0] / "results").queries(*[
        key for key, row in open_results(ran[0] / "results").records().iterrows() if row["method"] == "refusing"
    ])  # fmt: skip
    assert len(queries) == 6
    assert (queries["NN"] == 0).sum() >= 2
