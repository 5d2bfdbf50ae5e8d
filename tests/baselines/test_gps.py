import numpy as np
import pytest

from baselines.gps import GPS
from benchmark.api.contracts import Shape
from tests.baselines.embedding import sphere


def test_a_sphere_becomes_a_sphere():
    # Eigenvalue 2 three times; the three functions have squares that sum to 3 / (4 pi), over 2 gives the radius.
    form = GPS().canonicalise(Shape(identifier="sphere", mesh=sphere(1500)))
    np.testing.assert_allclose(np.linalg.norm(form.vertices, axis=1), np.sqrt(3 / (8 * np.pi)), rtol=0.02)
    assert form.notes["eigenvalue_1"] == pytest.approx(8 * np.pi, rel=0.01)
    assert form.notes["eigenvalue_gap_12"] == pytest.approx(0, abs=0.02)
    assert form.notes["eigenvalue_gap_34"] == pytest.approx(2, rel=0.02)
