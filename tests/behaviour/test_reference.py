"""The comparison with the reference names what changed."""

import pytest

from tools.reference import compare

ROW, OTHER = "animals (quick), mesh, gps", "animals (quick), mesh, shape-dna"
ROWS = {ROW: {"NN": [1.0, 0.0], "distance": [1234.56, None]}, OTHER: {"status": ["failed"]}}


@pytest.mark.parametrize(
    ("changes", "lines"),
    [
        ({}, []),
        ({ROW: {"NN": [1.0, 1e-6], "distance": [1234.561, None]}}, []),  # the last of six digits
        ({ROW: {"NN": [0.0, 1.0], "distance": [1234.56, None]}}, [f"{ROW}: NN by 1"]),
        ({ROW: {"NN": [1.0], "distance": [1234.56, 2.0]}}, [f"{ROW}: NN of other queries, distance None -> 2.0"]),
        ({OTHER: {"status": ["ok"]}}, [f"{OTHER}: status failed -> ok"]),
        ({"tosca (quick), mesh, gps": {}}, ["tosca (quick), mesh, gps: new"]),
    ],
)
def test_what_changed_is_named(changes, lines):
    assert compare(ROWS, ROWS | changes) == lines
    assert compare(ROWS | {"gone": {}}, ROWS) == ["gone: missing"]
