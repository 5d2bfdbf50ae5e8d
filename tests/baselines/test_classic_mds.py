import numpy as np
import pytest
from scipy.spatial.distance import cdist

from baselines._kernels.orientation import canonical_signs, vertex_areas
from baselines.classic_mds import ClassicMDS, classic_scaling
from tests.baselines.embedding import PointShape, points_on_ellipsoid, spread

pytestmark = pytest.mark.kernels


@pytest.mark.parametrize("n", [4, 64, 301])
def test_points_in_space_are_recovered(n):
    points = np.random.default_rng(n).standard_normal((n, 3)) * [3, 2, 1]
    embedded, ratios = classic_scaling(cdist(points, points))
    np.testing.assert_allclose(spread(embedded), spread(points), atol=1e-8)
    assert ratios[3] == pytest.approx(0, abs=1e-9)


def test_a_euclidean_shape_comes_back_in_its_canonical_frame():
    points = points_on_ellipsoid()
    shape = PointShape(points)
    form = ClassicMDS().canonicalise(shape)
    np.testing.assert_allclose(spread(form.vertices), spread(points), atol=1e-8)
    assert form.notes["stress"] == pytest.approx(0, abs=1e-12)
    assert (canonical_signs(form.vertices, vertex_areas(shape.mesh), shape.mesh.vertices)[:2] == 1).all()
    assert form.notes["handedness"] >= 0
    mirrored = ClassicMDS().canonicalise(PointShape(points * [1, 1, -1]))
    np.testing.assert_allclose(mirrored.vertices, form.vertices, atol=1e-8)


def test_negative_eigenvalues_count_as_zero():
    # Four corners of a square with shortest paths along its sides: eigenvalues 2, 2, 0 and -1 by hand.
    ring = np.array([[0, 1, 2, 1], [1, 0, 1, 2], [2, 1, 0, 1], [1, 2, 1, 0]], dtype=float)
    points, ratios = classic_scaling(ring)
    np.testing.assert_allclose(ratios, [1, 1, 0, -0.5], atol=1e-12)
    np.testing.assert_allclose(points[:, 2], 0, atol=1e-7)
    np.testing.assert_allclose(spread(points)[0], [0, np.sqrt(2), 2, np.sqrt(2)], atol=1e-7)
